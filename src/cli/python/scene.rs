//! Loaded scenes.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::failure::exception;
use super::options::{Given, Options, Scope, given};
use crate::cli::setup;
use crate::loaded::LoadedScene;
use crate::report::run::SceneSummary;

/// A scene and its shot. Several renderers can share it.
#[pyclass(frozen, module = "diptych")]
pub struct Scene {
    loaded: Mutex<LoadedScene>,
    /// The shot, and the options that it was loaded with.
    pub(super) shot: String,
    pub(super) given: Vec<Given>,
}

/// Loads `builtin:NAME`, a shot (.toml) or a scene (.gltf, .glb). Options are those of the command line.
#[pyfunction]
#[pyo3(signature = (shot, **options))]
pub fn load(py: Python<'_>, shot: &Bound<'_, PyAny>, options: Option<&Bound<'_, PyDict>>) -> PyResult<Scene> {
    let (shot, given) = (shot.str()?.to_string(), given(options, Scope::Scene)?);
    let options = Options::parse(&shot, &given)?;
    let loaded = py.detach(|| setup::load(&options.render)).map_err(exception)?;
    Ok(Scene { loaded: Mutex::new(loaded), shot, given })
}

impl Scene {
    pub fn loaded(&self) -> MutexGuard<'_, LoadedScene> {
        self.loaded.lock().unwrap_or_else(PoisonError::into_inner)
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
