//! Tests of containers, URIs, versions and extensions.

use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine;
use serde_json::json;

use super::{CORNERS, Draft, assert_mentions, load, read};
use crate::scene::budget::{Budget, ByteSize};
use crate::scene::folder::Access;
use crate::scene::{Scene, SceneError};

#[test]
fn a_glb_gives_its_triangle() {
    let scene = Draft::triangle().scene();
    assert_eq!(scene.triangle_count(), 1);
    assert_eq!(scene.name, "draft");
    assert_eq!(scene.materials.len(), 1);
    assert_eq!(scene.warnings, [] as [&str; 0]);
}

#[test]
fn a_gltf_finds_its_buffer_behind_a_percent_encoded_uri() {
    let folder = tempfile::tempdir().unwrap();
    let mut draft = Draft::triangle();
    fs::create_dir(folder.path().join("my data")).unwrap();
    fs::write(folder.path().join("my data/ä.bin"), &draft.bin).unwrap();
    draft.json["buffers"] = json!([{"byteLength": draft.bin.len(), "uri": "my%20data/%C3%A4.bin"}]);
    let path = folder.path().join("scene.gltf");
    fs::write(&path, draft.json.to_string()).unwrap();
    assert_eq!(load(&path).unwrap().triangle_count(), 1);
}

#[test]
fn a_buffer_may_be_a_data_uri_with_or_without_padding() {
    let mut draft = Draft::triangle();
    let text = base64::engine::general_purpose::STANDARD.encode(&draft.bin);
    for text in [text.as_str(), text.trim_end_matches('=')] {
        let uri = format!("data:application/octet-stream;base64,{text}");
        draft.json["buffers"] = json!([{"byteLength": draft.bin.len(), "uri": uri}]);
        assert_eq!(read(draft.json.to_string().as_bytes()).unwrap().triangle_count(), 1);
    }
    draft.json["buffers"][0]["uri"] = json!("data:;base64,@@@@");
    assert_mentions(&draft.complaint(), &["buffer 0", "base64"]);
}

#[test]
fn missing_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    let error = load(&path).unwrap_err();
    assert!(matches!(error, SceneError::Read { .. }));
    assert_mentions(&error.to_string(), &["scene.gltf"]);

    let mut draft = Draft::triangle();
    draft.json["buffers"] = json!([{"byteLength": draft.bin.len(), "uri": "lost.bin"}]);
    fs::write(&path, draft.json.to_string()).unwrap();
    let error = load(&path).unwrap_err();
    assert!(matches!(error, SceneError::Read { .. }));
    assert_mentions(&error.to_string(), &["lost.bin"]);
}

#[test]
fn a_folder_is_no_scene() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(load(folder.path()), Err(SceneError::Read { .. })));
}

#[test]
fn remote_and_short_buffers_are_refused() {
    let mut draft = Draft::triangle();
    draft.json["buffers"] = json!([{"byteLength": 42, "uri": "https://example.com/a.bin"}]);
    assert_mentions(&draft.complaint(), &["buffer 0", "https://example.com/a.bin"]);
    draft.json["buffers"] = json!([{"byteLength": 1_000_000_000_000u64}]);
    assert_mentions(&draft.complaint(), &["buffer 0", "1000000000000"]);
}

#[test]
fn truncation_is_recognised() {
    let glb = Draft::triangle().glb();
    for length in [0, 3, 11, 15, 40, glb.len() - 1] {
        assert!(matches!(read(&glb[..length]), Err(SceneError::Invalid { .. })), "{length}");
    }
    assert_mentions(&read(&glb[..glb.len() - 1]).unwrap_err().to_string(), &["cut short"]);
}

#[test]
fn broken_json_is_located() {
    assert_mentions(&read(b"{\"asset\": {").unwrap_err().to_string(), &["JSON", "line 1"]);
}

#[test]
fn other_versions_are_refused() {
    let mut draft = Draft::triangle();
    draft.json["asset"] = json!({"version": "1.0"});
    assert_mentions(&draft.complaint(), &["version 1.0"]);
    draft.json["asset"] = json!({"version": "2.1", "minVersion": "2.1"});
    assert_mentions(&draft.complaint(), &["version 2.1"]);
}

#[test]
fn required_extensions_are_all_named_with_a_way_out() {
    let mut draft = Draft::triangle();
    draft.json["extensionsRequired"] =
        json!(["KHR_mesh_quantization", "EXT_lights_ies", "MSFT_texture_dds", "EXT_made_up"]);
    let error = draft.read().unwrap_err();
    assert!(matches!(&error, SceneError::Extensions { extensions, .. } if extensions.len() == 3));
    let text = error.to_string();
    assert_mentions(&text, &["EXT_lights_ies", "MSFT_texture_dds", "EXT_made_up", "PNG or JPEG"]);
}

#[test]
fn optional_extensions_are_warned_of_once() {
    let mut draft = Draft::triangle();
    draft.json["extensionsUsed"] = json!(["EXT_lights_ies", "KHR_lights_punctual", "EXT_lights_ies", "KHR_xmp"]);
    let warnings = draft.scene().warnings;
    assert_eq!(warnings.len(), 1);
    assert_mentions(&warnings[0], &["EXT_lights_ies"]);
}

#[test]
fn a_byte_order_mark_is_passed_over() {
    let mut draft = Draft::triangle();
    let text = base64::engine::general_purpose::STANDARD.encode(bytemuck::cast_slice::<f32, u8>(&CORNERS));
    draft.json["buffers"] = json!([{"byteLength": 36, "uri": format!("data:;base64,{text}")}]);
    draft.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    let text = format!("\u{FEFF}{}", draft.json);
    assert_eq!(read(text.as_bytes()).unwrap().triangle_count(), 1);
}

#[test]
fn scenes_without_nodes_and_animations_of_pointers_are_read() {
    let mut draft = Draft::triangle();
    draft.push("scenes", json!({"name": "Empty"}));
    let target = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/nodes/0"}}});
    draft.push("animations", json!({"samplers": [], "channels": [{"sampler": 0, "target": target}]}));
    draft.json["extras"] = json!({"tool": ["a", 1]});
    let scene = draft.scene();
    assert_eq!((scene.triangle_count(), scene.warnings.len()), (1, 1));
    assert_mentions(&scene.warnings[0], &["animations of /nodes/0 are left out", "animation 0 channel 0"]);
    draft.json["scene"] = json!(1);
    assert_eq!(draft.scene().triangle_count(), 0);
}

/// Returns a triangle whose buffer is a file of `length` bytes, named by `count` buffers.
fn of_one_file(folder: &Path, length: usize, count: usize) -> (PathBuf, Draft) {
    let mut draft = Draft::triangle();
    let mut bytes = draft.bin.clone();
    bytes.resize(length, 0);
    fs::write(folder.join("a.bin"), bytes).unwrap();
    draft.json["buffers"] = vec![json!({"byteLength": length, "uri": "a.bin"}); count].into();
    (folder.join("scene.gltf"), draft)
}

fn load_within(path: &Path, draft: &Draft, bytes: u64) -> Result<Scene, SceneError> {
    fs::write(path, draft.json.to_string()).unwrap();
    let budget = Budget::new(ByteSize(bytes));
    crate::scene::gltf::load(path, Access::of(&budget))
}

#[test]
fn a_file_is_read_once_however_many_buffers_name_it() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut draft) = of_one_file(folder.path(), 8 << 20, 1000);
    draft.json["buffers"][1]["uri"] = json!("./a.bin");
    draft.json["bufferViews"][1]["buffer"] = json!(1);
    assert_eq!(load_within(&path, &draft, 12 << 20).unwrap().triangle_count(), 1);
    let error = load_within(&path, &draft, 8 << 20).unwrap_err();
    assert!(matches!(error, SceneError::Refused { .. }));
    assert_mentions(&error.to_string(), &["scene.gltf", "buffer 0", "8.0 MiB", "raise the limit"]);
}

#[test]
fn buffers_that_nothing_in_use_needs_are_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut draft) = of_one_file(folder.path(), 1024, 3);
    draft.json["buffers"][1]["uri"] = json!("lost.bin");
    draft.json["buffers"][2]["uri"] = json!("../outside.bin");
    assert_eq!(load_within(&path, &draft, 1 << 20).unwrap().triangle_count(), 1);
    draft.json["bufferViews"][1]["buffer"] = json!(1);
    assert_mentions(&load_within(&path, &draft, 1 << 20).unwrap_err().to_string(), &["lost.bin"]);
    draft.json["bufferViews"][1]["buffer"] = json!(2);
    let error = load_within(&path, &draft, 1 << 20).unwrap_err().to_string();
    assert_mentions(&error, &["scene.gltf", "buffer 2", "'../outside.bin'", "allow files outside"]);
}
