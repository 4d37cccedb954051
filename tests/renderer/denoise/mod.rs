//! The denoiser alone ([`FrameDenoiser`]) on the renderer's own noisy frames.

mod buffers;
mod planes;

use crate::black::{self, BLACK, RED, WHITE, colored, mean, textured};
use crate::common::{Stage, Subject, devices, give_back};
use diptych::RunConfig;
use diptych::denoise::{FrameDenoiser, Given, Settings};
use diptych::image::{Extent, RgbImage};
use diptych::metrics;
use diptych::passes::Aov;
use diptych::scene::Material;
use diptych::scene::rig::{Eye, View};
use glam::DVec3;

const EXTENT: Extent = Extent::new(96, 64);
const FRAMES: u32 = 16;
const SPP: u32 = 2;

/// A view of a noisy frame.
struct Noisy {
    camera: View,
    color: RgbImage,
    /// Emission, albedo, normal and position.
    guides: [Vec<[f32; 3]>; 4],
}

impl Noisy {
    fn given(&self) -> Given<'_> {
        let [emission, albedo, normal, position] = &self.guides;
        let given = Given::new(self.camera, &self.color.pixels, albedo, normal, position);
        Given { emission: Some(emission), ..given }
    }
}

/// Calls `then` with a new denoiser.
fn with_denoiser<T>(settings: &Settings, then: impl FnOnce(&mut FrameDenoiser) -> T) -> T {
    let gpu = devices(1).pop().unwrap();
    let mut denoiser = FrameDenoiser::on(gpu, settings).unwrap_or_else(|e| panic!("{e}"));
    let result = then(&mut denoiser);
    give_back(denoiser.into_device());
    result
}

fn plain(subject: &Subject, spp: u32) -> RunConfig {
    let mut config = subject.settings(EXTENT.width, EXTENT.height);
    config.envelope.most.spp = spp.into();
    config
}

/// Renders a frame without a denoiser at each of these times.
fn noisy(subject: &Subject, times_s: &[f64]) -> Vec<[Noisy; 2]> {
    let mut config = plain(subject, SPP);
    config.buffers.aovs = vec![Aov::Emission, Aov::Albedo, Aov::Normal, Aov::Position];
    let mut stage = Stage::alone(subject, &config);
    let frame = |(index, &time_s): (u32, &f64)| {
        let linear = stage.frame_at(time_s, index).linear;
        let mut aov = |i: usize| {
            let [left, right] = stage.renderer().read_aov_pixels(i).unwrap().into_outer();
            [left, right].map(|values| values.as_chunks().0.to_vec())
        };
        let mut guides = [0, 1, 2, 3].map(&mut aov);
        let mut view = |eye: Eye, color| {
            let guides = guides.each_mut().map(|eyes| std::mem::take(&mut eyes[eye.index()]));
            Noisy { camera: subject.rig.view(time_s, eye), color, guides }
        };
        let [left, right] = linear.into_outer();
        [view(Eye::LEFT, left), view(Eye::RIGHT, right)]
    };
    (0..).zip(times_s).map(frame).collect()
}

/// Denoises stereo pairs one after another.
fn denoised(denoiser: &mut FrameDenoiser, frames: &[[Noisy; 2]]) -> Vec<Vec<RgbImage>> {
    frames.iter().map(|views| denoiser.denoise(&views.each_ref().map(Noisy::given)).unwrap()).collect()
}

/// Times of frames that arrive at `end_s`.
fn times(end_s: f64, step_s: f64) -> Vec<f64> {
    (0..FRAMES).map(|i| end_s - f64::from(FRAMES - 1 - i) * step_s).collect()
}

fn rmse(right: &RgbImage, found: &RgbImage) -> f64 {
    metrics::compare(right, found).unwrap().rmse
}

fn settings() -> Settings {
    Settings { spp: SPP, ..Settings::new(EXTENT) }
}

/// Checks that frames with history are closer to a reference than as traced and than a frame alone. Their errors are
/// 0.23 to 0.42 of those as traced in these scenes, and 0.24 to 0.47 of those of a frame alone.
fn assert_error_falls(shot: &str, end_s: f64, step_s: f64) {
    let subject = Subject::load(shot);
    let frames = noisy(&subject, &times(end_s, step_s));
    let [found, alone] = with_denoiser(&settings(), |denoiser| {
        let found = denoised(denoiser, &frames);
        denoiser.reset();
        [found, denoised(denoiser, &frames[FRAMES as usize - 1..])]
    });
    let mut config = plain(&subject, 128);
    config.seed = 99;
    let reference = Stage::alone(&subject, &config).frame_at(end_s, 0).linear;
    for (eye, right) in reference.into_outer().iter().enumerate() {
        let traced = rmse(right, &frames[FRAMES as usize - 1][eye].color);
        let [first, last] = [&alone[0][eye], &found[FRAMES as usize - 1][eye]].map(|image| rmse(right, image));
        println!("{shot} eye {eye}: RMSE {traced:.4} as traced, {first:.4} alone, {last:.4} with history");
        assert!(last < 0.55 * traced, "{last} with history, {traced} as traced");
        assert!(last < 0.6 * first, "{last} with history, {first} without");
    }
}

#[test]
fn still_frames_of_others_converge() {
    assert_error_falls("builtin:cornell", 0.0, 0.0);
}

#[test]
fn moving_frames_of_others_converge() {
    assert_error_falls("builtin:checker", 0.5, 1.0 / 72.0);
}

/// Light of black surfaces and of surfaces without some channel bypasses the filter, and no light is lost. The means of
/// all frames are within 0.6 % of those as traced.
#[test]
fn light_of_others_is_kept() {
    let of = |name, texels| textured(name, texels, |texture| colored(Some(texture), Material::default()));
    let black = black::moving(of("black and white", [BLACK, WHITE]));
    let red = of("red and white", [RED, WHITE]);
    for (subject, step_s) in [(black, 0.05), (red, 0.0), (Subject::load("builtin:cornell"), 0.0)] {
        let frames = noisy(&subject, &times(0.8, step_s));
        let found = with_denoiser(&settings(), |denoiser| denoised(denoiser, &frames));
        let sum = |images: &mut dyn Iterator<Item = &RgbImage>| images.map(mean).sum::<DVec3>();
        let traced = sum(&mut frames.iter().flatten().map(|view| &view.color));
        let ratio = sum(&mut found.iter().flatten()) / traced;
        println!("{}: {ratio:.4}", subject.name);
        assert!((ratio - 1.0).abs().cmple(DVec3::splat(0.01)).all(), "{}: a mean of {ratio}", subject.name);
    }
}

/// After a reset, a frame has the bytes of a first one; without it, it uses the history.
#[test]
fn reset_leaves_no_ghost() {
    let subject = Subject::load("builtin:cornell");
    let frames = noisy(&subject, &[0.0, 0.0, 0.0]);
    let [first, continued, again] = with_denoiser(&settings(), |denoiser| {
        let first = denoised(denoiser, &frames[2..]);
        denoiser.reset();
        denoised(denoiser, &frames[..2]);
        let continued = denoised(denoiser, &frames[2..]);
        denoiser.reset();
        [first, continued, denoised(denoiser, &frames[2..])]
    });
    assert!(first == again, "a frame after a reset differs from a first one");
    assert!(first != continued, "the history has no effect");
}

/// One view has the picture of the left view of a pair.
#[test]
fn single_view_equals_the_left_one_of_a_pair() {
    let subject = Subject::load("builtin:cornell");
    let frames = noisy(&subject, &[0.0, 0.1]);
    let pairs = with_denoiser(&settings(), |denoiser| denoised(denoiser, &frames));
    let alone = with_denoiser(&Settings { views: 1, ..settings() }, |denoiser| {
        frames.iter().map(|views| denoiser.denoise(&[views[0].given()]).unwrap()).collect::<Vec<_>>()
    });
    for (alone, pair) in alone.iter().zip(&pairs) {
        assert!(alone[..] == pair[..1], "one view differs from the left one of a pair");
    }
}
