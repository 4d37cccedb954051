//! Renderers.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;

use glam::DVec3;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::exclusive::{Exclusive, Guard};
use super::failure::exception;
use super::frame::{Frame, Images, Look, report, tags};
use super::options::{Given, Options, Scope, given};
use super::policy::Function;
use super::scene::Scene;
use crate::environment::let_devices_set_environment;
use crate::failure::Failure;
use crate::options::RenderOptions;
use crate::report::run::FrameRow;
use crate::setup;
use diptych::exec::ranks::Devices;
use diptych::exec::{PerView, Renderer as Inner};
use diptych::image::exr::Tags;
use diptych::loaded::LoadedScene;
use diptych::passes::Aov;
use diptych::scene::rig::{Rig, RigKey};

/// Renders frames of a scene on one or more devices. Options are those of the command line.
#[pyclass(frozen, module = "diptych")]
pub struct Renderer {
    pub(super) scene: Py<Scene>,
    pub(super) options: Options,
    pub(super) rig: Rig,
    pub(super) look: Look,
    pub(super) policy: Option<Arc<Function>>,
    /// The renderer, except while a [`Player`](super::player::Player) has its devices.
    inner: Exclusive<Option<Inner>>,
    /// Number of the next frame.
    next: AtomicU32,
}

/// Opens the devices of the options. Drivers may read settings from the environment meanwhile, so the caller keeps the
/// interpreter's lock.
pub(super) fn open_devices(_: Python<'_>, options: &Options) -> Result<Devices, Failure> {
    // SAFETY: as with an assignment to `os.environ`, the interpreter's lock keeps other Python code from accessing the
    // environment. Other native threads must not access it while a renderer is created, as `docs/guide/python.md` says.
    unsafe { let_devices_set_environment() };
    setup::open_devices(&options.render, usize::from(options.virtual_devices))
}

fn pose(position: [f64; 3], target: [f64; 3], up: [f64; 3]) -> PyResult<Rig> {
    let [position, target, up] = [position, target, up].map(DVec3::from);
    let key = RigKey { time_s: 0.0, position, target, up };
    if !(position.is_finite() && target.is_finite() && up.is_finite()) || key.is_degenerate() {
        let what =
            "the pose has no orientation: position and target must differ, and up must not be parallel to the view";
        return Err(PyValueError::new_err(what));
    }
    Ok(Rig::of_keys(vec![key]))
}

#[pymethods]
impl Renderer {
    #[new]
    #[pyo3(signature = (scene, *, policy=None, **options))]
    fn new(
        py: Python<'_>,
        scene: Py<Scene>,
        policy: Option<Bound<'_, PyAny>>,
        options: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let own = given(options, Scope::Renderer)?;
        let policy = policy.map(|function| policy_of(function, &own)).transpose()?;
        let options = scene.get().options(&own)?;
        let devices = open_devices(py, &options).map_err(exception)?;
        let make = |loaded: &LoadedScene, devices: Devices| {
            let inner = start(&options.render, loaded, devices, policy.as_ref())?;
            Ok((inner, loaded.shot.rig.clone(), Look::of(&loaded.shot)))
        };
        let made = py.detach(|| scene.get().metered(&options.render, devices, make));
        let (inner, rig, look) = made.map_err(exception)?;
        let inner = Exclusive::new(Some(inner));
        Ok(Self { scene, options, rig, look, policy, inner, next: AtomicU32::new(0) })
    }

    /// Renders a frame at a time on the camera's path, in seconds, or from a pose. `warm_up` frames of the same instant
    /// come before it, and end the history of earlier frames.
    #[pyo3(signature = (time=0.0, *, index=None, warm_up=0, position=None, target=None, up=[0.0, 1.0, 0.0]))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
    fn render(
        &self,
        py: Python<'_>,
        time: f64,
        index: Option<u32>,
        warm_up: u32,
        position: Option<[f64; 3]>,
        target: Option<[f64; 3]>,
        up: [f64; 3],
    ) -> PyResult<Frame> {
        let begin = Instant::now();
        let rig = match (position, target) {
            (None, None) => self.rig.clone(),
            (Some(position), Some(target)) => Rig { keys: pose(position, target, up)?.keys, ..self.rig.clone() },
            _ => return Err(PyValueError::new_err("give both position and target, or neither")),
        };
        if !time.is_finite() {
            return Err(PyValueError::new_err("time is not a number of seconds"));
        }
        let index = index.unwrap_or_else(|| self.next.load(Ordering::Relaxed));
        self.next.store(index.wrapping_add(1), Ordering::Relaxed);
        let render = |inner: &mut Inner, index: u32| -> PyResult<(FrameRow, PerView<Tags>)> {
            let asked_ms = self.ask(inner)?;
            let params = inner.frame(&rig, time, index);
            let frame = inner.render(&params).map_err(exception)?;
            let row = FrameRow::new(&frame, &params.quality, &rig, time);
            let tags = tags(&rig, self.look, &frame, self.options.render.settings.size, time);
            Ok((FrameRow { plan_ms: row.plan_ms + asked_ms, ..row }, tags))
        };
        let (images, report) = py.detach(|| {
            let mut guard = self.lock().map_err(exception)?;
            let inner = guard.as_mut().ok_or_else(busy).map_err(exception)?;
            if warm_up > 0 {
                inner.begin_anew();
            }
            for before in (1..=warm_up).rev() {
                render(inner, index.wrapping_sub(before))?;
            }
            let (row, tags) = render(inner, index)?;
            let images = Images::read(inner, &self.aovs(), tags).map_err(exception)?;
            Ok::<_, PyErr>((images, report(&row).map_err(exception)?))
        })?;
        py.check_signals()?;
        Frame::new(py, images, self.look, report, begin)
    }

    /// Discards the history, so that the next frame does not use earlier frames.
    fn begin_anew(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.lock()?.as_mut().map(Inner::begin_anew).ok_or_else(busy)).map_err(exception)
    }

    /// Devices of the renderer, in JSON.
    fn devices_json(&self, py: Python<'_>) -> PyResult<String> {
        let text = py.detach(|| -> Result<String, Failure> {
            let guard = self.lock()?;
            let inner = guard.as_ref().ok_or_else(busy)?;
            Ok(serde_json::to_string(inner.devices()).map_err(anyhow::Error::from)?)
        });
        text.map_err(exception)
    }
}

impl Renderer {
    pub(super) fn aovs(&self) -> Vec<Aov> {
        self.options.render.aovs.clone()
    }

    /// Asks the policy in Python, if there is one, for the rows of the next frame. Returns the time in milliseconds that
    /// this took.
    pub(super) fn ask(&self, inner: &mut Inner) -> PyResult<f64> {
        let Some(policy) = &self.policy else { return Ok(0.0) };
        inner.assign_anew();
        policy.ask(inner.costs())
    }

    fn lock(&self) -> Result<Guard<'_, Option<Inner>>, Failure> {
        self.inner.lock()
    }

    /// Takes the devices. Until [`Self::put_back`], no frame can be rendered.
    pub(super) fn take(&self) -> Result<Devices, Failure> {
        self.lock()?.take().map(Inner::into_devices).ok_or_else(busy)
    }

    pub(super) fn put_back(&self, devices: Devices) -> Result<(), Failure> {
        let inner = start(&self.options.render, &self.scene.get().loaded(), devices, self.policy.as_ref())?;
        *self.lock()? = Some(inner);
        Ok(())
    }
}

/// Creates a renderer with a policy in Python, or else with that of the options.
pub(super) fn start(
    options: &RenderOptions,
    loaded: &LoadedScene,
    devices: Devices,
    policy: Option<&Arc<Function>>,
) -> Result<Inner, Failure> {
    setup::renderer_with(options, loaded, devices, Instant::now(), |grid, devices| match policy {
        Some(function) => Ok(function.policy(grid.height, devices)),
        None => setup::policy(options, grid, devices),
    })
}

/// Makes a policy of a function, unless options select another policy.
fn policy_of(function: Bound<'_, PyAny>, options: &[Given]) -> PyResult<Arc<Function>> {
    if let Some(other) = options.iter().find(|option| ["balance", "ratios"].contains(&option.id)) {
        return Err(PyTypeError::new_err(format!("give either policy or {}", other.id)));
    }
    Function::new(function)
}

fn busy() -> Failure {
    Failure::Run(anyhow::anyhow!("the renderer's devices play a sequence: close the player first"))
}
