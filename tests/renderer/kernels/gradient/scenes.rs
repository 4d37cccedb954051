//! Scenes whose light changes.

use diptych::accel::{Accel, Layout};
use diptych::scene::needs::SceneNeeds;
use diptych::scene::{Environment, Light as Lamp, LightKind, Material, Scene};
use glam::{DVec3, Vec3};

use super::twin::World;
use crate::common::{Subject, still_rig};
use crate::kernels::camera::STORAGE_SCALE;
use crate::reference::scenes::{add_material, add_matte, add_quad, colored, empty, matte, place, quad};

const SUN: DVec3 = DVec3::new(0.3, -0.5, -0.8);
const STRENGTH: DVec3 = DVec3::new(3.0, 2.5, 2.0);

/// Returns a folding screen in the sun behind a board. Its parts light one another.
pub fn screen() -> Scene {
    let mut scene = empty("folding screen");
    let [red, blue] = [Vec3::new(0.8, 0.3, 0.2), Vec3::new(0.1, 0.4, 0.9)].map(|c| add_matte(&mut scene, c));
    let up = Vec3::Y * 6.0;
    place(&mut scene, quad(Vec3::new(-4.0, -3.0, -2.4), Vec3::new(2.8, 0.0, -2.4), up, red));
    place(&mut scene, quad(Vec3::new(-1.2, -3.0, -4.8), Vec3::X * 2.2, up, blue));
    place(&mut scene, quad(Vec3::new(1.0, -3.0, -4.8), Vec3::new(2.8, 0.0, 2.4), up, red));
    place(&mut scene, quad(Vec3::new(-1.4, -0.5, -3.3), Vec3::X * 2.0, Vec3::Y * 2.2, blue));
    let kind = LightKind::Directional { direction: SUN.as_vec3().normalize(), angle_rad: 0.0 };
    scene.lights.push(Lamp { kind, strength: STRENGTH.as_vec3() });
    scene
}

/// Returns the screen with all kinds of lamps, some ambient light, and emissive parts.
pub fn lit_screen(gloss: bool) -> Scene {
    let mut scene = screen();
    if gloss {
        (scene.materials[0].specular, scene.materials[0].roughness) = (1.0, 0.4);
    }
    scene.environment = Environment::Constant(Vec3::new(0.1, 0.2, 0.3));
    let glow = add_material(&mut scene, Material { emissive: Vec3::splat(6.0), ..matte() });
    place(&mut scene, quad(Vec3::new(-0.5, 2.8, -4.0), Vec3::X, Vec3::Z, glow));
    let kind = LightKind::Point { position: Vec3::new(1.5, -1.5, -2.5), radius: 0.2 };
    scene.lights.push(Lamp { kind, strength: Vec3::splat(2.0) });
    scene
}

/// Returns a board near the eye with a lamp so close and bright that samples near it are not finite.
pub fn dazzled() -> Scene {
    let mut scene = empty("dazzled board");
    add_quad(&mut scene, (Vec3::new(-0.6, -0.3, -0.3), Vec3::X * 0.9, Vec3::Y * 0.9), colored(Vec3::splat(0.5)));
    let kind = LightKind::Point { position: Vec3::new(-0.2, 0.1, -0.2), radius: 0.0 };
    scene.lights.push(Lamp { kind, strength: Vec3::splat(2e37) });
    scene
}

pub fn subject(scene: Scene, gloss: bool) -> (Subject, World) {
    let triangles = Accel::build_with(&scene, Layout::Flat).unwrap().triangles;
    let corners = triangles.iter().map(|t| [t.v0, t.v1, t.v2].map(Vec3::as_dvec3)).collect();
    let world = World { triangles: corners, sun: SUN.normalize(), strength: STRENGTH * f64::from(STORAGE_SCALE) };
    let rig = still_rig(Vec3::ZERO, Vec3::NEG_Z, Vec3::Y, 0.5);
    let mut subject = Subject::laid_out("folding screen", scene, rig, Layout::Flat);
    // All scenes share a shader.
    subject.needs = SceneNeeds::of(&lit_screen(gloss));
    (subject, world)
}
