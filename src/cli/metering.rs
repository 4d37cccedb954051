//! Metering: the exposure that shows a scene well, from the radiances of a small frame.

use std::time::Instant;

use crate::exec::ranks::Devices;
use crate::image::{Extent, RgbImage};
use crate::loaded::LoadedScene;
use crate::quality::Quality;
use crate::scene::shot::EXPOSURE_EV;
#[cfg(feature = "view")]
use crate::scene::shot::Shot;
use crate::scene::{Scene, studio};

use super::failure::Failure;
use super::options::RenderOptions;
use super::progress::Progress;
use super::setup;

/// Meters the first frame if the shot asks for it, sets the shot's exposure and prints it. Returns the devices, which
/// keep the pipelines that metering compiled.
pub fn meter(
    options: &RenderOptions,
    loaded: &mut LoadedScene,
    gpus: Devices,
    progress: &Progress,
) -> Result<Devices, Failure> {
    if !loaded.shot.is_metered {
        return Ok(gpus);
    }
    progress.phase("metering");
    let mut gpus = gpus;
    for _ in 0..MOST_FRAMES {
        let before_ev = loaded.shot.exposure_ev;
        let options = small(options);
        let mut renderer = setup::renderer(&options, loaded, gpus, Instant::now())?;
        renderer.render(&renderer.frame(&loaded.shot.rig, options.time, 0))?;
        let image = renderer.read_linear()?.left;
        gpus = renderer.into_devices();
        loaded.shot.exposure_ev = wanted_ev(&loaded.scene, &image);
        // Half floats clip light that is far too bright for the exposure of its frame.
        if loaded.shot.exposure_ev - before_ev > CLIPPED_EV {
            break;
        }
    }
    let ev = loaded.exposure_ev();
    if options.json {
        progress.event(|| serde_json::json!({ "event": "exposure", "exposure_ev": ev }));
    } else if !options.quiet {
        progress.tell(&format!("metered exposure: {ev:+} EV (--exposure {ev} repeats it)"));
    }
    Ok(gpus)
}

/// A meter that follows the light of a moving camera slowly, as an eye does.
#[cfg(feature = "view")]
#[derive(Clone, Copy, Debug)]
pub struct SlowMeter {
    first_ev: f32,
    ev: f32,
}

#[cfg(feature = "view")]
impl SlowMeter {
    /// Number of frames from one metered frame to the next.
    pub const INTERVAL: u32 = 8;
    /// Times after which 1 - 1/e of a change is made up for, seconds: in more light and in less.
    const BRIGHTER_S: f32 = 0.4;
    const DARKER_S: f32 = 1.0;
    /// Maximum difference from the exposure of the first frame, at which half floats store radiance.
    const MOST_TURNED_EV: f32 = 10.0;

    /// Starts at the metered exposure of a shot; `None` if the shot is not metered.
    pub fn new(shot: &Shot) -> Option<Self> {
        let ev = shot.exposure_ev;
        shot.is_metered.then_some(Self { first_ev: ev, ev })
    }

    /// Takes the radiances of a frame, `passed_s` seconds after the last, and returns the exposure of the next frames.
    pub fn follow(&mut self, scene: &Scene, image: &RgbImage, passed_s: f32) -> f32 {
        let wanted = wanted_ev(scene, image);
        let wanted = wanted.clamp(self.first_ev - Self::MOST_TURNED_EV, self.first_ev + Self::MOST_TURNED_EV);
        let slowness_s = if wanted < self.ev { Self::BRIGHTER_S } else { Self::DARKER_S };
        self.ev += (wanted - self.ev) * (1.0 - (-passed_s / slowness_s).exp());
        self.ev
    }
}

/// Returns the exposure that shows a frame of the scene well.
fn wanted_ev(scene: &Scene, image: &RgbImage) -> f32 {
    if studio::has_ground(scene) { studio_ev(image) } else { metered_ev(image) }
}

/// Maximum number of frames that are metered, and the exposure below which the last one may have been clipped.
const MOST_FRAMES: usize = 2;
const CLIPPED_EV: f32 = -10.0;

/// Minimum width of the metered frame, and the factor by which it is narrower than the frames of the run.
const LEAST_WIDTH: u32 = 64;
const REDUCTION: u32 = 4;

/// Returns the options of a small frame without foveation or injected faults.
fn small(options: &RenderOptions) -> RenderOptions {
    let mut run = options.run.clone();
    let Extent { width, height } = run.size;
    let narrow = (width / REDUCTION).max(LEAST_WIDTH).min(width);
    run.size = Extent::new(narrow, (height * narrow / width).max(1));
    run.faults.disturbances.clear();
    run.faults.slowdown.clear();
    RenderOptions::single(run, &Quality { fovea: None, polar: None, scale: 1.0, ..options.quality() })
}

/// Side of the blocks whose means are metered, pixels. Means of blocks are less noisy than pixels.
const BLOCK: usize = 4;
/// Fraction of width and height that the metered middle takes.
const MIDDLE: f32 = 0.75;
const MID_GREY: f64 = 0.22;
/// Maximum radiance after exposure of all but the brightest [`HIGHLIGHTS`] of the blocks, and the maximum number of
/// stops by which they lower the exposure. A window may stay too bright.
const BRIGHTEST: f64 = 1.2;
const HIGHLIGHTS: f64 = 0.03;
const MOST_LOWERED_EV: f64 = 1.5;

/// Returns the exposure that makes the geometric mean of the middle mid-grey, or less to protect highlights.
fn metered_ev(image: &RgbImage) -> f32 {
    let mut blocks = middle(image);
    blocks.sort_by(f64::total_cmp);
    let lit: Vec<f64> = blocks.iter().copied().filter(|radiance| *radiance > 0.0).collect();
    let Some(brightest) = lit.last() else { return 0.0 };
    // Black surroundings of an object say nothing about its light.
    let counted = lit.iter().filter(|radiance| **radiance > 1e-4 * brightest).map(|radiance| radiance.log2());
    let (sum, count) = counted.fold((0.0, 0.0), |(sum, count), log| (sum + log, count + 1.0));
    let ev = MID_GREY.log2() - sum / count;
    let highlight = blocks[((1.0 - HIGHLIGHTS) * (blocks.len() - 1) as f64) as usize];
    let protected = if highlight > 0.0 { (BRIGHTEST / highlight).log2() } else { ev };
    rounded(ev.min(protected.max(ev - MOST_LOWERED_EV)))
}

/// Returns the exposure of an object in the studio. Its light is known, so that white stays white at 0 EV; dark objects
/// get some more.
fn studio_ev(image: &RgbImage) -> f32 {
    const FRACTION: f32 = 0.35;
    const MOST_EV: f32 = 0.6;
    rounded(f64::from((metered_ev(image) * FRACTION).clamp(0.0, MOST_EV)))
}

/// Rounds to hundredths of a stop, within the allowed exposures.
fn rounded(ev: f64) -> f32 {
    ((ev * 100.0).round() / 100.0).clamp(*EXPOSURE_EV.start(), *EXPOSURE_EV.end()) as f32
}

/// Returns the mean radiances of the blocks in the middle of the image.
fn middle(image: &RgbImage) -> Vec<f64> {
    let [width, height] = [image.extent.width, image.extent.height].map(|side| side as usize);
    let range = |side: usize| {
        let margin = (side as f32 * (1.0 - MIDDLE) / 2.0) as usize;
        margin..side - margin
    };
    let mut blocks = Vec::new();
    for top in range(height).step_by(BLOCK) {
        for left in range(width).step_by(BLOCK) {
            let rows = top..(top + BLOCK).min(range(height).end);
            let pixels = rows.flat_map(|y| (left..(left + BLOCK).min(range(width).end)).map(move |x| y * width + x));
            let values: Vec<f64> =
                pixels.map(|i| image.pixels[i].iter().map(|c| f64::from(*c)).sum::<f64>() / 3.0).collect();
            blocks.push(values.iter().sum::<f64>() / values.len() as f64);
        }
    }
    blocks.retain(|radiance| radiance.is_finite());
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    fn filled(radiance: f32) -> RgbImage {
        Image::filled(Extent::new(64, 48), [radiance; 3])
    }

    #[test]
    fn an_even_picture_becomes_mid_grey_in_any_unit() {
        for (radiance, expected) in [(0.22, 0.0), (0.22 * 1024.0, -10.0), (0.055, 2.0), (0.0, 0.0), (1e-12, 24.0)] {
            assert_eq!(metered_ev(&filled(radiance)), expected, "{radiance}");
        }
    }

    #[test]
    fn the_middle_counts_and_highlights_are_protected() {
        let mut image = filled(0.22);
        image.pixels[..64].fill([1e4; 3]);
        assert_eq!(metered_ev(&image), 0.0, "the border is bright");
        // The upper third of the picture is a window.
        let mut image = filled(0.02);
        image.pixels[..64 * 16].fill([0.6; 3]);
        assert!((metered_ev(&image) - 1.0).abs() < 0.05, "{}", metered_ev(&image));
        image.pixels[..64 * 16].fill([60.0; 3]);
        let plain = filled(0.02);
        assert!(metered_ev(&image) > metered_ev(&plain) - 6.0);
    }

    #[cfg(feature = "view")]
    #[test]
    fn a_slow_meter_follows_light_faster_than_darkness_and_then_rests() {
        let scene = Scene::empty("metered");
        let after = |radiance: f32, seconds: f32| {
            let mut meter = SlowMeter { first_ev: 0.0, ev: 0.0 };
            let steps = (seconds * 10.0) as usize;
            (0..steps).map(|_| meter.follow(&scene, &filled(0.22 * radiance), 0.1)).last().unwrap()
        };
        let (bright, dark) = (after(16.0, 0.4), after(1.0 / 16.0, 0.4));
        assert!((-2.6..-2.5).contains(&bright), "{bright}");
        assert!((1.25..1.35).contains(&dark), "{dark}");
        assert!((after(16.0, 5.0) + 4.0).abs() < 0.01 && (after(1.0 / 16.0, 10.0) - 4.0).abs() < 0.01);
        assert!((after(1e-6, 60.0) - SlowMeter::MOST_TURNED_EV).abs() < 0.01);
    }

    #[test]
    fn white_stays_white_in_the_studio_and_black_gets_more_light() {
        assert_eq!(studio_ev(&filled(0.8)), 0.0);
        assert!((0.3..=0.6).contains(&studio_ev(&filled(0.03))));
    }
}
