//! Makes it happen: one worker thread per device carries out its tasks of the frame graph, rows cross through host
//! memory, and the whole images end up on the primary, the first device that is left. README.md beside this file has
//! the protocol.

mod costs;
mod crew;
mod faults;
mod messages;
mod staging;
mod watchdog;
mod worker;

pub use faults::{Fault, InjectedKind, Injection, Trouble};

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam::channel::{Receiver, Sender, unbounded};

use crate::device::{DeviceFailure, DeviceInfo, GpuDevice};
use crate::graph::{Assignment, FrameGraph, FrameSpec, PhysicalImage, Resource, Seam, Stage, Views, passes};
use crate::image::{Extent, Image, RgbImage};
use crate::scene::rig::{Eye, Rig};
use crate::schedule::{CostModel, Policy, simulate};
use crate::stages::{Aov, RowTally, SceneTables, StageError, StageSettings, layout};
use crew::Crew;
use messages::{Answer, FrameJob, Order, Parcel, Stop};
use watchdog::Watchdog;
use worker::Worker;

#[derive(Debug, thiserror::Error)]
pub enum ExecError {
    #[error("device {device} failed: {what}")]
    Device { device: usize, what: String },
    #[error("no device is left: the last one, device {device}, failed: {what}")]
    NoneLeft { device: usize, what: String },
    #[error("there is no frame to read yet")]
    NoFrame,
    #[error("the devices waited for one another until they gave up")]
    Stuck,
    #[error(transparent)]
    Stage(#[from] StageError),
    #[error("cannot start a worker thread")]
    Thread(#[from] std::io::Error),
}

/// What stays the same for all frames of a run.
#[derive(Clone, Debug)]
pub struct RenderSettings {
    pub stages: StageSettings,
    pub seam: Seam,
    pub seed: u32,
    /// Light reaches the eye through at most max(bounces, 1) reflections.
    pub bounces: u32,
    /// Upper bound of indirect radiance; 0: none.
    pub indirect_clamp: f32,
    pub exposure_ev: f32,
}

/// Time of one task on one device, milliseconds since the renderer's origin.
#[derive(Clone, Debug, serde::Serialize)]
pub struct TaskTiming {
    pub stage: &'static str,
    #[serde(skip)]
    pub kind: TimedTask,
    pub view: Eye,
    pub device: usize,
    pub rows: Range<u32>,
    pub begin_ms: f64,
    pub end_ms: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Number of the transfer within its frame; both of its ends have it.
    #[serde(skip)]
    pub transfer: Option<u32>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimedTask {
    /// On the device's own clock.
    Gpu(Stage),
    /// Rows taken from the device's memory to the host's.
    Download,
    /// Rows handed to the device.
    Upload,
}

/// What a frame took and found.
#[derive(Clone, Debug)]
pub struct FrameReport {
    pub index: u32,
    /// When the first task was handed out, milliseconds since the renderer's origin.
    pub begin_ms: f64,
    /// From there to the whole images on the primary.
    pub makespan_ms: f64,
    /// The makespan that the cost model foretold; none before it has learned from a frame.
    pub predicted_ms: Option<f64>,
    /// Host time to make stripes and graph, milliseconds.
    pub plan_ms: f64,
    pub tasks: Vec<TaskTiming>,
    /// Per eye, summed over rows.
    pub tallies: [Tally; 2],
    /// Per eye and row.
    pub row_tallies: [Vec<RowTally>; 2],
    pub assignment: Assignment,
}

impl FrameReport {
    /// Rows at which one device's part of the left eye's path tracing ends and the next one's begins.
    pub fn stripe_edges(&self) -> &[u32] {
        self.assignment.stripes(Stage::PathTrace, Eye::Left).inner_edges()
    }

    /// Bytes that crossed from device to device.
    pub fn uploaded_bytes(&self) -> u64 {
        self.tasks.iter().filter(|t| t.kind == TimedTask::Upload).filter_map(|t| t.bytes).sum()
    }
}

/// Totals of one view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    pub rays: u64,
    pub nonfinite: u64,
    /// By [`crate::stages::HoleReason`].
    pub holes: [u64; 6],
}

/// Both eyes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Stereo<T> {
    pub left: T,
    pub right: T,
}

/// Renders frames on a set of devices.
pub struct Renderer {
    settings: RenderSettings,
    spec: FrameSpec,
    tables: Arc<SceneTables>,
    policy: Box<dyn Policy>,
    costs: CostModel,
    devices: Vec<DeviceInfo>,
    crew: Crew,
    watchdog: Watchdog,
    trouble: Trouble,
    faults: Vec<Fault>,
    /// The graph that the last assignment gave.
    planned: Option<(Assignment, Arc<FrameGraph>)>,
    /// What the last frame was made of.
    last: Option<Inputs>,
    origin: Instant,
}

/// What a frame is made of.
#[derive(Clone, Copy)]
struct Inputs {
    constants: layout::Frame,
    /// The eyes of the frame before.
    previous: [layout::View; 2],
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
            iterations: settings.stages.iterations,
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
        // One after another: drivers have crashed on pipelines made concurrently.
        for (gpu, (_, inbox)) in gpus.into_iter().zip(parcels) {
            let worker =
                Worker::new(gpu, &settings.stages, &tables, &stages, inbox, outboxes.clone(), reply.clone(), origin)?;
            devices.push(worker.info().clone());
            workers.push(worker);
        }
        let crew = Crew::start(workers, replies, outboxes)?;
        let costs = CostModel::new(&spec);
        let (watchdog, trouble, faults) = (Watchdog::default(), Trouble::default(), Vec::new());
        let (planned, last) = (None, None);
        Ok(Self {
            settings,
            spec,
            tables,
            policy,
            costs,
            devices,
            crew,
            watchdog,
            trouble,
            faults,
            planned,
            last,
            origin,
        })
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
        let spp = self.settings.stages.spp;
        self.render_with(rig, time_s, index, 0..spp, curve_shift(self.spec.extent, spp))
    }

    /// [`Self::render`] with only these samples of sequences that each pixel has for itself, at most
    /// [`StageSettings::spp`] of them.
    pub fn render_samples(
        &mut self,
        rig: &Rig,
        time_s: f64,
        index: u32,
        samples: Range<u32>,
    ) -> Result<FrameReport, ExecError> {
        self.render_with(rig, time_s, index, samples, layout::NO_CURVE)
    }

    fn render_with(
        &mut self,
        rig: &Rig,
        time_s: f64,
        index: u32,
        samples: Range<u32>,
        curve_shift: u32,
    ) -> Result<FrameReport, ExecError> {
        let constants = layout::Frame { curve_shift, ..self.constants(rig, time_s, index, samples) };
        let previous = self.last.map_or(constants.views, |l| l.constants.views);
        let inputs = Inputs { constants, previous };
        self.last = Some(inputs);
        let faults = self.faults.len();
        let report = self.carry_out(&inputs, faults, 1)?;
        self.costs.learn(&costs::frame_costs(&report, self.devices.len()));
        if self.faults.len() == faults {
            self.watchdog.learn(self.samples(&inputs), report.makespan_ms);
        }
        Ok(report)
    }

    /// Makes a frame on the devices there are, again whenever one of them fails. The next attempt is the
    /// `first_attempt`th, and faults are its own from the `first_fault`th on.
    fn carry_out(&mut self, inputs: &Inputs, first_fault: usize, first_attempt: u32) -> Result<FrameReport, ExecError> {
        let index = inputs.constants.index;
        let _span = tracing::info_span!("frame", frame = index).entered();
        let begin = Instant::now();
        let mut attempts = first_attempt;
        loop {
            let planned = Instant::now();
            let (assignment, graph) = self.plan();
            let predicted = self.costs.has_learned().then(|| simulate(&graph, &self.costs).ok()).flatten();
            let mut report = FrameReport {
                index,
                begin_ms: begin.duration_since(self.origin).as_secs_f64() * 1e3,
                makespan_ms: 0.0,
                predicted_ms: predicted.map(|p| p.makespan_ms),
                plan_ms: planned.elapsed().as_secs_f64() * 1e3,
                tasks: Vec::new(),
                tallies: Default::default(),
                row_tallies: Default::default(),
                assignment,
            };
            let failures = self.collect(inputs, &graph, &mut report)?;
            if failures.is_empty() {
                self.recovered(first_fault, attempts);
                report.tasks.sort_by(|a, b| a.device.cmp(&b.device).then(a.begin_ms.total_cmp(&b.begin_ms)));
                return Ok(report);
            }
            self.take_out(index, failures)?;
            attempts += 1;
        }
    }

    /// Of both eyes of a frame, for the watchdog.
    fn samples(&self, inputs: &Inputs) -> u64 {
        2 * self.spec.extent.area() as u64 * u64::from(inputs.constants.spp.max(1))
    }

    /// Stripes and graph of the next frame; the graph is built anew only when a stripe has moved.
    fn plan(&mut self) -> (Assignment, Arc<FrameGraph>) {
        let left = self.crew.left();
        let model = if left.len() == self.devices.len() {
            Cow::Borrowed(&self.costs)
        } else {
            Cow::Owned(self.costs.of_devices(&left))
        };
        let assignment = self.policy.assign(&model).renumbered(&left, self.devices.len());
        let graph = match self.planned.take() {
            Some((old, graph)) if old == assignment => graph,
            _ => Arc::new(FrameGraph::build(&self.spec, &assignment)),
        };
        self.planned = Some((assignment.clone(), Arc::clone(&graph)));
        (assignment, graph)
    }

    /// Goes on without these devices.
    fn take_out(&mut self, frame: u32, failures: Vec<(usize, DeviceFailure)>) -> Result<(), ExecError> {
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
        for fault in &mut self.faults[first..] {
            (fault.attempts, fault.recovery_ms) = (attempts, now_ms - fault.noticed_ms);
        }
    }

    fn constants(&self, rig: &Rig, time_s: f64, index: u32, samples: Range<u32>) -> layout::Frame {
        let extent = self.spec.extent;
        let aspect = f64::from(extent.width) / f64::from(extent.height);
        let rig = rig.relative_to(self.tables.origin());
        let mut frame = layout::Frame {
            views: Eye::ALL.map(|eye| layout::View::new(&rig.view(time_s, eye), aspect)),
            width: extent.width,
            height: extent.height,
            index,
            seed: self.settings.seed,
            spp: samples.end - samples.start,
            sample_base: samples.start,
            reflections: self.settings.bounces.max(1),
            indirect_clamp: self.settings.indirect_clamp,
            exposure: self.settings.exposure_ev.exp2(),
            ..Default::default()
        };
        self.tables.describe(&mut frame);
        frame
    }

    /// Has every device do its part of a frame; returns those that failed.
    fn collect(
        &mut self,
        inputs: &Inputs,
        graph: &Arc<FrameGraph>,
        report: &mut FrameReport,
    ) -> Result<Vec<(usize, DeviceFailure)>, ExecError> {
        let Inputs { constants, previous } = *inputs;
        let mut orders = Vec::new();
        for device in self.crew.left() {
            let (runs, injected) = self.trouble.take(device, constants.index);
            let job = FrameJob { graph: Arc::clone(graph), constants, previous, runs, injected };
            orders.push((device, Order::Frame(Box::new(job))));
        }
        let (mut failures, mut is_whole) = (Vec::new(), true);
        for (device, answer) in self.crew.ask(orders, self.watchdog.limit(self.samples(inputs))) {
            match answer {
                Ok(Answer::Frame(reply)) => {
                    if let Some(rows) = reply.row_tallies {
                        report.makespan_ms = reply.end_ms - report.begin_ms;
                        report.tallies = rows.each_ref().map(|r| total(r));
                        report.row_tallies = rows;
                    }
                    report.tasks.extend(reply.tasks);
                }
                Ok(Answer::Pixels(_)) => {}
                Err(Stop::Device(failure)) => failures.push((device, failure)),
                Err(Stop::Aborted) => is_whole = false,
            }
        }
        if failures.is_empty() && !is_whole { Err(ExecError::Stuck) } else { Ok(failures) }
    }

    /// An image of the last frame from the primary, raw, both eyes. If the primary fails, others make the frame again.
    fn read(&mut self, image: PhysicalImage) -> Result<Stereo<Vec<u8>>, ExecError> {
        loop {
            let (Some(inputs), Some((_, graph))) = (self.last, &self.planned) else { return Err(ExecError::NoFrame) };
            let primary = graph.primary;
            let limit = self.watchdog.limit(self.samples(&inputs));
            let (_, injected) = self.trouble.take(primary, inputs.constants.index);
            match self.crew.ask(vec![(primary, Order::Read(image, injected))], limit).pop() {
                Some((_, Ok(Answer::Pixels([left, right])))) => return Ok(Stereo { left, right }),
                Some((device, Err(Stop::Device(failure)))) => {
                    let first_fault = self.faults.len();
                    self.take_out(inputs.constants.index, vec![(device, failure)])?;
                    self.carry_out(&inputs, first_fault, 2)?;
                }
                _ => return Err(ExecError::Stuck),
            }
        }
    }

    /// The last frame, scene-referred.
    pub fn read_linear(&mut self) -> Result<Stereo<RgbImage>, ExecError> {
        let raw = self.read(PhysicalImage::Linear)?;
        let image = |bytes: &[u8]| {
            let pixels = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(bytes);
            Image { extent: self.spec.extent, pixels: pixels.iter().map(|p| [p[0], p[1], p[2]]).collect() }
        };
        Ok(Stereo { left: image(&raw.left), right: image(&raw.right) })
    }

    /// The last frame, tonemapped and encoded on the devices.
    pub fn read_display(&mut self) -> Result<Stereo<Image<[u8; 4]>>, ExecError> {
        let raw = self.read(PhysicalImage::Display)?;
        let image = |bytes: &[u8]| Image { extent: self.spec.extent, pixels: bytemuck::pod_collect_to_vec(bytes) };
        Ok(Stereo { left: image(&raw.left), right: image(&raw.right) })
    }

    /// The i-th auxiliary image, as many channels as [`Aov::channels`] names.
    pub fn read_aov(&mut self, i: usize) -> Result<Stereo<Vec<Vec<f32>>>, ExecError> {
        let raw = self.read(PhysicalImage::Aov(i as u8))?;
        let aov: Aov = self.settings.stages.aovs[i];
        let channels = |bytes: &[u8]| {
            let pixels = bytemuck::pod_collect_to_vec::<u8, [f32; 4]>(bytes);
            (0..aov.channels().len()).map(|c| pixels.iter().map(|p| p[c]).collect()).collect()
        };
        Ok(Stereo { left: channels(&raw.left), right: channels(&raw.right) })
    }
}

/// [`layout::Frame::curve_shift`] for pixels that all take `spp` samples.
fn curve_shift(extent: Extent, spp: u32) -> u32 {
    let bits_for = |count: u32| u32::BITS - count.saturating_sub(1).leading_zeros();
    let shift = bits_for(spp);
    let numbers = 2 * bits_for(extent.width.max(extent.height)) + shift;
    if numbers > u32::BITS { layout::NO_CURVE } else { shift }
}

/// Sums the primary's row tallies.
fn total(rows: &[RowTally]) -> Tally {
    let mut sum = Tally::default();
    for row in rows {
        sum.rays += u64::from(row.rays);
        sum.nonfinite += u64::from(row.nonfinite);
        for (s, h) in sum.holes.iter_mut().zip(row.holes) {
            *s += u64::from(h);
        }
    }
    sum
}

/// Name of a resource in reports.
fn resource_name(resource: Resource) -> &'static str {
    match resource {
        Resource::Hit => "hit",
        Resource::Guide => "guide",
        Resource::Albedo => "albedo",
        Resource::Emission => "emission",
        Resource::Radiance => "radiance",
        Resource::Filtered(_) => "filtered",
        Resource::Tally => "tally",
        Resource::Holes => "holes",
        Resource::RowTally => "row_tally",
        Resource::Linear => "linear",
        Resource::Display => "display",
        Resource::Aov(_) => "aov",
    }
}
