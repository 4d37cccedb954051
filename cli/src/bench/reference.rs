//! References for a grid of settings: images that you supply, or rendered images, which later runs reuse.

use std::path::{Path, PathBuf};
use std::time::Duration;

use diptych::accumulation::{Noise, hash_of};
use diptych::exec::PerView;
use diptych::frame::Sampler;
use diptych::frame::settings::Settings;
use diptych::image::{RgbImage, exr};
use diptych::loaded::LoadedScene;
use diptych::metrics::kinds::KindMap;
use diptych::metrics::surfaces::Sighting;
use diptych::quality::Quality;

use super::args::Args;
use super::journal::Journal;
use crate::failure::Failure;
use crate::interrupt;
use crate::options::{RenderOptions, RunOptions};
use crate::output;
use crate::reference::{PASS_SPP, Plan};
use crate::setup::{self, Tracing};

/// Seed of references, so that they share no random numbers with the images that are compared with them.
const SEED: u32 = 0x5eed_0001;

/// Ground-truth images, up to their noise.
pub struct Reference {
    pub images: PerView<RgbImage>,
    /// Noise of a rendered reference; `None` for supplied images.
    pub noise: Option<PerView<Noise>>,
    /// Origin of the images in words, for reports.
    pub origin: String,
    /// Kinds of each eye's pixels, if errors by kind are wanted.
    pub kinds: Option<[KindMap; 2]>,
    /// The right eye's pixels that show the surfaces of the left eye's, if rivalry between the eyes is wanted.
    pub in_right: Option<Vec<Sighting>>,
    /// Key of the reference in the journal: its samples per pixel, or the hashes of supplied images.
    pub key: String,
}

/// Reads the reference's images in a folder.
pub fn given(folder: &Path, options: &RunOptions) -> Result<Reference, Failure> {
    let read = |name: &str| -> Result<RgbImage, Failure> {
        let path = folder.join(name);
        let image = exr::read_rgb(&path).map_err(|e| Failure::Input(e.into()))?;
        if image.extent != options.settings.size {
            let what = format!(
                "{} is {}, not {}: give its size as --size",
                path.display(),
                image.extent,
                options.settings.size
            );
            return Err(Failure::Input(anyhow::anyhow!(what)));
        }
        Ok(image)
    };
    let images = PerView::both(read("left.exr")?, read("right.exr")?);
    let key = [images.left(), images.right()].map(|image| hash_of(bytemuck::cast_slice(&image.pixels)));
    let origin = format!("{}; its noise is unknown, and errors below it mean nothing", folder.display());
    Ok(Reference { images, noise: None, origin, kinds: None, in_right: None, key: key.join(" ") })
}

/// A reference to render.
pub struct Wanted<'a> {
    pub options: &'a RunOptions,
    /// Virtual devices on each adapter.
    pub virtual_devices: u16,
    pub spp: u32,
    pub bounces: u32,
    pub time_limit: Duration,
    /// Folder that keeps references for later runs.
    pub kept: PathBuf,
}

impl<'a> Wanted<'a> {
    /// Returns the reference for the grid of `bench`.
    pub fn of_grid(args: &'a Args) -> Result<Self, Failure> {
        let judged = args.judged()?;
        let options = &args.options;
        Ok(Self {
            options,
            virtual_devices: args.virtual_devices,
            spp: args.reference_spp.unwrap_or(if args.quick { 256 } else { 1024 }),
            bounces: args.bounces().into_iter().chain(judged.iter().map(|k| k.bounces)).max().unwrap_or(0),
            time_limit: reference_time(&args.options.settings),
            kept: args.reference_dir.clone().unwrap_or_else(|| options.out.join("reference")),
        })
    }

    /// Returns the plan for rendering the reference.
    pub fn plan(&self) -> Result<Plan, Failure> {
        let seed = if self.options.settings.seed == SEED { !SEED } else { SEED };
        let mut run = self.options.clone();
        (run.settings.seed, run.settings.sampler) = (seed, Sampler::default());
        let quality = Quality { bounces: self.bounces, ..Quality::default() };
        Plan::new(RenderOptions::new(run, quality), self.spp, PASS_SPP, Some(self.time_limit))
    }
}

/// Returns the time limit of a reference.
pub fn reference_time(settings: &Settings) -> Duration {
    settings.time_limit().unwrap_or(Duration::from_secs(600))
}

/// Returns the stored reference for this shot and these settings. Renders or resumes it if it has too few samples,
/// unless the journal has measurements against it.
pub fn own(
    wanted: &Wanted,
    loaded: &LoadedScene,
    tracing: &Tracing,
    journal: Option<&Journal>,
) -> Result<Reference, Failure> {
    let options = wanted.options;
    let mut plan = wanted.plan()?;
    let folder = plan.keep_below(&wanted.kept, loaded);
    plan.prepare(loaded, "--reference-cache")?;
    let begun = plan.begun(loaded, 0)?;
    let key = |samples: u32| format!("{samples} spp");
    let (accumulation, how) = if begun.samples() >= plan.spp || journal.is_some_and(|j| j.knows(&key(begun.samples())))
    {
        let how = format!("{} samples per pixel, kept from an earlier run", begun.samples());
        (begun, how)
    } else {
        let gpus = setup::open_devices(options, usize::from(wanted.virtual_devices))?;
        let mut renderer = setup::renderer(&plan.options, loaded, gpus, tracing.recorder.origin())?;
        let done = plan.accumulate(&mut renderer, loaded, 0, begun, tracing)?;
        // Its samples so far are kept for the next run.
        interrupt::check()?;
        (done.accumulation, done.row.to_string())
    };
    let images = accumulation.mean();
    let tags =
        output::tags(&loaded.shot.rig, loaded.shot.exposure_ev, options.settings.size, plan.options.time_s(0), 0);
    exr::write_tagged_rgb(&folder.join("left.exr"), images.left(), tags.left())?;
    exr::write_tagged_rgb(&folder.join("right.exr"), images.right(), tags.right())?;
    let (origin, key) = (format!("{how}, in {}", folder.display()), key(accumulation.samples()));
    Ok(Reference { images, noise: accumulation.noise(), origin, kinds: None, in_right: None, key })
}
