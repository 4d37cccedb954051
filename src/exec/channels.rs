//! The transport within one process: unbounded channels.

use std::sync::Arc;
use std::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use super::messages::{Command, Message, Reply};
use super::transport::{RendererTransport, WorkerTransport};
use super::watchdog::{Heartbeat, LifeSign};

pub struct RendererChannels {
    workers: Vec<WorkerLine>,
    replies: Receiver<Reply>,
}

/// What leads to a worker.
struct WorkerLine {
    /// None: closed.
    commands: Option<Sender<Command>>,
    inbox: Sender<Message>,
    heartbeat: Arc<Heartbeat>,
    /// Disconnected once the worker has ended.
    ended: Receiver<()>,
}

pub struct WorkerChannels {
    device: usize,
    commands: Receiver<Command>,
    inbox: Receiver<Message>,
    /// Of all workers.
    inboxes: Vec<Sender<Message>>,
    replies: Sender<Reply>,
    heartbeat: Arc<Heartbeat>,
    /// Nothing is ever sent; see [`WorkerLine::ended`].
    _here: Sender<()>,
}

/// The renderer's end and those of the workers of so many devices.
pub fn channels(devices: usize) -> (RendererChannels, Vec<WorkerChannels>) {
    let (reply, replies) = unbounded();
    let (inboxes, receivers): (Vec<_>, Vec<_>) = (0..devices).map(|_| unbounded()).unzip();
    let (mut lines, mut workers) = (Vec::new(), Vec::new());
    for (device, inbox) in receivers.into_iter().enumerate() {
        let (commands, orders) = unbounded();
        let (here, ended) = unbounded();
        let heartbeat = Arc::<Heartbeat>::default();
        workers.push(WorkerChannels {
            device,
            commands: orders,
            inbox,
            inboxes: inboxes.clone(),
            replies: reply.clone(),
            heartbeat: Arc::clone(&heartbeat),
            _here: here,
        });
        lines.push(WorkerLine { commands: Some(commands), inbox: inboxes[device].clone(), heartbeat, ended });
    }
    (RendererChannels { workers: lines, replies }, workers)
}

impl RendererChannels {
    /// The answers of all workers.
    pub fn replies(&self) -> &Receiver<Reply> {
        &self.replies
    }
}

impl WorkerChannels {
    /// Where commands and messages come from, for who passes them on to a worker elsewhere.
    pub fn receivers(&self) -> (&Receiver<Command>, &Receiver<Message>) {
        (&self.commands, &self.inbox)
    }

    /// What leads to all workers, and to the renderer.
    pub fn senders(&self) -> (Vec<Sender<Message>>, Sender<Reply>) {
        (self.inboxes.clone(), self.replies.clone())
    }
}

impl RendererTransport for RendererChannels {
    fn command(&self, device: usize, command: Command) -> bool {
        self.workers[device].commands.as_ref().is_some_and(|commands| commands.send(command).is_ok())
    }

    fn close(&mut self, device: usize) {
        self.workers[device].commands = None;
    }

    fn reply(&self, limit: Duration) -> Option<Reply> {
        self.replies.recv_timeout(limit).ok()
    }

    fn call_off(&self, ticket: u64) {
        for worker in &self.workers {
            // A worker that has ended waits for nothing.
            let _ = worker.inbox.send(Message::Abort { ticket });
        }
    }

    fn signs(&self) -> Vec<LifeSign> {
        self.workers.iter().map(|w| w.heartbeat.sign()).collect()
    }

    fn ends(&self, device: usize, limit: Duration) -> bool {
        self.workers[device].ended.recv_timeout(limit) == Err(RecvTimeoutError::Disconnected)
    }
}

impl WorkerTransport for WorkerChannels {
    fn command(&self, waits: bool) -> Option<Command> {
        if waits { self.commands.recv().ok() } else { self.commands.try_recv().ok() }
    }

    fn message(&self, limit: Duration) -> Option<Message> {
        // Without a limit, an empty channel costs no look at the clock.
        if limit.is_zero() { self.inbox.try_recv().ok() } else { self.inbox.recv_timeout(limit).ok() }
    }

    fn send(&self, to: usize, message: Message) {
        // See `RendererChannels::call_off`.
        let _ = self.inboxes[to].send(message);
    }

    fn call_off(&self, ticket: u64) {
        for to in (0..self.inboxes.len()).filter(|to| *to != self.device) {
            self.send(to, Message::Abort { ticket });
        }
    }

    fn answer(&self, reply: Reply) {
        // Nobody listens any more if the run has ended.
        let _ = self.replies.send(reply);
    }

    fn heartbeat(&self) -> &Heartbeat {
        &self.heartbeat
    }
}
