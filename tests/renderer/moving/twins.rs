//! An animated scene at a time equals the static scene of that time.

use crate::common::{Stage, Subject};
use crate::reference::scenes::moving;
use crate::reference::scenes::{add_matte, add_mesh};
use diptych::metrics;
use diptych::scene::Scene;
use glam::{DVec3, Vec3};

use super::watched;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;

/// Returns the lower PSNR of both eyes, dB, against a new static scene of that instant with the same random numbers.
fn psnr(stage: &mut Stage, subject: &Subject, time_s: f64, spp: u32) -> f64 {
    let found = stage.frame_at(time_s, 5).linear;
    let twin = watched(subject.scene.at(time_s));
    let mut settings = twin.settings(WIDTH, HEIGHT);
    settings.envelope.most.spp = spp.into();
    let expected = Stage::alone(&twin, &settings).frame(5).linear;
    let eyes = [(expected.left(), found.left()), (expected.right(), found.right())];
    eyes.map(|(a, b)| metrics::compare(a, b).unwrap().psnr).into_iter().fold(f64::INFINITY, f64::min)
}

#[track_caller]
fn hold_against_twins(scene: Scene, times_s: &[f64], spp: u32, least_db: f64) {
    let subject = watched(scene);
    let mut settings = subject.settings(WIDTH, HEIGHT);
    settings.envelope.most.spp = spp.into();
    let mut stage = Stage::alone(&subject, &settings);
    let found: Vec<f64> = times_s.iter().map(|&time_s| psnr(&mut stage, &subject, time_s, spp)).collect();
    println!("{}: {found:.1?} dB", subject.name);
    assert!(found.iter().all(|db| *db >= least_db), "{}: {found:.1?} dB at {times_s:?} s", subject.name);
}

#[test]
fn deformed_scene_matches_its_static_twin() {
    hold_against_twins(moving::skinned(), &[0.0, 0.9], 16, 60.0);
    hold_against_twins(moving::morphed(), &[0.7], 16, 60.0);
}

/// One body is scaled to nothing for a while, and returns in another size.
#[test]
fn rigidly_moved_scene_matches_its_static_twin() {
    hold_against_twins(moving::rigid(), &[0.3, 1.0, 1.5], 16, 60.0);
}

#[test]
fn moved_or_switched_lights_match_a_static_twin() {
    hold_against_twins(moving::lights(), &[0.0, 0.8], 16, 60.0);
    // While a lamp is dark, the static scene has one light fewer, and random numbers select others.
    hold_against_twins(moving::switched(), &[1.2], 16, 60.0);
}

/// There are more bodies than invocations in a row.
#[test]
fn skinning_moves_tens_of_thousands_of_triangles() {
    let mut draft = moving::Draft::room("many triangles");
    let red = add_matte(&mut draft.scene, Vec3::new(0.8, 0.4, 0.3));
    let mesh = add_mesh(&mut draft.scene, moving::patch(185, red));
    moving::add_patch(&mut draft, mesh, DVec3::Y);
    let scene = draft.done();
    assert!(scene.meshes[mesh].triangles.len() > diptych::accel::COLUMNS as usize);
    hold_against_twins(scene, &[0.8], 4, 60.0);
}
