//! Hard edges at many depths: boards, bars, boxes and spheres from 0.5 m to 50 m in front of a chequered floor and
//! backdrop. This scene exposes errors at seams and in reprojection.

use super::super::Scene;
use super::assembly::{Assembly, emitter, glossy, matte, metal, textured};
use super::geometry::Surface;
use super::maths::{Dice, scale, shift, turn_x, turn_y, turn_z};
use super::shapes::{block, cuboid, cylinder, sphere, torus};
use super::texels::checker;
use glam::{Vec2, Vec3};

/// Indices of materials by use.
struct Paints {
    light: usize,
    dark: usize,
    /// Materials with a texture of 8 × 8 squares: `crisp` with nearest and `soft` with linear filtering.
    crisp: usize,
    soft: usize,
    colors: [usize; 4],
    panel: usize,
}

/// sRGB codes of albedo 0.8 and 0.1.
const LIGHT: u8 = 231;
const DARK: u8 = 89;

pub fn build() -> Scene {
    let mut a = Assembly::new("checker");
    let paints = mix_paints(&mut a);
    surroundings(&mut a, &paints);
    boards(&mut a, &paints);
    bars(&mut a, &paints);
    solids(&mut a, &paints);
    panels(&mut a, &paints);
    a.finish()
}

fn mix_paints(a: &mut Assembly) -> Paints {
    let crisp = a.texture(checker(64, 8, LIGHT, DARK), false);
    let soft = a.texture(checker(64, 8, LIGHT, DARK), true);
    Paints {
        light: a.material(matte("light", [0.8; 3])),
        dark: a.material(matte("dark", [0.1; 3])),
        crisp: a.material(textured("checker, nearest", crisp)),
        soft: a.material(textured("checker, linear", soft)),
        colors: [
            a.material(matte("red", [0.7, 0.12, 0.1])),
            a.material(glossy("blue", [0.1, 0.2, 0.65], 0.35)),
            a.material(matte("yellow", [0.75, 0.6, 0.1])),
            a.material(metal("steel", [0.6, 0.6, 0.62], 0.3)),
        ],
        panel: a.material(emitter("panel", [9.0, 8.6, 8.0])),
    }
}

/// Adds a floor of 1 m squares (an 8 m texture) and a backdrop of 2 m squares, 50 m away.
fn surroundings(a: &mut Assembly, paints: &Paints) {
    let floor = Surface::quad(Vec3::new(-32.0, 0.0, 4.0), Vec3::X * 64.0, Vec3::Z * -56.0);
    a.add(floor.uv_scaled(Vec2::splat(1.0 / 8.0)), paints.crisp);
    let backdrop = Surface::quad(Vec3::new(-32.0, -1.0, -50.0), Vec3::X * 64.0, Vec3::Y * 33.0);
    a.add(backdrop.uv_scaled(Vec2::splat(1.0 / 16.0)), paints.soft);
}

/// Adds upright boards: textured ones, and ones whose squares are geometry with holes between them.
fn boards(a: &mut Assembly, paints: &Paints) {
    let board = cuboid([-0.5, -0.5, -0.02], [0.5, 0.5, 0.02]);
    let plain = a.mesh(board.clone(), paints.crisp);
    let smooth = a.mesh(board, paints.soft);
    let (open_light, open_dark) = (a.mesh(squares(0), paints.light), a.mesh(squares(1), paints.dark));
    for (mesh, [x, y, z], turn, size) in [
        (plain, [-0.34, 1.42, -0.5], 0.5, 0.22),
        (smooth, [-1.6, 1.0, -3.0], 0.7, 1.0),
        (plain, [4.5, 2.2, -9.0], -0.5, 3.0),
        (smooth, [-9.0, 3.4, -18.0], 0.3, 5.0),
        (plain, [11.0, 5.2, -30.0], -0.2, 8.0),
    ] {
        a.place(mesh, shift(x, y, z) * turn_y(turn) * scale(size));
    }
    for ([x, y, z], turn, size) in
        [([0.42, 1.78, -0.9], -0.4, 0.4), ([1.3, 2.6, -5.0], 0.25, 1.8), ([-5.5, 2.4, -11.0], 0.2, 3.6)]
    {
        let place = shift(x, y, z) * turn_y(turn) * scale(size);
        a.place(open_light, place);
        a.place(open_dark, place);
    }
}

/// Returns the squares of one colour of an 8 × 8 checkerboard of unit size, as boxes with gaps between them. Squares
/// of parity 0 are offset to the front, those of parity 1 to the back.
fn squares(parity: usize) -> Surface {
    let (cell, half) = (1.0 / 8.0, 0.9 / 16.0);
    let depth = if parity == 0 { 0.05 } else { -0.05 };
    let pieces = (0..64).filter(|i| (i % 8 + i / 8) % 2 == parity).map(|i| {
        let x = (i % 8) as f32 * cell - 0.5 + cell / 2.0;
        let y = (i / 8) as f32 * cell - 0.5 + cell / 2.0;
        cuboid([x - half, y - half, depth - 0.01], [x + half, y + half, depth + 0.01])
    });
    Surface::union(pieces)
}

/// Adds fences of thin bars, upright, horizontal and slanted, down to less than a pixel's width.
fn bars(a: &mut Assembly, paints: &Paints) {
    let unit = a.mesh(block([0.0; 3], [0.01, 1.0, 0.01]), paints.dark);
    let pale = a.mesh(block([0.0; 3], [0.01, 1.0, 0.01]), paints.light);
    let round = a.mesh(cylinder(0.008, 1.0, 12), paints.colors[2]);
    for i in 0..24 {
        let t = i as f32;
        let mesh = if i % 2 == 0 { unit } else { pale };
        a.place(mesh, shift(0.55 + 0.05 * t, 0.0, -1.6 - 0.12 * t) * scale(1.3));
        a.place(round, shift(-3.6 + 0.13 * t, 0.0, -6.0) * turn_z(0.35) * scale(2.4));
        a.place(unit, shift(-8.0 + 0.7 * t, 0.0, -22.0) * scale(7.0));
        a.place(pale, shift(-14.0 + 1.2 * t, 0.0, -40.0) * scale(12.0));
    }
    for i in 0..10 {
        let rail = shift(2.2, 0.25 + 0.22 * i as f32, -4.2) * turn_z(std::f32::consts::FRAC_PI_2);
        a.place(if i % 2 == 0 { pale } else { unit }, rail * scale(2.0));
    }
}

/// Adds receding rows of boxes and spheres, each row at its own depth.
fn solids(a: &mut Assembly, paints: &Paints) {
    let boxes = paints.colors.map(|paint| a.mesh(block([0.0; 3], [1.0; 3]), paint));
    let checked_box = a.mesh(block([0.0; 3], [1.0; 3]), paints.crisp);
    let balls = paints.colors.map(|paint| a.mesh(sphere(0.5, 48, 24), paint));
    let checked_ball = a.mesh(sphere(0.5, 48, 24).uv_scaled(Vec2::new(4.0, 2.0)), paints.soft);
    let ring = a.mesh(torus(0.4, 0.1, 48, 20), paints.colors[0]);
    let mut dice = Dice::new(5);
    let mut depth = 1.1;
    for row in 0..16 {
        let size = 0.14 * depth;
        for side in [-1.0, 1.0] {
            let x = side * depth * dice.range(0.28, 0.62);
            let turn = turn_y(dice.angle());
            let pick = (dice.unit() * 4.0) as usize;
            let on_box = match row % 3 {
                0 => checked_box,
                _ => boxes[pick],
            };
            a.place(on_box, shift(x, 0.0, -depth) * turn * scale(size));
            let top = shift(x, size * 1.45, -depth) * scale(size * 0.9);
            match row % 4 {
                0 => a.place(balls[(pick + 1) % 4], top),
                1 => a.place(checked_ball, top * turn_x(0.4)),
                2 => a.place(ring, top * turn_x(1.2)),
                _ => {}
            }
        }
        depth *= 1.27;
    }
}

fn panels(a: &mut Assembly, paints: &Paints) {
    for (x, y, z, size) in [(-2.0, 6.0, -3.0, 3.0), (6.0, 14.0, -22.0, 8.0)] {
        let corner = Vec3::new(x - size / 2.0, y, z - size / 2.0);
        a.add(Surface::quad(corner, Vec3::X * size, Vec3::Z * size), paints.panel);
    }
}
