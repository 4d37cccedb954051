//! What moves keeps its history.

use crate::common::{Stage, Subject, is_thorough};
use crate::reference::scenes::moving::{self, Draft};
use crate::reference::scenes::{add_material, add_matte, add_mesh, matte, place, quad};
use diptych::exec::{RenderSettings, Stereo};
use diptych::image::RgbImage;
use diptych::passes::Aov;
use diptych::scene::{Environment, Material, Scene};
use glam::{DVec3, Vec3};

use super::watched;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const FPS: f64 = 72.0;
const FRAMES: u32 = 16;

/// A board beside a board of the same kind, before a wall, of which one moves by a pixel and a half a frame. A large lamp
/// lights them from the side, so that one sample has much noise.
fn boards() -> Scene {
    let mut draft = Draft::room("boards");
    draft.scene.environment = Environment::Black;
    let grey = add_matte(&mut draft.scene, Vec3::splat(0.6));
    let lamp = add_material(&mut draft.scene, Material { emissive: Vec3::splat(6.0), ..matte() });
    place(&mut draft.scene, quad(Vec3::new(-1.5, 3.2, 0.5), Vec3::X * 3.0, Vec3::Z * 2.0, lamp));
    let board = |z| quad(Vec3::new(-0.5, -0.5, z), Vec3::X, Vec3::Y, grey);
    let mesh = add_mesh(&mut draft.scene, board(0.0));
    let node = draft.node(None, DVec3::ZERO, DVec3::ONE);
    draft.shift(node, Vec3::new(-1.4, 0.9, 0.3), Vec3::new(3.0, 0.9, 0.3));
    draft.body(mesh, node, None, Vec::new());
    draft.done()
}

/// Square error over square radiance, over pixels that move and those that do not.
fn errors(right: &Stereo<RgbImage>, found: &Stereo<RgbImage>, moves: &[bool]) -> [f64; 2] {
    [true, false].map(|which| {
        let mut sums = [0.0f64; 2];
        for (a, b) in [(&right.left, &found.left), (&right.right, &found.right)] {
            for p in (0..moves.len()).filter(|p| moves[*p] == which) {
                for (x, y) in a.pixels[p].iter().zip(&b.pixels[p]) {
                    sums[0] += f64::from(x - y).powi(2);
                    sums[1] += f64::from(*x).powi(2);
                }
            }
        }
        sums[0] / sums[1]
    })
}

fn reference(subject: &Subject, time_s: f64, spp: u32) -> Stereo<RgbImage> {
    let mut settings = subject.settings(WIDTH, HEIGHT);
    (settings.seed, settings.stages.spp) = (99, spp);
    settings.bounces = 2;
    Stage::alone(subject, &settings).frame_at(time_s, 0).linear
}

/// The last of some frames, and which pixels of it are on a surface that moves, and were not at its border.
fn arrived(subject: &Subject, begins_anew: bool) -> (Stereo<RgbImage>, Vec<bool>) {
    let mut settings = RenderSettings { bounces: 2, ..subject.accumulated(WIDTH, HEIGHT) };
    settings.stages.aovs = vec![Aov::Motion];
    let mut stage = Stage::alone(subject, &settings);
    let mut last = None;
    for i in 0..FRAMES {
        if begins_anew {
            stage.renderer().begin_anew();
        }
        last = Some(stage.frame_at(f64::from(i) / FPS, i).linear);
    }
    let motion = stage.aov(0).left;
    let is_on = |p: usize| motion[0][p].hypot(motion[1][p]) > 0.2;
    let around = |p: usize| {
        let (x, y) = ((p % WIDTH as usize) as i32, (p / WIDTH as usize) as i32);
        let near = (-2..=2).flat_map(move |dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
        near.map(|(x, y)| (x.clamp(0, WIDTH as i32 - 1) + y.clamp(0, HEIGHT as i32 - 1) * WIDTH as i32) as usize)
    };
    let moves = (0..(WIDTH * HEIGHT) as usize).map(|p| around(p).all(is_on)).collect();
    (last.unwrap(), moves)
}

#[test]
fn surfaces_that_move_keep_their_history() {
    let subject = watched(boards());
    let right = reference(&subject, f64::from(FRAMES - 1) / FPS, if is_thorough() { 1024 } else { 256 });
    let (kept, moves) = arrived(&subject, false);
    let (anew, _) = arrived(&subject, true);
    let [found, still] = errors(&right, &kept, &moves);
    let [without, still_without] = errors(&right, &anew, &moves);
    let count = moves.iter().filter(|m| **m).count();
    println!(
        "{count} pixels move: {found:.5} beside {still:.5} of still ones; {without:.5} and {still_without:.5} anew"
    );
    assert!(count > 200, "{count} pixels move");
    assert!(found < 0.6 * without, "{found} is not much less than {without} without history");
}

/// How bright the frames after a switch are beside what is right.
#[test]
fn a_light_that_switches_is_seen_within_four_frames() {
    let subject = watched(moving::switched());
    let settings = RenderSettings { bounces: 2, ..subject.accumulated(WIDTH, HEIGHT) };
    let mut stage = Stage::alone(&subject, &settings);
    let mean = |image: &Stereo<RgbImage>| {
        image.left.pixels.iter().flatten().map(|v| f64::from(*v)).sum::<f64>() / image.left.pixels.len() as f64
    };
    const BEFORE: u32 = 16;
    let time_s = |i: u32| moving::SWITCH_S + (f64::from(i) - f64::from(BEFORE)) / FPS;
    let frames: Vec<f64> = (0..BEFORE + 8).map(|i| mean(&stage.frame_at(time_s(i) + 1e-4, i).linear)).collect();
    drop(stage);
    let [dark, lit] = [0.5, 1.5].map(|time_s| mean(&reference(&subject, time_s, 64)));
    let of_lit: Vec<f64> = frames[BEFORE as usize..].iter().map(|mean| mean / lit).collect();
    println!("dark {:.4} of lit; after the switch {of_lit:.3?}", dark / lit);
    assert!(dark < 0.5 * lit);
    assert!((frames[BEFORE as usize - 1] / dark - 1.0).abs() < 0.05, "before: {} of what is right", frames[15] / dark);
    assert!((of_lit[3] - 1.0).abs() < 0.1, "after four frames {:.3} of what is right", of_lit[3]);
}
