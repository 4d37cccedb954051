//! Communication of the renderer and its workers: orders and answers between the renderer and each worker, rows and
//! aborts among workers, and signs of life. Sending never blocks.

use std::time::Duration;

use super::messages::{Message, Order, Reply};
use super::watchdog::{Heartbeat, LifeSign};

/// The renderer's end. Methods identify a worker by the number of its device in the run.
pub trait RendererTransport: Send {
    /// Sends an order to a device's worker; returns false if the worker has ended.
    fn order(&self, device: usize, order: Order) -> bool;

    /// Closes the order channel of this device's worker, which makes the worker end.
    fn close(&mut self, device: usize);

    /// Returns the next answer of any worker, if one arrives within `limit`.
    fn reply(&self, limit: Duration) -> Option<Reply>;

    /// Tells all workers to stop waiting for rows of this attempt.
    fn call_off(&self, ticket: u64);

    /// Returns the signs of life of all workers, by device.
    fn signs(&self) -> Vec<LifeSign>;

    /// Returns true if a worker has ended, or ends within `limit`.
    fn ends(&self, device: usize, limit: Duration) -> bool;
}

/// A worker's end. The worker counts as ended once this is dropped.
pub trait WorkerTransport: Send {
    /// Returns the next order. With `waits`, it blocks until there is one, and `None` means that there will be no
    /// more.
    fn order(&self, waits: bool) -> Option<Order>;

    /// Returns the next message, if one arrives within `limit`.
    fn message(&self, limit: Duration) -> Option<Message>;

    /// Sends a message to another worker. Nothing happens if that worker has ended.
    fn send(&self, to: usize, message: Message);

    /// Tells all other workers to stop waiting for rows of this attempt.
    fn call_off(&self, ticket: u64);

    /// Answers the renderer, if it still exists.
    fn answer(&self, reply: Reply);

    /// Returns the heartbeat through which the worker gives signs of life.
    fn heartbeat(&self) -> &Heartbeat;
}
