//! Tests of primitives: topologies, attribute formats, and their errors.

use glam::{Vec2, Vec3, Vec4};
use serde_json::json;

use super::{CORNERS, Draft, F32, U8, U16, U32, assert_mentions};

/// Five points of a zigzag.
const ZIGZAG: [f32; 15] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0];

fn with_mode(mode: u32, indices: Option<&[u8]>) -> Vec<[u32; 3]> {
    let mut draft = Draft::empty();
    let positions = draft.floats("VEC3", &ZIGZAG);
    let mut primitive = json!({"attributes": {"POSITION": positions}, "mode": mode});
    if let Some(indices) = indices {
        primitive["indices"] = json!(draft.packed(U8, "SCALAR", indices.len(), indices));
    }
    draft.primitive(primitive);
    draft.scene().meshes.first().map(|m| m.triangles.clone()).unwrap_or_default()
}

#[test]
fn strips_and_fans_keep_their_winding() {
    assert_eq!(with_mode(5, None), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert_eq!(with_mode(6, None), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
    assert_eq!(with_mode(4, Some(&[4, 3, 2, 2, 1, 0])), [[4, 3, 2], [2, 1, 0]]);
    assert_eq!(with_mode(6, Some(&[4, 3, 2])), [[1, 0, 2]]);
}

#[test]
fn strips_jump_over_repeated_vertices() {
    assert_eq!(with_mode(5, Some(&[0, 1, 2, 2, 3, 3, 4, 1])), [[0, 1, 2], [3, 1, 4]]);
}

#[test]
fn points_and_lines_are_left_out_with_one_warning() {
    let mut draft = Draft::triangle();
    for mode in [0, 1, 2, 3] {
        draft.primitive(json!({"attributes": {"POSITION": 0}, "mode": mode}));
    }
    let scene = draft.scene();
    assert_eq!((scene.meshes.len(), scene.instances.len(), scene.warnings.len()), (1, 1, 1));
    assert_mentions(&scene.warnings[0], &["points and lines", "mesh 0 'Thing' primitive 1 and 3 more"]);
}

#[test]
fn meshes_are_shared_by_their_instances() {
    let mut draft = Draft::triangle();
    draft.push("nodes", json!({"mesh": 0, "scale": [-1, 1, 1]}));
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    let scene = draft.scene();
    assert_eq!((scene.meshes.len(), scene.instances.len(), scene.triangle_count()), (1, 2, 2));
    assert!(scene.instances[1].world_from_local.matrix3.determinant() < 0.0);
}

#[test]
fn unused_vertices_are_dropped() {
    let mut draft = Draft::empty();
    let positions = draft.floats("VEC3", &ZIGZAG);
    let colors = draft.packed(U8, "VEC3", 5, &[0, 0, 0, 51, 0, 0, 102, 0, 0, 153, 0, 0, 255, 0, 0]);
    let indices = draft.packed(U8, "SCALAR", 3, &[4, 1, 3]);
    draft.primitive(json!({"attributes": {"POSITION": positions, "COLOR_0": colors}, "indices": indices}));
    let mesh = &draft.scene().meshes[0];
    assert_eq!(mesh.triangles, [[2, 0, 1]]);
    assert_eq!(mesh.positions, [Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::new(0.0, 2.0, 0.0)]);
    assert_eq!(mesh.colors, [0.2, 0.6, 1.0].map(|r| Vec4::new(r, 0.0, 0.0, 1.0)));
}

#[test]
fn quantized_attributes_are_scaled_only_if_normalized() {
    let mut draft = Draft::empty();
    let shorts: [i16; 12] = [0, 0, 0, 0, 32767, -32768, -32767, 0, 7, 7, 7, 0];
    let bytes: &[u8] = bytemuck::cast_slice(&shorts);
    let plain = draft.packed(5122, "VEC3", 3, bytes);
    draft.json["bufferViews"][0]["byteStride"] = json!(8);
    draft.json["accessors"][plain]["count"] = json!(3);
    let mut normalized = draft.json["accessors"][plain].clone();
    normalized["normalized"] = json!(true);
    let normalized = draft.push("accessors", normalized);
    let uvs = draft.packed(U16, "VEC2", 3, bytemuck::cast_slice(&[0u16, 65535, 1, 2, 3, 4]));
    draft.json["accessors"][uvs]["normalized"] = json!(true);
    draft.primitive(json!({"attributes": {"POSITION": plain}}));
    draft.primitive(json!({"attributes": {"POSITION": normalized, "TEXCOORD_1": uvs}}));
    let meshes = draft.scene().meshes;
    assert_eq!(meshes[0].positions[1], Vec3::new(32767.0, -32768.0, -32767.0));
    assert_eq!(meshes[1].positions[1], Vec3::new(1.0, -1.0, -1.0));
    assert!(meshes[1].uvs[0].is_empty());
    assert_eq!(meshes[1].uvs[1][0], Vec2::Y);
}

#[test]
fn signed_bytes_and_wide_indices_are_read() {
    let mut draft = Draft::empty();
    let positions = draft.packed(5120, "VEC3", 3, &[0, 0, 0, 0, 0x80, 0x7F, 1, 0, 1, 2, 3, 0]);
    draft.json["bufferViews"][0]["byteStride"] = json!(4);
    let indices = draft.packed(U32, "SCALAR", 3, bytemuck::cast_slice(&[2u32, 1, 0]));
    draft.primitive(json!({"attributes": {"POSITION": positions}, "indices": indices}));
    let mesh = &draft.scene().meshes[0];
    assert_eq!(mesh.positions[1], Vec3::new(-128.0, 127.0, 1.0));
    assert_eq!(mesh.triangles, [[2, 1, 0]]);
}

#[test]
fn sparse_elements_replace_base_values() {
    let mut draft = Draft::triangle();
    let indices = draft.view(&[1, 2]);
    let values = draft.view(bytemuck::cast_slice(&[5.0f32, 6.0, 7.0, 0.0, 3.0, 0.0]));
    let sparse = json!({
        "count": 2,
        "indices": {"bufferView": indices, "componentType": U8},
        "values": {"bufferView": values},
    });
    draft.json["accessors"][0]["sparse"] = sparse.clone();
    let expected = [Vec3::ZERO, Vec3::new(5.0, 6.0, 7.0), Vec3::new(0.0, 3.0, 0.0)];
    assert_eq!(draft.scene().meshes[0].positions, expected);
    draft.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    assert_eq!(draft.scene().meshes[0].positions, expected);

    draft.json["accessors"][0]["count"] = json!(2);
    assert_mentions(&draft.complaint(), &["POSITION", "accessor 0", "sparse"]);
}

#[test]
fn normals_become_unit_and_broken_ones_fall_back() {
    let mut draft = Draft::triangle();
    let normals = draft.floats("VEC3", &[0.0, 3.0, 0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0]);
    draft.attribute("NORMAL", normals);
    let scene = draft.scene();
    assert_eq!(scene.meshes[0].normals, [Vec3::Y, Vec3::Z, Vec3::Z]);
    assert_eq!(scene.warnings.len(), 1);

    let zeros = draft.floats("VEC3", &[0.0; 9]);
    draft.attribute("NORMAL", zeros);
    let scene = draft.scene();
    assert!(scene.meshes[0].normals.is_empty());
    assert_eq!(scene.warnings.len(), 1);
}

#[test]
fn normals_of_any_length_keep_their_direction() {
    let mut draft = Draft::triangle();
    let normals = draft.floats("VEC3", &[1e-40, 0.0, 0.0, 0.0, 3e38, 0.0, 0.0, 0.0, -1e-30]);
    draft.attribute("NORMAL", normals);
    let normals = &draft.scene().meshes[0].normals;
    for (normal, expected) in normals.iter().zip([Vec3::X, Vec3::Y, Vec3::NEG_Z]) {
        assert!(normal.distance(expected) < 1e-6, "{normal}");
    }
}

#[test]
fn colours_of_three_components_are_opaque_and_clamped() {
    let mut draft = Draft::triangle();
    let colors = draft.floats("VEC3", &[0.5, 2.0, -1.0, 0.0, 0.0, 0.0, f32::INFINITY, 0.0, 0.0]);
    draft.attribute("COLOR_0", colors);
    let scene = draft.scene();
    assert_eq!(scene.meshes[0].colors, [Vec4::new(0.5, 1.0, 0.0, 1.0), Vec4::W, Vec4::ONE]);
    assert_eq!(scene.warnings.len(), 1);
}

#[test]
fn rejects_bad_accessors() {
    let cases = [
        ("/accessors/0/count", json!(4), &["mesh 0 'Thing' primitive 0", "POSITION", "accessor 0"][..]),
        ("/accessors/0/count", json!(u64::MAX), &["POSITION", "accessor 0"]),
        ("/accessors/0/count", json!(4_000_000_000u32), &["POSITION", "accessor 0"]),
        ("/accessors/0/byteOffset", json!(u64::MAX), &["accessor 0"]),
        ("/accessors/0/byteOffset", json!(1), &["accessor 0"]),
        ("/accessors/0/bufferView", json!(9), &["accessor 0", "buffer view 9"]),
        ("/accessors/0/componentType", json!(7), &["accessor 0", "componentType"]),
        ("/accessors/0/type", json!("MAT3"), &["accessor 0", "Mat3"]),
        ("/accessors/0/type", json!("VEC2"), &["POSITION", "accessor 0"]),
        ("/bufferViews/0/byteStride", json!(4), &["accessor 0", "stride of 4"]),
        ("/bufferViews/0/byteStride", json!(0), &["accessor 0", "stride of 0"]),
        ("/bufferViews/0/byteStride", json!(u64::MAX), &["accessor 0"]),
        ("/bufferViews/0/byteLength", json!(u64::MAX), &["buffer view 0", "buffer 0"]),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), &["buffer view 0", "buffer 0"]),
        ("/bufferViews/0/buffer", json!(3), &["buffer view 0", "buffer 3"]),
        ("/accessors/1/componentType", json!(F32), &["indices", "accessor 1"]),
        ("/meshes/0/primitives/0/indices", json!(5), &["indices", "accessor 5"]),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(5), &["POSITION", "accessor 5"]),
        ("/meshes/0/primitives/0/material", json!(0), &["mesh 0", "material 0"]),
        ("/nodes/0/mesh", json!(1), &["node 0", "mesh 1"]),
    ];
    for (pointer, value, words) in cases {
        let mut draft = Draft::triangle();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        draft.json.pointer_mut(parent).unwrap()[key] = value;
        assert_mentions(&draft.complaint(), words);
    }
}

#[test]
fn rejects_indices_beyond_the_vertices() {
    let mut draft = Draft::triangle();
    let indices = draft.packed(U8, "SCALAR", 3, &[0, 1, 3]);
    draft.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    assert_mentions(&draft.complaint(), &["mesh 0 'Thing' primitive 0", "accessor 2", "vertex 3"]);
}

#[test]
fn rejects_non_finite_positions() {
    for bad in [f32::NAN, f32::INFINITY] {
        let mut corners = CORNERS;
        corners[4] = bad;
        let mut draft = Draft::empty();
        let positions = draft.floats("VEC3", &corners);
        draft.primitive(json!({"attributes": {"POSITION": positions}}));
        assert_mentions(&draft.complaint(), &["mesh 0 'Thing' primitive 0", "POSITION of vertex 1"]);
    }
}

#[test]
fn rejects_attributes_of_other_lengths() {
    let mut draft = Draft::triangle();
    let uvs = draft.floats("VEC2", &[0.0; 4]);
    draft.attribute("TEXCOORD_0", uvs);
    assert_mentions(&draft.complaint(), &["mesh 0", "TEXCOORD_0", "2 elements for 3 vertices"]);
}

#[test]
fn rejects_huge_counts_without_data() {
    let mut draft = Draft::empty();
    draft.push("accessors", json!({"componentType": F32, "count": 3_000_000_000u32, "type": "VEC3"}));
    draft.primitive(json!({"attributes": {"POSITION": 0}}));
    assert_mentions(&draft.complaint(), &["accessor 0", "3000000000"]);
}
