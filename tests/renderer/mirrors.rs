//! Frames that follow perfect mirrors, clear glass and polish: what a mirror or a pane shows is as good as the room behind
//! an opening.

use crate::common::{Stage, Subject, with_outputs};
use crate::reference::scenes::moving::Draft;
use crate::reference::scenes::{
    add_material, add_matte, add_mesh, block, empty, icosphere, instance, matte, place, quad,
};
use crate::reference::scenes::{scaled_at, studio};
use crate::same_bytes::assert_same;
use diptych::RunConfig;
use diptych::exec::Stereo;
use diptych::graph::Resource;
use diptych::image::{Extent, Image, RgbImage};
use diptych::metrics::{self, Errors};
use diptych::passes::Aov;
use diptych::quality::Denoiser;
use diptych::scene::rig::{Eye, Rig, RigKey, View};
use diptych::scene::{Clearcoat, Material, Mesh, Scene, Volume};
use glam::{Affine3A, DVec2, DVec3, Vec3, dvec2, vec3};

const WIDTH: u32 = 64;
const HEIGHT: u32 = 48;
const BOUNCES: u32 = 3;
const FPS: f64 = 72.0;

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
enum Wall {
    Mirror,
    Brushed,
    Lacquer,
    Opening,
    Pane,
}

/// Returns a room with such a wall, and its camera, which moves sideways.
fn room(wall: Wall) -> Subject {
    let mut scene = empty("room");
    let [white, red, blue, yellow] =
        [[0.7, 0.7, 0.7], [0.8, 0.2, 0.2], [0.2, 0.3, 0.8], [0.8, 0.7, 0.2]].map(|c| add_matte(&mut scene, c.into()));
    let lamp = add_material(&mut scene, Material { emissive: vec3(6.0, 5.5, 5.0), ..matte() });
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

fn subject(name: &str, scene: Scene) -> Subject {
    let key = |time_s, x: f64| RigKey {
        time_s,
        position: DVec3::new(x, 1.3, 1.2),
        target: DVec3::new(0.3 * x, 1.1, -2.0),
        up: DVec3::Y,
    };
    Subject::new(name, scene, Rig::of_keys(vec![key(0.0, -0.3), key(1.0, 0.9)]))
}

/// Returns the room with a block that moves, also behind an opening or a pane.
fn moving_room(wall: Wall) -> Subject {
    let mut draft = Draft::new("moving");
    draft.scene = room(wall).scene;
    let red = add_matte(&mut draft.scene, vec3(0.8, 0.2, 0.2));
    let mesh = add_mesh(&mut draft.scene, block(red));
    let way = [vec3(-0.4, 0.4, 0.5), vec3(0.8, 0.7, 0.4)];
    let over = |p: Vec3| vec3(p.x, p.y, 2.0 * MIRROR_Z - p.z);
    for [from, to] in [way, way.map(over)].into_iter().take(if wall == Wall::Mirror { 1 } else { 2 }) {
        let node = draft.node(None, from.as_dvec3(), DVec3::splat(0.3));
        draft.shift(node, from, to);
        draft.body(mesh, node, None, Vec::new());
    }
    subject(&format!("moving {wall:?}"), draft.done())
}

fn settings(subject: &Subject, denoiser: Denoiser) -> RunConfig {
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    (settings.envelope.most.denoiser, settings.envelope.most.bounces) = (Some(denoiser), BOUNCES);
    settings.envelope.most.iterations = [denoiser.most_iterations().min(5); 3];
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
    (settings.seed, settings.envelope.most.spp, settings.envelope.most.bounces) = (99, 16, BOUNCES);
    let mut stage = Stage::alone(subject, &settings);
    let parts = (0..PARTS).map(|index| stage.frame_at(time_s(FRAMES - 1, is_moving), index).linear);
    let sum = parts.map(|eyes| [within(&eyes.left), within(&eyes.right)]).reduce(|mut sum, part| {
        for (sum, part) in sum.iter_mut().zip(part) {
            let pairs = sum.pixels.as_flattened_mut().iter_mut().zip(part.pixels.as_flattened());
            pairs.for_each(|(sum, part)| *sum += part);
        }
        sum
    });
    let mut mean = sum.expect("there are parts");
    mean.iter_mut().for_each(|eye| eye.pixels.as_flattened_mut().iter_mut().for_each(|v| *v /= PARTS as f32));
    mean
}

/// Compares the mirror of the last frame with a reference, in both eyes.
fn errors(subject: &Subject, reference: &[RgbImage; 2], settings: &RunConfig, is_moving: bool) -> [Errors; 2] {
    let mut stage = Stage::alone(subject, settings);
    let frames = (0..FRAMES).map(|index| stage.frame_at(time_s(index, is_moving), index).linear);
    let found = frames.last().expect("there are frames");
    let compare = |expected: &RgbImage, found: &RgbImage| metrics::compare(expected, &within(found)).unwrap();
    [compare(&reference[0], &found.left), compare(&reference[1], &found.right)]
}

/// Asserts that the mirror and the pane of these rooms show as much as the opening, and more than if they are not
/// followed.
fn assert_as_good_as_an_opening([mirror, pane, opening]: &[Subject; 3], is_moving: bool) {
    assert!(mirror.needs.mirrors && pane.needs.mirrors && !opening.needs.mirrors);
    let of = |subject: &Subject, expected: &[RgbImage; 2], follow_mirrors| {
        let settings = RunConfig { follow_mirrors, ..settings(subject, Denoiser::SVGF) };
        errors(subject, expected, &settings, is_moving)
    };
    let twin = of(opening, &reference(opening, is_moving), true);
    let mut fails = Vec::new();
    for subject in [mirror, pane] {
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
fn mirrors_and_panes_show_a_room_as_well_as_an_opening_would() {
    let rooms = WALLS.map(room);
    for is_moving in [false, true] {
        assert_as_good_as_an_opening(&rooms, is_moving);
    }
}

/// Surfaces that move have no history in mirrors and behind panes.
#[test]
fn mirrors_and_panes_show_a_moving_room_as_well_as_an_opening_would() {
    assert_as_good_as_an_opening(&WALLS.map(moving_room), true);
}

#[test]
fn lacquer_shows_the_room_sharply() {
    let subject = room(Wall::Lacquer);
    for is_moving in [false, true] {
        let expected = reference(&subject, is_moving);
        let [followed, blurred] = [true, false].map(|follow_mirrors| {
            errors(&subject, &expected, &RunConfig { follow_mirrors, ..settings(&subject, Denoiser::SVGF) }, is_moving)
        });
        for (eye, (followed, blurred)) in followed.iter().zip(&blurred).enumerate() {
            let [a, b] = [followed, blurred].map(|e| (e.psnr, e.flip));
            println!("moving {is_moving}, eye {eye}: PSNR and FLIP {a:.3?}, blurred {b:.3?}");
            assert!(followed.flip < 0.9 * blurred.flip && a.0 > b.0, "moving {is_moving}, eye {eye}: {a:.3?}, {b:.3?}");
        }
    }
}

/// The room has the noise of one sample per pixel, so `bmfr` gains little.
#[test]
fn denoisers_that_would_blur_a_brushed_mirror_leave_its_light_alone() {
    let subject = room(Wall::Brushed);
    let expected = reference(&subject, false);
    for (denoiser, most) in [(Denoiser::ATROUS, 0.8), (Denoiser::BMFR, 1.0)] {
        let [sharp, blurred] = [true, false].map(|bypass_narrow_lobes| {
            errors(&subject, &expected, &RunConfig { bypass_narrow_lobes, ..settings(&subject, denoiser) }, false)
        });
        for (sharp, blurred) in sharp.iter().zip(&blurred) {
            let [a, b] = [sharp, blurred].map(|e| (e.psnr, e.flip));
            println!("{denoiser:?}: PSNR and FLIP {a:.3?}, filtered {b:.3?}");
            assert!(sharp.flip < most * blurred.flip, "{denoiser:?}: PSNR and FLIP {a:.3?}, filtered {b:.3?}");
        }
    }
}

/// Pixels of the mirror are holes where those of the opening are: where the left eye does not see the point.
#[test]
fn the_right_eye_takes_over_light_in_plane_mirrors() {
    let holes = |wall, follow_mirrors| {
        let subject = room(wall);
        let mut settings = settings(&subject, Denoiser::SVGF);
        (settings.follow_mirrors, settings.buffers.aovs) = (follow_mirrors, vec![Aov::Holes]);
        let mut stage = Stage::alone(&subject, &settings);
        stage.frame(0);
        stage.aov(0).right[0].iter().map(|reason| *reason != 0.0).collect::<Vec<_>>()
    };
    let count = |holes: &[bool]| holes.iter().filter(|is_hole| **is_hole).count();
    let [mirror, opening] = [Wall::Mirror, Wall::Opening].map(|wall| holes(wall, true));
    let differing = mirror.iter().zip(&opening).filter(|(a, b)| a != b).count();
    let [followed, true_holes, blurred] = [&mirror, &opening, &holes(Wall::Mirror, false)].map(|holes| count(holes));
    println!("{followed} holes, {true_holes} with the opening, {differing} differ, {blurred} without following");
    assert!(followed as f64 <= 1.1 * true_holes as f64 && differing <= 3, "{followed}, {true_holes}, {differing}");
    assert!(blurred > 5 * true_holes, "{blurred}");
}

/// Returns the room with a ball in its middle.
fn room_with_ball(name: &str, material: Material) -> Subject {
    let mut scene = room(Wall::Opening).scene;
    let material = add_material(&mut scene, material);
    let ball = add_mesh(&mut scene, icosphere(4, true, material));
    instance(&mut scene, ball, scaled_at(0.6, vec3(0.0, 1.2, -0.8)));
    subject(name, scene)
}

/// Returns the point of a view's image at which it sees a point, in pixels.
fn seen_at(view: &View, point: DVec3, extent: Extent) -> DVec2 {
    let along = point - view.origin.as_dvec3();
    let [right, up, forward] = [view.right, view.up, view.forward].map(|axis| along.dot(axis.as_dvec3()));
    let [width, height] = [extent.width, extent.height].map(f64::from);
    let pixels = height / 2.0 / f64::from(view.tan_half_yfov);
    dvec2(width / 2.0 + pixels * right / forward, height / 2.0 - pixels * up / forward)
}

/// The images of surfaces in a mirror ball and in a glass ball lie where the other eye sees the surfaces. A search over
/// all of its pixels tells where that is.
#[test]
fn balls_show_surfaces_where_a_search_finds_them() {
    const EXTENT: Extent = Extent::new(160, 120);
    let clear = Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY };
    let balls = [
        ("mirror ball", studio::metal(Vec3::ONE, 0.0), 0.2, 0.2),
        ("glass ball", Material { volume: Some(clear), ..studio::glass(Vec3::ONE, 0.0) }, 0.064, 1.0),
    ];
    for (name, material, baseline_m, most) in balls {
        let mut subject = room_with_ball(name, material);
        subject.rig.baseline_m = baseline_m;
        let mut settings = subject.accumulated(EXTENT.width, EXTENT.height);
        settings.envelope.most.bounces = BOUNCES;
        settings.buffers.declarations = with_outputs(&["hit", "guide"]);
        let mut stage = Stage::alone(&subject, &settings);
        stage.frame(0);
        let mut read = |name| {
            let eyes = stage.renderer().read_output(Resource::image::<[u32; 4]>(name)).unwrap();
            [eyes.left, eyes.right].map(|bytes| bytemuck::pod_collect_to_vec::<u8, [u32; 4]>(&bytes))
        };
        let [hits, guides] = [read("hit"), read("guide")];
        let is_mirrored =
            |eye: usize, at: usize| hits[eye][at][3] & 0x0080_0000 != 0 && guides[eye][at][3] != 0x8000_8000;
        let position = |eye: usize, at: usize| {
            let [x, y, z, _] = guides[eye][at].map(f32::from_bits);
            vec3(x, y, z).as_dvec3()
        };
        let [left, right] = [Eye::Left, Eye::Right].map(|eye| subject.rig.view(0.0, eye));
        let width = EXTENT.width as usize;
        let centre = |at: usize| dvec2((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        let mut off = Vec::new();
        for at in (0..hits[0].len()).filter(|at| is_mirrored(0, *at)) {
            let point = position(0, at);
            let material = hits[0][at][3] & 0x00ff_ffff;
            let others =
                (0..hits[1].len()).filter(|at| is_mirrored(1, *at) && hits[1][*at][3] & 0x00ff_ffff == material);
            let found =
                others.min_by(|a, b| position(1, *a).distance(point).total_cmp(&position(1, *b).distance(point)));
            let Some(found) = found.filter(|found| position(1, *found).distance(point) < 0.02) else { continue };
            let direction = left.ray_direction(centre(at).x, centre(at).y, EXTENT);
            let at_distance = |distance: f64| {
                let image = left.origin.as_dvec3() + distance * direction;
                seen_at(&right, image, EXTENT).distance(centre(found))
            };
            off.push([
                at_distance(f32::from_bits(hits[0][at][1]).into()),
                at_distance(left.origin.as_dvec3().distance(point)),
            ]);
        }
        let median = |i: usize| {
            let mut sorted: Vec<f64> = off.iter().map(|both| both[i]).collect();
            sorted.sort_by(f64::total_cmp);
            sorted[sorted.len() / 2]
        };
        let [by_image, by_surface] = [0, 1].map(median);
        println!(
            "{name}: {} pixels, median {by_image:.2} px off, {by_surface:.2} at the surface's own distance",
            off.len()
        );
        assert!(off.len() > 200 && by_image < most && by_surface > 3.0 * by_image, "{name}: {by_image} {by_surface}");
    }
}

/// Returns the room with a second mirror on the far wall, a mirror ball, a pane, a glass ball and a coated ball.
fn hall_of_mirrors() -> Subject {
    let mut scene = room(Wall::Mirror).scene;
    let gold = add_material(&mut scene, studio::metal(vec3(0.9, 0.7, 0.4), 0.0));
    place(&mut scene, quad(vec3(1.5, 0.0, 1.98), -1.5 * Vec3::X, 2.0 * Vec3::Y, gold));
    let ball = add_mesh(&mut scene, icosphere(3, true, gold));
    instance(&mut scene, ball, scaled_at(0.35, vec3(0.1, 0.35, -0.9)));
    instance(&mut scene, ball, Affine3A::from_translation(vec3(0.0, 5.0, 0.0)));
    let pane = add_material(&mut scene, studio::glass(vec3(0.9, 1.0, 0.9), 0.0));
    place(&mut scene, quad(vec3(-1.6, 0.1, 0.0), vec3(1.2, 0.0, -0.2), 1.2 * Vec3::Y, pane));
    let clear = Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY };
    let clear = add_material(&mut scene, Material { volume: Some(clear), ..studio::glass(Vec3::ONE, 0.0) });
    let ball = add_mesh(&mut scene, icosphere(3, true, clear));
    instance(&mut scene, ball, scaled_at(0.3, vec3(0.6, 0.9, -0.5)));
    let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
    let coated = Material { clearcoat: coat, ..studio::dielectric(vec3(0.3, 0.1, 0.1), 0.5) };
    let coated = add_material(&mut scene, coated);
    let ball = add_mesh(&mut scene, icosphere(3, true, coated));
    instance(&mut scene, ball, scaled_at(0.25, vec3(-0.4, 0.25, 0.1)));
    subject("hall of mirrors", scene)
}

#[test]
fn frames_that_follow_mirrors_have_the_bytes_of_one_device() {
    let [still, moving] = [hall_of_mirrors(), moving_room(Wall::Mirror)];
    let of_still = [(&still, Denoiser::SVGF, 1), (&still, Denoiser::BMFR, 1), (&still, Denoiser::SVGF, 2)];
    let of_moving = [(&moving, Denoiser::SVGF, 1), (&moving, Denoiser::BMFR, 1)];
    for (subject, denoiser, spp) in of_still.into_iter().chain(of_moving) {
        let mut settings = settings(subject, denoiser);
        settings.envelope.most.spp = spp;
        let [one, three] = [1, 3].map(|devices| {
            let mut stage = Stage::even(subject, &settings, devices);
            (0..3).map(|index| stage.frame_at(f64::from(index) / FPS, index)).collect::<Vec<_>>()
        });
        for (index, (one, three)) in one.iter().zip(&three).enumerate() {
            let what = format!("{}, {denoiser:?}, {spp} spp, frame {index}", subject.name);
            assert_same(&what, &one.linear, &three.linear);
            assert_eq!(one.report.tallies, three.report.tallies, "{what}");
        }
    }
}

/// Filtered frames change if mirrors are followed; auxiliary images do not.
#[test]
fn auxiliary_images_show_the_mirrors_themselves() {
    let subject = hall_of_mirrors();
    let aovs = [Aov::Albedo, Aov::Normal, Aov::Position, Aov::Depth, Aov::Roughness, Aov::Motion, Aov::SpecularAlbedo];
    let render = |follow_mirrors: bool| {
        let mut settings = settings(&subject, Denoiser::SVGF);
        (settings.follow_mirrors, settings.buffers.aovs) = (follow_mirrors, aovs.to_vec());
        let mut stage = Stage::alone(&subject, &settings);
        let frame = stage.frame(0).linear;
        (frame, aovs.iter().enumerate().map(|(i, _)| stage.aov(i)).collect::<Vec<Stereo<_>>>())
    };
    let [(followed, of_followed), (blurred, of_blurred)] = [true, false].map(render);
    assert!(followed.left.pixels != blurred.left.pixels, "no mirror is followed");
    for ((aov, a), b) in aovs.iter().zip(of_followed).zip(of_blurred) {
        assert!(a.left == b.left && a.right == b.right, "{}", aov.name());
    }
}
