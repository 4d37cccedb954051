//! Orders to workers, and the answers that have arrived.

/// Tickets of orders whose answers have not been taken, oldest first. `A` is the type of an answer.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Ledger<A> {
    asked: Vec<Asked<A>>,
    /// The last ticket that was issued.
    ticket: u64,
}

/// Orders under one ticket, with the devices that have not answered and the answers of the others.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Asked<A> {
    ticket: u64,
    awaited: Vec<usize>,
    answers: Vec<(usize, A)>,
}

impl<A> Default for Ledger<A> {
    fn default() -> Self {
        Self { asked: Vec::new(), ticket: 0 }
    }
}

impl<A> Ledger<A> {
    /// Issues a ticket for orders that these devices must answer.
    pub fn ask(&mut self, devices: Vec<usize>) -> u64 {
        self.ticket += 1;
        self.asked.push(Asked { ticket: self.ticket, awaited: devices, answers: Vec::new() });
        self.ticket
    }

    /// Returns the devices whose answers under this ticket are missing.
    pub fn awaited(&self, ticket: u64) -> &[usize] {
        self.asked.iter().find(|a| a.ticket == ticket).map_or(&[], |a| &a.awaited)
    }

    /// Records a device's answer. An answer is ignored if [`Self::answer_for`] has already answered for the device.
    pub fn answer(&mut self, ticket: u64, device: usize, answer: A) {
        if let Some(asked) = self.asked.iter_mut().find(|a| a.ticket == ticket && a.awaited.contains(&device)) {
            asked.awaited.retain(|d| *d != device);
            asked.answers.push((device, answer));
        }
    }

    /// Records `answer` for a device under every ticket that it has not answered. Returns these tickets, which the
    /// caller must cancel.
    pub fn answer_for(&mut self, device: usize, answer: impl Fn() -> A) -> Vec<u64> {
        let is_awaited = |a: &&Asked<A>| a.awaited.contains(&device);
        let tickets: Vec<u64> = self.asked.iter().filter(is_awaited).map(|a| a.ticket).collect();
        tickets.iter().for_each(|ticket| self.answer(*ticket, device, answer()));
        tickets
    }

    /// Removes and returns all answers under this ticket, each with its device. Returns `None` while any is missing,
    /// and an empty list for a ticket that is not in the ledger.
    pub fn take(&mut self, ticket: u64) -> Option<Vec<(usize, A)>> {
        match self.asked.iter().position(|a| a.ticket == ticket) {
            Some(place) if !self.asked[place].awaited.is_empty() => None,
            Some(place) => Some(self.asked.remove(place).answers),
            None => Some(Vec::new()),
        }
    }
}
