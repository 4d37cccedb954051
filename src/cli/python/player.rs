//! Sequences inside a frame budget.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::failure::exception;
use super::frame::{Frame, Images, report};
use super::renderer::{Renderer, open_devices};
use crate::cli::failure::Failure;
use crate::cli::options::RenderOptions;
use crate::cli::play::Pace;
use crate::cli::setup;
use crate::control::{Budget, candidates};
use crate::exec::ranks::Devices;
use crate::quality::Envelope;
use crate::report::play::ControlRow;
use crate::report::run::FrameRow;
use crate::scene::head::HeadMotion;
use crate::scene::rig::Rig;
use crate::session::Session;

/// Iterator over the frames of a sequence. The control loop sets the quality of each frame so that frame times stay
/// inside the budget.
#[pyclass(frozen, module = "diptych")]
pub struct Player {
    renderer: Py<Renderer>,
    playing: Mutex<Option<Playing>>,
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
}

impl Playing {
    /// Renders the next frame; returns its images and its entry in run.json, or `None` after the last frame.
    fn frame(&mut self, renderer: &Renderer) -> Result<Option<(Images, String)>, Failure> {
        if self.next == self.frames {
            return Ok(None);
        }
        let Self { session, rig, .. } = self;
        let decided = session.decide();
        let late_ms = self.pace.as_ref().map_or(0.0, Pace::wait);
        let time_s = self.time_s + f64::from(self.next.saturating_add(self.missed)) / self.fps;
        let frame = session.render(decided, rig, time_s, self.next)?;
        let missed_periods = self.pace.as_mut().map_or(0, Pace::complete);
        self.next += 1;
        self.missed = self.missed.saturating_add(missed_periods);
        let mut row = FrameRow::new(&frame, session.quality(decided.decision.rung), rig, time_s);
        row.control = Some(ControlRow::new(decided, session.budget(), frame.makespan_ms, late_ms));
        row.miss(missed_periods);
        Ok(Some((Images::read(&mut session.renderer, &renderer.aovs())?, report(&row)?)))
    }
}

/// Begins a sequence on the devices of a renderer.
fn begin(renderer: &Renderer, devices: Devices, budget: Budget, rig: &Rig) -> Result<Session, Failure> {
    let options = &renderer.options.render;
    let qualities = candidates(options.quality().denoiser, false);
    let envelope = Envelope::of(&qualities);
    let most = RenderOptions { aov: options.aov.clone(), ..RenderOptions::single(options.run.clone(), &envelope.most) };
    let loaded = renderer.scene.get().loaded();
    let inner = setup::varying_renderer(&most, &loaded, devices, Instant::now(), &envelope)?;
    Ok(Session::calibrated(inner, rig, options.size, &qualities, budget)?)
}

/// Returns the camera that follows recorded head motion.
fn followed(renderer: &Renderer, path: &Path) -> Result<Rig, Failure> {
    let options = &renderer.options.render;
    let invalid = |what: String| Failure::Input(anyhow::anyhow!("{}: {what}", path.display()));
    let motion = HeadMotion::read(path, &options.scene.budget())?;
    let rig = motion.rig(&renderer.rig).map_err(invalid)?.plain_at(options.size);
    if rig.optics.is_some() {
        return Err(invalid("the eyes have projections of their own, which only `diptych play` supports".to_owned()));
    }
    Ok(rig)
}

#[pymethods]
impl Player {
    #[new]
    #[pyo3(signature = (renderer, budget_ms, frames, *, fps=72.0, time=0.0, motion=None, pace=false))]
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
    ) -> PyResult<Self> {
        let budget = Budget::new(budget_ms.0, budget_ms.1).map_err(|error| PyValueError::new_err(error.to_string()))?;
        if !(fps.is_finite() && fps > 0.0 && time.is_finite()) {
            return Err(PyValueError::new_err("fps must be above 0 and time a number of seconds"));
        }
        let of = renderer.get();
        let rig = motion.map_or_else(|| Ok(of.rig.clone()), |path| followed(of, &path)).map_err(exception)?;
        let devices = of.take()?;
        let session = match py.detach(|| begin(of, devices, budget, &rig)) {
            Ok(session) => session,
            Err(failure) => {
                let devices = open_devices(py, &of.options).map_err(exception)?;
                py.detach(|| of.put_back(devices)).map_err(exception)?;
                return Err(exception(failure));
            }
        };
        let (frames, pace) = (frames.unwrap_or(u32::MAX), pace.then(|| Pace::new(fps)));
        let playing = Playing { session, rig, fps, time_s: time, next: 0, frames, pace, missed: 0 };
        Ok(Self { renderer, playing: Mutex::new(Some(playing)) })
    }

    fn __iter__(this: Py<Self>) -> Py<Self> {
        this
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Frame>> {
        let begin = Instant::now();
        let renderer = self.renderer.get();
        let next = || self.lock().as_mut().map_or(Ok(None), |playing| playing.frame(renderer));
        let Some((images, report)) = py.detach(next).map_err(exception)? else {
            self.close(py)?;
            return Ok(None);
        };
        py.check_signals()?;
        Frame::new(py, images, renderer.look, report, begin).map(Some)
    }

    /// Ends the sequence and gives the devices back to the renderer.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.end()).map_err(exception)
    }

    fn __enter__(this: Py<Self>) -> Py<Self> {
        this
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) -> PyResult<()> {
        self.close(py)
    }
}

impl Player {
    fn lock(&self) -> MutexGuard<'_, Option<Playing>> {
        self.playing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn end(&self) -> Result<(), Failure> {
        let playing = self.lock().take();
        playing.map_or(Ok(()), |playing| self.renderer.get().put_back(playing.session.renderer.into_devices()))
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        // A destructor has no way to report a failure; the next frame of the renderer does.
        let _ = self.end();
    }
}
