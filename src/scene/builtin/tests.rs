//! Tests of all built-in scenes, and of the files of static ones.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{Vec2, Vec3};
use serde_json::json;

use super::super::{Environment, Mesh, Scene};
use super::*;

fn each(mut check: impl FnMut(&Builtin, &Scene)) {
    for builtin in BUILTINS {
        check(builtin, &builtin.build());
    }
}

fn geometric_normal(mesh: &Mesh, t: &[u32; 3]) -> Vec3 {
    let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
    (b - a).cross(c - a)
}

#[test]
fn unknown_scene_name_lists_the_known_names() {
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
        let count = find(name).unwrap().build().triangle_count();
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
fn scenes_contain_only_animated_lights() {
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
fn same_bytes_from_building_twice() {
    each(|b, s| assert_eq!(fingerprint(s), fingerprint(&b.build()), "{}", b.name));
}

#[test]
fn shots_are_toml_with_a_path_of_four_seconds() {
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
fn camera_keys_stay_near_the_scene() {
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

#[test]
fn lanterns_of_the_forest_hang_above_the_ground() {
    let forest = find("forest").unwrap();
    let shot: toml::Table = forest.shot.parse().unwrap();
    let lanterns = shot["light"].as_array().unwrap();
    assert_eq!(lanterns.len(), 80);
    let scene = forest.build();
    let is_ground = |mesh: &&Mesh| scene.materials[mesh.material].name == "forest floor";
    let ground = scene.meshes.iter().find(is_ground).unwrap();
    for lantern in lanterns {
        let position: Vec<f32> =
            lantern["position"].as_array().unwrap().iter().map(|v| v.as_float().unwrap() as f32).collect();
        let (at, y) = (Vec2::new(position[0], position[2]), position[1]);
        let height = ground.triangles.iter().find_map(|t| height_in(t.map(|i| ground.positions[i as usize]), at));
        assert!(y > height.unwrap() + 0.3, "{position:?} above {height:?}");
        assert!((0.3..=3.0).contains(&lantern["intensity"].as_float().unwrap()));
    }
}

/// Returns the height of a triangle at a point of the x-z plane; `None` outside it.
fn height_in(corners: [Vec3; 3], at: Vec2) -> Option<f32> {
    let [a, b, c] = corners.map(|p| Vec2::new(p.x, p.z));
    let area = (b - a).perp_dot(c - a);
    let weights = [(b, c), (c, a), (a, b)].map(|(from, to)| (to - from).perp_dot(at - from) / area);
    let is_inside = weights.iter().all(|w| *w >= 0.0);
    is_inside.then(|| corners.iter().zip(weights).map(|(p, w)| p.y * w).sum())
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(bytes).unwrap();
    gzip.finish().unwrap()
}

#[test]
fn embedded_files_are_plain_glb_below_the_limit() {
    let files = BUILTINS.iter().filter_map(|b| match b.content {
        Content::File(compressed) => Some((b.name, compressed)),
        Content::Code(_) => None,
    });
    assert_eq!(files.clone().count(), BUILTINS.len() - 1);
    for (name, compressed) in files {
        let scene = read(name, compressed).unwrap();
        assert_eq!((scene.name.as_str(), scene.motion.is_empty()), (name, true));
        let mut bytes = Vec::new();
        GzDecoder::new(compressed).read_to_end(&mut bytes).unwrap();
        assert!(bytes.starts_with(b"glTF") && (bytes.len() as u64) < MAX_BYTES / 2, "{name}");
    }
}

#[test]
fn rejects_damaged_and_oversized_files() {
    let Content::File(cornell) = find("cornell").unwrap().content else { panic!("cornell is a file") };
    let mut damaged = cornell.to_vec();
    damaged[cornell.len() / 2] ^= 1;
    for bytes in [&damaged, &cornell[..cornell.len() - 4], b"glTF", b""] {
        assert!(matches!(read("cornell", bytes), Err(SceneError::Read { .. })));
    }
    let endless = gzip(&vec![b' '; 2 * MAX_BYTES as usize]);
    assert!(matches!(read("endless", &endless), Err(SceneError::Invalid { .. })));
}

#[test]
fn embedded_file_reads_no_other_file() {
    let here = concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml");
    for uri in ["Cargo.toml", "../Cargo.toml", here] {
        assert!(uri.starts_with("..") || std::path::Path::new(uri).exists());
        let file = json!({
            "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
            "buffers": [{ "uri": uri, "byteLength": 36 }], "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        });
        let error = read("curious", &gzip(file.to_string().as_bytes())).unwrap_err();
        assert!(matches!(&error, SceneError::Read { path, .. } if path.ends_with("Cargo.toml")), "{error}");
    }
}
