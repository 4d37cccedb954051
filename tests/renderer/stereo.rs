//! Two eyes: reprojected pixels look like traced ones, and each eye has its own viewpoint.

use crate::common::{Stage, Subject, is_thorough, sampled, still_rig, with};
use crate::pictures::{board_before_wall, seen_apart};
use crate::reference::scenes::materials;
use crate::reference::ztest::{assert_agrees, mean_and_variance};
use diptych::metrics::compare;
use diptych::passes::Aov;
use glam::Vec3;

/// 512 spp with two bounces in the classic box. The noise of the two renders, which is independent except in the holes,
/// is below the tolerance.
#[test]
fn reprojected_eye_matches_a_traced_one() {
    let subject = Subject::load("builtin:cornell");
    let mut settings = with(subject.settings(64, 36), |config| config.envelope.most.bounces = 2);
    settings.envelope.most.spp = 512.into();
    let traced = Stage::alone(&subject, &settings).frame(0);
    settings.buffers.reproject = true;
    let reprojected = Stage::alone(&subject, &settings).frame(0);
    assert!(traced.linear.left() == reprojected.linear.left());
    assert!(traced.linear.right() != reprojected.linear.right());
    assert!((0.001..0.5).contains(&reprojected.hole_fraction()), "{}", reprojected.hole_fraction());
    let found = compare(traced.linear.right(), reprojected.linear.right()).unwrap();
    println!("holes {:.3}\n{found}", reprojected.hole_fraction());
    assert!(found.psnr >= 40.0, "{found}");
    assert!((found.mean_ratio.unwrap() - 1.0).abs() < 0.005, "{found}");
}

/// Specular radiance depends on the eye. The right eye reuses the left one's only where the difference is small.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn reprojected_specular_surfaces_match_traced_ones() {
    let all = ["dielectrics", "metals", "clearcoats"];
    for name in all.into_iter().take(if is_thorough() { 3 } else { 1 }) {
        let subject = seen_apart(materials::named(name));
        let mut settings = with(subject.settings(64, 36), |config| config.envelope.most.bounces = 3);
        settings.envelope.most.spp = 256.into();
        let traced = Stage::alone(&subject, &settings).frame(0).linear.right().clone();
        settings.buffers.reproject = true;
        let frame = Stage::alone(&subject, &settings).frame(0);
        let found = compare(&traced, frame.linear.right()).unwrap();
        let mean = found.mean_ratio.unwrap();
        println!("{name}: holes {:.3}, PSNR {:.1} dB, mean {mean:.4}", frame.hole_fraction(), found.psnr);
        assert!(frame.hole_fraction() < 0.5, "{name}: {} are holes", frame.hole_fraction());
        assert!(found.psnr >= 38.0 && (mean - 1.0).abs() < 0.005, "{name}: {found}");
    }
}

/// The image has the command line's default size.
#[test]
fn atrium_has_the_expected_number_of_holes() {
    let subject = Subject::load("builtin:atrium");
    assert_eq!(subject.rig.baseline_m, 0.064);
    let settings = with(subject.denoised(640, 360), |config| config.envelope.most.bounces = 1);
    let frame = Stage::alone(&subject, &settings).frame(0);
    // By reason; 3.9 % in all. Drivers round differently at silhouettes.
    let (found, expected) = (frame.report.tallies[1].holes, [2036u64, 2723, 603, 3352, 0, 352]);
    let is_close = |(found, expected): (&u64, &u64)| found.abs_diff(*expected) <= expected / 20 + 10;
    assert!(found.iter().zip(&expected).all(is_close), "{found:?} pixels are holes, not {expected:?}");
    assert_eq!(frame.report.tallies[0].holes, [0; 6], "the left eye has no holes");
}

#[test]
fn eyes_without_a_baseline_see_equal_images() {
    for shot in sampled(["builtin:cornell", "builtin:checker"], 2) {
        let mut subject = Subject::load(shot);
        subject.rig.baseline_m = 0.0;
        let mut settings = with(subject.settings(80, 45), |config| config.envelope.most.bounces = 2);
        settings.buffers.reproject = true;
        let frame = Stage::alone(&subject, &settings).frame(0);
        assert!(frame.hole_fraction() < 0.001, "{shot}: {} are holes", frame.hole_fraction());
        let found = compare(frame.linear.left(), frame.linear.right()).unwrap();
        assert!(found.psnr > 60.0, "{shot}: reprojection onto itself\n{found}");

        settings.buffers.reproject = false;
        settings.envelope.most.spp = 16.into();
        let mut stage = Stage::alone(&subject, &settings);
        let frames: Vec<_> = (0..8).map(|i| stage.frame(i).linear).collect();
        let lefts: Vec<_> = frames.iter().map(|f| f.left().clone()).collect();
        let rights: Vec<_> = frames.iter().map(|f| f.right().clone()).collect();
        assert!(lefts[0] != rights[0], "{shot}: the eyes share their random numbers");
        assert_agrees(shot, &mean_and_variance(&lefts), &mean_and_variance(&rights), 0.06);
    }
}

/// A filled hole has the same random numbers as in a fully traced eye.
#[test]
fn same_bytes_in_holes_as_in_a_traced_eye() {
    let subject = Subject::load("builtin:checker");
    let mut settings = subject.settings(128, 72);
    settings.buffers.aovs = vec![Aov::Holes];
    let traced = Stage::alone(&subject, &settings).frame(0).linear.right().clone();
    settings.buffers.reproject = true;
    let mut stage = Stage::alone(&subject, &settings);
    let reprojected = stage.frame(0);
    let holes = stage.aov(0).right().clone();
    let filled: Vec<usize> = (0..traced.pixels.len()).filter(|&i| holes[0][i] > 0.0).collect();
    let counted: u64 = reprojected.report.tallies[1].holes.iter().sum();
    assert_eq!(filled.len() as u64, counted);
    assert!(filled.len() > 100, "{} holes", filled.len());
    for i in filled {
        let (found, expected) = (reprojected.linear.right().pixels[i], traced.pixels[i]);
        assert_eq!(found.map(f32::to_bits), expected.map(f32::to_bits), "pixel {i}");
    }
}

/// Returns the mean column and row of the pixels nearer than `depth`.
fn middle_of_near(depths: &[f32], width: usize, depth: f32) -> (f64, f64) {
    let near: Vec<usize> = (0..depths.len()).filter(|&i| depths[i] > 0.0 && depths[i] < depth).collect();
    assert!(near.len() > 50, "{} near pixels", near.len());
    let mean = |of: &dyn Fn(usize) -> usize| near.iter().map(|&i| of(i) as f64).sum::<f64>() / near.len() as f64;
    (mean(&|i| i % width), mean(&|i| i / width))
}

#[test]
fn near_object_has_the_expected_disparity() {
    let (width, height) = (160, 90);
    let mut scene = board_before_wall([2.0, 0.25], [40.0, 100.0]);
    scene.environment = diptych::scene::Environment::Constant(Vec3::ONE);
    let mut rig = still_rig(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y, 0.5);
    rig.baseline_m = 0.2;
    let subject = Subject::new("board before a wall", scene, rig);
    let mut settings = subject.settings(width, height);
    settings.buffers.aovs = vec![Aov::Depth];
    settings.buffers.reproject = true;
    let mut stage = Stage::alone(&subject, &settings);
    stage.frame(0);
    let depth = stage.aov(0);
    let (left_x, left_y) = middle_of_near(&depth.left()[0], width as usize, 10.0);
    let (right_x, right_y) = middle_of_near(&depth.right()[0], width as usize, 10.0);
    // Disparity is focal length in pixels times baseline over distance.
    let disparity = 0.5 * f64::from(height) / 0.5 * 0.2 / 2.0;
    assert!((left_x - right_x - disparity).abs() < 0.6, "{left_x} - {right_x} is not {disparity}");
    assert!((left_y - right_y).abs() < 1e-9);
    let middle = f64::from(width) / 2.0 - 0.5;
    assert!(left_x > middle && right_x < middle, "{left_x} and {right_x} on the sides of {middle}");
}
