//! Communication of the renderer and its workers within one process, over unbounded channels: orders and answers between
//! the renderer and each worker, rows and aborts among workers, and signs of life. Sending never blocks.

use std::sync::Arc;
use std::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use super::messages::{Message, Order, Reply};
use super::watchdog::{Heartbeat, LifeSign};

/// The renderer's end. Methods identify a worker by the number of its device in the run.
pub struct RendererChannels {
    workers: Vec<WorkerLine>,
    replies: Receiver<Reply>,
}

/// The renderer's channels to one worker, and the heartbeat of that worker.
struct WorkerLine {
    /// `None` once closed.
    orders: Option<Sender<Order>>,
    inbox: Sender<Message>,
    heartbeat: Arc<Heartbeat>,
    /// Disconnected once the worker has ended.
    ended: Receiver<()>,
}

/// A worker's end. The worker counts as ended once this is dropped.
pub struct WorkerChannels {
    device: usize,
    orders: Receiver<Order>,
    inbox: Receiver<Message>,
    /// Inboxes of all workers, by device.
    inboxes: Vec<Sender<Message>>,
    replies: Sender<Reply>,
    heartbeat: Arc<Heartbeat>,
    /// Carries no messages. Dropping it disconnects [`WorkerLine::ended`].
    _here: Sender<()>,
}

/// Creates the renderer's end and the ends of the workers, one per device.
pub fn channels(devices: usize) -> (RendererChannels, Vec<WorkerChannels>) {
    let (reply, replies) = unbounded();
    let (inboxes, receivers): (Vec<_>, Vec<_>) = (0..devices).map(|_| unbounded()).unzip();
    let (mut lines, mut workers) = (Vec::new(), Vec::new());
    for (device, inbox) in receivers.into_iter().enumerate() {
        let (sender, orders) = unbounded();
        let (here, ended) = unbounded();
        let heartbeat = Arc::<Heartbeat>::default();
        workers.push(WorkerChannels {
            device,
            orders,
            inbox,
            inboxes: inboxes.clone(),
            replies: reply.clone(),
            heartbeat: Arc::clone(&heartbeat),
            _here: here,
        });
        lines.push(WorkerLine { orders: Some(sender), inbox: inboxes[device].clone(), heartbeat, ended });
    }
    (RendererChannels { workers: lines, replies }, workers)
}

impl RendererChannels {
    /// Returns the receiver of all workers' answers.
    pub fn replies(&self) -> &Receiver<Reply> {
        &self.replies
    }

    /// Sends an order to a device's worker; returns false if the worker has ended.
    pub fn order(&self, device: usize, order: Order) -> bool {
        self.workers[device].orders.as_ref().is_some_and(|orders| orders.send(order).is_ok())
    }

    /// Closes the order channel of this device's worker, which makes the worker end.
    pub fn close(&mut self, device: usize) {
        self.workers[device].orders = None;
    }

    /// Returns the next answer of any worker, if one arrives within `limit`.
    pub fn reply(&self, limit: Duration) -> Option<Reply> {
        self.replies.recv_timeout(limit).ok()
    }

    /// Tells all workers to stop waiting for rows of this attempt.
    pub fn call_off(&self, ticket: u64) {
        for worker in &self.workers {
            // A worker that has ended needs no message.
            let _ = worker.inbox.send(Message::Abort { ticket });
        }
    }

    /// Returns the signs of life of all workers, by device.
    pub fn signs(&self) -> Vec<LifeSign> {
        self.workers.iter().map(|w| w.heartbeat.sign()).collect()
    }

    /// Returns true if a worker has ended, or ends within `limit`.
    pub fn ends(&self, device: usize, limit: Duration) -> bool {
        self.workers[device].ended.recv_timeout(limit) == Err(RecvTimeoutError::Disconnected)
    }
}

impl WorkerChannels {
    /// Returns the receivers of orders and messages, for a thread that forwards them to a worker on another rank.
    pub fn receivers(&self) -> (&Receiver<Order>, &Receiver<Message>) {
        (&self.orders, &self.inbox)
    }

    /// Returns the senders to the inboxes of all workers, and to the renderer.
    pub fn senders(&self) -> (Vec<Sender<Message>>, Sender<Reply>) {
        (self.inboxes.clone(), self.replies.clone())
    }

    /// Returns the next order. With `waits`, it blocks until there is one, and `None` means that there will be no
    /// more.
    pub fn order(&self, waits: bool) -> Option<Order> {
        if waits { self.orders.recv().ok() } else { self.orders.try_recv().ok() }
    }

    /// Returns the next message, if one arrives within `limit`.
    pub fn message(&self, limit: Duration) -> Option<Message> {
        // With a limit of 0, this does not read the clock.
        if limit.is_zero() { self.inbox.try_recv().ok() } else { self.inbox.recv_timeout(limit).ok() }
    }

    /// Sends a message to another worker. Nothing happens if that worker has ended.
    pub fn send(&self, to: usize, message: Message) {
        // Ignore the error: a worker that has ended needs no messages.
        let _ = self.inboxes[to].send(message);
    }

    /// Tells all other workers to stop waiting for rows of this attempt.
    pub fn call_off(&self, ticket: u64) {
        for to in (0..self.inboxes.len()).filter(|to| *to != self.device) {
            self.send(to, Message::Abort { ticket });
        }
    }

    /// Answers the renderer, if it still exists.
    pub fn answer(&self, reply: Reply) {
        // The receiver is gone if the run has ended.
        let _ = self.replies.send(reply);
    }

    /// Returns the heartbeat through which the worker gives signs of life.
    pub fn heartbeat(&self) -> &Heartbeat {
        &self.heartbeat
    }
}
