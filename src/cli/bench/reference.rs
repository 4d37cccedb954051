//! References for a grid of settings: images that you supply, or rendered images, which later runs reuse.

use std::path::Path;

use crate::accumulation::{Noise, hash_of};
use crate::exec::Stereo;
use crate::frame::Sampler;
use crate::image::{Extent, RgbImage, exr};
use crate::loaded::LoadedScene;
use crate::metrics::kinds::KindMap;
use crate::metrics::surfaces::Sighting;
use crate::quality::Quality;

use super::args::Args;
use super::journal::Journal;
use crate::cli::failure::Failure;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::output;
use crate::cli::reference::{PASS_SPP, PassOptions, Plan};
use crate::cli::setup::{self, Tracing};

/// Seed of references, so that they share no random numbers with the images that are compared with them.
const SEED: u32 = 0x5eed_0001;

/// Ground-truth images, up to their noise.
pub struct Reference {
    pub images: Stereo<RgbImage>,
    /// Noise of a rendered reference; `None` for supplied images.
    pub noise: Option<Stereo<Noise>>,
    /// Origin of the images in words, for reports.
    pub origin: String,
    /// Kinds of each eye's pixels, if errors by kind are wanted.
    pub kinds: Option<[KindMap; 2]>,
    /// The right eye's pixels that show the surfaces of the left eye's, if rivalry between the eyes is wanted.
    pub in_right: Option<Vec<Sighting>>,
    /// Key of the reference in the journal: its samples per pixel, or the hashes of supplied images.
    pub key: String,
}

impl Reference {
    /// Returns a frame as the reference of other frames.
    pub fn of_frame(images: Stereo<RgbImage>) -> Self {
        Self { images, noise: None, origin: String::new(), kinds: None, in_right: None, key: String::new() }
    }

    /// Returns a sentence that names the shot, the size, the origin and the noise of the reference.
    pub fn note(&self, shot: &str, size: Extent) -> String {
        let noise = self.noise.as_ref().map_or(String::new(), |noise| format!("; its own noise: {noise}"));
        format!("Reference of {shot} at {size}: {}{noise}.", self.origin)
    }
}

/// Reads the images that the options name, or renders a reference.
pub fn find(args: &Args, loaded: &LoadedScene, tracing: &Tracing, journal: &Journal) -> Result<Reference, Failure> {
    match &args.reference {
        Some(folder) => given(folder, &args.options),
        None => own(args, loaded, tracing, Some(journal)),
    }
}

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
    let images = Stereo { left: read("left.exr")?, right: read("right.exr")? };
    let key = [&images.left, &images.right].map(|image| hash_of(bytemuck::cast_slice(&image.pixels)));
    let origin = format!("{}; its noise is unknown, and errors below it mean nothing", folder.display());
    Ok(Reference { images, noise: None, origin, kinds: None, in_right: None, key: key.join(" ") })
}

/// Returns the plan for rendering a reference.
pub fn plan(args: &Args) -> Result<Plan, Failure> {
    let options = &args.options;
    let seed = if options.settings.seed == SEED { !SEED } else { SEED };
    let mut run = options.clone();
    (run.settings.seed, run.settings.sampler) = (seed, Sampler::default());
    let passes = PassOptions { time_limit: Some(args.reference_time_limit), passes_out: None, pass_spp: PASS_SPP };
    let spp = args.reference_spp.unwrap_or(if args.quick { 256 } else { 1024 });
    let judged = args.judged()?;
    let bounces = args.bounces().into_iter().chain(judged.iter().map(|k| k.bounces)).max().unwrap_or(0);
    Plan::new(RenderOptions::new(run, Quality { bounces, ..Quality::default() }), spp, passes)
}

/// Returns the stored reference for this shot and these settings. Renders or resumes it if it has too few samples,
/// unless the journal has measurements against it.
pub fn own(
    args: &Args,
    loaded: &LoadedScene,
    tracing: &Tracing,
    journal: Option<&Journal>,
) -> Result<Reference, Failure> {
    let options = &args.options;
    let mut plan = plan(args)?;
    let kept = args.reference_dir.clone().unwrap_or_else(|| options.out.join("reference"));
    let folder = plan.keep_below(&kept, loaded);
    plan.prepare(loaded, "--reference-cache")?;
    let begun = plan.begun(loaded, 0)?;
    let key = |samples: u32| format!("{samples} spp");
    let (accumulation, how) =
        if begun.samples() >= plan.spp() || journal.is_some_and(|j| j.knows(&key(begun.samples()))) {
            let how = format!("{} samples per pixel, kept from an earlier run", begun.samples());
            (begun, how)
        } else {
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            let mut renderer = setup::renderer(&plan.options, loaded, gpus, tracing.recorder.origin())?;
            let done = plan.accumulate(&mut renderer, loaded, 0, begun, tracing)?;
            (done.accumulation, done.row.to_string())
        };
    let images = accumulation.mean();
    let tags = output::tags(&loaded.shot.rig, loaded.shot.exposure_ev, options.settings.size, plan.time_s(0), 0);
    exr::write_tagged_rgb(&folder.join("left.exr"), &images.left, &tags.left)?;
    exr::write_tagged_rgb(&folder.join("right.exr"), &images.right, &tags.right)?;
    let (origin, key) = (format!("{how}, in {}", folder.display()), key(accumulation.samples()));
    Ok(Reference { images, noise: accumulation.noise(), origin, kinds: None, in_right: None, key })
}
