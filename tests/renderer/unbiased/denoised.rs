//! Features of denoised frames change their noise and not their mean, or their mean only within bounds.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::LazyLock;

use super::{EXTENT, QUICK, RENDERS, Renders, detected, estimates, renders, subject};
use crate::common::{Stage, Subject, sampled};
use crate::reference::scenes::{lit, matte};
use crate::reference::ztest::assert_agrees;
use diptych::RunConfig;
use diptych::passes::denoise::Denoise;
use diptych::quality::{Denoiser, Filter};

/// A denoiser that leaves light as it was traced.
struct Identity;

impl Denoise for Identity {
    fn name(&self) -> &'static str {
        "identity"
    }

    fn help(&self) -> Option<&'static str> {
        None
    }

    fn leaves_out_narrow_lobes(&self) -> bool {
        true
    }
}

fn identity() -> Denoiser {
    static IDENTITY: LazyLock<Denoiser> = LazyLock::new(|| Denoiser::register(&Identity).unwrap());
    *IDENTITY
}

/// Returns the variance of a pixel's green value over renders, as the mean over pixels.
fn variance_of_pixels(renders: &Renders) -> f64 {
    let count = renders.len() as f64;
    let of_pixel = |i: usize| {
        let mean = renders.iter().map(|pixels| pixels[i][1]).sum::<f64>() / count;
        renders.iter().map(|pixels| (pixels[i][1] - mean).powi(2)).sum::<f64>() / (count - 1.0)
    };
    (0..EXTENT.area()).map(of_pixel).sum::<f64>() / EXTENT.area() as f64
}

/// Asserts that frames which the identity denoises have the same mean without and with a change. Returns the variance of
/// a frame of one sample per pixel with the change, divided by that without.
fn assert_mean_stays(name: &str, subject: &Subject, bounces: u32, change: fn(&mut RunConfig, bool)) -> f64 {
    let mut noise = f64::NAN;
    // One sample goes through the pixel's centre; several are spread over the pixel.
    for spp in [1, 4] {
        let side = |is_on: bool, seed: u32| {
            let mut settings = subject.settings(EXTENT.width, EXTENT.height);
            settings.seed = seed;
            let most = &mut settings.envelope.most;
            (most.filter, most.spp, most.bounces) = (Some(Filter::new(identity(), 1)), spp.into(), bounces);
            change(&mut settings, is_on);
            move |numbers: Range<u64>, _| renders(subject, 0.0, &settings, numbers)
        };
        let resolution = detected(QUICK.resolution);
        let [without, with] = estimates(resolution, [&mut side(false, 1), &mut side(true, 2)]);
        assert_agrees(&format!("{name}, {spp} spp"), &without, &with, resolution);
        if spp == 1 {
            let [without, with] =
                [false, true].map(|is_on| variance_of_pixels(&side(is_on, 3)(0..2 * RENDERS.start, spp)));
            noise = with / without;
        }
    }
    noise
}

/// Add rows in [`lit::HARD`].
#[test]
fn hard_shadow_bypass_keeps_the_mean() {
    for (name, light) in sampled(lit::HARD, 2) {
        let subject = subject(lit::things(name, light));
        assert!(subject.needs.hard_lights, "{name}");
        let noise = assert_mean_stays(name, &subject, 2, |settings, is_on| settings.hard_shadows = is_on);
        // Every path samples the only light. One of several adds noise if paths choose among them.
        let most = if name == "hard_point" { 1.001 } else { 0.8 };
        assert!(noise < most, "{name}: the variance is {noise} of that without");
    }
}

/// Follows mirrors in rows of these scenes with these reflections, few of which end in the middle of a chain of mirrors.
fn hold_following(rows: impl IntoIterator<Item = (lit::Row, u32)>, is_covered: fn(&Subject) -> bool) {
    for ((name, add), bounces) in rows {
        let subject = subject(lit::things(name, add));
        assert!(is_covered(&subject), "{name}");
        let noise = assert_mean_stays(name, &subject, bounces, |settings, is_on| settings.follow_mirrors = is_on);
        println!("{name}: {noise:.3} of the variance");
    }
}

/// Add rows in [`lit::MIRRORS`].
#[test]
fn mirror_following_keeps_the_mean() {
    let rows = lit::MIRRORS.into_iter().zip([4, 2, 3, 3, 5, 3]);
    hold_following(sampled(rows, 6), |subject| subject.needs.mirrors);
}

/// Add rows in [`lit::POLISHED`].
#[test]
fn polish_following_keeps_the_mean() {
    let rows = lit::POLISHED.into_iter().zip([2, 3, 3, 2]);
    hold_following(sampled(rows, 4), |subject| subject.needs.polish);
}

/// Add rows in [`lit::NARROW`].
#[test]
fn narrow_lobe_bypass_keeps_mean_and_variance() {
    for (name, add_balls) in sampled(lit::NARROW.into_iter().chain([lit::MIRRORS[2]]), 3) {
        let subject = subject(lit::things(name, add_balls));
        assert!(subject.needs.narrow_lobes, "{name}");
        let noise = assert_mean_stays(name, &subject, 2, |settings, is_on| settings.bypass_narrow_lobes = is_on);
        assert!((noise - 1.0).abs() < 0.01, "{name}: the variance is {noise} of that without");
    }
}

/// The bias is bounded in each block of pixels, since the mean of the picture would hide a caustic that is lost.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn regularization_calms_caustics_and_keeps_light() {
    const BLOCK: usize = 8;
    let caustics = subject(lit::caustics());
    let matte = subject(matte::box_area_light());
    assert!(caustics.needs.narrow_lobes && !matte.needs.narrow_lobes);
    let settings = |subject: &Subject, regularize| {
        let mut settings = RunConfig { regularize, ..subject.accumulated(EXTENT.width, EXTENT.height) };
        settings.envelope.most.filter = Some(Filter::new(identity(), 1));
        settings.envelope.most.bounces = 3;
        settings
    };
    let frame = |subject: &Subject, settings: &RunConfig| Stage::alone(subject, settings).frame(0).linear.into_left();
    assert!(frame(&matte, &settings(&matte, true)) == frame(&matte, &settings(&matte, false)));

    let of = |regularize, count| renders(&caustics, 0.0, &settings(&caustics, regularize), 0..count);
    let [with, without] = [of(true, 256), of(false, 2048)];
    let noise = variance_of_pixels(&with) / variance_of_pixels(&without);
    let means = |renders: &Renders| {
        let width = EXTENT.width as usize;
        let mut blocks = BTreeMap::new();
        for (i, _) in renders[0].iter().enumerate() {
            let sum = renders.iter().map(|pixels| pixels[i][1]).sum::<f64>() / renders.len() as f64;
            *blocks.entry((i % width / BLOCK, i / width / BLOCK)).or_insert(0.0) += sum;
        }
        blocks.into_values().collect::<Vec<f64>>()
    };
    let ratios = means(&with).iter().zip(means(&without)).map(|(a, b)| a / b).collect::<Vec<_>>();
    let [least, most] = [f64::min, f64::max].map(|pick| ratios.iter().copied().reduce(pick).unwrap());
    println!("{noise:.3} of the variance, blocks have {least:.3} to {most:.3} of the light");
    assert!(noise < 0.5 && least > 0.8 && most < 1.2, "{noise}, {least} to {most}");
}
