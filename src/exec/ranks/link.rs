//! Links that carry bytes between ranks.

/// Priority of a packet. Packets of round trips (pings and pongs) may overtake large packets that were sent before
/// them, so that large packets do not delay signs of life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    RoundTrip,
    Other,
}

/// A rank's end of the links to all other ranks. Only one thread uses it.
pub trait Link {
    fn rank(&self) -> usize;

    /// Returns the number of ranks.
    fn ranks(&self) -> usize;

    /// Returns the name of this rank's machine.
    fn host(&self) -> String;

    /// Sends a packet to another rank without blocking. Packets of one [`Way`] from one rank to another arrive in
    /// order.
    fn send(&mut self, to: usize, packet: Vec<u8>, way: Way);

    /// Returns a packet that has arrived, if there is one, and the rank that sent it.
    fn receive(&mut self) -> Option<(usize, Vec<u8>)>;

    /// Frees completed sends; returns true if no send or receive is in progress.
    fn is_settled(&mut self) -> bool;

    /// Disconnects this rank from the others, and waits for them if necessary. Every rank must call it.
    fn leave(&mut self);

    /// Ends the processes of all ranks.
    fn abort(&mut self, status: u8);
}
