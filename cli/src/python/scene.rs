//! Loaded scenes.

use std::sync::{PoisonError, RwLock, RwLockReadGuard};

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::failure::exception;
use super::options::{Given, Options, Scope, given};
use super::shot;
use crate::failure::Failure;
use crate::options::RenderOptions;
use crate::progress::Progress;
use crate::report::run::SceneSummary;
use crate::{metering, setup};
use diptych::exec::ranks::{Devices, Load};
use diptych::loaded::LoadedScene;
use diptych::scene::folder::Source;

/// A scene and its shot. Several renderers can share it.
#[pyclass(frozen, module = "diptych")]
pub struct Scene {
    loaded: RwLock<LoadedScene>,
    /// The shot, its text if it is a dict, and the options that it was loaded with.
    shot: String,
    text: Option<String>,
    given: Vec<Given>,
}

/// Name of a shot that is given as a dict, in messages.
const DICT: &str = "dict";

/// Loads `builtin:NAME`, a shot (.toml or a dict) or a scene (.gltf, .glb). Options are those of the command line.
#[pyfunction]
#[pyo3(signature = (shot, **options))]
pub fn load(py: Python<'_>, shot: &Bound<'_, PyAny>, options: Option<&Bound<'_, PyDict>>) -> PyResult<Scene> {
    let given = given(options, Scope::Scene)?;
    let text = shot.cast::<PyDict>().ok().map(shot::text).transpose()?;
    let shot = if text.is_some() { DICT.to_owned() } else { shot.str()?.to_string() };
    let options = Options::new(&shot, text.as_deref(), &given)?;
    let load = || match &text {
        None => setup::load_rig(&options.render),
        Some(text) => {
            let what = Load { shot: shot.clone(), time_s: options.render.settings.time, files: None };
            setup::load_here(&options.render, &what, Source::Shot(text))
        }
    };
    let loaded = py.detach(load).map_err(exception)?;
    Ok(Scene { loaded: RwLock::new(loaded), shot, text, given })
}

impl Scene {
    /// Returns the options of a renderer of the scene, with those that it was loaded with.
    pub(super) fn options(&self, own: &[Given]) -> PyResult<Options> {
        Options::new(&self.shot, self.text.as_deref(), self.given.iter().chain(own))
    }

    pub fn loaded(&self) -> RwLockReadGuard<'_, LoadedScene> {
        self.loaded.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// Meters the scene if its shot asks for it, and calls `make`. Other threads may use the scene meanwhile, unless it
    /// is metered.
    pub fn metered<T>(
        &self,
        options: &RenderOptions,
        devices: Devices,
        make: impl FnOnce(&LoadedScene, Devices) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let loaded = self.loaded();
        if !loaded.shot.is_metered {
            return make(&loaded, devices);
        }
        drop(loaded);
        let loaded = &mut *self.loaded.write().unwrap_or_else(PoisonError::into_inner);
        let devices = metering::meter(options, loaded, devices, &Progress::text(true, false))?;
        make(loaded, devices)
    }
}

#[pymethods]
impl Scene {
    /// Description of the scene as in run.json, in JSON.
    fn info_json(&self, py: Python<'_>) -> PyResult<String> {
        py.detach(|| {
            let loaded = self.loaded();
            serde_json::to_string(&SceneSummary::of(&loaded.scene, loaded.needs, true))
        })
        .map_err(|error| exception(anyhow::Error::from(error)))
    }

    /// Times of the first and the last key of the camera's path, in seconds.
    #[getter]
    fn path_s(&self, py: Python<'_>) -> (f64, f64) {
        py.detach(|| {
            let loaded = self.loaded();
            let keys = &loaded.shot.rig.keys;
            (keys.first().map_or(0.0, |key| key.time_s), keys.last().map_or(0.0, |key| key.time_s))
        })
    }
}
