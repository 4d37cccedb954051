//! The worker's protocol, described in `src/exec/README.md`, as a state machine without I/O. The worker executes the
//! actions that the state machine returns and reports their outcomes to it. A test explores the state machine in every
//! order of events.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use super::action::{Action, Ordered, Outcome};
use crate::exec::messages::Message;
use crate::plan::{Command, Commands, Outgoing};

/// Number of time slices without a message after which a worker stops waiting for rows of other workers and abandons
/// the frame. A slice is an eighth of the device's time limit. The renderer detects a hung worker in fewer slices.
const DEPENDENT_SLICES: u32 = 32;

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Frame {
    ticket: u64,
    commands: Arc<Commands>,
    progress: Progress,
}

/// Progress of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Progress {
    /// The commands are being executed; holds the index of the next one.
    Command(usize),
    /// All tasks are submitted.
    Submitted,
    /// All tasks have ended, and images are being read back to the host.
    Read,
}

/// Position in the worker's loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum At {
    /// Between two steps, the worker takes a new order if there is one. A new frame takes priority over the remaining
    /// commands of older frames, so that the device stays busy while the host waits for rows of the older frames.
    Orders,
    /// The worker executes the newest frame's own tasks.
    Newest,
    /// If `waits`, the worker advances the oldest frame by one step, for which it may wait. Otherwise it advances the
    /// frames that are older than the newest as far as possible without waiting, and then returns to the newest.
    Oldest { waits: bool },
}

/// The state of a worker.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Protocol<B> {
    /// True if a submission blocks until the previous one has completed, as on lavapipe. Rows that others wait for are
    /// then sent before each submission, at the cost of a short gap. Hardware queues need no gap.
    submit_blocks: bool,
    /// Frames that are begun and not answered, oldest first. All but the newest have their own tasks submitted.
    open: VecDeque<Frame>,
    /// Rows to send to other devices: their copies to the host have been submitted, in this order.
    outgoing: VecDeque<Outgoing>,
    /// Tickets of the orders that have not been answered, oldest first.
    unanswered: Vec<u64>,
    /// Rows that arrived before they were needed, by ticket and transfer.
    early: BTreeMap<(u64, u32), B>,
    /// Tickets of cancelled attempts at a frame.
    aborted: BTreeSet<u64>,
    /// Lowest ticket that can still be open. Messages with lower tickets are dropped.
    floor: u64,
    has_failed: bool,
    at: At,
    /// Number of time slices without a message in the current wait for rows; `None` if the worker waits for none.
    receiving: Option<u32>,
    /// Actions that [`Self::next_action`] returns before any other.
    due: VecDeque<Action<B>>,
}

impl<B> Protocol<B> {
    /// Creates the state of a new worker. `submit_blocks` is true if a submission blocks until the previous one has
    /// completed.
    pub fn new(submit_blocks: bool) -> Self {
        Self {
            submit_blocks,
            open: VecDeque::new(),
            outgoing: VecDeque::new(),
            unanswered: Vec::new(),
            early: BTreeMap::new(),
            aborted: BTreeSet::new(),
            floor: 0,
            has_failed: false,
            at: At::Orders,
            receiving: None,
            due: VecDeque::new(),
        }
    }

    /// Returns the next action. Pass all messages that have arrived to [`Self::message`] first.
    pub fn next_action(&mut self) -> Action<B> {
        loop {
            if let Some(action) = self.due.pop_front() {
                if let Action::Answer { ticket, .. } = action {
                    self.unanswered.retain(|t| *t != ticket);
                }
                return action;
            }
            let action = match self.at {
                At::Orders => return Action::TakeOrder { waits: self.open.is_empty() },
                At::Newest => self.step_newest(),
                At::Oldest { waits } => self.step_oldest(waits),
            };
            if let Some(action) = action {
                return action;
            }
        }
    }

    /// Accepts the order with this ticket, which `make` creates. `make` is not called if the device has failed. If
    /// the device fails before the order is answered, the answer reports the failure.
    pub fn order(&mut self, ticket: u64, make: impl FnOnce() -> Ordered) {
        self.unanswered.push(ticket);
        if self.has_failed {
            return self.fail();
        }
        self.forget_below(self.open.front().map_or(ticket, |f| f.ticket));
        match make() {
            Ordered::Frame(commands) => {
                self.open.push_back(Frame { ticket, commands, progress: Progress::Command(0) });
                self.at = At::Newest;
            }
            Ordered::Read { injected } => {
                self.due.extend(injected.map(|kind| Action::Inject { kind }));
                self.due.extend([Action::Read { ticket }, Action::Answer { ticket, outcome: Outcome::Done }]);
            }
        }
    }

    /// Continues with the frames in progress. Call this after [`Action::TakeOrder`] if no order has arrived yet.
    pub fn no_order(&mut self) {
        self.at = At::Oldest { waits: true };
    }

    /// Accepts a message.
    pub fn message(&mut self, message: Message<B>) {
        match message {
            // Messages of an abandoned attempt may arrive late.
            Message::Rows { ticket, .. } | Message::Abort { ticket } if ticket < self.floor || self.has_failed => {}
            Message::Rows { ticket, transfer, rows } => drop(self.early.insert((ticket, transfer), rows)),
            Message::Abort { ticket } => drop(self.aborted.insert(ticket)),
        }
    }

    /// Notes that no message arrived within a time slice. After `DEPENDENT_SLICES` such slices, abandons the frame that
    /// waits for rows.
    pub fn timed_out(&mut self) {
        let slices = self.receiving.unwrap_or(0);
        self.receiving = Some(slices + 1);
        let frame = if self.at == At::Newest { self.open.back() } else { self.open.front() };
        if let Some(ticket) = frame.filter(|_| slices >= DEPENDENT_SLICES).map(|f| f.ticket) {
            self.give_up(ticket);
        }
    }

    /// Notes whether the work that [`Action::End`] or [`Action::TakeImages`] asked for has completed.
    pub fn ended(&mut self, has_ended: bool) {
        let (At::Oldest { waits }, Some(frame)) = (self.at, self.open.front_mut()) else { return };
        if !has_ended {
            self.at = At::Newest;
            return;
        }
        if frame.progress == Progress::Submitted {
            frame.progress = Progress::Read;
        } else {
            let ticket = frame.ticket;
            self.open.pop_front();
            self.forget_below(ticket + 1);
            self.due.push_back(Action::Answer { ticket, outcome: Outcome::Done });
        }
        self.end_step(waits);
    }

    /// Notes that the device can no longer be used, and fails all open attempts.
    pub fn fail(&mut self) {
        self.has_failed = true;
        self.at = At::Orders;
        self.receiving = None;
        self.due.clear();
        self.open.clear();
        self.outgoing.clear();
        self.early.clear();
        self.aborted.clear();
        self.due.extend(self.unanswered.iter().map(|&ticket| Action::CallOff { ticket }));
        let failed = |&ticket: &u64| Action::Answer { ticket, outcome: Outcome::Failed };
        self.due.extend(self.unanswered.iter().map(failed));
    }

    /// Abandons the attempt with this ticket, because another device failed in it or did not send its rows.
    fn give_up(&mut self, ticket: u64) {
        self.open.retain(|f| f.ticket != ticket);
        self.outgoing.retain(|o| o.ticket != ticket);
        self.receiving = None;
        self.due.push_back(Action::Answer { ticket, outcome: Outcome::Aborted });
        if self.at != (At::Oldest { waits: false }) {
            self.at = At::Orders;
        }
    }

    fn forget_below(&mut self, ticket: u64) {
        self.floor = ticket;
        self.early.retain(|(t, _), _| *t >= ticket);
        self.aborted.retain(|t| *t >= ticket);
    }

    fn end_step(&mut self, waits: bool) {
        if waits {
            self.at = At::Orders;
        }
    }

    /// Returns the next action of the newest frame's own tasks, or `None` if only the state has changed.
    fn step_newest(&mut self) -> Option<Action<B>> {
        let newest = self.open.back().and_then(|frame| match frame.progress {
            Progress::Command(at) if at < frame.commands.own => Some((frame.ticket, at, &frame.commands.list[at])),
            _ => None,
        });
        let Some((ticket, at, command)) = newest else {
            self.at = At::Orders;
            return None;
        };
        match command {
            &Command::CopyIn { transfer, .. } => return self.receive(ticket, at, transfer),
            Command::Submit(_) if self.submit_blocks && !self.outgoing.is_empty() => return self.send(),
            // Send outgoing rows before waiting for the device, so that other workers need not wait meanwhile.
            Command::Ask | Command::Probe { .. } if !self.outgoing.is_empty() => return self.send(),
            Command::Submit(copies) => {
                self.outgoing.extend(copies);
                self.at = At::Oldest { waits: false };
            }
            _ => {}
        }
        self.set_progress(ticket, Progress::Command(at + 1));
        Some(Action::Execute { ticket, at })
    }

    /// Advances the oldest frame, once its own tasks are submitted: sends rows that others wait for, receives rows of
    /// the stitch, and waits for the device. Returns `None` if only the state has changed.
    fn step_oldest(&mut self, waits: bool) -> Option<Action<B>> {
        let Some(frame) = self.open.front().filter(|_| waits || self.open.len() > 1) else {
            self.at = At::Newest;
            return None;
        };
        let (ticket, commands) = (frame.ticket, Arc::clone(&frame.commands));
        let at = match frame.progress {
            Progress::Command(at) if at < commands.own => {
                self.at = At::Newest;
                return None;
            }
            Progress::Command(at) => at,
            Progress::Submitted => return Some(Action::End { ticket, waits }),
            Progress::Read => return Some(Action::TakeImages { ticket, waits }),
        };
        let has_rows_to_send = self.outgoing.front().is_some_and(|o| o.ticket == ticket);
        if waits && has_rows_to_send {
            return self.send();
        }
        if self.aborted.contains(&ticket) {
            self.give_up(ticket);
            return None;
        }
        let is_here = |command: &Command| match command {
            Command::CopyIn { transfer, .. } => self.early.contains_key(&(ticket, *transfer)),
            _ => true,
        };
        if !waits && (has_rows_to_send || !commands.list[at..].iter().all(is_here)) {
            self.at = At::Newest;
            return None;
        }
        if let Some(&Command::CopyIn { transfer, .. }) = commands.list.get(at) {
            return self.receive(ticket, at, transfer);
        }
        // Only their submission may follow the uploads.
        self.set_progress(ticket, Progress::Submitted);
        self.end_step(waits);
        (at < commands.list.len()).then_some(Action::Execute { ticket, at })
    }

    /// Receives the rows of an upload. Before waiting for them, sends all outgoing rows. Outgoing rows precede this
    /// upload in the order of tasks that all devices follow, so workers cannot wait for one another in a cycle.
    fn receive(&mut self, ticket: u64, at: usize, transfer: u32) -> Option<Action<B>> {
        if self.receiving.is_none() {
            self.receiving = Some(0);
            return Some(Action::Receive { ticket, transfer });
        }
        if self.aborted.contains(&ticket) {
            self.give_up(ticket);
            return None;
        }
        let Some(rows) = self.early.remove(&(ticket, transfer)) else {
            return self.send().or(Some(Action::AwaitMessage));
        };
        self.receiving = None;
        self.set_progress(ticket, Progress::Command(at + 1));
        Some(Action::Write { ticket, at, rows })
    }

    /// Returns the action that sends the oldest outgoing rows, or `None` if there are none.
    fn send(&mut self) -> Option<Action<B>> {
        self.outgoing.pop_front().map(Action::Send)
    }

    fn set_progress(&mut self, ticket: u64, progress: Progress) {
        self.open.iter_mut().filter(|f| f.ticket == ticket).for_each(|f| f.progress = progress);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Builder;
    use crate::plan::tests::rows;

    #[test]
    fn missing_rows_abort_after_dependent_slices() {
        let mut worker = Protocol::<()>::new(false);
        let mut builder = Builder::new(1);
        builder.copy_in(0, rows(0));
        worker.order(1, || Ordered::Frame(Arc::new(builder.end_own())));
        assert_eq!(worker.next_action(), Action::Execute { ticket: 1, at: 0 });
        assert_eq!(worker.next_action(), Action::Receive { ticket: 1, transfer: 0 });
        for _ in 0..DEPENDENT_SLICES {
            assert_eq!(worker.next_action(), Action::AwaitMessage);
            worker.timed_out();
        }
        assert_eq!(worker.next_action(), Action::AwaitMessage);
        worker.timed_out();
        assert_eq!(worker.next_action(), Action::Answer { ticket: 1, outcome: Outcome::Aborted });
        assert_eq!(worker.next_action(), Action::TakeOrder { waits: true });
    }

    #[test]
    fn failed_device_calls_off_commands() {
        let mut worker = Protocol::<()>::new(false);
        worker.fail();
        worker.order(5, || unreachable!("the device can no longer be used"));
        assert_eq!(worker.next_action(), Action::CallOff { ticket: 5 });
        assert_eq!(worker.next_action(), Action::Answer { ticket: 5, outcome: Outcome::Failed });
        assert_eq!(worker.next_action(), Action::TakeOrder { waits: true });
    }
}
