//! Sequences inside a frame budget.

use std::path::{Path, PathBuf};
use std::time::Instant;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::control::{self, Controller, Raised};
use super::exclusive::{Exclusive, Guard};
use super::failure::exception;
use super::frame::{Frame, Images, report, tags};
use super::renderer::{Renderer, open_devices, start};
use crate::failure::Failure;
use crate::options::RenderOptions;
use crate::play::Pace;
use crate::report::play::ControlRow;
use crate::report::run::FrameRow;
use crate::scene_loading::budget;
use crate::setup;
use diptych::control::{Budget, Ladder, candidates};
use diptych::exec::ranks::Devices;
use diptych::quality::{Envelope, FrameQuality};
use diptych::scene::head::HeadMotion;
use diptych::scene::rig::Rig;
use diptych::scene::shot::allowed::FPS;
use diptych::session::{Decided, Session};

/// Iterator over the frames of a sequence. The control loop sets the quality of each frame so that frame times stay
/// inside the budget.
#[pyclass(frozen, module = "diptych")]
pub struct Player {
    renderer: Py<Renderer>,
    playing: Exclusive<Option<Playing>>,
    /// Rungs of the ladder, in JSON.
    #[pyo3(get)]
    ladder_json: String,
}

struct Playing {
    session: Session,
    rig: Rig,
    fps: f64,
    time_s: f64,
    /// Number of the next frame, and the number of frames in the sequence.
    next: u32,
    frames: u32,
    /// Clock of the frames; `None` if it stands still between frames.
    pace: Option<Pace>,
    /// Display periods that frames have missed.
    missed: u32,
    /// Exceptions of the controller.
    raised: Raised,
}

/// A rung of the ladder, as Python sees it.
#[derive(serde::Serialize)]
struct RungRow {
    time_ms: f64,
    error: f64,
    #[serde(flatten)]
    quality: FrameQuality,
}

fn ladder_json(ladder: &Ladder) -> Result<String, Failure> {
    let rows = ladder.rungs().iter().map(|rung| RungRow {
        time_ms: rung.time_ms,
        error: rung.error,
        quality: (&rung.quality).into(),
    });
    Ok(serde_json::to_string(&rows.collect::<Vec<_>>()).map_err(anyhow::Error::from)?)
}

impl Playing {
    /// Renders the next frame; returns its images and its entry in run.json, or `None` after the last frame.
    fn frame(&mut self, renderer: &Renderer) -> PyResult<Option<(Images, String)>> {
        if self.next == self.frames {
            return Ok(None);
        }
        let asked_ms = renderer.ask(&mut self.session.renderer)?;
        let decided = self.session.decide();
        self.raised.check()?;
        let frame = self.render(renderer, decided, asked_ms).map_err(exception)?;
        self.raised.check()?;
        Ok(Some(frame))
    }

    /// Renders a frame whose rows a policy in Python took `asked_ms` to distribute.
    fn render(&mut self, renderer: &Renderer, decided: Decided, asked_ms: f64) -> Result<(Images, String), Failure> {
        let Self { session, rig, .. } = self;
        let late_ms = self.pace.as_mut().map_or(0.0, Pace::wait);
        let time_s = self.time_s + f64::from(self.next.saturating_add(self.missed)) / self.fps;
        let frame = session.render(decided, rig, time_s, self.next)?;
        let now = Instant::now();
        let missed_periods = self.pace.as_mut().map_or(0, |pace| pace.complete(now).missed_periods);
        self.next += 1;
        self.missed = self.missed.saturating_add(missed_periods);
        let mut row = FrameRow::new(&frame, session.quality(decided.decision.rung), rig, time_s);
        row.control = Some(ControlRow::new(decided, session.budget(), frame.makespan_ms, late_ms));
        row.miss(missed_periods);
        row.plan_ms += asked_ms;
        let tags = tags(rig, renderer.look, &frame, renderer.options.render.settings.size, time_s);
        Ok((Images::read(&mut session.renderer, &renderer.aovs(), tags)?, report(&row)?))
    }
}

/// Begins a sequence on the devices of a renderer.
fn begin(renderer: &Renderer, devices: Devices, budget: Budget, rig: &Rig) -> Result<Session, Failure> {
    let options = &renderer.options.render;
    let qualities = candidates(options.quality().denoiser(), false);
    let most = RenderOptions::new(options.run.clone(), Envelope::of(&qualities).with_unfiltered());
    let most = RenderOptions { aovs: options.aovs.clone(), ..most };
    let loaded = renderer.scene.get().loaded();
    let inner = start(&most, &loaded, devices, renderer.policy.as_ref())?;
    Ok(Session::calibrated(inner, rig, options.settings.size, &qualities, budget)?)
}

/// Returns the camera that follows recorded head motion.
fn followed(renderer: &Renderer, path: &Path) -> Result<Rig, Failure> {
    let options = &renderer.options.render;
    let invalid = |what: String| Failure::Input(anyhow::anyhow!("{}: {what}", path.display()));
    let motion = HeadMotion::read(path, &budget(&options.settings))?;
    let rig = motion.rig(&renderer.rig).map_err(invalid)?.plain_at(options.settings.size);
    if rig.optics.is_some() {
        return Err(invalid("the eyes have projections of their own, which only `diptych play` supports".to_owned()));
    }
    Ok(rig)
}

#[pymethods]
impl Player {
    #[new]
    #[pyo3(signature = (renderer, budget_ms, frames, *, fps=72.0, time=0.0, motion=None, pace=false, controller=None))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn new(
        py: Python<'_>,
        renderer: Py<Renderer>,
        budget_ms: (f64, f64),
        frames: Option<u32>,
        fps: f64,
        time: f64,
        motion: Option<PathBuf>,
        pace: bool,
        controller: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let budget = Budget::new(budget_ms.0, budget_ms.1).map_err(|error| PyValueError::new_err(error.to_string()))?;
        if !(FPS.allows(fps) && time.is_finite()) {
            return Err(PyValueError::new_err(format!("give {} as fps, and a number of seconds as time", FPS.what)));
        }
        controller.as_ref().map_or(Ok(()), control::check)?;
        let of = renderer.get();
        setup::check_eyes(&of.rig).map_err(exception)?;
        let rig = motion.map_or_else(|| Ok(of.rig.clone()), |path| followed(of, &path)).map_err(exception)?;
        let devices = py.detach(|| of.take()).map_err(exception)?;
        let mut session = match py.detach(|| begin(of, devices, budget, &rig)) {
            Ok(session) => session,
            Err(failure) => {
                let devices = open_devices(py, &of.options).map_err(exception)?;
                py.detach(|| of.put_back(devices)).map_err(exception)?;
                return Err(exception(failure));
            }
        };
        let raised = Raised::default();
        if let Some(object) = controller {
            let controller = Controller::new(object.unbind(), session.ladder(), budget, raised.clone());
            session.set_controller(Box::new(controller));
        }
        let ladder_json = ladder_json(session.ladder()).map_err(exception)?;
        let (frames, pace) = (frames.unwrap_or(u32::MAX), pace.then(|| Pace::new(fps)));
        let playing = Playing { session, rig, fps, time_s: time, next: 0, frames, pace, missed: 0, raised };
        Ok(Self { renderer, playing: Exclusive::new(Some(playing)), ladder_json })
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        let begin = Instant::now();
        let renderer = self.renderer.get();
        let next = || self.lock().map_err(exception)?.as_mut().map_or(Ok(None), |playing| playing.frame(renderer));
        let Some((images, report)) = py.detach(next)? else {
            self.close(py)?;
            return Ok(None);
        };
        py.check_signals()?;
        Frame::new(py, images, renderer.look, report, begin).map(Some)
    }

    /// Counts time in milliseconds that the last frame took after it was rendered. The control loop adds the mean of it
    /// to each frame's time.
    fn spend(&self, py: Python<'_>, ms: f64) -> PyResult<()> {
        if !(ms.is_finite() && ms >= 0.0) {
            return Err(PyValueError::new_err("ms is not a number of milliseconds"));
        }
        py.detach(|| self.lock().map(|mut playing| playing.iter_mut().for_each(|p| p.session.spend(ms))))
            .map_err(exception)
    }

    /// Ends the sequence and gives the devices back to the renderer.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.end()).map_err(exception)
    }
}

impl Player {
    fn lock(&self) -> Result<Guard<'_, Option<Playing>>, Failure> {
        self.playing.lock()
    }

    fn end(&self) -> Result<(), Failure> {
        let playing = self.lock()?.take();
        playing.map_or(Ok(()), |playing| self.renderer.get().put_back(playing.session.renderer.into_devices()))
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        // A destructor has no way to report a failure; the next frame of the renderer does. Other threads may need the
        // interpreter's lock until they release the scene.
        let _ = Python::try_attach(|py| py.detach(|| self.end()));
    }
}
