//! [`Node`]: a rank's connection to all other ranks. The rank's threads send requests through it, and learn from it if
//! a rank is lost.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, bounded, unbounded};

use super::agree::Identity;
use super::link::Link;
use super::packet::{RankMessage, Request, Response};
use super::post::Post;
use super::renderer_devices::RendererDevices;
use super::shared::{Control, Shared};
use super::{RankError, Recorded};
use crate::schedule::Network;

/// Time limit for all ranks to join at the start.
const MEETING: Duration = Duration::from_secs(60);
/// Interval at which a wait for messages checks for lost ranks.
const SLICE: Duration = Duration::from_millis(20);

pub struct Node {
    rank: usize,
    ranks: usize,
    controls: Sender<Control>,
    messages: Mutex<Receiver<(usize, RankMessage)>>,
    shared: Arc<Shared>,
    pub(super) epoch: Instant,
    /// Next number of a request (`requests`), and next number of a renderer or of a set of devices (`numbers`).
    requests: AtomicU64,
    numbers: AtomicU32,
    thread: Mutex<Option<JoinHandle<()>>>,
}

/// Pending requests to all other ranks.
pub struct Asked {
    node: Arc<Node>,
    number: u64,
}

impl Node {
    /// Starts the post thread, creates the link on it, and joins the other ranks. Rank 0 calls `on_interrupt` with the
    /// signal number when another rank reports that a signal told it to end.
    ///
    /// # Errors
    /// A message if the link or its thread cannot be created.
    pub fn join<L: Link>(
        link: impl FnOnce() -> Result<L, String> + Send + 'static,
        on_interrupt: impl Fn(i32) + Send + 'static,
    ) -> Result<Arc<Self>, String> {
        let (controls, orders) = unbounded();
        let (message, messages) = unbounded();
        let (told, made) = bounded(1);
        let shared = Arc::<Shared>::default();
        let (epoch, of_post) = (Instant::now(), Arc::clone(&shared));
        let run = move || match link() {
            Ok(link) => {
                let _ = told.send(Ok((link.rank(), link.ranks(), link.host())));
                Post::new(link, orders, message, of_post, epoch, Box::new(on_interrupt)).run();
            }
            Err(what) => {
                let _ = told.send(Err(what));
            }
        };
        let thread = std::thread::Builder::new().name("post".to_owned()).spawn(run).map_err(|e| e.to_string())?;
        let (rank, ranks, host) = made.recv().map_err(|_| "the connecting thread has ended".to_owned())??;
        let node = Self {
            rank,
            ranks,
            controls,
            messages: Mutex::new(messages),
            shared,
            epoch,
            requests: AtomicU64::new(0),
            numbers: AtomicU32::new(0),
            thread: Mutex::new(Some(thread)),
        };
        *node.hosts() = vec![String::new(); ranks];
        node.hosts()[rank].clone_from(&host);
        if rank > 0 {
            node.tell(0, RankMessage::Hello(Identity::here(host)));
        }
        Ok(Arc::new(node))
    }

    pub fn rank(&self) -> usize {
        self.rank
    }

    /// Returns the number of ranks.
    pub fn ranks(&self) -> usize {
        self.ranks
    }

    /// Returns the name of a rank's machine.
    pub fn host(&self, rank: usize) -> String {
        self.shared.host(rank)
    }

    /// Returns the error of a lost rank, if there is one.
    pub fn lost(&self) -> Option<RankError> {
        self.shared.lost()
    }

    /// Returns the instant at which this rank's clock reads 0.
    pub fn epoch(&self) -> Instant {
        self.epoch
    }

    /// Takes the trace spans that other ranks have recorded since the last call.
    pub fn recorded(&self) -> Vec<Recorded> {
        std::mem::take(&mut *self.shared.recorded.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Returns the number of bytes of image rows that this rank has sent to other ranks.
    pub fn row_bytes(&self) -> u64 {
        self.shared.row_bytes.load(Ordering::Relaxed)
    }

    /// Returns a model of the network, with the mean latency and time per byte between rank 0 and the others. `ranks`
    /// holds the rank of each device.
    pub(super) fn network(&self, ranks: Vec<usize>) -> Network {
        let links = self.shared.links.lock().unwrap_or_else(PoisonError::into_inner);
        let others = links.get(1..).unwrap_or_default();
        let mean = |of: fn(&(f64, f64)) -> f64| others.iter().map(of).sum::<f64>() / others.len().max(1) as f64;
        Network { ranks, latency_ms: mean(|link| link.0), ms_per_byte: mean(|link| link.1) }
    }

    fn hosts(&self) -> MutexGuard<'_, Vec<String>> {
        self.shared.hosts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for all other ranks, and checks that they run the same program. Only rank 0 calls it.
    ///
    /// # Errors
    /// [`RankError`] of the first rank that runs another program, or does not join in time.
    pub fn meet(&self) -> Result<(), RankError> {
        let (here, begin) = (Identity::here(self.host(0)), Instant::now());
        let mut missing: Vec<usize> = (1..self.ranks).collect();
        let mut refused = Vec::new();
        while let Some(&first) = missing.first() {
            self.check_lost()?;
            if begin.elapsed() > MEETING {
                let what = format!("it did not join within {} s", MEETING.as_secs());
                return Err(RankError::Lost { rank: first, host: String::new(), what });
            }
            let Some((rank, RankMessage::Hello(there))) = self.message(SLICE) else { continue };
            self.hosts()[rank].clone_from(&there.host);
            missing.retain(|other| *other != rank);
            refused.extend(here.check(&there).err().map(|what| (rank, what)));
        }
        refused.sort();
        refused.into_iter().next().map_or(Ok(()), |(rank, what)| Err(self.refusal(rank, what)))
    }

    pub(super) fn refusal(&self, rank: usize, what: String) -> RankError {
        RankError::Refused { rank, host: self.host(rank), what }
    }

    fn check_lost(&self) -> Result<(), RankError> {
        self.lost().map_or(Ok(()), Err)
    }

    /// Returns a new number for a renderer or a set of devices.
    pub(super) fn number(&self) -> u32 {
        self.numbers.fetch_add(1, Ordering::Relaxed)
    }

    /// Sends a request to every other rank.
    pub fn ask(self: &Arc<Self>, request: &Request) -> Asked {
        let number = self.requests.fetch_add(1, Ordering::Relaxed);
        for rank in 1..self.ranks {
            self.tell(rank, RankMessage::Request { number, request: Box::new(request.clone()) });
        }
        Asked { node: Arc::clone(self), number }
    }

    pub(super) fn tell(&self, to: usize, message: RankMessage) {
        self.control(Control::Send { to, message });
    }

    pub(super) fn attach(&self, number: u32, renderer: RendererDevices) {
        self.control(Control::Attach { number, renderer: Box::new(renderer) });
    }

    pub(super) fn detach(&self, number: u32) {
        self.control(Control::Detach { number });
    }

    fn control(&self, control: Control) {
        // Ignore the error: the post thread receives controls until this rank leaves.
        let _ = self.controls.send(control);
    }

    /// Returns the next message from another rank, with the number of that rank, if one arrives within `limit`.
    pub(super) fn message(&self, limit: Duration) -> Option<(usize, RankMessage)> {
        let messages = self.messages.lock().unwrap_or_else(PoisonError::into_inner);
        messages.recv_timeout(limit).ok()
    }

    /// On rank 0, ends the run on all ranks with this exit status; on other ranks, only disconnects this rank. If a
    /// rank is lost, aborts the processes of all ranks with this status, but at least 1.
    pub fn end(&self, status: u8) {
        let Some(thread) = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take() else { return };
        if self.lost().is_some() {
            self.control(Control::Abort { status: status.max(1) });
        } else {
            if self.rank == 0 {
                (1..self.ranks).for_each(|rank| self.tell(rank, RankMessage::End { status }));
            }
            self.control(Control::Leave);
        }
        // Ignore the result: if the thread has panicked, it has already printed the message.
        let _ = thread.join();
    }
}

impl Asked {
    /// Waits for the responses of all other ranks and returns them in order of rank.
    ///
    /// # Errors
    /// [`RankError`] of the first rank that could not execute the request, or is lost.
    pub fn wait(self) -> Result<Vec<Response>, RankError> {
        let node = &self.node;
        let mut answers: Vec<Option<Result<Response, String>>> = (1..node.ranks).map(|_| None).collect();
        while answers.iter().any(Option::is_none) {
            node.check_lost()?;
            if let Some((rank, RankMessage::Response { number, response })) = node.message(SLICE)
                && number == self.number
            {
                answers[rank - 1] = Some(response);
            }
        }
        let answers = (1..).zip(answers.into_iter().flatten());
        answers.map(|(rank, answer)| answer.map_err(|what| node.refusal(rank, what))).collect()
    }
}
