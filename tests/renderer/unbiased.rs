//! The renderer's mean is that of an independent path tracer, and more samples only make it quieter.

use crate::common::{Stage, Subject, is_thorough, still_rig};
use crate::reference::scenes::{lit, materials, matte, moving};
use crate::reference::ztest::{Estimate, assert_agrees, compare, mean_and_variance, verdict};
use crate::reference::{Pinhole, Reference};
use diptych::exec::RenderSettings;
use diptych::image::{Extent, RgbImage};
use diptych::scene::Scene;
use diptych::scene::rig::Eye;
use diptych::stages::Sampler;

const WIDTH: u32 = 48;
const HEIGHT: u32 = 32;

struct Effort {
    extent: Extent,
    reference_spp: u32,
    /// Samples of each of eight renders.
    renders: [(Sampler, u32); 2],
    /// Of the two samplers, rows of a table take turns.
    takes_turns: bool,
    bounces: &'static [u32],
    /// Bias of the image's mean that the test is sure to see.
    resolution: f64,
}

const QUICK: Effort = Effort {
    extent: Extent::new(32, 24),
    reference_spp: 256,
    renders: [(Sampler::Sobol, 32), (Sampler::Pcg, 48)],
    takes_turns: true,
    bounces: &[4],
    resolution: 0.035,
};

/// In the classic box, light on the ceiling beside the lamp makes most of the renderer's noise.
const BOX: Effort = Effort { resolution: 0.16, ..QUICK };

const THOROUGH_BOX: Effort = Effort {
    extent: Extent::new(WIDTH, HEIGHT),
    reference_spp: 512,
    renders: [(Sampler::Sobol, 64), (Sampler::Pcg, 96)],
    resolution: 0.08,
    bounces: &[1, 4],
    takes_turns: false,
};

/// Enough to see what a sun's disc of 3° loses if it is normalised by its solid angle, 0.07 % of its light.
const THOROUGH: Effort = Effort {
    extent: Extent::new(WIDTH, HEIGHT),
    reference_spp: 8192,
    renders: [(Sampler::Sobol, 1024), (Sampler::Pcg, 2048)],
    takes_turns: false,
    bounces: &[1, 4],
    resolution: 0.005,
};

/// For the tables of many scenes.
const ROW: Effort = Effort {
    extent: Extent::new(24, 16),
    reference_spp: 192,
    renders: [(Sampler::Sobol, 16), (Sampler::Pcg, 24)],
    resolution: 0.06,
    ..QUICK
};

/// A coat takes a few percent of what an emitter sends.
const CARD: Effort =
    Effort { reference_spp: 1024, renders: [(Sampler::Sobol, 128), (Sampler::Pcg, 160)], resolution: 0.045, ..ROW };

const THOROUGH_ROW: Effort = Effort { resolution: 0.01, ..THOROUGH };

/// Frames of scenes that move, at a time when they do.
const MOVING: Effort = Effort { reference_spp: 256, renders: [(Sampler::Sobol, 32), (Sampler::Pcg, 48)], ..ROW };

/// What the left eye of the subject's rig sees, as the reference has it.
fn pinhole(subject: &Subject) -> Pinhole {
    let view = subject.rig.view(0.0, Eye::Left);
    Pinhole {
        origin: view.origin,
        right: view.right,
        up: view.up,
        forward: view.forward,
        tan_half_yfov: view.tan_half_yfov,
    }
}

/// The rigs' eyes coincide, so that both are renders of the same view, with random numbers of their own.
fn renders(subject: &Subject, time_s: f64, settings: &RenderSettings, frames: u32) -> Vec<RgbImage> {
    assert_eq!(subject.rig.baseline_m, 0.0);
    let mut stage = Stage::alone(subject, settings);
    (0..frames).map(|i| stage.frame_at(time_s, i).linear).flat_map(|eyes| [eyes.left, eyes.right]).collect()
}

/// Light over up to max(`bounces`, 1) reflections. The reference counts one less.
fn expected(subject: &Subject, time_s: f64, bounces: u32, effort: &Effort) -> Estimate {
    let scene = subject.scene.at(time_s);
    let reference = Reference::new(&scene);
    reference.render(&pinhole(subject), effort.extent, effort.reference_spp, bounces.max(1) - 1, 1)
}

/// What speaks against the renderer's means being the reference's in the table's `row`.
fn against(row: usize, (subject, time_s): (&Subject, f64), effort: &Effort) -> Vec<String> {
    let mut against = Vec::new();
    let turn = effort.takes_turns.then_some(row % effort.renders.len());
    for &bounces in effort.bounces {
        let expected = expected(subject, time_s, bounces, effort);
        for (i, (sampler, spp)) in effort.renders.into_iter().enumerate() {
            if turn.is_some_and(|turn| turn != i) {
                continue;
            }
            let mut settings = subject.settings(effort.extent.width, effort.extent.height);
            settings.bounces = bounces;
            settings.seed = 3 + bounces;
            settings.stages.sampler = sampler;
            settings.stages.spp = spp;
            let found = mean_and_variance(&renders(subject, time_s, &settings, 4));
            let what = format!("{}, {bounces} reflections, {sampler:?}", subject.name);
            let report = compare(&expected, &found);
            println!("{what}\n{report}");
            against.extend(verdict(&report, effort.resolution).iter().map(|line| format!("{what}: {line}")));
        }
    }
    against
}

/// Looks at all of them before it fails.
fn hold_against_the_reference(subjects: impl IntoIterator<Item = Subject>, effort: &Effort) {
    hold_at(subjects.into_iter().map(|subject| (subject, 0.0)), effort);
}

/// As they are at these times.
fn hold_at(subjects: impl IntoIterator<Item = (Subject, f64)>, effort: &Effort) {
    let rows = subjects.into_iter().enumerate();
    let against: Vec<String> =
        rows.flat_map(|(row, (subject, time_s))| against(row, (&subject, time_s), effort)).collect();
    assert!(against.is_empty(), "the images differ\n{}", against.join("\n"));
}

/// A scene as its camera sees it, with both eyes.
fn subject((scene, camera): (Scene, Pinhole)) -> Subject {
    let rig = still_rig(camera.origin, camera.forward, camera.up, camera.tan_half_yfov);
    Subject::new(&scene.name.clone(), scene, rig)
}

fn matte_scenes() -> impl Iterator<Item = Subject> {
    matte::all().into_iter().map(|(_, scene, camera)| subject((scene, camera)))
}

#[test]
fn every_matte_scene_is_unbiased() {
    hold_against_the_reference(matte_scenes(), &QUICK);
}

/// Rows are added in [`lit::ALL`].
#[test]
fn every_kind_of_light_is_unbiased_on_every_kind_of_surface() {
    hold_against_the_reference(lit::ALL.map(|(name, light)| subject(lit::things(name, light))), &ROW);
}

/// Rows are added in [`lit::CARDS`].
#[test]
fn emitters_with_alpha_or_a_coat_are_unbiased() {
    hold_against_the_reference(lit::CARDS.map(|(name, light)| subject(lit::things(name, light))), &CARD);
}

/// Rows are added in [`materials::ALL`].
#[test]
fn every_material_is_unbiased() {
    hold_against_the_reference(materials::ALL.map(|(_, scene)| subject(scene())), &ROW);
}

/// Tables that were brought to a time hold the scene of that time. Rows take turns in samplers and are of two times.
#[test]
fn scenes_that_move_are_unbiased_at_every_time() {
    let scenes = [
        (moving::skinned(), 0.8),
        (moving::morphed(), 0.6),
        (moving::rigid(), 1.4),
        (moving::lights(), 0.7),
        (moving::emissive(), 0.9),
        (moving::switched(), 0.5),
        (moving::switched(), 1.3),
    ];
    hold_at(scenes.map(|(scene, time_s)| (subject((scene, moving::camera())), time_s)), &MOVING);
}

#[test]
#[ignore = "takes many minutes: run it after changes to the material model"]
fn no_material_and_no_light_has_a_small_bias() {
    let lit = lit::ALL.into_iter().chain(lit::CARDS).map(|(name, light)| lit::things(name, light));
    let scenes = lit.chain(materials::ALL.map(|(_, scene)| scene()));
    hold_against_the_reference(scenes.map(subject), &THOROUGH_ROW);
}

#[test]
#[ignore = "takes minutes: run it after changes to lights, sampling or intersection"]
fn no_scene_has_a_small_bias() {
    hold_against_the_reference(matte_scenes(), &THOROUGH);
}

#[test]
fn the_classic_box_is_unbiased() {
    let mut subject = Subject::load("builtin:cornell");
    subject.rig.baseline_m = 0.0;
    hold_against_the_reference([subject], if is_thorough() { &THOROUGH_BOX } else { &BOX });
}

#[test]
fn no_bounces_are_direct_light_as_is_one() {
    let subject = subject(matte::box_area_light());
    let render = |bounces| {
        let settings = RenderSettings { bounces, ..subject.settings(WIDTH, HEIGHT) };
        Stage::alone(&subject, &settings).frame(0).linear.left
    };
    assert!(render(0) == render(1));
    assert!(render(1) != render(2));
}

/// Runs of one seed are alike, and those of two are as independent as two frames.
#[test]
fn seeds_name_random_numbers_of_their_own() {
    let subject = subject(matte::box_area_light());
    let render = |seed, index| {
        let settings = RenderSettings { seed, ..subject.settings(WIDTH, HEIGHT) };
        Stage::alone(&subject, &settings).frame(index).linear.left
    };
    let [first, again, other, later] = [(1, 0), (1, 0), (2, 0), (1, 1)].map(|(seed, index)| render(seed, index));
    assert!(first == again);
    let differing = |image: &RgbImage| first.pixels.iter().zip(&image.pixels).filter(|(a, b)| a != b).count();
    let [of_seeds, of_frames] = [&other, &later].map(differing);
    assert!(of_frames > first.pixels.len() / 2, "{of_frames} pixels have light of their own in another frame");
    assert!(
        of_seeds.abs_diff(of_frames) < of_frames / 10,
        "{of_seeds} with another seed, {of_frames} in another frame"
    );
}

/// Batches, running means and jitter: many samples in one frame have the mean of many frames of few samples.
#[test]
fn samples_of_a_frame_and_of_several_frames_have_one_mean() {
    let subject = subject(matte::box_area_light());
    let estimate = |spp, frames| {
        let mut settings = subject.settings(WIDTH, HEIGHT);
        settings.bounces = 2;
        settings.stages.sampler = Sampler::Pcg;
        settings.stages.spp = spp;
        mean_and_variance(&renders(&subject, 0.0, &settings, frames))
    };
    // 100 samples make four batches, the last of them short.
    assert_agrees("100 x 8 and 2 x 200", &estimate(100, 4), &estimate(2, 200), QUICK.resolution);
}
