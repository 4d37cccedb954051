//! The control loop: decide what a frame is rendered with, render it, take in what it took, tell whoever listens.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::Path;
use std::time::Instant;

use diptych::control::{Budget, Controller, Decision, ESTIMATES_EV, Ladder, Measure, Origin};
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, Renderer};
use diptych::quality::{Denoiser, FrameQuality, Quality};
use diptych::report::play::{ControlRow, Play, SizeFit};
use diptych::report::record::{FrameRecord, SpooledRows};
use diptych::report::rectified::RectifiedFrame;
use diptych::report::run::{FrameRow, RunReport};
use diptych::scene::rig::Rig;
use diptych::schedule::Effort;
use diptych::trace::frames::{FrameControl, record_devices};

use super::Failure;
use super::fit;
use super::ladder::{Calibration, qualities};
use super::live::Live;
use super::options::Prepared;
use crate::cli::faults::FaultLog;
use crate::cli::progress::Progress;
use crate::cli::settings;
use crate::cli::setup::{Loaded, Tracing};

pub struct Session {
    pub renderer: Renderer,
    pub ladder: Ladder,
    pub tracing: Tracing,
    pub progress: Progress,
    /// Where no rung fits the size that was asked for.
    pub fit: Option<SizeFit>,
    /// How long it took until the first frame could begin.
    pub warm_up_s: f64,
    qualities: Vec<(Quality, Effort)>,
    controller: Controller,
    budget: Budget,
    live: Live,
    faults: FaultLog,
    /// Devices that were taken out.
    lost: usize,
}

/// What the next frame is to be, and how long it took to choose that.
#[derive(Clone, Copy)]
pub struct Decided {
    decision: Decision,
    decide_ms: f64,
}

impl Session {
    /// Makes the renderer on these devices, of a smaller size where that is wanted and needed, and finds its ladder.
    pub fn start(
        prepared: &mut Prepared,
        loaded: &Loaded,
        gpus: Devices,
        tracing: Tracing,
        progress: Progress,
    ) -> Result<Self, Failure> {
        progress.phase("warming up");
        let begin = Instant::now();
        let (mut renderer, fit) = fit::start(prepared, loaded, gpus, &tracing, &progress)?;
        record_devices(&tracing.recorder, renderer.devices());
        let ladder = find_ladder(prepared, loaded, &mut renderer, &progress)?;
        let Prepared { options, choice, .. } = prepared;
        // Timing settings takes frames of any length; the frames that count begin here.
        renderer.set_budget(options.budget_ms.hi_ms());
        let denoiser = Denoiser::name_of(choice.denoiser);
        Ok(Self {
            fit,
            warm_up_s: begin.elapsed().as_secs_f64(),
            qualities: qualities(&ladder, &options.foveated),
            controller: Controller::new(&ladder, options.budget_ms),
            live: Live::new(options.budget_ms, renderer.devices(), denoiser, ladder.rungs().len(), prepared.frames),
            budget: options.budget_ms,
            lost: renderer.faults().len(),
            renderer,
            ladder,
            tracing,
            progress,
            faults: FaultLog::default(),
        })
    }

    /// The rung of the next frame.
    pub fn decide(&mut self) -> Decided {
        let begin = Instant::now();
        let Self { renderer, qualities, controller, .. } = self;
        let known = RefCell::new(HashMap::new());
        let predict = |rung: usize| -> f64 {
            let (quality, effort) = &qualities[rung];
            let predicted = || renderer.predicted_ms(quality, effort).unwrap_or(f64::NAN);
            *known.borrow_mut().entry(rung).or_insert_with(predicted)
        };
        let decision = controller.next(&predict);
        Decided { decision, decide_ms: begin.elapsed().as_secs_f64() * 1e3 }
    }

    /// Where the left and the right eye look in the frame of that time, if that matters.
    pub fn gaze(&self, time_s: f64) -> Option<[[f64; 2]; 2]> {
        let of_layers = self.renderer.foveation().map(|layers| &layers.gaze);
        let of_polar = self.renderer.polar().map(|polar| &polar.gaze);
        of_layers.or(of_polar).map(|eyes| eyes.each_ref().map(|gaze| gaze.at(time_s)))
    }

    /// Radii of the foveal layers that a frame has.
    #[cfg(feature = "view")]
    pub fn fovea(&self, decided: Decided) -> Option<[f64; 2]> {
        self.qualities[decided.decision.rung].0.fovea
    }

    /// Renders a frame as decided, `late_ms` after it was due; returns its row and its report.
    pub fn render(
        &mut self,
        decided: Decided,
        late_ms: f64,
        rig: &Rig,
        time_s: f64,
        index: u32,
    ) -> Result<(FrameRow, FrameReport), Failure> {
        let (quality, effort) = self.qualities[decided.decision.rung].clone();
        self.renderer.set_quality(quality, effort)?;
        let frame = self.renderer.render(rig, time_s, index)?;
        Ok((self.take_in(&frame, decided, late_ms, rig, time_s), frame))
    }

    /// Begins the record of the frames in a folder.
    pub fn record(&self, folder: &Path) -> Result<FrameRecord, Failure> {
        Ok(FrameRecord::create(folder, self.budget_ms())?)
    }

    fn budget_ms(&self) -> [f64; 2] {
        [self.budget.lo_ms(), self.budget.hi_ms()]
    }

    /// Returns the contents of run.json.
    pub fn report<'a>(
        &self,
        prepared: &Prepared,
        loaded: &Loaded,
        record: &'a FrameRecord,
    ) -> RunReport<&'a SpooledRows> {
        let Prepared { options, choice, render, .. } = prepared;
        let devices = self.renderer.devices();
        let budget_ms = self.budget_ms();
        let mut settings = settings::in_force(render, loaded.exposure_ev(), devices);
        // A headset may have said what it is.
        settings.options.insert("budget_ms".to_owned(), format!("{}..{}", budget_ms[0], budget_ms[1]).into());
        let rows = record.rows();
        let mut report = RunReport::new(settings, devices, &loaded.scene, loaded.needs, !render.no_skip, rows);
        report.warm_up_s = self.warm_up_s;
        report.faults = self.renderer.faults().to_vec();
        report.rectified = self.renderer.rectified().map(|frame| RectifiedFrame::new(frame, render.size));
        let play = Play {
            denoiser: Denoiser::name_of(choice.denoiser),
            ladder: options.ladder_name(&self.ladder),
            measure: self.ladder.origin().measure,
            rungs: self.ladder.rungs().to_vec(),
            fps: render.fps,
            fit: self.fit.clone(),
        };
        report.play = record.play.summary(&play);
        report
    }

    /// Tells the controller and the trace; returns the frame's row.
    fn take_in(&mut self, frame: &FrameReport, decided: Decided, late_ms: f64, rig: &Rig, time_s: f64) -> FrameRow {
        let Decided { decision: Decision { rung, expected_ms, fits }, decide_ms } = decided;
        self.controller.observe(rung, frame.makespan_ms);
        let lost = self.renderer.faults().len();
        if std::mem::replace(&mut self.lost, lost) != lost {
            self.controller.devices_changed();
        }
        let budget_ms = self.budget_ms();
        let in_band = (budget_ms[0]..=budget_ms[1]).contains(&frame.makespan_ms);
        let (quality, _) = &self.qualities[rung];
        self.tracing.record(quality, Some(FrameControl { rung, budget_ms }), frame);
        let mut row = FrameRow::new(frame, quality, rig, time_s);
        row.control = Some(ControlRow { rung, expected_ms, fits, in_band, late_ms, decide_ms });
        row
    }

    /// Announces a frame whose row is recorded, on the terminal or as a line of JSON.
    pub fn announce(&mut self, row: &FrameRow, frame: &FrameReport) {
        let Some(ControlRow { rung, expected_ms, fits, in_band, late_ms, .. }) = row.control else { return };
        let FrameQuality { spp, bounces, iterations, scale, fovea } = row.quality;
        self.progress.event(|| {
            serde_json::json!({
                "event": "frame", "index": row.index, "rung": rung, "spp": spp, "bounces": bounces,
                "iterations": iterations, "scale": scale, "fovea": fovea, "predicted_ms": row.predicted_ms, "expected_ms": expected_ms,
                "fits": fits, "makespan_ms": row.makespan_ms, "in_band": in_band, "late_ms": late_ms,
            })
        });
        self.live.observe(row, &frame.busy_ms(), &self.progress);
        self.faults.say_new(&self.renderer, &self.tracing, &self.progress);
    }
}

fn find_ladder(
    prepared: &Prepared,
    loaded: &Loaded,
    renderer: &mut Renderer,
    progress: &Progress,
) -> Result<Ladder, Failure> {
    let Prepared { options, choice, render, .. } = prepared;
    if let Some(ladder) = &choice.ladder {
        return Ok(ladder.clone());
    }
    progress.phase("timing settings");
    let origin = Origin {
        shot: render.shot.clone(),
        size: render.size.to_string(),
        exposure_ev: ESTIMATES_EV,
        measure: Measure::Estimate,
        devices: Vec::new(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let (rig, rows) = (&loaded.shot.rig, render.size.height);
    let ladder = Calibration::new(renderer, rig, render.time, rows, &options.foveated).ladder(choice, origin);
    // The first frame is not to find what was timed.
    renderer.begin_anew();
    ladder
}
