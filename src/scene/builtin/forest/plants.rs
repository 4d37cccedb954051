//! Grows trees, bushes, grass and boulders.

use super::super::geometry::{Surface, Vertex};
use super::super::maths::{Dice, noise, sin_cos};
use super::super::shapes::{limb, sphere};
use super::species::Species;
use glam::{Vec2, Vec3};

/// Angle from one branch to the next, so that no branch is right above another.
const GOLDEN_ANGLE: f32 = 2.399_963;

/// Returns the two surfaces of a tree: its wood and its leaves.
pub fn tree(species: &Species) -> (Surface, Surface) {
    let mut dice = Dice::new(species.seed);
    let trunk = trunk_path(species, &mut dice);
    let mut branches: Vec<_> = (0..species.branches).map(|i| branch_path(species, &trunk, i, &mut dice)).collect();
    let wood = limb(&trunk, 8).with(Surface::union(branches.iter().map(|path| limb(path, 4))));
    // Leaves grow on the trunk's tip as on branches.
    branches.push(trunk[trunk.len() - 3..].to_vec());
    let mut leaves = Surface::default();
    for i in 0..species.cards {
        let path = &branches[i % branches.len()];
        // Prefers positions near the tip.
        let (a, b) = (dice.unit(), dice.unit());
        let at = point_on(path, 0.3 + 0.75 * a.max(b));
        let heart = point_on(&trunk, species.crown_foot + 0.5 * (1.0 - species.crown_foot));
        let outward = (at - heart).normalize() + Vec3::Y * 0.3;
        leaves.append(&card(at, outward, species.card_size, species.lift.min(0.3), &mut dice));
    }
    (wood, leaves)
}

type Path = Vec<(Vec3, f32)>;

/// Returns the centres and radii of a trunk, which is wider at the ground and sways slightly on its way up.
fn trunk_path(species: &Species, dice: &mut Dice) -> Path {
    let (lean_x, lean_z) = (dice.range(-0.3, 0.3), dice.range(-0.3, 0.3));
    (0..=7)
        .map(|i| {
            let t = i as f32 / 7.0;
            let sway = Vec3::new(dice.range(-0.09, 0.09), 0.0, dice.range(-0.09, 0.09)) * t * (1.0 - t) * 4.0;
            let centre = Vec3::new(lean_x * t * t, species.height * t * (0.35 + 0.65 * t) - 0.1, lean_z * t * t);
            let near_ground = (1.0 - t) * (1.0 - t) * (1.0 - t) * (1.0 - t);
            let flare = 1.0 + 0.55 * near_ground * near_ground;
            (centre + sway, species.trunk_radius * flare * (1.0 - 0.94 * t))
        })
        .collect()
}

fn branch_path(species: &Species, trunk: &Path, index: usize, dice: &mut Dice) -> Path {
    let up = (index as f32 + dice.unit()) / species.branches as f32;
    let t = species.crown_foot + (0.97 - species.crown_foot) * up;
    let root = point_on(trunk, t);
    let [low, middle, high] = species.reach;
    let reach = if up < 0.5 { low + (middle - low) * 2.0 * up } else { middle + (high - middle) * (2.0 * up - 1.0) };
    let reach = reach * dice.range(0.8, 1.15);
    let (s, c) = sin_cos(index as f32 * GOLDEN_ANGLE + dice.range(-0.4, 0.4));
    let out = Vec3::new(c, 0.0, s);
    let side = Vec3::new(-s, 0.0, c) * dice.range(-0.15, 0.15) * reach;
    let thick = species.trunk_radius * (0.42 - 0.25 * up);
    (0..=3)
        .map(|i| {
            let t = i as f32 / 3.0;
            let rise = reach * (species.lift * t - 0.18 * t * t);
            (root + out * (reach * t) + Vec3::Y * rise + side * t * t, thick * (1.0 - 0.88 * t))
        })
        .collect()
}

/// Returns the centre at parameter `t` of the path, interpolated between its points: 0 is the first point, 1 the last.
/// Values above 1 extrapolate.
fn point_on(path: &Path, t: f32) -> Vec3 {
    let place = t.max(0.0) * (path.len() - 1) as f32;
    let i = (place as usize).min(path.len() - 2);
    path[i].0 + (path[i + 1].0 - path[i].0) * (place - i as f32)
}

/// Returns a square for a texture of a leaf spray, with the spray's stem at `foot`. The square faces `outward`, with
/// jitter. `lift` sets the slope of the spray's direction of growth: positive upwards, negative downwards.
fn card(foot: Vec3, outward: Vec3, size: f32, lift: f32, dice: &mut Dice) -> Surface {
    let jitter = Vec3::new(dice.range(-1.0, 1.0), dice.range(-1.0, 1.0), dice.range(-1.0, 1.0));
    let normal = (outward.normalize() + 0.85 * jitter).normalize();
    let grow = Vec3::new(outward.x, lift, outward.z) + 0.5 * jitter.cross(outward);
    let right = grow.cross(normal).normalize() * size * dice.range(0.75, 1.2);
    let up = normal.cross(right);
    let mut s = Surface::quad(foot - right / 2.0 - up * 0.1, right, up);
    // Row 0 of a texture is its top row.
    s.vertices.iter_mut().for_each(|v| v.uv = Vec2::new(v.uv.x, right.length() - v.uv.y) / right.length());
    s
}

/// Returns a heap of leaf cards without visible wood.
pub fn bush(seed: u32) -> Surface {
    let mut dice = Dice::new(seed);
    Surface::union((0..90).map(|_| {
        let (s, c) = sin_cos(dice.angle());
        let (out, up) = (dice.unit() * 0.75, dice.unit());
        let foot = Vec3::new(c * out, 0.02 + 0.75 * up * (1.0 - 0.6 * out), s * out);
        let outward = Vec3::new(c, 0.4 + 0.6 * up, s);
        card(foot, outward, 0.5, 0.6, &mut dice)
    }))
}

/// Returns bent blades of grass over about two square metres.
pub fn tuft(seed: u32) -> Surface {
    let mut dice = Dice::new(seed);
    Surface::union((0..110).map(|_| {
        let (s, c) = sin_cos(dice.angle());
        let foot = Vec3::new(dice.range(-1.0, 1.0), 0.0, dice.range(-1.0, 1.0));
        let foot = foot * (0.35 + 0.5 * dice.unit());
        blade(foot, Vec3::new(c, 0.0, s), dice.range(0.14, 0.42))
    }))
}

/// Returns a grass blade of two segments that tapers to a point and bends towards `lean`.
fn blade(foot: Vec3, lean: Vec3, length: f32) -> Surface {
    let side = Vec3::Y.cross(lean) * 0.011;
    Surface::grid(1, 2, |u, v| {
        let centre = foot + Vec3::Y * (length * v * (1.15 - 0.35 * v)) + lean * (length * 0.55 * v * v);
        let width = if v < 1.0 { 1.0 - 0.4 * v } else { 0.0 };
        let normal = (Vec3::Y * (1.1 * v) + lean * -(1.15 - 0.7 * v)).normalize();
        Vertex { position: centre + side * width * (1.0 - 2.0 * u), normal, uv: Vec2::new(u, v) }
    })
}

/// Returns a lumpy, flattened ball, half sunk.
pub fn boulder(seed: u32) -> Surface {
    let mut s = sphere(1.0, 24, 14);
    let lump = |n: Vec3| {
        let bump = noise(n.x * 1.7 + 8.0, n.y * 1.7 + n.z * 2.1 + 8.0, 64, seed);
        n * Vec3::new(0.62, 0.4, 0.5) * (0.72 + 0.5 * bump)
    };
    for v in &mut s.vertices {
        let n = v.normal;
        let east = n.any_orthonormal_vector();
        let north = n.cross(east);
        let slope = |d: Vec3| lump((n + d * 0.02).normalize()) - lump((n - d * 0.02).normalize());
        v.position = lump(n);
        v.normal = slope(east).cross(slope(north)).normalize();
    }
    s
}
