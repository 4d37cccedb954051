//! The link over MPI: non-blocking point-to-point messages on `MPI_COMM_WORLD`. Only the thread that initialises MPI
//! calls it (`MPI_THREAD_FUNNELED`).

use std::collections::VecDeque;

use mpi::environment::Universe;
use mpi::request::{Request, StaticScope};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, Destination, Equivalence, Source};
use mpi::{Rank, Tag, Threading};

use super::link::{Link, Way};

pub struct MpiLink {
    /// Sends in progress.
    sent: Vec<OnItsWay>,
    /// Receives in progress, each with the rank of its sender and its tag, in the order in which they began.
    coming: VecDeque<((usize, Tag), OnItsWay)>,
    world: SimpleCommunicator,
    /// `None` once the rank has left.
    universe: Option<Universe>,
}

/// Tags of messages by [`Way`]. Messages with the first tag are received first.
const TAGS: [Tag; 2] = [1, 0];

/// A message in progress, with the memory that it is sent from or received into.
struct OnItsWay {
    request: Request<'static, [u8], StaticScope>,
    packet: *mut [u8],
}

impl OnItsWay {
    /// Returns the packet if MPI has completed the message, otherwise the message itself.
    fn end(self) -> Result<Box<[u8]>, Self> {
        let Self { request, packet } = self;
        match request.test() {
            // SAFETY: the pointer is from a box, and nothing else reads or writes the memory any more.
            Ok(_) => Ok(unsafe { Box::from_raw(packet) }),
            Err(request) => Err(Self { request, packet }),
        }
    }
}

impl MpiLink {
    /// # Errors
    /// A message if MPI is initialised already, or does not support `MPI_THREAD_FUNNELED`.
    pub fn new() -> Result<Self, String> {
        #[cfg(target_os = "linux")]
        super::slices::ask_for_short_ones();
        let (universe, threading) =
            mpi::initialize_with_threading(Threading::Funneled).ok_or("MPI is initialised already")?;
        if threading < Threading::Funneled {
            return Err(format!("this MPI has no support for threads: it offers {threading:?}"));
        }
        let (sent, coming) = (Vec::new(), VecDeque::new());
        Ok(Self { sent, coming, world: universe.world(), universe: Some(universe) })
    }

    fn test_sent(&mut self) {
        self.sent = self.sent.drain(..).filter_map(|message| message.end().err()).collect();
    }

    /// Leaks the messages in flight: their buffers must stay valid, and their requests must not be dropped.
    fn give_up(&mut self) {
        std::mem::forget(std::mem::take(&mut self.sent));
        std::mem::forget(std::mem::take(&mut self.coming));
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

    fn send(&mut self, to: usize, packet: Vec<u8>, way: Way) {
        let packet = Box::into_raw(packet.into_boxed_slice());
        // SAFETY: the memory is freed only once the message is sent.
        let bytes: &'static [u8] = unsafe { &*packet };
        let process = self.world.process_at_rank(to as Rank);
        let request = process.immediate_send_with_tag(StaticScope, bytes, TAGS[way as usize]);
        self.sent.push(OnItsWay { request, packet });
        self.test_sent();
    }

    fn receive(&mut self) -> Option<(usize, Vec<u8>)> {
        let any = self.world.any_process();
        while let Some((message, status)) = TAGS.into_iter().find_map(|tag| any.immediate_matched_probe_with_tag(tag)) {
            let size = usize::try_from(status.count(u8::equivalent_datatype())).unwrap_or(0);
            let packet = Box::into_raw(vec![0; size].into_boxed_slice());
            // SAFETY: nothing reads the memory before the message has arrived.
            let bytes: &'static mut [u8] = unsafe { &mut *packet };
            let request = message.immediate_matched_receive_into(StaticScope, bytes);
            let from = (status.source_rank() as usize, status.tag());
            self.coming.push_back((from, OnItsWay { request, packet }));
        }
        // Small messages may complete before large ones that were sent earlier. Messages with the same sender and tag
        // must be returned in order, so a message waits for the earlier ones.
        let mut awaited = Vec::new();
        for at in 0..self.coming.len() {
            let from = self.coming[at].0;
            if awaited.contains(&from) {
                continue;
            }
            let (from, message) = self.coming.remove(at)?;
            match message.end() {
                Ok(packet) => return Some((from.0, packet.into_vec())),
                Err(message) => self.coming.insert(at, (from, message)),
            }
            awaited.push(from);
        }
        None
    }

    fn is_settled(&mut self) -> bool {
        self.test_sent();
        self.sent.is_empty() && self.coming.is_empty()
    }

    fn leave(&mut self) {
        self.give_up();
        self.universe = None;
    }

    fn abort(&mut self, status: u8) {
        self.give_up();
        self.world.abort(i32::from(status));
    }
}
