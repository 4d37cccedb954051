//! A wood at night round a winding path: many instances, cut-out leaves and many small lights.
//!
//! The camera walks the path towards −z. The lights are part of the shot, whose text `lanterns` writes.

#[cfg(test)]
mod lanterns;
mod plants;
mod species;
mod terrain;

use super::super::{Material, Scene, TextureRef};
use super::assembly::{Assembly, cut_out, glossy, matte, sheet, textured};
use super::maths::{Dice, scale, shift, turn_x, turn_y};
use super::texels;
use glam::{Affine3A, Vec2, Vec3};
use species::SPECIES;

const TREES: usize = 98;
const BUSHES: usize = 64;
const TUFTS: usize = 118;

/// Placement of a plant.
#[derive(Clone, Copy)]
struct Spot {
    foot: Vec3,
    turn: f32,
    size: f32,
    /// Index of the plant's variant: a tree species, or the mesh of a bush or tuft.
    kind: usize,
}

impl Spot {
    fn world_from_local(self) -> Affine3A {
        Affine3A::from_translation(self.foot) * turn_y(self.turn) * scale(self.size)
    }
}

pub fn build() -> Scene {
    let mut a = Assembly::new("forest");
    let soil = a.texture(texels::forest_floor(128), true);
    let soil = a.material(textured("forest floor", soil));
    a.add(terrain::ground(), soil);
    let broad = a.texture(texels::leaf_spray(256), true);
    trees(&mut a, broad);
    undergrowth(&mut a, broad);
    stones(&mut a);
    a.finish()
}

fn trees(a: &mut Assembly, broad: TextureRef) {
    let needles = a.texture(texels::needle_spray(128), true);
    let meshes = SPECIES.map(|s| {
        let bark = a.material(matte(&format!("{} bark", s.name), s.bark));
        let spray = textured(&format!("{} leaves", s.name), if s.needles { needles } else { broad });
        let leaf = a.material(cut_out(Material { base_color: Vec3::from(s.leaf).extend(1.0), ..spray }));
        let (wood, leaves) = plants::tree(&s);
        [a.mesh(wood, bark), a.mesh(leaves, leaf)]
    });
    for spot in tree_spots() {
        let place = spot.world_from_local();
        meshes[spot.kind].iter().for_each(|&mesh| a.place(mesh, place));
    }
}

/// Returns the placements of trees: one jittered position per cell of a grid, except on the path.
fn tree_spots() -> Vec<Spot> {
    let mut dice = Dice::new(2024);
    let cell = 5.6;
    let cells = (0..13).flat_map(|row| (0..11).map(move |column| (column, row)));
    let spots = cells.filter_map(|(column, row)| {
        let x = (column as f32 - 5.0 + dice.range(-0.42, 0.42)) * cell;
        let z = 20.0 - (row as f32 + dice.range(-0.42, 0.42)) * cell;
        let spot = Spot {
            foot: Vec3::new(x, terrain::height(x, z) - 0.06, z),
            turn: dice.angle(),
            size: dice.range(0.8, 1.25),
            kind: (dice.unit() * SPECIES.len() as f32) as usize,
        };
        (terrain::off_path(x, z) > 1.9).then_some(spot)
    });
    spots.take(TREES).collect()
}

/// Adds bushes among the trees and tufts of grass along the path.
fn undergrowth(a: &mut Assembly, broad: TextureRef) {
    let spray = textured("bush", broad);
    let bush_leaf = a.material(cut_out(Material { base_color: Vec3::new(0.55, 0.7, 0.4).extend(1.0), ..spray }));
    let grass = a.material(sheet(matte("grass", [0.2, 0.3, 0.08])));
    let bushes = [11, 12, 13].map(|seed| a.mesh(plants::bush(seed), bush_leaf));
    let tufts = [21, 22, 23].map(|seed| a.mesh(plants::tuft(seed), grass));
    for spot in spots_near_path(BUSHES, 71, [1.5, 14.0]) {
        a.place(bushes[spot.kind], spot.world_from_local());
    }
    for spot in spots_near_path(TUFTS, 72, [0.75, 7.5]) {
        a.place(tufts[spot.kind], spot.world_from_local());
    }
}

/// Returns `count` placements between `near` and `far` metres from the path's centre line in x, denser near the path.
fn spots_near_path(count: usize, seed: u32, [near, far]: [f32; 2]) -> Vec<Spot> {
    let mut dice = Dice::new(seed);
    (0..count)
        .map(|i| {
            // The far end is seen at a grazing angle, so it needs fewer plants.
            let along = (i as f32 + dice.unit()) / count as f32;
            let z = 17.5 - 50.0 * along * (0.45 + 0.55 * along);
            let reach = dice.unit();
            let side = if dice.unit() < 0.5 { -1.0 } else { 1.0 };
            let x = terrain::path_x(z) + side * (near + (far - near) * reach * reach);
            Spot {
                foot: Vec3::new(x, terrain::height(x, z) - 0.03, z),
                turn: dice.angle(),
                size: dice.range(0.75, 1.3),
                kind: (dice.unit() * 3.0) as usize,
            }
        })
        .collect()
}

/// Adds boulders beside the path.
fn stones(a: &mut Assembly) {
    let rock = a.material(glossy("rock", [0.3, 0.3, 0.28], 0.8));
    let boulders = [5, 6].map(|seed| a.mesh(plants::boulder(seed).uv_scaled(Vec2::splat(2.0)), rock));
    for (i, spot) in spots_near_path(12, 73, [1.0, 6.0]).into_iter().enumerate() {
        let tilt = turn_x(spot.turn * 0.1) * shift(0.0, -0.08, 0.0);
        a.place(boulders[i % 2], spot.world_from_local() * tilt);
    }
}
