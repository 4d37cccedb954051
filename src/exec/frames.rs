//! The frames in flight: orders handed out, answers collected, devices that failed taken out.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use obvhs::aabb::Aabb;

use super::late::Late;
use super::messages::{Answer, FrameJob, Order, Pixels, Stop};
use super::output::Output;
use super::planner::Plan;
use super::watchdog::Limits;
use super::worker_pool::WorkerPool;
use super::{ExecError, Fault, FrameReport, InjectedFaults, Injection, Tally, TaskTiming};
use crate::device::DeviceFailure;
use crate::graph::FrameGraph;
use crate::passes::ROW_TALLY;
use crate::quality::Quality;
use crate::schedule::{Cut, Effort, Network};
use crate::stages::{Place, SceneUpdate, layout};

/// What a frame is made of.
#[derive(Clone)]
pub struct Inputs {
    pub constants: layout::Frame,
    pub quality: Quality,
    /// What its stages cost, held against other qualities.
    pub effort: Effort,
    /// Constants of the frame before.
    pub previous: layout::Previous,
    /// What it changes in the scene.
    pub update: SceneUpdate,
    /// Bounds of each body that moves, relative to the tables' origin, and by how much it has moved at most since the
    /// frame before, scene units.
    pub moved: Vec<(Aabb, f32)>,
    /// Seconds.
    pub time_s: f64,
    pub place: Place,
    /// The images that come back with its answer.
    pub reads: Arc<[Output]>,
    /// The images that end up whole on the primary; none: all.
    pub outputs: Option<Arc<[Output]>>,
    /// Where the pose is asked for that it is shown from; none: its constants have it.
    pub late: Option<Late>,
}

impl Inputs {
    /// Of both eyes.
    fn samples(&self) -> u64 {
        let layout::Frame { camera, sampling, .. } = self.constants;
        2 * u64::from(camera.width) * u64::from(camera.height) * u64::from(sampling.spp.max(1))
    }
}

/// How often a frame has been begun.
#[derive(Clone, Copy)]
pub struct Attempt {
    /// From 1.
    pub number: u32,
    /// The faults that the frame has run into are those from this one on.
    pub first_fault: usize,
    /// When the first attempt began, milliseconds since the renderer's origin.
    pub begin_ms: f64,
}

/// A frame that devices are at.
pub struct InFlight {
    pub inputs: Inputs,
    pub report: FrameReport,
    pub attempt: Attempt,
    graph: Arc<FrameGraph>,
    ticket: u64,
    /// What its workers were told; a later one may be shorter.
    limit: Duration,
    /// The faults that are injected into it.
    injections: Vec<Injection>,
}

/// Where the images of a frame are.
pub struct Whole {
    pub inputs: Inputs,
    pub primary: usize,
    pub end_ms: f64,
    /// Those that came with it.
    pub images: HashMap<Output, Pixels>,
    /// Where the primary has them, if it is on this rank.
    pub buffers: HashMap<Output, [wgpu::Buffer; 2]>,
}

/// What became of the frame that was begun first.
pub enum Finished {
    Whole(Box<InFlight>),
    /// These devices failed, so all frames in flight have to be begun again, oldest first.
    Failed {
        failures: BTreeMap<usize, DeviceFailure>,
        frames: Vec<InFlight>,
    },
}

/// What the answers to a frame's orders come to.
struct Collected {
    failures: BTreeMap<usize, DeviceFailure>,
    /// Whether no worker gave the frame up because of another.
    is_whole: bool,
    begin_ms: f64,
    end_ms: f64,
    images: HashMap<Output, Pixels>,
    buffers: HashMap<Output, [wgpu::Buffer; 2]>,
}

/// The workers with the frames that they are at.
pub struct Frames {
    workers: WorkerPool,
    pub limits: Limits,
    pub injected: InjectedFaults,
    pub faults: Vec<Fault>,
    /// Oldest first.
    in_flight: VecDeque<InFlight>,
    /// How many may be in flight.
    capacity: usize,
    /// The last frame that is whole.
    pub whole: Option<Whole>,
    origin: Instant,
}

impl Frames {
    pub fn new(workers: WorkerPool, capacity: usize, origin: Instant) -> Self {
        Self {
            workers,
            limits: Limits::default(),
            injected: InjectedFaults::default(),
            faults: Vec::new(),
            in_flight: VecDeque::new(),
            capacity,
            whole: None,
            origin,
        }
    }

    /// What rows take between devices of different ranks.
    pub fn network(&self) -> Network {
        self.workers.network()
    }

    /// Ends all workers.
    pub fn into_workers(self) -> WorkerPool {
        self.workers
    }

    pub fn now_ms(&self) -> f64 {
        self.origin.elapsed().as_secs_f64() * 1e3
    }

    pub fn devices_left(&self) -> Vec<usize> {
        self.workers.left()
    }

    pub fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    pub fn is_full(&self) -> bool {
        self.in_flight.len() >= self.capacity
    }

    /// The number of the frame that was begun first.
    pub fn oldest(&self) -> Option<u32> {
        self.in_flight.front().map(|f| f.report.index)
    }

    /// A frame that is begun for the first time, at `begin_ms`.
    pub fn first_attempt(&self, begin_ms: f64) -> Attempt {
        Attempt { number: 1, first_fault: self.faults.len(), begin_ms }
    }

    /// Gives every device its part of a frame, with the cuts of its work.
    pub fn hand_out(
        &mut self,
        inputs: Inputs,
        (plan, graph): (&Plan, Arc<FrameGraph>),
        cuts: impl Fn(usize) -> Vec<Cut>,
        report: FrameReport,
        attempt: Attempt,
    ) {
        let index = report.index;
        let (mut orders, mut injections) = (Vec::new(), Vec::new());
        for device in self.workers.left() {
            let (runs, injected) = self.injected.take(device, index);
            injections.extend(injected.map(|kind| Injection { kind, device, frame: index }));
            let Inputs { constants, previous, place, ref reads, .. } = inputs;
            let (reads, update) = (reads.to_vec(), inputs.update.clone());
            let (cuts, plan) = (cuts(device), plan.clone());
            let late = inputs.late.clone().filter(|_| device == plan.assignment.primary());
            let job = FrameJob { plan, constants, previous, update, place, reads, cuts, late, runs, injected };
            orders.push((device, Order::Frame(Box::new(job))));
        }
        let limit = self.limit(&inputs);
        let ticket = self.workers.ask(orders, limit);
        if let Some(before) = self.in_flight.back_mut() {
            (before.report.overlapped, before.report.predicted_ms) = (true, None);
        }
        self.in_flight.push_back(InFlight { inputs, report, attempt, graph, ticket, limit, injections });
    }

    /// Notes how long the frame that was handed out last is predicted to take.
    pub fn predict_last(&mut self, makespan_ms: Option<f64>) {
        if let Some(frame) = self.in_flight.back_mut() {
            frame.report.predicted_ms = makespan_ms;
        }
    }

    /// What a device may take for one thing that is waited for. Frames that were begun before may come first.
    fn limit(&self, inputs: &Inputs) -> Duration {
        self.limits.limit(inputs.samples() * self.capacity as u64)
    }

    /// Waits for the frame that was begun first; none if none is in flight.
    ///
    /// # Errors
    /// [`ExecError::Stuck`] if workers gave the frame up though no device failed, [`ExecError::Rank`] if a rank is lost.
    pub fn finish(&mut self) -> Result<Option<Finished>, ExecError> {
        let Some(mut frame) = self.in_flight.pop_front() else { return Ok(None) };
        let collected = self.collect(&mut frame);
        if let Some(lost) = self.workers.lost() {
            return Err(lost.into());
        }
        if !collected.failures.is_empty() {
            return Ok(Some(self.call_off(frame, collected.failures)));
        }
        if !collected.is_whole {
            return Err(ExecError::Stuck);
        }
        self.complete(&mut frame, collected);
        Ok(Some(Finished::Whole(Box::new(frame))))
    }

    fn collect(&mut self, frame: &mut InFlight) -> Collected {
        let primary = frame.report.assignment.primary();
        let mut all = Collected {
            failures: BTreeMap::new(),
            is_whole: true,
            begin_ms: f64::INFINITY,
            end_ms: 0.0,
            images: HashMap::new(),
            buffers: HashMap::new(),
        };
        for (device, answer) in self.workers.answers(frame.ticket, frame.limit) {
            match answer {
                Ok(Answer::Frame(reply)) => {
                    all.begin_ms = reply.begin_ms.min(all.begin_ms);
                    if device == primary {
                        all.end_ms = reply.end_ms;
                        frame.report.shown_from = reply.shown_from.map(|pose| *pose);
                        let names = Output::of_frame(&frame.graph.program, &frame.inputs.reads);
                        all.images = names.into_iter().zip(reply.images).collect();
                        all.buffers = reply.buffers.into_iter().collect();
                    }
                    frame.report.clock_residuals_us.push((device, reply.clock_residual_us));
                    let timing = |time| TaskTiming::of(&frame.graph, device, time);
                    frame.report.tasks.extend(reply.times.iter().filter_map(timing));
                }
                Ok(Answer::Pixels(_)) => {}
                Err(Stop::Device(failure)) => drop(all.failures.insert(device, failure)),
                Err(Stop::Aborted) => all.is_whole = false,
            }
        }
        all
    }

    /// Calls off the frames behind the one that these devices failed in.
    fn call_off(&mut self, frame: InFlight, mut failures: BTreeMap<usize, DeviceFailure>) -> Finished {
        let behind = std::mem::take(&mut self.in_flight);
        behind.iter().for_each(|f| self.workers.call_off(f.ticket));
        for other in &behind {
            for (device, answer) in self.workers.answers(other.ticket, other.limit) {
                if let Err(Stop::Device(failure)) = answer {
                    failures.entry(device).or_insert(failure);
                }
            }
        }
        let frames: Vec<InFlight> = std::iter::once(frame).chain(behind).collect();
        // Faults that were to be injected may not have happened when the frames were called off.
        let injections = frames.iter().flat_map(|f| &f.injections).filter(|i| !failures.contains_key(&i.device));
        self.injected.injections.extend(injections);
        Finished::Failed { failures, frames }
    }

    fn complete(&mut self, frame: &mut InFlight, collected: Collected) {
        let Collected { begin_ms, end_ms, mut images, buffers, .. } = collected;
        let report = &mut frame.report;
        if report.overlapped && frame.attempt.number == 1 {
            report.begin_ms = begin_ms;
        }
        report.makespan_ms = end_ms - report.begin_ms;
        report.interval_ms = self.whole.as_ref().map(|w| end_ms - w.end_ms);
        if let Some(tallies) = images.remove(&Output::from(ROW_TALLY)) {
            report.row_tallies = tallies.map(|bytes| bytemuck::pod_collect_to_vec(&bytes));
            report.tallies = report.row_tallies.each_ref().map(|rows| Tally::of(rows));
        }
        report.tasks.sort_by(|a, b| a.device.cmp(&b.device).then(a.begin_ms.total_cmp(&b.begin_ms)));
        if frame.attempt.number == 1 {
            self.limits.learn(frame.inputs.samples(), report.makespan_ms);
        }
        let primary = report.assignment.primary();
        self.recovered(frame.attempt);
        self.whole = Some(Whole { inputs: frame.inputs.clone(), primary, end_ms, images, buffers });
    }

    /// The frame of this attempt is whole, so its faults are overcome.
    fn recovered(&mut self, attempt: Attempt) {
        let now_ms = self.now_ms();
        for fault in self.faults[attempt.first_fault..].iter_mut().filter(|f| f.attempts == 0) {
            (fault.attempts, fault.recovery_ms) = (attempt.number, now_ms - fault.noticed_ms);
        }
    }

    /// Takes devices out that failed in this frame. `remove` is told the place of each among those that are left.
    ///
    /// # Errors
    /// [`ExecError::NoneLeft`]
    pub fn take_out(
        &mut self,
        frame: u32,
        failures: BTreeMap<usize, DeviceFailure>,
        mut remove: impl FnMut(usize),
    ) -> Result<(), ExecError> {
        let _span = tracing::info_span!("take devices out", frame).entered();
        let noticed_ms = self.now_ms();
        for (device, DeviceFailure { kind, what }) in failures {
            let left = self.workers.left();
            self.workers.take_out(device);
            if left.len() == 1 {
                return Err(ExecError::NoneLeft { device, what });
            }
            remove(left.iter().filter(|d| **d < device).count());
            self.faults.push(Fault { frame, device, kind, what, attempts: 0, recovery_ms: 0.0, noticed_ms });
        }
        Ok(())
    }

    /// The last whole frame, if the primary has this image of it and keeps it until another frame is begun.
    ///
    /// # Errors
    /// [`ExecError::NoFrame`] if there is no such frame or its images may be those of later ones already.
    pub fn whole_with(&self, image: &Output) -> Result<&Whole, ExecError> {
        let is_there = |whole: &&Whole| whole.inputs.outputs.as_ref().is_none_or(|outputs| outputs.contains(image));
        let whole = self.whole.as_ref().filter(|_| self.in_flight.is_empty()).filter(is_there);
        whole.ok_or(ExecError::NoFrame)
    }

    /// An image of the last whole frame, from its primary; or why that failed.
    ///
    /// # Errors
    /// Those of [`Self::whole_with`], and [`ExecError::Stuck`] if the worker gave no answer of this kind.
    pub fn fetch(&mut self, image: Output) -> Result<Result<Pixels, DeviceFailure>, ExecError> {
        let whole = self.whole_with(&image)?;
        let Whole { primary, inputs: Inputs { place, .. }, .. } = *whole;
        let limit = self.limit(&whole.inputs);
        let (_, injected) = self.injected.take(primary, whole.inputs.constants.sampling.index);
        let ticket = self.workers.ask(vec![(primary, Order::Read { image, place, injected })], limit);
        match self.workers.answers(ticket, limit).pop() {
            Some((_, Ok(Answer::Pixels(pixels)))) => Ok(Ok(pixels)),
            Some((_, Err(Stop::Device(failure)))) => Ok(Err(failure)),
            _ => Err(ExecError::Stuck),
        }
    }
}
