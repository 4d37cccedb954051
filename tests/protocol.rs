//! The protocol of `src/exec/README.md` as a model: renderer and workers as state machines, explored in every order of
//! events, with devices that fail or hang at every point and some that wake up too late.

use std::collections::{BTreeSet, HashSet, VecDeque};

type Device = usize;
type Ticket = u32;
/// Round, from, to.
type Transfer = (u8, Device, Device);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Parcel {
    Rows(Ticket, Transfer),
    Abort(Ticket),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Answer {
    Done,
    Failed,
    Aborted,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Step {
    Send(Transfer),
    Receive(Transfer),
}

/// A device's part of a frame: everybody needs rows of everybody, then the primary needs all.
fn part(device: Device, left: &[Device]) -> Vec<Step> {
    let others = || left.iter().copied().filter(move |d| *d != device);
    let mut steps: Vec<Step> = others().map(|to| Step::Send((0, device, to))).collect();
    steps.extend(others().map(|from| Step::Receive((0, from, device))));
    if device == left[0] {
        steps.extend(others().map(|from| Step::Receive((1, from, device))));
    } else {
        steps.push(Step::Send((1, device, left[0])));
    }
    steps
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Worker {
    commands: VecDeque<(Ticket, Vec<Device>)>,
    inbox: VecDeque<Parcel>,
    /// The attempt it is at, and what is left of its part.
    doing: Option<VecDeque<Step>>,
    ticket: Ticket,
    early: BTreeSet<(Ticket, Transfer)>,
    aborted: Ticket,
    hangs: bool,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct World {
    workers: Vec<Worker>,
    replies: VecDeque<(Ticket, Device, Answer)>,
    /// The renderer: devices left, those that have not answered, those that failed, whether all others are done.
    left: Vec<Device>,
    awaited: BTreeSet<Device>,
    failed: BTreeSet<Device>,
    is_whole: bool,
    ticket: Ticket,
    frame: u32,
    /// Events that may still befall devices.
    faults: u32,
}

#[derive(Clone, Copy)]
struct Rules {
    devices: usize,
    frames: u32,
    faults: u32,
    /// Whether an attempt has a ticket of its own; else it has the frame's.
    fresh_tickets: bool,
}

#[derive(Debug, PartialEq)]
enum Wrong {
    /// Nobody can do anything, and the frames are not done.
    Deadlock,
    /// All have answered, none has failed, and yet not all are done.
    Stuck,
}

impl World {
    fn new(rules: Rules) -> Self {
        let mut world = Self {
            workers: vec![Worker::default(); rules.devices],
            replies: VecDeque::new(),
            left: (0..rules.devices).collect(),
            awaited: BTreeSet::new(),
            failed: BTreeSet::new(),
            is_whole: true,
            ticket: 0,
            frame: 1,
            faults: rules.faults,
        };
        world.hand_out(rules);
        world
    }

    fn hand_out(&mut self, rules: Rules) {
        self.ticket = if rules.fresh_tickets { self.ticket + 1 } else { self.frame };
        self.is_whole = true;
        for &device in &self.left {
            self.workers[device].commands.push_back((self.ticket, self.left.clone()));
            self.awaited.insert(device);
        }
    }

    fn abort(&mut self, ticket: Ticket) {
        self.workers.iter_mut().for_each(|w| w.inbox.push_back(Parcel::Abort(ticket)));
    }

    /// Every state that may follow.
    fn next(&self, rules: Rules) -> Result<Vec<Self>, Wrong> {
        let mut next = Vec::new();
        for device in 0..self.workers.len() {
            next.extend(self.worker_steps(device));
            if self.faults > 0 && self.workers[device].doing.is_some() && !self.workers[device].hangs {
                next.extend(self.mishaps(device));
            }
        }
        if let Some(&(ticket, device, answer)) = self.replies.front() {
            let mut after = self.clone();
            after.replies.pop_front();
            if ticket == self.ticket && after.awaited.remove(&device) {
                match answer {
                    Answer::Done => {}
                    Answer::Failed => drop(after.failed.insert(device)),
                    Answer::Aborted => after.is_whole = false,
                }
            }
            after.conclude(rules)?;
            next.push(after);
        }
        for &device in self.awaited.iter().filter(|d| self.workers[**d].hangs) {
            let mut after = self.clone();
            after.awaited.remove(&device);
            after.failed.insert(device);
            after.abort(self.ticket);
            after.conclude(rules)?;
            next.push(after);
        }
        Ok(next)
    }

    /// What the renderer does once all have answered.
    fn conclude(&mut self, rules: Rules) -> Result<(), Wrong> {
        if !self.awaited.is_empty() {
            return Ok(());
        }
        if self.failed.is_empty() && !self.is_whole {
            return Err(Wrong::Stuck);
        }
        if self.failed.is_empty() {
            self.frame += 1;
        }
        let failed = std::mem::take(&mut self.failed);
        self.left.retain(|d| !failed.contains(d));
        if !self.is_over(rules) {
            self.hand_out(rules);
        }
        Ok(())
    }

    fn is_over(&self, rules: Rules) -> bool {
        self.left.is_empty() || self.frame > rules.frames
    }

    fn worker_steps(&self, device: Device) -> Option<Self> {
        let mut after = self.clone();
        let worker = &mut after.workers[device];
        if worker.hangs {
            // It may wake up, before or after it was given up.
            worker.hangs = false;
            return Some(after);
        }
        let Some(steps) = &mut worker.doing else {
            let (ticket, left) = worker.commands.pop_front()?;
            worker.ticket = ticket;
            worker.early.retain(|(t, _)| *t == ticket);
            worker.doing = Some(part(device, &left).into());
            return Some(after);
        };
        let ticket = worker.ticket;
        match steps.front().copied() {
            None => after.answer(device, Answer::Done),
            Some(Step::Send(transfer)) => {
                steps.pop_front();
                after.workers[transfer.2].inbox.push_back(Parcel::Rows(ticket, transfer));
            }
            Some(Step::Receive(transfer)) => match worker.inbox.pop_front() {
                Some(Parcel::Abort(t)) => worker.aborted = worker.aborted.max(t),
                Some(Parcel::Rows(t, _)) if t < ticket => {}
                Some(Parcel::Rows(t, what)) => drop(worker.early.insert((t, what))),
                None if worker.aborted == ticket => {
                    worker.early.clear();
                    after.answer(device, Answer::Aborted);
                }
                None if worker.early.remove(&(ticket, transfer)) => drop(steps.pop_front()),
                None => return None,
            },
        }
        Some(after)
    }

    fn answer(&mut self, device: Device, answer: Answer) {
        let worker = &mut self.workers[device];
        worker.doing = None;
        self.replies.push_back((worker.ticket, device, answer));
    }

    /// The device fails, or its worker hangs.
    fn mishaps(&self, device: Device) -> [Self; 2] {
        let (mut fails, mut hangs) = (self.clone(), self.clone());
        fails.faults -= 1;
        fails.workers[device].early.clear();
        fails.abort(self.workers[device].ticket);
        fails.answer(device, Answer::Failed);
        hangs.faults -= 1;
        hangs.workers[device].hangs = true;
        [fails, hangs]
    }
}

/// Visits every state; returns how many there are.
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
    for (devices, frames, faults) in [(1, 2, 1), (2, 3, 0), (2, 2, 2), (3, 1, 1)] {
        let states = explore(Rules { devices, frames, faults, fresh_tickets: true });
        let states = states.unwrap_or_else(|e| panic!("{e:?} of {devices} devices after {faults} faults"));
        println!("{devices} devices, {frames} frames, {faults} faults: {states} states");
        assert!(states > 4);
    }
}

/// A worker that remembers a frame as aborted, and not the attempt at it, takes no part in the next attempt.
#[test]
fn attempts_need_tickets_of_their_own() {
    let wrong = explore(Rules { devices: 3, frames: 1, faults: 1, fresh_tickets: false });
    assert_eq!(wrong, Err(Wrong::Stuck));
}
