//! Foveated layers: which pixels are sampled, and that nothing else changes.

use crate::common::{Frame, Stage, Subject, foveate, project, sampled, with};
use crate::pictures::{distances, mean};
use diptych::RunConfig;
use diptych::frame::Foveation;
use diptych::image::{Extent, RgbImage};
use diptych::passes::Aov;
use diptych::projection::{LogPolar, PolarSpace};
use diptych::quality::{Denoiser, Filter};
use diptych::scene::shot::Gaze;

const WIDTH: u32 = 128;
const HEIGHT: u32 = 96;
const EXTENT: Extent = Extent::new(WIDTH, HEIGHT);

fn towards(x: f64, y: f64) -> [Gaze; 2] {
    [x, 1.0 - x].map(|x| Gaze { path: vec![[0.0, x, y]] })
}

fn settings(subject: &Subject, gaze: [Gaze; 2], foveation: Foveation, iterations: [u32; 3]) -> RunConfig {
    let mut settings = subject.settings(WIDTH, HEIGHT);
    settings.buffers.aovs = vec![Aov::Spp];
    foveate(&mut settings, gaze, foveation, iterations);
    settings
}

fn same(a: &RgbImage, b: &RgbImage, i: usize) -> bool {
    a.pixels[i].map(f32::to_bits) == b.pixels[i].map(f32::to_bits)
}

fn is_same(a: &RgbImage, b: &RgbImage) -> bool {
    (0..a.pixels.len()).all(|i| same(a, b, i))
}

#[test]
fn sampling_mask_has_the_density_of_each_ring() {
    const RINGS: usize = 12;
    let subject = Subject::load("builtin:cornell");
    for (x, unsampled_fraction) in [(0.5, 0.5), (0.3, 0.75)] {
        let (gaze, foveation) = (towards(x, 0.4), Foveation { unsampled_fraction, ..Default::default() });
        let mut stage = Stage::alone(&subject, &settings(&subject, gaze.clone(), foveation, [0; 3]));
        stage.frame(0);
        let spp = stage.aov(0);
        for (eye, spp) in spp.outer().into_iter().enumerate() {
            let [r0, r1] = foveation.radii.map(|r| r * f64::from(WIDTH));
            let mut rings = [(0.0, 0.0, 0.0); RINGS];
            for (&d, &spp) in distances(gaze[eye].at(0.0), EXTENT).iter().zip(&spp[0]) {
                let expected = 1.0 - unsampled_fraction * ((d - r0) / (r1 - r0)).clamp(0.0, 1.0);
                assert!(spp == 0.0 || spp == 1.0);
                assert!(d >= r0 || spp == 1.0, "a pixel of the inner layer is not sampled");
                let ring = &mut rings[((d / 8.0) as usize).min(RINGS - 1)];
                *ring = (ring.0 + 1.0, ring.1 + expected, ring.2 + f64::from(spp));
            }
            for (i, (pixels, expected, sampled)) in rings.into_iter().enumerate() {
                // Independent pixels would scatter by the root of their number; these are stratified and scatter less.
                let tolerance = 0.5 * f64::sqrt(pixels) + 1.0;
                assert!((sampled - expected).abs() < tolerance, "ring {i}: {sampled} of {pixels}, not {expected}");
            }
        }
    }
}

#[test]
fn sampled_pixels_equal_those_without_foveation() {
    let subject = Subject::load("builtin:checker");
    for spp in [1, 3] {
        let mut foveated = settings(&subject, towards(0.4, 0.5), Foveation::default(), [0; 3]);
        foveated.envelope.most.spp = spp.into();
        let plain = with(foveated.clone(), |config| config.envelope.most.fovea = None);
        let all = Stage::alone(&subject, &plain).frame(0);
        let mut stage = Stage::alone(&subject, &foveated);
        let some = stage.frame(0);
        let sampled = stage.aov(0);
        for eye in 0..2 {
            let mask = &sampled.outer()[eye][0];
            let (a, b) = (all.linear.outer()[eye], some.linear.outer()[eye]);
            let wrong = (0..mask.len()).filter(|&i| mask[i] > 0.0 && !same(a, b, i)).count();
            assert_eq!(wrong, 0, "{spp} spp: sampled pixels differ");
            let skipped = mask.iter().filter(|m| **m == 0.0).count();
            assert!(skipped > mask.len() / 4);
            assert!(some.report.tallies[eye].rays < all.report.tallies[eye].rays);
        }
    }
}

#[test]
fn same_bytes_and_rays_if_foveation_skips_no_pixel() {
    let subject = Subject::load("builtin:checker");
    let foveation = Foveation { unsampled_fraction: 0.0, ..Default::default() };
    for (spp, reproject) in [(1, false), (3, true)] {
        let mut foveated = settings(&subject, towards(0.5, 0.5), foveation, [5; 3]);
        (foveated.envelope.most.spp, foveated.buffers.reproject) = (spp.into(), reproject);
        let plain = with(foveated.clone(), |config| config.envelope.most.fovea = None);
        let expected = Stage::alone(&subject, &plain).frame(0);
        let found = Stage::alone(&subject, &foveated).frame(0);
        // Outside the inner layer, reprojection into the right eye may leave pixels to the filter.
        for eye in 0..if reproject { 1 } else { 2 } {
            let (a, b) = (expected.linear.outer()[eye], found.linear.outer()[eye]);
            assert!(is_same(a, b), "{spp} spp, eye {eye}");
            // A pixel that is listed twice would have twice the rays.
            let rays = |f: &Frame| f.report.row_tallies[eye].iter().map(|r| r.rays).collect::<Vec<_>>();
            assert_eq!(rays(&expected), rays(&found));
        }
    }
}

#[test]
fn render_scale_samples_its_square_and_keeps_mean() {
    let subject = Subject::load("builtin:cornell");
    for denoiser in sampled([Denoiser::SVGF, Denoiser::ATROUS], 2) {
        let filter = Some(Filter::new(denoiser, 5));
        let render = |scale: f64| {
            let mut settings = with(subject.denoised(WIDTH, HEIGHT), |config| config.envelope.most.scale = scale);
            (settings.envelope.most.filter, settings.buffers.aovs) = (filter, vec![Aov::Spp]);
            let mut stage = Stage::alone(&subject, &settings);
            let frames: Vec<_> = (0..8).map(|i| stage.frame(i)).collect();
            (frames, stage.aov(0))
        };
        let (full, _) = render(1.0);
        for scale in sampled([0.5, 0.75], 2) {
            let (frames, spp) = render(scale);
            let rays = |f: &[Frame]| f.iter().map(|f| f.report.tallies[0].rays).sum::<u64>();
            assert!(rays(&frames) < rays(&full));
            let share = spp.left()[0].iter().map(|s| f64::from(*s)).sum::<f64>() / f64::from(WIDTH * HEIGHT);
            // Samples are stratified, except at silhouettes, which are always sampled.
            assert!(share > scale * scale - 0.01 && share < scale * scale + 0.05, "{filter:?} {scale}: {share}");
            let (last, whole) = (&frames[7].linear, &full[7].linear);
            for (found, expected) in last.outer().into_iter().zip(whole.outer()) {
                let ratio = mean(found) / mean(expected);
                assert!((ratio - 1.0).abs() < 0.03, "{filter:?} {scale}: the mean changes by {ratio}");
            }
        }
    }
}

/// Some views are so narrow that the whole screen is in the fovea. The gaze varies, too.
#[test]
fn narrow_visual_polar_images_match_perspective_ones() {
    const BLOCK: usize = 8;
    let mut subject = Subject::load("builtin:checker");
    for yfov_deg in sampled([1.0f64, 3.0, 20.0], 3) {
        subject.rig.yfov_rad = yfov_deg.to_radians();
        let mut settings = with(subject.settings(WIDTH, HEIGHT), |config| config.envelope.most.bounces = 1);
        settings.envelope.most.spp = 8.into();
        let expected = Stage::alone(&subject, &settings).frame(0);
        for (x, y) in [(0.5, 0.5), (0.2, 0.3), (1.0, 0.9)] {
            project(&mut settings, towards(x, y), PolarSpace::Visual);
            let found = Stage::alone(&subject, &settings).frame(0);
            for (found, expected) in found.linear.outer().into_iter().zip(expected.linear.outer()) {
                let [found, expected] = [found, expected].map(|image| block_means(image, BLOCK));
                let off: f64 = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).sum();
                let off = off / expected.iter().sum::<f64>();
                assert!(off < 0.15, "{yfov_deg} degrees, gaze at {x}, {y}: {off}");
            }
        }
    }
}

/// Returns the mean brightness of square blocks of pixels.
fn block_means(image: &RgbImage, size: usize) -> Vec<f64> {
    let (columns, rows) = (WIDTH as usize / size, HEIGHT as usize / size);
    let mut means = vec![0.0; columns * rows];
    for (i, pixel) in image.pixels.iter().enumerate() {
        let block = i / WIDTH as usize / size * columns + i % WIDTH as usize / size;
        means[block] += pixel.iter().map(|c| f64::from(*c)).sum::<f64>() / (3 * size * size) as f64;
    }
    means
}

#[test]
fn same_bytes_at_full_scale_if_smaller_are_allowed() {
    let subject = Subject::load("builtin:checker");
    for filter in [Denoiser::SVGF, Denoiser::ATROUS].map(|denoiser| Some(Filter::new(denoiser, 5))) {
        let render = |sparse: bool| {
            let mut settings = subject.denoised(WIDTH, HEIGHT);
            (settings.envelope.most.filter, settings.envelope.most.scale) = (filter, if sparse { 0.5 } else { 1.0 });
            let mut stage = Stage::alone(&subject, &settings);
            stage.set(|params| params.quality.scale = 1.0);
            (0..3).map(|i| stage.frame(i).linear).collect::<Vec<_>>()
        };
        for (plain, sparse) in render(false).iter().zip(&render(true)) {
            plain.outer().into_iter().zip(sparse.outer()).for_each(|(a, b)| assert!(is_same(a, b), "{filter:?}"));
        }
    }
}

#[test]
fn denoiser_fills_unsampled_pixels_without_nan() {
    let subject = Subject::load("builtin:cornell");
    for gaze in [towards(0.0, 0.0), towards(1.0, 1.0), towards(0.5, 0.5)] {
        for unsampled_fraction in [0.5, 1.0] {
            let foveation = Foveation { unsampled_fraction, ..Default::default() };
            let mut foveated = settings(&subject, gaze.clone(), foveation, [2, 3, 5]);
            let distances = distances(gaze[0].at(0.0), EXTENT);
            foveated.buffers.reproject = true;
            let plain = with(foveated.clone(), |config| config.envelope.most.fovea = None);
            let all = Stage::alone(&subject, &plain).frame(0).linear;
            let mut stage = Stage::alone(&subject, &foveated);
            let found = stage.frame(0).linear;
            for eye in 0..2 {
                assert!(found.outer()[eye].pixels.iter().flatten().all(|c| c.is_finite()));
            }
            // If the outer layer is not sampled at all, light reaches only as far as the filter.
            let reach = if unsampled_fraction < 1.0 { f64::INFINITY } else { 0.3 * f64::from(WIDTH) };
            let is_dark = |i: usize| found.left().pixels[i] == [0.0; 3] && all.left().pixels[i] != [0.0; 3];
            let dark = (0..distances.len()).filter(|&i| distances[i] < reach && is_dark(i)).count();
            assert_eq!(dark, 0, "{gaze:?}, {unsampled_fraction}");
        }
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn rotating_mask_samples_each_pixel_in_three_frames() {
    let subject = Subject::load("builtin:cornell");
    for denoiser in [Denoiser::SVGF, Denoiser::ATROUS] {
        let mut settings = settings(&subject, towards(0.5, 0.5), Foveation::default(), [1; 3]);
        settings.envelope.most.filter = Some(Filter::new(denoiser, 1));
        let mut stage = Stage::alone(&subject, &settings);
        let mut sampled = vec![0.0; (WIDTH * HEIGHT) as usize];
        for frame in 0..3 {
            stage.frame(frame);
            sampled.iter_mut().zip(&stage.aov(0).left()[0]).for_each(|(sum, spp)| *sum += spp);
        }
        let never = sampled.iter().filter(|s| **s == 0.0).count();
        assert_eq!(never == 0, denoiser == Denoiser::SVGF, "{never} pixels were never sampled");
    }
}

/// A gaze from an eye tracker during a run has the same effect as one in the settings.
#[test]
fn gaze_set_per_frame_applies_to_each_eye() {
    let subject = Subject::load("builtin:cornell");
    let sampled = |at_first, later: Option<[[f64; 2]; 2]>| {
        let mut stage = Stage::alone(&subject, &settings(&subject, at_first, Foveation::default(), [0; 3]));
        stage.set(move |params| params.gaze = later.unwrap_or(params.gaze));
        stage.frame(0);
        let spp = stage.aov(0);
        spp.into_outer()
    };
    let expected = sampled(towards(0.25, 0.6), None);
    assert!(expected[0] != expected[1], "the eyes look to one place");
    assert!(sampled(towards(0.5, 0.5), Some([[0.25, 0.6], [0.75, 0.6]])) == expected);
}

/// Returns the mean radiance of the pixels whose index satisfies a condition.
fn mean_of(image: &RgbImage, counts: impl Fn(usize) -> bool) -> f64 {
    let pixels = || image.pixels.iter().enumerate().filter(|(i, _)| counts(*i));
    pixels().map(|(_, p)| p.iter().map(|c| f64::from(*c)).sum::<f64>()).sum::<f64>() / (3 * pixels().count()) as f64
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn polar_images_match_perspective_with_fewer_rays() {
    let subject = Subject::load("builtin:cornell");
    let mut plain = subject.settings(WIDTH, HEIGHT);
    (plain.envelope.most.spp, plain.buffers.aovs) = (32.into(), vec![Aov::Position]);
    let render = |space: Option<PolarSpace>| {
        let mut settings = plain.clone();
        (settings.gaze, settings.envelope.most.polar) = (towards(0.4, 0.6), space);
        let mut stage = Stage::alone(&subject, &settings);
        let frame = stage.frame(0);
        (frame, stage.aov(0))
    };
    let (expected, places) = render(None);
    let spaces = [PolarSpace::Visual, PolarSpace::Log(LogPolar::COMPOSITE), PolarSpace::Log(LogPolar::PRESETS[1].1)];
    let rendered = spaces.map(|space| (space, render(Some(space))));
    for (space, (found, found_places), eye) in rendered.iter().flat_map(|(s, of)| [(s, of, 0), (s, of, 1)]) {
        let (a, b) = (expected.linear.outer()[eye], found.linear.outer()[eye]);
        let distances = distances([[0.4, 0.6][eye], 0.6], EXTENT);
        for (what, radius) in [("around the gaze", 12.0), ("everywhere", 1e3)] {
            let [a, b] = [a, b].map(|image| mean_of(image, |i| distances[i] < radius));
            assert!((b / a - 1.0).abs() < 0.03, "{space}, eye {eye}, {what}: {b} instead of {a}");
        }
        // Auxiliary images show the nearest pixel.
        let [a, b] = [&places, found_places].map(|places| places.outer()[eye]);
        let apart = |i: usize| (0..3).map(|c| (a[c][i] - b[c][i]).abs()).fold(0.0, f32::max);
        let near = (0..a[0].len()).filter(|&i| apart(i) < 0.15).count();
        assert!(near * 10 > a[0].len() * 9, "{space}, eye {eye}: {near} of {} places are near", a[0].len());
        let share = found.report.tallies[eye].rays as f64 / expected.report.tallies[eye].rays as f64;
        assert!(share < 0.75, "{space}, eye {eye}: {share} of the rays");
    }
}
