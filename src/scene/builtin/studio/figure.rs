//! A figure of tubes around a skeleton, in metres. It stands upright and looks along +z, with its left at +x.

use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::{FRAC_PI_2, TAU};

use super::maths::{sin_cos, turn_x};
use super::surface::{Surface, Vertex};
use crate::scene::Mesh;
use crate::scene::motion::Influence;

/// Name of a joint, index of its parent, and position in the mesh.
pub struct Joint {
    pub name: &'static str,
    pub parent: Option<usize>,
    pub at: DVec3,
}

const fn joint(name: &'static str, parent: Option<usize>, at: [f64; 3]) -> Joint {
    Joint { name, parent, at: DVec3::from_array(at) }
}

pub const PELVIS: usize = 0;
pub const SPINE: usize = 1;
pub const CHEST: usize = 2;
pub const HEAD: usize = 3;
/// Indices of the upper arms, left and right. The forearm is the next joint.
pub const ARMS: [usize; 2] = [4, 6];
/// Indices of the thighs, left and right. Shin and foot are the next two joints.
pub const LEGS: [usize; 2] = [8, 11];

/// All joints. Parents precede their children.
pub const JOINTS: [Joint; 14] = [
    joint("pelvis", None, [0.0, 0.9, 0.0]),
    joint("spine", Some(PELVIS), [0.0, 1.02, 0.0]),
    joint("chest", Some(SPINE), [0.0, 1.2, 0.0]),
    joint("head", Some(CHEST), [0.0, 1.47, 0.0]),
    joint("left upper arm", Some(CHEST), [0.205, 1.38, 0.0]),
    joint("left forearm", Some(4), [0.205, 1.1, 0.0]),
    joint("right upper arm", Some(CHEST), [-0.205, 1.38, 0.0]),
    joint("right forearm", Some(6), [-0.205, 1.1, 0.0]),
    joint("left thigh", Some(PELVIS), [0.09, 0.88, 0.0]),
    joint("left shin", Some(8), [0.09, 0.47, 0.0]),
    joint("left foot", Some(9), [0.09, ANKLE, 0.0]),
    joint("right thigh", Some(PELVIS), [-0.09, 0.88, 0.0]),
    joint("right shin", Some(11), [-0.09, 0.47, 0.0]),
    joint("right foot", Some(12), [-0.09, ANKLE, 0.0]),
];

/// Height of the ankles above the soles.
pub const ANKLE: f64 = 0.08;

/// Half the height in metres of the region in which skin weights blend between two joints.
const BLEND: f32 = 0.05;

const SHIRT: [f32; 3] = [0.75, 0.3, 0.12];
const TROUSERS: [f32; 3] = [0.1, 0.16, 0.3];
const SKIN: [f32; 3] = [0.62, 0.42, 0.32];
const SHOES: [f32; 3] = [0.08, 0.07, 0.07];

/// Cross-sections of a tube as (height, half width, half depth).
type Rings = &'static [[f32; 3]];

const TORSO: Rings = &[
    [0.8, 0.0, 0.0],
    [0.81, 0.08, 0.06],
    [0.85, 0.14, 0.1],
    [0.92, 0.16, 0.11],
    [1.02, 0.14, 0.1],
    [1.12, 0.135, 0.1],
    [1.25, 0.165, 0.115],
    [1.36, 0.175, 0.105],
    [1.41, 0.13, 0.08],
    [1.44, 0.06, 0.055],
    [1.46, 0.0, 0.0],
];

const NECK_AND_HEAD: Rings = &[
    [1.4, 0.0, 0.0],
    [1.405, 0.045, 0.045],
    [1.47, 0.048, 0.05],
    [1.51, 0.055, 0.06],
    [1.54, 0.068, 0.08],
    [1.6, 0.078, 0.095],
    [1.67, 0.08, 0.1],
    [1.73, 0.066, 0.082],
    [1.765, 0.036, 0.045],
    [1.775, 0.0, 0.0],
];

const ARM: Rings = &[
    [0.73, 0.0, 0.0],
    [0.74, 0.018, 0.025],
    [0.79, 0.025, 0.042],
    [0.85, 0.025, 0.032],
    [0.9, 0.026, 0.028],
    [1.0, 0.034, 0.036],
    [1.06, 0.037, 0.039],
    [1.1, 0.038, 0.04],
    [1.14, 0.04, 0.042],
    [1.25, 0.046, 0.05],
    [1.36, 0.055, 0.06],
    [1.41, 0.042, 0.045],
    [1.43, 0.0, 0.0],
];

const LEG: Rings = &[
    [0.045, 0.0, 0.0],
    [0.05, 0.032, 0.036],
    [0.08, 0.04, 0.045],
    [0.13, 0.043, 0.047],
    [0.28, 0.052, 0.062],
    [0.38, 0.054, 0.058],
    [0.43, 0.055, 0.058],
    [0.47, 0.057, 0.06],
    [0.51, 0.059, 0.063],
    [0.6, 0.066, 0.072],
    [0.75, 0.08, 0.086],
    [0.88, 0.085, 0.09],
    [0.94, 0.07, 0.075],
    [0.97, 0.0, 0.0],
];

/// Cross-sections along z from heel to toe as (z, half width, half height), with the sole at y = 0.
const FOOT: Rings = &[
    [-0.065, 0.0, 0.0],
    [-0.06, 0.022, 0.022],
    [-0.04, 0.036, 0.042],
    [0.0, 0.04, 0.05],
    [0.06, 0.043, 0.042],
    [0.12, 0.046, 0.03],
    [0.17, 0.036, 0.022],
    [0.19, 0.016, 0.012],
    [0.195, 0.0, 0.0],
];

pub fn mesh(material: usize) -> Mesh {
    let mut mesh = Mesh { material, ..Mesh::default() };
    let mut part = |surface: Surface, color: [f32; 3], chain: &[(usize, f32)]| {
        let first = mesh.positions.len() as u32;
        let part = surface.into_mesh(material);
        mesh.influences.extend(part.positions.iter().map(|p| influence(chain, p.y)));
        mesh.colors.extend(part.positions.iter().map(|_| Vec3::from(color).extend(1.0)));
        mesh.positions.extend(part.positions);
        mesh.normals.extend(part.normals);
        mesh.triangles.extend(part.triangles.iter().map(|t| t.map(|i| i + first)));
    };
    part(tube(TORSO, 16, |_| 0.0), SHIRT, &[(PELVIS, 0.0), (SPINE, 1.0), (CHEST, 1.2)]);
    part(tube(NECK_AND_HEAD, 14, |_| 0.01), SKIN, &[(CHEST, 0.0), (HEAD, 1.47)]);
    for (side, (arm, leg)) in [1.0, -1.0].into_iter().zip(ARMS.into_iter().zip(LEGS)) {
        let (shin, foot) = (leg + 1, leg + 2);
        part(tube(ARM, 10, |_| 0.0).moved(side * 0.205, 0.0, 0.0), SKIN, &[(arm + 1, 0.0), (arm, 1.1)]);
        let chain = [(foot, 0.0), (shin, ANKLE as f32), (leg, 0.47), (PELVIS, 0.95)];
        part(tube(LEG, 12, |_| 0.0).moved(side * 0.09, 0.0, 0.0), TROUSERS, &chain);
        // The rotation maps the tube's axis to +z and its −z upwards.
        let shoe = tube(FOOT, 10, |half_height| -half_height).transformed(turn_x(FRAC_PI_2));
        part(shoe.moved(side * 0.09, 0.0, 0.0), SHOES, &[(foot, 0.0)]);
    }
    mesh
}

/// Returns a tube of elliptic cross-sections along +y, closed if the first and the last are points. `z_of` maps a
/// section's half depth to its centre's z.
fn tube(rings: &[[f32; 3]], sides: usize, z_of: impl Fn(f32) -> f32) -> Surface {
    let last = rings.len() - 1;
    Surface::grid(last, sides, |u, v| {
        let i = (u * last as f32).round() as usize;
        let [y, width, depth] = rings[i];
        let (sin, cos) = sin_cos(if v < 1.0 { v * TAU } else { 0.0 });
        let [below, above] = [rings[i.saturating_sub(1)], rings[(i + 1).min(last)]];
        let slope = (above[1] + above[2] - below[1] - below[2]) / (2.0 * (above[0] - below[0]));
        let normal = match i {
            0 => Vec3::NEG_Y,
            _ if i == last => Vec3::Y,
            _ => (Vec3::new(cos * depth, 0.0, sin * width).normalize() - Vec3::Y * slope).normalize(),
        };
        let position = Vec3::new(cos * width, y, z_of(depth) + sin * depth);
        Vertex { position, normal, uv: Vec2::new(v, u) }
    })
}

/// Returns the skin weights of a vertex at height `y`. `chain` lists a limb's joints from the lowest to the highest,
/// each with the height at which its influence replaces that of the joint before it.
fn influence(chain: &[(usize, f32)], y: f32) -> Influence {
    let at = chain.iter().rposition(|(_, from)| y >= from - BLEND).unwrap_or(0);
    let (joint, from) = chain[at];
    let (below, _) = chain[at.saturating_sub(1)];
    let share = if at == 0 { 1.0 } else { ((y - from + BLEND) / (2.0 * BLEND)).clamp(0.0, 1.0) };
    let share = share * share * (3.0 - 2.0 * share);
    let mut influence = Influence::default();
    influence.weights[..2].copy_from_slice(&[share, 1.0 - share]);
    let joints = [(joint, share), (below, 1.0 - share)].map(|(j, weight)| if weight > 0.0 { j as u16 } else { 0 });
    influence.joints[..2].copy_from_slice(&joints);
    influence
}
