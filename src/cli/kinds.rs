//! Auxiliary images that determine the kinds of pixels.

use crate::exec::ranks::Devices;
use crate::image::{Image, RgbImage};
use crate::loaded::LoadedScene;
use crate::metrics::kinds::{Guides, KindMap};
use crate::passes::Aov;
use crate::quality::Quality;

use super::failure::Failure;
use super::options::{RenderOptions, RunOptions};
use super::setup::{self, Tracing};
use crate::exec::Stereo;

/// Auxiliary images of [`Guides`], in the order of its fields.
pub const AOVS: [Aov; 6] =
    [Aov::Depth, Aov::Normal, Aov::BaseColor, Aov::DiffuseAlbedo, Aov::SpecularAlbedo, Aov::Roughness];

/// Quality at which auxiliary images are rendered: the cheapest, since they do not depend on light.
const QUALITY: Quality =
    Quality { spp: 1, bounces: 0, denoiser: None, iterations: [0; 3], fovea: None, polar: None, scale: 1.0 };

/// Collects the images that `read` returns for each of [`AOVS`].
pub fn guides<E>(mut read: impl FnMut(Aov) -> Result<RgbImage, E>) -> Result<Guides, E> {
    let [depth, normal, base_color, diffuse_albedo, specular_albedo, roughness] = AOVS;
    Ok(Guides {
        depth: read(depth)?,
        normal: read(normal)?,
        base_color: read(base_color)?,
        diffuse_albedo: read(diffuse_albedo)?,
        specular_albedo: read(specular_albedo)?,
        roughness: read(roughness)?,
    })
}

/// Renders the auxiliary images of a shot and classifies the pixels of both eyes' references. Returns the devices, too.
pub fn of_shot(
    run: &RunOptions,
    loaded: &LoadedScene,
    reference: &Stereo<RgbImage>,
    gpus: Devices,
    tracing: &Tracing,
) -> Result<([KindMap; 2], Devices), Failure> {
    let options = RenderOptions { aov: AOVS.to_vec(), ..RenderOptions::single(run.clone(), &QUALITY) };
    let mut renderer = setup::renderer(&options, loaded, gpus, tracing.recorder.origin())?;
    let frame = renderer.frame(&loaded.shot.rig, options.time, 0);
    renderer.render(&frame)?;
    let mut images: [Vec<RgbImage>; 2] = Default::default();
    for i in 0..AOVS.len() {
        let Stereo { left, right } = renderer.read_aov(i)?;
        for (images, channels) in images.iter_mut().zip([left, right]) {
            let last = channels.len() - 1;
            let pixel = |p: usize| [0, 1, 2].map(|c: usize| channels[c.min(last)][p]);
            images.push(Image { extent: run.size, pixels: (0..run.size.area()).map(pixel).collect() });
        }
    }
    let (exposure_ev, yfov_deg) = (loaded.shot.exposure_ev, loaded.shot.rig.yfov_rad.to_degrees());
    let map = |images: &mut Vec<RgbImage>, reference: &RgbImage| -> Result<KindMap, Failure> {
        let mut images = images.drain(..);
        let guides = guides(|_| images.next().ok_or_else(|| anyhow::anyhow!("an auxiliary image is missing")))?;
        Ok(KindMap::new(&guides, reference, exposure_ev, yfov_deg)?)
    };
    let [left, right] = &mut images;
    Ok(([map(left, &reference.left)?, map(right, &reference.right)?], renderer.into_devices()))
}
