//! Tests of tangents, from the file and generated.

use std::f32::consts::FRAC_PI_2;

use glam::{Vec2, Vec3, Vec4};
use serde_json::json;

use super::damaged::Random;
use super::materials::with_texture;
use super::{Draft, U8, assert_mentions};
use crate::scene::Mesh;

/// Returns two triangles in the plane z = 0 that face +z, with `uvs` for the corners (0, 0), (1, 0), (1, 1) and (0, 1).
fn quad(uvs: [f32; 8]) -> Draft {
    let mut draft = with_texture(json!({"normalTexture": {"index": 0}}));
    let positions = draft.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]);
    let normals = draft.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let uvs = draft.floats("VEC2", &uvs);
    let indices = draft.packed(U8, "SCALAR", 6, &[0, 1, 2, 0, 2, 3]);
    draft.json["meshes"][0]["primitives"] = json!([{
        "attributes": {"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs},
        "indices": indices,
        "material": 0,
    }]);
    draft
}

/// Texture coordinates of an upright image: its top is at y = 1.
const UPRIGHT: [f32; 8] = [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0];

#[track_caller]
fn assert_all(mesh: &Mesh, expected: Vec4) {
    assert_eq!(mesh.tangents.len(), mesh.positions.len());
    for tangent in &mesh.tangents {
        assert!(tangent.distance(expected) < 1e-6, "{tangent} is not {expected}");
    }
}

#[test]
fn tangents_run_along_u_and_bitangents_up_the_image() {
    let upright = quad(UPRIGHT).scene();
    assert!(upright.warnings.is_empty(), "{:?}", upright.warnings);
    assert_eq!((upright.meshes[0].positions.len(), upright.triangle_count()), (4, 2));
    assert_all(&upright.meshes[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
    let mirrored = UPRIGHT.chunks(2).flat_map(|uv| [1.0 - uv[0], uv[1]]).collect::<Vec<_>>();
    let mirrored = quad(mirrored.try_into().unwrap()).scene();
    // u points towards -x, yet up the image is +y, so the bitangent is minus the cross product of normal and tangent.
    assert_all(&mirrored.meshes[0], Vec4::new(-1.0, 0.0, 0.0, -1.0));
    let turned = UPRIGHT.chunks(2).flat_map(|uv| [1.0 - uv[1], uv[0]]).collect::<Vec<_>>();
    let turned = quad(turned.try_into().unwrap()).scene();
    assert_all(&turned.meshes[0], Vec4::new(0.0, 1.0, 0.0, 1.0));
}

#[test]
fn anisotropy_uses_tangents_of_texture_or_file() {
    let mut draft = quad(UPRIGHT);
    draft.json["materials"][0].as_object_mut().unwrap().remove("normalTexture");
    let name = "KHR_materials_anisotropy";
    draft.json["extensionsUsed"] = json!([name, "KHR_texture_transform"]);
    draft.json["materials"][0]["extensions"] = json!({name: {"anisotropyStrength": 0.5}});
    assert_all(&draft.scene().meshes[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
    let mirrored = json!({"index": 0, "extensions": {"KHR_texture_transform": {"scale": [-2, 2]}}});
    draft.json["materials"][0]["extensions"][name]["anisotropyTexture"] = mirrored;
    assert_all(&draft.scene().meshes[0], Vec4::new(-1.0, 0.0, 0.0, -1.0));
    let tangents = draft.floats("VEC4", &[0.0, 1.0, 0.0, 1.0].repeat(4));
    draft.attribute("TANGENT", tangents);
    draft.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
    let scene = draft.scene();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    assert_all(&scene.meshes[0], Vec4::new(0.0, 1.0, 0.0, 1.0));
}

#[test]
fn tangents_follow_the_coordinates_of_their_map() {
    let mut draft = quad(UPRIGHT);
    draft.json["materials"][0]["normalTexture"]["extensions"] = json!({"KHR_texture_transform": {"scale": [-2, 2]}});
    assert_all(&draft.scene().meshes[0], Vec4::new(-1.0, 0.0, 0.0, -1.0));
    // The rotation points u up the image: u decreases towards +y.
    draft.json["materials"][0]["normalTexture"]["extensions"] =
        json!({"KHR_texture_transform": {"rotation": FRAC_PI_2}});
    let mesh = &draft.scene().meshes[0];
    let map = draft.scene().materials[0].normal_map.unwrap().texture.uv_from_uv;
    let along_u = map.matrix2.inverse() * Vec2::X;
    assert_all(mesh, Vec4::new(along_u.x, -along_u.y, 0.0, 1.0));

    let mut second = quad([0.0; 8]);
    let attributes = &mut second.json["meshes"][0]["primitives"][0]["attributes"];
    let uvs = attributes["TEXCOORD_0"].clone();
    attributes["TEXCOORD_1"] = uvs;
    let uvs = second.floats("VEC2", &UPRIGHT);
    second.attribute("TEXCOORD_1", uvs);
    assert_all(&second.scene().meshes[0], Vec4::ZERO);
    second.json["materials"][0]["normalTexture"]["texCoord"] = json!(1);
    assert_all(&second.scene().meshes[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
}

#[test]
fn vertices_are_split_where_the_image_is_mirrored() {
    // A strip of two quads, with the image mirrored along their common edge x = 1.
    let mut draft = with_texture(json!({"normalTexture": {"index": 0}}));
    let positions = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 2.0, 1.0, 0.0];
    let positions = draft.floats("VEC3", &positions);
    let uvs = draft.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]);
    let colors = draft.floats("VEC3", &(0..18).map(|i| i as f32 / 18.0).collect::<Vec<_>>());
    let indices = draft.packed(U8, "SCALAR", 12, &[0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4]);
    let attributes = json!({"POSITION": positions, "TEXCOORD_0": uvs, "COLOR_0": colors});
    draft.json["meshes"][0]["primitives"] = json!([{"attributes": attributes, "indices": indices, "material": 0}]);
    let mesh = &draft.scene().meshes[0];
    assert_eq!((mesh.positions.len(), mesh.uvs[0].len(), mesh.colors.len(), mesh.normals.len()), (8, 8, 8, 0));
    for (i, triangle) in mesh.triangles.iter().enumerate() {
        let expected = if i < 2 { Vec4::new(1.0, 0.0, 0.0, 1.0) } else { Vec4::new(-1.0, 0.0, 0.0, -1.0) };
        for &v in triangle {
            assert!(mesh.tangents[v as usize].distance(expected) < 1e-6);
        }
    }
    // A copy has its original's position and colour.
    for v in 6..8 {
        let original = (0..6).find(|&o| mesh.positions[o] == mesh.positions[v]).unwrap();
        assert_eq!((mesh.uvs[0][v], mesh.colors[v]), (mesh.uvs[0][original], mesh.colors[original]));
    }
}

/// A mesh without tangents has those of its displaced vertices, whatever its targets say.
#[test]
fn morph_targets_have_the_tangents_of_their_shapes() {
    // The first target lifts the right side; the second rotates it out of the plane.
    let lift = [0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0];
    let turn = [0.0, 0.0, 0.0, -0.5, 0.0, 0.5, -0.5, 0.0, 0.5, 0.0, 0.0, 0.0];
    let wrong = [0.0, 0.0, 7.0].repeat(4);
    for has_normals in [true, false] {
        let mut draft = quad(UPRIGHT);
        if !has_normals {
            let attributes = &mut draft.json["meshes"][0]["primitives"][0]["attributes"];
            attributes.as_object_mut().unwrap().remove("NORMAL");
        }
        let targets = [lift, turn].map(|offsets| {
            let [positions, tangents] = [&offsets[..], &wrong[..]].map(|values| draft.floats("VEC3", values));
            json!({"POSITION": positions, "TANGENT": tangents})
        });
        draft.json["meshes"][0]["primitives"][0]["targets"] = json!(targets);
        for weights in [[0.0, 0.0], [1.0, 0.0], [0.25, 0.0], [0.0, 1.0]] {
            draft.json["meshes"][0]["weights"] = json!(weights);
            let [lift, turn] = weights;
            // Tangents are perpendicular to the normals of the file, which do not change.
            let out = if has_normals { 0.0 } else { 0.5 * turn };
            let along_u = Vec3::new(1.0 - 0.5 * turn, 2.0 * lift, out).normalize();
            assert_all(&draft.scene().meshes[0], along_u.extend(1.0));
        }
    }
}

#[test]
fn tangents_of_the_file_are_kept_if_a_map_needs_them() {
    let mut draft = quad(UPRIGHT);
    let tangent = [0.0, 2.0, 0.0, -1.0];
    let tangents = draft.floats("VEC4", &tangent.repeat(4));
    draft.attribute("TANGENT", tangents);
    assert_all(&draft.scene().meshes[0], Vec4::new(0.0, 1.0, 0.0, -1.0));
    let bytes: [u8; 4] = [0, 127, 0, 0x81];
    let quantized = draft.packed(5120, "VEC4", 4, &bytes.repeat(4));
    let mut other = draft.clone();
    other.attribute("TANGENT", quantized);
    assert_all(&other.scene().meshes[0], Vec4::new(0.0, 1.0, 0.0, -1.0));

    // Without normals, tangents must be ignored.
    let mut flat = draft.clone();
    let attributes = &mut flat.json["meshes"][0]["primitives"][0]["attributes"];
    attributes.as_object_mut().unwrap().remove("NORMAL");
    assert_all(&flat.scene().meshes[0], Vec4::new(1.0, 0.0, 0.0, 1.0));

    draft.json["materials"][0] = json!({});
    assert!(draft.scene().meshes[0].tangents.is_empty());
}

#[test]
fn broken_tangents_are_zero_or_named() {
    let mut draft = quad(UPRIGHT);
    let mut tangents = [1.0, 0.0, 0.0, 1.0].repeat(4);
    tangents[4] = f32::NAN;
    tangents[8] = 0.0;
    tangents[15] = 0.0;
    let tangents = draft.floats("VEC4", &tangents);
    draft.attribute("TANGENT", tangents);
    let scene = draft.scene();
    assert_eq!(scene.meshes[0].tangents, [Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::ZERO, Vec4::ZERO, Vec4::ZERO]);
    assert_eq!(scene.warnings.len(), 1);
    assert_mentions(&scene.warnings[0], &["tangents", "mesh 0"]);
    let narrow = draft.floats("VEC3", &[0.0; 12]);
    draft.attribute("TANGENT", narrow);
    assert_mentions(&draft.complaint(), &["TANGENT", "mesh 0"]);
}

#[test]
fn meshes_without_coordinates_lose_their_normal_map() {
    let mut draft = quad(UPRIGHT);
    draft.json["materials"][0]["normalTexture"]["texCoord"] = json!(1);
    draft.push("nodes", json!({"mesh": 0}));
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    let scene = draft.scene();
    assert_all(&scene.meshes[0], Vec4::ZERO);
    assert_eq!(scene.warnings.len(), 1);
    assert_mentions(&scene.warnings[0], &["normal maps", "mesh 0"]);
}

#[test]
fn degenerate_triangles_have_sane_tangents() {
    let mut draft = quad(UPRIGHT);
    let indices = draft.packed(U8, "SCALAR", 9, &[1, 1, 2, 0, 1, 2, 0, 2, 3]);
    draft.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    assert_all(&draft.scene().meshes[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
    for uvs in [[0.5; 8], [1e30; 8], [0.0, 3e38, 3e38, 3e38, 3e38, -3e38, -3e38, -3e38]] {
        let mesh = &quad(uvs).scene().meshes[0];
        let sane = |t: &Vec4| *t == Vec4::ZERO || (t.truncate().length() - 1.0).abs() < 1e-5 && t.w.abs() == 1.0;
        assert!(mesh.tangents.len() >= 4 && mesh.tangents.iter().all(sane), "{uvs:?} {:?}", mesh.tangents);
    }
}

/// Returns a fan of `count` triangles around the origin.
fn fan(count: usize) -> Draft {
    let mut draft = with_texture(json!({"normalTexture": {"index": 0}}));
    let point = |i: usize| Vec2::from_angle(i as f32 / count as f32);
    let rim: Vec<Vec2> = (0..=count).map(point).collect();
    let positions: Vec<f32> =
        [Vec3::ZERO].into_iter().chain(rim.iter().map(|p| p.extend(0.0))).flat_map(|p| p.to_array()).collect();
    let uvs: Vec<f32> = [Vec2::ZERO].iter().chain(&rim).flat_map(|p| [p.x, 1.0 - p.y]).collect();
    let positions = draft.floats("VEC3", &positions);
    let uvs = draft.floats("VEC2", &uvs);
    draft.json["meshes"][0]["primitives"] =
        json!([{"attributes": {"POSITION": positions, "TEXCOORD_0": uvs}, "mode": 6, "material": 0}]);
    let normals = draft.floats("VEC3", &[0.0, 0.0, 1.0].repeat(count + 2));
    draft.attribute("NORMAL", normals);
    draft
}

#[test]
fn vast_fans_end_and_are_warned_of() {
    let scene = fan(1000).scene();
    assert!(scene.warnings.is_empty() && scene.meshes[0].tangents.iter().all(|t| *t != Vec4::ZERO));
    let scene = fan(200_000).scene();
    assert_eq!(scene.warnings.len(), 1);
    assert_mentions(&scene.warnings[0], &["normal maps", "mesh 0"]);
    assert_all(&scene.meshes[0], Vec4::ZERO);
}

#[test]
fn tangled_meshes_have_sane_tangents() {
    const VERTICES: usize = 8;
    let mut random = Random(0x2545_F491);
    for case in 0..2000 {
        let mut draft = with_texture(json!({"normalTexture": {"index": 0}}));
        // Few distinct values make vertices and edges coincide.
        let mut few = |count: usize| (0..count).map(|_| random.below(3) as f32 - 1.0).collect::<Vec<_>>();
        let (positions, uvs) = (draft.floats("VEC3", &few(3 * VERTICES)), draft.floats("VEC2", &few(2 * VERTICES)));
        let corners: Vec<u8> = (0..36).map(|_| random.below(VERTICES) as u8).collect();
        let indices = draft.packed(U8, "SCALAR", corners.len(), &corners);
        let attributes = json!({"POSITION": positions, "TEXCOORD_0": uvs});
        draft.json["meshes"][0]["primitives"] = json!([{"attributes": attributes, "indices": indices, "material": 0}]);
        let mesh = &draft.scene().meshes[0];
        let count = mesh.positions.len();
        assert_eq!((mesh.tangents.len(), mesh.uvs[0].len()), (count, count), "case {case}");
        let sane = |t: &Vec4| *t == Vec4::ZERO || (t.truncate().length() - 1.0).abs() < 1e-5 && t.w.abs() == 1.0;
        assert!(mesh.tangents.iter().all(sane), "case {case}");
        // Splitting must not move corners.
        draft.json["materials"][0] = json!({});
        let whole = &draft.scene().meshes[0];
        let corners = |m: &Mesh| m.triangles.iter().map(|t| t.map(|v| m.positions[v as usize])).collect::<Vec<_>>();
        assert_eq!(corners(mesh), corners(whole), "case {case}");
    }
}
