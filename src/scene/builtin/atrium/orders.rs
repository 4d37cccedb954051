//! Columns, piers, arches and balusters: the pieces that repeat in each bay.

use super::super::geometry::{Outline, Surface};
use super::super::maths::{sin, sin_cos};
use super::super::shapes::{arch, block, cuboid, lathe, ribbon, rise, spandrel};
use glam::{Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// Distance between columns, metres.
pub const BAY: f32 = 3.0;

/// Dimensions of a storey's arcade, metres.
#[derive(Clone, Copy)]
pub struct Order {
    /// Height from the floor to the springing of the arches.
    pub height: f32,
    pub shaft_radius: f32,
    pub arch_radius: f32,
    /// Height from the springing to the top of the wall above the arch.
    pub wall_rise: f32,
    pub flutes: usize,
    pub leafy: bool,
}

/// Half the thickness of the wall above the arches.
pub const WALL_HALF: f32 = 0.22;

/// Returns the fluted shaft between base and capital, swelling slightly towards its foot.
pub fn shaft(order: &Order) -> Surface {
    let r = order.shaft_radius;
    let (foot, neck) = (base_height(r), order.height - capital_height(r));
    let levels: Vec<_> = (0..=4)
        .map(|i| {
            let t = i as f32 / 4.0;
            [foot - 0.01 + (neck - foot + 0.02) * t, 1.0 - 0.14 * t * t]
        })
        .collect();
    rise(&fluted(r, order.flutes), &levels)
}

/// Returns a circle with scooped flutes and narrow fillets between them.
fn fluted(radius: f32, flutes: usize) -> Outline {
    let depth = radius * 0.085;
    let points = (0..flutes).flat_map(move |i| {
        let start = i as f32 / flutes as f32 * TAU;
        [0.0, 0.2, 0.47, 0.73].map(|t: f32| {
            let scoop = ((t - 0.2) / 0.8).max(0.0);
            let (s, c) = sin_cos(start + t / flutes as f32 * TAU);
            let r = radius - depth * sin(scoop * PI);
            [r * c, r * s]
        })
    });
    Outline::closed(points)
}

fn base_height(r: f32) -> f32 {
    r * 1.1
}

fn capital_height(r: f32) -> f32 {
    r * 1.9
}

/// Returns plinth, two tori with a scotia between them, capital and abacus.
pub fn base_and_capital(order: &Order) -> Surface {
    let r = order.shaft_radius;
    let plinth = block([0.0, -0.02, 0.0], [r * 2.8, r * 0.42 + 0.02, r * 2.8]);
    let attic = [
        [1.28, 0.4],
        [1.38, 0.47],
        [1.41, 0.56],
        [1.36, 0.66],
        [1.24, 0.7],
        [1.24, 0.73],
        [1.12, 0.79],
        [1.11, 0.86],
        [1.18, 0.91],
        [1.22, 0.97],
        [1.18, 1.04],
        [1.06, 1.07],
        [1.06, 1.1],
        [0.95, 1.12],
    ];
    let base = lathe(&profile(&attic, r, 0.0), 18);
    let top = order.height;
    let bell = [
        [0.8, 0.0],
        [0.92, 0.01],
        [0.95, 0.06],
        [0.92, 0.11],
        [0.84, 0.13],
        [0.84, 0.6],
        [0.88, 1.0],
        [0.98, 1.3],
        [1.12, 1.45],
        [1.14, 1.5],
        [1.1, 1.54],
        [0.6, 1.56],
    ];
    let bell = lathe(&profile(&bell, r, top - capital_height(r)), 18);
    let mut capital = plinth.with(base).with(bell).with(abacus(r, top));
    if order.leafy {
        capital.append(&leaves(r, top - capital_height(r)));
    }
    capital
}

fn profile(points: &[[f32; 2]], unit: f32, lift: f32) -> Outline {
    Outline::open(points.iter().map(|p| [p[0] * unit, p[1] * unit + lift]))
}

/// Returns the slab under the arches in two steps. It extends slightly into the wall above.
fn abacus(r: f32, top: f32) -> Surface {
    let lower = block([0.0, top - r * 0.36, 0.0], [r * 2.44, r * 0.2, r * 2.44]);
    lower.with(block([0.0, top - r * 0.18, 0.0], [r * 2.66, r * 0.18 + 0.012, r * 2.66]))
}

/// Returns two rings of curling leaves round the bell of a capital.
fn leaves(r: f32, foot: f32) -> Surface {
    let leaf = |height: f32, turn: f32| {
        let (s, c) = sin_cos(turn);
        let out = Vec3::new(c, 0.0, s);
        let at = |reach: f32, y: f32| out * (r * reach) + Vec3::Y * (foot + r * y);
        let path = [
            (at(0.86, 0.1), r * 0.2),
            (at(0.9, 0.1 + 0.5 * height), r * 0.25),
            (at(0.98, 0.1 + 0.88 * height), r * 0.2),
            (at(1.12, 0.1 + height), r * 0.13),
            (at(1.2, 0.02 + 0.9 * height), r * 0.05),
        ];
        ribbon(&path, 0.3, 5, out)
    };
    let ring = |height: f32, offset: f32| (0..8).map(move |i| leaf(height, (i as f32 + offset) / 8.0 * TAU));
    Surface::union(ring(0.7, 0.0).chain(ring(1.25, 0.5)))
}

/// Returns the plastered wall over one bay's arch, with y = 0 at the springing.
pub fn arch_wall(order: &Order) -> Surface {
    spandrel(BAY, order.wall_rise, order.arch_radius, 2.0 * WALL_HALF, 24)
}

/// Returns the moulded stone ring round the opening, on both faces of the wall, with its keystone.
pub fn archivolt(order: &Order, steps: usize) -> Surface {
    let r = order.arch_radius;
    let half = [
        [-0.02, -0.17],
        [-0.01, -0.225],
        [0.02, -0.25],
        [0.06, -0.23],
        [0.13, -0.235],
        [0.16, -0.27],
        [0.22, -0.29],
        [0.25, -0.27],
        [0.25, -0.15],
    ];
    let front = half.iter().map(|p| [r + p[0], p[1]]);
    let back = half.iter().rev().map(|p| [r + p[0], -p[1]]);
    let ring = arch(&Outline::closed(front.chain(back)), steps);
    ring.with(cuboid([-0.11, r - 0.06, -0.33], [0.11, r + 0.29, 0.33]))
}

/// Returns a square corner pier with plinth and impost.
pub fn pier(order: &Order) -> Surface {
    let half = 0.42;
    let body = cuboid([-half, -0.02, -half], [half, order.height + order.wall_rise - 0.06, half]);
    let ring = |y: f32, height: f32, out: f32| block([0.0, y, 0.0], [2.0 * (half + out), height, 2.0 * (half + out)]);
    Surface::union([
        body,
        ring(-0.015, 0.24, 0.07),
        ring(0.22, 0.06, 0.035),
        ring(order.height - 0.3, 0.05, 0.02),
        ring(order.height - 0.16, 0.08, 0.045),
        ring(order.height - 0.09, 0.1, 0.08),
    ])
}

/// Height of a baluster, metres.
pub const BALUSTER: f32 = 0.58;

pub fn baluster() -> Surface {
    let points = [
        [0.045, 0.0],
        [0.066, 0.03],
        [0.06, 0.06],
        [0.036, 0.085],
        [0.074, 0.19],
        [0.066, 0.265],
        [0.031, 0.44],
        [0.036, 0.475],
        [0.055, 0.5],
        [0.055, 0.535],
        [0.042, 0.58],
    ];
    lathe(&Outline::open(points), 8)
}

/// Returns the plinth and the handrail of a balustrade that runs along x and stands at y = 0. Its balusters start at
/// y = 0.1.
pub fn rails(length: f32) -> Surface {
    let half = length / 2.0;
    let top = 0.1 + BALUSTER;
    let lower = cuboid([-half, -0.02, -0.1], [half, 0.11, 0.1]);
    let rail = cuboid([-half, top - 0.01, -0.085], [half, top + 0.05, 0.085]);
    let cap = cuboid([-half, top + 0.045, -0.12], [half, top + 0.13, 0.12]);
    lower.with(rail).with(cap)
}

/// Returns evenly spaced positions of balusters along a balustrade of that length, centred on 0.
pub fn baluster_offsets(length: f32) -> impl Iterator<Item = f32> {
    let count = (length / 0.27) as usize;
    (0..count).map(move |i| (i as f32 + 0.5) / count as f32 * length - length / 2.0)
}

/// Returns an urn with a foot and a rolled lip, about 0.9 high. `stretch` scales its radius and its height.
pub fn urn(stretch: Vec2) -> Surface {
    let points = [
        [0.0, 0.0],
        [0.2, 0.0],
        [0.2, 0.06],
        [0.12, 0.1],
        [0.08, 0.17],
        [0.13, 0.22],
        [0.26, 0.34],
        [0.33, 0.5],
        [0.32, 0.64],
        [0.25, 0.74],
        [0.23, 0.79],
        [0.27, 0.85],
        [0.32, 0.88],
        [0.31, 0.9],
        [0.14, 0.86],
        [0.2, 0.8],
        [0.0, 0.78],
    ];
    lathe(&Outline::open(points.map(|p| [p[0] * stretch.x, p[1] * stretch.y])), 14)
}
