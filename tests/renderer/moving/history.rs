//! Dynamic geometry keeps its history.

use crate::common::{Stage, Subject, is_thorough, with};
use crate::pictures::mean;
use crate::reference::scenes::moving::{self, Draft};
use crate::reference::scenes::{add_material, add_matte, add_mesh, append, instance, matte, place, quad};
use diptych::exec::PerView;
use diptych::image::RgbImage;
use diptych::passes::Aov;
use diptych::scene::motion::Target;
use diptych::scene::motion::keys::Interpolation;
use diptych::scene::{Environment, LightKind, Material, Mesh, Scene};
use glam::{Affine3A, DVec3, Vec3};

use super::watched;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const FPS: f64 = 72.0;
const FRAMES: u32 = 16;

/// Returns a board that moves by 1.5 pixels per frame beside a static one, in front of a distant wall. A lamp as long
/// as the whole path lights both equally in any position and is noisy.
fn boards() -> Scene {
    things(|grey, _| quad(Vec3::new(-0.5, -0.5, 0.0), Vec3::X, Vec3::Y, grey))
}

/// Returns the same with fences of dark bars, 1.5 pixels wide and equally far apart.
fn fences() -> Scene {
    things(|_, dark| {
        let bar = |i: u16| quad(Vec3::new(0.09 * f32::from(i) - 0.5, -0.5, 0.0), Vec3::X * 0.045, Vec3::Y, dark);
        let mut fence = bar(0);
        (1..12).for_each(|i| append(&mut fence, bar(i)));
        fence
    })
}

/// Adds a grey or dark mesh twice: moving, and static.
fn things(mesh: impl Fn(usize, usize) -> Mesh) -> Scene {
    let mut draft = Draft::new("things");
    let dark = add_matte(&mut draft.scene, Vec3::splat(0.05));
    let grey = add_matte(&mut draft.scene, Vec3::splat(0.6));
    let lamp = add_material(&mut draft.scene, Material { emissive: Vec3::splat(3.0), ..matte() });
    place(&mut draft.scene, quad(Vec3::new(-9.0, 0.0, -6.0), Vec3::X * 18.0, Vec3::Y * 6.0, grey));
    place(&mut draft.scene, quad(Vec3::new(-30.0, 3.2, 0.5), Vec3::X * 60.0, Vec3::Z * 2.0, lamp));
    let mesh = add_mesh(&mut draft.scene, mesh(grey, dark));
    instance(&mut draft.scene, mesh, Affine3A::from_translation(Vec3::new(0.9, 0.9, Z)));
    let node = draft.node(None, DVec3::ZERO, DVec3::ONE);
    draft.shift(node, Vec3::new(-1.4, 0.9, Z), Vec3::new(3.0, 0.9, Z));
    draft.body(mesh, node, None, Vec::new());
    draft.done()
}

/// z of the boards.
const Z: f32 = 0.3;

/// Returns square error over square radiance of the left eye, over these pixels.
fn error(right: &PerView<RgbImage>, found: &PerView<RgbImage>, pixels: &[usize]) -> f64 {
    let values = |image: &RgbImage| pixels.iter().flat_map(|p| image.pixels[*p]).map(f64::from).collect::<Vec<_>>();
    let (right, found) = (values(right.left()), values(found.left()));
    let square = right.iter().zip(&found).map(|(x, y)| (x - y).powi(2)).sum::<f64>();
    square / right.iter().map(|x| x.powi(2)).sum::<f64>()
}

fn reference(subject: &Subject, time_s: f64, spp: u32) -> PerView<RgbImage> {
    let mut settings = subject.settings(WIDTH, HEIGHT);
    (settings.seed, settings.envelope.most.spp) = (99, spp.into());
    settings.envelope.most.bounces = 2;
    Stage::alone(subject, &settings).frame_at(time_s, 0).linear
}

/// Returns the last frame of a sequence, with its pixels on the moving and on the static object, at least `inside`
/// pixels from their borders.
fn arrived(subject: &Subject, begins_anew: bool, inside: usize) -> (PerView<RgbImage>, [Vec<usize>; 2]) {
    let mut settings = with(subject.accumulated(WIDTH, HEIGHT), |config| config.envelope.most.bounces = 2);
    settings.buffers.aovs = vec![Aov::Motion, Aov::Position];
    let mut stage = Stage::alone(subject, &settings);
    let frames = (0..FRAMES).map(|i| {
        begins_anew.then(|| stage.renderer().begin_anew());
        stage.frame_at(f64::from(i) / FPS, i).linear
    });
    let last = frames.last().unwrap();
    let (motion, position) = (stage.aov(0).into_left(), stage.aov(1).into_left());
    let is_on =
        |p: usize, moves: bool| (position[2][p] - Z).abs() < 1e-3 && (motion[0][p].hypot(motion[1][p]) > 0.2) == moves;
    let (width, height) = (WIDTH as usize, HEIGHT as usize);
    let is_inside = |p: usize, moves: bool| {
        let (x, y) = (p % width, p / width);
        let near = || (y - inside..=y + inside).flat_map(|y| (x - inside..=x + inside).map(move |x| x + y * width));
        (2..width - 2).contains(&x) && (2..height - 2).contains(&y) && near().all(|p| is_on(p, moves))
    };
    (last, [true, false].map(|moves| (0..width * height).filter(|p| is_inside(*p, moves)).collect()))
}

#[test]
fn moving_surfaces_keep_their_history() {
    let subject = watched(boards());
    let right = reference(&subject, f64::from(FRAMES - 1) / FPS, if is_thorough() { 2048 } else { 256 });
    let (kept, pixels) = arrived(&subject, false, 2);
    let (anew, _) = arrived(&subject, true, 2);
    let [moving, still] = [0, 1].map(|i| error(&right, &kept, &pixels[i]));
    let [moving_anew, still_anew] = [0, 1].map(|i| error(&right, &anew, &pixels[i]));
    let counts = pixels.each_ref().map(Vec::len);
    println!("{counts:?} pixels: {moving:.6} moving, {still:.6} still; {moving_anew:.6}, {still_anew:.6} anew");
    assert!(counts.iter().all(|count| *count > 150), "{counts:?} pixels");
    assert!(moving < 1.5 * still, "{moving} where the board moves, {still} where it stands");
    assert!(moving < 0.5 * moving_anew, "{moving} is not much less than {moving_anew} without history");
}

/// Repeated resampling of history does not blur thin geometry.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn thin_moving_geometry_stays_sharp() {
    let subject = watched(fences());
    let right = reference(&subject, f64::from(FRAMES - 1) / FPS, 64);
    let (found, pixels) = arrived(&subject, false, 0);
    let [moving, still] = [0, 1].map(|i| error(&right, &found, &pixels[i]));
    let counts = pixels.each_ref().map(Vec::len);
    println!("{counts:?} pixels: {moving:.4} moving, {still:.4} still");
    assert!(counts.iter().all(|count| *count > 100), "{counts:?} pixels");
    // With a history of ten frames on dynamic geometry, it would be above 0.24.
    assert!(still < 0.06 && moving < 0.15, "{moving} where the fence moves, {still} where it stands");
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn switched_light_is_correct_after_four_frames() {
    let subject = watched(moving::switched());
    let settings = with(subject.accumulated(WIDTH, HEIGHT), |config| config.envelope.most.bounces = 2);
    let mut stage = Stage::alone(&subject, &settings);
    let mean = |image: &PerView<RgbImage>| mean(image.left());
    const BEFORE: u32 = 16;
    let time_s = |i: u32| moving::SWITCH_S + (f64::from(i) - f64::from(BEFORE)) / FPS;
    let frames: Vec<f64> = (0..BEFORE + 8).map(|i| mean(&stage.frame_at(time_s(i) + 1e-4, i).linear)).collect();
    drop(stage);
    let [dark, lit] = [0.5, 1.5].map(|time_s| mean(&reference(&subject, time_s, 64)));
    let of_lit: Vec<f64> = frames[BEFORE as usize..].iter().map(|mean| mean / lit).collect();
    println!("dark {:.4} of lit; after the switch {of_lit:.3?}", dark / lit);
    assert!(dark < 0.5 * lit);
    assert!((frames[BEFORE as usize - 1] / dark - 1.0).abs() < 0.05, "before: {} of what is right", frames[15] / dark);
    assert!(of_lit[3..].iter().all(|of| (of - 1.0).abs() < 0.1), "{of_lit:.3?} of what is right");
}

/// The lamp's total light stays the same, so only individual pixels show its jump.
#[test]
fn jumped_lamp_is_correct_after_four_frames() {
    let mut draft = Draft::room("jump");
    draft.scene.environment = Environment::Black;
    let lamp = draft.node(None, DVec3::ZERO, DVec3::ONE);
    draft.light(lamp, LightKind::Point { position: Vec3::ZERO, radius: 0.0 }, Vec3::splat(4.0));
    let places = [[-1.5, 1.0, 0.5], [1.5, 1.0, 0.5]].concat();
    draft.animate(Target::Translation(lamp), Interpolation::Step, &[0.0, moving::SWITCH_S as f32], &places);
    let subject = watched(draft.done());
    let settings = with(subject.accumulated(WIDTH, HEIGHT), |config| config.envelope.most.bounces = 2);
    let mut stage = Stage::alone(&subject, &settings);
    let time_s = |i: u32| moving::SWITCH_S + (f64::from(i) - f64::from(FRAMES)) / FPS + 1e-4;
    let frames: Vec<_> = (0..FRAMES + 4).map(|i| stage.frame_at(time_s(i), i).linear).collect();
    drop(stage);
    let [before, after] = [0.5, 1.5].map(|time_s| reference(&subject, time_s, 64));
    let all: Vec<usize> = (0..(WIDTH * HEIGHT) as usize).collect();
    let settled = error(&before, &frames[FRAMES as usize - 1], &all);
    let jumped: Vec<f64> = frames[FRAMES as usize..].iter().map(|frame| error(&after, frame, &all)).collect();
    println!("{settled:.4} before, {jumped:.4?} after; {:.4} if nothing changed", error(&after, &before, &all));
    assert!(error(&after, &before, &all) > 0.3);
    assert!(settled < 0.02 && jumped[3] < 0.05, "{settled} before, {jumped:?} after");
}
