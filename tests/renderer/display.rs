//! Display encoding, the units of light, and the output of images.

use crate::common::{Stage, Subject, is_thorough, with};
use crate::pictures::brightest;
use diptych::RunConfig;
use diptych::exec::{ExecError, PerView};
use diptych::image::RgbImage;
use diptych::image::display::tonemap;
use diptych::image::tone::ToneCurve;
use diptych::passes::tonemap::DISPLAY;
use diptych::scene::load::load_shot;
use diptych::scene::rig::Eye;
use diptych::scene::{Environment, Light, LightKind};
use glam::Vec3;

/// Compares the devices' encoding with the host's in f64; rounding may change a value by one level.
#[test]
fn display_image_equals_tonemapped_linear_image() {
    let subject = Subject::load("builtin:cornell");
    for tone in [ToneCurve::Reinhard, ToneCurve::Neutral, ToneCurve::Agx, ToneCurve::Aces, ToneCurve::None] {
        let settings = RunConfig { exposure_ev: -0.7, tone, ..subject.denoised(96, 54) };
        assert_tonemapped(&mut Stage::alone(&subject, &settings), tone);
    }
}

fn assert_tonemapped(stage: &mut Stage, tone: ToneCurve) {
    let frame = stage.frame(0);
    let display = stage.display();
    for eye in Eye::BOTH {
        let (linear, shown) = (frame.linear.of(eye), display.of(eye));
        let expected = tonemap(linear, -0.7, tone);
        assert!(expected.pixels.iter().any(|p| p[0] > 200) && expected.pixels.iter().any(|p| p[0] <= 1));
        for (i, (e, s)) in expected.pixels.iter().zip(&shown.pixels).enumerate() {
            let apart = (0..3).map(|c| e[c].abs_diff(s[c])).max();
            assert!(apart <= Some(1), "{tone:?}, {eye} eye, pixel {i}: {s:?} instead of {e:?}");
        }
    }
}

/// Loads a checker under a sun of `sun_lux`, with its other light scaled by `brightness`.
fn under_a_sun(brightness: f32, sun_lux: f32) -> Subject {
    let (shot, mut scene) = load_shot("builtin:checker").unwrap();
    scene.materials.iter_mut().for_each(|m| m.emissive *= brightness);
    scene.environment = Environment::Constant(Vec3::splat(0.5 * brightness));
    let kind = LightKind::Directional { direction: Vec3::new(0.3, -1.0, -0.4).normalize(), angle_rad: 0.01 };
    scene.lights = vec![Light { kind, strength: Vec3::splat(sun_lux) }];
    Subject::new("checker in the sun", scene, shot.rig)
}

/// Renders a sequence, in units in which white is 1.
fn exposed(exposure_ev: f32, gloss: bool) -> Vec<PerView<RgbImage>> {
    let white = (-exposure_ev).exp2();
    // The sun has 100,000 lux at −17 EV.
    let subject = under_a_sun(white, 1e5 * (white / 17f32.exp2()));
    let mut settings = RunConfig { exposure_ev, ..subject.accumulated(64, 36) };
    settings.buffers.needs.gloss = gloss;
    let mut stage = Stage::alone(&subject, &settings);
    let frame = |i: u32| stage.frame_at(0.02 * f64::from(i), i).linear;
    let mut frames: Vec<_> = (0..8).map(frame).collect();
    let values = frames.iter_mut().flat_map(|f| f.iter_mut()).flat_map(|eye| &mut eye.pixels);
    values.for_each(|pixel| *pixel = pixel.map(|v| v / white));
    frames
}

/// Powers of two scale floats and half floats exactly. Only the rounding of their smallest values depends on the unit
/// of light.
#[test]
fn picture_is_independent_of_the_unit_of_light() {
    let all: &[f32] = &[-24.0, -20.0, -17.0, 20.0, 24.0];
    for (gloss, few) in [(true, &[-24.0, 24.0][..]), (false, &[-17.0])] {
        let exposures_ev = if is_thorough() { all } else { few };
        let expected = exposed(0.0, gloss);
        for &exposure_ev in exposures_ev {
            let mut worst = 0.0f32;
            for (e, f) in expected.iter().zip(&exposed(exposure_ev, gloss)) {
                for eye in Eye::BOTH {
                    let [e, f] = [e, f].map(|frame| frame.of(eye).pixels.as_flattened());
                    worst = e.iter().zip(f).map(|(e, f)| (e - f).abs() / (e + 1e-3)).fold(worst, f32::max);
                }
            }
            println!("gloss {gloss}, {exposure_ev} EV: a pixel is off by {worst:.1e}");
            assert!(worst < 1e-4, "gloss {gloss}, {exposure_ev} EV: a pixel is off by {worst:.1e}");
        }
    }
}

/// The unit of stored light is a whole number of stops.
#[test]
fn exposures_of_the_same_stop_give_equal_radiance() {
    let subject = under_a_sun(1.0, 1e3);
    let pixels = |exposure_ev| {
        let settings = RunConfig { exposure_ev, ..subject.accumulated(64, 36) };
        let [left, right] = Stage::alone(&subject, &settings).frame(0).linear.into_outer();
        [left.pixels, right.pixels]
    };
    assert!(pixels(-0.9) == pixels(-1.4));
}

/// With separate specular radiance, half floats hold up to 65504 times white at 0 EV. Brighter pixels are clipped and counted.
#[test]
fn half_float_overflow_is_clipped_and_counted() {
    let subject = under_a_sun(1.0, 1e9);
    let clipped = |exposure_ev, gloss| {
        let mut settings = RunConfig { exposure_ev, hard_shadows: false, ..subject.accumulated(64, 36) };
        settings.buffers.needs.gloss = gloss;
        let frame = Stage::alone(&subject, &settings).frame(0);
        let brightest = brightest(frame.linear.left());
        assert!(frame.linear.left().pixels.as_flattened().iter().all(|v| v.is_finite()));
        let clipped = [0, 1].map(|eye| frame.report.tallies[eye].clipped);
        (clipped, brightest)
    };
    let ([left, right], cut) = clipped(0.0, true);
    let (none, whole) = clipped(0.0, false);
    assert!(left > 100 && right > 0, "{left} and {right} pixels are clipped");
    assert_eq!(none, [0, 0], "floats hold it all");
    assert!(cut < 0.01 * whole, "{cut} is left of {whole}");
    let (none, whole_again) = clipped(-17.0, true);
    assert_eq!(none, [0, 0], "a shorter exposure keeps it all");
    assert!((whole_again / whole - 1.0).abs() < 0.1, "{whole_again} is not {whole}");
}

/// Rows of images that nobody reads are not transferred.
#[test]
fn unread_images_are_not_transferred() {
    let subject = Subject::load("builtin:cornell");
    let settings = with(subject.denoised(96, 54), |config| config.execution.adapts_halo = false);
    let mut two = Stage::even(&subject, &settings, 2);
    let render = |two: &mut Stage| {
        let params = two.params(0.0, 0);
        two.renderer().render(&params).unwrap().uploaded_bytes()
    };
    let all = render(&mut two);
    let shown = two.display();
    two.renderer().set_outputs(&[DISPLAY]);
    let fewer = render(&mut two);
    assert_eq!(two.display(), shown);
    assert!(matches!(two.renderer().read_linear(), Err(ExecError::NoFrame)));
    // Half of both eyes' linear images, 16 bytes per pixel, are not transferred.
    assert_eq!(all - fewer, 16 * 96 * 54);
}
