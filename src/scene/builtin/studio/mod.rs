//! A room with every kind of dynamic geometry and light: a skinned walking figure, two swinging lamps, a fan with rigid
//! blades, a banner with morph targets, and a sign that switches off. Everything repeats after four seconds.

mod assembly;
mod figure;
mod maths;
mod shapes;
mod staging;
mod surface;
mod walk;

#[cfg(test)]
mod tests;

use glam::{DQuat, DVec3, Vec2, Vec3};
use std::f64::consts::FRAC_PI_2;

use self::assembly::{checker, emitter, glossy, matte, metal, sheet, textured};
use self::figure::JOINTS;
use self::maths::{shift, sin_cos, turn_x, turn_z};
use self::shapes::{block, cylinder, lathe, sphere};
use self::staging::{Staging, turned, wave};
use self::surface::Surface;
use self::walk::Stride;
use crate::scene::motion::{Attached, Emitter, Morph, Target};
use crate::scene::{Light, LightKind, Mesh, Scene};

/// Half the room's width, its height, and z of its back and its open front, metres.
const HALF: f32 = 2.2;
const HEIGHT: f32 = 2.8;
const BACK: f32 = -2.0;
const FRONT: f32 = 2.4;

/// Number of steps between the keyframes of the walk, and of swinging motion, in one period.
const WALK_STEPS: u32 = 160;
const SWING_STEPS: u32 = 64;

pub fn build() -> Scene {
    let mut s = Staging::new("studio");
    room(&mut s);
    sign(&mut s);
    walker(&mut s);
    lamps(&mut s);
    fan(&mut s);
    banner(&mut s);
    s.finish()
}

fn room(s: &mut Staging) {
    let a = &mut s.still;
    let white = a.material(matte("plaster", [0.72, 0.7, 0.66]));
    let blue = a.material(matte("blue wall", [0.2, 0.3, 0.42]));
    let ochre = a.material(matte("ochre wall", [0.6, 0.4, 0.16]));
    let tiles = a.texture(checker(64, 8, 200, 140));
    let floor = a.material(textured("floor", tiles));
    let (x, y, z) = (Vec3::X * 2.0 * HALF, Vec3::Y * HEIGHT, Vec3::Z * (FRONT - BACK));
    let corner = Vec3::new(-HALF, 0.0, BACK);
    a.add(Surface::quad(corner + z, x, -z).uv_scaled(Vec2::splat(0.5)), floor);
    a.add(Surface::quad(corner + y, x, z), white);
    a.add(Surface::quad(corner, x, y), white);
    a.add(Surface::quad(corner + z, -z, y), blue);
    a.add(Surface::quad(corner + x, z, y), ochre);

    let wood = a.material(glossy("wood", [0.3, 0.17, 0.08], 0.35));
    let steel = a.material(metal("steel", [0.75, 0.75, 0.78], 0.12));
    a.add(block([1.65, 0.0, 0.75], [0.5, 0.7, 0.5]), wood);
    a.add(sphere(0.22, 32, 16).moved(1.65, 0.92, 0.75), steel);
}

/// Adds a sign on the left wall that switches off after two seconds.
fn sign(s: &mut Staging) {
    const COLOR: Vec3 = Vec3::new(0.25, 0.8, 1.0);
    const STRENGTH: f32 = 6.0;
    let glow = s.still.material(emitter("sign", (COLOR * STRENGTH).to_array()));
    s.still.add(Surface::quad(Vec3::new(0.01 - HALF, 1.1, 0.5), Vec3::NEG_Z * 1.1, Vec3::Y * 0.5), glow);
    s.motion.emitters.push(Emitter { index: glow, color: COLOR, strength: STRENGTH });
    s.switched(Target::EmissiveStrength(0), &[0.0, 2.0], &[STRENGTH.into(), 0.1]);
}

fn walker(s: &mut Staging) {
    let cloth = s.still.material(matte("figure", [1.0; 3]));
    let mesh = s.still.raw_mesh(figure::mesh(cloth));
    let root = s.node("figure", None, DVec3::ZERO, DQuat::IDENTITY);
    s.sampled(Target::Translation(root), WALK_STEPS, |t| Stride::at(t).place.to_array());
    s.sampled(Target::Rotation(root), WALK_STEPS, |t| Stride::at(t).heading.to_array());
    let mut joints: Vec<usize> = Vec::new();
    for (i, joint) in JOINTS.iter().enumerate() {
        let (parent, from) = joint.parent.map_or((root, DVec3::ZERO), |p| (joints[p], JOINTS[p].at));
        let node = s.node(joint.name, Some(parent), joint.at - from, DQuat::IDENTITY);
        s.sampled(Target::Rotation(node), WALK_STEPS, |t| Stride::at(t).turns[i].to_array());
        joints.push(node);
    }
    s.sampled(Target::Translation(joints[figure::PELVIS]), WALK_STEPS, |t| Stride::at(t).pelvis.to_array());
    s.dress(mesh, joints, &JOINTS.map(|j| j.at));
}

/// Adds two lamps that hang from the ceiling. The second has a spotlight as well.
fn lamps(s: &mut Staging) {
    const DROP: f32 = 0.95;
    let cord = s.still.material(matte("cord", [0.05; 3]));
    let enamel = s.still.material(sheet(glossy("enamel", [0.55, 0.08, 0.06], 0.3)));
    let bulb = s.still.material(emitter("bulb", [110.0, 82.0, 52.0]));
    let meshes = [
        s.still.mesh(cylinder(0.006, DROP - 0.17, 6).moved(0.0, 0.17 - DROP, 0.0), cord),
        s.still.mesh(lathe(&[[0.18, -DROP], [0.12, 0.1 - DROP], [0.03, 0.17 - DROP]], 24), enamel),
        s.still.mesh(sphere(0.05, 12, 6).moved(0.0, 0.05 - DROP, 0.0), bulb),
    ];
    let places = [([-1.25, -0.7], DVec3::Z, 0.3, 0.0), ([1.0, 0.5], DVec3::new(0.6, 0.0, 0.8), 0.25, 0.3)];
    for (name, ([x, z], axis, swing, phase)) in ["left lamp", "right lamp"].into_iter().zip(places) {
        let hook = s.node(name, None, DVec3::new(x, HEIGHT.into(), z), DQuat::IDENTITY);
        meshes.into_iter().for_each(|mesh| s.hang(mesh, hook));
        let at = |t: f64| turned(axis, swing * wave(t / 2.0 + phase).0).to_array();
        s.sampled(Target::Rotation(hook), SWING_STEPS, at);
        if name == "right lamp" {
            // Lights shine along their node's −z.
            let down = turned(DVec3::X, -FRAC_PI_2);
            let node = s.node("spot", Some(hook), DVec3::new(0.0, -f64::from(DROP) - 0.02, 0.0), down);
            let (cos_inner, cos_outer) = (0.9, 0.77);
            let kind =
                LightKind::Spot { position: Vec3::ZERO, radius: 0.0, direction: Vec3::NEG_Y, cos_inner, cos_outer };
            s.motion
                .lights
                .push(Attached { index: s.still.light(Light { kind, strength: Vec3::new(9.0, 8.2, 7.0) }), node });
        }
    }
}

/// Adds a fan on a stand, with an oscillating head.
fn fan(s: &mut Staging) {
    const BLADES: u32 = 4;
    const AT: [f32; 3] = [1.5, 1.3, -1.15];
    let dark = s.still.material(glossy("fan", [0.1, 0.11, 0.12], 0.3));
    let brass = s.still.material(sheet(metal("blade", [0.85, 0.68, 0.35], 0.3)));
    let [x, y, z] = AT;
    s.still.add(cylinder(0.2, 0.03, 24).with(cylinder(0.022, y, 12)).moved(x, 0.0, z), dark);
    let along_z = turn_x(std::f32::consts::FRAC_PI_2);
    let motor = s.still.mesh(cylinder(0.07, 0.2, 20).transformed(shift(0.0, 0.0, -0.12) * along_z), dark);
    let hub = s.still.mesh(sphere(0.05, 16, 8), brass);
    let blade = s.still.mesh(blade(), brass);
    let head = s.node("fan", None, Vec3::from(AT).as_dvec3(), DQuat::IDENTITY);
    s.hang(motor, head);
    s.sampled(Target::Rotation(head), SWING_STEPS, |t| turned(DVec3::Y, -0.7 + 0.4 * wave(t / 4.0).0).to_array());
    let rotor = s.node("rotor", Some(head), DVec3::Z * 0.1, DQuat::IDENTITY);
    s.hang(hub, rotor);
    // The rotor turns once per second. Steps are far below half a turn, so that interpolation takes the right
    // direction.
    s.sampled(Target::Rotation(rotor), SWING_STEPS, |t| turned(DVec3::Z, t.fract() * std::f64::consts::TAU).to_array());
    for i in 0..BLADES {
        let turn = turned(DVec3::Z, std::f64::consts::TAU * f64::from(i) / f64::from(BLADES));
        let node = s.node("blade", Some(rotor), DVec3::ZERO, turn);
        s.hang(blade, node);
    }
}

/// Returns a twisted blade along +x that flattens towards its end.
fn blade() -> Surface {
    Surface::smooth_grid(8, 2, |u, v| {
        let (sin, cos) = sin_cos(0.7 - 0.4 * u);
        let across = (v - 0.5) * (0.09 + 0.1 * u);
        Vec3::new(0.03 + 0.37 * u, across * cos, across * sin)
    })
}

/// Adds a cloth that hangs from a rod on the back wall. Its folds travel as the weights of two morph targets vary.
fn banner(s: &mut Staging) {
    const RED: [f32; 3] = [0.55, 0.05, 0.07];
    const TOP: [f32; 3] = [-0.75, 2.45, BACK + 0.25];
    let red = s.still.material(sheet(matte("banner", RED)));
    let wood = s.still.material(glossy("rod", [0.3, 0.17, 0.08], 0.35));
    let across = turn_z(std::f32::consts::FRAC_PI_2);
    let [x, y, z] = TOP;
    s.still.add(cylinder(0.018, WIDTH + 0.2, 10).transformed(shift(x + 0.5 * WIDTH + 0.1, y, z) * across), wood);
    let mesh = s.still.raw_mesh(cloth(red));
    let node = s.node("banner", None, Vec3::from(TOP).as_dvec3(), DQuat::IDENTITY);
    s.body(mesh, node, None, vec![1.0, 0.0]);
    s.sampled(Target::Weights(node), SWING_STEPS, |t| [wave(t / 2.0).1, wave(t / 2.0).0]);
}

/// Size of the banner, metres.
const WIDTH: f32 = 1.3;
const LENGTH: f32 = 1.7;

/// Returns a flat cloth that hangs from the origin, and two morph targets a quarter wave apart. Normals of the sum are
/// exact: a surface z(x, y) has the normal (−∂z/∂x, −∂z/∂y, 1), which is linear in z.
fn cloth(material: usize) -> Mesh {
    const DEPTH: f32 = 0.09;
    const WAVES: [f32; 2] = [7.0, 2.2];
    let corner = Vec3::new(-0.5 * WIDTH, -LENGTH, 0.0);
    let flat = Surface::smooth_grid(26, 18, |u, v| corner + Vec3::new(u * WIDTH, v * LENGTH, 0.0));
    let mut mesh = flat.into_mesh(material);
    for quarter in [0.0, std::f32::consts::FRAC_PI_2] {
        let mut morph = Morph::default();
        for p in &mesh.positions {
            let (sin, cos) = sin_cos(WAVES[0] * p.x + WAVES[1] * p.y + quarter);
            let deep = DEPTH * -p.y / LENGTH;
            let slopes = [deep * WAVES[0] * cos, deep * WAVES[1] * cos - DEPTH / LENGTH * sin];
            morph.positions.push(Vec3::Z * deep * sin);
            morph.normals.push(Vec3::new(-slopes[0], -slopes[1], 0.0));
        }
        mesh.morphs.push(morph);
    }
    mesh
}
