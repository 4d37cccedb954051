//! Auxiliary images that determine the kinds of pixels, and which pixels of the eyes show the same surface.

use diptych::exec::ranks::Devices;
use diptych::image::{Image, RgbImage};
use diptych::loaded::LoadedScene;
use diptych::metrics::kinds::{Guides, KindMap};
use diptych::metrics::surfaces::{Sighting, Surfaces};
use diptych::passes::Aov;
use diptych::quality::Quality;
use diptych::scene::rig::Eye;

use super::failure::Failure;
use super::options::{RenderOptions, RunOptions};
use super::setup::{self, Tracing};
use diptych::exec::PerView;

/// Auxiliary images of [`Guides`], in the order of its fields.
pub const AOVS: [Aov; 6] =
    [Aov::Depth, Aov::Normal, Aov::BaseColor, Aov::DiffuseAlbedo, Aov::SpecularAlbedo, Aov::Roughness];

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

/// Properties of pixels that auxiliary images tell.
pub struct Seen {
    /// Kinds of each eye's pixels.
    pub kinds: Option<[KindMap; 2]>,
    /// The right eye's pixels that show the surfaces of the left eye's.
    pub in_right: Vec<Sighting>,
}

/// Renders auxiliary images of a shot. Classifies the pixels of both eyes' references if `by_kind`. Returns the devices,
/// too.
pub fn of_shot(
    run: &RunOptions,
    loaded: &LoadedScene,
    reference: &PerView<RgbImage>,
    by_kind: bool,
    gpus: Devices,
    tracing: &Tracing,
) -> Result<(Seen, Devices), Failure> {
    let mut aovs = if by_kind { AOVS.to_vec() } else { Vec::new() };
    aovs.extend([Aov::ShownPosition, Aov::ShownNormal, Aov::VirtualPosition]);
    // The cheapest frames, since auxiliary images do not depend on light, with all the mirrors and panes that a chain may
    // have.
    let quality = Quality { bounces: 8, filter: None, ..Quality::default() };
    let options = RenderOptions { aovs: aovs.clone(), ..RenderOptions::new(run.clone(), quality) };
    let mut renderer = setup::renderer(&options, loaded, gpus, tracing.recorder.origin())?;
    let frame = renderer.frame(&loaded.shot.rig, options.settings.time, 0);
    let pixel_centre = renderer.render(&frame)?.pixel_centre;
    let mut images: [Vec<RgbImage>; 2] = Default::default();
    for i in 0..aovs.len() {
        for (images, channels) in images.iter_mut().zip(renderer.read_aov(i)?) {
            let last = channels.len() - 1;
            let pixel = |p: usize| [0, 1, 2].map(|c: usize| channels[c.min(last)][p]);
            images
                .push(Image { extent: run.settings.size, pixels: (0..run.settings.size.area()).map(pixel).collect() });
        }
    }
    let image = |eye: usize, aov: Aov| -> Result<RgbImage, Failure> {
        let at = aovs.iter().position(|other| *other == aov);
        let missing = || anyhow::anyhow!("the auxiliary image '{}' is missing", aov.name());
        Ok(at.map(|at| images[eye][at].clone()).ok_or_else(missing)?)
    };
    let (exposure_ev, yfov_deg) = (loaded.shot.exposure_ev, loaded.shot.rig.yfov_rad.to_degrees());
    let map = |eye: usize, reference: &RgbImage| -> Result<KindMap, Failure> {
        Ok(KindMap::new(&guides(|aov| image(eye, aov))?, reference, exposure_ev, yfov_deg)?)
    };
    let kinds = if by_kind { Some([map(0, reference.left())?, map(1, reference.right())?]) } else { None };
    let surfaces = |eye| -> Result<Surfaces, Failure> {
        let shown = Surfaces::new(image(eye, Aov::ShownPosition)?, image(eye, Aov::ShownNormal)?)?;
        Ok(shown.seen_at(image(eye, Aov::VirtualPosition)?)?)
    };
    let world_to_ndc = loaded.shot.rig.matrices(options.settings.time, Eye::RIGHT, run.settings.size).world_to_ndc;
    let in_right = surfaces(0)?.in_other_eye(&surfaces(1)?, &world_to_ndc, pixel_centre)?;
    Ok((Seen { kinds, in_right }, renderer.into_devices()))
}
