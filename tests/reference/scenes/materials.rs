//! Scenes that show the lobes of the material model, each under light that is easy to find.
//!
//! A row adds objects to the studio and returns their camera. Keep small bright lights away from smooth glass and metal:
//! the noise of caustics would hide any bias.

use diptych::scene::{AlphaMode, Clearcoat, Light, LightKind, Material, Mesh, NormalMap, Scene, Volume};
use glam::{Affine3A, Vec3, vec2, vec3, vec4};

use super::studio::{CLEAR, Pictures, add_balls, add_panels, camera, dielectric, glass, metal, second, studio, turned};
use super::{
    add_material, add_matte, add_mesh, block, grid, icosphere, instance, matte, place, place_at, quad, scaled_at,
};
use crate::reference::Pinhole;

pub type Row = (&'static str, fn(&mut Scene) -> Pinhole);

pub fn build((name, add): Row) -> (Scene, Pinhole) {
    let mut scene = studio(name);
    let camera = add(&mut scene);
    (scene, camera)
}

/// Builds the row of [`ALL`] with this name.
pub fn named(name: &str) -> (Scene, Pinhole) {
    build(ALL.into_iter().find(|row| row.0 == name).unwrap_or_else(|| panic!("there is no {name}")))
}

/// All scenes of this file with their names.
pub const ALL: [Row; 16] = [
    // Rough, glossy and smooth metals.
    ("metals", |scene| {
        let gold = vec3(1.0, 0.77, 0.34);
        add_balls(scene, [metal(gold, 0.7), metal(gold, 0.25), metal(vec3(0.95, 0.93, 0.9), 0.0)])
    }),
    // Dielectrics: glossy, rough and smooth over a colour, and half metal.
    ("dielectrics", |scene| {
        let red = vec3(0.8, 0.25, 0.2);
        let half = Material { metallic: 0.5, ..dielectric(vec3(0.9, 0.9, 0.95), 0.35) };
        add_balls(scene, [dielectric(red, 0.3), half, dielectric(red, 0.0)]);
        let pictures = Pictures::add(scene);
        let tiles = Material { base_color_texture: Some(pictures.checker), ..dielectric(Vec3::ONE, 0.4) };
        add_panels(scene, [Material { base_color_texture: Some(turned(pictures.checker)), ..tiles.clone() }, tiles])
    }),
    ("tinted_specular", |scene| {
        let tinted = Material {
            ior: 1.8,
            specular: 0.7,
            specular_color: vec3(2.0, 0.6, 0.3),
            ..dielectric(vec3(0.2, 0.3, 0.6), 0.35)
        };
        let saturated = Material { ior: 2.5, specular_color: vec3(8.0, 4.0, 1.0), specular: 0.9, ..tinted.clone() };
        add_balls(scene, [tinted.clone(), saturated, Material { roughness: 0.0, ..tinted }])
    }),
    // Panels of rough, half-rough and smooth thin glass in front of a block.
    ("thin_glass", |scene| {
        let green = vec3(0.7, 0.95, 0.8);
        let half = Material { transmission: 0.5, ..glass(green, 0.3) };
        add_panels(scene, [glass(green, 0.45), half, glass(green, 0.0)]);
        let red = add_matte(scene, vec3(0.8, 0.2, 0.15));
        let cube = add_mesh(scene, block(red));
        for x in [-1.0, 0.0, 1.0] {
            instance(scene, cube, scaled_at(0.5, vec3(x, 0.25, -0.9)));
        }
        camera()
    }),
    // A sun, a point light and a spot behind panes that are tinted with bumps, half opaque, blended, coated, or smooth in
    // parts. The room's lamp and sky shine through them, too.
    ("delta_lights_behind_panes", |scene| {
        let pictures = Pictures::add(scene);
        let green = vec3(0.6, 0.95, 0.7);
        let half = Material {
            transmission: 0.5,
            clearcoat: Clearcoat { factor: 0.7, ..Clearcoat::default() },
            ..glass(green, 0.0)
        };
        let blended = Material { base_color: green.extend(0.6), alpha_mode: AlphaMode::Blend, ..glass(green, 0.0) };
        let parts = Material { metallic_roughness_texture: Some(pictures.steps), ..glass(Vec3::ONE, 0.3) };
        let bumpy = Material { normal_map: pictures.normal_map(1.0), ..glass(green, 0.0) };
        add_panels(scene, [bumpy, half, blended, parts]);
        let direction = vec3(0.2, -0.7, 0.9).normalize();
        let kind = LightKind::Directional { direction, angle_rad: 0.0 };
        scene.lights.push(Light { kind, strength: vec3(2.0, 1.8, 1.5) });
        let position = vec3(0.6, 1.4, -1.2);
        scene.lights.push(Light { kind: LightKind::Point { position, radius: 0.0 }, strength: vec3(1.0, 1.5, 2.0) });
        let (direction, cos_inner, cos_outer) = (vec3(0.3, -0.8, 0.9).normalize(), 0.95, 0.7);
        let kind = LightKind::Spot { position: vec3(-0.8, 1.5, -1.0), radius: 0.0, direction, cos_inner, cos_outer };
        scene.lights.push(Light { kind, strength: vec3(3.0, 1.5, 1.0) });
        camera()
    }),
    // Panels that show their backs, with invisible volumes, beside glass.
    ("opaque_with_a_volume", |scene| {
        let dense = Volume { attenuation_color: vec3(0.5, 0.1, 0.02), attenuation_distance: 0.3 };
        let opaque = Material { volume: Some(dense), ..dielectric(vec3(0.8, 0.7, 0.6), 0.6) };
        add_panels(scene, [opaque.clone(), glass(Vec3::ONE, 0.3), opaque]);
        let panels = scene.instances.len() - 3;
        for panel in &mut scene.instances[panels..] {
            panel.world_from_local *= Affine3A::from_rotation_y(std::f32::consts::PI);
        }
        camera()
    }),
    ("smooth_thick_glass", |scene| {
        add_balls(
            scene,
            [
                Material { volume: amber(0.5), ..glass(Vec3::ONE, 0.0) },
                Material { volume: CLEAR, ior: 1.2, ..glass(vec3(0.8, 0.9, 1.0), 0.0) },
            ],
        )
    }),
    ("rough_thick_glass", |scene| {
        add_balls(
            scene,
            [
                Material { volume: amber(0.8), ..glass(Vec3::ONE, 0.3) },
                Material { volume: amber(0.8), ior: 2.0, ..glass(Vec3::ONE, 0.6) },
            ],
        )
    }),
    // The camera and a block are inside a large glass ball. The camera's rays do not know that medium.
    ("inside_glass", |scene| {
        let material = Material { volume: amber(2.0), ..glass(Vec3::ONE, 0.0) };
        let material = add_material(scene, material);
        let ball = add_mesh(scene, icosphere(3, true, material));
        instance(scene, ball, scaled_at(0.8, vec3(0.0, 0.9, 1.0)));
        let blue = add_matte(scene, vec3(0.2, 0.3, 0.8));
        place_at(scene, block(blue), scaled_at(0.3, vec3(0.25, 0.7, 0.6)));
        Pinhole::looking_at(vec3(0.0, 1.0, 1.4), vec3(0.0, 0.7, 0.0), Vec3::Y, 60.0)
    }),
    ("clearcoats", |scene| {
        let coat = |factor, roughness| Clearcoat { factor, roughness, ..Clearcoat::default() };
        add_balls(
            scene,
            [
                Material { clearcoat: coat(1.0, 0.0), ..metal(vec3(0.8, 0.2, 0.2), 0.6) },
                Material { clearcoat: coat(0.8, 0.3), ..dielectric(vec3(0.1, 0.3, 0.6), 0.8) },
                Material { clearcoat: coat(1.0, 0.1), emissive: vec3(0.3, 0.8, 0.4), ..matte() },
            ],
        )
    }),
    // Matte, metal and dielectric normal maps; the middle one is mirrored, the last one strong.
    ("normal_maps", |scene| {
        let pictures = Pictures::add(scene);
        let mapped = |material, scale| Material { normal_map: pictures.normal_map(scale), ..material };
        add_panels(
            scene,
            [
                mapped(Material { base_color: vec4(0.8, 0.7, 0.6, 1.0), ..matte() }, 1.0),
                mapped(metal(vec3(0.9, 0.8, 0.7), 0.4), 0.8),
                mapped(dielectric(vec3(0.3, 0.6, 0.3), 0.3), 2.5),
            ],
        )
    }),
    // Coats with and without a map over bases with and without one, and a textured coat.
    ("coat_maps", |scene| {
        let pictures = Pictures::add(scene);
        let coat = Clearcoat { factor: 1.0, roughness: 0.25, ..Clearcoat::default() };
        let mapped = Clearcoat { normal_map: pictures.normal_map(1.0), ..coat };
        let textured = Clearcoat {
            factor_texture: Some(pictures.steps),
            roughness_texture: Some(second(pictures.steps)),
            roughness: 0.8,
            ..coat
        };
        let base = dielectric(vec3(0.6, 0.2, 0.15), 0.6);
        add_panels(
            scene,
            [
                Material { clearcoat: mapped, ..base.clone() },
                Material { clearcoat: coat, normal_map: pictures.normal_map(1.0), ..base.clone() },
                Material { clearcoat: textured, ..base },
            ],
        )
    }),
    // Roughness and metalness, emission, and colours on the second coordinate set.
    ("material_textures", |scene| {
        let pictures = Pictures::add(scene);
        add_panels(
            scene,
            [
                Material { metallic_roughness_texture: Some(pictures.steps), ..metal(vec3(0.9, 0.6, 0.4), 0.9) },
                Material {
                    emissive: vec3(1.5, 1.0, 0.6),
                    emissive_texture: Some(second(pictures.checker)),
                    ..dielectric(vec3(0.3, 0.3, 0.3), 0.5)
                },
                Material {
                    base_color_texture: Some(second(pictures.checker)),
                    metallic_roughness_texture: Some(turned(pictures.steps)),
                    metallic: 0.7,
                    ..dielectric(Vec3::ONE, 0.8)
                },
            ],
        )
    }),
    // Textured strength and colour of the dielectric's reflection, and textured transmission, in front of a block.
    ("specular_textures", |scene| {
        let pictures = Pictures::add(scene);
        let base = dielectric(vec3(0.25, 0.3, 0.35), 0.35);
        add_panels(
            scene,
            [
                Material { specular_texture: Some(pictures.steps), ior: 2.0, ..base.clone() },
                Material {
                    specular_color_texture: Some(second(pictures.checker)),
                    specular_color: vec3(3.0, 2.0, 2.0),
                    ..base.clone()
                },
                Material { transmission: 1.0, transmission_texture: Some(pictures.steps), ..base },
            ],
        );
        let red = add_matte(scene, vec3(0.8, 0.2, 0.15));
        place_at(scene, block(red), scaled_at(0.5, vec3(1.0, 0.25, -0.9)));
        camera()
    }),
    // An unlit ball and panel that light the floor and are seen in a metal ball and from behind.
    ("unlit", |scene| {
        let pictures = Pictures::add(scene);
        let shown = Material { base_color: vec4(0.9, 0.5, 0.2, 1.0), unlit: true, ..dielectric(Vec3::ONE, 0.5) };
        let ignored = Material { emissive: Vec3::splat(50.0), ..shown.clone() };
        let textured = Material { base_color_texture: Some(pictures.checker), ..shown };
        add_balls(scene, [ignored, metal(Vec3::splat(0.9), 0.2), textured.clone()]);
        let textured = add_material(scene, textured);
        let mut behind = quad(vec3(-1.5, 0.2, -0.8), 3.0 * Vec3::X, Vec3::Y, textured);
        behind.uvs[0] = vec![Vec3::ZERO.truncate(); 4];
        place(scene, behind);
        camera()
    }),
    // An index of 1 does not refract; an index of 0 reflects everything that the colour leaves.
    ("ior_one_and_zero", |scene| {
        let haze = Material { ior: 1.0, volume: amber(0.6), ..glass(Vec3::ONE, 0.4) };
        let tinted = Material { ior: 0.0, specular_color: vec3(0.9, 0.6, 0.3), ..dielectric(Vec3::splat(0.8), 0.3) };
        let passing = Material { specular: 0.6, volume: amber(0.6), transmission: 1.0, ..tinted.clone() };
        add_balls(scene, [haze, tinted, passing])
    }),
];

pub(super) fn amber(attenuation_distance: f32) -> Option<Volume> {
    Some(Volume { attenuation_color: vec3(0.9, 0.6, 0.2), attenuation_distance })
}

/// Normal maps, on the base or only on a coat, on bent sheets without tangents.
pub fn mapped_without_tangents() -> (Scene, Pinhole) {
    let mut scene = studio("normal maps without tangents");
    let map = Pictures::add(&mut scene).waves;
    let on = |texture| Some(NormalMap { texture, scale: 1.0 });
    let coat = Clearcoat { factor: 1.0, roughness: 0.3, normal_map: on(second(map)), ..Clearcoat::default() };
    let materials = [
        (Material { normal_map: on(turned(map)), ..metal(vec3(0.9, 0.6, 0.3), 0.4) }, true),
        (Material { clearcoat: coat, ..dielectric(vec3(0.1, 0.2, 0.3), 0.8) }, true),
        (Material { normal_map: on(map), ..metal(vec3(0.5, 0.8, 0.6), 0.4) }, false),
    ];
    for (i, (material, has_normals)) in materials.into_iter().enumerate() {
        let material = add_material(&mut scene, material);
        let mesh = add_mesh(&mut scene, bent_sheet(material, has_normals));
        instance(&mut scene, mesh, Affine3A::from_translation(vec3(1.05 * (i as f32 - 1.0), 0.55, 0.0)));
    }
    (scene, camera())
}

/// Returns a sheet that is bent around a vertical axis. On both coordinate sets its image is mirrored in the middle,
/// where vertices are shared.
fn bent_sheet(material: usize, has_normals: bool) -> Mesh {
    const COLUMNS: u32 = 8;
    const ROWS: u32 = 5;
    let mut mesh = Mesh { material, ..Mesh::default() };
    for (row, column) in (0..=ROWS).flat_map(|row| (0..=COLUMNS).map(move |column| (row, column))) {
        let [s, t] = [column as f32 / COLUMNS as f32 - 0.5, row as f32 / ROWS as f32];
        let (sin, cos) = (2.0 * s).sin_cos();
        mesh.positions.push(vec3(0.5 * sin, t - 0.5, 0.4 * cos - 0.3));
        if has_normals {
            mesh.normals.push(vec3(0.4 * sin, 0.0, 0.5 * cos).normalize());
        }
        mesh.uvs[0].push(vec2(2.0 * s.abs() + 0.4 * t, 1.0 - 0.5 * t * (1.0 + t)));
        mesh.uvs[1].push(vec2(t, 1.5 * s.abs() + 0.2 * t));
    }
    mesh.triangles = grid(COLUMNS, ROWS);
    mesh
}
