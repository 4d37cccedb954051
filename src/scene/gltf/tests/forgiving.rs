//! Files that break the specification slightly, and extensions that hide, repeat and repaint meshes.

use glam::Vec3;
use serde_json::json;

use super::{CORNERS, Draft, F32, assert_mentions, read_variant};
use crate::scene::Scene;

#[test]
fn incomplete_triangles_are_omitted_with_a_warning() {
    let mut draft = Draft::empty();
    let positions = draft.floats("VEC3", &[&CORNERS[..], &CORNERS[..6]].concat());
    draft.primitive(json!({"attributes": {"POSITION": positions}}));
    let scene = draft.scene();
    assert_eq!((scene.triangle_count(), scene.meshes[0].positions.len()), (1, 3));
    assert_mentions(&scene.warnings[0], &["last whole triangle", "mesh 0"]);

    let indices = draft.packed(super::U16, "SCALAR", 4, &[0, 0, 1, 0, 2, 0, 1, 0]);
    draft.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let scene = draft.scene();
    assert_eq!((scene.triangle_count(), scene.meshes[0].positions.len()), (1, 3));
    assert_mentions(&scene.warnings[0], &["last whole triangle", "mesh 0"]);
}

#[test]
fn almost_affine_matrix_is_accepted() {
    let with = |last: f32| {
        let mut draft = Draft::triangle();
        draft.json["nodes"][0]["matrix"] = json!([1, 0, 0, last, 0, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1.0 + last]);
        draft
    };
    assert_eq!(with(9e-4).scene().bounds().min.x, 5.0);
    assert_mentions(&with(2e-3).complaint(), &["not affine"]);
}

#[test]
fn missing_scene_falls_back_to_the_first() {
    let mut draft = Draft::triangle();
    draft.json["scene"] = json!(3);
    let scene = draft.scene();
    assert_eq!(scene.triangle_count(), 1);
    assert_mentions(&scene.warnings[0], &["scene 3", "first"]);
    draft.json["scenes"] = json!([]);
    let scene = draft.scene();
    assert_eq!(scene.triangle_count(), 1);
    assert_mentions(&scene.warnings[0], &["scene 3", "all nodes"]);
}

#[test]
fn hidden_nodes_and_their_children_are_omitted() {
    let shown = |visible: bool| {
        let mut draft = Draft::triangle();
        draft.json["extensionsRequired"] = json!(["KHR_node_visibility"]);
        let hidden = json!({"KHR_node_visibility": {"visible": visible}});
        let light = json!({"KHR_lights_punctual": {"light": 0}});
        draft.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
        draft.json["nodes"] = json!([{"children": [1, 2], "extensions": hidden}, {"mesh": 0}, {"extensions": light}]);
        let scene = draft.scene();
        (scene.instances.len(), scene.lights.len(), scene.warnings.len())
    };
    assert_eq!((shown(true), shown(false)), ((1, 1, 0), (0, 0, 0)));
}

/// Returns a triangle with two instances, of which the second is turned by 180 degrees around y and twice as large.
fn instanced() -> Draft {
    let mut draft = Draft::triangle();
    let translation = draft.floats("VEC3", &[0.0, 0.0, 0.0, 10.0, 0.0, 0.0]);
    let rotation = draft.packed(F32, "VEC4", 2, bytemuck::cast_slice(&[0.0f32, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0]));
    let scale = draft.floats("VEC3", &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    let attributes = json!({"TRANSLATION": translation, "ROTATION": rotation, "SCALE": scale});
    draft.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
    draft.json["nodes"][0]["translation"] = json!([0, 5, 0]);
    draft.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    draft
}

#[test]
fn instances_of_a_node_are_placed() {
    let scene = instanced().scene();
    assert_eq!((scene.instances.len(), scene.meshes.len(), scene.warnings.len()), (2, 1, 0));
    let at = |i: usize, p: Vec3| scene.instances[i].world_from_local.transform_point3(p);
    assert!(at(0, Vec3::X).abs_diff_eq(Vec3::new(1.0, 5.0, 0.0), 1e-5));
    assert!(at(1, Vec3::X).abs_diff_eq(Vec3::new(8.0, 5.0, 0.0), 1e-5), "{}", at(1, Vec3::X));
}

#[test]
fn instances_are_counted_by_any_attribute() {
    let mut draft = instanced();
    let ids = draft.floats("SCALAR", &[7.0, 8.0, 9.0]);
    let extension = |draft: &mut Draft, attributes| {
        draft.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"] = json!({"attributes": attributes});
    };
    extension(&mut draft, json!({"_ID": ids}));
    let scene = draft.scene();
    assert_eq!((scene.instances.len(), scene.warnings.len()), (3, 0));
    assert_eq!(scene.instances[2].world_from_local.translation, glam::Vec3A::new(0.0, 5.0, 0.0));
    extension(&mut draft, json!({"_ID": ids, "SCALE": ids - 1}));
    assert_mentions(&draft.complaint(), &["node 0", "different counts"]);
    extension(&mut draft, json!({"_ID": 99}));
    assert_mentions(&draft.complaint(), &["node 0", "_ID", "accessor 99"]);
}

#[test]
fn rejects_damaged_instances() {
    for (name, value, says) in [
        ("SCALE", json!(0), "different counts"),
        ("ROTATION", json!(0), "4 components"),
        ("TRANSLATION", json!(99), "accessor 99"),
        ("TRANSLATION", json!("x"), "number of an accessor"),
    ] {
        let mut draft = instanced();
        draft.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"][name] = value;
        assert_mentions(&draft.complaint(), &["node 0", "EXT_mesh_gpu_instancing", says]);
    }
}

#[test]
fn variant_replaces_mapped_materials() {
    let mut draft = Draft::triangle();
    draft.json["extensionsRequired"] = json!(["KHR_materials_variants"]);
    draft.json["extensions"] = json!({"KHR_materials_variants": {"variants": [{"name": "day"}, {"name": "night"}]}});
    draft.json["materials"] = json!([{"name": "plain"}, {"name": "dark"}]);
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let mappings = json!([{"material": 1, "variants": [1]}]);
    draft.json["meshes"][0]["primitives"][0]["extensions"] = json!({"KHR_materials_variants": {"mappings": mappings}});
    let name = |scene: &Scene| scene.materials[scene.meshes[0].material].name.clone();
    let seen = |draft: &Draft, variant: Option<&str>| read_variant(&draft.glb(), variant).map(|scene| name(&scene));
    assert_eq!(name(&draft.scene()), "plain");
    assert_eq!(seen(&draft, Some("day")).unwrap(), "plain");
    assert_eq!(seen(&draft, Some("night")).unwrap(), "dark");
    let error = format!("{:?}", seen(&draft, Some("dusk")).unwrap_err());
    assert_mentions(&error, &["'dusk'", "day, night"]);
    draft.json["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] =
        json!(9);
    assert_mentions(&format!("{:?}", seen(&draft, Some("night")).unwrap_err()), &["material 9"]);
}
