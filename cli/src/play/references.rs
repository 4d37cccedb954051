//! Frames of a run that are kept, and their references.

use std::time::Duration;

use crate::report::run::ReferenceRow;
use diptych::exec::{PerView, Renderer};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::scene::rig::Rig;

use super::args::Args;
use crate::failure::Failure;
use crate::interrupt;
use crate::options::{RenderOptions, RunOptions};
use crate::reference::{PASS_SPP, Plan};
use crate::setup::{self, Tracing};

/// Time limit of a reference without a number of samples.
const TIME_LIMIT: Duration = Duration::from_secs(10);
/// Maximum samples per pixel of such a reference; beyond it, no difference is visible.
const SPP_MAX: u32 = 1 << 14;

/// A frame, read back from the devices.
pub struct Kept {
    pub index: u32,
    pub linear: PerView<RgbImage>,
    pub rig: Rig,
    pub time_s: f64,
}

/// Renders unbiased references of frames, with other random numbers.
pub struct References {
    plan: Plan,
    renderer: Renderer,
    tracing: Tracing,
}

impl References {
    /// Prepares references with `spp` samples per pixel, or as many as [`TIME_LIMIT`] allows.
    pub fn new(args: &Args, options: &RenderOptions, loaded: &LoadedScene, spp: Option<u32>) -> Result<Self, Failure> {
        let mut run = RunOptions { trace: None, ..options.run.clone() };
        run.settings.disturb.clear();
        run.settings.seed = !run.settings.seed;
        run.settings.slowdown.clear();
        let time_limit = spp.is_none().then_some(TIME_LIMIT);
        let render = RenderOptions { run, frames: 1, ..options.clone() };
        let plan = Plan::new(render, spp.unwrap_or(SPP_MAX), PASS_SPP, time_limit)?;
        // The passes of the references stay out of the run's trace.
        let tracing = Tracing::start(&plan.options)?;
        let gpus = setup::open_devices(&plan.options, usize::from(args.options.virtual_devices))?;
        let renderer = setup::renderer(&plan.options, loaded, gpus, tracing.recorder.origin())?;
        Ok(Self { plan, renderer, tracing })
    }

    /// Renders the reference of a frame. `loaded` has the frame's camera from then on.
    pub fn of(&mut self, frame: &Kept, loaded: &mut LoadedScene) -> Result<(PerView<RgbImage>, ReferenceRow), Failure> {
        let Self { plan, renderer, tracing } = self;
        loaded.shot.rig = frame.rig.clone();
        plan.options.run.settings.time = frame.time_s;
        let done = plan.accumulate(renderer, loaded, 0, plan.begun(loaded, 0)?, tracing)?;
        interrupt::check()?;
        Ok((done.accumulation.mean(), done.row))
    }
}
