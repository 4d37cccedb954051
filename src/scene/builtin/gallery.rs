//! Everything that shows images of other things, in one room: a wall mirror, balls of chrome, glass, brushed metal and
//! lacquer, a window with a view, a basin of water and a polished floor.

use super::super::{Material, Scene, Volume};
use super::assembly::{Assembly, emitter, glossy, matte, metal, textured};
use super::geometry::Surface;
use super::maths::shift;
use super::shapes::{block, cuboid, sphere};
use super::texels::checker;
use glam::{Vec2, Vec3};

/// Half the room's width and depth, and its height, metres.
const HALF: f32 = 3.0;
const HEIGHT: f32 = 3.0;

pub fn build() -> Scene {
    let mut a = Assembly::new("gallery");
    room(&mut a);
    view(&mut a);
    exhibits(&mut a);
    basin(&mut a);
    a.finish()
}

/// Returns clear glass: a pane, or a solid if it has a volume.
fn glass(name: &str, volume: Option<Volume>, ior: f32) -> Material {
    Material { transmission: 1.0, volume, ior, ..glossy(name, [1.0; 3], 0.0) }
}

/// Returns a quad whose texture of 2 x 2 squares is 2 m wide.
fn tiled(corner: Vec3, u: Vec3, v: Vec3) -> Surface {
    Surface::quad(corner, u, v).uv_scaled(Vec2::splat(0.5))
}

/// Adds the walls, with a mirror on the left and a window at the back.
fn room(a: &mut Assembly) {
    let white = a.material(matte("plaster", [0.75, 0.74, 0.7]));
    let stripes = a.texture(checker(64, 2, 220, 120), true);
    let stripes = a.material(textured("chequered wall", stripes));
    let stone = a.texture(checker(64, 2, 150, 60), true);
    let stone = a.material(Material { roughness: 0.0, specular: 1.0, ..textured("polished stone", stone) });
    let mirror = a.material(metal("mirror", [0.95; 3], 0.0));
    let pane = a.material(glass("pane", None, 1.5));
    let lamp = a.material(emitter("lamp", [16.0, 15.0, 13.5]));

    let (x, y, z) = (Vec3::X * 2.0 * HALF, Vec3::Y * HEIGHT, Vec3::Z * 2.0 * HALF);
    let corner = Vec3::new(-HALF, 0.0, -HALF);
    a.add(tiled(corner + z, x, -z), stone);
    a.add(Surface::quad(corner + y, x, z), white);
    a.add(Surface::quad(corner + z, -z, y), white);
    a.add(tiled(corner + x, z, y), stripes);
    a.add(tiled(corner + x + z, -x, y), stripes);
    a.add(Surface::quad(Vec3::new(-HALF + 0.01, 0.3, 1.6), Vec3::Z * -3.4, Vec3::Y * 2.2), mirror);
    a.add(Surface::quad(Vec3::new(-0.8, HEIGHT - 0.01, -0.8), Vec3::X * 1.6, Vec3::Z * 1.6), lamp);
    // The window is 2.4 m wide and 1.4 m high.
    for (min, max) in [
        ([-HALF, 0.0], [-0.6, HEIGHT]),
        ([1.8, 0.0], [HALF, HEIGHT]),
        ([-0.6, 0.0], [1.8, 1.0]),
        ([-0.6, 2.4], [1.8, HEIGHT]),
    ] {
        a.add(cuboid([min[0], min[1], -HALF - 0.2], [max[0], max[1], -HALF]), white);
    }
    a.add(Surface::quad(Vec3::new(-0.6, 1.0, -HALF - 0.1), Vec3::X * 2.4, Vec3::Y * 1.4), pane);
}

/// Adds what the window shows: a lawn and coloured houses.
fn view(a: &mut Assembly) {
    let lawn = a.material(matte("lawn", [0.15, 0.35, 0.08]));
    a.add(Surface::quad(Vec3::new(-30.0, -0.5, -4.0), Vec3::X * 60.0, Vec3::Z * -60.0), lawn);
    for (x, z, height, color) in [
        (-4.0, -16.0, 4.5, [0.7, 0.25, 0.15]),
        (0.5, -12.0, 3.0, [0.75, 0.65, 0.3]),
        (4.0, -20.0, 6.0, [0.3, 0.35, 0.6]),
    ] {
        let paint = a.material(matte("house", color));
        a.add(block([x, -0.5, z], [3.0, height, 3.0]), paint);
    }
}

/// Adds four balls on plinths.
fn exhibits(a: &mut Assembly) {
    let clear = Volume { attenuation_color: Vec3::ONE, attenuation_distance: f32::INFINITY };
    let plinth = a.material(matte("plinth", [0.5, 0.48, 0.45]));
    let plinth = a.mesh(block([0.0; 3], [0.5, 0.5, 0.5]), plinth);
    for (x, z, material) in [
        (-1.9, -1.2, metal("chrome", [0.95, 0.93, 0.9], 0.0)),
        (-0.7, -0.6, glass("glass", Some(clear), 1.5)),
        (0.5, -0.9, metal("brushed brass", [0.9, 0.7, 0.35], 0.15)),
        (1.7, -1.4, glossy("lacquer", [0.6, 0.05, 0.05], 0.0)),
    ] {
        let material = a.material(material);
        let ball = a.mesh(sphere(0.4, 96, 48), material);
        a.place(ball, shift(x, 0.91, z));
        a.place(plinth, shift(x, 0.0, z));
    }
}

/// Adds a basin of water with tiles at its bottom.
fn basin(a: &mut Assembly) {
    let tiles = a.texture(checker(64, 8, 230, 110), true);
    let tiles = a.material(textured("tiles", tiles));
    let rim = a.material(matte("rim", [0.4, 0.42, 0.45]));
    let tint = Volume { attenuation_color: Vec3::new(0.7, 0.9, 0.95), attenuation_distance: 1.0 };
    let water = a.material(glass("water", Some(tint), 1.33));
    let ([x0, x1], [z0, z1]) = ([0.3, 2.3], [0.2, 1.4]);
    a.add(Surface::quad(Vec3::new(x0, 0.02, z1), Vec3::X * (x1 - x0), Vec3::Z * (z0 - z1)), tiles);
    for (min, max) in [
        ([x0 - 0.1, z0 - 0.1], [x1 + 0.1, z0]),
        ([x0 - 0.1, z1], [x1 + 0.1, z1 + 0.1]),
        ([x0 - 0.1, z0], [x0, z1]),
        ([x1, z0], [x1 + 0.1, z1]),
    ] {
        a.add(cuboid([min[0], 0.0, min[1]], [max[0], 0.4, max[1]]), rim);
    }
    // A gap keeps the water from touching the basin.
    a.add(cuboid([x0 + 0.002, 0.03, z0 + 0.002], [x1 - 0.002, 0.33, z1 - 0.002]), water);
}
