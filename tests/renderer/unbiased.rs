//! The renderer's mean equals that of an independent path tracer, and more samples only reduce noise.

mod denoised;

use std::ops::Range;

use crate::common::{Stage, Subject, is_thorough, sampled, with};
use crate::pictures::seen;
use crate::reference::scenes::{lit, lobes, materials, matte, moving};
use crate::reference::tangents;
use crate::reference::ztest::{Estimate, assert_agrees, compare, verdict};
use crate::reference::{Pinhole, Reference};
use diptych::RunConfig;
use diptych::frame::Sampler;
use diptych::image::{Extent, RgbImage};
use diptych::scene::Scene;
use diptych::scene::gltf;
use diptych::scene::load::load_shot;
use diptych::scene::rig::{Eye, View};
use glam::{Vec3, vec3};

/// Few pixels with many samples each. Powers of two suit low-discrepancy points and workgroups.
const EXTENT: Extent = Extent::new(16, 8);

/// Minimum number of renders for an estimate, so that their spread is known, and the maximum.
const RENDERS: Range<u64> = 32..16384;

/// Samples per render, at first and for scenes that turn out to be noisy: larger point sets are distributed better.
const SPP: [u32; 2] = [8, 32];

struct Effort {
    samplers: &'static [Sampler],
    /// True if rows of a table alternate between the samplers.
    takes_turns: bool,
    bounces: &'static [u32],
    /// Relative bias of the image's mean that the test must detect under `make test-full`. It determines the number of
    /// renders.
    resolution: f64,
}

/// Returns the relative bias of the image's mean that a test must detect. Twice the bias takes a quarter of the renders,
/// with which `make test` detects the faults that lose or double the light of a lobe or a lamp.
fn detected(resolution: f64) -> f64 {
    if is_thorough() { resolution } else { 2.0 * resolution }
}

const QUICK: Effort = Effort { samplers: &[Sampler::Sobol], takes_turns: false, bounces: &[4], resolution: 0.01 };

/// For scenes with little noise, because independent numbers add more.
const BOTH_SAMPLERS: Effort =
    Effort { samplers: &[Sampler::Sobol, Sampler::Pcg], takes_turns: true, bounces: &[3], ..QUICK };

/// For light that samples and bounces find, at the first surface and at the next.
const LIT: Effort = Effort { bounces: &[2], ..QUICK };

/// For light that samples and directions from the first surface find.
const CARD: Effort = Effort { bounces: &[1], ..QUICK };

const THOROUGH: Effort =
    Effort { samplers: &[Sampler::Sobol, Sampler::Pcg], takes_turns: false, bounces: &[1, 4], resolution: 0.004 };

/// A sun's disc of 3° that is normalised by its solid angle loses 0.07 % of its light, and this resolution detects
/// that.
const SUN: Effort = Effort { samplers: &[Sampler::Sobol], bounces: &[1], resolution: 0.0007, ..THOROUGH };

/// Returns the left eye of the subject's rig as the reference's camera.
pub fn pinhole(subject: &Subject) -> Pinhole {
    let View { origin, right, up, forward, tan_half_yfov, .. } = subject.rig.view(0.0, Eye::LEFT);
    Pinhole { origin, right, up, forward, tan_half_yfov }
}

type Renders = Vec<Vec<[f64; 3]>>;

/// Renders until both means are accurate enough to detect a difference of `resolution`. Each side gets a range of
/// render numbers and a number of samples. If [`RENDERS`] do not suffice, the verdict says so.
fn estimates(resolution: f64, mut sides: [&mut dyn FnMut(Range<u64>, u32) -> Renders; 2]) -> [Estimate; 2] {
    let mut spp = [SPP[0]; 2];
    let mut renders = sides.each_mut().map(|render| render(0..RENDERS.start, SPP[0]));
    loop {
        let known = renders.each_ref().map(|renders| Estimate::from_renders(EXTENT, renders.clone()));
        let report = compare(&known[0], &known[1]);
        let counts = renders.each_ref().map(|renders| renders.len() as u64);
        let excess = report.surely_found.iter().fold(0.0f64, |most, bias| most.max(*bias)) / resolution;
        if excess <= 1.0 || counts.contains(&RENDERS.end) {
            println!("{} renders of {} samples and {} of {}", counts[0], spp[0], counts[1], spp[1]);
            return known;
        }
        // Add renders on the side whose variance falls faster.
        let fall = |i: usize| known[i].variance_of_image() / (counts[i] * u64::from(spp[i])) as f64;
        let i = if fall(0) > fall(1) { 0 } else { 1 };
        if excess > 1.5 && spp[i] == SPP[0] {
            spp[i] = SPP[1];
            renders[i] = sides[i](0..RENDERS.start, SPP[1]);
        } else {
            let more = (counts[i] / 4).next_multiple_of(4).min(RENDERS.end - counts[i]);
            renders[i].extend(sides[i](counts[i]..counts[i] + more, spp[i]));
        }
    }
}

/// Renders both eyes, which have the same view with independent random numbers.
fn renders(subject: &Subject, time_s: f64, settings: &RunConfig, numbers: Range<u64>) -> Renders {
    assert_eq!(subject.rig.baseline_m, 0.0);
    let mut stage = Stage::alone(subject, settings);
    let frames = (numbers.start / 2..numbers.end / 2).map(|i| stage.frame_at(time_s, i as u32).linear);
    let images = frames.flat_map(|eyes| eyes.into_outer());
    images.map(|image| image.pixels.iter().map(|pixel| pixel.map(f64::from)).collect()).collect()
}

/// Returns the evidence against equal means of renderer and reference for the table's `row`.
fn against(row: usize, (subject, time_s): (&Subject, f64), effort: &Effort) -> Vec<String> {
    let scene = subject.scene.at(time_s);
    let reference = Reference::new(&scene);
    // Each row has independent random numbers.
    let seed = 1 + row as u32;
    let turn = effort.takes_turns.then_some(row % effort.samplers.len());
    let mut against = Vec::new();
    for &bounces in effort.bounces {
        for (i, &sampler) in effort.samplers.iter().enumerate() {
            if turn.is_some_and(|turn| turn != i) {
                continue;
            }
            let what = format!("{}, {bounces} reflections, {sampler:?}", subject.name);
            print!("{what}, ");
            // Light after up to max(`bounces`, 1) bounces; the reference counts one less.
            let mut expect = |numbers: Range<u64>, spp| {
                let first = u64::from(seed) * RENDERS.end;
                let seeds = first + numbers.start..first + numbers.end;
                reference.renders(&pinhole(subject), EXTENT, spp, bounces.max(1) - 1, seeds)
            };
            let mut settings = subject.settings(EXTENT.width, EXTENT.height);
            (settings.envelope.most.bounces, settings.seed, settings.sampler) = (bounces, seed, sampler);
            let mut find = |numbers, spp: u32| {
                settings.envelope.most.spp = spp.into();
                renders(subject, time_s, &settings, numbers)
            };
            let resolution = detected(effort.resolution);
            let [expected, found] = estimates(resolution, [&mut expect, &mut find]);
            let report = compare(&expected, &found);
            println!("{report}");
            against.extend(verdict(&report, resolution).iter().map(|line| format!("{what}: {line}")));
        }
    }
    against
}

/// Checks all subjects before it fails.
fn hold_against_the_reference(subjects: impl IntoIterator<Item = Subject>, effort: &Effort) {
    hold_at(subjects.into_iter().map(|subject| (subject, 0.0)), effort);
}

/// Checks scenes at these times.
fn hold_at(subjects: impl IntoIterator<Item = (Subject, f64)>, effort: &Effort) {
    let rows = subjects.into_iter().enumerate();
    let against: Vec<String> =
        rows.flat_map(|(row, (subject, time_s))| against(row, (&subject, time_s), effort)).collect();
    assert!(against.is_empty(), "the images differ\n{}", against.join("\n"));
}

/// Returns a scene seen by its camera in both eyes, with less above and below and more at the sides than in other
/// pictures.
fn subject((scene, camera): (Scene, Pinhole)) -> Subject {
    seen((scene, Pinhole { tan_half_yfov: 0.8 * camera.tan_half_yfov, ..camera }))
}

fn matte_scenes() -> impl Iterator<Item = Subject> {
    matte::all().into_iter().map(subject)
}

#[test]
fn every_diffuse_scene_is_unbiased() {
    hold_against_the_reference(sampled(matte_scenes(), 3), &QUICK);
}

/// Add rows in [`lit::ALL`].
#[test]
fn every_light_is_unbiased_on_every_material() {
    hold_against_the_reference(sampled(lit::ALL, 3).map(|(name, light)| subject(lit::things(name, light))), &LIT);
}

/// Add rows in [`lit::CARDS`].
#[test]
fn emitters_with_alpha_or_a_coat_are_unbiased() {
    hold_against_the_reference(sampled(lit::CARDS, 2).map(|(name, light)| subject(lit::things(name, light))), &CARD);
}

/// Add rows in [`materials::ALL`].
#[test]
fn every_material_is_unbiased() {
    hold_against_the_reference(sampled(materials::ALL, 3).map(|row| subject(materials::build(row))), &BOTH_SAMPLERS);
}

/// Add rows in [`lobes::ALL`].
#[test]
fn every_lobe_of_an_extension_is_unbiased() {
    hold_against_the_reference(sampled(lobes::ALL, 6).map(|row| subject(materials::build(row))), &BOTH_SAMPLERS);
}

/// Tables that were updated to a time represent the scene at that time.
#[test]
fn animated_scenes_are_unbiased_at_any_time() {
    let scenes = [
        (moving::skinned(), 0.8),
        (moving::morphed(), 0.6),
        (moving::rigid(), 1.4),
        (moving::lights(), 0.7),
        (moving::emissive(), 0.9),
        (moving::switched(), 0.5),
        (moving::switched(), 1.3),
    ];
    hold_at(sampled(scenes, 3).map(|(scene, time_s)| (subject((scene, moving::camera())), time_s)), &LIT);
}

/// Tangents missing from the file follow glTF's definition: for base and coat maps, both coordinate sets, meshes
/// without normals, and mirrored images.
#[test]
fn generated_tangents_follow_the_gltf_definition() {
    let (scene, camera) = materials::mapped_without_tangents();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("mapped.glb");
    gltf::write(&file, &scene).unwrap();
    let (_, mut loaded) = load_shot(file.to_str().unwrap()).unwrap();
    (loaded.environment, loaded.lights) = (scene.environment, scene.lights);
    let mut subject = subject((loaded, camera));
    let mut mapped = 0;
    for mesh in &mut subject.scene.meshes {
        let material = &subject.scene.materials[mesh.material];
        let Some(map) = material.normal_map.or(material.clearcoat.normal_map) else { continue };
        let found = mesh.tangents.clone();
        tangents::define(mesh, map.texture);
        for (found, expected) in found.iter().zip(&mesh.tangents) {
            assert!(found.distance(*expected) < 1e-3, "{found} is not {expected}");
        }
        mapped += 1;
    }
    assert_eq!(mapped, 3);
    // A bias of 0.01 is that of an image which is flipped where it is mirrored.
    hold_against_the_reference([subject], &Effort { resolution: 0.005, ..CARD });
}

#[test]
#[ignore = "takes many minutes: run it after changes to the material model"]
fn no_material_and_no_light_has_a_small_bias() {
    let lit = lit::ALL.into_iter().chain(lit::CARDS).map(|(name, light)| lit::things(name, light));
    let scenes = lit.chain(materials::ALL.into_iter().chain(lobes::ALL).map(materials::build));
    hold_against_the_reference(scenes.map(subject), &THOROUGH);
}

#[test]
#[ignore = "takes minutes: run it after changes to lights, sampling or intersection"]
fn no_scene_has_a_small_bias() {
    hold_against_the_reference(matte_scenes(), &THOROUGH);
    hold_against_the_reference([subject(matte::point_spot_directional())], &SUN);
}

/// Floor, walls and blocks fill the picture. Visible edges of the lamp and of the ceiling beside it would cause most of
/// its noise.
#[test]
fn cornell_box_is_unbiased() {
    let Subject { scene, .. } = Subject::load("builtin:cornell");
    let camera = Pinhole::looking_at(vec3(-0.25, 1.0, 3.9), vec3(0.0, 0.75, 0.0), Vec3::Y, 18.0);
    hold_against_the_reference([subject((scene, camera))], if is_thorough() { &THOROUGH } else { &QUICK });
}

#[test]
fn zero_and_one_bounce_are_both_direct_light() {
    let subject = subject(matte::box_area_light());
    let render = |bounces| {
        let settings = with(subject.settings(48, 32), |config| config.envelope.most.bounces = bounces);
        Stage::alone(&subject, &settings).frame(0).linear.into_left()
    };
    assert!(render(0) == render(1));
    assert!(render(1) != render(2));
}

/// Runs with one seed are equal; runs with two seeds are as independent as two frames.
#[test]
fn seeds_select_independent_random_numbers() {
    let subject = subject(matte::box_area_light());
    let render = |seed, index| {
        let settings = RunConfig { seed, ..subject.settings(48, 32) };
        Stage::alone(&subject, &settings).frame(index).linear.into_left()
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

/// Batches, running means and jitter: many samples in one frame have the same mean as many frames of few samples.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn one_frame_and_many_frames_have_the_same_mean() {
    let subject = subject(matte::environment_only());
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    (settings.envelope.most.bounces, settings.sampler) = (2, Sampler::Pcg);
    let render = |spp: u32, count: u64| {
        let mut settings = settings.clone();
        (settings.seed, settings.envelope.most.spp) = (spp, spp.into());
        Estimate::from_renders(EXTENT, renders(&subject, 0.0, &settings, 0..count))
    };
    // 100 samples make four batches, the last of them incomplete.
    assert_agrees("32 frames of 100 and 1,024 of 2", &render(100, 64), &render(2, 2048), QUICK.resolution);
}
