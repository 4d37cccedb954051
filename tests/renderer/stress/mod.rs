//! Scenes that strain the arithmetic. No sample is dropped, every pixel is a valid radiance, and the row's claim about
//! its scene holds.

mod moved;
mod rows;
mod surfaces;

use crate::common::{Stage, Subject, foveate, is_thorough, sampled};
use crate::pictures::{brightest, mean, rig_of};
use crate::reference::Pinhole;
use diptych::frame::{Foveation, Sampler};
use diptych::image::RgbImage;
use diptych::scene::needs::SceneNeeds;
use diptych::scene::{AlphaMode, Scene};

const WIDTH: u32 = 32;
const HEIGHT: u32 = 18;

/// Maximum number of samples in a quick run. Rows should fail for arithmetic, not for a low number of samples.
const MOST_SPP: u32 = 16;

/// Settings for rendering a scene.
#[derive(Clone, Copy)]
struct Effort {
    size: [u32; 2],
    spp: u32,
    bounces: u32,
    seed: u32,
}

impl Effort {
    const fn new(spp: u32, bounces: u32) -> Self {
        Self { size: [WIDTH, HEIGHT], spp, bounces, seed: 5 }
    }
}

/// A scene, its camera, and a claim about its image, which must also be finite.
struct Row {
    name: &'static str,
    seen: (Scene, Pinhole),
    effort: Effort,
    claim: Box<dyn Fn(&RgbImage)>,
}

/// Returns a scene seen by its camera in both eyes.
fn subject(name: &str, (scene, camera): (Scene, Pinhole)) -> Subject {
    Subject::new(name, scene, rig_of(&camera))
}

#[track_caller]
fn assert_radiance(image: &RgbImage, what: &str) {
    let wrong = image.pixels.as_flattened().iter().find(|c| !c.is_finite() || **c < 0.0);
    assert_eq!(wrong, None, "{what}: a pixel is no radiance");
}

/// Renders both eyes of `frames` frames with independent random numbers; every sample must be finite.
fn renders(subject: &Subject, effort: Effort, sampler: Sampler, frames: u32) -> Vec<RgbImage> {
    let mut settings = subject.settings(effort.size[0], effort.size[1]);
    settings.envelope.most.bounces = effort.bounces;
    settings.seed = effort.seed;
    settings.envelope.most.spp = effort.spp.into();
    settings.sampler = sampler;
    let mut stage = Stage::alone(subject, &settings);
    let images: Vec<_> = (0..frames).map(|i| stage.frame(i).linear).flat_map(|eyes| eyes.into_outer()).collect();
    images.iter().for_each(|image| assert_radiance(image, &subject.name));
    images
}

fn image(name: &str, seen: (Scene, Pinhole), mut effort: Effort) -> RgbImage {
    let subject = subject(name, seen);
    if !is_thorough() {
        effort.spp = effort.spp.min(MOST_SPP);
    }
    renders(&subject, effort, Sampler::Sobol, 1).swap_remove(0)
}

fn hold(row: Row) {
    let image = image(row.name, row.seen, row.effort);
    println!("{:40} mean {:.6e}, brightest {:.6e}", row.name, mean(&image), brightest(&image));
    (row.claim)(&image);
}

#[test]
fn every_sample_of_every_row_is_finite() {
    sampled(rows::all(), 4).for_each(hold);
}

/// Accumulation, filters and TAA give a valid radiance everywhere, even from few samples.
#[test]
fn every_row_is_finite_through_history_and_filters() {
    for row in sampled(rows::all(), 24) {
        let subject = subject(row.name, row.seen);
        let [width, height] = row.effort.size;
        let mut settings = subject.accumulated(width, height);
        settings.envelope.most.bounces = row.effort.bounces;
        // All rows use the same shaders, with specular radiance.
        settings.buffers.needs = SceneNeeds::ALL;
        foveate(&mut settings, Default::default(), Foveation::default(), [2, 3, 5]);
        let mut stage = Stage::alone(&subject, &settings);
        for frame in 0..3 {
            let linear = stage.frame(frame).linear;
            linear.outer().into_iter().for_each(|eye| assert_radiance(eye, row.name));
        }
    }
}

/// However many layers a ray must pass, on any driver, its sample is correct or counted as dropped.
#[test]
fn terminated_rays_are_counted() {
    for count in [1000, 5000, 100_000] {
        let subject = subject(&format!("{count} layers"), rows::layers(count, AlphaMode::Blend));
        for spp in [1, 8] {
            let mut settings = subject.settings(8, 8);
            settings.envelope.most.spp = spp.into();
            let frame = Stage::alone(&subject, &settings).frame_with_drops(0);
            let wrong = frame.linear.left().pixels.iter().filter(|pixel| **pixel != [1.0; 3]).count();
            let dropped = frame.report.tallies[0].nonfinite;
            println!("{count} layers, {spp} samples: {wrong} of 64 pixels are not right, {dropped} samples counted");
            assert!(wrong as u64 <= dropped, "{count} layers: {wrong} pixels are wrong and {dropped} samples counted");
            assert!(count > 1000 || dropped == 0, "{count} layers: {dropped} samples were dropped");
        }
    }
}

/// Light that is finite in each sample may overflow in a sum, in a division by albedo, or with a surface's emission.
#[test]
fn overflowing_light_is_dropped_and_counted() {
    let subject = subject("too bright", rows::too_bright());
    let [plain, denoised, accumulated] = [Subject::settings, Subject::denoised, Subject::accumulated];
    for (name, settings) in [("plain", plain), ("denoised", denoised), ("accumulated", accumulated)] {
        for (spp, gloss) in sampled([(1, true), (1, false), (4, true)], 2) {
            let mut settings = settings(&subject, WIDTH, HEIGHT);
            settings.envelope.most.spp = spp.into();
            settings.buffers.needs.gloss = gloss;
            let mut stage = Stage::alone(&subject, &settings);
            for frame in 0..3 {
                let frame = stage.frame_with_drops(frame);
                let dropped: Vec<u64> = frame.report.tallies.iter().map(|tally| tally.nonfinite).collect();
                println!("{name}, {spp} samples, gloss {gloss}: {dropped:?} dropped");
                frame.linear.outer().into_iter().for_each(|eye| assert_radiance(eye, name));
                assert!(dropped.iter().sum::<u64>() > 0, "{name}, {spp} samples, gloss {gloss}: nothing was counted");
            }
        }
    }
}

#[test]
#[ignore = "takes minutes: run it after changes to lights, sampling or intersection"]
fn every_one_of_many_samples_is_finite() {
    for row in rows::all() {
        let effort = Effort { spp: row.effort.spp.max(256), seed: 77, ..row.effort };
        renders(&subject(row.name, row.seen), effort, Sampler::Sobol, 1);
    }
}
