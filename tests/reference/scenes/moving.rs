//! Animated scenes, one for each kind of motion, with a common camera.

use std::f32::consts::{FRAC_PI_2, TAU};

use diptych::image::{Extent, Image};
use diptych::scene::motion::keys::{Interpolation, Keys};
use diptych::scene::motion::{
    Animation, Attached, Body, Channel, Emitter, Influence, Morph, Motion, Node, Placement, Skin, Target,
};
use diptych::scene::{Environment, Light, LightKind, NormalMap};
use glam::{DQuat, DVec3, Vec2, vec4};

use super::*;

/// Duration of the motions in seconds, after which they repeat.
pub const DURATION_S: f64 = 2.0;

/// An animated scene under construction.
pub struct Draft {
    pub scene: Scene,
    channels: Vec<Channel>,
}

impl Draft {
    pub fn new(name: &str) -> Self {
        Self { scene: empty(name), channels: Vec::new() }
    }

    /// Creates a grey floor in front of a wall, with some light from all directions.
    pub fn room(name: &str) -> Self {
        let mut draft = Self::new(name);
        let scene = &mut draft.scene;
        scene.environment = Environment::Constant(vec3(0.35, 0.4, 0.45));
        let grey = add_matte(scene, Vec3::splat(0.6));
        place(scene, quad(vec3(-4.0, 0.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 6.0, grey));
        place(scene, quad(vec3(-4.0, 0.0, -2.0), Vec3::X * 8.0, Vec3::Y * 4.0, grey));
        draft
    }

    pub fn node(&mut self, parent: Option<usize>, translation: DVec3, scale: DVec3) -> usize {
        let rest = Placement::Parts { translation, rotation: DQuat::IDENTITY, scale };
        self.scene.motion.nodes.push(Node { name: String::new(), parent, rest });
        self.scene.motion.nodes.len() - 1
    }

    pub fn animate(&mut self, target: Target, interpolation: Interpolation, times_s: &[f32], values: &[f32]) {
        let keys = Keys::new(times_s.to_vec(), values.to_vec(), values.len() / times_s.len(), interpolation).unwrap();
        self.channels.push(Channel { target, keys });
    }

    /// Rotates a node around an axis from rest to `angle` in the middle of the motion and back.
    pub fn swing(&mut self, node: usize, axis: DVec3, angle: f64) {
        let turned = |angle| DQuat::from_axis_angle(axis.normalize(), angle).as_quat().to_array();
        let keys = [turned(0.0), turned(angle), turned(0.0)].concat();
        self.animate(Target::Rotation(node), Interpolation::Linear, &[0.0, 1.0, 2.0], &keys);
    }

    /// Moves a node from `from` to `to` in the middle of the motion and back.
    pub fn shift(&mut self, node: usize, from: Vec3, to: Vec3) {
        let keys = [from, to, from].map(|v| v.to_array()).concat();
        self.animate(Target::Translation(node), Interpolation::Linear, &[0.0, 1.0, 2.0], &keys);
    }

    /// Adds a body of that mesh.
    pub fn body(&mut self, mesh: usize, node: usize, skin: Option<usize>, weights: Vec<f32>) {
        let number = self.scene.instances.len();
        instance(&mut self.scene, mesh, Affine3A::IDENTITY);
        self.scene.motion.bodies.push(Body { instance: number, node, skin, weights });
    }

    /// Adds a light on a node.
    pub fn light(&mut self, node: usize, kind: LightKind, strength: Vec3) -> usize {
        self.scene.lights.push(Light { kind, strength });
        let index = self.scene.lights.len() - 1;
        self.scene.motion.lights.push(Attached { index, node });
        index
    }

    /// Returns the scene at time 0.
    pub fn done(mut self) -> Scene {
        let animation = Animation { name: "all".into(), channels: self.channels, duration_s: DURATION_S };
        self.scene.motion.animations = vec![animation];
        self.scene.motion.loops = true;
        let motion: Motion = self.scene.motion.clone();
        motion.place(&motion.pose(0.0), &mut self.scene);
        self.scene
    }
}

pub fn camera() -> Pinhole {
    Pinhole::looking_at(vec3(0.0, 1.2, 4.2), vec3(0.0, 0.8, 0.0), Vec3::Y, 40.0)
}

/// Adds a material with a flat normal map, so that meshes get tangents.
pub fn add_mapped(scene: &mut Scene, albedo: Vec3) -> usize {
    let texture = add_texture(scene, Image::filled(Extent::new(2, 2), [128, 128, 255, 255]), false);
    let normal_map = Some(NormalMap { texture, scale: 1.0 });
    add_material(scene, Material { base_color: albedo.extend(1.0), normal_map, ..matte() })
}

/// Returns an upright tube of radius 0.25 and height 1.5 around the y axis, which three joints at 0, 0.5 and 1 bend.
/// Zero weights precede others or lie between them.
pub fn tube(sides: usize, rings: usize, material: usize) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    for (ring, side) in (0..=rings).flat_map(|r| (0..=sides).map(move |s| (r, s))) {
        let (height, turn) = (1.5 * ring as f32 / rings as f32, side as f32 / sides as f32);
        let (sin, cos) = (turn * TAU).sin_cos();
        mesh.positions.push(vec3(0.25 * cos, height, -0.25 * sin));
        mesh.normals.push(vec3(cos, 0.0, -sin));
        mesh.tangents.push(vec4(-sin, 0.0, -cos, 1.0));
        mesh.uvs[0].push(Vec2::new(turn, 1.0 - height));
        let along = (height / 0.5 - 0.5).clamp(0.0, 2.0);
        let lower = (along as usize).min(1);
        let part = along - lower as f32;
        let mut influence = Influence::default();
        for (slot, joint, weight) in [(2, lower, 1.0 - part), (5, lower + 1, part)] {
            if weight > 0.0 {
                (influence.joints[slot], influence.weights[slot]) = (joint as u16, weight);
            }
        }
        mesh.influences.push(influence);
    }
    mesh.triangles = grid(sides as u32, rings as u32);
    mesh
}

/// Adds a swinging tube at `at`, mirrored by a negative `scale`.
pub fn add_tube(draft: &mut Draft, mesh: usize, at: DVec3, scale: DVec3) {
    let hip = draft.node(None, at, scale);
    let knee = draft.node(Some(hip), DVec3::Y * 0.5, DVec3::ONE);
    let foot = draft.node(Some(knee), DVec3::Y * 0.5, DVec3::ONE);
    let inverse_bind = [0.0, -0.5, -1.0].map(|y| Affine3A::from_translation(Vec3::Y * y)).to_vec();
    draft.scene.motion.skins.push(Skin { joints: vec![hip, knee, foot], inverse_bind });
    let (skin, weights) = (draft.scene.motion.skins.len() - 1, vec![0.0; draft.scene.meshes[mesh].morphs.len()]);
    draft.swing(hip, DVec3::Y, 0.8);
    draft.swing(knee, DVec3::Z, 0.9);
    draft.swing(foot, DVec3::new(1.0, 0.0, 0.5), -0.8);
    draft.body(mesh, hip, Some(skin), weights);
}

/// Returns a square of edge 1 in x and y around (0, 0, 0), with `cells` squares each way and two morph targets: a bulge
/// with normals and tangents of its own, and a shear without.
pub fn patch(cells: usize, material: usize) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    let (mut bulge, mut shear) = (Morph::default(), Morph::default());
    for (row, column) in (0..=cells).flat_map(|r| (0..=cells).map(move |c| (r, c))) {
        let [x, y] = [column, row].map(|i| i as f32 / cells as f32 - 0.5);
        mesh.positions.push(vec3(x, y, 0.0));
        mesh.normals.push(Vec3::Z);
        mesh.tangents.push(vec4(1.0, 0.0, 0.0, 1.0));
        mesh.uvs[0].push(Vec2::new(x + 0.5, 0.5 - y));
        let [(sin_x, cos_x), (sin_y, cos_y)] = [x, y].map(|v| (2.0 * FRAC_PI_2 * v).sin_cos());
        let [dx, dy] = [-sin_x * cos_y, -cos_x * sin_y].map(|d| 0.4 * 2.0 * FRAC_PI_2 * d);
        bulge.positions.push(Vec3::Z * (0.4 * cos_x * cos_y));
        bulge.normals.push(vec3(-dx, -dy, 1.0).normalize() - Vec3::Z);
        bulge.tangents.push(vec3(1.0, 0.0, dx).normalize() - Vec3::X);
        shear.positions.push(vec3(0.4 * y, 0.0, 0.1 * y));
    }
    mesh.triangles = grid(cells as u32, cells as u32);
    mesh.morphs = vec![bulge, shear];
    mesh
}

/// Adds a patch at `at` that bulges and shears.
pub fn add_patch(draft: &mut Draft, mesh: usize, at: DVec3) {
    let node = draft.node(None, at, DVec3::ONE);
    let weights = [0.0, 0.0, 1.0, 0.3, 0.2, 1.0];
    draft.animate(Target::Weights(node), Interpolation::Linear, &[0.0, 0.8, 2.0], &weights);
    draft.body(mesh, node, None, vec![0.0; 2]);
}

pub fn skinned() -> Scene {
    let mut draft = Draft::room("skinned");
    let blue = add_mapped(&mut draft.scene, vec3(0.3, 0.5, 0.8));
    let mesh = add_mesh(&mut draft.scene, tube(16, 12, blue));
    add_tube(&mut draft, mesh, DVec3::new(-0.6, 0.1, 0.0), DVec3::ONE);
    add_tube(&mut draft, mesh, DVec3::new(0.7, 0.1, 0.3), DVec3::new(-0.8, 0.8, 0.8));
    draft.done()
}

pub fn morphed() -> Scene {
    let mut draft = Draft::room("morphed");
    let red = add_mapped(&mut draft.scene, vec3(0.8, 0.4, 0.3));
    let mesh = add_mesh(&mut draft.scene, patch(12, red));
    add_patch(&mut draft, mesh, DVec3::new(-0.7, 0.9, 0.0));
    add_patch(&mut draft, mesh, DVec3::new(0.8, 0.8, 0.4));
    // One instance is static.
    instance(&mut draft.scene, mesh, Affine3A::from_translation(vec3(0.0, 1.3, -1.0)));
    draft.done()
}

/// Blocks that share a mesh; one is mirrored, and one is scaled to zero for a while.
pub fn rigid() -> Scene {
    let mut draft = Draft::room("rigid");
    let green = add_matte(&mut draft.scene, vec3(0.4, 0.8, 0.4));
    let mesh = add_mesh(&mut draft.scene, block(green));
    for (i, scale) in [DVec3::splat(0.5), DVec3::new(-0.6, 0.4, 0.5), DVec3::splat(0.45)].into_iter().enumerate() {
        let at = DVec3::new(1.1 * i as f64 - 1.1, 0.5, 0.3 * i as f64);
        let node = draft.node(None, at, scale);
        draft.swing(node, DVec3::new(0.3, 1.0, 0.2 * i as f64), 1.2);
        draft.shift(node, at.as_vec3(), at.as_vec3() + vec3(0.1, 0.7, -0.3));
        draft.body(mesh, node, None, Vec::new());
        if i == 2 {
            let sizes = [[0.45f32; 3], [0.0; 3], [0.5; 3]].concat();
            draft.animate(Target::Scale(node), Interpolation::Step, &[0.0, 0.9, 1.1], &sizes);
        }
    }
    draft.done()
}

/// Moving spherical light, point light and spot.
pub fn lights() -> Scene {
    let mut draft = Draft::room("lights");
    draft.scene.environment = Environment::Black;
    let grey = add_matte(&mut draft.scene, Vec3::splat(0.7));
    place_at(&mut draft.scene, block(grey), scaled_at(0.6, vec3(0.1, 0.3, 0.2)));
    let sphere = draft.node(None, DVec3::ZERO, DVec3::ONE);
    draft.shift(sphere, vec3(-1.0, 1.5, 0.8), vec3(0.0, 1.7, 1.2));
    draft.light(sphere, LightKind::Point { position: Vec3::ZERO, radius: 0.3 }, Vec3::splat(2.0));
    let point = draft.node(None, DVec3::ZERO, DVec3::ONE);
    draft.shift(point, vec3(1.2, 0.8, 1.0), vec3(0.6, 1.8, 1.0));
    draft.light(point, LightKind::Point { position: Vec3::ZERO, radius: 0.0 }, vec3(1.0, 0.6, 0.3));
    let spot = draft.node(None, DVec3::new(0.0, 3.0, 1.0), DVec3::ONE);
    draft.swing(spot, DVec3::new(-1.0, 0.4, 0.0), 1.8);
    let kind =
        LightKind::Spot { position: Vec3::ZERO, radius: 0.0, direction: Vec3::NEG_Z, cos_inner: 0.95, cos_outer: 0.8 };
    draft.light(spot, kind, vec3(4.0, 5.0, 9.0));
    draft.done()
}

/// Moving emissive blocks, one mirrored, with increasing brightness.
pub fn emissive() -> Scene {
    let mut draft = Draft::room("emissive");
    draft.scene.environment = Environment::Black;
    let color = vec3(1.0, 0.8, 0.5);
    let glow = add_material(&mut draft.scene, Material { emissive: color * 3.0, ..matte() });
    draft.scene.motion.emitters.push(Emitter { index: glow, color, strength: 3.0 });
    draft.animate(Target::EmissiveStrength(0), Interpolation::Linear, &[0.0, 2.0], &[2.0, 6.0]);
    let mesh = add_mesh(&mut draft.scene, block(glow));
    for (x, scale) in [(-0.8, DVec3::splat(0.4)), (0.8, DVec3::new(-0.3, 0.5, 0.3))] {
        let at = DVec3::new(x, 0.8, 0.0);
        let node = draft.node(None, at, scale);
        draft.swing(node, DVec3::new(1.0, 1.0, x), 1.0);
        draft.shift(node, at.as_vec3(), at.as_vec3() + vec3(0.2, 0.6, 0.5));
        draft.body(mesh, node, None, Vec::new());
    }
    draft.done()
}

/// A lamp that is dark until [`SWITCH_S`], beside one that is always on.
pub fn switched() -> Scene {
    let mut draft = Draft::room("switched");
    draft.scene.environment = Environment::Black;
    let mut lamp = |at: Vec3, strength: Vec3| {
        draft.scene.lights.push(Light { kind: LightKind::Point { position: at, radius: 0.0 }, strength });
    };
    lamp(vec3(-1.2, 2.0, 0.5), Vec3::splat(1.0));
    lamp(vec3(1.2, 2.0, 0.8), Vec3::ZERO);
    draft.scene.motion.lamps.push(Emitter { index: 1, color: vec3(1.0, 0.9, 0.8), strength: 0.0 });
    draft.animate(Target::LightIntensity(0), Interpolation::Step, &[0.0, SWITCH_S as f32], &[0.0, 6.0]);
    draft.done()
}

pub const SWITCH_S: f64 = 1.0;

/// All kinds of motion in one scene.
pub fn everything() -> Scene {
    let mut draft = Draft::room("everything");
    let blue = add_mapped(&mut draft.scene, vec3(0.3, 0.5, 0.8));
    let mesh = add_mesh(&mut draft.scene, tube(12, 8, blue));
    add_tube(&mut draft, mesh, DVec3::new(-0.9, 0.1, 0.0), DVec3::ONE);
    add_tube(&mut draft, mesh, DVec3::new(-0.3, 0.1, -0.6), DVec3::new(-0.8, 0.8, 0.8));
    let mesh = add_mesh(&mut draft.scene, patch(8, blue));
    add_patch(&mut draft, mesh, DVec3::new(0.6, 1.2, -0.3));
    let green = add_matte(&mut draft.scene, vec3(0.4, 0.8, 0.4));
    let color = vec3(1.0, 0.8, 0.5);
    let glow = add_material(&mut draft.scene, Material { emissive: color * 3.0, ..matte() });
    for (i, material) in [green, green, glow].into_iter().enumerate() {
        let mesh = add_mesh(&mut draft.scene, block(material));
        let at = DVec3::new(0.7 * i as f64 - 0.3, 0.4, 0.8);
        let node = draft.node(None, at, DVec3::new(if i == 1 { -0.3 } else { 0.3 }, 0.3, 0.4));
        draft.swing(node, DVec3::new(0.3, 1.0, 0.2), 1.5);
        draft.body(mesh, node, None, Vec::new());
    }
    let lamp = draft.node(None, DVec3::ZERO, DVec3::ONE);
    draft.shift(lamp, vec3(-1.0, 1.8, 1.0), vec3(1.0, 2.0, 1.0));
    let light = draft.light(lamp, LightKind::Point { position: Vec3::ZERO, radius: 0.1 }, Vec3::splat(1.5));
    draft.scene.motion.lamps.push(Emitter { index: light, color: Vec3::ONE, strength: 1.5 });
    draft.animate(Target::LightIntensity(0), Interpolation::Step, &[0.0, 0.12], &[1.5, 3.0]);
    draft.done()
}
