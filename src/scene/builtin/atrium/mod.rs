//! The demo scene: a court of three by nine bays between two storeys of vaulted and beamed galleries.
//!
//! x points across the court, −z along it away from the camera. Bays form a ring. Each has a frame with its origin on
//! the column line at ground level, x along the wall and +z into the court.

mod furnishing;
mod hall;
mod orders;

use super::super::Scene;
use super::assembly::{Assembly, glossy, matte, metal, sheet, textured};
use super::maths::{quarter_turn_y, shift};
use super::texels::marble_tiles;
use glam::Affine3A;
use orders::{BAY, Order};

/// Number of bays across and along the court.
const BAYS: [usize; 2] = [3, 9];
/// Half the distance between opposite column lines, across and along the court, metres.
const COURT: [f32; 2] = [BAY * 1.5, BAY * 4.5];
/// Distance from the column line to the back wall's face.
const GALLERY: f32 = 3.4;
/// Heights of the court, of the upper floor and of the roof's underside relative to the lower gallery's floor.
const COURT_Y: f32 = -0.3;
const UPPER_Y: f32 = 5.5;
const ROOF_Y: f32 = 9.85;

const LOWER: Order =
    Order { height: 3.6, shaft_radius: 0.26, arch_radius: 1.2, wall_rise: 1.55, flutes: 20, leafy: true };
const UPPER: Order =
    Order { height: 2.75, shaft_radius: 0.2, arch_radius: 1.25, wall_rise: 1.65, flutes: 16, leafy: false };

struct Paints {
    stone: usize,
    trim: usize,
    wall: usize,
    vault: usize,
    dark_stone: usize,
    tiles: usize,
    wood: usize,
    bronze: usize,
    gilt: usize,
    terracotta: usize,
    leaf: usize,
    water: usize,
    cloth: [usize; 3],
}

pub fn build() -> Scene {
    let mut a = Assembly::new("atrium");
    let paints = mix_paints(&mut a);
    let bays = bays();
    hall::floors(&mut a, &paints);
    hall::walls_and_roof(&mut a, &paints);
    hall::arcade(&mut a, &paints, &bays, 0.0, &LOWER);
    hall::arcade(&mut a, &paints, &bays, UPPER_Y, &UPPER);
    hall::vaults(&mut a, &paints, &bays);
    hall::beams(&mut a, &paints, &bays);
    hall::cornices(&mut a, &paints, &bays);
    hall::balustrades(&mut a, &paints, &bays);
    hall::terrace(&mut a, &paints);
    furnish(&mut a, &paints, &bays);
    a.finish()
}

fn mix_paints(a: &mut Assembly) -> Paints {
    let tiles = a.texture(marble_tiles(256), true);
    let mut cloth = |name: &str, color| a.material(sheet(matte(name, color)));
    Paints {
        cloth: [
            cloth("red cloth", [0.58, 0.07, 0.06]),
            cloth("green cloth", [0.1, 0.36, 0.13]),
            cloth("blue cloth", [0.08, 0.17, 0.5]),
        ],
        stone: a.material(matte("limestone", [0.68, 0.6, 0.48])),
        trim: a.material(matte("pale stone", [0.74, 0.69, 0.6])),
        wall: a.material(matte("ochre plaster", [0.66, 0.5, 0.33])),
        vault: a.material(matte("white plaster", [0.76, 0.72, 0.64])),
        dark_stone: a.material(glossy("basalt", [0.26, 0.24, 0.22], 0.5)),
        tiles: a.material(super::super::Material { roughness: 0.45, ..textured("tiles", tiles) }),
        wood: a.material(glossy("oak", [0.3, 0.17, 0.09], 0.6)),
        bronze: a.material(metal("bronze", [0.5, 0.36, 0.2], 0.45)),
        gilt: a.material(metal("gilt", [0.8, 0.6, 0.25], 0.3)),
        terracotta: a.material(matte("terracotta", [0.55, 0.25, 0.14])),
        leaf: a.material(glossy("agave", [0.16, 0.3, 0.1], 0.6)),
        water: a.material(glossy("water", [0.05, 0.12, 0.13], 0.08)),
    }
}

/// Returns the frames of all bays in order round the court. The first bay of each side has a corner at its left.
fn bays() -> Vec<Affine3A> {
    let mut bays = Vec::new();
    for quarter in 0..4 {
        let (count, reach) = match quarter % 2 {
            0 => (BAYS[0], COURT[1]),
            _ => (BAYS[1], COURT[0]),
        };
        for i in 0..count {
            let x = (i as f32 + 0.5 - count as f32 / 2.0) * BAY;
            bays.push(quarter_turn_y(quarter) * shift(x, 0.0, -reach));
        }
    }
    bays
}

/// Returns true if bay `i` is the first of its side.
fn is_first_of_side(i: usize) -> bool {
    let (short, long) = (BAYS[0], BAYS[1]);
    [0, short, short + long, 2 * short + long].contains(&i)
}

fn furnish(a: &mut Assembly, paints: &Paints, bays: &[Affine3A]) {
    banners(a, paints, bays);
    let (doorway, door) = (a.mesh(furnishing::doorway(), paints.trim), a.mesh(furnishing::door(), paints.wood));
    let urn = a.mesh(orders::urn(glam::Vec2::ONE), paints.terracotta);
    let plant = a.mesh(furnishing::plant(), paints.leaf);
    for (i, &bay) in bays.iter().enumerate() {
        let back = bay * shift(0.0, 0.0, -GALLERY);
        if i % 2 == 0 {
            for place in [back, back * shift(0.0, UPPER_Y, 0.0)] {
                a.place(doorway, place);
                a.place(door, place * shift(0.0, 0.0, 0.05));
            }
        }
        if i % 3 == 1 {
            let spot = bay * shift(0.95, COURT_Y, 1.35);
            a.place(urn, spot);
            a.place(plant, spot * shift(0.0, 0.76, 0.0));
        }
    }
    let fountain = shift(0.0, COURT_Y - 0.01, -3.0);
    let stone = a.mesh(furnishing::fountain(), paints.trim);
    a.place(stone, fountain);
    for (radius, y) in [(1.345, 0.4), (0.7, 1.44)] {
        let water = a.mesh(furnishing::water(radius, y), paints.water);
        a.place(water, fountain);
    }
    let lantern = a.mesh(furnishing::lantern(2.1), paints.bronze);
    a.place(lantern, shift(-6.31, 2.9, 3.0));
}

/// Adds long banners in three colours in front of every other upper balustrade of the long sides.
fn banners(a: &mut Assembly, paints: &Paints, bays: &[Affine3A]) {
    let cloths: Vec<_> = (0..3).map(|i| a.mesh(furnishing::banner(40 + i as u32), paints.cloth[i])).collect();
    let rod = a.mesh(furnishing::banner_rod(0.7), paints.gilt);
    let (west, east) = (BAYS[0], 2 * BAYS[0] + BAYS[1]);
    for (side, first) in [west, east].into_iter().enumerate() {
        for k in (1..BAYS[1]).step_by(2) {
            let hook = bays[first + k] * shift(0.0, UPPER_Y + 0.74, 0.72);
            a.place(cloths[(k / 2 + side) % 3], hook);
            a.place(rod, hook);
        }
    }
}
