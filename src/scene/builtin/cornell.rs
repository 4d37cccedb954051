//! The Cornell box: two coloured walls, two blocks and a lamp in the ceiling, all Lambertian.

use super::super::Scene;
use super::assembly::{Assembly, emitter, matte};
use super::geometry::Surface;
use super::maths::{shift, turn_y};
use super::shapes::block;
use glam::Vec3;

/// Half the room's width and depth, and half its height, metres.
const HALF: f32 = 1.0;

pub fn build() -> Scene {
    let mut a = Assembly::new("cornell");
    let white = a.material(matte("white", [0.725, 0.71, 0.68]));
    let red = a.material(matte("red", [0.63, 0.065, 0.05]));
    let green = a.material(matte("green", [0.14, 0.45, 0.091]));
    let lamp = a.material(emitter("lamp", [17.0, 12.0, 4.0]));

    let (x, y, z) = (Vec3::X * 2.0 * HALF, Vec3::Y * 2.0 * HALF, Vec3::Z * 2.0 * HALF);
    let corner = Vec3::new(-HALF, 0.0, -HALF);
    a.add(Surface::quad(corner + z, x, -z), white);
    a.add(Surface::quad(corner + y, x, z), white);
    a.add(Surface::quad(corner, x, y), white);
    a.add(Surface::quad(corner + z, -z, y), red);
    a.add(Surface::quad(corner + x, z, y), green);
    a.add(lamp_surface(), lamp);

    let tall = a.mesh(block([0.0; 3], [0.6, 1.2, 0.6]), white);
    let short = a.mesh(block([0.0; 3], [0.6, 0.6, 0.6]), white);
    a.place(tall, shift(-0.33, 0.0, -0.29) * turn_y(0.3));
    a.place(short, shift(0.33, 0.0, 0.37) * turn_y(-0.29));
    a.finish()
}

/// Returns a rectangle that faces down, slightly below the ceiling.
fn lamp_surface() -> Surface {
    let (width, depth) = (0.47, 0.38);
    let corner = Vec3::new(-width / 2.0, 2.0 * HALF - 0.005, -depth / 2.0);
    Surface::quad(corner, Vec3::X * width, Vec3::Z * depth)
}
