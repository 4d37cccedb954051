//! Number of samples for a wanted noise, from a small frame.

use std::time::Instant;

use diptych::accumulation::{Accumulation, Noise};
use diptych::exec::PerView;
use diptych::exec::ranks::Devices;
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::samples::Samples;

use crate::failure::Failure;
use crate::metering;
use crate::options::RenderOptions;
use crate::progress::Progress;
use crate::reference::{PASS_SPP, Plan};
use crate::setup;

/// Passes of the small frame. The estimate compares even with odd ones.
const PASSES: u32 = 4;

/// Returns the number of samples per pixel, at most `most`, at which the samples have the noise `wanted`: the root of
/// their relMSE in the worse eye, at the shot's exposure. Also returns the devices, which keep compiled pipelines.
///
/// A frame of a quarter of the width shows the noise of [`PASSES`] passes. Noise falls with the root of the number of
/// samples; it falls faster with those of a Sobol' sequence, so the picture is rather less noisy than wanted.
pub fn samples_for(
    wanted: f64,
    most: u32,
    options: &RenderOptions,
    loaded: &LoadedScene,
    gpus: Devices,
    progress: &Progress,
) -> Result<(Devices, u32), Failure> {
    const PHASE: &str = "estimating noise";
    progress.phase(PHASE);
    let plan = Plan::new(metering::small(options), PASSES * PASS_SPP, PASS_SPP, None)?;
    let mut renderer = setup::renderer(&plan.options, loaded, gpus, Instant::now())?;
    let mut sum = Accumulation::new(plan.options.settings.size, loaded.shot.rig.views);
    let gain = loaded.shot.exposure_ev.exp2();
    for pass in 0..PASSES {
        let params = renderer.frame(&loaded.shot.rig, options.settings.time, 0);
        let first = pass * PASS_SPP;
        renderer.render_samples_watched(&params, first..first + PASS_SPP, |fraction| {
            progress.phase_part(PHASE, (f64::from(pass) + fraction) / f64::from(PASSES));
        })?;
        let mut images = renderer.read_linear()?;
        images.iter_mut().for_each(|image| expose(image, gain));
        sum.add(pass, &images, PASS_SPP, 0);
    }
    let spp = sum.noise().map_or(most, |noise| needed(wanted, &noise, sum.samples(), most));
    tell(options, progress, wanted, spp, most);
    Ok((renderer.into_devices(), spp))
}

fn expose(image: &mut RgbImage, gain: f32) {
    image.pixels.as_flattened_mut().iter_mut().for_each(|c| *c *= gain);
}

/// Returns the number of samples with the noise `wanted` if `samples` samples have the noise `noise`.
fn needed(wanted: f64, noise: &PerView<Noise>, samples: u32, most: u32) -> u32 {
    let relmse = noise.iter().map(|noise| noise.relmse).fold(0.0, f64::max);
    let spp = (f64::from(samples) * relmse / (wanted * wanted)).ceil();
    // A conversion to an integer saturates.
    (spp as u32).clamp(*Samples::VALID.start(), most)
}

fn tell(options: &RenderOptions, progress: &Progress, wanted: f64, spp: u32, most: u32) {
    if options.json {
        progress.event(|| serde_json::json!({ "event": "noise", "noise": wanted, "spp": spp, "spp_most": most }));
    } else if !options.quiet {
        let bound = if spp == most { ", the most allowed (--spp)" } else { "" };
        progress.tell(&format!("noise {wanted} takes about {spp} samples per pixel{bound}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_grow_with_the_square_of_noise() {
        let noise = |relmse| PerView::both(Noise { rmse: 1.0, relmse: 0.01 }, Noise { rmse: 1.0, relmse });
        let spp = |wanted, relmse| needed(wanted, &noise(relmse), 32, 4096);
        assert_eq!([spp(0.2, 0.04), spp(0.1, 0.04), spp(0.1, 0.0)], [32, 128, 32]);
        assert_eq!([spp(1e-9, 0.04), spp(1e9, 0.04), spp(0.1, f64::INFINITY)], [4096, 1, 4096]);
    }
}
