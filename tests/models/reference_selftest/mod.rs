//! Compares the reference path tracer and its z-test with closed forms.
//!
//! If the estimator has no variance, the answer must be exact to f32 input. Otherwise it must lie within 4.5 standard
//! errors, which must be small.

mod energy;
mod glass;
mod lights;
mod materials;
mod rays;
mod scenes;
mod sky_and_camera;
mod surfaces;
mod textures;
mod ztest;

use diptych::scene::{Light, LightKind, Scene};
use glam::{Vec3, vec3};

use crate::reference::Reference;
use crate::reference::scenes::{add_quad, colored, empty};
use crate::reference::ztest::Estimate;

/// Adds a floor at y = 0 that faces up, 20 wide.
fn floor(scene: &mut Scene, albedo: Vec3) {
    add_quad(scene, (vec3(-10.0, 0.0, -10.0), 20.0 * Vec3::Z, 20.0 * Vec3::X), colored(albedo));
}

fn white_floor(name: &str) -> Scene {
    let mut scene = empty(name);
    floor(&mut scene, Vec3::ONE);
    scene
}

/// Returns the radiance that the point (x, 0, z) of the floor sends up and aside.
fn look_at_floor(scene: &Scene, x: f32, z: f32, spp: u32, bounces: u32) -> Estimate {
    let away = vec3(0.3, 0.4, -0.2);
    Reference::new(scene).probe(vec3(x, 0.0, z) + away, -away, spp, bounces, 1)
}

fn point(position: Vec3, radius: f32, strength: Vec3) -> Light {
    Light { kind: LightKind::Point { position, radius }, strength }
}
