//! Scenes that show the lobes of extensions: sheen, thin films, diffuse transmission, anisotropy, dispersion.
//!
//! To add a row, follow `materials.rs`.

use diptych::scene::{Anisotropy, Clearcoat, DiffuseTransmission, Iridescence, Material, Scene, Sheen};
use glam::{Vec3, vec3};

use super::materials::{Row, amber};
use super::studio::{Pictures, add_balls, add_panels, camera, dielectric, glass, metal, second};
use super::{add_matte, block, place_at, scaled_at};

/// All scenes of this file with their names.
pub const ALL: [Row; 10] = [
    // Velvet over black, felt, and a sheen with a smooth coat over metal.
    ("sheens", |scene| {
        let sheen = |color, roughness| Sheen { color, roughness, ..Sheen::default() };
        let coat = Clearcoat { factor: 0.5, ..Clearcoat::default() };
        add_balls(
            scene,
            [
                Material { sheen: sheen(Vec3::splat(0.9), 0.3), ..dielectric(Vec3::splat(0.02), 0.9) },
                Material {
                    sheen: sheen(vec3(0.3, 0.5, 0.9), 0.7),
                    specular: 0.0,
                    ..dielectric(vec3(0.6, 0.2, 0.1), 1.0)
                },
                Material {
                    sheen: sheen(vec3(0.2, 0.8, 0.4), 0.15),
                    clearcoat: coat,
                    ..metal(vec3(0.9, 0.6, 0.3), 0.4)
                },
            ],
        )
    }),
    // Textured colour and roughness of a sheen, and a sheen on smooth metal and on a pane.
    ("sheen_textures", |scene| {
        let pictures = Pictures::add(scene);
        let sheen = Sheen { color: vec3(0.8, 0.9, 1.0), roughness: 0.8, ..Sheen::default() };
        let base = dielectric(vec3(0.3, 0.1, 0.1), 0.8);
        add_panels(
            scene,
            [
                Material { sheen: Sheen { color_texture: Some(pictures.checker), ..sheen }, ..base.clone() },
                Material { sheen: Sheen { roughness_texture: Some(second(pictures.steps)), ..sheen }, ..base },
                Material { sheen, ..metal(vec3(0.9, 0.7, 0.5), 0.0) },
                Material { sheen: Sheen { roughness: 0.4, ..sheen }, ..glass(vec3(0.7, 0.95, 0.8), 0.0) },
            ],
        )
    }),
    // Thin films on metal, on a dark dielectric, and on a bubble of thin glass.
    ("films", |scene| {
        let film = |ior, nm| Iridescence { factor: 1.0, ior, thickness_nm: [nm; 2], ..Iridescence::default() };
        add_balls(
            scene,
            [
                Material { iridescence: film(1.8, 350.0), ..metal(vec3(0.6, 0.6, 0.65), 0.3) },
                Material { iridescence: film(1.3, 550.0), ..dielectric(vec3(0.05, 0.05, 0.1), 0.4) },
                Material { iridescence: film(1.33, 420.0), ..glass(Vec3::ONE, 0.0) },
            ],
        )
    }),
    // Textured coverage and thickness of films, one of them on half-metal with a normal map.
    ("film_textures", |scene| {
        let pictures = Pictures::add(scene);
        let film = Iridescence { factor: 0.9, ior: 1.6, thickness_nm: [150.0, 600.0], ..Iridescence::default() };
        let base = dielectric(vec3(0.1, 0.15, 0.2), 0.35);
        add_panels(
            scene,
            [
                Material { iridescence: Iridescence { factor_texture: Some(pictures.steps), ..film }, ..base.clone() },
                Material {
                    iridescence: Iridescence { thickness_texture: Some(second(pictures.steps)), ..film },
                    ..base
                },
                Material {
                    iridescence: film,
                    metallic: 0.5,
                    normal_map: pictures.normal_map(0.7),
                    ..metal(vec3(0.9, 0.7, 0.5), 0.4)
                },
            ],
        )
    }),
    // Sheets with diffuse transmission, lit from behind: a leaf with textures, paper, and one under a sheen and a coat.
    ("leaves", |scene| {
        let pictures = Pictures::add(scene);
        let green = DiffuseTransmission { factor: 0.7, color: vec3(0.4, 0.8, 0.1), ..DiffuseTransmission::default() };
        let textured = DiffuseTransmission {
            factor_texture: Some(pictures.steps),
            color_texture: Some(second(pictures.checker)),
            ..green
        };
        let leaf = Material { diffuse_transmission: textured, ..dielectric(vec3(0.2, 0.5, 0.1), 0.4) };
        let paper = DiffuseTransmission { factor: 0.5, color: vec3(0.9, 0.85, 0.7), ..green };
        let paper = Material { diffuse_transmission: paper, specular: 0.0, ..dielectric(vec3(0.9, 0.9, 0.85), 1.0) };
        let covered = Material {
            diffuse_transmission: green,
            sheen: Sheen { color: vec3(0.5, 0.4, 0.6), roughness: 0.5, ..Sheen::default() },
            clearcoat: Clearcoat { factor: 0.8, roughness: 0.3, ..Clearcoat::default() },
            ..leaf.clone()
        };
        add_panels(scene, [leaf, paper, covered]);
        let red = add_matte(scene, vec3(0.8, 0.2, 0.15));
        place_at(scene, block(red), scaled_at(0.5, vec3(0.0, 0.25, -0.9)));
        camera()
    }),
    // Balls that enclose a volume behind a wall with diffuse transmission, with and without facets that transmit as well.
    ("lampshades", |scene| {
        let through = DiffuseTransmission { factor: 0.8, color: vec3(1.0, 0.9, 0.7), ..DiffuseTransmission::default() };
        let shade =
            Material { diffuse_transmission: through, volume: amber(1.0), ..dielectric(vec3(0.9, 0.8, 0.7), 0.5) };
        let half = Material { transmission: 0.5, roughness: 0.3, ..shade.clone() };
        add_balls(scene, [shade, half])
    }),
    // Metals and a dielectric that are rougher along circles, across them, and askew.
    ("brushed", |scene| {
        let brushed = |strength, rotation| Anisotropy { strength, rotation, texture: None };
        add_balls(
            scene,
            [
                Material { anisotropy: brushed(0.9, 0.0), ..metal(vec3(0.9, 0.8, 0.7), 0.25) },
                Material { anisotropy: brushed(0.6, 1.57), ..metal(vec3(0.7, 0.75, 0.9), 0.3) },
                Material { anisotropy: brushed(0.8, 0.6), ..dielectric(vec3(0.5, 0.1, 0.1), 0.35) },
            ],
        );
        turn_on_lathe(scene, 3);
        camera()
    }),
    // Textured strength and direction, on a mirrored panel too, and under a normal map and a coat.
    ("brushed_textures", |scene| {
        let pictures = Pictures::add(scene);
        let base = metal(vec3(0.9, 0.8, 0.6), 0.3);
        let brushed = |texture| Anisotropy { strength: 0.9, rotation: 0.4, texture };
        add_panels(
            scene,
            [
                Material { anisotropy: brushed(Some(pictures.checker)), ..base.clone() },
                Material { anisotropy: brushed(Some(second(pictures.steps))), ..base.clone() },
                Material {
                    anisotropy: brushed(None),
                    normal_map: pictures.normal_map(0.8),
                    clearcoat: Clearcoat { factor: 0.6, roughness: 0.2, ..Clearcoat::default() },
                    ..base
                },
            ],
        )
    }),
    // A thin sheet and a solid of brushed glass, and dispersive frosted glass.
    ("brushed_glass", |scene| {
        let anisotropy = Anisotropy { strength: 0.7, rotation: 0.3, texture: None };
        let sheet = Material { anisotropy, ..glass(vec3(0.8, 0.95, 0.9), 0.3) };
        let solid = Material { volume: amber(2.0), ..sheet.clone() };
        let prism = Material { anisotropy, volume: amber(4.0), dispersion: 4.0, ..glass(Vec3::ONE, 0.4) };
        add_balls(scene, [sheet, solid, prism]);
        turn_on_lathe(scene, 3);
        camera()
    }),
    // Solid glass with dispersion: smooth, smooth with a strong one, and frosted.
    ("prisms", |scene| {
        let prism = |dispersion, roughness| Material { volume: amber(5.0), dispersion, ..glass(Vec3::ONE, roughness) };
        add_balls(scene, [prism(1.0, 0.0), prism(8.0, 0.0), prism(6.0, 0.4)])
    }),
];

/// Gives the last meshes tangents along circles of latitude, like metal that was turned on a lathe.
fn turn_on_lathe(scene: &mut Scene, meshes: usize) {
    for mesh in scene.meshes.iter_mut().rev().take(meshes) {
        let along = |n: &Vec3| Vec3::Y.cross(*n).normalize_or_zero().extend(1.0);
        mesh.tangents = mesh.normals.iter().map(along).collect();
    }
}
