//! Explores the protocol of `src/exec/README.md` in every order of events. It runs the workers' real state machine and
//! the renderer's real ledger, with frames in flight, devices that fail or hang at every point, and some that recover
//! too late.

use std::collections::{BTreeSet, HashSet, VecDeque};
use std::sync::Arc;

use crate::effort::is_thorough;
use diptych::exec::protocol::{Action, Ledger, Message, Ordered, Outcome, Protocol};
use diptych::graph::Bound;
use diptych::passes::tonemap::LINEAR;
use diptych::plan::{Builder, Command, Commands, EyeImage, Outgoing, Rows};
use diptych::scene::rig::Eye;

type Device = usize;
type Ticket = u64;

/// A worker with its thread.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Worker {
    /// State machine; its rows carry no bytes.
    protocol: Protocol<()>,
    orders: VecDeque<(Ticket, Arc<Commands>)>,
    hangs: bool,
}

impl Worker {
    /// Executes steps that neither affect nor depend on others. Only the remaining steps must be explored in every
    /// order.
    fn settle(&mut self) {
        loop {
            let mut after = self.protocol.clone();
            match after.next_action() {
                Action::Execute { .. } | Action::Receive { .. } => self.protocol = after,
                _ => return,
            }
        }
    }
}

/// Returns the commands of a frame on a device. Every device needs rows of every other. The primary needs all of them
/// for the stitch, or, if it `asks` for a pose, to show the frame. With `in_order`, rows are sent before others are
/// awaited, as in the common order of tasks.
fn commands(ticket: Ticket, device: Device, left: &[Device], rules: Rules) -> Arc<Commands> {
    let Rules { submits_often, in_order, asks, .. } = rules;
    let others = || left.iter().copied().filter(move |d| *d != device);
    let transfer = |round: u32, from: Device, to: Device| round * 100 + from as u32 * 10 + to as u32;
    let rows = |task| {
        let bound = Bound { resource: LINEAR, buffer: 0, is_before: false };
        Rows { task, image: EyeImage { bound, eye: Eye::LEFT }, rows: 0..1 }
    };
    let dispatch = || Command::Dispatch { pass: 0, launches: Vec::new(), begins: None, ends: None };
    let mut builder = Builder::new(ticket);
    builder.record(dispatch());
    if !in_order {
        others().for_each(|from| builder.copy_in(transfer(0, from, device), rows(0)));
    }
    for to in others() {
        builder.copy_out(transfer(0, device, to), to, rows(0));
        if submits_often && in_order {
            builder.record(dispatch());
            builder.apart(Command::Probe { task: 0, stamps: None });
        }
    }
    if in_order {
        others().for_each(|from| builder.copy_in(transfer(0, from, device), rows(0)));
    }
    let last = others().map(|from| (transfer(1, from, device), rows(0)));
    let mut stitch = Vec::new();
    if device != left[0] {
        builder.record(dispatch());
        builder.copy_out(transfer(1, device, left[0]), left[0], rows(0));
    } else if asks {
        last.for_each(|(transfer, rows)| builder.copy_in(transfer, rows));
        builder.ask();
        builder.record(dispatch());
        builder.record(dispatch());
    } else {
        stitch.extend(last.map(|(transfer, rows)| Command::CopyIn { transfer, rows }));
    }
    let mut commands = builder.end_own();
    commands.list.extend(stitch);
    commands.end();
    Arc::new(commands)
}

/// An attempt at a frame from the renderer's point of view.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Attempt {
    /// Ticket in the ledger and in the workers' orders.
    asked: Ticket,
    told: Ticket,
    frame: u32,
    answers: Option<Vec<(Device, Outcome)>>,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct World {
    workers: Vec<Worker>,
    replies: VecDeque<(Ticket, Device, Outcome)>,
    ledger: Ledger<Outcome>,
    left: Vec<Device>,
    /// Attempts, oldest first.
    attempts: VecDeque<Attempt>,
    /// True if a device failed in the oldest attempt; those behind it are cancelled.
    recovers: bool,
    begun: u32,
    done: u32,
    /// Number of faults that may still happen.
    faults: u32,
}

#[derive(Clone, Copy)]
struct Rules {
    devices: usize,
    frames: u32,
    in_flight: usize,
    faults: u32,
    /// True if submissions wait for one another.
    submit_blocks: bool,
    /// True if rows for each device are sent in a submission of their own.
    submits_often: bool,
    /// True if each attempt has a ticket of its own, false if it uses the frame's.
    fresh_tickets: bool,
    /// True if rows are sent before others are awaited.
    in_order: bool,
    /// True if the primary asks for the pose for late latching.
    asks: bool,
}

const RULES: Rules = Rules {
    devices: 2,
    frames: 1,
    in_flight: 1,
    faults: 1,
    submit_blocks: true,
    submits_often: false,
    fresh_tickets: true,
    in_order: true,
    asks: false,
};

#[derive(Debug, PartialEq)]
enum Wrong {
    /// No event is possible, but the frames are not done.
    Deadlock,
    /// All workers have answered without failure, but some frames are not done.
    Stuck,
}

impl World {
    fn new(rules: Rules) -> Self {
        let worker = Worker { protocol: Protocol::new(rules.submit_blocks), orders: VecDeque::new(), hangs: false };
        let mut world = Self {
            workers: vec![worker; rules.devices],
            replies: VecDeque::new(),
            ledger: Ledger::default(),
            left: (0..rules.devices).collect(),
            attempts: VecDeque::new(),
            recovers: false,
            begun: 0,
            done: 0,
            faults: rules.faults,
        };
        world.begin_frames(rules);
        world
    }

    fn begin_frames(&mut self, rules: Rules) {
        while self.begun < rules.frames && self.attempts.len() < rules.in_flight {
            self.begun += 1;
            self.hand_out(self.begun, rules);
        }
    }

    fn hand_out(&mut self, frame: u32, rules: Rules) {
        let asked = self.ledger.ask(self.left.clone());
        let told = if rules.fresh_tickets { asked } else { Ticket::from(frame) };
        for &device in &self.left {
            let commands = commands(told, device, &self.left, rules);
            self.workers[device].orders.push_back((told, commands));
        }
        self.attempts.push_back(Attempt { asked, told, frame, answers: None });
    }

    fn call_off(&mut self, ticket: Ticket) {
        for worker in &mut self.workers {
            worker.protocol.message(Message::Abort { ticket });
            worker.settle();
        }
    }

    /// Returns all possible next states.
    fn next(&self, rules: Rules) -> Result<Vec<Self>, Wrong> {
        let mut next = Vec::new();
        for (device, worker) in self.workers.iter().enumerate() {
            next.extend(self.worker_steps(device));
            let is_idle = worker.protocol.clone().next_action() == Action::TakeOrder { waits: true };
            if self.faults > 0 && !is_idle && !worker.hangs {
                next.extend(self.mishaps(device));
            }
        }
        if let Some(&(told, device, outcome)) = self.replies.front() {
            let mut after = self.clone();
            after.replies.pop_front();
            if let Some(attempt) = self.attempts.iter().find(|a| a.told == told) {
                after.ledger.answer(attempt.asked, device, outcome);
            }
            after.conclude(rules)?;
            next.push(after);
        }
        // The renderer waits for the oldest unanswered attempt, and drops devices that hang in it.
        if let Some(waited_for) = self.attempts.iter().find(|a| a.answers.is_none()) {
            let awaited = self.ledger.awaited(waited_for.asked).iter();
            for &device in awaited.filter(|d| self.workers[**d].hangs) {
                let mut after = self.clone();
                for ticket in after.ledger.answer_for(device, || Outcome::Failed) {
                    let told = self.attempts.iter().find(|a| a.asked == ticket).map(|a| a.told);
                    told.into_iter().for_each(|told| after.call_off(told));
                }
                after.conclude(rules)?;
                next.push(after);
            }
        }
        Ok(next)
    }

    /// Continues as the renderer does after all workers have answered.
    fn conclude(&mut self, rules: Rules) -> Result<(), Wrong> {
        for attempt in self.attempts.iter_mut().filter(|a| a.answers.is_none()) {
            attempt.answers = self.ledger.take(attempt.asked);
        }
        while let Some(answers) = self.attempts.front().and_then(|a| a.answers.clone()) {
            if answers.iter().all(|(_, outcome)| *outcome != Outcome::Failed) {
                if answers.iter().any(|(_, outcome)| *outcome == Outcome::Aborted) {
                    return Err(Wrong::Stuck);
                }
                self.attempts.pop_front();
                self.done += 1;
                self.begin_frames(rules);
                continue;
            }
            if !self.recovers {
                self.recovers = true;
                let behind: Vec<Ticket> = self.attempts.iter().skip(1).map(|a| a.told).collect();
                behind.into_iter().for_each(|t| self.call_off(t));
            }
            if self.attempts.iter().any(|a| a.answers.is_none()) {
                break;
            }
            self.recovers = false;
            let again = std::mem::take(&mut self.attempts);
            let answers = again.iter().flat_map(|a| a.answers.iter().flatten());
            let failed: BTreeSet<Device> = answers.filter(|(_, o)| *o == Outcome::Failed).map(|(d, _)| *d).collect();
            self.left.retain(|d| !failed.contains(d));
            if self.left.is_empty() {
                break;
            }
            again.into_iter().for_each(|a| self.hand_out(a.frame, rules));
        }
        Ok(())
    }

    fn is_over(&self, rules: Rules) -> bool {
        self.left.is_empty() || self.done == rules.frames
    }

    /// Returns the possible results of a worker's next action; none if it has to wait.
    fn worker_steps(&self, device: Device) -> Vec<Self> {
        let mut after = self.clone();
        let worker = &mut after.workers[device];
        if worker.hangs {
            // The worker may recover before or after it was dropped.
            worker.hangs = false;
            return vec![after];
        }
        match worker.protocol.next_action() {
            Action::TakeOrder { waits } => match worker.orders.pop_front() {
                Some((ticket, commands)) => worker.protocol.order(ticket, || Ordered::Frame(commands)),
                None if waits => return Vec::new(),
                None => worker.protocol.no_order(),
            },
            Action::AwaitMessage => return Vec::new(),
            Action::End { waits, .. } | Action::TakeImages { waits, .. } => {
                let mut later = after.clone();
                after.workers[device].protocol.ended(true);
                later.workers[device].protocol.ended(false);
                let both = [Some(after), (!waits).then_some(later)];
                return both.into_iter().flatten().map(|world| world.settled(device)).collect();
            }
            Action::Send(Outgoing { ticket, transfer, to }) => {
                after.workers[to].protocol.message(Message::Rows { ticket, transfer, rows: () });
                after.workers[to].settle();
            }
            Action::CallOff { ticket } => {
                for other in (0..after.workers.len()).filter(|other| *other != device) {
                    after.workers[other].protocol.message(Message::Abort { ticket });
                    after.workers[other].settle();
                }
            }
            Action::Answer { ticket, outcome } => after.replies.push_back((ticket, device, outcome)),
            // The event is invisible to others.
            _ => {}
        }
        vec![after.settled(device)]
    }

    fn settled(mut self, device: Device) -> Self {
        self.workers[device].settle();
        self
    }

    /// Returns the states in which the device fails or its worker hangs.
    fn mishaps(&self, device: Device) -> [Self; 2] {
        let (mut fails, mut hangs) = (self.clone(), self.clone());
        fails.faults -= 1;
        fails.workers[device].protocol.fail();
        hangs.faults -= 1;
        hangs.workers[device].hangs = true;
        [fails, hangs]
    }
}

/// Visits every state; returns the number of states.
fn explore(rules: Rules) -> Result<usize, Wrong> {
    let first = World::new(rules);
    let mut seen = HashSet::from([first.clone()]);
    let mut open = vec![first];
    let mut ends = 0;
    while let Some(world) = open.pop() {
        if world.is_over(rules) {
            ends += 1;
            continue;
        }
        let next = world.next(rules)?;
        if next.is_empty() {
            return Err(Wrong::Deadlock);
        }
        for after in next {
            if seen.insert(after.clone()) {
                open.push(after);
            }
        }
    }
    assert!(ends > 0);
    Ok(seen.len())
}

#[test]
fn every_order_of_events_ends() {
    let cases = [(1, 2, 1, 1), (2, 3, 1, 0), (2, 2, 1, 2), (3, 1, 1, 1), (1, 3, 2, 1), (2, 3, 2, 0), (2, 2, 2, 1)];
    for (devices, frames, in_flight, faults) in cases {
        // Between them, the first and the last case enable each of the three options.
        let kinds = [(true, true, false), (false, false, false), (false, false, true), (true, false, true)];
        for (submit_blocks, submits_often, asks) in kinds.into_iter().step_by(if is_thorough() { 1 } else { 3 }) {
            let rules = Rules { devices, frames, in_flight, faults, submit_blocks, submits_often, asks, ..RULES };
            let states = explore(rules);
            let states = states.unwrap_or_else(|e| panic!("{e:?} of {devices} devices after {faults} faults"));
            println!("{devices} devices, {frames} frames, {in_flight} in flight, {faults} faults: {states} states");
            assert!(states > 4);
        }
    }
}

/// If a worker remembers a frame as aborted instead of the attempt, it takes no part in the next attempt.
#[test]
fn attempts_need_fresh_tickets() {
    let wrong = explore(Rules { devices: 3, fresh_tickets: false, ..RULES });
    assert_eq!(wrong, Err(Wrong::Stuck));
}

/// Workers deadlock if each waits for the other's rows before it sends its own.
#[test]
fn tasks_need_a_common_order() {
    assert_eq!(explore(Rules { faults: 0, in_order: false, ..RULES }), Err(Wrong::Deadlock));
}
