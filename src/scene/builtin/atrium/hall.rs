//! Builds the hall: floors, walls, arcades, vaults, cornices, balustrades and the terrace.

use super::super::assembly::Assembly;
use super::super::geometry::{Outline, Surface};
use super::super::maths::{quarter_turn_y, shift};
use super::super::shapes::{arch, block, cuboid, extrude, groin_vault, moulding};
use super::orders::{self, Order, WALL_HALF};
use super::{BAY, COURT, COURT_Y, GALLERY, Paints, ROOF_Y, UPPER_Y, is_first_of_side};
use glam::{Affine3A, Vec2, Vec3};

/// Distances in metres from the column line to the upper and the lower edge of the steps down into the court.
const STEP_REACH: [f32; 2] = [0.52, 0.88];

/// Returns a flat rectangle at height `y` that faces up. Its texture repeats every `tile_m` metres.
fn paving(min: [f32; 2], max: [f32; 2], y: f32, tile_m: f32) -> Surface {
    let (dx, dz) = (max[0] - min[0], max[1] - min[1]);
    Surface::quad(Vec3::new(min[0], y, max[1]), Vec3::X * dx, Vec3::NEG_Z * dz).uv_scaled(Vec2::splat(1.0 / tile_m))
}

/// Returns paving at height `y` that surrounds the court, from `inner` metres inside the column line to the back walls.
fn ring_paving(inner: f32, y: f32, tile_m: f32) -> Surface {
    let [x, z] = COURT.map(|half| half - inner);
    let [far_x, far_z] = COURT.map(|half| half + GALLERY + 0.1);
    Surface::union([
        paving([-far_x, -far_z], [-x, far_z], y, tile_m),
        paving([x, -far_z], [far_x, far_z], y, tile_m),
        paving([-x, -far_z], [x, -z], y, tile_m),
        paving([-x, z], [x, far_z], y, tile_m),
    ])
}

/// Returns a moulding all round the court. In `profile`, x points into the court, with 0 on the column line, and y up.
fn court_ring(profile: &Outline, y: f32) -> Surface {
    let [x, z] = COURT;
    let side = |start: Vec3, outward: Vec3, half: f32| moulding(profile, start, outward, 2.0 * half, [1.0, -1.0]);
    Surface::union([
        side(Vec3::new(-x, y, -z), Vec3::X, z),
        side(Vec3::new(x, y, z), Vec3::NEG_X, z),
        side(Vec3::new(x, y, -z), Vec3::Z, x),
        side(Vec3::new(-x, y, z), Vec3::NEG_Z, x),
    ])
}

pub fn floors(a: &mut Assembly, paints: &Paints) {
    let [near, far] = STEP_REACH;
    let [x, z] = COURT.map(|half| half - far + 0.01);
    a.add(paving([-x, -z], [x, z], COURT_Y, 1.2), paints.tiles);
    a.add(ring_paving(near, 0.0, 0.9), paints.tiles);
    let steps = Outline::open([[far, COURT_Y], [far, COURT_Y / 2.0], [near, COURT_Y / 2.0], [near, 0.0]]);
    a.add(court_ring(&steps, 0.0), paints.trim);
    a.add(ring_paving(-0.15, UPPER_Y, 0.9), paints.tiles);
}

/// Adds the shell: back walls with a dark dado, the ceiling over the upper gallery and the roof's edge.
pub fn walls_and_roof(a: &mut Assembly, paints: &Paints) {
    let [x, z] = COURT.map(|half| half + GALLERY);
    let shell = |low: f32, high: f32, inset: f32| {
        let (x, z, t) = (x - inset, z - inset, 0.4 + inset);
        Surface::union([
            cuboid([-x - t, low, -z - t], [-x, high, z + t]),
            cuboid([x, low, -z - t], [x + t, high, z + t]),
            cuboid([-x, low, -z - t + 0.01], [x, high, -z]),
            cuboid([-x, low, z], [x, high, z + t - 0.01]),
        ])
    };
    a.add(shell(-0.5, ROOF_Y + 0.2, 0.0), paints.wall);
    for floor in [0.0, UPPER_Y] {
        a.add(shell(floor - 0.03, floor + 0.9, 0.03), paints.dark_stone);
        a.add(shell(floor + 0.88, floor + 0.97, 0.06), paints.trim);
    }
    a.add(ceiling_ring(ROOF_Y, ROOF_Y + 0.25), paints.wood);
}

/// Returns a slab over the galleries, from height `low` to height `high`.
fn ceiling_ring(low: f32, high: f32) -> Surface {
    let [x, z] = COURT.map(|half| half - 0.1);
    let [far_x, far_z] = COURT.map(|half| half + GALLERY + 0.3);
    Surface::union([
        cuboid([-far_x, low, -far_z], [-x, high, far_z]),
        cuboid([x, low, -far_z], [far_x, high, far_z]),
        cuboid([-x, low, -far_z], [x, high, -z]),
        cuboid([-x, low, z], [x, high, far_z]),
    ])
}

/// Adds a storey's columns, corner piers and arches, and the wall above them.
pub fn arcade(a: &mut Assembly, paints: &Paints, bays: &[Affine3A], floor: f32, order: &Order) {
    let shaft = a.mesh(orders::shaft(order), paints.stone);
    let ends = a.mesh(orders::base_and_capital(order), paints.trim);
    let pier = a.mesh(orders::pier(order), paints.stone);
    let wall = a.mesh(orders::arch_wall(order), paints.wall);
    let ring = a.mesh(orders::archivolt(order, 18), paints.trim);
    for (i, &bay) in bays.iter().enumerate() {
        let post = bay * shift(-BAY / 2.0, floor, 0.0);
        if is_first_of_side(i) {
            a.place(pier, post);
        } else {
            a.place(shaft, post);
            a.place(ends, post);
        }
        let springing = bay * shift(0.0, floor + order.height, 0.0);
        a.place(wall, springing);
        a.place(ring, springing);
    }
}

/// Adds groin vaults, transverse ribs and wall pilasters of the lower gallery.
pub fn vaults(a: &mut Assembly, paints: &Paints, bays: &[Affine3A]) {
    let (depth, spring) = (GALLERY - WALL_HALF, super::LOWER.height);
    let middle = -(WALL_HALF + depth / 2.0);
    let web = a.mesh(groin_vault(BAY, depth, 1.45, 6), paints.vault);
    let corner_web = a.mesh(groin_vault(depth, depth, 1.45, 6), paints.vault);
    let rib = arch(&Outline::rectangle([1.38, -0.17], [1.66, 0.17]), 20);
    let rib = a.mesh(rib.transformed(quarter_turn_y(1)), paints.trim);
    let pilaster = a.mesh(pilaster(spring), paints.stone);
    for (i, &bay) in bays.iter().enumerate() {
        a.place(web, bay * shift(0.0, spring, middle));
        let left = bay * shift(-BAY / 2.0, 0.0, 0.0);
        let mut lines = vec![left];
        if is_first_of_side(i) {
            a.place(corner_web, left * shift(middle, spring, middle));
            let before = bays[(i + bays.len() - 1) % bays.len()];
            lines.push(before * shift(BAY / 2.0, 0.0, 0.0));
        }
        for line in lines {
            a.place(rib, line * shift(0.0, spring, middle));
            a.place(pilaster, line * shift(0.0, 0.0, -GALLERY));
        }
    }
}

/// Returns a flat pier against the back wall, with its foot at the origin.
fn pilaster(height: f32) -> Surface {
    Surface::union([
        block([0.0, -0.02, 0.1], [0.46, height, 0.32]),
        block([0.0, -0.01, 0.1], [0.56, 0.22, 0.42]),
        block([0.0, height - 0.22, 0.1], [0.54, 0.09, 0.4]),
        block([0.0, height - 0.14, 0.1], [0.62, 0.15, 0.48]),
    ])
}

/// Adds the timber of the upper gallery: beams across it and a plate along each wall.
pub fn beams(a: &mut Assembly, paints: &Paints, bays: &[Affine3A]) {
    let mut timber = Surface::default();
    for i in 0..4 {
        let x = (i as f32 - 1.5) * BAY / 4.0;
        timber.append(&cuboid([x - 0.08, ROOF_Y - 0.24, -GALLERY - 0.05], [x + 0.08, ROOF_Y + 0.02, -0.1]));
        timber.append(&cuboid([x - 0.1, ROOF_Y - 0.4, -GALLERY - 0.05], [x + 0.1, ROOF_Y - 0.23, -GALLERY + 0.3]));
    }
    timber.append(&cuboid([-BAY / 2.0, ROOF_Y - 0.12, -1.9], [BAY / 2.0, ROOF_Y + 0.01, -1.72]));
    let timber = a.mesh(timber, paints.wood);
    a.place_all(timber, bays);
}

/// Adds the two entablatures round the court, with dentils under them and ornaments on the upper one.
pub fn cornices(a: &mut Assembly, paints: &Paints, bays: &[Affine3A]) {
    let lower = Outline::open([
        [0.2, -0.1],
        [0.25, -0.1],
        [0.25, 0.0],
        [0.28, 0.02],
        [0.28, 0.14],
        [0.33, 0.19],
        [0.33, 0.33],
        [0.36, 0.34],
        [0.42, 0.36],
        [0.46, 0.41],
        [0.5, 0.43],
        [0.5, 0.5],
        [0.46, 0.53],
        [0.46, 0.6],
        [-0.26, 0.6],
        [-0.26, 0.45],
    ]);
    a.add(court_ring(&lower, UPPER_Y - 0.5), paints.trim);
    let upper = Outline::open([
        [0.2, -0.1],
        [0.26, -0.1],
        [0.26, 0.05],
        [0.3, 0.08],
        [0.3, 0.2],
        [0.36, 0.26],
        [0.36, 0.42],
        [0.42, 0.44],
        [0.55, 0.5],
        [0.62, 0.58],
        [0.66, 0.6],
        [0.66, 0.7],
        [0.6, 0.74],
        [0.6, 0.8],
        [0.3, 0.84],
        [0.3, 1.15],
        [0.34, 1.17],
        [0.34, 1.25],
        [-0.1, 1.27],
        [-0.1, 0.4],
    ]);
    a.add(court_ring(&upper, ROOF_Y - 0.3), paints.trim);
    let teeth = |reach: f32, low: f32, high: f32| {
        Surface::union((0..14).map(|i| {
            let x = (i as f32 + 0.5) / 14.0 * BAY - BAY / 2.0;
            cuboid([x - 0.055, low, reach - 0.06], [x + 0.055, high, reach + 0.045])
        }))
    };
    let teeth = teeth(0.33, UPPER_Y - 0.29, UPPER_Y - 0.18).with(teeth(0.36, ROOF_Y - 0.01, ROOF_Y + 0.1));
    let teeth = a.mesh(teeth, paints.trim);
    a.place_all(teeth, bays);
    let urn = a.mesh(orders::urn(Vec2::splat(0.8)), paints.terracotta);
    for &bay in bays {
        a.place(urn, bay * shift(-BAY / 2.0, ROOF_Y + 0.94, 0.12));
    }
}

pub fn balustrades(a: &mut Assembly, paints: &Paints, bays: &[Affine3A]) {
    let length = BAY - 0.3;
    let rails = a.mesh(orders::rails(length), paints.trim);
    let baluster = a.mesh(orders::baluster(), paints.trim);
    for &bay in bays {
        balustrade(a, [rails, baluster], length, bay * shift(0.0, UPPER_Y + 0.1, 0.0));
    }
    for side in [-1.0, 1.0] {
        let flank = shift(side * 2.88, TERRACE_Y, 11.2) * quarter_turn_y(1);
        balustrade(a, [rails, baluster], length, flank);
    }
    let length = 1.0;
    let rails = a.mesh(orders::rails(length), paints.trim);
    for side in [-1.0, 1.0] {
        balustrade(a, [rails, baluster], length, shift(side * 2.26, TERRACE_Y, 9.74));
    }
}

fn balustrade(a: &mut Assembly, [rails, baluster]: [usize; 2], length: f32, place: Affine3A) {
    a.place(rails, place);
    for x in orders::baluster_offsets(length) {
        a.place(baluster, place * shift(x, 0.1, 0.0));
    }
}

/// Height of the terrace on which the camera stands, and number of its stairs.
const TERRACE_Y: f32 = 1.9;
const STAIRS: usize = 13;

/// Adds a raised platform at the near end with stairs down into the court.
pub fn terrace(a: &mut Assembly, paints: &Paints) {
    a.add(cuboid([-3.0, COURT_Y - 0.1, 9.6], [3.0, TERRACE_Y - 0.06, 12.62]), paints.stone);
    a.add(cuboid([-3.06, TERRACE_Y - 0.14, 9.54], [3.06, TERRACE_Y, 12.6]), paints.trim);
    let rise = (TERRACE_Y - COURT_Y) / STAIRS as f32;
    let treads = (0..STAIRS).flat_map(|k| {
        let x = (STAIRS - 1 - k) as f32 * 0.3 + 0.08;
        [[x, COURT_Y + rise * k as f32], [x, COURT_Y + rise * (k + 1) as f32]]
    });
    let stairs = moulding(&Outline::open(treads), Vec3::new(-1.55, -0.004, 9.6), Vec3::NEG_Z, 3.1, [0.0; 2]);
    a.add(stairs, paints.trim);
    let run = 0.3 * STAIRS as f32;
    let cheek =
        Outline::closed([[-0.1, COURT_Y - 0.1], [run, COURT_Y - 0.1], [run, COURT_Y + 0.5], [-0.1, TERRACE_Y + 0.42]]);
    let cheek = a.mesh(extrude(&cheek, 0.3).transformed(quarter_turn_y(1)), paints.stone);
    let guardian = a.mesh(super::furnishing::guardian(), paints.trim);
    let post = a.mesh(block([0.0, -0.02, 0.0], [0.34, 0.9, 0.34]), paints.stone);
    let urn = a.mesh(orders::urn(Vec2::splat(0.55)), paints.terracotta);
    for side in [-1.0, 1.0] {
        a.place(cheek, shift(side * 1.7 - 0.15, 0.0, 9.55));
        a.place(guardian, shift(side * 1.7, COURT_Y, 9.55 - run - 0.2) * quarter_turn_y(2));
        for (x, z) in [(1.7, 9.76), (2.84, 9.76), (2.84, 12.45)] {
            a.place(post, shift(side * x, TERRACE_Y, z));
            a.place(urn, shift(side * x, TERRACE_Y + 0.875, z));
        }
    }
}
