//! Frames in flight: distributes orders, collects answers, and drops devices that failed.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::inputs::Inputs;
use super::messages::{Answer, FrameJob, Pixels, Stop, TaskTime, Work};
use super::output::Output;
use super::plan::Plan;
use super::plausibility::check;
use super::stopping::StopFlag;
use super::watchdog::Limits;
use super::worker_pool::WorkerPool;
use super::{ExecError, Fault, FrameReport, InjectedFaults, Injection, Tally, TaskTiming};
use crate::device::DeviceFailure;
use crate::graph::FrameGraph;
use crate::passes::ROW_TALLY;
use crate::schedule::{Network, Prediction, Splits};

/// An attempt at a frame.
#[derive(Clone, Copy)]
pub struct Attempt {
    /// Number of the attempt, from 1.
    pub number: u32,
    /// Number of faults recorded before the frame's first attempt. Later faults are attributed to this frame.
    pub first_fault: usize,
    /// Begin of the first attempt, in milliseconds since the renderer's origin.
    pub begin_ms: f64,
}

/// A frame that the devices are rendering.
pub struct InFlight {
    pub inputs: Inputs,
    pub report: FrameReport,
    pub attempt: Attempt,
    graph: Arc<FrameGraph>,
    /// Predicted time of each device's tasks, in milliseconds; empty if unknown.
    tasks_ms: Vec<Vec<f64>>,
    ticket: u64,
    /// Time limit that its workers received with their orders. The current limit may be shorter.
    limit: Duration,
    /// Faults that the workers inject during this attempt.
    injections: Vec<Injection>,
}

/// The last complete frame, and the location of its images.
pub struct CompleteFrame {
    pub inputs: Inputs,
    pub primary: usize,
    pub end_ms: f64,
    /// Images that the primary returned with its answer.
    pub images: HashMap<Output, Pixels>,
    /// Buffers of its outputs on the primary; empty if the primary is on another rank.
    pub buffers: HashMap<Output, Vec<wgpu::Buffer>>,
}

/// Outcome of the oldest frame in flight.
pub enum Finished {
    /// The frame's report, and the number of its attempt.
    Complete(Box<FrameReport>, u32),
    /// The devices in `failures` failed, so the frames in `frames` must be begun again, oldest first.
    Failed { failures: BTreeMap<usize, DeviceFailure>, frames: Vec<InFlight> },
}

/// Combined answers of the workers to a frame's orders.
struct Collected {
    failures: BTreeMap<usize, DeviceFailure>,
    /// True unless a worker abandoned the frame because another device failed.
    is_whole: bool,
    begin_ms: f64,
    end_ms: f64,
    images: HashMap<Output, Pixels>,
    buffers: HashMap<Output, Vec<wgpu::Buffer>>,
}

/// The workers, and their frames in flight.
pub struct Frames {
    workers: WorkerPool,
    pub limits: Limits,
    pub injected: InjectedFaults,
    pub faults: Vec<Fault>,
    /// Frames in flight, oldest first.
    in_flight: VecDeque<InFlight>,
    /// Maximum number of frames in flight.
    capacity: usize,
    /// The last complete frame.
    pub whole: Option<CompleteFrame>,
    origin: Instant,
    stop: StopFlag,
    /// True once `stop` has ended a wait: devices may be busy for a long time.
    is_stopped: bool,
}

impl Frames {
    pub fn new(workers: WorkerPool, capacity: usize, origin: Instant, stop: StopFlag) -> Self {
        Self {
            workers,
            limits: Limits::default(),
            injected: InjectedFaults::default(),
            faults: Vec::new(),
            in_flight: VecDeque::new(),
            capacity,
            whole: None,
            origin,
            stop,
            is_stopped: false,
        }
    }

    /// Returns the model of the network between ranks: its latency and its time per byte.
    pub fn network(&self) -> Network {
        self.workers.network()
    }

    /// Returns the workers.
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

    /// Returns the index of the oldest frame in flight.
    pub fn oldest(&self) -> Option<u32> {
        self.in_flight.front().map(|f| f.report.index)
    }

    /// Returns the first attempt at a frame, which begins at `begin_ms`.
    pub fn first_attempt(&self, begin_ms: f64) -> Attempt {
        Attempt { number: 1, first_fault: self.faults.len(), begin_ms }
    }

    /// Sends every device its part of a frame, with the submission splits of its work.
    pub fn dispatch_frame(
        &mut self,
        inputs: Inputs,
        (plan, graph): (&Plan, Arc<FrameGraph>),
        splits: impl Fn(usize) -> Splits,
        report: FrameReport,
        attempt: Attempt,
    ) {
        let index = report.index;
        let (mut orders, mut injections) = (Vec::new(), Vec::new());
        for device in self.workers.left() {
            let (runs, injected) = self.injected.take(device, index);
            injections.extend(injected.map(|kind| Injection { kind, device, frames: index..index + 1 }));
            let Inputs { constants, previous, place, ref reads, .. } = inputs;
            let (reads, update, views) = (reads.to_vec(), inputs.update.clone(), inputs.views.clone());
            let (splits, plan) = (splits(device), plan.clone());
            let late = inputs.late.clone().filter(|_| device == plan.assignment.primary());
            let watch = inputs.watch.clone();
            let job = FrameJob {
                plan,
                constants,
                previous,
                views,
                update,
                place,
                reads,
                splits,
                late,
                runs,
                injected,
                watch,
            };
            orders.push((device, Work::Frame(Box::new(job))));
        }
        let limit = self.limit(&inputs);
        let ticket = self.workers.ask(orders, limit);
        if let Some(before) = self.in_flight.back_mut() {
            (before.report.overlapped, before.report.predicted_ms) = (true, None);
        }
        self.in_flight.push_back(InFlight {
            inputs,
            report,
            attempt,
            graph,
            tasks_ms: Vec::new(),
            ticket,
            limit,
            injections,
        });
    }

    /// Records the prediction of the frame that was dispatched last. The makespan of frames that overlap is unknown.
    pub fn predict_last(&mut self, prediction: Prediction) {
        if let Some(frame) = self.in_flight.back_mut() {
            let report = &mut frame.report;
            report.predicted_ms = Some(prediction.makespan_ms).filter(|_| !report.overlapped);
            frame.tasks_ms = prediction.tasks_ms;
        }
    }

    /// Returns the time limit for a single wait on a device. A wait may include the work of all frames in flight, so
    /// the limit allows for `capacity` frames.
    fn limit(&self, inputs: &Inputs) -> Duration {
        self.limits.limit(inputs.samples() * self.capacity as u64)
    }

    /// Waits for the oldest frame in flight; returns `None` if there is none. Calls `progress` repeatedly with the
    /// fraction of its work that is done, if the frame is watched.
    ///
    /// # Errors
    /// [`ExecError::Stuck`] if workers abandoned the frame although no device failed, [`ExecError::Stopped`] if the stop
    /// flag ended the wait, [`ExecError::Implausible`] if its counts or times are impossible, [`ExecError::Rank`] if a
    /// rank is lost.
    pub fn finish(&mut self, progress: &mut dyn FnMut(f64)) -> Result<Option<Finished>, ExecError> {
        let Some(mut frame) = self.in_flight.pop_front() else { return Ok(None) };
        let collected = if self.is_stopped { None } else { self.collect(&mut frame, progress) };
        let Some(collected) = collected else {
            self.is_stopped = true;
            self.in_flight.clear();
            return Err(ExecError::Stopped);
        };
        if let Some(lost) = self.workers.lost() {
            return Err(lost.into());
        }
        if !collected.failures.is_empty() {
            return Ok(Some(self.call_off(frame, collected.failures)));
        }
        if !collected.is_whole {
            return Err(ExecError::Stuck);
        }
        self.complete(frame, collected).map(Some)
    }

    /// Collects the answers to a frame's orders; `None` if the stop flag ended the wait.
    fn collect(&mut self, frame: &mut InFlight, progress: &mut dyn FnMut(f64)) -> Option<Collected> {
        let primary = frame.report.assignment.primary();
        let mut all = Collected {
            failures: BTreeMap::new(),
            is_whole: true,
            begin_ms: f64::INFINITY,
            end_ms: 0.0,
            images: HashMap::new(),
            buffers: HashMap::new(),
        };
        let (stop, mut waits) = (self.stop.clone(), self.stop.begin_wait());
        let (watch, devices) = (frame.inputs.watch.clone(), self.workers.left());
        let goes_on = || {
            let Some(watch) = &watch else { return waits() };
            progress(watch.fraction(&devices));
            // A frame that its own flag ends has a picture, however long that takes.
            if watch.ends_with_picture() { !(watch.is_hopeless() && stop.is_set()) } else { waits() }
        };
        for (device, answer) in self.workers.answers_while(frame.ticket, frame.limit, goes_on)? {
            match answer {
                Ok(Answer::Frame(reply)) => {
                    all.begin_ms = reply.begin_ms.min(all.begin_ms);
                    frame.report.spp_done = frame.report.spp_done.into_iter().chain(reply.spp_done).min();
                    if device == primary {
                        all.end_ms = reply.end_ms;
                        frame.report.shown_from = reply.shown_from.map(|pose| *pose);
                        let names = Output::of_frame(&frame.graph.program, &frame.inputs.reads);
                        all.images = names.into_iter().zip(reply.images).collect();
                        all.buffers = reply.buffers.into_iter().collect();
                    }
                    frame.report.clock_residuals_us.push((device, reply.clock_residual_us));
                    let tasks_ms = frame.tasks_ms.get(device);
                    let predicted_ms = |time: &TaskTime| tasks_ms.and_then(|tasks| tasks.get(time.task)).copied();
                    let timing = |time| TaskTiming::of(&frame.graph, device, time, predicted_ms(time));
                    frame.report.tasks.extend(reply.times.iter().filter_map(timing));
                }
                Ok(Answer::Pixels(_)) => {}
                Err(Stop::Device(failure)) => drop(all.failures.insert(device, failure)),
                Err(Stop::Aborted) => all.is_whole = false,
            }
        }
        Some(all)
    }

    /// Cancels the frames that were begun after the one in which these devices failed.
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
        // The cancelled frames may have ended before their faults were injected, so inject these again.
        let injections =
            frames.iter().flat_map(|f| &f.injections).filter(|i| !failures.contains_key(&i.device)).cloned();
        self.injected.injections.extend(injections);
        Finished::Failed { failures, frames }
    }

    fn complete(&mut self, frame: InFlight, collected: Collected) -> Result<Finished, ExecError> {
        let Collected { begin_ms, end_ms, mut images, buffers, .. } = collected;
        let InFlight { inputs, mut report, attempt, .. } = frame;
        if report.overlapped && attempt.number == 1 {
            report.begin_ms = begin_ms;
        }
        report.makespan_ms = end_ms - report.begin_ms;
        report.interval_ms = self.whole.as_ref().map(|w| end_ms - w.end_ms);
        if let Some(tallies) = images.remove(&Output::from(ROW_TALLY)) {
            report.row_tallies = tallies.iter().map(|bytes| bytemuck::pod_collect_to_vec(bytes)).collect();
            report.tallies = report.row_tallies.iter().map(|rows| Tally::of(rows)).collect();
        }
        report.tasks.sort_by(|a, b| a.device.cmp(&b.device).then(a.begin_ms.total_cmp(&b.begin_ms)));
        let times = report.tasks.iter().flat_map(|task| [task.begin_ms, task.end_ms]);
        check(&inputs.constants, &report.pixels, &report.tallies, times.chain([begin_ms, end_ms]))
            .map_err(|what| ExecError::Implausible { frame: report.index, what })?;
        if attempt.number == 1 {
            self.limits.learn(inputs.samples(), report.makespan_ms);
        }
        let primary = report.assignment.primary();
        self.recovered(attempt, end_ms);
        self.whole = Some(CompleteFrame { inputs, primary, end_ms, images, buffers });
        Ok(Finished::Complete(Box::new(report), attempt.number))
    }

    /// Marks the faults of a frame as recovered by this attempt, which was complete at `end_ms`.
    fn recovered(&mut self, attempt: Attempt, end_ms: f64) {
        for fault in self.faults[attempt.first_fault..].iter_mut().filter(|f| f.attempts == 0) {
            (fault.attempts, fault.recovery_ms) = (attempt.number, end_ms - attempt.begin_ms);
        }
    }

    /// Drops the devices that failed in this frame. Calls `remove` for each of them, with its index among the devices
    /// that remained before it was dropped.
    ///
    /// # Errors
    /// [`ExecError::NoneLeft`]
    pub fn drop_device(
        &mut self,
        frame: u32,
        failures: BTreeMap<usize, DeviceFailure>,
        mut remove: impl FnMut(usize),
    ) -> Result<(), ExecError> {
        let _span = tracing::info_span!("take devices out", frame).entered();
        let noticed_ms = self.now_ms();
        for (device, DeviceFailure { kind, what }) in failures {
            let left = self.workers.left();
            self.workers.drop_device(device);
            if left.len() == 1 {
                return Err(ExecError::NoneLeft { device, what });
            }
            remove(left.iter().filter(|d| **d < device).count());
            self.faults.push(Fault { frame, device, kind, what, attempts: 0, recovery_ms: 0.0, noticed_ms });
        }
        Ok(())
    }

    /// Returns the last complete frame, if the primary still has this image of the frame. The primary keeps the image
    /// until another frame begins.
    ///
    /// # Errors
    /// [`ExecError::NoFrame`] if there is no such frame, or later frames may have overwritten its images.
    pub fn complete_with(&self, image: &Output) -> Result<&CompleteFrame, ExecError> {
        let is_there =
            |whole: &&CompleteFrame| whole.inputs.outputs.as_ref().is_none_or(|outputs| outputs.contains(image));
        let whole = self.whole.as_ref().filter(|_| self.in_flight.is_empty()).filter(is_there);
        whole.ok_or(ExecError::NoFrame)
    }

    /// Reads an image of the last complete frame from its primary. The inner error is the primary's failure.
    ///
    /// # Errors
    /// Errors of [`Self::complete_with`], [`ExecError::Stuck`] if the worker did not answer with an image, and
    /// [`ExecError::Stopped`] if the stop flag has ended a wait.
    pub fn fetch(&mut self, image: Output) -> Result<Result<Pixels, DeviceFailure>, ExecError> {
        if self.is_stopped {
            return Err(ExecError::Stopped);
        }
        let whole = self.complete_with(&image)?;
        let CompleteFrame { primary, inputs: Inputs { place, .. }, .. } = *whole;
        let limit = self.limit(&whole.inputs);
        let (_, injected) = self.injected.take(primary, whole.inputs.constants.sampling.index);
        let ticket = self.workers.ask(vec![(primary, Work::Read { image, place, injected })], limit);
        match self.workers.answers(ticket, limit).pop() {
            Some((_, Ok(Answer::Pixels(pixels)))) => Ok(Ok(pixels)),
            Some((_, Err(Stop::Device(failure)))) => Ok(Err(failure)),
            _ => Err(ExecError::Stuck),
        }
    }
}
