//! Rendering inside a frame budget: a renderer, and a controller that picks the quality of each frame from a ladder.

mod calibration;
mod blur_errors;

use std::cell::RefCell;
use std::collections::HashMap;
use std::time::Instant;

pub use calibration::{CalibrationError, FIRST_FRAME, View, calibrate};

use crate::control::{
    Budget, Control, ControllerKind, Decision, ESTIMATES_EV, Ladder, Measure, Origin, candidates, relative_costs,
};
use crate::exec::{BuildError, Builder, ExecError, FrameParams, FrameReport, Renderer};
use crate::image::Extent;
use crate::quality::{Denoiser, Envelope, Quality};
use crate::scene::rig::Rig;
use crate::schedule::RelativeCost;
use crate::schedule::learned::Mean;

/// Renders frames inside a budget.
///
/// ```no_run
/// use diptych::{LoadedScene, Renderer, Session};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scene = LoadedScene::load("builtin:cornell")?;
/// let mut session = Session::start(Renderer::builder(&scene).size(96, 54), "11..20".parse()?)?;
/// for index in 0..100 {
///     let frame = session.render_next(&scene.shot.rig, f64::from(index) / 72.0, index)?;
///     println!("{:.1} ms: {}", frame.report.makespan_ms, session.quality(frame.decision.rung));
/// }
/// # Ok(())
/// # }
/// ```
pub struct Session {
    pub renderer: Renderer,
    /// Gaze of both eyes in frames rendered from now on, see [`FrameParams::gaze`].
    pub gaze: Option<[[f64; 2]; 2]>,
    /// Exposure of frames rendered from now on, in stops. `None` uses that of the renderer's configuration.
    pub exposure_ev: Option<f32>,
    ladder: Ladder,
    /// The quality and the relative cost of each rung.
    qualities: Vec<(Quality, RelativeCost)>,
    controller: Box<dyn Control>,
    budget: Budget,
    /// Time of a frame outside its makespan, in milliseconds: poses, uploads of moving geometry, and row tallies.
    outside: Mean,
    /// Time of [`Self::read`] per frame, in milliseconds, and that of the newest frame if it was not learned yet.
    reading: Mean,
    read_ms: Option<f64>,
    /// The number of devices that were dropped.
    dropped: usize,
}

/// An error of [`Session::start`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    #[error(transparent)]
    Build(#[from] BuildError),
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
}

/// The rung of the next frame, and the time in milliseconds that it took to choose it.
#[derive(Clone, Copy, Debug)]
pub struct Decided {
    pub decision: Decision,
    pub decide_ms: f64,
}

/// A frame of a session.
#[derive(Clone, Debug)]
pub struct SessionFrame {
    pub report: FrameReport,
    pub decision: Decision,
}

impl Session {
    /// Makes a renderer and calibrates the built-in SVGF ladder for it: times some qualities for about two seconds, and
    /// estimates errors.
    ///
    /// # Errors
    /// [`StartError::Build`] if the renderer cannot be built, [`StartError::Calibration`] if the calibration fails.
    pub fn start(builder: Builder, budget: Budget) -> Result<Self, StartError> {
        let qualities = candidates(Some(Denoiser::SVGF), false);
        let (rig, size) = (builder.rig().clone(), builder.extent());
        let renderer = builder.envelope(Envelope::of(&qualities).with_unfiltered()).build()?;
        Ok(Self::calibrated(renderer, &rig, size, &qualities, budget)?)
    }

    /// Begins a session on a renderer of images of this size, and calibrates a ladder of `qualities` for it. The
    /// renderer's envelope must contain them. If it has frames without a filter ([`Envelope::with_unfiltered`]), the
    /// error of the filter's iterations is measured on devices that are fast enough.
    ///
    /// # Errors
    /// [`CalibrationError`] if a frame fails or no quality could be timed.
    pub fn calibrated(
        mut renderer: Renderer,
        rig: &Rig,
        size: Extent,
        qualities: &[Quality],
        budget: Budget,
    ) -> Result<Self, CalibrationError> {
        let time_s = rig.keys.first().map_or(0.0, |key| key.time_s);
        let origin = Origin {
            shot: String::new(),
            size: size.to_string(),
            exposure_ev: ESTIMATES_EV,
            measure: Measure::Estimate,
            devices: Vec::new(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        let view = View { rig, time_s };
        let ladder = calibrate(&mut renderer, &view, qualities, &|quality: &Quality| *quality, origin, &|| false)?;
        let qualities = ladder.rungs().iter().map(|rung| rung.quality).collect();
        Ok(Self::with_qualities(renderer, ladder, qualities, budget))
    }

    /// Begins a session on a renderer that has the pipelines of all rungs, see [`Builder::envelope`]. Frames on rung i are
    /// rendered with `qualities[i]`.
    pub fn with_qualities(mut renderer: Renderer, ladder: Ladder, qualities: Vec<Quality>, budget: Budget) -> Self {
        renderer.set_budget(budget.hi_ms());
        Self {
            qualities: qualities.into_iter().zip(relative_costs(ladder.rungs())).collect(),
            controller: ControllerKind::Diptych.start(&ladder, budget),
            budget,
            outside: Mean::default(),
            reading: Mean::default(),
            read_ms: None,
            dropped: renderer.faults().len(),
            renderer,
            gaze: None,
            exposure_ev: None,
            ladder,
        }
    }

    pub fn ladder(&self) -> &Ladder {
        &self.ladder
    }

    /// Returns the budget: the range that the makespans (frame times) should stay in.
    pub fn budget(&self) -> Budget {
        self.budget
    }

    /// Returns the quality of frames on a rung.
    pub fn quality(&self, rung: usize) -> &Quality {
        &self.qualities[rung].0
    }

    /// Replaces the controller.
    pub fn set_controller(&mut self, controller: Box<dyn Control>) {
        self.controller = controller;
    }

    /// Chooses the rung of the next frame. The controller keeps the whole time of a frame inside the budget, not its
    /// makespan alone; the decision has the expected makespan.
    pub fn decide(&mut self) -> Decided {
        let begin = Instant::now();
        if let Some(ms) = self.read_ms.take() {
            self.reading.learn_with_zero(ms);
        }
        let Self { renderer, qualities, controller, outside, reading, .. } = self;
        let outside_ms = outside.value().unwrap_or(0.0) + reading.value().unwrap_or(0.0);
        let (renderer, known) = (RefCell::new(renderer), RefCell::new(HashMap::new()));
        let predict = |rung: usize| -> f64 {
            let (quality, relative_cost) = &qualities[rung];
            let predicted = || {
                let makespan_ms = renderer.borrow_mut().predicted_ms(quality, relative_cost);
                makespan_ms.map_or(f64::NAN, |ms| ms + outside_ms)
            };
            *known.borrow_mut().entry(rung).or_insert_with(predicted)
        };
        let mut decision = controller.next(&predict);
        if decision.expected_ms.is_finite() {
            decision.expected_ms = (decision.expected_ms - outside_ms).max(0.0);
        }
        Decided { decision, decide_ms: begin.elapsed().as_secs_f64() * 1e3 }
    }

    /// Renders a frame on the chosen rung, like [`Renderer::render`], and reports its time to the controller.
    ///
    /// # Errors
    /// Errors of [`Renderer::render`].
    pub fn render(&mut self, decided: Decided, rig: &Rig, time_s: f64, index: u32) -> Result<FrameReport, ExecError> {
        let rung = decided.decision.rung;
        let (quality, relative_cost) = self.qualities[rung].clone();
        let frame = self.renderer.frame(rig, time_s, index);
        let exposure_ev = self.exposure_ev.unwrap_or(frame.exposure_ev);
        let params =
            FrameParams { quality, gaze: self.gaze.unwrap_or(frame.gaze), exposure_ev, relative_cost, ..frame };
        let begin = Instant::now();
        let frame = self.renderer.render(&params)?;
        let whole_ms = begin.elapsed().as_secs_f64() * 1e3;
        self.read_ms = Some(0.0);
        self.outside.learn_with_zero((whole_ms - frame.makespan_ms).max(0.0));
        self.controller.observe(rung, whole_ms.max(frame.makespan_ms) + self.reading.value().unwrap_or(0.0));
        let dropped = self.renderer.faults().len();
        if std::mem::replace(&mut self.dropped, dropped) != dropped {
            self.controller.devices_changed();
        }
        Ok(frame)
    }

    /// Reads images of the last frame for its presentation. The controller adds the mean time of this to each frame's.
    ///
    /// # Errors
    /// Errors of `read`.
    pub fn read<T>(&mut self, read: impl FnOnce(&mut Renderer) -> Result<T, ExecError>) -> Result<T, ExecError> {
        let _span = tracing::info_span!("read images").entered();
        let begin = Instant::now();
        let images = read(&mut self.renderer)?;
        self.spend(begin.elapsed().as_secs_f64() * 1e3);
        Ok(images)
    }

    /// Counts time that passes between the last frame and its presentation, in milliseconds, like that of [`Self::read`].
    pub fn spend(&mut self, ms: f64) {
        *self.read_ms.get_or_insert_default() += ms;
    }

    /// Chooses a rung and renders a frame on it.
    ///
    /// # Errors
    /// Errors of [`Renderer::render`].
    pub fn render_next(&mut self, rig: &Rig, time_s: f64, index: u32) -> Result<SessionFrame, ExecError> {
        let decided = self.decide();
        let report = self.render(decided, rig, time_s, index)?;
        Ok(SessionFrame { report, decision: decided.decision })
    }
}
