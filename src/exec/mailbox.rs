//! What workers send one another: rows, and calls to stop.

use std::collections::{BTreeSet, HashMap};
use std::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender};

use super::messages::{Message, Stop};

/// One worker's end of it.
pub struct Mailbox {
    device: usize,
    inbox: Receiver<Message>,
    /// Of all workers.
    outboxes: Vec<Sender<Message>>,
    /// Rows that came before they were asked for, by ticket and transfer.
    early: HashMap<(u64, u32), Vec<u8>>,
    /// Attempts that were called off.
    aborted: BTreeSet<u64>,
    /// All attempts below are over.
    floor: u64,
}

impl Mailbox {
    pub fn new(device: usize, inbox: Receiver<Message>, outboxes: Vec<Sender<Message>>) -> Self {
        Self { device, inbox, outboxes, early: HashMap::new(), aborted: BTreeSet::new(), floor: 0 }
    }

    /// Attempts below this one are over; what belongs to them is dropped.
    pub fn forget_below(&mut self, ticket: u64) {
        self.floor = ticket;
        self.early.retain(|(t, _), _| *t >= ticket);
        self.aborted.retain(|t| *t >= ticket);
    }

    pub fn send(&self, to: usize, ticket: u64, transfer: u32, bytes: Vec<u8>) -> Result<(), Stop> {
        self.outboxes[to].send(Message::Rows { ticket, transfer, bytes }).map_err(|_| Stop::Aborted)
    }

    /// Tells all others that this device sends nothing more for this attempt.
    pub fn call_off(&self, ticket: u64) {
        for (_, outbox) in self.outboxes.iter().enumerate().filter(|(i, _)| *i != self.device) {
            // A worker that is gone waits for nothing.
            let _ = outbox.send(Message::Abort { ticket });
        }
    }

    /// Takes in what has come.
    ///
    /// # Errors
    /// [`Stop::Aborted`] if this attempt was called off.
    pub fn look(&mut self, ticket: u64) -> Result<(), Stop> {
        while let Ok(message) = self.inbox.try_recv() {
            self.take_in(message);
        }
        if self.aborted.contains(&ticket) { Err(Stop::Aborted) } else { Ok(()) }
    }

    /// Waits for something to come; returns whether it did.
    pub fn wait(&mut self, limit: Duration) -> Result<bool, Stop> {
        match self.inbox.recv_timeout(limit) {
            Ok(message) => {
                self.take_in(message);
                Ok(true)
            }
            Err(RecvTimeoutError::Timeout) => Ok(false),
            Err(RecvTimeoutError::Disconnected) => Err(Stop::Aborted),
        }
    }

    pub fn has(&self, ticket: u64, transfer: u32) -> bool {
        self.early.contains_key(&(ticket, transfer))
    }

    pub fn take(&mut self, ticket: u64, transfer: u32) -> Option<Vec<u8>> {
        self.early.remove(&(ticket, transfer))
    }

    fn take_in(&mut self, message: Message) {
        match message {
            // Rows of an attempt that was given up come late.
            Message::Rows { ticket, .. } | Message::Abort { ticket } if ticket < self.floor => {}
            Message::Rows { ticket, transfer, bytes } => drop(self.early.insert((ticket, transfer), bytes)),
            Message::Abort { ticket } => drop(self.aborted.insert(ticket)),
        }
    }
}
