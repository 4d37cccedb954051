//! The public interface of execution: plans frames, distributes them to the devices, and finishes them.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::frames::{Attempt, Finished, Frames};
use super::inputs::Inputs;
use super::late_latching::PoseSource;
use super::output::Output;
use super::plan::{History, Plan};
use super::planner::{Graphs, Planner};
use super::ranks::Devices;
use super::stopping::StopFlag;
use super::watch::{WATCHED_DISPATCH_MS, Watch};
use super::worker_pool::WorkerPool;
use super::{ExecError, Fault, FrameParams, FrameReport, InjectedFaults, costs};
use crate::device::{DeviceInfo, Traversal};
use crate::frame::RunConfig;
use crate::frame::constants::constants;
use crate::graph::{Assignment, FrameGraph, Resource};
use crate::image::Extent;
use crate::layout;
use crate::samples::PixelSamples;
use crate::scene::rig::Rig;
use crate::schedule::{CostModel, FrameCosts, Policy, RelativeCost, simulate, splits};
use crate::stages::{Place, StageError};
use crate::tables::SceneTables;

/// Renders frames on a set of devices.
pub struct Renderer {
    pub(super) config: RunConfig,
    pub(super) tables: Arc<SceneTables>,
    devices: Vec<DeviceInfo>,
    /// Maximum predicted time of a submission in milliseconds, by device; `None` if it is not bounded.
    max_dispatch_ms: Vec<Option<f64>>,
    pub(super) costs: CostModel,
    pub(super) planner: Planner,
    /// The latest plan and its graph.
    pub(super) planned: Option<(Plan, Arc<FrameGraph>)>,
    pub(super) frames: Frames,
    /// Constants of the last frame that was begun, its views, and its time in the scene, in seconds.
    last: Option<(layout::Previous, Vec<layout::View>, f64)>,
    /// Images that frames gather on the primary; `None` gathers all outputs.
    outputs: Option<Vec<Output>>,
    pub(super) pose_source: Option<Arc<PoseSource>>,
    begun: u64,
    /// True if the next frame must not use the history.
    begins_anew: bool,
}

impl Renderer {
    /// Starts a worker per device and warms up every pipeline. Times in reports count from `origin`.
    ///
    /// # Errors
    /// [`ExecError`] if a setting is invalid, devices have different traversals, a device fails at once, has too little
    /// memory or cannot compile a stage, a thread cannot be started, or another rank cannot take part.
    pub fn new(
        devices: impl Into<Devices>,
        tables: Arc<SceneTables>,
        config: RunConfig,
        policy: Box<dyn Policy>,
        origin: Instant,
    ) -> Result<Self, ExecError> {
        Self::start(devices.into(), tables, config, policy, origin, StopFlag::default())
    }

    /// Does what [`Self::new`] does, unless `stop` ends it.
    pub(super) fn start(
        devices: Devices,
        tables: Arc<SceneTables>,
        mut config: RunConfig,
        policy: Box<dyn Policy>,
        origin: Instant,
        stop: StopFlag,
    ) -> Result<Self, ExecError> {
        config.check()?;
        let infos = devices.infos();
        if infos.iter().any(|info| info.traversal != infos[0].traversal) {
            return Err(ExecError::MixedTraversal);
        }
        if let Some(moving) = &mut config.buffers.moving {
            moving.hardware = infos.iter().any(|info| info.traversal == Traversal::Hardware);
        }
        let frames_in_flight = config.execution.frames_in_flight;
        let graphs = Graphs::of_config(&config, devices.len(), tables.has_surfaces());
        let graphs = Arc::new(graphs.map_err(StageError::Program)?);
        let program = graphs.planned_program(config.execution.seam, config.quality().most_iterations());
        let costs = CostModel::new(&program, devices.len());
        let planner = Planner::new(policy, &config, devices.len(), Arc::clone(&graphs));
        let bounds_ms = devices.max_dispatch_ms().into_iter();
        let max_dispatch_ms = bounds_ms.map(|bound_ms| config.execution.max_dispatch_ms.or(bound_ms)).collect();
        let (workers, devices) = WorkerPool::start(devices, &config, &tables, &graphs, origin, &stop)?;
        Ok(Self {
            config,
            tables,
            devices,
            max_dispatch_ms,
            costs,
            planner,
            planned: None,
            frames: Frames::new(workers, frames_in_flight, origin, stop),
            last: None,
            outputs: None,
            pose_source: None,
            begun: 0,
            begins_anew: false,
        })
    }

    /// Returns the devices that have not failed, for use by another renderer. They keep their compiled pipelines, so
    /// that the other renderer need not compile these again.
    pub fn into_devices(self) -> Devices {
        self.frames.into_workers().end()
    }

    /// Sets the time without a sign of life after which a device is dropped. By default, this limit follows from the
    /// times of frames.
    pub fn set_watchdog(&mut self, limit: Duration) {
        self.frames.limits.fixed = Some(limit);
    }

    /// Sets the frame budget in milliseconds and makes the run interactive: devices that hang are dropped sooner. If
    /// budget and frame times are at most 0.1 s, a hang delays a frame by at most 1 s. In a batch run (without a
    /// budget), a device that hangs is dropped after 10 s at the earliest. The limit of [`Self::set_watchdog`]
    /// overrides both.
    pub fn set_budget(&mut self, budget_ms: f64) {
        self.frames.limits.budget_ms = Some(budget_ms);
    }

    /// Sets the faults to inject from now on.
    pub fn set_injected_faults(&mut self, injected: InjectedFaults) {
        self.frames.injected = injected;
    }

    /// Sets the images that frames begun from now on gather on the primary, in addition to the `reads` of
    /// [`Self::begin`]. Other images need not be transferred between devices.
    pub fn set_outputs(&mut self, images: &[Resource]) {
        self.outputs = Some(images.iter().map(|image| Output::from(*image)).collect());
    }

    /// Discards the temporal history, so that the next frame does not use earlier frames.
    pub fn begin_anew(&mut self) {
        self.begins_anew = true;
    }

    /// Returns the configuration of all frames.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// Returns the extent of the rectified images, if the displayed images are resampled from such.
    pub fn rectified(&self) -> Option<Extent> {
        self.config.chain().projection()
    }

    /// Returns the faults of the dropped devices, in order.
    pub fn faults(&self) -> &[Fault] {
        &self.frames.faults
    }

    /// Returns all devices of the run, including those dropped since.
    pub fn devices(&self) -> &[DeviceInfo] {
        &self.devices
    }

    /// Returns the cost model, which learns from every frame.
    pub fn costs(&self) -> &CostModel {
        &self.costs
    }

    pub fn policy_name(&self) -> &'static str {
        self.planner.policy_name()
    }

    /// Returns the parameters of a frame from the camera `rig` at the scene time `time_s`, in seconds. Quality, seed
    /// and exposure are those of the configuration. `index` is the frame number, which keys the random numbers.
    pub fn frame(&self, rig: &Rig, time_s: f64, index: u32) -> FrameParams {
        let (rig, quality) = (rig.clone(), self.config.quality());
        let RunConfig { seed, exposure_ev, .. } = self.config;
        let gaze = self.config.gaze_at(time_s);
        let relative_cost = RelativeCost::default();
        FrameParams { rig, time_s, index, seed, quality, gaze, shown_from: None, exposure_ev, relative_cost }
    }

    /// Checks whether a frame can have these parameters.
    ///
    /// # Errors
    /// [`ExecError::Setting`] if the frame's quality is invalid or outside the [`RunConfig::envelope`], see
    /// [`crate::quality::Envelope::check`].
    pub fn check(&self, params: &FrameParams) -> Result<(), ExecError> {
        Ok(self.config.envelope.check(&params.quality)?)
    }

    /// Renders a frame.
    ///
    /// # Errors
    /// Errors of [`Self::check`] and [`Self::finish`].
    pub fn render(&mut self, params: &FrameParams) -> Result<FrameReport, ExecError> {
        self.begin(params, &[])?;
        self.finish_last(&mut |_| {})
    }

    /// Begins a frame like [`Self::render`], but does not wait for it; [`Self::finish`] waits for frames in the order
    /// in which they were begun. If [`crate::frame::Execution::frames_in_flight`] frames are in flight, first finishes
    /// the oldest and discards its report. `reads` are the images of this frame that can be read while later frames are
    /// in flight.
    ///
    /// # Errors
    /// Errors of [`Self::check`], and of [`Self::finish`] if the oldest frame is finished first.
    pub fn begin(&mut self, params: &FrameParams, reads: &[Resource]) -> Result<(), ExecError> {
        self.check(params)?;
        let centres_one = self.config.envelope.centres_one();
        self.begin_with(params, params.quality.spp.shared(self.config.grid(), centres_one), reads, None)
    }

    pub(super) fn begin_with(
        &mut self,
        params: &FrameParams,
        samples: PixelSamples,
        reads: &[Resource],
        watch: Option<Arc<Watch>>,
    ) -> Result<(), ExecError> {
        let FrameParams { time_s, quality, ref relative_cost, .. } = *params;
        let (mut constants, views) = constants(&self.config, params, &self.tables, samples);
        if self.frames.is_full() {
            self.finish()?;
        }
        let last = self.last.take();
        let (previous, before, last_s) = last.unwrap_or_else(|| ((&constants).into(), views.clone(), time_s));
        let (update, moved) = self.tables.update(&mut constants, time_s, last_s);
        let place = Place::of(self.begun, self.config.execution.frames_in_flight);
        self.begun += 1;
        let reads: Arc<[Output]> = reads.iter().map(|image| Output::from(*image)).collect();
        let relative_cost = relative_cost.clone();
        let outputs = self.outputs.as_ref().map(|outputs| outputs.iter().chain(&*reads).cloned().collect());
        let late = self.late(params);
        let both = views.iter().zip(before).map(|(now, before)| [*now, before]).collect();
        self.last = Some(((&constants).into(), views, time_s));
        let inputs = Inputs {
            constants,
            quality,
            relative_cost,
            previous,
            views: both,
            update,
            moved,
            place,
            reads,
            outputs,
            late,
            watch,
        };
        self.dispatch_frame(inputs, None);
        Ok(())
    }

    pub(super) fn finish_last(&mut self, progress: &mut dyn FnMut(f64)) -> Result<FrameReport, ExecError> {
        let mut report = None;
        while let Some(finished) = self.finish_with(progress)? {
            report = Some(finished);
        }
        report.ok_or(ExecError::NoFrame)
    }

    /// Returns the number of frames in flight.
    pub fn in_flight(&self) -> usize {
        self.frames.in_flight()
    }

    /// Waits for the oldest frame in flight; returns `None` if there is none. When a device fails, all frames in flight
    /// are begun again on the others.
    ///
    /// # Errors
    /// [`ExecError::NoneLeft`] if the last device failed, [`ExecError::Stuck`] if devices waited for one another until
    /// they gave up, [`ExecError::Stopped`] if [`super::Builder::stop`] says so, [`ExecError::Rank`] if a rank is lost.
    pub fn finish(&mut self) -> Result<Option<FrameReport>, ExecError> {
        self.finish_with(&mut |_| {})
    }

    fn finish_with(&mut self, progress: &mut dyn FnMut(f64)) -> Result<Option<FrameReport>, ExecError> {
        while let Some(index) = self.frames.oldest() {
            let _span = tracing::info_span!("finish frame", frame = index).entered();
            match self.frames.finish(progress)? {
                Some(Finished::Complete(report, attempt)) => {
                    self.learn(&report, attempt);
                    return Ok(Some(*report));
                }
                Some(Finished::Failed { failures, frames }) => {
                    self.drop_device(index, failures)?;
                    self.restart(frames);
                }
                None => {}
            }
        }
        Ok(None)
    }

    /// Learns from the frame that was completed last.
    fn learn(&mut self, report: &FrameReport, attempt: u32) {
        for &(device, residual_us) in &report.clock_residuals_us {
            let known = &mut self.devices[device].clock_residual_us;
            *known = known.max(residual_us);
        }
        let begun_ms = (!report.overlapped && attempt == 1).then_some(report.begin_ms);
        let whole = self.frames.whole.as_ref();
        let relative_cost = whole.map(|whole| whole.inputs.relative_cost.clone()).unwrap_or_default();
        self.costs.network = self.frames.network();
        self.costs.learn(&FrameCosts { relative_cost, ..costs::frame_costs(report, self.devices.len(), begun_ms) });
    }

    /// Plans a frame and sends every device its part. `again` describes the new attempt if the frame was begun before,
    /// and is `None` for its first attempt.
    pub(super) fn dispatch_frame(&mut self, mut inputs: Inputs, again: Option<Attempt>) {
        let index = inputs.constants.sampling.index;
        let _span = tracing::info_span!("begin frame", frame = index).entered();
        let now_ms = self.frames.now_ms();
        let attempt = again.unwrap_or_else(|| self.frames.first_attempt(now_ms));
        let overlapped = self.frames.in_flight() > 0;
        let left = self.frames.devices_left();
        // Only devices of this rank have the pose source.
        inputs.late =
            inputs.late.filter(|_| left.first().is_some_and(|&primary| self.devices[primary].is_on_first_rank()));
        let planned = self.planned.take().map(|(plan, _)| plan);
        let before = match again {
            None => {
                let begins_anew = std::mem::take(&mut self.begins_anew);
                planned.map(|plan| plan.assignment).filter(|_| !begins_anew)
            }
            // Frames begun after this one may have overwritten its history.
            Some(_) if self.config.execution.frames_in_flight > 1 => None,
            Some(_) => planned.and_then(|plan| plan.history).map(|history| history.before),
        };
        // Without a device that computed a part of the previous frame, nothing of its history is left.
        let is_left = |before: &Assignment| left.iter().any(|&device| before.works()[device]);
        let history = before.filter(is_left).and_then(|before| {
            let lost = (0..before.devices()).filter(|device| !left.contains(device)).collect();
            Some(History { before, rows: inputs.history_rows(&self.config, &self.tables)?, lost })
        });
        let (plan, graph) = self.planner.plan(&mut self.costs, &inputs, &left, history);
        let lost = plan.history.as_ref().map_or(0..0, |history| history.lost_rows(&graph.program));
        inputs.constants.history = layout::History::new(plan.history.as_ref().map(|history| history.rows), lost);
        let report = FrameReport {
            index,
            begin_ms: attempt.begin_ms,
            makespan_ms: 0.0,
            interval_ms: None,
            slot: inputs.place.slot,
            overlapped,
            predicted_ms: None,
            plan_ms: self.frames.now_ms() - now_ms,
            tasks: Vec::new(),
            clock_residuals_us: Vec::new(),
            tallies: Default::default(),
            pixels: inputs.pixels(&self.config),
            row_tallies: Default::default(),
            bodies_left_out: inputs.update.left_out,
            devices: left,
            ranks: self.devices.iter().filter_map(|d| Some(d.rank.as_ref()?.number)).collect(),
            assignment: plan.assignment.clone(),
            spec: self.planner.spec(&plan),
            program: Arc::clone(&graph.program),
            pixel_centre: inputs.constants.camera.centre.to_array(),
            shown_from: None,
            spp_done: None,
        };
        let (samples, is_watched) = (inputs.constants.sampling.samples, inputs.watch.is_some());
        let splits = |device: usize| {
            let bound_ms = self.max_dispatch_ms[device].or(is_watched.then_some(WATCHED_DISPATCH_MS));
            let bounded = bound_ms.map(|ms| splits(&graph, &self.costs, device, ms, samples)).unwrap_or_default();
            if is_watched { bounded.probing_all(&graph, device) } else { bounded }
        };
        self.frames.dispatch_frame(inputs, (&plan, Arc::clone(&graph)), splits, report, attempt);
        // The prediction runs while the devices are busy.
        if self.costs.has_learned() {
            self.frames.predict_last(simulate(&graph, &self.costs));
        }
        self.planned = Some((plan, graph));
    }
}
