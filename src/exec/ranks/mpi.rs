//! The link of MPI: non-blocking point-to-point messages of the world's communicator, driven by one thread
//! (`MPI_THREAD_FUNNELED`), the one that initialises MPI.

use mpi::environment::Universe;
use mpi::point_to_point::MatchedReceiveVec;
use mpi::request::{Request, StaticScope};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, Destination, Source};
use mpi::{Rank, Threading};

use super::link::Link;

/// What starters of MPI programs tell each process, by which the number of them is known before MPI is initialised.
const SIZES: [&str; 4] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "SLURM_STEP_NUM_TASKS"];

pub struct MpiLink {
    /// Messages on their way.
    sent: Vec<Sent>,
    world: SimpleCommunicator,
    /// None: it has left.
    universe: Option<Universe>,
}

/// A message and the memory that it is sent from.
struct Sent {
    request: Request<'static, [u8], StaticScope>,
    packet: *mut [u8],
}

impl MpiLink {
    /// Whether several processes were started together.
    pub fn is_wanted() -> bool {
        let size = |name| std::env::var(name).ok().and_then(|text| text.parse().ok());
        SIZES.into_iter().filter_map(size).any(|size: u32| size > 1)
    }

    /// # Errors
    /// That MPI is not there, or cannot be driven by one of several threads.
    pub fn new() -> Result<Self, String> {
        let (universe, threading) =
            mpi::initialize_with_threading(Threading::Funneled).ok_or("MPI is initialised already")?;
        if threading < Threading::Funneled {
            return Err(format!("this MPI has no support for threads: it offers {threading:?}"));
        }
        Ok(Self { sent: Vec::new(), world: universe.world(), universe: Some(universe) })
    }
}

impl Link for MpiLink {
    fn rank(&self) -> usize {
        self.world.rank() as usize
    }

    fn ranks(&self) -> usize {
        self.world.size() as usize
    }

    fn host(&self) -> String {
        mpi::environment::processor_name().unwrap_or_default()
    }

    fn send(&mut self, to: usize, packet: Vec<u8>) {
        let packet = Box::into_raw(packet.into_boxed_slice());
        // SAFETY: the memory is given back only once the message is sent.
        let bytes: &'static [u8] = unsafe { &*packet };
        let request = self.world.process_at_rank(to as Rank).immediate_send(StaticScope, bytes);
        self.sent.push(Sent { request, packet });
        self.is_sent();
    }

    fn receive(&mut self) -> Option<(usize, Vec<u8>)> {
        let (packet, status) = self.world.any_process().immediate_matched_probe()?.matched_receive_vec();
        Some((status.source_rank() as usize, packet))
    }

    fn is_sent(&mut self) -> bool {
        let mut on_their_way = Vec::new();
        for Sent { request, packet } in self.sent.drain(..) {
            match request.test() {
                // SAFETY: it is from a box, and nobody reads it any more.
                Ok(_) => drop(unsafe { Box::from_raw(packet) }),
                Err(request) => on_their_way.push(Sent { request, packet }),
            }
        }
        self.sent = on_their_way;
        self.sent.is_empty()
    }

    fn leave(&mut self) {
        // What could not be sent stays where it is; its requests must not be dropped.
        std::mem::forget(std::mem::take(&mut self.sent));
        self.universe = None;
    }

    fn abort(&mut self, status: u8) {
        std::mem::forget(std::mem::take(&mut self.sent));
        self.world.abort(i32::from(status));
    }
}
