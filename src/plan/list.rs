//! Lists the commands of a device's share of a frame.

use std::ops::Range;

use super::commands::{Command, Commands, EyeImage, InjectedKind, Launched, Outgoing, PassConstants, Rows, Timed};
use super::workgroups::groups;
use crate::graph::{Access, FrameGraph, Linked, Program, SceneUse, Task, TaskKind, Use};
use crate::passes::LATE_PARTITION;
use crate::samples::{PixelSamples, Run};
use crate::schedule::{Position, Splits, parts, rows_in};
use crate::wgsl::Words;

/// A device's share of a frame: the inputs of its commands, in addition to the frame's graph.
#[derive(Clone, Copy, Debug)]
pub struct Share<'a> {
    pub ticket: u64,
    pub device: usize,
    pub samples: PixelSamples,
    pub splits: &'a Splits,
    /// Number of times that each dispatch runs; more than 1 only to simulate slow devices. The images of the device stay
    /// the same, byte for byte.
    pub repeats: u32,
    /// Fault to inject after half of the device's own tasks.
    pub injected: Option<InjectedKind>,
    /// True if late reprojection asks for the pose.
    pub asks: bool,
}

impl Commands {
    /// Lists a device's commands for a frame.
    ///
    /// Commands are submitted as late as possible: before a wait for rows, at splits, and at the end. Consecutive copies
    /// share a submission, right after the last of them is recorded. The worker waits for rows only when everything up
    /// to the next submission is recorded; the device then writes the rows at the start of that submission. The host
    /// thus records while the device is busy with earlier work. Late reprojection comes last, so that all rows have
    /// arrived when the pose is sampled.
    pub fn new(graph: &FrameGraph, share: &Share<'_>) -> Self {
        let (own, stitch) = graph.parts_of(share.device);
        let shows = |task: &Task| graph.pass(task).is_some_and(|linked| linked.pass.partition == LATE_PARTITION);
        let is_late = |(_, task): &(usize, &Task)| share.asks && shows(task);
        let (late, first): (Vec<_>, Vec<_>) = own.iter().enumerate().partition(is_late);
        let begins_late = first.len();
        let mut builder = Builder::new(share.ticket);
        for (at, (number, task)) in first.into_iter().chain(late).enumerate() {
            if let Some(kind) = share.injected.filter(|_| at == own.len() / 2) {
                builder.inject(kind);
            }
            if at == begins_late {
                builder.ask();
            }
            builder.task(graph, share, number, task);
        }
        if own.is_empty() {
            share.injected.into_iter().for_each(|kind| builder.inject(kind));
        }
        let mut commands = builder.end_own();
        for (number, task) in (own.len()..).zip(stitch) {
            if let TaskKind::Upload { image, transfer } = task.kind {
                commands.list.push(Command::CopyIn { transfer, rows: rows_of(&graph.program, number, task, image) });
            }
        }
        commands.end();
        commands
    }

    /// Makes the device execute the last uploads, if no submission follows them.
    pub fn end(&mut self) {
        let submits = self.list.iter().any(|command| matches!(command, Command::Submit(_)));
        if self.list.len() > self.own || !submits {
            self.list.push(Command::Submit(Vec::new()));
        }
    }
}

/// Lists the commands of a device's own tasks, and submits them where needed.
#[derive(Default)]
pub struct Builder {
    ticket: u64,
    list: Vec<Command>,
    timed: Vec<Timed>,
    /// True if recorded commands have not been submitted yet.
    has_recorded: bool,
    /// Copies that the next submission includes.
    copies: Vec<Outgoing>,
    /// Writes of rows that the next submission executes first.
    writes: Vec<Command>,
    /// True if recorded commands need a pose that has not been sampled yet.
    asks: bool,
}

/// Maximum number of timed dispatches in a frame: WebGPU allows 4096 timestamps.
pub const MOST_TIMED: usize = 2048;

impl Builder {
    pub fn new(ticket: u64) -> Self {
        Self { ticket, list: vec![Command::Begin], ..Self::default() }
    }

    /// Adds a command that is recorded and submitted later. Copies before it are submitted first.
    pub fn record(&mut self, command: Command) {
        if !self.copies.is_empty() {
            self.submit();
        }
        self.push(command);
    }

    fn push(&mut self, command: Command) {
        self.list.push(command);
        self.has_recorded = true;
    }

    /// Adds a copy of rows for device `to`.
    pub fn copy_out(&mut self, transfer: u32, to: usize, rows: Rows) {
        self.push(Command::CopyOut { transfer, rows });
        self.copies.push(Outgoing { ticket: self.ticket, transfer, to });
    }

    /// Adds rows of another device, which the next submission needs.
    pub fn copy_in(&mut self, transfer: u32, rows: Rows) {
        self.submit();
        self.writes.push(Command::CopyIn { transfer, rows });
    }

    /// Asks for the pose right before the next submission. Everything before is submitted.
    pub fn ask(&mut self) {
        self.submit();
        self.asks = true;
    }

    pub fn inject(&mut self, kind: InjectedKind) {
        self.apart(Command::Inject(kind));
    }

    /// Adds a command that records and submits by itself.
    pub fn apart(&mut self, command: Command) {
        self.submit();
        self.list.append(&mut self.writes);
        self.list.extend(std::mem::take(&mut self.asks).then_some(Command::Ask));
        self.list.push(command);
    }

    fn submit(&mut self) {
        if std::mem::take(&mut self.has_recorded) {
            self.list.push(Command::Close);
            self.list.append(&mut self.writes);
            if std::mem::take(&mut self.asks) {
                self.list.push(Command::Ask);
            }
            self.list.push(Command::Submit(std::mem::take(&mut self.copies)));
        }
    }

    /// Ends the device's own tasks. Those of the stitch follow.
    pub fn end_own(mut self) -> Commands {
        if !self.timed.is_empty() {
            self.push(Command::Stamps);
        }
        self.submit();
        self.list.append(&mut self.writes);
        Commands { own: self.list.len(), list: self.list, timed: self.timed }
    }

    fn task(&mut self, graph: &FrameGraph, share: &Share<'_>, number: usize, task: &Task) {
        let rows = |image| rows_of(&graph.program, number, task, image);
        match task.kind {
            TaskKind::Dispatch { .. } => {
                Work::of(graph, task).iter().for_each(|work| self.dispatch(work, share, number));
            }
            TaskKind::Download { image, transfer, to } => self.copy_out(transfer, to, rows(image)),
            TaskKind::Upload { image, transfer } => self.copy_in(transfer, rows(image)),
            TaskKind::Stitch => {}
        }
    }

    /// Adds a dispatch, with a submission between its parts.
    fn dispatch(&mut self, work: &Work<'_>, share: &Share<'_>, task: usize) {
        let pair = (self.timed.len() < MOST_TIMED).then_some(2 * self.timed.len() as u32);
        let mut submissions = 0;
        if share.splits.probes.contains(&task) {
            self.apart(Command::Probe { task, stamps: pair });
            self.timed.extend(pair.map(|_| Timed { task, submissions }));
            return;
        }
        for (i, part) in parts(&share.splits.ends, task, work.rows).into_iter().enumerate() {
            if i > 0 {
                self.submit();
            }
            if part.start < part.end {
                work.part(&part, share, pair).into_iter().for_each(|command| self.record(command));
                submissions += 1;
            }
        }
        self.timed.extend(pair.map(|_| Timed { task, submissions }));
    }
}

/// A pass on some rows.
#[derive(Clone, Copy)]
pub struct Work<'a> {
    pub program: &'a Program,
    pub pass: usize,
    pub rows: &'a Range<u32>,
    valid: &'a Range<u32>,
}

impl<'a> Work<'a> {
    /// Returns the pass of a task; `None` if the task runs none.
    pub fn of(graph: &'a FrameGraph, task: &'a Task) -> Option<Self> {
        let TaskKind::Dispatch { pass, valid } = &task.kind else { return None };
        Some(Self { program: &graph.program, pass: *pass, rows: &task.rows, valid })
    }

    fn linked(&self) -> &Linked {
        &self.program.passes()[self.pass]
    }

    /// Returns the images that some uses bind, each with the number of its binding.
    fn images(&self, is_meant: impl Fn(&Use) -> bool) -> Vec<(usize, EyeImage)> {
        let Linked { pass, images, .. } = self.linked();
        let uses = pass.uses.iter().zip(images).enumerate().filter(|(_, (used, _))| is_meant(used));
        uses.map(|(binding, (used, &image))| {
            (binding, EyeImage { bound: self.program.images()[image], eye: pass.eye_of(used) })
        })
        .collect()
    }

    /// Returns the commands of a part of the work. `pair` is the index of the first of the work's two timestamps.
    pub fn part(&self, part: &Range<Position>, share: &Share<'_>, pair: Option<u32>) -> Vec<Command> {
        let (begins, ends) = (part.start == Position::start(self.rows), part.end == Position::END);
        let builds = ends && !self.rows.is_empty() && self.linked().pass.builds_from.is_some();
        // Later parts may add to any image that the first part wrote.
        let is_added_to = |used: &Use| used.access == Access::Add || (used.access.writes() && !begins);
        let added_to = if share.repeats > 1 { self.images(is_added_to) } else { Vec::new() };
        let launches = launched(self.program, self.pass, self.rows, self.valid, part, share.samples, share.device);
        let mut commands: Vec<Command> =
            added_to.iter().map(|&(binding, image)| Command::Save { binding, image }).collect();
        for repeat in 0..share.repeats {
            if repeat > 0 {
                commands.extend(added_to.iter().map(|&(binding, image)| Command::Restore { binding, image }));
            }
            if begins {
                commands
                    .extend(self.images(|used| used.is_cleared).into_iter().map(|(_, image)| Command::Clear(image)));
            }
            let begin = pair.filter(|_| repeat == 0 && begins);
            let end = pair.filter(|_| repeat + 1 == share.repeats && ends).map(|pair| pair + 1);
            let (pass, launches) = (self.pass, launches.clone());
            commands.push(Command::Dispatch { pass, launches, begins: begin, ends: end.filter(|_| !builds) });
            commands.extend(builds.then_some(Command::Build { pass, ends: end }));
        }
        commands
    }
}

/// Work that ends before it has all samples.
pub struct Ended {
    /// Commands that complete the work.
    pub commands: Vec<Command>,
    /// Samples of the pixel that has the fewest.
    pub least: u32,
}

impl Work<'_> {
    /// Ends the work early, after the part before `at`. Pixels without samples take one, and runs that take none turn
    /// the means of the others into results. The frame's number of samples per pixel must be set to 1 before, so that
    /// any number of samples is enough.
    pub fn end_early(&self, at: Position, share: &Share<'_>, pair: Option<u32>) -> Ended {
        let launches = &self.linked().pass.launches;
        let one = PixelSamples { least: 1, ..share.samples };
        let needed: Vec<Run> = one.runs(launches).collect();
        let number = at.run as usize;
        let launch = |part: Range<Position>, samples| {
            launched(self.program, self.pass, self.rows, self.valid, &part, samples, share.device)
        };
        let mut runs = Vec::new();
        if number < needed.len() {
            runs.extend(launch(at..Position::END, one));
        }
        let mut least = 1;
        if let Some(run) = share.samples.runs(launches).nth(number).filter(|run| needed.get(number) != Some(run)) {
            let Words([begin, end, third]) = run.args;
            let to = |row| Position { run: at.run, row };
            let mut complete = |rows: Range<Position>, samples: u32| {
                let all = launch(rows, share.samples).into_iter();
                runs.extend(all.map(|mut run| {
                    run.constants.args = Words([samples, samples, third]);
                    run
                }));
            };
            complete(to(self.rows.start)..at, end);
            if number >= needed.len() {
                complete(at..to(self.rows.end), begin);
                least = begin;
            }
        }
        let begins = at == Position::start(self.rows);
        let cleared = self.images(|used| used.is_cleared && begins).into_iter();
        let mut commands: Vec<Command> = cleared.map(|(_, image)| Command::Clear(image)).collect();
        let (begins, ends) = (pair.filter(|_| begins), pair.map(|pair| pair + 1));
        commands.push(Command::Dispatch { pass: self.pass, launches: runs, begins, ends });
        Ended { commands, least }
    }
}

fn rows_of(program: &Program, task: usize, of: &Task, image: usize) -> Rows {
    let image = EyeImage { bound: program.images()[image], eye: of.view };
    Rows { task, image, rows: of.rows.clone() }
}

/// Returns the runs of a pass's kernel in a part of its work on `rows`.
pub fn launched(
    program: &Program,
    pass: usize,
    rows: &Range<u32>,
    valid: &Range<u32>,
    part: &Range<Position>,
    samples: PixelSamples,
    device: usize,
) -> Vec<Launched> {
    let pass = &program.passes()[pass].pass;
    let extent = pass.grid.extent(program.extent);
    let runs = (0..).zip(samples.runs(&pass.launches)).map(|(run, launch)| (rows_in(part, rows, run), launch));
    // All rows of a run may be in other parts. A pass without rows runs nevertheless, to warm up its pipeline.
    runs.filter(|(part, _)| !part.is_empty() || rows.is_empty())
        .map(|(part, run)| {
            // Kernels that change the scene do nothing if their arguments are 0.
            let is_idle = part.is_empty() && pass.kernel.scene == SceneUse::Write;
            let constants = PassConstants {
                view: (!pass.view.is_source()).into(),
                row_begin: part.start,
                row_end: part.end,
                valid_begin: valid.start,
                valid_end: valid.end,
                args: if is_idle { Words::default() } else { run.args },
                width: extent.width,
                height: extent.height,
                device: device as u32,
            };
            let groups = groups(pass.dispatch, pass.kernel.workgroup, extent.width, &part);
            Launched { jitter: run.jitter, constants, groups }
        })
        .collect()
}
