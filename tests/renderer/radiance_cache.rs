//! Paths that end in the radiance cache: the light that they find, on any number of devices.

use glam::{Affine3A, DVec3, Quat, Vec2, Vec3, vec2, vec3, vec4};

use super::moving::watched;
use crate::black::{BLACK, RED, WHITE, tiles};
use crate::common::{Frame, Stage, Subject, devices_to_lose, still_rig};
use crate::pictures::mean;
use crate::reference::scenes::moving::everything;
use crate::reference::scenes::{add_material, add_mesh, block, empty, instance, matte, place, quad};
use crate::same_bytes::{HEIGHT, Rows, every, hold, run};
use diptych::RunConfig;
use diptych::graph::HaloPlan;
use diptych::metrics;
use diptych::scene::rig::{Rig, RigKey};
use diptych::scene::{Material, Scene};
use diptych::schedule::Even;

const WIDTH: u32 = 128;
/// Number of frames after which most cells are filled.
const FRAMES: usize = 24;

fn settings(subject: &Subject, cache: bool) -> RunConfig {
    RunConfig { cache, ..subject.accumulated(WIDTH, HEIGHT) }
}

fn rays(frame: &Frame) -> u64 {
    frame.report.tallies.iter().map(|tally| tally.rays).sum()
}

/// Returns a rig that moves a little along x, so that surfaces and cells change.
fn sliding(rig: &Rig) -> Rig {
    let view = rig.keys[0];
    let key = |time_s: f64| {
        let aside = DVec3::X * 0.2 * time_s;
        RigKey { time_s, position: view.position + aside, target: view.target + aside, ..view }
    };
    Rig { keys: vec![key(0.0), key(1.0)], ..rig.clone() }
}

/// Stripes jump and vanish; a device that has none in a frame knows no records of that frame.
#[test]
fn same_bytes_with_cache_on_jumping_stripes() {
    let loaded = Subject::load("builtin:cornell");
    let subject = Subject { rig: sliding(&loaded.rig), ..loaded };
    let rows = Rows::Turns(&["1,1,1", "5,1,2", "1,0,1", "0,1,0", "1,2,9", "path_trace.left=1,9,1"]);
    let runs = [run(3, rows).with(HaloPlan::RECOMPUTE, 1), run(3, rows).with(HaloPlan::EXCHANGE, 3)];
    let one = hold("cache", &subject, &settings(&subject, true), &every(1.0 / 72.0, FRAMES), &runs);
    let (first, last) = (rays(&one[0]), rays(&one[FRAMES - 1]));
    assert!(last * 10 < first * 9, "{first} rays without and {last} with a filled cache");
}

/// The rays of a frame tell which cells it knows. Records of a device are lost with it, but its part of the frame is made
/// again.
#[test]
fn cache_survives_the_loss_of_a_device() {
    let subject = Subject::load("builtin:cornell");
    let settings = settings(&subject, true);
    let mut one = Stage::alone(&subject, &settings);
    let gpus = devices_to_lose(2);
    let lost = gpus[1].device.clone();
    let mut two = Stage::on(gpus, &subject, &settings, Box::new(Even::new(HEIGHT, 2)));
    let mut all = Vec::new();
    for i in 0..FRAMES as u32 {
        if i == FRAMES as u32 / 2 {
            lost.destroy();
        }
        all.push(rays(&one.frame(i)));
        assert_eq!(rays(&two.frame(i)), all[i as usize], "frame {i}");
    }
    assert!(all[FRAMES - 1] * 10 < all[0] * 9, "the cache is not used: {all:?}");
    assert_eq!(two.renderer().faults().iter().map(|f| f.device).collect::<Vec<_>>(), [1]);
}

#[test]
fn only_static_scenes_with_history_are_cached() {
    let (still, moving) = (Subject::load("builtin:cornell"), watched(everything()));
    let cached = |config: RunConfig| RunConfig { cache: true, ..config }.caches();
    assert!(cached(still.accumulated(WIDTH, HEIGHT)));
    assert!(!cached(still.denoised(WIDTH, HEIGHT)), "à-trous keeps no history");
    assert!(!cached(still.settings(WIDTH, HEIGHT)), "nothing is denoised");
    assert!(!cached(moving.accumulated(WIDTH, HEIGHT)), "something moves");
    let mut once = still.accumulated(WIDTH, HEIGHT);
    once.envelope.most.bounces = 1;
    assert!(!cached(once), "no path reflects light twice");
}

/// Cells that frames of two bounces have filled lack the light of further bounces.
#[test]
fn frames_of_more_bounces_do_not_read_cells_of_fewer() {
    let subject = Subject::load("builtin:cornell");
    let trace = |cache: bool| {
        let mut stage = Stage::alone(&subject, &settings(&subject, cache));
        stage.set(|frame| frame.quality.bounces = if frame.index < FRAMES as u32 { 2 } else { 6 });
        (0..2 * FRAMES as u32).map(|i| rays(&stage.frame(i))).collect::<Vec<_>>()
    };
    let [off, on] = [false, true].map(trace);
    let saved = |i: usize| 1.0 - on[i] as f64 / off[i] as f64;
    let [few, changed, many] = [FRAMES - 1, FRAMES, 2 * FRAMES - 1].map(saved);
    println!("rays saved: {few:.3} with 2 bounces, {changed:.3} in the first frame with 6, {many:.3} later");
    assert!(few > 0.05 && many > 0.1, "{few}, {many}");
    assert!(changed.abs() < 0.002, "the first frame of 6 bounces reads cells of 2: {changed}");
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn cached_frames_keep_the_mean_and_the_error() {
    for name in ["builtin:cornell", "builtin:gallery"] {
        let subject = Subject::load(name);
        let mut reference = subject.settings(WIDTH, HEIGHT);
        (reference.seed, reference.envelope.most.spp) = (99, 64.into());
        let reference = Stage::alone(&subject, &reference).frame(0).linear.into_left();
        let [off, on] = [false, true].map(|cache| {
            let mut stage = Stage::alone(&subject, &settings(&subject, cache));
            let frames: Vec<Frame> = (0..FRAMES as u32).map(|i| stage.frame(i)).collect();
            let late = &frames[FRAMES / 2..];
            let means = late.iter().map(|frame| mean(frame.linear.left())).sum::<f64>();
            let error = |frame: &Frame| metrics::compare(&reference, frame.linear.left()).unwrap().relmse;
            let errors = late.iter().map(error).sum::<f64>();
            (means, errors, rays(&frames[FRAMES - 1]))
        });
        println!("{name}: {off:?} without and {on:?} with a cache");
        assert!(on.2 * 10 < off.2 * 9, "{name}: {} rays without and {} with a cache", off.2, on.2);
        assert!((on.0 / off.0 - 1.0).abs() < 0.007, "{name}: mean ratio of {}", on.0 / off.0);
        assert!(on.1 < 1.05 * off.1, "{name}: errors of {} and {}", off.1, on.1);
    }
}

/// A room of 6 x 2.5 x 3 m that is open towards the camera, with a lamp at its ceiling.
fn room(name: &str, material: impl FnOnce(&mut Scene) -> Material) -> Scene {
    let mut scene = empty(name);
    let material = material(&mut scene);
    let walls = add_material(&mut scene, material);
    let lamp = Material { base_color: vec4(0.0, 0.0, 0.0, 1.0), emissive: Vec3::splat(20.0), ..matte() };
    let lamp = add_material(&mut scene, lamp);
    let (x, y, z) = (6.0 * Vec3::X, 2.5 * Vec3::Y, 3.0 * Vec3::Z);
    let corner = vec3(-3.0, 0.0, -3.0);
    let [floor, ceiling] = [quad(corner, z, x, walls), quad(corner + y, x, z, walls)];
    let [back, left, right] = [quad(corner, x, y, walls), quad(corner, y, z, walls), quad(corner + x, z, y, walls)];
    for mut wall in [floor, ceiling, back, left, right] {
        let edges = [1, 3].map(|i| wall.positions[i].distance(wall.positions[0]));
        wall.uvs[0] = vec![Vec2::ZERO, vec2(edges[0], 0.0), Vec2::from(edges), vec2(0.0, edges[1])];
        place(&mut scene, wall);
    }
    place(&mut scene, quad(vec3(-2.0, 2.45, -2.0), Vec3::X, Vec3::Z, lamp));
    scene
}

fn looked_into(scene: Scene) -> Subject {
    let name = scene.name.clone();
    Subject::new(&name, scene, still_rig(vec3(0.0, 1.25, 3.5), -Vec3::Z, Vec3::Y, 0.4))
}

/// A cell covers several tiles. Its light is that over the albedo of all, not a mean that counts black tiles as dark.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn cells_keep_the_light_of_tiles() {
    for texels in [[BLACK, WHITE], [RED, WHITE]] {
        let subject = looked_into(room("tiled room", |scene| Material {
            base_color_texture: Some(tiles(scene, texels, 8.0)),
            ..matte()
        }));
        let [off, on] = [false, true].map(|cache| {
            let mut stage = Stage::alone(&subject, &settings(&subject, cache));
            let frames: Vec<Frame> = (0..2 * FRAMES as u32).map(|i| stage.frame(i)).collect();
            let pixels = frames[FRAMES..].iter().flat_map(|frame| &frame.linear.left().pixels);
            let light = pixels.map(|pixel| DVec3::from_array(pixel.map(f64::from))).sum::<DVec3>();
            (light, rays(&frames[frames.len() - 1]))
        });
        let ratio = on.0 / off.0;
        println!("{texels:?}: {ratio:.5} of the light, {} rays without and {} with a cache", off.1, on.1);
        assert!(on.1 * 20 < off.1 * 19, "{} rays without and {} with a cache", off.1, on.1);
        // The brightest channel has 1.002 to 1.004 of its light. Black tiles that count as dark cost 0.008.
        assert!((ratio - 1.0).abs().max_element() < 0.006, "{texels:?}: {ratio} of the light");
    }
}

/// Two rooms side by side with a wall of 5 cm between them. The lamp is in the left one; no light reaches the right one.
fn rooms() -> Subject {
    let mut scene = room("two rooms", |_| Material { base_color: Vec3::splat(0.7).extend(1.0), ..matte() });
    let wall = add_mesh(&mut scene, block(0));
    let at = Affine3A::from_scale_rotation_translation(vec3(0.05, 2.5, 3.0), Quat::IDENTITY, vec3(0.0, 1.25, -1.5));
    instance(&mut scene, wall, at);
    looked_into(scene)
}

#[test]
fn no_light_leaks_through_a_wall() {
    let subject = rooms();
    let sides = |cache: bool| {
        let mut stage = Stage::alone(&subject, &settings(&subject, cache));
        let frames: Vec<Frame> = (0..2 * FRAMES as u32).map(|i| stage.frame(i)).collect();
        let image = frames[frames.len() - 1].linear.left();
        let half = |is_left: bool| {
            let pixels = image.pixels.iter().enumerate();
            let side = pixels.filter(|(i, _)| ((*i as u32 % WIDTH) < WIDTH / 2) == is_left);
            side.map(|(_, p)| f64::from(p.iter().sum::<f32>())).sum::<f64>()
        };
        (half(true), half(false), rays(&frames[frames.len() - 1]))
    };
    let (off, on) = (sides(false), sides(true));
    println!("{off:?} without and {on:?} with a cache");
    assert!(on.2 * 20 < off.2 * 19, "{} rays without and {} with a cache", off.2, on.2);
    assert!(on.1 - off.1 < 5e-4 * on.0, "{} instead of {} beside {}", on.1, off.1, on.0);
}
