//! The control loop: chooses the quality of a frame, renders it, records its times and reports it.

use std::cell::Cell;
use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::report::play::{ControlRow, DeadlineRow, Play, SizeFit};
use crate::report::record::{FrameRecord, SpooledRows};
use crate::report::rectified::RectifiedFrame;
use crate::report::run::{FrameRow, RunReport};
use diptych::control::{Decision, ESTIMATES_EV, Ladder, Measure, Origin};
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, Renderer};
use diptych::frame::Disturbance;
use diptych::loaded::LoadedScene;
use diptych::quality::{Denoiser, FrameQuality, Quality};
use diptych::scene::rig::Rig;
use diptych::session::{self, Decided, View, calibrate};
use diptych::trace::deadline::{Deadline, Presented, Surroundings};
use diptych::trace::frames::{FrameControl, record_devices};
use diptych::trace::late::LateCauses;

use super::fitting_size;
use super::heartbeat::Heartbeat;
use super::prepared::Prepared;
use super::status_lines::StatusLines;
use crate::failure::Failure;
use crate::faults::FaultLog;
use crate::others::RecentOthers;
use crate::progress::Progress;
use crate::setup::Tracing;
use crate::{interrupt, settings};

/// A session with its trace, its progress output and its fault messages.
pub struct Session {
    pub inner: session::Session,
    pub tracing: Tracing,
    pub progress: Progress,
    /// Result of the search for a smaller size; `None` if the requested size fits.
    pub fit: Option<SizeFit>,
    /// Time that creating the renderer and determining the quality ladder took, seconds.
    pub warm_up_s: f64,
    live: StatusLines,
    faults: FaultLog,
    causes: LateCauses,
    heartbeat: Heartbeat,
    others: RecentOthers,
    disturb: Vec<Disturbance>,
}

impl Deref for Session {
    type Target = session::Session;

    fn deref(&self) -> &session::Session {
        &self.inner
    }
}

impl DerefMut for Session {
    fn deref_mut(&mut self) -> &mut session::Session {
        &mut self.inner
    }
}

impl Session {
    /// Creates the renderer on these devices and determines its quality ladder. Renders at a smaller size if the
    /// requested one does not fit the budget and [`Prepared::fits_size`] allows it.
    pub fn start(
        prepared: &mut Prepared,
        loaded: &LoadedScene,
        gpus: Devices,
        tracing: Tracing,
        progress: Progress,
    ) -> Result<Self, Failure> {
        progress.phase("warming up");
        let begin = Instant::now();
        let (mut renderer, fit) = fitting_size::start(prepared, loaded, gpus, &tracing, &progress)?;
        record_devices(&tracing.recorder, renderer.devices());
        let ladder = find_ladder(prepared, loaded, &mut renderer, &progress)?;
        let Prepared { options, choice, render, .. } = prepared;
        let denoiser = Denoiser::name_of(choice.denoiser);
        let qualities = ladder.rungs().iter().map(|rung| options.run.settings.limit(&rung.quality)).collect();
        let mut inner = session::Session::with_qualities(renderer, ladder, qualities, options.budget_ms);
        inner.set_controller(render.settings.controller[0].start(inner.ladder(), options.budget_ms));
        let (devices, rungs) = (inner.renderer.devices(), inner.ladder().rungs().len());
        let live = StatusLines::new(options.budget_ms, devices, denoiser, rungs, prepared.frames);
        Ok(Self {
            fit,
            warm_up_s: begin.elapsed().as_secs_f64(),
            live,
            // The session tightens the watchdog to the budget. Create it last, since calibration frames may take any
            // time.
            inner,
            tracing,
            progress,
            faults: FaultLog::default(),
            causes: LateCauses::default(),
            heartbeat: Heartbeat::start(),
            others: RecentOthers::default(),
            disturb: prepared.render.settings.disturb.clone(),
        })
    }

    /// Returns the gaze of the left and the right eye at `time_s`; `None` without foveation.
    pub fn gaze(&self, time_s: f64) -> Option<[[f64; 2]; 2]> {
        let config = self.renderer.config();
        let is_foveated = config.foveation().is_some() || config.envelope.most.polar.is_some();
        is_foveated.then(|| self.inner.gaze.unwrap_or_else(|| config.gaze_at(time_s)))
    }

    /// Returns the radii of a frame's foveal layers, if it has any.
    #[cfg(feature = "view")]
    pub fn fovea(&self, decided: Decided) -> Option<[f64; 2]> {
        self.quality(decided.decision.rung).fovea
    }

    /// Renders a frame as decided, `late_ms` after it was due; returns its row, without missed display periods, and its
    /// report.
    pub fn render(
        &mut self,
        decided: Decided,
        late_ms: f64,
        rig: &Rig,
        time_s: f64,
        index: u32,
    ) -> Result<(FrameRow, FrameReport), Failure> {
        let frame = self.inner.render(decided, rig, time_s, index)?;
        let mut row = FrameRow::new(&frame, self.quality(decided.decision.rung), rig, time_s);
        row.control = Some(ControlRow::new(decided, self.budget(), frame.makespan_ms, late_ms));
        Ok((row, frame))
    }

    /// Adds the deadline of a rendered frame to its row, with the cause if it was missed, and records the frame in the
    /// trace. Call this once the frame is complete, so that neither counts as its time.
    pub fn complete(&mut self, row: &mut FrameRow, frame: &FrameReport, decided: Decided, deadline: Option<Deadline>) {
        let Decision { rung, expected_ms, fits } = decided.decision;
        let mut control = FrameControl { rung, budget_ms: self.budget_ms(), expected_ms, fits, shown: None };
        if let Some(deadline) = deadline {
            row.miss(deadline.missed_periods);
            let around = self.surroundings(frame.index, &deadline);
            let cause = self.causes.cause(frame, &deadline, &control, &around);
            let shown = control.shown.insert(Presented { deadline, cause, around });
            row.deadline = Some(DeadlineRow::new(frame, shown));
        }
        self.tracing.record(self.quality(rung), Some(&control), frame);
    }

    fn surroundings(&mut self, index: u32, deadline: &Deadline) -> Surroundings {
        let at = |ms: f64| self.tracing.recorder.origin() + Duration::from_secs_f64(ms.max(0.0) / 1e3);
        let paused_ms = self.heartbeat.paused_ms(at(deadline.refresh_ms), at(deadline.complete_ms));
        Surroundings { event: self.event(index), others: self.others.share(), paused_ms }
    }

    /// Describes the disturbance or the fault of a frame, if there is one.
    fn event(&self, index: u32) -> Option<String> {
        let fault = self.renderer.faults().iter().find(|fault| fault.frame == index);
        let dropped = fault.map(|fault| format!("device {} dropped: {}", fault.device, fault.kind.name()));
        dropped.or_else(|| self.disturb.iter().find(|disturbance| disturbance.is_at(index)).map(ToString::to_string))
    }

    /// Creates the record of the session's frames, whose files are in `folder`.
    pub fn record(&self, folder: &Path) -> Result<FrameRecord, Failure> {
        Ok(FrameRecord::create(folder, self.renderer.devices().len(), self.budget_ms())?)
    }

    fn budget_ms(&self) -> [f64; 2] {
        let budget = self.budget();
        [budget.lo_ms(), budget.hi_ms()]
    }

    /// Returns the contents of run.json.
    pub fn report<'a>(
        &self,
        prepared: &Prepared,
        loaded: &LoadedScene,
        record: &'a FrameRecord,
    ) -> RunReport<&'a SpooledRows> {
        let Prepared { options, choice, render, .. } = prepared;
        let devices = self.renderer.devices();
        let budget_ms = self.budget_ms();
        let mut settings = settings::in_force(render, loaded.exposure_ev(), devices);
        // The budget may come from the headset rather than from the option.
        settings.options.insert("budget_ms".to_owned(), format!("{}..{}", budget_ms[0], budget_ms[1]).into());
        let rows = record.rows();
        let mut report =
            RunReport::new(settings, devices, &loaded.scene, loaded.needs, render.settings.skip_unused, rows);
        report.warm_up_s = self.warm_up_s;
        report.faults = self.renderer.faults().to_vec();
        report.rectified = self.renderer.rectified().map(|frame| RectifiedFrame::new(frame, render.settings.size));
        let play = Play {
            denoiser: Denoiser::name_of(choice.denoiser),
            ladder: options.ladder_name(self.ladder()),
            measure: self.ladder().origin().measure,
            rungs: self.ladder().rungs().to_vec(),
            fps: render.fps,
            fit: self.fit.clone(),
        };
        report.play = record.play.summary(&play);
        report
    }

    /// Announces a frame on the terminal or as a JSON line. Call it after recording the frame's row.
    pub fn announce(&mut self, row: &FrameRow, frame: &FrameReport) {
        let Some(ControlRow { rung, expected_ms, fits, in_band, late_ms, .. }) = row.control else { return };
        let FrameQuality { spp, bounces, iterations, scale, fovea } = row.quality;
        self.progress.event(|| {
            serde_json::json!({
                "event": "frame", "index": row.index, "rung": rung, "spp": spp.least, "extra": spp.fraction(), "bounces": bounces,
                "iterations": iterations, "scale": scale, "fovea": fovea, "predicted_ms": row.predicted_ms, "expected_ms": expected_ms,
                "fits": fits, "makespan_ms": row.makespan_ms, "in_band": in_band, "late_ms": late_ms,
            })
        });
        self.live.observe(row, &frame.busy_ms(), &self.progress);
        self.faults.say_new(&self.inner.renderer, &self.tracing, &self.progress);
    }
}

/// Name of the calibration in messages, and the number of its frames, unless they take long.
const TIMING: &str = "timing settings";
const CALIBRATION_FRAMES: f64 = 33.0;

fn find_ladder(
    prepared: &Prepared,
    loaded: &LoadedScene,
    renderer: &mut Renderer,
    progress: &Progress,
) -> Result<Ladder, Failure> {
    let Prepared { options, choice, render, .. } = prepared;
    if let Some(ladder) = &choice.ladder {
        return Ok(ladder.clone());
    }
    progress.phase(TIMING);
    let origin = Origin {
        shot: render.shot.clone(),
        size: render.settings.size.to_string(),
        exposure_ev: ESTIMATES_EV,
        measure: Measure::Estimate,
        devices: Vec::new(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let view = View { rig: &loaded.shot.rig, time_s: render.settings.time };
    let limit = |quality: &Quality| options.run.settings.limit(quality);
    let begun = Cell::new(0);
    let stop = || {
        progress.phase_part(TIMING, (f64::from(begun.get()) / CALIBRATION_FRAMES).min(0.99));
        begun.set(begun.get() + 1);
        interrupt::is_set()
    };
    Ok(calibrate(renderer, &view, &choice.qualities, &limit, origin, &stop)?)
}
