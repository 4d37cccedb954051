//! Frames whose quality changes.

use super::*;
use crate::common::{foveate, sampled, with};
use diptych::exec::FrameParams;
use diptych::frame::{Foveation, Sampler};
use diptych::passes::Aov;
use diptych::quality::{Denoiser, Filter, Quality};
use diptych::samples::Samples;
use diptych::scene::shot::Gaze;

/// Samples, bounces, iterations (at most those of the denoiser), render scale and foveal radii of a frame.
type Numbers = (f64, u32, u32, f64, Option<[f64; 2]>);

fn quality(denoiser: Denoiser, (spp, bounces, iterations, scale, fovea): Numbers) -> Quality {
    Quality {
        spp: Samples::of_mean(spp),
        bounces,
        filter: Some(Filter::new(denoiser, iterations.min(denoiser.most_iterations()))),
        scale,
        fovea,
        polar: None,
    }
}

const QUALITIES: [Numbers; 8] = [
    (1.0, 1, 2, 0.7, None),
    (3.0, 4, 4, 1.0, None),
    (1.0, 6, 1, 1.0, Some([0.1, 0.3])),
    (1.5, 6, 4, 1.0, None),
    (2.0, 2, 3, 0.5, Some([0.2, 0.4])),
    (2.25, 6, 2, 0.7, Some([0.1, 0.3])),
    (3.0, 6, 4, 0.9, None),
    (1.0, 3, 4, 1.0, None),
];

fn gaze() -> [Gaze; 2] {
    [0.4, 0.6].map(|x| Gaze { path: vec![[0.0, x, 0.5]] })
}

/// Renders frames of all [`QUALITIES`].
fn play(subject: &Subject, settings: &RunConfig, devices: usize) -> Vec<Frame> {
    let mut settings = settings.clone();
    (settings.envelope.most.spp, settings.envelope.mixes_spp, settings.envelope.most.scale) =
        (Samples::of_mean(3.5), true, 0.5);
    let denoiser = settings.denoiser().unwrap();
    foveate(&mut settings, gaze(), Foveation::default(), [4.min(denoiser.most_iterations()); 3]);
    let mut stage = Stage::with(subject, &settings, devices, Box::new(Measured::new(HEIGHT, devices)));
    let frame = |(i, numbers): (usize, &Numbers)| {
        let quality = quality(denoiser, *numbers);
        stage.set(move |params| params.quality = quality);
        stage.frame_at(i as f64 * 0.05, i as u32)
    };
    QUALITIES.iter().enumerate().map(frame).collect()
}

#[test]
fn same_bytes_when_quality_changes_per_frame() {
    let subject = Subject::load("builtin:checker");
    let settings = subject.denoised(WIDTH, HEIGHT);
    let (one, two) = (play(&subject, &settings, 1), play(&subject, &settings, 2));
    for (i, (spp, bounces, iterations, scale, fovea)) in QUALITIES.into_iter().enumerate() {
        let mut fixed = with(settings.clone(), |config| {
            config.envelope.most.bounces = bounces;
            config.envelope.most.scale = scale
        });
        let most = &mut fixed.envelope.most;
        (most.spp, most.filter) = (Samples::of_mean(spp), Some(Filter::new(Denoiser::ATROUS, iterations)));
        fixed.envelope.mixes_spp = spp == 1.5;
        (fixed.gaze, fixed.envelope.most.fovea) = (gaze(), fovea);
        let expected = Stage::even(&subject, &fixed, 1).frame_at(i as f64 * 0.05, i as u32).linear;
        assert_same(&format!("frame {i} on one device"), &expected, &one[i].linear);
    }
    assert_same_frames("two devices", &one, &two);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_of_history_across_quality_changes() {
    let subject = Subject::load("builtin:atrium");
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    for denoiser in [Denoiser::SVGF, Denoiser::BMFR] {
        settings.envelope.most.filter = Some(Filter::new(denoiser, 5.min(denoiser.most_iterations())));
        let [one, three] = [1, 3].map(|devices| play(&subject, &settings, devices));
        assert_same_frames(&format!("{denoiser:?}"), &one, &three);
    }
}

#[test]
fn exposure_changes_display_images_but_not_radiance() {
    let subject = Subject::load("builtin:studio");
    for denoiser in sampled([Denoiser::SVGF, Denoiser::BMFR], 2) {
        let mut settings = subject.accumulated(WIDTH, HEIGHT);
        settings.envelope.most.filter = Some(Filter::new(denoiser, 5.min(denoiser.most_iterations())));
        let images = |ev_of: &dyn Fn(u32) -> f32| {
            let mut stage = Stage::even(&subject, &settings, 2);
            let frame = |index: u32| {
                let exposure_ev = ev_of(index);
                stage.set(move |params| params.exposure_ev = exposure_ev);
                let linear = stage.frame_at(f64::from(index) * 0.05, index).linear;
                (linear, stage.renderer().read_display().unwrap().into_left().pixels)
            };
            (0..4).map(frame).collect::<Vec<_>>()
        };
        let constant = images(&|_| settings.exposure_ev);
        let changing = images(&|index| settings.exposure_ev + [0.0, 1.3, -2.0, 5.0][index as usize]);
        for (i, (constant, changing)) in constant.iter().zip(&changing).enumerate() {
            let frame = format!("{denoiser:?}, frame {i}");
            assert_same(&frame, &constant.0, &changing.0);
            assert!(
                (constant.1 == changing.1) == (i == 0),
                "{frame}: the picture differs from that at the same exposure, or not from that at another"
            );
        }
    }
}

#[test]
fn rejects_qualities_outside_the_envelope() {
    let subject = Subject::load("builtin:cornell");
    let mut settings = subject.denoised(32, 18);
    (settings.envelope.most.spp, settings.envelope.most.filter) = (3.into(), Some(Filter::new(Denoiser::ATROUS, 4)));
    let mut stage = Stage::even(&subject, &settings, 1);
    let frame = stage.params(0.0, 0);
    let mut set = |denoiser, numbers| {
        stage.renderer().check(&FrameParams { quality: quality(denoiser, numbers), ..frame.clone() })
    };
    let whole = |(spp, bounces, iterations)| (spp, bounces, iterations, 1.0, None);
    let wrong = [(0.0, 1, 1), (4.0, 1, 1), (1.0, 1, 1), (2.5, 1, 1), (2.0, 1, 0), (2.0, 1, 5)].map(whole);
    for wrong in wrong.into_iter().chain([(2.0, 1, 1, 0.5, None), (2.0, 1, 1, 1.0, Some([0.1, 0.2]))]) {
        assert!(set(Denoiser::ATROUS, wrong).is_err(), "{wrong:?}");
    }
    assert!(set(Denoiser::SVGF, whole((2.0, 1, 1))).is_err());
    assert!(set(Denoiser::ATROUS, whole((2.0, 1, 1))).is_ok());
}

#[test]
fn same_bytes_from_equal_frame_parameters() {
    let subject = Subject::load("builtin:cornell");
    let settings = subject.denoised(32, 18);
    let image = |devices: usize, params: &FrameParams| {
        let mut stage = Stage::even(&subject, &settings, devices);
        stage.renderer().render(params).unwrap();
        stage.renderer().read_linear().unwrap()
    };
    let params = FrameParams { seed: 5, ..Stage::even(&subject, &settings, 1).params(0.25, 7) };
    let text = serde_json::to_string(&params).unwrap();
    let read: FrameParams = serde_json::from_str(&text).unwrap();
    assert_eq!(read, params);
    let first = image(2, &params);
    assert_same("the frame that was read", &image(1, &read), &first);
    assert!(image(1, &FrameParams { seed: 6, ..params }) != first);
}

/// Numbers of samples between two whole ones are those of tiles: each pixel has one of the two, and the bytes that it
/// has where all pixels have this number.
#[test]
fn same_bytes_per_pixel_with_fractional_spp() {
    let subject = Subject::load("builtin:studio");
    // Two eyes that are path traced. Sequences of a pixel do not depend on the number of its samples.
    let settings = with(subject.settings(WIDTH, HEIGHT), |config| {
        config.buffers.reproject = false;
        config.sampler = Sampler::Pcg;
        config.buffers.aovs = vec![Aov::Spp];
    });
    let frame = |spp: f64, devices: usize| {
        let settings = with(settings.clone(), |config| {
            config.envelope.most.spp = Samples::of_mean(spp);
            config.envelope.mixes_spp = spp == 1.5;
        });
        let mut stage = Stage::even(&subject, &settings, devices);
        let image = stage.frame(3).linear;
        let counts = stage.aov(0);
        let ([left, right], [of_left, of_right]) = (image.into_outer(), counts.into_outer());
        [(left, of_left), (right, of_right)]
    };
    for least in sampled([1.0, 4.0], 2) {
        let [few, many, between] = [(0.0, 1), (1.0, 1), (0.5, 2)].map(|(extra, devices)| frame(least + extra, devices));
        for (eye, (image, counts)) in between.iter().enumerate() {
            for (i, (pixel, &count)) in image.pixels.iter().zip(&counts[0]).enumerate() {
                let expected = if f64::from(count) == least { &few } else { &many };
                assert!(f64::from(count) == least || f64::from(count) == least + 1.0, "{count} samples");
                assert_eq!(*pixel, expected[eye].0.pixels[i], "pixel {i} of eye {eye} with {count} samples");
            }
            let mean = counts[0].iter().sum::<f32>() / counts[0].len() as f32;
            assert!((f64::from(mean) - least - 0.5).abs() < 0.05, "{mean} samples per pixel");
        }
    }
}
