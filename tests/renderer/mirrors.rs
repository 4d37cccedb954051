//! Frames that follow perfect mirrors, clear glass and polish: what a mirror or a pane shows is as good as the room behind
//! an opening.

use crate::common::{Stage, Subject, sampled, still_rig, with, with_outputs};
use crate::reference::scenes::moving::Draft;
use crate::reference::scenes::{
    add_material, add_matte, add_mesh, block, empty, icosphere, instance, matte, place, place_at, quad,
};
use crate::reference::scenes::{scaled_at, studio};
use diptych::RunConfig;
use diptych::exec::PerView;
use diptych::graph::Resource;
use diptych::image::{Extent, Image, RgbImage};
use diptych::metrics::{self, Errors};
use diptych::passes::Aov;
use diptych::quality::{Denoiser, Filter};
use diptych::scene::motion::Target;
use diptych::scene::motion::keys::Interpolation;
use diptych::scene::rig::{Eye, Rig, RigKey, View};
use diptych::scene::{Clearcoat, Material, Mesh, Scene};
use glam::{Affine3A, DQuat, DVec2, DVec3, Vec3, dvec2, vec3};

mod auxiliary;
mod images;

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const BOUNCES: u32 = 3;
pub const FPS: f64 = 72.0;

/// Place of the wall with the mirror, which faces +z.
const MIRROR_Z: f32 = -2.0;

/// Returns the mesh as the mirror shows it.
fn reflected(mesh: &Mesh) -> Mesh {
    let over = |p: &Vec3| vec3(p.x, p.y, 2.0 * MIRROR_Z - p.z);
    let turned = |n: &Vec3| vec3(n.x, n.y, -n.z);
    Mesh {
        positions: mesh.positions.iter().map(over).collect(),
        normals: mesh.normals.iter().map(turned).collect(),
        triangles: mesh.triangles.iter().map(|[a, b, c]| [*a, *c, *b]).collect(),
        ..mesh.clone()
    }
}

/// A wall of the room: a mirror, also a brushed one, dark lacquer, an opening to a mirrored copy of the room, or a pane
/// before that copy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wall {
    Mirror,
    Brushed,
    Lacquer,
    Opening,
    Pane,
}

/// Returns the meshes of the room but for the wall.
fn furniture(scene: &mut Scene) -> Vec<Mesh> {
    let [white, red, blue, yellow] =
        [[0.7, 0.7, 0.7], [0.8, 0.2, 0.2], [0.2, 0.3, 0.8], [0.8, 0.7, 0.2]].map(|c| add_matte(scene, c.into()));
    let lamp = add_material(scene, Material { emissive: vec3(6.0, 5.5, 5.0), ..matte() });
    let mut meshes = vec![
        quad(vec3(-2.0, 0.0, 2.0), 4.0 * Vec3::X, -4.0 * Vec3::Z, white),
        quad(vec3(-2.0, 2.5, -2.0), 4.0 * Vec3::X, 4.0 * Vec3::Z, white),
        quad(vec3(-2.0, 0.0, 2.0), -4.0 * Vec3::Z, 2.5 * Vec3::Y, red),
        quad(vec3(2.0, 0.0, -2.0), 4.0 * Vec3::Z, 2.5 * Vec3::Y, blue),
        quad(vec3(2.0, 0.0, 2.0), -4.0 * Vec3::X, 2.5 * Vec3::Y, white),
        // The lamp shines away from the mirror, since light samples find a copied lamp but no image of one.
        quad(vec3(-1.5, 2.1, -1.9), 3.0 * Vec3::X, 0.4 * Vec3::Y, lamp),
    ];
    for (material, size, at) in
        [(yellow, 0.6, vec3(-0.9, 0.3, -0.4)), (blue, 0.5, vec3(0.8, 0.25, 0.3)), (white, 0.9, vec3(1.3, 0.45, -1.2))]
    {
        let mut block = block(material);
        block.positions.iter_mut().for_each(|p| *p = *p * size + at);
        meshes.push(block);
    }
    // Stripes on the far wall, which only the mirror shows.
    for i in 0..6u8 {
        let x = 1.8 - 0.6 * f32::from(i);
        meshes.push(quad(vec3(x, 0.2, 1.99), -0.3 * Vec3::X, 2.0 * Vec3::Y, [red, blue, yellow][usize::from(i % 3)]));
    }
    meshes
}

/// Returns a room with such a wall, and its camera, which moves sideways.
fn room(wall: Wall) -> Subject {
    let mut scene = empty("room");
    let mut meshes = furniture(&mut scene);
    if matches!(wall, Wall::Opening | Wall::Pane) {
        meshes.extend(meshes.iter().map(reflected).collect::<Vec<_>>());
    }
    let material = match wall {
        Wall::Mirror => Some(studio::metal(Vec3::ONE, 0.0)),
        Wall::Brushed => Some(studio::metal(Vec3::ONE, 0.1)),
        Wall::Lacquer => Some(Material { ior: 2.4, ..studio::dielectric(Vec3::splat(0.02), 0.0) }),
        Wall::Opening => None,
        Wall::Pane => Some(studio::glass(Vec3::ONE, 0.0)),
    };
    if let Some(material) = material {
        let material = add_material(&mut scene, material);
        meshes.push(quad(vec3(-2.0, 0.0, MIRROR_Z), 4.0 * Vec3::X, 2.5 * Vec3::Y, material));
    }
    meshes.into_iter().for_each(|mesh| place(&mut scene, mesh));
    subject(&format!("{wall:?}"), scene)
}

fn solid_glass() -> Material {
    Material { volume: studio::CLEAR, ..studio::glass(Vec3::ONE, 0.0) }
}

fn subject(name: &str, scene: Scene) -> Subject {
    let key = |time_s, x: f64| RigKey {
        time_s,
        position: DVec3::new(x, 1.3, 1.2),
        target: DVec3::new(0.3 * x, 1.1, -2.0),
        up: DVec3::Y,
    };
    Subject::new(name, scene, Rig::of_keys(vec![key(0.0, -0.3), key(1.0, 0.9)]))
}

/// Adds a block that moves.
fn add_moving_block(draft: &mut Draft, from: Vec3, to: Vec3) {
    let red = add_matte(&mut draft.scene, vec3(0.8, 0.2, 0.2));
    let mesh = add_mesh(&mut draft.scene, block(red));
    let node = draft.node(None, from.as_dvec3(), DVec3::splat(0.3));
    draft.shift(node, from, to);
    draft.body(mesh, node, None, Vec::new());
}

/// Places of the block that moves.
const WAY: [Vec3; 2] = [vec3(-0.4, 0.4, 0.5), vec3(0.8, 0.7, 0.4)];

/// Returns the room with a block that moves, also behind an opening or a pane.
pub fn moving_room(wall: Wall) -> Subject {
    let mut draft = Draft::new("moving");
    draft.scene = room(wall).scene;
    let over = |p: Vec3| vec3(p.x, p.y, 2.0 * MIRROR_Z - p.z);
    for [from, to] in [WAY, WAY.map(over)].into_iter().take(if wall == Wall::Mirror { 1 } else { 2 }) {
        add_moving_block(&mut draft, from, to);
    }
    subject(&format!("moving {wall:?}"), draft.done())
}

/// Returns the room with static eyes, and with a mirror in its wall that turns by half a degree per frame, or an opening
/// there and behind it a mirrored room that turns by twice as much. In the mirror, a block moves.
fn turning_room(wall: Wall) -> Subject {
    const SECONDS: f32 = 0.25;
    let mut draft = Draft::new("turning");
    let mut meshes = furniture(&mut draft.scene);
    let white = add_matte(&mut draft.scene, Vec3::splat(0.7));
    let frame = [
        quad(vec3(-2.0, 0.0, MIRROR_Z), 0.8 * Vec3::X, 2.5 * Vec3::Y, white),
        quad(vec3(1.2, 0.0, MIRROR_Z), 0.8 * Vec3::X, 2.5 * Vec3::Y, white),
        quad(vec3(-1.2, 2.0, MIRROR_Z), 2.4 * Vec3::X, 0.5 * Vec3::Y, white),
    ];
    let pivot = MIRROR_Z * Vec3::Z;
    let turning = |draft: &mut Draft, meshes: &[Mesh], times: f64| {
        let node = draft.node(None, pivot.as_dvec3(), DVec3::ONE);
        let half = times * f64::from(0.5f32.to_radians()) * FPS * f64::from(SECONDS) / 2.0;
        let turned = |angle| DQuat::from_rotation_y(angle).as_quat().to_array();
        let keys = [turned(-half), turned(half)].concat();
        draft.animate(Target::Rotation(node), Interpolation::Linear, &[0.0, SECONDS], &keys);
        for mesh in meshes {
            let positions = mesh.positions.iter().map(|p| *p - pivot).collect();
            let mesh = add_mesh(&mut draft.scene, Mesh { positions, ..mesh.clone() });
            draft.body(mesh, node, None, Vec::new());
        }
        node
    };
    add_moving_block(&mut draft, WAY[0], WAY[1]);
    if wall == Wall::Mirror {
        let mirror = add_material(&mut draft.scene, studio::metal(Vec3::ONE, 0.0));
        turning(&mut draft, &[quad(vec3(-1.2, 0.0, MIRROR_Z), 2.4 * Vec3::X, 2.0 * Vec3::Y, mirror)], 1.0);
    } else {
        let behind: Vec<_> = meshes.iter().map(reflected).collect();
        let turns = turning(&mut draft, &behind, 2.0);
        let mesh = draft.scene.instances[draft.scene.motion.bodies[0].instance].mesh;
        let over = |p: Vec3| vec3(p.x, p.y, 2.0 * MIRROR_Z - p.z) - pivot;
        let node = draft.node(Some(turns), over(WAY[0]).as_dvec3(), DVec3::splat(0.3));
        draft.shift(node, over(WAY[0]), over(WAY[1]));
        draft.body(mesh, node, None, Vec::new());
    }
    meshes.extend(frame);
    meshes.into_iter().for_each(|mesh| place(&mut draft.scene, mesh));
    let scene = draft.done();
    let rig = Rig::of_keys(vec![RigKey {
        time_s: 0.0,
        position: DVec3::new(0.0, 1.3, 1.2),
        target: DVec3::new(0.0, 1.1, -2.0),
        up: DVec3::Y,
    }]);
    Subject::new(&format!("turning {wall:?}"), scene, rig)
}

pub fn settings(subject: &Subject, denoiser: Denoiser) -> RunConfig {
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    (settings.envelope.most.filter, settings.envelope.most.bounces) = (Some(Filter::new(denoiser, 5)), BOUNCES);
    settings
}

/// Returns the part of an image that the mirror fills.
fn within(image: &RgbImage) -> RgbImage {
    let (columns, rows) = (WIDTH / 4..3 * WIDTH / 4, HEIGHT / 4..5 * HEIGHT / 8);
    let pixels = rows.clone().flat_map(|y| columns.clone().map(move |x| *image.get(x, y))).collect();
    Image { extent: Extent::new(columns.len() as u32, rows.len() as u32), pixels }
}

const FRAMES: u32 = 16;

/// Returns the time of a frame at which the eyes move or stand still.
fn time_s(index: u32, is_moving: bool) -> f64 {
    if is_moving { f64::from(index) / FPS } else { 0.0 }
}

/// Returns the mirror's part of an unfiltered last frame, of many samples.
fn reference(subject: &Subject, is_moving: bool) -> [RgbImage; 2] {
    const PARTS: u32 = 8;
    let mut settings = subject.settings(WIDTH, HEIGHT);
    (settings.seed, settings.envelope.most.spp, settings.envelope.most.bounces) = (99, 16.into(), BOUNCES);
    let mut stage = Stage::alone(subject, &settings);
    let parts = (0..PARTS).map(|index| stage.frame_at(time_s(FRAMES - 1, is_moving), index).linear);
    let parts: Vec<_> = parts.map(|eyes| [within(eyes.left()), within(eyes.right())]).collect();
    [0, 1].map(|eye| {
        let mean = |i: usize| [0, 1, 2].map(|c| parts.iter().map(|p| p[eye].pixels[i][c]).sum::<f32>() / PARTS as f32);
        let extent = parts[0][eye].extent;
        Image { extent, pixels: (0..extent.area()).map(mean).collect() }
    })
}

/// Compares the mirror of the last frame with a reference, in both eyes.
fn errors(subject: &Subject, reference: &[RgbImage; 2], settings: &RunConfig, is_moving: bool) -> [Errors; 2] {
    let mut stage = Stage::alone(subject, settings);
    let frames = (0..FRAMES).map(|index| stage.frame_at(time_s(index, is_moving), index).linear);
    let found = frames.last().expect("there are frames");
    let compare = |expected: &RgbImage, found: &RgbImage| metrics::compare(expected, &within(found)).unwrap();
    [compare(&reference[0], found.left()), compare(&reference[1], found.right())]
}

/// Asserts that mirrors and panes show as much as the opening, the last of the rooms, and more than if they are not
/// followed.
fn assert_as_good_as_an_opening(rooms: &[Subject], is_moving: bool) {
    let (opening, mirrors) = rooms.split_last().unwrap();
    assert!(mirrors.iter().all(|subject| subject.needs.mirrors) && !opening.needs.mirrors);
    let of = |subject: &Subject, expected: &[RgbImage; 2], follow_mirrors| {
        let settings = RunConfig { follow_mirrors, ..settings(subject, Denoiser::SVGF) };
        errors(subject, expected, &settings, is_moving)
    };
    let twin = of(opening, &reference(opening, is_moving), true);
    let mut fails = Vec::new();
    for subject in mirrors {
        let expected = reference(subject, is_moving);
        let [followed, blurred] = [true, false].map(|follow| of(subject, &expected, follow));
        for eye in [0, 1] {
            let [a, b, c] = [&twin, &followed, &blurred].map(|e| (e[eye].psnr, e[eye].flip));
            let errors = format!("PSNR and FLIP {b:.3?}, blurred {c:.3?}, opening {a:.3?}");
            let what = format!("{}, moving {is_moving}, eye {eye}: {errors}", subject.name);
            println!("{what}");
            if b.0 < a.0 - 1.0 || b.1 > 0.85 * c.1 {
                fails.push(what);
            }
        }
    }
    assert!(fails.is_empty(), "{fails:#?}");
}

const WALLS: [Wall; 3] = [Wall::Mirror, Wall::Pane, Wall::Opening];

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn mirrors_and_panes_denoise_as_well_as_an_opening() {
    let rooms = WALLS.map(room);
    for is_moving in [true, false] {
        assert_as_good_as_an_opening(&rooms, is_moving);
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn moving_rooms_in_mirrors_denoise_like_an_opening() {
    assert_as_good_as_an_opening(&WALLS.map(moving_room), true);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn turning_mirror_denoises_like_an_opening() {
    assert_as_good_as_an_opening(&[Wall::Mirror, Wall::Opening].map(turning_room), true);
}

/// Asserts that a change improves both eyes' FLIP to at most this fraction; returns whether it improves their PSNR.
fn assert_sharper(
    (subject, expected): (&Subject, &[RgbImage; 2]),
    (denoiser, is_moving): (Denoiser, bool),
    most: f64,
    change: impl Fn(&mut RunConfig, bool),
) -> bool {
    let [sharp, blurred] = [true, false].map(|is_on| {
        errors(subject, expected, &with(settings(subject, denoiser), |config| change(config, is_on)), is_moving)
    });
    let pairs = sharp.iter().zip(&blurred);
    pairs.clone().for_each(|(sharp, blurred)| {
        let [a, b] = [sharp, blurred].map(|e| (e.psnr, e.flip));
        let what = format!("{denoiser:?}, moving {is_moving}: PSNR and FLIP {a:.3?}, blurred {b:.3?}");
        println!("{what}");
        assert!(sharp.flip < most * blurred.flip, "{what}");
    });
    pairs.clone().all(|(sharp, blurred)| sharp.psnr > blurred.psnr)
}

#[test]
fn lacquer_shows_the_room_sharply() {
    let subject = room(Wall::Lacquer);
    for is_moving in sampled([true, false], 2) {
        let seen = (&subject, &reference(&subject, is_moving));
        let follow = |config: &mut RunConfig, is_on| config.follow_mirrors = is_on;
        assert!(assert_sharper(seen, (Denoiser::SVGF, is_moving), 0.9, follow), "PSNR, moving {is_moving}");
    }
}

/// The room has the noise of one sample per pixel, so `bmfr` gains little.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn brushed_mirrors_bypass_blurring_denoisers() {
    let subject = room(Wall::Brushed);
    let seen = (&subject, &reference(&subject, false));
    for (denoiser, most) in [(Denoiser::ATROUS, 0.8), (Denoiser::BMFR, 1.0)] {
        assert_sharper(seen, (denoiser, false), most, |config, is_on| config.bypass_narrow_lobes = is_on);
    }
}

/// Pixels of the mirror are holes where those of the opening are: where the left eye does not see the point.
#[test]
fn right_eye_reuses_light_in_plane_mirrors() {
    let holes = |wall, follow_mirrors| {
        let subject = room(wall);
        let mut settings = settings(&subject, Denoiser::SVGF);
        (settings.follow_mirrors, settings.buffers.aovs) = (follow_mirrors, vec![Aov::Holes]);
        let mut stage = Stage::alone(&subject, &settings);
        stage.frame(0);
        stage.aov(0).right()[0].iter().map(|reason| *reason != 0.0).collect::<Vec<_>>()
    };
    let count = |holes: &[bool]| holes.iter().filter(|is_hole| **is_hole).count();
    let [mirror, opening] = [Wall::Mirror, Wall::Opening].map(|wall| holes(wall, true));
    let differing = mirror.iter().zip(&opening).filter(|(a, b)| a != b).count();
    let [followed, true_holes, blurred] = [&mirror, &opening, &holes(Wall::Mirror, false)].map(|holes| count(holes));
    println!("{followed} holes, {true_holes} with the opening, {differing} differ, {blurred} without following");
    assert!(followed as f64 <= 1.1 * true_holes as f64 && differing <= 3, "{followed}, {true_holes}, {differing}");
    assert!(blurred > 5 * true_holes, "{blurred}");
}

/// Returns the room with a second mirror on the far wall, a mirror ball, a pane, a glass ball and a coated ball.
pub fn hall_of_mirrors() -> Subject {
    let mut scene = room(Wall::Mirror).scene;
    let gold = add_material(&mut scene, studio::metal(vec3(0.9, 0.7, 0.4), 0.0));
    place(&mut scene, quad(vec3(1.5, 0.0, 1.98), -1.5 * Vec3::X, 2.0 * Vec3::Y, gold));
    let ball = add_mesh(&mut scene, icosphere(3, true, gold));
    instance(&mut scene, ball, scaled_at(0.35, vec3(0.1, 0.35, -0.9)));
    instance(&mut scene, ball, Affine3A::from_translation(vec3(0.0, 5.0, 0.0)));
    let pane = add_material(&mut scene, studio::glass(vec3(0.9, 1.0, 0.9), 0.0));
    place(&mut scene, quad(vec3(-1.6, 0.1, 0.0), vec3(1.2, 0.0, -0.2), 1.2 * Vec3::Y, pane));
    let clear = add_material(&mut scene, solid_glass());
    place_at(&mut scene, icosphere(3, true, clear), scaled_at(0.3, vec3(0.6, 0.9, -0.5)));
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let coated = Material { clearcoat: coat, ..studio::dielectric(vec3(0.3, 0.1, 0.1), 0.5) };
    let coated = add_material(&mut scene, coated);
    place_at(&mut scene, icosphere(3, true, coated), scaled_at(0.25, vec3(-0.4, 0.25, 0.1)));
    subject("hall of mirrors", scene)
}
