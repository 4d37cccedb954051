//! The z-test.

use diptych::image::{Extent, Image, RgbImage};

use crate::reference::Reference;
use crate::reference::sampling::Rng;
use crate::reference::scenes::matte;
use crate::reference::ztest::{Estimate, Moments, assert_agrees, compare, mean_and_variance, verdict};

/// Returns K renders of independent noise around `mean` with a standard deviation of 0.3.
fn noise(extent: Extent, renders: u64, mean: f32, seed: u64) -> Vec<RgbImage> {
    (0..renders)
        .map(|k| {
            let mut rng = Rng::new(seed, k);
            let mut image = Image::filled(extent, [0.0; 3]);
            for x in image.pixels.as_flattened_mut() {
                *x = mean + 0.3 * rng.normal() as f32;
            }
            image
        })
        .collect()
}

#[test]
fn equal_means_pass_and_have_the_documented_z() {
    let extent = Extent::new(100, 76);
    let (mut squares, mut tails) = (0.0, 0.0);
    for seed in 0..20 {
        let a = mean_and_variance(&noise(extent, 8, 1.0, 2 * seed));
        let b = mean_and_variance(&noise(extent, 8, 1.0, 2 * seed + 1));
        let report = assert_agrees("noise", &a, &b, 0.015);
        squares += report.block_mean_square() / 20.0;
        tails += report.blocks_beyond_3() / 20.0;
        // The distribution is like Student's t with 14 degrees of freedom: 1 % beyond 3.
        assert!((0.005..0.015).contains(&report.pixels_beyond_3), "{report}");
    }
    assert!((squares - 1.0).abs() < 0.05, "{squares}");
    assert!(tails < 0.006, "{tails}");
}

#[test]
fn global_and_local_biases_are_detected() {
    let extent = Extent::new(96, 72);
    let a = mean_and_variance(&noise(extent, 12, 1.0, 1));
    let brighter = mean_and_variance(&noise(extent, 12, 1.01, 2));
    let against = verdict(&compare(&a, &brighter), 0.01);
    assert!(against.len() == 1 && against[0].contains("image mean"), "{against:?}");

    let mut spoilt = noise(extent, 12, 1.0, 3);
    for image in &mut spoilt {
        for y in 24..32 {
            for x in 40..48 {
                image.pixels[y * 96 + x][1] += 0.15;
            }
        }
    }
    let against = verdict(&compare(&a, &mean_and_variance(&spoilt)), 0.01);
    assert!(against.iter().any(|line| line.contains("max |z|")), "{against:?}");
}

#[test]
fn rejects_excessive_noise_and_non_finite_values() {
    let extent = Extent::new(32, 32);
    let a = mean_and_variance(&noise(extent, 4, 1.0, 1));
    let mut b = mean_and_variance(&noise(extent, 4, 1.0, 2));
    assert!(verdict(&compare(&a, &b), 0.05).is_empty());
    assert!(verdict(&compare(&a, &b), 0.005).iter().any(|line| line.contains("noisy")));
    b.mean[100][2] = f64::NAN;
    assert!(verdict(&compare(&a, &b), 0.05).len() > 1);
}

/// Images without noise may differ by f32 rounding and no more.
#[test]
fn exact_images_agree_to_rounding() {
    let flat = |value: f64| {
        let mut moments = Moments::default();
        moments.add([value; 3]);
        moments.add([value; 3]);
        Estimate::from_moments(Extent::new(16, 16), &[moments; 256])
    };
    assert!(verdict(&compare(&flat(0.5), &flat(0.5 * (1.0 + 1e-6))), 0.005).is_empty());
    assert!(verdict(&compare(&flat(0.0), &flat(0.0)), 0.005).is_empty());
    assert!(!verdict(&compare(&flat(0.5), &flat(0.5005)), 0.005).is_empty());
}

/// Pixels of a render share a random number, so only the spread of the renders' means shows the error of the image's
/// mean.
#[test]
fn shared_errors_count_in_the_variance_of_the_image() {
    let extent = Extent::new(16, 8);
    let estimate = |mean: f64, seed: u64| {
        let render = |k: u64| {
            let shared = mean * (1.0 + 0.02 * (Rng::new(seed, k).uniform() - 0.5));
            vec![[shared; 3]; extent.area()]
        };
        Estimate::from_renders(extent, (0..32).map(render).collect())
    };
    let image_mean = |against: Vec<String>| against.iter().any(|line| line.contains("image mean"));
    let (mut squares, mut seen) = (0.0, 0);
    for seed in 0..200 {
        let report = compare(&estimate(1.0, 2 * seed), &estimate(1.0, 2 * seed + 1));
        assert!(!image_mean(verdict(&report, 0.01)), "{report}");
        squares += report.image_z[0] * report.image_z[0] / 200.0;
        // The standard error is 0.02 / √12 / √32 · √2 = 0.00144, estimated with 62 degrees of freedom.
        let bias = 0.00144 * (3.8 + 1.3);
        assert!((0.7 * bias..1.3 * bias).contains(&report.surely_found[0]), "{report}");
        let biased = compare(&estimate(1.0, 2 * seed), &estimate(1.0 + bias, 2 * seed + 1));
        seen += u32::from(image_mean(verdict(&biased, 0.01)));
    }
    assert!((squares - 1.0).abs() < 0.35, "{squares}");
    assert!((160..200).contains(&seen), "a bias that nine of ten tries find is found {seen} times in 200");
}

/// A lattice has the same mean as independent paths and less noise.
#[test]
fn lattice_has_the_mean_of_independent_paths() {
    let (scene, camera) = matte::environment_only();
    let reference = Reference::new(&scene);
    let extent = Extent::new(16, 8);
    let lattice = Estimate::from_renders(extent, reference.renders(&camera, extent, 16, 1, 0..32));
    let independent = reference.render(&camera, extent, 512, 1, 1);
    assert_agrees("lattice", &independent, &lattice, 0.015);
    let paths = Estimate::from_renders(
        extent,
        (0..32).map(|seed| reference.render(&camera, extent, 16, 1, seed).mean).collect(),
    );
    let [a, b] = [&lattice, &paths].map(Estimate::variance_of_image);
    assert!(a < 0.5 * b, "{a} and {b}");
}
