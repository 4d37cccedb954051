//! Matte, glossy and metal objects under one kind of light each, and under many. Bright lamps are outside the picture,
//! because their edges would cause most of its noise. The floor fills the picture, so that no pixel is black.
//!
//! To add a row, write a function that adds the light to [`things`], and its line in [`ALL`].

use diptych::image::Extent;
use diptych::scene::{AlphaMode, Clearcoat, Environment, Light, LightKind, Material, Scene, Volume};
use glam::{Vec2, Vec3, vec2, vec3, vec4};

use super::pictures::sky;
use super::studio::{Pictures, add_balls, dielectric, glass, ground, metal, second, turned};
use super::{add_material, add_quad, block, icosphere, matte, place, place_at, quad, scaled_at};
use crate::reference::Pinhole;

pub type Row = (&'static str, fn(&mut Scene));

/// All kinds of light with their names.
pub const ALL: [Row; 10] = [
    ("emissive_triangles", add_lamps),
    ("point", |scene| scene.lights.push(point(0.0))),
    ("spot", |scene| scene.lights.push(spot(0.0))),
    ("sphere", |scene| scene.lights.push(point(0.3))),
    ("sphere_spot", |scene| scene.lights.push(spot(0.25))),
    ("directional", |scene| scene.lights.push(sun(0.0))),
    ("directional_disc", |scene| scene.lights.push(sun(4.0))),
    ("constant_environment", |scene| scene.environment = Environment::Constant(vec3(0.6, 0.7, 0.9))),
    ("environment_with_a_sun", add_sunny_sky),
    ("many_lights", add_many),
];

/// Emissive triangles that emit less than their factor, or from the back.
pub const CARDS: [Row; 5] = [
    ("masked", |scene| add_card(scene, Card::Masked)),
    ("blended", |scene| add_card(scene, Card::Blended)),
    ("textured_mask", |scene| add_card(scene, Card::Textured)),
    ("coated", |scene| add_card(scene, Card::Coated)),
    ("seen_from_behind", |scene| add_card(scene, Card::FromBehind)),
];

/// Lights with hard shadows, alone and among others.
pub const HARD: [Row; 3] = [
    ("hard_point", |scene| scene.lights.push(point(0.0))),
    ("narrow_sun_under_a_sky", |scene| {
        scene.lights.push(sun(0.9));
        add_sunny_sky(scene);
    }),
    ("hard_among_soft", |scene| {
        add_lamps(scene);
        scene.lights.extend([point(0.0), spot(0.0), spot(0.2), sun(0.0), sun(0.9)]);
    }),
];

/// Perfect mirrors and clear glass in several kinds of light: a wall, two mirrors that face each other, a golden ball, a
/// pane, and a glass ball around a block. They show dim lights only, because light that they throw on other surfaces is
/// found by chance and would cause most of the noise.
pub const MIRRORS: [Row; 6] = [
    ("a_mirror", |scene| {
        add_mirror(scene, vec3(-1.8, 0.0, -0.9), vec3(3.6, 0.0, 0.3), vec3(0.0, 2.0, 0.2));
        let ball = Light { strength: Vec3::splat(0.05), ..point(0.3) };
        scene.lights.extend([ball, spot(0.0)]);
        let glow = add_material(scene, Material { emissive: Vec3::splat(0.4), double_sided: true, ..matte() });
        place(scene, quad(vec3(0.9, 0.2, 1.2), 0.8 * Vec3::X, 0.5 * Vec3::Y, glow));
        scene.environment = Environment::Constant(vec3(0.3, 0.4, 0.5));
    }),
    ("mirrors_that_face_each_other", |scene| {
        add_mirror(scene, vec3(-1.6, 0.0, 1.2), vec3(0.0, 0.0, -2.4), vec3(0.3, 1.5, 0.0));
        add_mirror(scene, vec3(1.6, 0.0, -1.2), vec3(0.0, 0.0, 2.4), vec3(-0.3, 1.5, 0.0));
        scene.lights.push(point(0.0));
        scene.environment = Environment::Constant(vec3(0.6, 0.7, 0.9));
    }),
    ("a_pane", |scene| {
        let pane = Material { emissive: vec3(0.02, 0.0, 0.0), ..glass(vec3(0.9, 0.95, 0.8), 0.0) };
        add_pane(scene, pane);
        scene.lights.extend([Light { strength: Vec3::splat(0.05), ..point(0.3) }, spot(0.0)]);
        scene.environment = Environment::Constant(vec3(0.3, 0.4, 0.5));
    }),
    ("a_pane_before_a_mirror", |scene| {
        add_mirror(scene, vec3(-1.8, 0.0, -0.9), vec3(3.6, 0.0, 0.3), vec3(0.0, 2.0, 0.2));
        add_pane(scene, glass(Vec3::ONE, 0.0));
        scene.environment = Environment::Constant(vec3(0.6, 0.7, 0.9));
    }),
    ("a_glass_ball_around_a_block", |scene| {
        let volume = Some(Volume { attenuation_color: vec3(0.9, 0.6, 0.3), attenuation_distance: 0.8 });
        let amber = add_material(scene, Material { volume, ..glass(Vec3::ONE, 0.0) });
        place_at(scene, icosphere(3, true, amber), scaled_at(0.6, vec3(0.2, 0.6, 0.8)));
        let core = add_material(scene, Material { base_color: vec4(0.3, 0.6, 0.4, 1.0), ..matte() });
        place_at(scene, block(core), scaled_at(0.3, vec3(0.2, 0.55, 0.75)));
        scene.environment = Environment::Constant(vec3(0.6, 0.7, 0.9));
    }),
    ("a_mirror_ball", |scene| {
        add_ball_in_the_sky(scene, metal(vec3(0.9, 0.7, 0.4), 0.0));
    }),
];

/// Polished surfaces: a painted wall, a wall of paint and metal behind a pane, and balls with a smooth coat over rough
/// metal and over smooth paint.
pub const POLISHED: [Row; 4] = [
    ("a_polished_wall", |scene| {
        add_wall(scene, dielectric(vec3(0.2, 0.1, 0.1), 0.0));
        let ball = Light { strength: Vec3::splat(0.05), ..point(0.3) };
        scene.lights.extend([ball, spot(0.0)]);
        scene.environment = Environment::Constant(vec3(0.3, 0.4, 0.5));
    }),
    ("half_a_mirror_behind_a_pane", |scene| {
        add_wall(scene, Material { metallic: 0.5, ..dielectric(vec3(0.2, 0.4, 0.3), 0.0) });
        add_pane(scene, glass(Vec3::ONE, 0.0));
        scene.environment = Environment::Constant(vec3(0.6, 0.7, 0.9));
    }),
    ("a_coated_metal_ball", |scene| {
        let coat = Clearcoat { factor: 0.8, ..Clearcoat::default() };
        add_ball_in_the_sky(scene, Material { clearcoat: coat, ..metal(vec3(0.5, 0.3, 0.1), 0.4) });
    }),
    ("a_coated_painted_ball", |scene| {
        let coat = Clearcoat { factor: 1.0, ..Clearcoat::default() };
        add_ball_in_the_sky(scene, Material { clearcoat: coat, ..dielectric(vec3(0.2, 0.3, 0.5), 0.0) });
    }),
];

/// Mirror balls in the light of a small lamp, so that they throw caustics.
pub fn caustics() -> (Scene, Pinhole) {
    things("caustics", |scene| {
        let lamp = add_material(scene, Material { emissive: Vec3::splat(150.0), ..matte() });
        place(scene, quad(vec3(-1.2, 2.4, 1.0), 0.15 * Vec3::X, 0.15 * Vec3::Z, lamp));
        add_balls(scene, [metal(vec3(0.9, 0.8, 0.7), 0.0), dielectric(vec3(0.3, 0.4, 0.5), 0.0)]);
    })
}

/// Narrow lobes that are no mirrors: a brushed golden ball and a lacquered one, in a sky.
pub const NARROW: [Row; 2] = [
    ("a_brushed_ball", |scene| {
        add_ball_in_the_sky(scene, metal(vec3(0.9, 0.7, 0.4), 0.15));
    }),
    ("a_lacquered_ball", |scene| {
        let lacquer = Clearcoat { factor: 1.0, roughness: 0.05, ..Clearcoat::default() };
        add_ball_in_the_sky(scene, Material { clearcoat: lacquer, ..dielectric(vec3(0.5, 0.1, 0.1), 0.6) });
    }),
];

fn add_ball_in_the_sky(scene: &mut Scene, material: Material) {
    let material = add_material(scene, material);
    place_at(scene, icosphere(3, true, material), scaled_at(0.6, vec3(0.2, 0.6, 0.8)));
    scene.environment = Environment::Map { image: sky(Extent::new(32, 16)).into(), rotation_deg: -40.0 };
}

fn add_mirror(scene: &mut Scene, corner: Vec3, u: Vec3, v: Vec3) {
    add_quad(scene, (corner, u, v), Material { emissive: vec3(0.02, 0.0, 0.0), ..metal(vec3(0.9, 0.95, 0.85), 0.0) });
}

/// Adds a wall of the material behind the objects.
fn add_wall(scene: &mut Scene, material: Material) {
    add_quad(scene, (vec3(-1.8, 0.0, -0.9), vec3(3.6, 0.0, 0.3), vec3(0.0, 2.0, 0.2)), material);
}

fn add_pane(scene: &mut Scene, material: Material) {
    add_quad(scene, (vec3(-1.8, 0.0, 1.3), 3.6 * Vec3::X, vec3(0.0, 1.3, 0.3)), material);
}

/// Returns a floor with a matte, a glossy and a rough metal ball in that light.
pub fn things(name: &str, add_light: fn(&mut Scene)) -> (Scene, Pinhole) {
    let mut scene = ground(name);
    let base = vec3(0.7, 0.5, 0.3);
    let matte = Material { base_color: base.extend(1.0), ..matte() };
    add_balls(&mut scene, [matte, dielectric(base, 0.35), metal(base, 0.5)]);
    add_light(&mut scene);
    (scene, Pinhole::looking_at(vec3(0.0, 2.6, 3.4), vec3(0.0, 0.35, 0.0), Vec3::Y, 30.0))
}

fn add_lamps(scene: &mut Scene) {
    let black = vec4(0.0, 0.0, 0.0, 1.0);
    let lamp = |emissive, double_sided| Material { base_color: black, emissive, double_sided, ..matte() };
    add_quad(scene, (vec3(-1.8, 2.4, -1.0), 2.4 * Vec3::X, 2.0 * Vec3::Z), lamp(vec3(2.0, 1.5, 1.0), false));
    add_quad(scene, (vec3(2.9, 0.3, -0.8), 1.4 * Vec3::Z, 1.6 * Vec3::Y), lamp(vec3(0.25, 0.6, 1.2), true));
}

/// Property of the lamp of [`add_card`] under test.
#[derive(Clone, Copy, PartialEq)]
enum Card {
    Masked,
    Blended,
    Textured,
    Coated,
    FromBehind,
}

/// Adds a lamp as the only light. It hangs above and faces down, tilted slightly towards the camera.
fn add_card(scene: &mut Scene, kind: Card) {
    let pictures = Pictures::add(scene);
    let lamp = |emissive: Vec3| {
        let plain = Material { base_color: vec4(0.1, 0.1, 0.1, 1.0), emissive, ..matte() };
        match kind {
            Card::Masked => Material { alpha_mode: AlphaMode::Mask { cutoff: 0.5 }, ..plain },
            Card::Blended => Material { base_color: vec4(0.1, 0.1, 0.1, 0.9), alpha_mode: AlphaMode::Blend, ..plain },
            Card::Textured => Material {
                base_color_texture: Some(turned(pictures.checker)),
                emissive_texture: Some(second(pictures.steps)),
                alpha_mode: AlphaMode::Mask { cutoff: 0.25 },
                ..plain
            },
            Card::Coated => Material {
                clearcoat: Clearcoat {
                    factor: 1.0,
                    factor_texture: Some(pictures.steps),
                    normal_map: pictures.normal_map(2.0),
                    ..Clearcoat::default()
                },
                ..plain
            },
            Card::FromBehind => Material { double_sided: true, ..plain },
        }
    };
    let lamp = add_material(scene, lamp(vec3(8.0, 6.0, 4.0)));
    let mut card = quad(vec3(-1.2, 3.2, -1.5), 2.4 * Vec3::X, vec3(0.0, 0.8, 2.2), lamp);
    card.uvs = [
        vec![vec2(-0.1, 1.1), vec2(1.2, 1.0), vec2(1.0, 0.0), vec2(0.1, -0.1)],
        vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
    ];
    // A masked card has a hole; a blended one fades along its length.
    if matches!(kind, Card::Masked | Card::Blended) {
        card.colors = [1.0, 0.3, 0.3, 1.0].map(|a| vec4(1.0, 1.0, 1.0, a)).to_vec();
    }
    if kind == Card::Coated {
        card.tangents = vec![(card.positions[1] - card.positions[0]).normalize().extend(1.0); 4];
    }
    if kind == Card::FromBehind {
        card.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    place(scene, card);
}

fn point(radius: f32) -> Light {
    let kind = LightKind::Point { position: vec3(-0.6, 2.3, 0.9), radius };
    Light { kind, strength: vec3(4.0, 3.5, 3.0) }
}

fn spot(radius: f32) -> Light {
    let kind = LightKind::Spot {
        position: vec3(1.2, 2.2, 1.2),
        radius,
        direction: vec3(-0.5, -0.8, -0.5).normalize(),
        cos_inner: 15f32.to_radians().cos(),
        cos_outer: 45f32.to_radians().cos(),
    };
    Light { kind, strength: vec3(6.0, 7.0, 8.0) }
}

fn sun(angle_deg: f32) -> Light {
    let direction = vec3(0.5, -1.0, -0.6).normalize();
    Light {
        kind: LightKind::Directional { direction, angle_rad: angle_deg.to_radians() },
        strength: vec3(2.0, 1.8, 1.5),
    }
}

/// Adds a sky with one texel as the sun, 300 times as bright as the rest.
fn add_sunny_sky(scene: &mut Scene) {
    let mut image = sky(Extent::new(32, 16));
    image.pixels[3 * 32 + 19] = [300.0, 280.0, 240.0];
    scene.environment = Environment::Map { image: image.into(), rotation_deg: -40.0 };
}

fn add_many(scene: &mut Scene) {
    add_lamps(scene);
    scene.lights.extend([point(0.0), spot(0.0), spot(0.2), sun(0.0), sun(3.0)]);
    let small =
        Light { kind: LightKind::Point { position: vec3(0.5, 0.25, 0.8), radius: 0.2 }, strength: Vec3::splat(0.3) };
    scene.lights.push(small);
    scene.environment = Environment::Constant(vec3(0.1, 0.1, 0.15));
}
