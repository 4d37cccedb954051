//! The protocol of `src/exec/README.md` as a model: renderer and workers as state machines, explored in every order of
//! events, with frames in flight, devices that fail or hang at every point and some that wake up too late.

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

/// A device's part of a frame: its own tasks, in which everybody needs rows of everybody, and those of the stitch, for
/// which the primary needs all.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Part {
    ticket: Ticket,
    own: VecDeque<Step>,
    stitch: VecDeque<Step>,
}

impl Part {
    fn new(ticket: Ticket, device: Device, left: &[Device]) -> Self {
        let others = || left.iter().copied().filter(move |d| *d != device);
        let mut own: VecDeque<Step> = others().map(|to| Step::Send((0, device, to))).collect();
        own.extend(others().map(|from| Step::Receive((0, from, device))));
        let mut stitch = VecDeque::new();
        if device == left[0] {
            stitch.extend(others().map(|from| Step::Receive((1, from, device))));
        } else {
            own.push_back(Step::Send((1, device, left[0])));
        }
        Self { ticket, own, stitch }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
struct Worker {
    commands: VecDeque<(Ticket, Vec<Device>)>,
    inbox: VecDeque<Parcel>,
    /// Not answered for, oldest first; only the last may have tasks of its own left.
    open: VecDeque<Part>,
    early: BTreeSet<(Ticket, Transfer)>,
    aborted: BTreeSet<Ticket>,
    hangs: bool,
    has_failed: bool,
}

impl Worker {
    /// What is over is forgotten.
    fn forget_below(&mut self, floor: Ticket) {
        self.early.retain(|(t, _)| *t >= floor);
        self.aborted.retain(|t| *t >= floor);
    }

    fn take_in(&mut self) {
        let floor = self.open.front().map_or(0, |p| p.ticket);
        for parcel in self.inbox.drain(..) {
            match parcel {
                Parcel::Rows(ticket, _) | Parcel::Abort(ticket) if ticket < floor => {}
                Parcel::Rows(ticket, what) => drop(self.early.insert((ticket, what))),
                Parcel::Abort(ticket) => drop(self.aborted.insert(ticket)),
            }
        }
    }
}

/// An attempt at a frame as the renderer sees it.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Asked {
    ticket: Ticket,
    frame: u32,
    awaited: BTreeSet<Device>,
    failed: BTreeSet<Device>,
    is_whole: bool,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct World {
    workers: Vec<Worker>,
    replies: VecDeque<(Ticket, Device, Answer)>,
    left: Vec<Device>,
    /// Oldest first.
    asked: VecDeque<Asked>,
    /// A device failed in the oldest one; those behind are called off.
    recovers: bool,
    ticket: Ticket,
    begun: u32,
    done: u32,
    /// Events that may still befall devices.
    faults: u32,
}

#[derive(Clone, Copy)]
struct Rules {
    devices: usize,
    frames: u32,
    in_flight: usize,
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
            asked: VecDeque::new(),
            recovers: false,
            ticket: 0,
            begun: 0,
            done: 0,
            faults: rules.faults,
        };
        world.begin_frames(rules);
        world
    }

    fn begin_frames(&mut self, rules: Rules) {
        while self.begun < rules.frames && self.asked.len() < rules.in_flight {
            self.begun += 1;
            self.hand_out(self.begun, rules);
        }
    }

    fn hand_out(&mut self, frame: u32, rules: Rules) {
        self.ticket = if rules.fresh_tickets { self.ticket + 1 } else { frame };
        for &device in &self.left {
            self.workers[device].commands.push_back((self.ticket, self.left.clone()));
        }
        let awaited = self.left.iter().copied().collect();
        self.asked.push_back(Asked { ticket: self.ticket, frame, awaited, failed: BTreeSet::new(), is_whole: true });
    }

    fn abort(&mut self, ticket: Ticket) {
        self.workers.iter_mut().for_each(|w| w.inbox.push_back(Parcel::Abort(ticket)));
    }

    /// Every state that may follow.
    fn next(&self, rules: Rules) -> Result<Vec<Self>, Wrong> {
        let mut next = Vec::new();
        for device in 0..self.workers.len() {
            next.extend(self.worker_steps(device));
            let worker = &self.workers[device];
            if self.faults > 0 && !worker.open.is_empty() && !worker.hangs {
                next.extend(self.mishaps(device));
            }
        }
        if let Some(&(ticket, device, answer)) = self.replies.front() {
            let mut after = self.clone();
            after.replies.pop_front();
            let asked = after.asked.iter_mut().find(|a| a.ticket == ticket && a.awaited.contains(&device));
            if let Some(asked) = asked {
                asked.awaited.remove(&device);
                match answer {
                    Answer::Done => {}
                    Answer::Failed => drop(asked.failed.insert(device)),
                    Answer::Aborted => asked.is_whole = false,
                }
            }
            after.conclude(rules)?;
            next.push(after);
        }
        // It waits for the oldest attempt that is not answered, and gives those up that hang there.
        if let Some(waited_for) = self.asked.iter().find(|a| !a.awaited.is_empty()) {
            for &device in waited_for.awaited.iter().filter(|d| self.workers[**d].hangs) {
                let mut after = self.clone();
                let mut tickets = Vec::new();
                for asked in after.asked.iter_mut().filter(|a| a.awaited.contains(&device)) {
                    asked.awaited.remove(&device);
                    asked.failed.insert(device);
                    tickets.push(asked.ticket);
                }
                tickets.into_iter().for_each(|t| after.abort(t));
                after.conclude(rules)?;
                next.push(after);
            }
        }
        Ok(next)
    }

    /// What the renderer does once all have answered.
    fn conclude(&mut self, rules: Rules) -> Result<(), Wrong> {
        while let Some(oldest) = self.asked.front().filter(|a| a.awaited.is_empty()) {
            if oldest.failed.is_empty() {
                if !oldest.is_whole {
                    return Err(Wrong::Stuck);
                }
                self.asked.pop_front();
                self.done += 1;
                self.begin_frames(rules);
                continue;
            }
            if !self.recovers {
                self.recovers = true;
                let behind: Vec<Ticket> = self.asked.iter().skip(1).map(|a| a.ticket).collect();
                behind.into_iter().for_each(|t| self.abort(t));
            }
            if self.asked.iter().any(|a| !a.awaited.is_empty()) {
                break;
            }
            self.recovers = false;
            let again = std::mem::take(&mut self.asked);
            self.left.retain(|d| !again.iter().any(|a| a.failed.contains(d)));
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

    fn worker_steps(&self, device: Device) -> Vec<Self> {
        let mut after = self.clone();
        let worker = &mut after.workers[device];
        if worker.hangs {
            // It may wake up, before or after it was given up.
            worker.hangs = false;
            return vec![after];
        }
        if worker.open.back().is_none_or(|p| p.own.is_empty())
            && let Some((ticket, left)) = worker.commands.pop_front()
        {
            let floor = worker.open.front().map_or(ticket, |p| p.ticket);
            worker.forget_below(floor);
            worker.open.push_back(Part::new(ticket, device, &left));
            if worker.has_failed {
                after.fail(device);
            }
            return vec![after];
        }
        let mut next = Vec::new();
        let Some(newest) = worker.open.len().checked_sub(1) else { return next };
        if !worker.open[newest].own.is_empty() {
            next.extend(self.step(device, newest));
            // It looks after its oldest frame meanwhile, if nothing must be waited for.
            if newest > 0 {
                next.extend(self.step(device, 0));
            }
        } else {
            next.extend(self.step(device, 0));
        }
        next
    }

    /// The next step of a part, if it need not wait.
    fn step(&self, device: Device, place: usize) -> Option<Self> {
        let mut after = self.clone();
        let worker = &mut after.workers[device];
        worker.take_in();
        let part = &mut worker.open[place];
        let ticket = part.ticket;
        let steps = if part.own.is_empty() { &mut part.stitch } else { &mut part.own };
        match steps.front().copied() {
            None => after.answer(device, place, Answer::Done),
            Some(Step::Send(transfer)) => {
                steps.pop_front();
                after.workers[transfer.2].inbox.push_back(Parcel::Rows(ticket, transfer));
            }
            Some(Step::Receive(_)) if worker.aborted.contains(&ticket) => {
                after.answer(device, place, Answer::Aborted);
            }
            Some(Step::Receive(transfer)) => {
                if !worker.early.remove(&(ticket, transfer)) {
                    return None;
                }
                steps.pop_front();
            }
        }
        Some(after)
    }

    fn answer(&mut self, device: Device, place: usize, answer: Answer) {
        let worker = &mut self.workers[device];
        let Some(part) = worker.open.remove(place) else { return };
        if place == 0 {
            worker.forget_below(part.ticket + u32::from(answer == Answer::Done));
        }
        self.replies.push_back((part.ticket, device, answer));
    }

    /// Nothing comes of all that the device has begun.
    fn fail(&mut self, device: Device) {
        self.workers[device].has_failed = true;
        while let Some(ticket) = self.workers[device].open.front().map(|p| p.ticket) {
            self.abort(ticket);
            self.answer(device, 0, Answer::Failed);
        }
    }

    /// The device fails, or its worker hangs.
    fn mishaps(&self, device: Device) -> [Self; 2] {
        let (mut fails, mut hangs) = (self.clone(), self.clone());
        fails.faults -= 1;
        fails.fail(device);
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
    let cases = [(1, 2, 1, 1), (2, 3, 1, 0), (2, 2, 1, 2), (3, 1, 1, 1), (1, 3, 2, 1), (2, 3, 2, 0), (2, 2, 2, 1)];
    for (devices, frames, in_flight, faults) in cases {
        let states = explore(Rules { devices, frames, in_flight, faults, fresh_tickets: true });
        let states = states.unwrap_or_else(|e| panic!("{e:?} of {devices} devices after {faults} faults"));
        println!("{devices} devices, {frames} frames, {in_flight} in flight, {faults} faults: {states} states");
        assert!(states > 4);
    }
}

/// A worker that remembers a frame as aborted, and not the attempt at it, takes no part in the next attempt.
#[test]
fn attempts_need_tickets_of_their_own() {
    let wrong = explore(Rules { devices: 3, frames: 1, in_flight: 1, faults: 1, fresh_tickets: false });
    assert_eq!(wrong, Err(Wrong::Stuck));
}
