//! Tests of nodes and their transforms.

use glam::{Affine3A, Quat, Vec3};
use serde_json::{Value, json};

use super::{Draft, assert_mentions};

fn with_nodes(nodes: Value) -> Draft {
    let mut draft = Draft::triangle();
    draft.json["nodes"] = nodes;
    draft
}

#[test]
fn transforms_accumulate_from_the_root() {
    let turn = Quat::from_rotation_y(0.7);
    let draft = with_nodes(json!([
        {"children": [1], "translation": [1, 2, 3], "rotation": turn.to_array(), "scale": [2, 2, 2]},
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 4, 5, 6, 1]},
    ]));
    let expected = Affine3A::from_scale_rotation_translation(Vec3::splat(2.0), turn, Vec3::new(1.0, 2.0, 3.0))
        * Affine3A::from_translation(Vec3::new(4.0, 5.0, 6.0))
        * Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0));
    let found = draft.scene().instances[0].world_from_local;
    assert!(found.abs_diff_eq(expected, 1e-5), "{found:?} {expected:?}");
}

#[test]
fn hierarchy_of_100000_levels_loads() {
    const DEPTH: usize = 100_000;
    let mut nodes: Vec<Value> =
        (1..DEPTH).map(|child| json!({"children": [child], "translation": [0.5, 0, 0]})).collect();
    nodes.push(json!({"mesh": 0}));
    let scene = with_nodes(Value::Array(nodes)).scene();
    assert_eq!(scene.instances[0].world_from_local.translation.x, (DEPTH - 1) as f32 * 0.5);
}

#[test]
fn rejects_cycles_and_second_parents() {
    assert_mentions(&with_nodes(json!([{"children": [0]}])).complaint(), &["node 0", "its own ancestor"]);
    let far = json!([{"mesh": 0}, {"children": [2]}, {"children": [1, 3]}, {}]);
    assert_mentions(&with_nodes(far).complaint(), &["its own ancestor"]);
    let shared = json!([{"children": [1, 2]}, {"children": [2]}, {"name": "Wheel", "mesh": 0}]);
    assert_mentions(&with_nodes(shared).complaint(), &["node 2 'Wheel'", "one parent"]);
    let mut twice = Draft::triangle();
    twice.json["scenes"][0]["nodes"] = json!([0, 0]);
    assert_mentions(&twice.complaint(), &["node 0", "twice"]);
}

#[test]
fn rejects_missing_nodes() {
    assert_mentions(&with_nodes(json!([{"children": [4]}])).complaint(), &["node 0", "node 4"]);
    let mut draft = Draft::triangle();
    draft.json["scenes"][0]["nodes"] = json!([2]);
    assert_mentions(&draft.complaint(), &["node 2"]);
}

#[test]
fn only_the_default_scene_is_loaded() {
    let mut draft = with_nodes(json!([{"mesh": 0}, {"mesh": 0, "translation": [9, 0, 0]}, {"mesh": 0}]));
    draft.json["scenes"] = json!([{"nodes": [0]}, {"nodes": [1]}]);
    draft.json["scene"] = json!(1);
    assert_eq!(draft.scene().bounds().min, Vec3::new(9.0, 0.0, 0.0));
    draft.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(draft.scene().bounds().min, Vec3::ZERO);
    draft.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(draft.scene().instances.len(), 3);
}

#[test]
fn rejects_impossible_transforms() {
    let projective = json!([{"matrix": [1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]);
    assert_mentions(&with_nodes(projective).complaint(), &["node 0", "affine"]);
    assert_mentions(&with_nodes(json!([{"rotation": [0, 0, 0, 0]}])).complaint(), &["node 0", "rotation"]);
    let vast = json!([{"children": [1], "scale": [1e30, 1, 1]}, {"scale": [1e30, 1, 1], "mesh": 0}]);
    assert_mentions(&with_nodes(vast).complaint(), &["node 1", "not finite"]);
}
