//! Streets at night between towers, lit only by their 10,000 windows. This scene shows the cost and the benefit of
//! importance sampling many lights.

use super::super::Scene;
use super::assembly::{Assembly, emitter, matte};
use super::geometry::Surface;
use super::maths::{Dice, quarter_turn_y, shift};
use super::shapes::block;
use glam::Vec3;

/// Number of towers along each side of the district, distance between their centres in metres, and their width.
const SIDE: usize = 10;
const PITCH: f32 = 20.0;
const WIDTH: f32 = 9.0;

/// Columns and rows of lit windows on each of a tower's four faces.
const COLUMNS: usize = 5;
const ROWS: usize = 5;

/// RGB radiance of each kind of window: rooms seen through curtains, blinds or bare glass.
const ROOMS: [[f32; 3]; 4] = [[14.0, 9.0, 4.0], [9.0, 8.0, 6.0], [2.5, 3.5, 6.0], [30.0, 24.0, 16.0]];

pub fn build() -> Scene {
    let mut a = Assembly::new("towers");
    let asphalt = a.material(matte("asphalt", [0.12; 3]));
    let walls = [[0.5, 0.48, 0.45], [0.35, 0.22, 0.17], [0.6, 0.62, 0.65]].map(|c| a.material(matte("wall", c)));
    let pane = Surface::quad(Vec3::new(-0.45, 0.0, 0.0), Vec3::X * 0.9, Vec3::Y * 1.1);
    let windows = ROOMS.map(|radiance| {
        let glass = a.material(emitter("window", radiance));
        a.mesh(pane.clone(), glass)
    });
    let edge = PITCH * SIDE as f32;
    let corner = Vec3::new(-edge / 2.0, 0.0, edge / 2.0);
    a.add(Surface::quad(corner, Vec3::X * edge, Vec3::NEG_Z * edge), asphalt);
    let mut dice = Dice::new(10_000);
    for i in 0..SIDE * SIDE {
        let [x, z] = [i % SIDE, i / SIDE].map(|k| PITCH * (k as f32 - 0.5 * (SIDE - 1) as f32));
        let height = dice.range(14.0, 48.0);
        a.add(block([x, 0.0, z], [WIDTH, height, WIDTH]), walls[i % walls.len()]);
        // The storey height is random per tower.
        let storey = (height - 3.0) / ROWS as f32;
        for k in 0..4 * COLUMNS * ROWS {
            let (face, column, row) = (k / (COLUMNS * ROWS), k % COLUMNS, k / COLUMNS % ROWS);
            let along = (column as f32 - 0.5 * (COLUMNS - 1) as f32) * 1.6;
            let sill = 2.0 + row as f32 * storey + dice.range(0.0, storey - 1.2);
            let place = shift(x, 0.0, z) * quarter_turn_y(face as i32) * shift(along, sill, 0.5 * WIDTH + 0.01);
            let room = windows[(dice.unit() * ROOMS.len() as f32) as usize];
            a.place(room, place);
        }
    }
    a.finish()
}
