//! Furnishings of the court: banners, plants, lantern, fountain, doors.

use super::super::geometry::{Outline, Surface};
use super::super::maths::{Dice, cos, shift, sin, sin_cos, turn_z};
use super::super::shapes::{arch, block, cuboid, cylinder, lathe, limb, ribbon, sphere, torus};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, TAU};

/// Returns a banner hung from its upper edge at the origin, 1.3 × 3 metres, with folds that deepen downwards.
pub fn banner(seed: u32) -> Surface {
    let mut dice = Dice::new(seed);
    let (phase, drift) = (dice.angle(), dice.range(-0.12, 0.12));
    let (width, height) = (1.3, 3.0);
    Surface::smooth_grid(28, 30, |u, v| {
        // v points up the cloth, so that the front is towards +z.
        let drop = 1.0 - v;
        let across = u - 0.5;
        let fold = sin(phase + (3.2 * across + 0.25 * drop) * TAU);
        let ripple = sin(2.0 * phase + (7.0 * across - 0.6 * drop) * TAU);
        let depth = (0.035 + 0.085 * drop) * fold + 0.014 * drop * ripple;
        let gather = 1.0 - 0.1 * drop + 0.03 * sin(phase + 4.0 * drop);
        let point = 0.32 * (0.5 - across.abs()) * drop;
        Vec3::new(across * width * gather + drift * drop * drop, -height * drop - point, depth + 0.1 * drop * drop)
    })
}

/// Returns a banner's rod with knobs, and two brackets that extend from the rod by `reach` metres towards −z, to the
/// wall.
pub fn banner_rod(reach: f32) -> Surface {
    let rod = cylinder(0.022, 1.6, 10).transformed(turn_z(FRAC_PI_2)).moved(0.8, 0.03, 0.0);
    let knob = |x: f32| sphere(0.05, 12, 8).moved(x, 0.03, 0.0);
    let bracket = |x: f32| cuboid([x - 0.02, 0.0, -reach], [x + 0.02, 0.055, 0.02]);
    Surface::union([rod, knob(-0.8), knob(0.8), bracket(-0.72), bracket(0.72)])
}

/// Returns an agave with long bent leaves.
pub fn plant() -> Surface {
    let mut dice = Dice::new(31);
    Surface::union((0..24).map(|i| {
        let (s, c) = sin_cos(i as f32 * 2.4 + dice.range(-0.2, 0.2));
        let out = Vec3::new(c, 0.0, s);
        let (length, lift) = (dice.range(0.5, 0.85), dice.range(0.4, 1.25));
        let width = dice.range(0.04, 0.06);
        let path: Vec<_> = (0..=5)
            .map(|k| {
                let t = k as f32 / 5.0;
                let reach = length * (0.06 + t * (1.0 - 0.35 * lift));
                let y = length * (lift * t - 0.75 * t * t * (1.2 - 0.6 * lift));
                (out * reach + Vec3::Y * y, width * (0.45 + 1.6 * t) * (1.02 - t))
            })
            .collect();
        ribbon(&path, 0.22, 6, Vec3::Y * 0.9 + out * 0.3)
    }))
}

/// Returns the cage of a hanging lantern, and a chain up to y = `chain`. The lantern's light belongs at the origin, in
/// the middle of the cage.
pub fn lantern(chain: f32) -> Surface {
    let ring = |y: f32, r: f32| torus(r, 0.014, 20, 8).moved(0.0, y, 0.0);
    let mut s = ring(-0.24, 0.1).with(ring(0.2, 0.17)).with(ring(0.0, 0.17));
    for i in 0..6 {
        let (sin, cos) = sin_cos(i as f32 / 6.0 * TAU);
        let out = Vec3::new(cos, 0.0, sin);
        let path = [
            (out * 0.1 - Vec3::Y * 0.24, 0.01),
            (out * 0.17, 0.01),
            (out * 0.17 + Vec3::Y * 0.2, 0.01),
            (out * 0.03 + Vec3::Y * 0.36, 0.01),
        ];
        s.append(&limb(&path, 6));
    }
    let cap = Outline::open([[0.0, 0.3], [0.06, 0.3], [0.05, 0.36], [0.02, 0.4], [0.0, 0.4]]);
    s.with(lathe(&cap, 16)).with(cylinder(0.008, chain - 0.38, 8).moved(0.0, 0.38, 0.0))
}

/// Returns the fountain's stone: an eight-sided basin and a pedestal with a bowl.
pub fn fountain() -> Surface {
    let basin = Outline::open([
        [1.62, 0.0],
        [1.62, 0.12],
        [1.52, 0.16],
        [1.52, 0.42],
        [1.6, 0.46],
        [1.62, 0.54],
        [1.36, 0.54],
        [1.34, 0.46],
        [1.34, 0.02],
    ]);
    let stem = Outline::open([
        [0.36, 0.0],
        [0.36, 0.3],
        [0.24, 0.4],
        [0.16, 0.55],
        [0.14, 0.75],
        [0.19, 0.95],
        [0.14, 1.08],
        [0.2, 1.13],
        [0.45, 1.2],
        [0.68, 1.31],
        [0.8, 1.44],
        [0.78, 1.48],
        [0.72, 1.46],
        [0.5, 1.36],
        [0.12, 1.32],
        [0.09, 1.45],
        [0.12, 1.6],
        [0.07, 1.68],
        [0.0, 1.7],
    ]);
    Surface::union([lathe(&basin, 8), lathe(&stem, 36), sphere(0.16, 28, 16).moved(0.0, 1.82, 0.0)])
}

pub fn water(radius: f32, y: f32) -> Surface {
    Surface::grid(24, 1, |u, v| {
        let (s, c) = sin_cos(if u < 1.0 { u * TAU } else { 0.0 });
        let position = Vec3::new(c * radius * (1.0 - v), y, -s * radius * (1.0 - v));
        super::super::geometry::Vertex { position, normal: Vec3::Y, uv: glam::Vec2::new(c, s) }
    })
}

/// Returns a stone doorway flat against a wall at z = 0, with its foot on y = 0: jambs, sill and arch.
pub fn doorway() -> Surface {
    let ring = Outline::closed([
        [0.6, 0.05],
        [0.6, -0.1],
        [0.64, -0.13],
        [0.7, -0.13],
        [0.72, -0.1],
        [0.78, -0.12],
        [0.8, -0.09],
        [0.8, 0.05],
    ]);
    let jamb = |x: f32| block([x, -0.02, 0.03], [0.2, 2.03, 0.16]);
    let impost = |x: f32| block([x, 1.94, 0.04], [0.27, 0.1, 0.22]);
    let key = cuboid([-0.08, 2.55, -0.05], [0.08, 2.87, 0.17]);
    let sill = block([0.0, -0.03, 0.06], [1.7, 0.1, 0.3]);
    let ring = arch(&ring, 20).moved(0.0, 2.0, 0.0);
    Surface::union([jamb(-0.7), jamb(0.7), impost(-0.7), impost(0.7), key, sill, ring])
}

/// Returns the planked leaves of a door.
pub fn door() -> Surface {
    let planks = (0..6).map(|i| {
        let x = -0.6 + 0.2 * i as f32;
        let middle = x + 0.1;
        let top = 2.0 + (0.62 * 0.62 - middle * middle).max(0.0).sqrt();
        cuboid([x + 0.006, 0.02, -0.02], [x + 0.194, top, 0.035])
    });
    let band = |y: f32| cuboid([-0.58, y, -0.01], [0.58, y + 0.07, 0.048]);
    Surface::union(planks).with(band(0.4)).with(band(1.6))
}

/// Returns a stylised lion: a ball with a mane of small knobs, on a pedestal.
pub fn guardian() -> Surface {
    let pedestal = Surface::union([
        block([0.0, -0.02, 0.0], [0.56, 0.16, 0.56]),
        block([0.0, 0.13, 0.0], [0.44, 0.62, 0.44]),
        block([0.0, 0.74, 0.0], [0.54, 0.08, 0.54]),
    ]);
    let neck = Outline::open([[0.2, 0.81], [0.2, 0.85], [0.13, 0.89], [0.11, 0.94], [0.17, 0.98], [0.1, 1.02]]);
    let mane = (0..14).map(|i| {
        let t = i as f32 / 14.0 * TAU;
        sphere(0.075, 12, 8).moved(0.23 * cos(t), 1.2 + 0.23 * sin(t), -0.06)
    });
    let ball = sphere(0.25, 28, 18).transformed(shift(0.0, 1.2, 0.0));
    Surface::union(mane).with(pedestal).with(lathe(&neck, 24)).with(ball)
}
