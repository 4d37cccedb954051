//! Tests of all built-in scenes and of the shapes they are made of.

use super::super::{Environment, Mesh, Scene};
use super::geometry::{Outline, Surface};
use super::shapes::*;
use super::*;
use glam::Vec3;

fn each(mut check: impl FnMut(&Builtin, &Scene)) {
    for builtin in BUILTINS {
        check(builtin, &(builtin.build)());
    }
}

fn geometric_normal(mesh: &Mesh, t: &[u32; 3]) -> Vec3 {
    let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
    (b - a).cross(c - a)
}

#[test]
fn a_scene_is_found_by_name_and_an_unknown_name_lists_the_known() {
    assert_eq!(find("cornell").unwrap().name, "cornell");
    let message = find("sponza").unwrap_err().to_string();
    assert!(BUILTINS.iter().all(|b| message.contains(b.name)), "{message}");
}

#[test]
fn triangle_counts_are_as_advertised() {
    for (name, range) in [
        ("atrium", 250_000..=270_000),
        ("checker", 10_000..=80_000),
        ("cornell", 36..=36),
        ("furnace", 40_000..=50_000),
        ("forest", 190_000..=210_000),
        ("gallery", 36_000..=37_000),
        ("studio", 4_000..=6_000),
        ("towers", 21_202..=21_202),
    ] {
        let count = (find(name).unwrap().build)().triangle_count();
        assert!(range.contains(&count), "{name}: {count}");
    }
}

#[test]
fn every_reference_points_at_something() {
    each(|b, s| {
        assert!(s.instances.iter().all(|i| i.mesh < s.meshes.len()), "{}", b.name);
        assert!(s.textures.iter().all(|t| t.image < s.images.len()), "{}", b.name);
        assert!(s.images.iter().all(|i| i.pixels.len() == i.extent.area()), "{}", b.name);
        for mesh in &s.meshes {
            let n = mesh.positions.len();
            assert!(mesh.material < s.materials.len());
            assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
            assert!(mesh.normals.is_empty() || mesh.normals.len() == n);
            let texture = s.materials[mesh.material].base_color_texture;
            assert!(texture.is_none_or(|t| t.texture < s.textures.len() && mesh.uvs[t.uv_set].len() == n));
            assert!(mesh.positions.iter().all(|p| p.is_finite()));
            assert!(mesh.uvs.iter().flatten().all(|uv| uv.is_finite()));
        }
    });
}

#[test]
fn every_mesh_is_used() {
    each(|b, s| {
        for mesh in 0..s.meshes.len() {
            assert!(s.instances.iter().any(|i| i.mesh == mesh), "{}: mesh {mesh}", b.name);
        }
    });
}

#[test]
fn environment_and_lights_that_stand_still_are_left_to_the_shot() {
    each(|b, s| {
        assert!(s.lights.len() == s.motion.lights.len() && s.environment == Environment::Black, "{}", b.name);
        assert!(s.warnings.is_empty() && !s.materials.is_empty(), "{}", b.name);
    });
}

#[test]
fn instances_neither_mirror_nor_shear() {
    each(|b, s| {
        for instance in &s.instances {
            let m = instance.world_from_local.matrix3;
            let size = m.x_axis.length();
            let even = (m.y_axis.length() - size).abs() + (m.z_axis.length() - size).abs();
            assert!(m.determinant() > 0.0 && even < 1e-4 * size, "{}: {m:?}", b.name);
        }
    });
}

#[test]
fn normals_are_unit_and_agree_with_the_winding() {
    each(|b, s| {
        for (index, mesh) in s.meshes.iter().enumerate() {
            assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{} {index}", b.name);
            let agrees = |t: &&[u32; 3]| {
                let g = geometric_normal(mesh, t);
                t.iter().all(|&i| mesh.normals.get(i as usize).is_none_or(|n| g.dot(*n) > 0.0))
            };
            let good = mesh.triangles.iter().filter(agrees).count();
            let share = good as f32 / mesh.triangles.len() as f32;
            assert!(share > 0.99, "{}: mesh {index} agrees at {share}", b.name);
        }
    });
}

#[test]
fn few_triangles_are_without_area() {
    each(|b, s| {
        for (index, mesh) in s.meshes.iter().enumerate() {
            let flat = mesh.triangles.iter().filter(|t| geometric_normal(mesh, t).length() < 1e-12).count();
            assert_eq!(flat, 0, "{}: mesh {index} of {}", b.name, mesh.triangles.len());
        }
    });
}

/// Returns the FNV-1a hash of everything that places a vertex.
fn fingerprint(scene: &Scene) -> u64 {
    let placed = scene.instances.iter().flat_map(|i| i.world_from_local.to_cols_array());
    let vertices = scene.meshes.iter().flat_map(|m| m.positions.iter().chain(&m.normals)).flat_map(|v| v.to_array());
    let indices = scene.meshes.iter().flat_map(|m| m.triangles.iter().flatten().copied());
    let words = placed.chain(vertices).map(f32::to_bits).chain(indices);
    words.fold(0xcbf2_9ce4_8422_2325, |h, w| (h ^ u64::from(w)).wrapping_mul(0x0100_0000_01b3))
}

#[test]
fn building_twice_gives_the_same_bits() {
    each(|b, s| assert_eq!(fingerprint(s), fingerprint(&(b.build)()), "{}", b.name));
}

#[test]
fn shots_are_toml_for_their_scene_with_a_path_of_four_seconds() {
    for b in BUILTINS {
        let shot: toml::Table = b.shot.parse().unwrap_or_else(|e| panic!("{}: {e}", b.name));
        assert_eq!(shot["name"].as_str(), Some(b.name));
        assert_eq!(shot["scene"].as_str(), Some(format!("builtin:{}", b.name).as_str()));
        let keys = shot["rig"]["key"].as_array().unwrap();
        let times: Vec<_> = keys.iter().map(|k| k["time_s"].as_float().unwrap()).collect();
        assert!(times.len() > 2 && times[0] == 0.0 && times.is_sorted() && times[times.len() - 1] == 4.0);
        assert!(shot["environment"].is_table());
    }
}

#[test]
fn the_camera_starts_inside_what_it_looks_at() {
    each(|b, s| {
        let shot: toml::Table = b.shot.parse().unwrap();
        let bounds = s.bounds();
        let size = (bounds.max - bounds.min).length();
        for key in shot["rig"]["key"].as_array().unwrap() {
            let p: Vec<f32> =
                key["position"].as_array().unwrap().iter().map(|v| v.as_float().unwrap() as f32).collect();
            let p = Vec3::new(p[0], p[1], p[2]);
            assert!((p.clamp(bounds.min, bounds.max) - p).length() < size, "{}: {p}", b.name);
        }
    });
}

/// Returns the volume enclosed by a closed surface; negative if it is inside out.
fn signed_volume(surface: &Surface) -> f32 {
    let corner = |i: u32| surface.vertices[i as usize].position.as_dvec3();
    let six: f64 = surface.triangles.iter().map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2])))).sum();
    (six / 6.0) as f32
}

fn solids() -> Vec<(&'static str, Surface, f32)> {
    use std::f32::consts::PI;
    let square = Outline::rectangle([0.5, -0.1], [0.7, 0.1]);
    vec![
        ("cuboid", cuboid([-1.0, 0.0, 2.0], [1.0, 3.0, 2.5]), 3.0),
        ("block", block([1.0, 0.0, 0.0], [1.0, 2.0, 3.0]), 6.0),
        ("sphere", sphere(0.5, 96, 48), PI / 6.0),
        ("cylinder", cylinder(0.5, 2.0, 128), PI / 2.0),
        ("torus", torus(1.0, 0.25, 96, 48), 2.0 * PI * PI / 16.0),
        ("extrusion", extrude(&Outline::rectangle([0.0; 2], [1.0, 2.0]), 3.0), 6.0),
        ("arch", arch(&square, 96), PI * 0.6 * 0.04),
        ("limb", limb(&[(Vec3::ZERO, 0.2), (Vec3::Y, 0.2), (Vec3::Y * 2.0, 0.2)], 64), PI * 0.08),
    ]
}

#[test]
fn solids_have_the_volume_of_their_formula() {
    for (name, surface, volume) in solids() {
        let got = signed_volume(&surface);
        assert!((got - volume).abs() < 0.01 * volume, "{name}: {got}, not {volume}");
    }
}

#[test]
fn solids_are_watertight() {
    for (name, surface, _) in solids() {
        let key = |i: u32| surface.vertices[i as usize].position.to_array().map(|c| (c * 1e5).round() as i64);
        let mut open = std::collections::HashMap::new();
        for t in &surface.triangles {
            for k in 0..3 {
                let (a, b) = (key(t[k]), key(t[(k + 1) % 3]));
                *open.entry(if a < b { (a, b) } else { (b, a) }).or_insert(0) += if a < b { 1 } else { -1 };
            }
        }
        assert!(open.values().all(|&n| n == 0), "{name}");
    }
}

#[test]
fn flipping_turns_a_solid_inside_out() {
    let ball = sphere(1.0, 16, 8);
    assert_eq!(signed_volume(&ball.clone().flipped()), -signed_volume(&ball));
}

#[test]
fn a_vault_is_seen_from_below() {
    let vault = groin_vault(3.0, 2.0, 1.0, 6).into_mesh(0);
    assert!(vault.triangles.iter().all(|t| geometric_normal(&vault, t).y <= 1e-6));
    assert!(vault.positions.iter().all(|p| (0.0..=1.0 + 1e-6).contains(&p.y)));
}
