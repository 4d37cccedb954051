//! What carries bytes from rank to rank.

use crossbeam::channel::{Receiver, Sender, unbounded};

/// How a packet goes. Round trips do not wait for large packets that were sent before them, so that these leave no rank without
/// a sign of life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    RoundTrip,
    Other,
}

/// A rank's end. One thread has it.
pub trait Link {
    fn rank(&self) -> usize;

    /// How many ranks there are.
    fn ranks(&self) -> usize;

    /// The name of the machine.
    fn host(&self) -> String;

    /// Sends a packet to another rank and does not wait. Packets of one way from one rank to another arrive in their order.
    fn send(&mut self, to: usize, packet: Vec<u8>, way: Way);

    /// A packet that has come, if there is one, and the rank that it comes from.
    fn receive(&mut self) -> Option<(usize, Vec<u8>)>;

    /// Frees what was sent and is on its way; returns whether that is all, and all that has begun to come is here.
    fn is_settled(&mut self) -> bool;

    /// Leaves the others, which all ranks must do; waits for them where that is needed.
    fn leave(&mut self);

    /// Ends the processes of all ranks.
    fn abort(&mut self, status: u8);
}

/// A rank among threads of one process.
pub struct ChannelLink {
    rank: usize,
    inbox: Receiver<(usize, Vec<u8>)>,
    outboxes: Vec<Sender<(usize, Vec<u8>)>>,
}

/// The ends of so many ranks.
pub fn channel_links(ranks: usize) -> Vec<ChannelLink> {
    let (outboxes, inboxes): (Vec<_>, Vec<_>) = (0..ranks).map(|_| unbounded()).unzip();
    let link = |(rank, inbox)| ChannelLink { rank, inbox, outboxes: outboxes.clone() };
    inboxes.into_iter().enumerate().map(link).collect()
}

impl Link for ChannelLink {
    fn rank(&self) -> usize {
        self.rank
    }

    fn ranks(&self) -> usize {
        self.outboxes.len()
    }

    fn host(&self) -> String {
        format!("thread {}", self.rank)
    }

    fn send(&mut self, to: usize, packet: Vec<u8>, _: Way) {
        // A rank that has left waits for nothing.
        let _ = self.outboxes[to].send((self.rank, packet));
    }

    fn receive(&mut self) -> Option<(usize, Vec<u8>)> {
        self.inbox.try_recv().ok()
    }

    fn is_settled(&mut self) -> bool {
        true
    }

    fn leave(&mut self) {}

    fn abort(&mut self, _: u8) {}
}
