//! Tasks that a device divides itself, since their time is unknown or they may have to end early.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::{Part, share_of};
use crate::device::DeviceFailure;
use crate::exec::worker::device::WorkerDevice;
use crate::graph::{FrameGraph, Pass, Work as Cost};
use crate::passes::path_trace::HOLE_FILL;
use crate::plan::{Command, Work};
use crate::samples::PixelSamples;
use crate::schedule::{Divisible, Position};

/// Time for which later tasks of a frame go on taking samples once one has ended early.
const LATER_TASKS: Duration = Duration::from_millis(300);

/// Longest predicted time of the first samples of pixels that have none. Beyond it, a frame that should end early has
/// no picture.
const FIRST_SAMPLES_MS: f64 = 500.0;

/// Estimates the cost of one path of a pass, relative to others.
fn path_cost(pass: &Pass) -> f64 {
    let of_path = if pass.work == Cost::Rays { 1.0 } else { 0.1 };
    // Few pixels are holes.
    if fills_holes(pass) { 0.1 * of_path } else { of_path }
}

fn fills_holes(pass: &Pass) -> bool {
    pass.stage == HOLE_FILL
}

/// True if the samples of a pass count as those of the frame.
fn counts(pass: &Pass) -> bool {
    pass.work == Cost::Rays && !fills_holes(pass)
}

impl Part {
    /// Executes a task of unknown time in submissions that grow with what the device has timed. If the frame is
    /// watched, at most one submission is on the device when another follows.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub(super) fn probe(
        &mut self,
        device: &mut WorkerDevice,
        task: usize,
        stamps: Option<u32>,
        beat: impl Fn(),
    ) -> Result<(), DeviceFailure> {
        let graph = Arc::clone(&self.graph);
        let Some(work) = work_of(&graph, self.device, task) else { return Ok(()) };
        let (bound_ms, samples) = (self.job.splits.bound_ms, self.job.constants.sampling.samples);
        let divisible = Divisible::new(work.program, work.pass, work.rows, samples);
        let pass = &work.program.passes()[work.pass].pass;
        let key = (pass.kernel.name, pass.index);
        let watch = self.job.watch.clone();
        if self.probing.ending.is_some() {
            device.stages.set_least_samples(&device.gpu, samples.least);
        }
        let mut at = Position::start(work.rows);
        while at < Position::END {
            let is_ending = watch.as_ref().is_some_and(|watch| watch.is_ending());
            if is_ending && self.ends_now(at == Position::start(work.rows) && fills_holes(pass)) {
                return self.end_early(device, &work, (task, stamps), at);
            }
            let to = device.speeds.reach(key, &divisible, at, bound_ms);
            let paths = divisible.paths(&(at..to));
            let is_timed = to < Position::END || device.speeds.is_new(key, paths);
            if is_timed {
                // The device must be idle, or the time would include other work.
                device.gpu.wait(None)?;
            }
            let begin_ms = device.now_ms();
            let commands = work.part(&(at..to), &share_of(&self.job, self.ticket, self.device), stamps);
            self.submit_all(device, task, &commands)?;
            beat();
            if is_timed {
                device.gpu.wait(None)?;
                device.speeds.learn(key, paths, device.now_ms() - begin_ms);
            }
            if let Some(watch) = &watch {
                self.probing.done += paths * path_cost(pass);
                watch.progress(self.device, self.probing.done / self.cost_of_probes().max(1.0));
            }
            at = to;
        }
        self.took(device, counts(pass).then_some(samples.least));
        Ok(())
    }

    fn submit_all(
        &mut self,
        device: &mut WorkerDevice,
        task: usize,
        commands: &[Command],
    ) -> Result<(), DeviceFailure> {
        commands.iter().try_for_each(|command| self.perform(device, command))?;
        self.close();
        self.submit(device);
        *self.probing.submissions.entry(task).or_default() += 1;
        Ok(())
    }

    /// Estimates the cost of all tasks that the device divides itself.
    fn cost_of_probes(&self) -> f64 {
        let samples = self.job.constants.sampling.samples;
        let cost = |task: &usize| {
            let work = work_of(&self.graph, self.device, *task)?;
            let all = Position::start(work.rows)..Position::END;
            let pass = &work.program.passes()[work.pass].pass;
            Some(Divisible::new(work.program, work.pass, work.rows, samples).paths(&all) * path_cost(pass))
        };
        self.job.splits.probes.iter().filter_map(cost).sum()
    }

    /// Decides whether a task ends, in a frame that ends early. `may_begin` is true for a short task that has not begun.
    fn ends_now(&mut self, may_begin: bool) -> bool {
        let is_first = self.probing.ending.is_none();
        let since = *self.probing.ending.get_or_insert_with(Instant::now);
        (is_first && !may_begin) || since.elapsed() > LATER_TASKS
    }

    /// Ends a task after the part before `at`: takes a first sample of pixels that have none, and turns the means of the
    /// samples so far into results.
    fn end_early(
        &mut self,
        device: &mut WorkerDevice,
        work: &Work<'_>,
        (task, stamps): (usize, Option<u32>),
        at: Position,
    ) -> Result<(), DeviceFailure> {
        let pass = &work.program.passes()[work.pass].pass;
        let ended = work.end_early(at, &share_of(&self.job, self.ticket, self.device), stamps);
        let one = PixelSamples { least: 1, ..self.job.constants.sampling.samples };
        let missing = Divisible::new(work.program, work.pass, work.rows, one).paths(&(at..Position::END));
        let first_ms = device.speeds.expected_ms((pass.kernel.name, pass.index), missing);
        if !fills_holes(pass) && first_ms > FIRST_SAMPLES_MS {
            self.job.watch.iter().for_each(|watch| watch.give_up());
        }
        // Kernels yield results once they have this number of samples.
        device.stages.set_least_samples(&device.gpu, 1);
        self.submit_all(device, task, &ended.commands)?;
        self.took(device, counts(pass).then_some(ended.least));
        Ok(())
    }

    /// Notes that a task has taken this number of samples, if they count. In a frame that ends early, later passes
    /// reckon with the least number.
    fn took(&mut self, device: &WorkerDevice, samples: Option<u32>) {
        let before = self.probing.least.unwrap_or(self.job.constants.sampling.samples.least);
        let least = samples.map_or(before, |samples| before.min(samples));
        self.probing.least = Some(least);
        if self.probing.ending.is_some() {
            device.stages.set_least_samples(&device.gpu, least);
        }
    }
}

fn work_of(graph: &FrameGraph, device: usize, task: usize) -> Option<Work<'_>> {
    Work::of(graph, graph.parts_of(device).0.get(task)?)
}
