//! Metering: the exposure that shows a scene well, from the radiances of a small frame.

use std::time::Instant;

use diptych::exec::ranks::Devices;
use diptych::image::{Extent, RgbImage};
use diptych::loaded::LoadedScene;
use diptych::quality::Quality;
use diptych::scene::shot::EXPOSURE_EV;
#[cfg(feature = "view")]
use diptych::scene::shot::Shot;
use diptych::scene::{Scene, studio};

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
        let params = renderer.frame(&loaded.shot.rig, options.settings.time, 0);
        renderer.render_watched(&params, None, |fraction| progress.phase_part("metering", fraction))?;
        let image = renderer.read_linear()?.into_left();
        gpus = renderer.into_devices();
        loaded.shot.exposure_ev = wanted_ev(&loaded.scene, &image).unwrap_or(0.0);
        // Half floats clip light that is far too bright for the exposure of its frame.
        if loaded.shot.exposure_ev - before_ev > CLIPPED_EV {
            break;
        }
    }
    let ev = loaded.exposure_ev();
    if options.json {
        progress.event(|| serde_json::json!({ "event": "exposure", "exposure_ev": ev }));
    } else if !options.quiet {
        progress.tell(&format!("metered exposure: {ev:+} EV (--set exposure={ev} repeats it)"));
    }
    Ok(gpus)
}

/// Eye adaptation: the exposure of a moving camera's frames, which follows the light with a delay.
#[cfg(feature = "view")]
#[derive(Debug)]
pub struct Adaptation {
    /// Exposure of the first frame, in stops.
    first_ev: f32,
    /// Exposure of the current frame, and that of its light.
    ev: f32,
    wanted_ev: f32,
}

#[cfg(feature = "view")]
impl Adaptation {
    /// Number of frames from one metered frame to the next.
    pub const INTERVAL: u32 = 8;
    /// Time constants of the adaptation to more and to less light, seconds.
    const BRIGHTER_S: f64 = 0.4;
    const DARKER_S: f64 = 1.0;
    /// Least and greatest change of the first frame's exposure, in stops. Half floats store radiance at that exposure,
    /// so they would clip highlights below, and lose dark surfaces above.
    const RANGE_EV: [f32; 2] = [-10.0, 4.0];

    /// Starts at the metered exposure of a shot; `None` if the shot is not metered.
    pub fn new(shot: &Shot) -> Option<Self> {
        let ev = shot.exposure_ev;
        shot.is_metered.then_some(Self { first_ev: ev, ev, wanted_ev: ev })
    }

    /// Returns the exposure of the next frame, `passed_s` seconds after the last one.
    pub fn next_ev(&mut self, passed_s: f64) -> f32 {
        let time_s = if self.wanted_ev < self.ev { Self::BRIGHTER_S } else { Self::DARKER_S };
        self.ev += (self.wanted_ev - self.ev) * (1.0 - (-passed_s / time_s).exp()) as f32;
        self.ev
    }

    /// Meters the radiances of a frame. A black frame changes nothing.
    pub fn meter(&mut self, scene: &Scene, image: &RgbImage) {
        let [least, most] = Self::RANGE_EV.map(|change| self.first_ev + change);
        self.wanted_ev = wanted_ev(scene, image).map_or(self.wanted_ev, |ev| ev.clamp(least, most));
    }
}

/// Returns the exposure for the light of a frame; `None` if the frame is black.
fn wanted_ev(scene: &Scene, image: &RgbImage) -> Option<f32> {
    let ev = metered_ev(image)?;
    Some(if studio::has_ground(scene) { studio_ev(ev) } else { ev })
}

/// Maximum number of frames that are metered, and the exposure below which the last one may have been clipped.
const MOST_FRAMES: usize = 2;
const CLIPPED_EV: f32 = -10.0;

/// Minimum width of the metered frame, and the factor by which it is narrower than the frames of the run.
const LEAST_WIDTH: u32 = 64;
const REDUCTION: u32 = 4;

/// Returns the options of a small frame without foveation or injected faults.
pub fn small(options: &RenderOptions) -> RenderOptions {
    let mut run = options.run.clone();
    let Extent { width, height } = run.settings.size;
    let narrow = (width / REDUCTION).max(LEAST_WIDTH).min(width);
    run.settings.size = Extent::new(narrow, (height * narrow / width).max(1));
    run.settings.disturb.clear();
    run.settings.slowdown.clear();
    RenderOptions::new(run, Quality { fovea: None, polar: None, scale: 1.0, ..options.quality() })
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

/// Returns the exposure that makes the geometric mean of the middle mid-grey, or less to protect highlights; `None` if
/// the middle is black.
fn metered_ev(image: &RgbImage) -> Option<f32> {
    let mut blocks = middle(image);
    blocks.sort_by(f64::total_cmp);
    let lit: Vec<f64> = blocks.iter().copied().filter(|radiance| *radiance > 0.0).collect();
    let brightest = lit.last()?;
    // Black surroundings of an object say nothing about its light.
    let counted = lit.iter().filter(|radiance| **radiance > 1e-4 * brightest).map(|radiance| radiance.log2());
    let (sum, count) = counted.fold((0.0, 0.0), |(sum, count), log| (sum + log, count + 1.0));
    let ev = MID_GREY.log2() - sum / count;
    let highlight = blocks[((1.0 - HIGHLIGHTS) * (blocks.len() - 1) as f64) as usize];
    let protected = if highlight > 0.0 { (BRIGHTEST / highlight).log2() } else { ev };
    Some(rounded(ev.min(protected.max(ev - MOST_LOWERED_EV))))
}

/// Returns the exposure of an object in the studio from the metered one. The studio's light is known, so that white stays
/// white at 0 EV; dark objects get some more.
fn studio_ev(metered_ev: f32) -> f32 {
    const FRACTION: f32 = 0.35;
    const MOST_EV: f32 = 0.6;
    rounded(f64::from((metered_ev * FRACTION).clamp(0.0, MOST_EV)))
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
    use diptych::image::Image;

    fn filled(radiance: f32) -> RgbImage {
        Image::filled(Extent::new(64, 48), [radiance; 3])
    }

    #[test]
    fn even_picture_is_metered_as_mid_grey() {
        for (radiance, expected) in [(0.22, 0.0), (0.22 * 1024.0, -10.0), (0.055, 2.0), (1e-12, 24.0)] {
            assert_eq!(metered_ev(&filled(radiance)), Some(expected), "{radiance}");
        }
        for radiance in [0.0, f32::NAN] {
            assert_eq!(metered_ev(&filled(radiance)), None, "{radiance}");
        }
    }

    #[test]
    fn metering_weighs_the_middle_and_spares_highlights() {
        let mut image = filled(0.22);
        image.pixels[..64].fill([1e4; 3]);
        assert_eq!(metered_ev(&image), Some(0.0), "the border is bright");
        // The upper third of the picture is a window.
        let mut image = filled(0.02);
        image.pixels[..64 * 16].fill([0.6; 3]);
        let ev_of = |image: &RgbImage| metered_ev(image).unwrap();
        assert!((ev_of(&image) - 1.0).abs() < 0.05, "{}", ev_of(&image));
        image.pixels[..64 * 16].fill([60.0; 3]);
        let plain = filled(0.02);
        assert!(ev_of(&image) > ev_of(&plain) - 6.0);
    }

    #[cfg(feature = "view")]
    #[test]
    fn adaptation_to_light_is_faster_than_to_dark() {
        let scene = Scene::empty("metered");
        let after = |radiance: f32, steps: usize| {
            let mut eye = Adaptation { first_ev: 0.0, ev: 0.0, wanted_ev: 0.0 };
            eye.meter(&scene, &filled(0.22 * radiance));
            eye.meter(&scene, &filled(0.0));
            (0..steps).map(|_| eye.next_ev(0.1)).last().unwrap()
        };
        let (bright, dark) = (after(16.0, 4), after(1.0 / 16.0, 4));
        assert!((-2.6..-2.5).contains(&bright), "{bright}");
        assert!((1.25..1.35).contains(&dark), "{dark}");
        assert!((after(16.0, 50) + 4.0).abs() < 0.01 && (after(1.0 / 16.0, 100) - 4.0).abs() < 0.01);
        let [least, most] = Adaptation::RANGE_EV;
        assert!((after(1e9, 200) - least).abs() < 0.01 && (after(1e-6, 200) - most).abs() < 0.01);
    }

    #[test]
    fn studio_keeps_white_and_brightens_black() {
        let ev_of = |radiance: f32| studio_ev(metered_ev(&filled(radiance)).unwrap());
        assert_eq!(ev_of(0.8), 0.0);
        assert!((0.3..=0.6).contains(&ev_of(0.03)));
    }
}
