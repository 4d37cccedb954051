//! References: unbiased images of many samples.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::failure::exception;
use super::frame::{Frame, Images, Look};
use super::options::{Scope, given};
use super::renderer::open_devices;
use super::scene::Scene;
use crate::failure::Failure;
use crate::reference::{OVERRULED, PASS_SPP, Plan};
use crate::{output, setup};
use diptych::accumulation::{Accumulation, Job, accumulate};
use diptych::samples::Samples;

/// Renders a reference: all views are traced, nothing is filtered. `progress` is called after each pass with the number
/// of samples per pixel so far and their total.
#[pyfunction]
#[pyo3(signature = (scene, spp=256, *, time=0.0, index=0, time_limit=None, progress=None, **options))]
#[expect(clippy::too_many_arguments, reason = "they are keywords in Python")]
pub fn reference(
    py: Python<'_>,
    scene: &Bound<'_, Scene>,
    spp: u32,
    time: f64,
    index: u32,
    time_limit: Option<f64>,
    progress: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Frame> {
    let begin = Instant::now();
    let (scene, own) = (scene.get(), given(options, Scope::Renderer)?);
    if let Some((id, why)) = OVERRULED.iter().find(|(id, _)| own.iter().any(|option| option.id == *id)) {
        return Err(PyTypeError::new_err(format!("a reference {why}: leave '{id}' out")));
    }
    let mut options = scene.options(&own)?;
    (options.render.run.settings.time, options.render.frames) = (time, 1);
    let checked = options.render.check().and_then(|()| Ok(Samples::from(spp).check()?));
    checked.map_err(|error| exception(Failure::Input(error)))?;
    let seconds = |limit| Duration::try_from_secs_f64(limit).ok().filter(|limit| !limit.is_zero());
    let wrong = || PyTypeError::new_err("time_limit: give a number of seconds above 0");
    let time_limit = time_limit.map(|limit| seconds(limit).ok_or_else(wrong)).transpose()?;
    let plan = Plan::new(options.render.clone(), spp, PASS_SPP, time_limit).map_err(exception)?;
    let devices = open_devices(py, &options).map_err(exception)?;
    let (stop, mut raised) = (AtomicBool::new(false), Ok(()));
    let accumulated = py.detach(|| -> Result<_, Failure> {
        let (mut renderer, rig, look) = scene.metered(&plan.options, devices, |loaded, devices| {
            let renderer = setup::renderer(&plan.options, loaded, devices, Instant::now())?;
            Ok((renderer, loaded.shot.rig.clone(), Look::of(&loaded.shot)))
        })?;
        let job = Job {
            rig: &rig,
            time_s: time,
            frame: index,
            pass_spp: PASS_SPP,
            spp,
            time_limit,
            checkpoint: None,
            progress: &|_, _| {},
            stop: &stop,
        };
        let begun = Accumulation::new(options.render.settings.size, rig.views);
        let done = accumulate(&mut renderer, &job, begun, |pass| {
            // A pass follows the one in which `stop` is set.
            if raised.is_err() {
                return;
            }
            let told = Python::attach(|py| {
                py.check_signals()?;
                let samples = (pass.accumulation.samples(), spp);
                progress.as_ref().map_or(Ok(()), |progress| progress.call1(py, samples).map(drop))
            });
            if told.is_err() {
                stop.store(true, Ordering::Relaxed);
                raised = told;
            }
        })?;
        let row = serde_json::to_string(&plan.row(index, 0, &done)).map_err(anyhow::Error::from)?;
        let tags = output::tags(&rig, look.exposure_ev, options.render.settings.size, time, index);
        let mut images = Images::read(&mut renderer, &plan.options.aovs, tags)?;
        images.linear = done.accumulation.mean();
        Ok((images, look, row))
    });
    raised?;
    let (images, look, row) = accumulated.map_err(exception)?;
    Frame::new(py, images, look, row, begin)
}
