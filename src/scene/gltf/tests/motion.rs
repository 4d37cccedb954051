//! Tests of animations, skins and morph targets.

use glam::{Affine3A, Mat4, Vec3};
use serde_json::{Value, json};

use super::{CORNERS, Draft, F32, U8, U16, any, assert_mentions};
use crate::scene::budget::{Budget, ByteSize};
use crate::scene::motion::Influence;
use crate::scene::motion::play::{Choice, Move, MoveKey, Moved, Play};
use crate::scene::{LightKind, Scene, SceneError};

/// Returns a triangle on node 1, below node 0.
fn hierarchy() -> Draft {
    let mut draft = Draft::triangle();
    draft.json["nodes"] = json!([{"name": "Base", "children": [1]}, {"name": "Top", "mesh": 0}]);
    draft
}

/// Adds an animation of one channel with linear keys.
fn animate(draft: &mut Draft, name: &str, target: Value, times: &[f32], kind: &str, values: &[f32]) {
    let (input, output) = (draft.floats("SCALAR", times), draft.floats(kind, values));
    let sampler = json!({"input": input, "output": output});
    draft.push(
        "animations",
        json!({"name": name, "samplers": [sampler], "channels": [{"sampler": 0, "target": target}]}),
    );
}

fn rising(draft: &mut Draft, name: &str, node: usize, height: f32) {
    let target = json!({"node": node, "path": "translation"});
    animate(draft, name, target, &[1.0, 3.0], "VEC3", &[0.0, 0.0, 0.0, 0.0, height, 0.0]);
}

fn playing(draft: &Draft, play: &Play) -> Result<Scene, SceneError> {
    let path = std::path::Path::new("draft.glb");
    super::super::parse(&draft.glb(), path, play, None, any(&Budget::unlimited())).map_err(|fault| fault.in_file(path))
}

fn height(scene: &Scene, time_s: f64) -> f32 {
    scene.at(time_s).bounds().min.y
}

#[test]
fn only_nodes_below_an_animated_node_move() {
    let mut draft = hierarchy();
    draft.push("nodes", json!({"mesh": 0, "translation": [5, 0, 0]}));
    draft.json["scenes"][0]["nodes"] = json!([0, 2]);
    rising(&mut draft, "Rise", 0, 4.0);
    let scene = draft.scene();
    assert_eq!(scene.warnings, [""; 0]);
    assert_eq!((scene.motion.nodes.len(), scene.motion.bodies.len()), (2, 1));
    assert_eq!((scene.motion.nodes[1].name.as_str(), scene.motion.nodes[1].parent), ("Top", Some(0)));
    let top = |time_s| scene.at(time_s).instances[0].world_from_local.translation.y;
    assert_eq!([top(0.0), top(1.0), top(2.0), top(2.5), top(5.0)], [0.0, 0.0, 2.0, 3.0, 2.0]);
    let still = scene.at(2.0);
    assert_eq!(still.instances[1].world_from_local, Affine3A::from_translation(Vec3::X * 5.0));

    let still = playing(&draft, &Play { animation: Choice::None, ..Play::default() }).unwrap();
    assert!(still.motion.is_empty() && still.motion.nodes.is_empty());
    let held = playing(&draft, &Play { loops: false, ..Play::default() }).unwrap();
    assert_eq!(held.at(9.0).instances[0].world_from_local.translation.y, 4.0);
}

#[test]
fn animations_are_chosen_by_name() {
    let mut draft = hierarchy();
    rising(&mut draft, "Low", 0, 1.0);
    rising(&mut draft, "High", 0, 8.0);
    rising(&mut draft, "Top", 1, 16.0);
    let chosen = |name: &str| playing(&draft, &Play { animation: Choice::of(name), ..Play::default() });
    assert_eq!(height(&chosen("High").unwrap(), 2.0), 4.0);
    let all = chosen("all").unwrap();
    assert_eq!((height(&all, 2.0), all.motion.animations.len()), (8.5, 2));
    assert_mentions(&all.warnings[0], &["chosen by its name", "Low, High, Top"]);
    assert_mentions(&chosen("Lost").unwrap_err().to_string(), &["draft.glb", "'Lost'", "Low, High, Top"]);
    assert_mentions(
        &playing(&Draft::triangle(), &Play { animation: Choice::of("x"), ..Play::default() }).unwrap_err().to_string(),
        &["none with a name"],
    );
}

#[test]
fn shot_moves_nodes_by_their_names() {
    let mut draft = hierarchy();
    rising(&mut draft, "Rise", 1, 4.0);
    let key = |time_s, y| MoveKey { time_s, position: Some(glam::DVec3::Y * y), ..MoveKey::default() };
    let of = |name: &str| Move { of: Moved::Node(name.into()), keys: vec![key(0.0, 0.0), key(2.0, 10.0)] };
    let play = |name| Play { moves: vec![of(name)], ..Play::default() };
    assert_eq!(height(&playing(&draft, &play("Base")).unwrap(), 1.5), 7.5 + 1.0);
    assert_eq!(height(&playing(&draft, &play("Top")).unwrap(), 1.5), 7.5);
    assert_mentions(&playing(&draft, &play("Lid")).unwrap_err().to_string(), &["no node named 'Lid'"]);
}

/// Returns a triangle skinned to joints on nodes 1 and 2. Vertices 0 and 1 follow the first, vertex 2 the second.
fn skinned(weights: &[u8; 12], joints: &[u8; 12]) -> Draft {
    let mut draft = Draft::triangle();
    draft.json["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [50, 0, 0]}, {"children": [2]}, {"translation": [0, 1, 0]},
    ]);
    draft.json["scenes"][0]["nodes"] = json!([0, 1]);
    let joints = draft.packed(U8, "VEC4", 3, joints);
    let weights = draft.packed(U8, "VEC4", 3, weights);
    draft.json["accessors"][weights]["normalized"] = json!(true);
    draft.attribute("JOINTS_0", joints);
    draft.attribute("WEIGHTS_0", weights);
    let down = Mat4::from_translation(Vec3::NEG_Y);
    let bind: Vec<f32> = [Mat4::IDENTITY, down].iter().flat_map(|m| m.to_cols_array()).collect();
    let view = draft.view(bytemuck::cast_slice(&bind));
    let bind = json!({"bufferView": view, "componentType": F32, "count": 2, "type": "MAT4"});
    let bind = draft.push("accessors", bind);
    draft.push("skins", json!({"joints": [1, 2], "inverseBindMatrices": bind}));
    draft
}

const WEIGHTS: [u8; 12] = [255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0];
const JOINTS: [u8; 12] = [0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0];

#[test]
fn skin_moves_vertices_with_joints_only() {
    let mut draft = skinned(&WEIGHTS, &JOINTS);
    let at_rest = draft.scene();
    assert!(at_rest.motion.is_empty() && at_rest.meshes[0].influences.is_empty() && at_rest.warnings.is_empty());
    assert_eq!(at_rest.at(0.0).bounds().max, Vec3::new(1.0, 1.0, 0.0));

    rising(&mut draft, "Stretch", 2, 3.0);
    let scene = draft.scene();
    assert_eq!((scene.motion.skins.len(), scene.motion.bodies[0].skin), (1, Some(0)));
    assert_eq!(scene.instances[0].world_from_local, Affine3A::IDENTITY);
    let mesh = &scene.at(2.0).meshes[0];
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.5, 0.0)]);
    assert_eq!(scene.motion.joints(&scene.motion.pose(2.0), 0).len(), 2);
    // Adds two skins on one skeleton, and a mesh with both.
    draft.push("skins", json!({"joints": [2, 1]}));
    draft.push("nodes", json!({"mesh": 0, "skin": 1}));
    draft.json["scenes"][0]["nodes"] = json!([0, 1, 3]);
    let scene = draft.scene();
    assert_eq!((scene.motion.skins.len(), scene.meshes.len(), scene.at(2.0).meshes.len()), (2, 1, 2));
}

#[test]
fn weights_are_made_to_sum_to_one() {
    let mut draft = skinned(&[10, 10, 0, 0, 0, 0, 0, 0, 20, 60, 0, 0], &[0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 9, 9]);
    rising(&mut draft, "Stretch", 2, 3.0);
    let scene = draft.scene();
    let percent = |weight: f32| (100.0 * weight).round();
    let of = |i: &Influence| (i.joints[0], percent(i.weights[0]), percent(i.weights[1]));
    let weights: Vec<_> = scene.meshes[0].influences.iter().map(of).collect();
    assert_eq!(weights, [(0, 50.0, 50.0), (1, 100.0, 0.0), (0, 25.0, 75.0)]);
    assert_mentions(&scene.warnings[0], &["without weights", "mesh 0 'Thing' primitive 0"]);
    assert!(scene.meshes[0].influences.iter().all(|i| i.joints[2..] == [0; 6]));
}

#[test]
fn third_set_of_joints_causes_a_warning() {
    let mut draft = skinned(&WEIGHTS, &JOINTS);
    let attributes = draft.json["meshes"][0]["primitives"][0]["attributes"].clone();
    for set in [1, 2] {
        assert_eq!(draft.scene().warnings, [""; 0]);
        for name in ["JOINTS", "WEIGHTS"] {
            draft.attribute(&format!("{name}_{set}"), attributes[format!("{name}_0")].as_u64().unwrap() as usize);
        }
    }
    assert_mentions(&draft.scene().warnings[0], &["joints after the first eight", "mesh 0 'Thing' primitive 0"]);
}

#[test]
fn joints_outside_the_scene_move_its_skins() {
    let inside = skinned(&WEIGHTS, &JOINTS);
    let mut outside = inside.clone();
    outside.json["scenes"][0]["nodes"] = json!([0]);
    let [inside, outside] = [inside, outside].map(|draft| draft.scene());
    assert_eq!(outside.meshes[0].positions, inside.meshes[0].positions);
    assert_eq!((outside.instances.len(), outside.meshes.len()), (inside.instances.len(), inside.meshes.len()));
    assert_mentions(&outside.warnings.join("\n"), &["joints outside the scene", "node 1"]);
}

#[test]
fn rejects_broken_skins() {
    let with = |change: fn(&mut Draft)| {
        let mut draft = skinned(&WEIGHTS, &JOINTS);
        change(&mut draft);
        draft.complaint()
    };
    assert_mentions(&skinned(&WEIGHTS, &[7; 12]).complaint(), &["node 0", "joint 7", "skin 0 has 2"]);
    assert_mentions(&with(|d| d.json["skins"][0]["joints"] = json!([])), &["skin 0", "0 joints"]);
    assert_mentions(&with(|d| d.json["skins"][0]["joints"] = json!([1, 9])), &["skin 0", "node 9"]);
    assert_mentions(&with(|d| d.json["nodes"][0]["skin"] = json!(4)), &["node 0", "skin 4"]);
    assert_mentions(&with(|d| d.json["skins"][0]["joints"] = json!([1, 2, 1])), &["2 matrices for 3 joints"]);
    assert_mentions(&with(|d| d.json["skins"][0]["inverseBindMatrices"] = json!(0)), &["MAT4"]);
    let poke = |draft: &mut Draft, value: f32| {
        let at = draft.bin.len() - 128;
        let bytes = if value == 0.0 { [0; 64].to_vec() } else { value.to_le_bytes().to_vec() };
        draft.bin[at..at + bytes.len()].copy_from_slice(&bytes);
    };
    for (value, says) in [(f32::NAN, "not finite"), (0.0, "not affine")] {
        let mut draft = skinned(&WEIGHTS, &JOINTS);
        poke(&mut draft, value);
        assert_mentions(&draft.complaint(), &["skin 0", "inverse bind matrix 0", says]);
    }
    let mut bare = skinned(&WEIGHTS, &JOINTS);
    bare.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("JOINTS_0");
    assert_mentions(&bare.scene().warnings[0], &["without joints", "node 0"]);
}

/// Returns a triangle whose vertex 1 moves along z and vertex 2 along x, by sparse accessors.
fn morphing() -> Draft {
    let mut draft = Draft::triangle();
    let mut targets = Vec::new();
    for (vertex, offset) in [(1u16, [0.0f32, 0.0, 1.0]), (2, [1.0, 0.0, 0.0])] {
        let indices = draft.view(bytemuck::cast_slice(&[vertex]));
        let values = draft.view(bytemuck::cast_slice(&offset));
        let sparse = json!({
            "count": 1, "indices": {"bufferView": indices, "componentType": U16}, "values": {"bufferView": values},
        });
        let accessor = json!({"componentType": F32, "count": 3, "type": "VEC3", "sparse": sparse});
        targets.push(json!({"POSITION": draft.push("accessors", accessor)}));
    }
    draft.json["meshes"][0]["primitives"][0]["targets"] = targets.into();
    draft
}

#[test]
fn morph_targets_follow_their_weights() {
    let mut draft = morphing();
    assert_eq!(bytemuck::cast_slice::<Vec3, f32>(&draft.scene().meshes[0].positions), CORNERS);
    draft.json["meshes"][0]["weights"] = json!([0.5, 0.0]);
    let rest = draft.scene();
    assert!(rest.motion.is_empty() && rest.meshes[0].morphs.is_empty());
    assert_eq!(rest.meshes[0].positions[1], Vec3::new(1.0, 0.0, 0.5));
    draft.json["nodes"][0]["weights"] = json!([0.0, 2.0]);
    assert_eq!(draft.scene().meshes[0].positions[2], Vec3::new(2.0, 1.0, 0.0));

    let target = json!({"node": 0, "path": "weights"});
    animate(&mut draft, "Talk", target.clone(), &[0.0, 2.0], "SCALAR", &[0.0, 0.0, 1.0, 2.0]);
    let scene = draft.scene();
    assert_eq!(scene.at(1.0).meshes[0].positions, [Vec3::ZERO, Vec3::new(1.0, 0.0, 0.5), Vec3::new(1.0, 1.0, 0.0)]);
    assert_eq!(scene.motion.moves().unwrap().morphing_instances, 1);

    draft.json["nodes"][0]["weights"] = json!([1.0]);
    assert_mentions(&draft.complaint(), &["node 0", "1 weights for 2 morph targets"]);
    let mut wrong = morphing();
    animate(&mut wrong, "", target.clone(), &[0.0, 2.0], "SCALAR", &[0.0, 0.0, 1.0]);
    assert_mentions(&wrong.complaint(), &["animation 0", "2 keys have 3 numbers, not 4"]);
    let mut none = Draft::triangle();
    animate(&mut none, "", target, &[0.0], "SCALAR", &[0.0]);
    assert_mentions(&none.complaint(), &["animation 0", "no morph targets"]);
}

#[test]
fn pointers_reach_materials_lights_and_nodes() {
    let mut draft = hierarchy();
    draft.json["materials"] = json!([{"emissiveFactor": [1, 0.5, 0]}]);
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point", "color": [1, 0, 1]}]}});
    draft.json["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
    let pointer = |text: &str| json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": text}}});
    let strength = "/materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength";
    animate(&mut draft, "", pointer(strength), &[0.0, 1.0], "SCALAR", &[0.0, 8.0]);
    let intensity = "/extensions/KHR_lights_punctual/lights/0/intensity";
    animate(&mut draft, "", pointer(intensity), &[0.0, 1.0], "SCALAR", &[0.0, 6.0]);
    let color = "/materials/0/pbrMetallicRoughness/baseColorFactor";
    animate(&mut draft, "", pointer(color), &[0.0, 1.0], "VEC4", &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    animate(&mut draft, "", pointer("/nodes/0/translation"), &[0.0, 1.0], "VEC3", &[0.0, 0.0, 0.0, 0.0, 2.0, 0.0]);
    animate(&mut draft, "", pointer("/materials/0/alphaCutoff"), &[0.0], "SCALAR", &[0.0]);
    draft.json["extensionsRequired"] = json!(["KHR_animation_pointer", "KHR_lights_punctual"]);
    let scene = draft.scene();
    assert_mentions(&scene.warnings[0], &["/materials/0/alphaCutoff", "animation 4"]);
    let still = scene.at(0.5);
    assert_eq!(still.materials[0].emissive, Vec3::new(4.0, 2.0, 0.0));
    assert_eq!(still.materials[0].base_color.x, 0.5);
    assert_eq!(still.lights[0].strength, Vec3::new(3.0, 0.0, 3.0));
    assert_eq!(still.lights[0].kind, LightKind::Point { position: Vec3::Y, radius: 0.0 });
    assert_eq!(height(&scene, 0.5), 1.0);
    let mut far = hierarchy();
    animate(&mut far, "", pointer("/materials/7/emissiveFactor"), &[0.0], "VEC3", &[0.0; 3]);
    assert_mentions(&far.complaint(), &["animation 0", "material 7"]);
}

#[test]
fn rejects_broken_animations() {
    let with = |times: &[f32], kind: &str, values: &[f32], path: &str, change: fn(&mut Value)| {
        let mut draft = hierarchy();
        animate(&mut draft, "Bad", json!({"node": 0, "path": path}), times, kind, values);
        change(&mut draft.json["animations"][0]);
        draft.complaint()
    };
    let zeros = [0.0; 6];
    let place = ["animation 0 'Bad' channel 0"];
    let mentions = |text: String, says: &str| assert_mentions(&text, &[place[0], says]);
    mentions(with(&[1.0, 0.5], "VEC3", &zeros, "translation", |_| ()), "not later than");
    mentions(with(&[0.0, f32::NAN], "VEC3", &zeros, "translation", |_| ()), "time of key 1");
    mentions(with(&[0.0, 1.0], "VEC3", &[f32::NAN; 6], "translation", |_| ()), "value of key 0");
    mentions(with(&[0.0], "VEC3", &zeros, "translation", |_| ()), "1 keys have 6 numbers, not 3");
    mentions(with(&[0.0, 1.0], "VEC2", &zeros[..4], "scale", |_| ()), "output");
    mentions(with(&[0.0], "VEC4", &zeros[..4], "rotation", |_| ()), "no quaternion");
    mentions(with(&[0.0], "VEC3", &zeros[..3], "colour", |_| ()), "'colour'");
    let set = |text: &'static str| -> fn(&mut Value) {
        match text {
            "sampler" => |a| a["channels"][0]["sampler"] = json!(5),
            "node" => |a| a["channels"][0]["target"]["node"] = json!(5),
            "input" => |a| a["samplers"][0]["input"] = json!(99),
            "spline" => |a| a["samplers"][0]["interpolation"] = json!("CUBICSPLINE"),
            _ => |a| a["samplers"][0]["interpolation"] = json!("NEAREST"),
        }
    };
    for (what, says) in [("sampler", "sampler 5"), ("node", "node 5"), ("input", "accessor 99"), ("spline", "not 18")] {
        mentions(with(&[0.0, 1.0], "VEC3", &zeros, "translation", set(what)), says);
    }
    mentions(with(&[0.0, 1.0], "VEC3", &zeros, "translation", set("")), "'NEAREST'");
    let mut odd = hierarchy();
    odd.json["animations"] = json!([{"channels": [{"sampler": -1, "target": {"path": "scale"}}]}]);
    assert_mentions(&odd.complaint(), &["animation 0 channel 0", "JSON"]);
}

fn channels(scene: &Scene) -> usize {
    scene.motion.animations.iter().map(|animation| animation.channels.len()).sum()
}

#[test]
fn faulty_channels_are_omitted_and_others_play() {
    for (times, says) in [
        (&[-1.0, 1.0][..], "time of key 0 is negative"),
        (&[0.0, 1.0, 1.0], "key 2 is not later"),
        (&[], "at least one key"),
    ] {
        let mut draft = hierarchy();
        rising(&mut draft, "Good", 0, 4.0);
        let values = vec![0.0; 3 * times.len()];
        animate(&mut draft, "Bad", json!({"node": 1, "path": "translation"}), times, "VEC3", &values);
        let scene = draft.scene();
        assert_eq!(scene.triangle_count(), hierarchy().scene().triangle_count());
        assert_eq!(channels(&scene), 1);
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
        assert_mentions(
            &scene.warnings[0],
            &["channels with faults are left out", "animation 1 'Bad' channel 0", says],
        );
        assert_mentions(&draft.complaint(), &["animation 1 'Bad' channel 0", says]);
    }
    let mut draft = hierarchy();
    rising(&mut draft, "Good", 0, 4.0);
    draft.json["animations"].as_array_mut().unwrap().insert(0, json!({"name": 7}));
    draft.json["animations"][1]["channels"].as_array_mut().unwrap().push(json!({"sampler": "first"}));
    draft.json["animations"][1]["samplers"].as_array_mut().unwrap().push(json!([]));
    let scene = draft.scene();
    assert_eq!(channels(&scene), 1);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    let chosen = playing(&draft, &Play { animation: Choice::Named("Good".into()), ..Play::default() });
    assert_eq!(channels(&chosen.unwrap()), 1);
}

#[test]
fn million_keys_load_within_the_budget() {
    let mut draft = hierarchy();
    let count = 1_000_000;
    let times: Vec<f32> = (0..count).map(|i| i as f32 / 64.0).collect();
    animate(&mut draft, "", json!({"node": 0, "path": "translation"}), &times, "VEC3", &vec![1.0; 3 * count]);
    let path = std::path::Path::new("draft.glb");
    let glb = draft.glb();
    let read = |bytes| {
        let budget = Budget::new(ByteSize(bytes));
        super::super::parse(&glb, path, &Play::default(), None, any(&budget)).map_err(|fault| fault.in_file(path))
    };
    assert_eq!(height(&read(64 << 20).unwrap(), 1e6), 1.0);
    assert!(matches!(read(8 << 20), Err(SceneError::Refused { .. })));
}

#[test]
fn vertices_in_use_keep_their_influences() {
    let mut draft = skinned(&WEIGHTS, &JOINTS);
    rising(&mut draft, "Stretch", 2, 3.0);
    // Leaves vertex 0 unused.
    let indices = draft.packed(U16, "SCALAR", 3, &[1, 0, 2, 0, 1, 0]);
    draft.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let mesh = &draft.scene().meshes[0];
    assert_eq!((mesh.positions.len(), mesh.influences.len()), (2, 2));
    assert_eq!((mesh.influences[0].joints[0], mesh.influences[1].joints[0]), (0, 1));
}

/// Writing and reading the static scene of a time gives the same scene.
#[test]
fn baked_scene_round_trips() {
    let mut draft = skinned(&WEIGHTS, &JOINTS);
    rising(&mut draft, "Stretch", 2, 3.0);
    let still = draft.scene().at(1.7);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("baked.glb");
    crate::scene::gltf::write(&path, &still).unwrap();
    let read = super::load(&path).unwrap();
    assert!(read.motion.is_empty());
    for (a, b) in still.instances.iter().zip(&read.instances) {
        assert_eq!(a.world_from_local, b.world_from_local);
        assert_eq!(still.meshes[a.mesh].positions, read.meshes[b.mesh].positions);
        assert_eq!(still.meshes[a.mesh].triangles, read.meshes[b.mesh].triangles);
    }
}
