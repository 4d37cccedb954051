//! Frames planned, handed out, and taken in again.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, unbounded};

use super::crew::Crew;
use super::history::history_rows;
use super::messages::{Answer, FrameJob, Order, Parcel, Pixels, Stop};
use super::post::Post;
use super::watchdog::Watchdog;
use super::worker::Worker;
use super::{ExecError, Fault, FrameReport, Injection, RenderSettings, Tally, Trouble, costs, quality};
use crate::device::{DeviceFailure, DeviceInfo, GpuDevice};
use crate::graph::{Assignment, FrameGraph, FrameSpec, PhysicalImage, Seam, Stage, Views, passes};
use crate::image::Extent;
use crate::quality::Quality;
use crate::scene::rig::{Eye, Rig};
use crate::scene::shot::Gaze;
use crate::schedule::{CostModel, Effort, FrameCosts, Policy, choose_halo, simulate};
use crate::stages::{Foveation, Place, SceneTables, layout};

/// Renders frames on a set of devices.
pub struct Renderer {
    pub(super) settings: RenderSettings,
    pub(super) spec: FrameSpec,
    /// Of the frames that are begun.
    pub(super) quality: Quality,
    /// What stages of that quality cost, held against other qualities.
    pub(super) effort: Effort,
    tables: Arc<SceneTables>,
    policy: Box<dyn Policy>,
    pub(super) costs: CostModel,
    devices: Vec<DeviceInfo>,
    pub(super) crew: Crew,
    watchdog: Watchdog,
    pub(super) trouble: Trouble,
    faults: Vec<Fault>,
    /// The next frame is not to build on those before.
    begins_anew: bool,
    /// The graph that the last plan gave.
    pub(super) planned: Option<(Plan, Arc<FrameGraph>)>,
    /// Handed out, oldest first.
    in_flight: VecDeque<InFlight>,
    begun: u64,
    /// What the last frame that was begun was made of.
    last: Option<Inputs>,
    /// The last frame that is whole.
    pub(super) whole: Option<Whole>,
    origin: Instant,
}

/// What a frame is made of.
#[derive(Clone)]
pub(super) struct Inputs {
    constants: layout::Frame,
    quality: Quality,
    effort: Effort,
    /// The eyes of the frame before.
    previous: [layout::View; 2],
    place: Place,
    reads: Arc<[PhysicalImage]>,
}

/// What a frame's graph is made of, beside what all frames have in common.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    seam: Seam,
    pub iterations: u32,
    pub assignment: Assignment,
    /// Who had which rows in the frame before, and how many rows its surfaces may have moved.
    pub history: Option<(Assignment, u32)>,
}

/// A frame that devices are at.
struct InFlight {
    inputs: Inputs,
    ticket: u64,
    /// What its workers were told; a later one may be shorter.
    limit: Duration,
    report: FrameReport,
    primary: usize,
    /// What is to happen to devices in it.
    injections: Vec<Injection>,
    /// Faults are the frame's own from here on.
    first_fault: usize,
    attempts: u32,
}

/// Where the images of a frame are.
pub(super) struct Whole {
    pub inputs: Inputs,
    pub primary: usize,
    pub end_ms: f64,
    /// Those that came with it.
    pub images: HashMap<PhysicalImage, Pixels>,
}

impl Inputs {
    pub fn index(&self) -> u32 {
        self.constants.index
    }

    pub fn place(&self) -> Place {
        self.place
    }
}

impl Renderer {
    /// Starts a worker per device and warms every pipeline up. Times are counted from `origin`.
    pub fn new(
        gpus: Vec<GpuDevice>,
        tables: Arc<SceneTables>,
        settings: RenderSettings,
        policy: Box<dyn Policy>,
        origin: Instant,
    ) -> Result<Self, ExecError> {
        let spec = FrameSpec {
            extent: settings.stages.extent,
            devices: gpus.len(),
            views: if settings.stages.reproject { Views::Reprojected } else { Views::Traced },
            filter: settings.stages.filter,
            sparse: settings.stages.leaves_pixels(),
            iterations: settings.stages.iterations,
            history_rows: settings.stages.keeps_history().then_some(0),
            seam: settings.seam,
            aovs: settings.stages.aovs.len() as u8,
            has_surfaces: tables.has_surfaces(),
        };
        let mut stages: Vec<Stage> = passes(&spec).iter().map(|p| p.stage).collect();
        stages.sort();
        stages.dedup();
        let (reply, replies) = unbounded();
        let parcels: Vec<(Sender<Parcel>, Receiver<Parcel>)> = gpus.iter().map(|_| unbounded()).collect();
        let outboxes: Vec<_> = parcels.iter().map(|(s, _)| s.clone()).collect();
        let (mut devices, mut workers) = (Vec::new(), Vec::new());
        for (gpu, (_, inbox)) in gpus.into_iter().zip(parcels) {
            let post = Post::new(gpu.info.index, inbox, outboxes.clone());
            let worker = Worker::new(gpu, &settings.stages, &tables, &stages, post, reply.clone(), origin)?;
            devices.push(worker.info().clone());
            workers.push(worker);
        }
        let crew = Crew::start(workers, replies, outboxes)?;
        Ok(Self {
            costs: CostModel::new(&spec),
            quality: quality::of(&settings),
            effort: Effort::default(),
            settings,
            spec,
            tables,
            policy,
            devices,
            crew,
            watchdog: Watchdog::default(),
            trouble: Trouble::default(),
            faults: Vec::new(),
            begins_anew: false,
            planned: None,
            in_flight: VecDeque::new(),
            begun: 0,
            last: None,
            whole: None,
            origin,
        })
    }

    /// The devices that have not failed, for another renderer, which need not compile again what it has in common with this
    /// one.
    pub fn into_devices(mut self) -> Vec<GpuDevice> {
        self.crew.end()
    }

    /// Takes a device out that gives no sign of life for this long, instead of a limit that follows from what frames
    /// took.
    pub fn set_watchdog(&mut self, limit: Duration) {
        self.watchdog.fixed = Some(limit);
    }

    /// Trouble to come.
    pub fn set_trouble(&mut self, trouble: Trouble) {
        self.trouble = trouble;
    }

    /// How often each device runs its dispatches from here on; once where nothing is said.
    pub fn set_slowdown(&mut self, slowdown: Vec<u32>) {
        self.trouble.slowdown = slowdown;
    }

    /// The next frame finds no history.
    pub fn begin_anew(&mut self) {
        self.begins_anew = true;
    }

    /// What follows the gaze, if anything does.
    pub fn foveation(&self) -> Option<&Foveation> {
        self.settings.stages.foveation.as_ref()
    }

    /// Where both eyes look from the next frame on, fractions of each one's image from the top left. Of no use without
    /// foveation.
    pub fn set_gaze(&mut self, [x, y]: [f64; 2]) {
        if let Some(foveation) = &mut self.settings.stages.foveation {
            foveation.gaze = [0, 1].map(|_| Gaze { path: vec![[0.0, x, y]] });
        }
    }

    /// The devices that were taken out, in order.
    pub fn faults(&self) -> &[Fault] {
        &self.faults
    }

    /// All that there were at the start.
    pub fn devices(&self) -> &[DeviceInfo] {
        &self.devices
    }

    /// What has been learned of the devices and the frame.
    pub fn costs(&self) -> &CostModel {
        &self.costs
    }

    pub fn policy_name(&self) -> &'static str {
        self.policy.name()
    }

    /// Renders the frame that the rig sees at `time_s`. `index` keys its random numbers.
    pub fn render(&mut self, rig: &Rig, time_s: f64, index: u32) -> Result<FrameReport, ExecError> {
        self.begin(rig, time_s, index, &[])?;
        self.finish_last()
    }

    /// [`Self::render`] with only these samples of sequences that each pixel has for itself, at most
    /// [`crate::stages::StageSettings::spp`] of them.
    pub fn render_samples(
        &mut self,
        rig: &Rig,
        time_s: f64,
        index: u32,
        samples: Range<u32>,
    ) -> Result<FrameReport, ExecError> {
        let constants = layout::Frame { curve_shift: layout::NO_CURVE, ..self.constants(rig, time_s, index, samples) };
        self.begin_with(constants, &[])?;
        self.finish_last()
    }

    /// Begins a frame as [`Self::render`] does, and waits for none: [`Self::finish`] does, in the same order. At most
    /// [`crate::stages::StageSettings::frames_in_flight`] may be begun and not finished; another one finishes the oldest
    /// first, whose report is lost. `reads` are the images that can be read while frames are in flight.
    pub fn begin(&mut self, rig: &Rig, time_s: f64, index: u32, reads: &[PhysicalImage]) -> Result<(), ExecError> {
        let spp = self.quality.spp;
        let curve_shift = curve_shift(self.spec.extent, spp);
        let constants = layout::Frame { curve_shift, ..self.constants(rig, time_s, index, 0..spp) };
        self.begin_with(constants, reads)
    }

    fn begin_with(&mut self, constants: layout::Frame, reads: &[PhysicalImage]) -> Result<(), ExecError> {
        let slots = self.settings.stages.frames_in_flight;
        if self.in_flight.len() >= slots {
            self.finish()?;
        }
        let previous = self.last.as_ref().map_or(constants.views, |l| l.constants.views);
        let place = Place::of(self.begun, slots);
        self.begun += 1;
        let (quality, effort) = (self.quality, self.effort.clone());
        let inputs = Inputs { constants, quality, effort, previous, place, reads: reads.into() };
        self.last = Some(inputs.clone());
        self.hand_out(inputs, None);
        Ok(())
    }

    fn finish_last(&mut self) -> Result<FrameReport, ExecError> {
        let mut report = None;
        while let Some(finished) = self.finish()? {
            report = Some(finished);
        }
        report.ok_or(ExecError::NoFrame)
    }

    /// How many frames are begun and not finished.
    pub fn in_flight(&self) -> usize {
        self.in_flight.len()
    }

    /// Waits for the frame that was begun first; none if none is left. When a device fails, all that is in flight is
    /// begun again on the others.
    pub fn finish(&mut self) -> Result<Option<FrameReport>, ExecError> {
        loop {
            let Some(mut frame) = self.in_flight.pop_front() else { return Ok(None) };
            let _span = tracing::info_span!("finish frame", frame = frame.report.index).entered();
            let failures = self.take_in(&mut frame)?;
            if failures.is_empty() {
                return Ok(Some(frame.report));
            }
            self.begin_again(frame, failures)?;
        }
    }

    /// Goes on without these devices: this frame and all those behind it are handed out anew.
    fn begin_again(&mut self, frame: InFlight, failures: Vec<(usize, DeviceFailure)>) -> Result<(), ExecError> {
        let index = frame.report.index;
        let mut failed: BTreeMap<usize, DeviceFailure> = failures.into_iter().collect();
        let behind: Vec<InFlight> = self.in_flight.drain(..).collect();
        behind.iter().for_each(|f| self.crew.call_off(f.ticket));
        for other in &behind {
            for (device, answer) in self.crew.answers(other.ticket, other.limit) {
                if let Err(Stop::Device(failure)) = answer {
                    failed.entry(device).or_insert(failure);
                }
            }
        }
        let (first_fault, attempts, begin_ms) = (frame.first_fault, frame.attempts, frame.report.begin_ms);
        // What was to happen may not have come to pass when devices were called off.
        self.trouble.injections.extend(frame.injections.into_iter().filter(|i| !failed.contains_key(&i.device)));
        self.take_out(index, failed)?;
        self.hand_out(frame.inputs, Some((first_fault, attempts + 1, begin_ms)));
        for frame in behind {
            self.trouble.injections.extend(frame.injections);
            self.hand_out(frame.inputs, None);
        }
        Ok(())
    }

    /// Plans a frame and gives every device its part. If it was begun before: where its faults begin, the number of this
    /// attempt and when the first one began.
    fn hand_out(&mut self, mut inputs: Inputs, again: Option<(usize, u32, f64)>) {
        let index = inputs.constants.index;
        let _span = tracing::info_span!("begin frame", frame = index).entered();
        let now_ms = self.origin.elapsed().as_secs_f64() * 1e3;
        let (first_fault, attempts, begin_ms) = again.unwrap_or((self.faults.len(), 1, now_ms));
        let overlapped = !self.in_flight.is_empty();
        // What devices that failed had kept is lost, so all of it is.
        let is_lost = again.is_some() | std::mem::take(&mut self.begins_anew);
        let history_rows = if is_lost { None } else { self.history_rows(&inputs) };
        inputs.constants.history_rows = history_rows.unwrap_or(layout::NO_HISTORY);
        let (plan, graph) = self.plan(&inputs, history_rows);
        let known = self.costs.has_learned() && !overlapped;
        let predicted = known.then(|| simulate(&graph, &self.costs).ok()).flatten();
        let report = FrameReport {
            index,
            begin_ms,
            makespan_ms: 0.0,
            interval_ms: None,
            slot: inputs.place.slot,
            overlapped,
            predicted_ms: predicted.map(|p| p.makespan_ms),
            plan_ms: self.origin.elapsed().as_secs_f64() * 1e3 - now_ms,
            tasks: Vec::new(),
            tallies: Default::default(),
            row_tallies: Default::default(),
            devices: self.crew.left(),
            assignment: plan.assignment,
            spec: FrameSpec { history_rows, ..self.spec.clone() },
            pixel_centre: inputs.constants.centre.to_array(),
        };
        let (mut orders, mut injections) = (Vec::new(), Vec::new());
        for device in self.crew.left() {
            let (runs, injected) = self.trouble.take(device, index);
            injections.extend(injected.map(|kind| Injection { kind, device, frame: index }));
            let Inputs { constants, previous, place, reads, .. } = inputs.clone();
            let job = FrameJob { graph: Arc::clone(&graph), constants, previous, place, reads, runs, injected };
            orders.push((device, Order::Frame(Box::new(job))));
        }
        let limit = self.limit(&inputs);
        let ticket = self.crew.ask(orders, limit);
        if let Some(before) = self.in_flight.back_mut() {
            (before.report.overlapped, before.report.predicted_ms) = (true, None);
        }
        let primary = graph.primary;
        self.in_flight.push_back(InFlight {
            inputs,
            ticket,
            limit,
            report,
            primary,
            injections,
            first_fault,
            attempts,
        });
    }

    /// What a device may take for one thing that is waited for. Frames that were begun before may come first.
    pub(super) fn limit(&self, inputs: &Inputs) -> Duration {
        self.watchdog.limit(self.samples(inputs) * self.settings.stages.frames_in_flight as u64)
    }

    /// Of both eyes of a frame.
    fn samples(&self, inputs: &Inputs) -> u64 {
        2 * self.spec.extent.area() as u64 * u64::from(inputs.constants.spp.max(1))
    }

    /// Stripes and graph of the next frame; the graph is built anew only when something of its plan has changed.
    fn plan(&mut self, inputs: &Inputs, history_rows: Option<u32>) -> (Plan, Arc<FrameGraph>) {
        let left = self.crew.left();
        self.spec.iterations = inputs.quality.most_iterations();
        self.costs.set_quality(self.spec.iterations, &inputs.effort);
        self.plan_halo(&left);
        let assignment = self.policy.assign(&self.costs.of_devices(&left)).renumbered(&left, self.devices.len());
        let before = self.planned.take();
        let history = before.as_ref().zip(history_rows).map(|((plan, _), rows)| (plan.assignment.clone(), rows));
        let plan = Plan { seam: self.spec.seam, iterations: self.spec.iterations, assignment, history };
        let graph = match before {
            Some((old, graph)) if old == plan => graph,
            _ => {
                let spec = FrameSpec { history_rows, ..self.spec.clone() };
                Arc::new(FrameGraph::build(&spec, &plan.assignment, plan.history.as_ref().map(|(before, _)| before)))
            }
        };
        self.planned = Some((plan.clone(), Arc::clone(&graph)));
        (plan, graph)
    }

    /// How many rows up and down a frame looks for the history of its surfaces; none if there is none.
    fn history_rows(&self, inputs: &Inputs) -> Option<u32> {
        let keeps = self.settings.stages.keeps_history() && self.planned.is_some();
        keeps.then(|| history_rows(&inputs.constants, &inputs.previous, &self.tables)).flatten()
    }

    fn plan_halo(&mut self, left: &[usize]) {
        let Seam::Halo(now) = self.spec.seam else { return };
        if self.settings.adapts_halo {
            let next = Seam::Halo(choose_halo(&self.costs.of_devices(left), now));
            if next != self.spec.seam {
                self.spec.seam = next;
                self.costs.set_seam(next);
            }
        }
    }

    /// Collects a frame's answers; returns the devices that failed. A whole frame is learned from.
    fn take_in(&mut self, frame: &mut InFlight) -> Result<Vec<(usize, DeviceFailure)>, ExecError> {
        let answers = self.crew.answers(frame.ticket, frame.limit);
        let (mut failures, mut is_whole, mut begin_ms, mut end_ms) = (Vec::new(), true, f64::INFINITY, 0.0);
        let mut images = HashMap::new();
        for (device, answer) in answers {
            match answer {
                Ok(Answer::Frame(reply)) => {
                    begin_ms = reply.begin_ms.min(begin_ms);
                    if device == frame.primary {
                        end_ms = reply.end_ms;
                        images = reply.images.into_iter().collect();
                    }
                    frame.report.tasks.extend(reply.tasks);
                }
                Ok(Answer::Pixels(_)) => {}
                Err(Stop::Device(failure)) => failures.push((device, failure)),
                Err(Stop::Aborted) => is_whole = false,
            }
        }
        if !failures.is_empty() {
            return Ok(failures);
        }
        if !is_whole {
            return Err(ExecError::Stuck);
        }
        self.complete(frame, begin_ms, end_ms, images);
        Ok(failures)
    }

    fn complete(
        &mut self,
        frame: &mut InFlight,
        begin_ms: f64,
        end_ms: f64,
        mut images: HashMap<PhysicalImage, Pixels>,
    ) {
        let report = &mut frame.report;
        if report.overlapped && frame.attempts == 1 {
            report.begin_ms = begin_ms;
        }
        report.makespan_ms = end_ms - report.begin_ms;
        report.interval_ms = self.whole.as_ref().map(|w| end_ms - w.end_ms);
        if let Some(tallies) = images.remove(&PhysicalImage::RowTally) {
            report.row_tallies = tallies.map(|bytes| bytemuck::pod_collect_to_vec(&bytes));
            report.tallies = report.row_tallies.each_ref().map(|rows| Tally::of(rows));
        }
        report.tasks.sort_by(|a, b| a.device.cmp(&b.device).then(a.begin_ms.total_cmp(&b.begin_ms)));
        let begun_ms = (!report.overlapped && frame.attempts == 1).then_some(report.begin_ms);
        let effort = frame.inputs.effort.clone();
        self.costs.learn(&FrameCosts { effort, ..costs::frame_costs(report, self.devices.len(), begun_ms) });
        if frame.attempts == 1 {
            let makespan_ms = report.makespan_ms;
            self.watchdog.learn(self.samples(&frame.inputs), makespan_ms);
        }
        self.recovered(frame.first_fault, frame.attempts);
        self.whole = Some(Whole { inputs: frame.inputs.clone(), primary: frame.primary, end_ms, images });
    }

    fn take_out(&mut self, frame: u32, failures: BTreeMap<usize, DeviceFailure>) -> Result<(), ExecError> {
        let _span = tracing::info_span!("take devices out", frame).entered();
        let noticed_ms = self.origin.elapsed().as_secs_f64() * 1e3;
        for (device, DeviceFailure { kind, what }) in failures {
            let left = self.crew.left();
            self.crew.take_out(device);
            if left.len() == 1 {
                return Err(ExecError::NoneLeft { device, what });
            }
            self.policy.remove_device(left.iter().filter(|d| **d < device).count());
            self.faults.push(Fault { frame, device, kind, what, attempts: 0, recovery_ms: 0.0, noticed_ms });
        }
        Ok(())
    }

    /// The frame that these faults, from the `first`th on, fell into is whole.
    fn recovered(&mut self, first: usize, attempts: u32) {
        let now_ms = self.origin.elapsed().as_secs_f64() * 1e3;
        for fault in self.faults[first..].iter_mut().filter(|f| f.attempts == 0) {
            (fault.attempts, fault.recovery_ms) = (attempts, now_ms - fault.noticed_ms);
        }
    }

    /// The device that held the images of the last whole frame has failed: others make it again.
    pub(super) fn make_again(&mut self, failure: DeviceFailure) -> Result<(), ExecError> {
        let Some(Whole { inputs, primary, .. }) = self.whole.take() else { return Err(ExecError::NoFrame) };
        let first_fault = self.faults.len();
        self.take_out(inputs.constants.index, [(primary, failure)].into())?;
        let begin_ms = self.origin.elapsed().as_secs_f64() * 1e3;
        self.hand_out(inputs, Some((first_fault, 2, begin_ms)));
        self.finish_last().map(drop)
    }

    fn constants(&self, rig: &Rig, time_s: f64, index: u32, samples: Range<u32>) -> layout::Frame {
        let extent = self.spec.extent;
        let aspect = f64::from(extent.width) / f64::from(extent.height);
        let rig = rig.relative_to(self.tables.origin());
        let spp = samples.end - samples.start;
        let mut frame = layout::Frame {
            views: Eye::ALL.map(|eye| layout::View::new(&rig.view(time_s, eye), aspect)),
            width: extent.width,
            height: extent.height,
            index,
            seed: self.settings.seed,
            spp,
            sample_base: samples.start,
            reflections: self.quality.bounces.max(1),
            layer_iterations: self.quality.iterations,
            indirect_clamp: self.settings.indirect_clamp,
            exposure: self.settings.exposure_ev.exp2(),
            history_rows: layout::NO_HISTORY,
            centre: self.settings.stages.centre(index, spp),
            sampled_share: (self.quality.scale * self.quality.scale) as f32,
            // Pixels that wait for a later frame have their turn in time.
            mask_turn: if self.settings.stages.keeps_history() { index.wrapping_mul(GOLDEN_RATIO) } else { 0 },
            ..Default::default()
        };
        self.tables.describe(&mut frame);
        if let Some(foveation) = &self.settings.stages.foveation {
            foveation.describe(&mut frame, time_s, self.quality.fovea);
        }
        frame
    }
}

/// Its fraction, of 2^32.
const GOLDEN_RATIO: u32 = 0x9e37_79b9;

/// [`layout::Frame::curve_shift`] for pixels that all take `spp` samples.
fn curve_shift(extent: Extent, spp: u32) -> u32 {
    let bits_for = |count: u32| u32::BITS - count.saturating_sub(1).leading_zeros();
    let shift = bits_for(spp);
    let numbers = 2 * bits_for(extent.width.max(extent.height)) + shift;
    if numbers > u32::BITS { layout::NO_CURVE } else { shift }
}
