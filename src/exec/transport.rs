//! How the renderer and its workers reach one another: commands and answers between the renderer and each worker, rows
//! and calls to stop among workers, and signs of life. Sending never waits.

use std::time::Duration;

use super::messages::{Command, Message, Reply};
use super::watchdog::{Heartbeat, LifeSign};

/// The renderer's end. Devices go by their numbers in the run.
pub trait RendererTransport: Send {
    /// Gives a command to a device's worker; returns whether there still is one.
    fn command(&self, device: usize, command: Command) -> bool;

    /// There will be no more commands for this device's worker, which ends upon that.
    fn close(&mut self, device: usize);

    /// The next answer of any worker, if one comes within this time.
    fn reply(&self, limit: Duration) -> Option<Reply>;

    /// Tells all workers that nobody need wait for rows of this attempt.
    fn call_off(&self, ticket: u64);

    /// Of all workers, by device.
    fn signs(&self) -> Vec<LifeSign>;

    /// Whether a worker has ended, or ends within this time.
    fn ends(&self, device: usize, limit: Duration) -> bool;
}

/// A worker's end. It counts as ended once this is dropped.
pub trait WorkerTransport: Send {
    /// The next command; waits for one if `waits`, and then none means that there will be none any more.
    fn command(&self, waits: bool) -> Option<Command>;

    /// The next message, if one comes within this time.
    fn message(&self, limit: Duration) -> Option<Message>;

    /// Sends a message to another worker. One that has ended waits for nothing.
    fn send(&self, to: usize, message: Message);

    /// Tells all other workers that nobody need wait for rows of this attempt.
    fn call_off(&self, ticket: u64);

    /// Answers the renderer, if there still is one.
    fn answer(&self, reply: Reply);

    /// Where signs of life are given.
    fn heartbeat(&self) -> &Heartbeat;
}
