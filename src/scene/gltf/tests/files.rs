//! Tests of containers, URIs, versions and extensions.

use std::fs;
use std::path::{Path, PathBuf};

use base64::Engine;
use serde_json::json;

use super::{CORNERS, Draft, assert_mentions, load, read};
use crate::scene::budget::{Budget, ByteSize};
use crate::scene::folder::Access;
use crate::scene::motion::play::Play;
use crate::scene::{Scene, SceneError};

#[test]
fn glb_loads_its_triangle() {
    let scene = Draft::triangle().scene();
    assert_eq!(scene.triangle_count(), 1);
    assert_eq!(scene.name, "draft");
    assert_eq!(scene.materials.len(), 1);
    assert_eq!(scene.warnings, [] as [&str; 0]);
}

#[test]
fn gltf_finds_percent_encoded_buffers() {
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
fn data_uris_work_with_or_without_padding() {
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
fn rejects_missing_files_by_name() {
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
fn rejects_a_folder_as_scene() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(load(folder.path()), Err(SceneError::Read { .. })));
}

#[test]
fn rejects_remote_and_short_buffers() {
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
fn rejects_other_versions() {
    let mut draft = Draft::triangle();
    draft.json["asset"] = json!({"version": "1.0"});
    assert_mentions(&draft.complaint(), &["version 1.0"]);
    draft.json["asset"] = json!({"version": "2.1", "minVersion": "2.1"});
    assert_mentions(&draft.complaint(), &["version 2.1"]);
}

#[test]
fn rejects_unknown_required_extensions_by_name() {
    let mut draft = Draft::triangle();
    draft.json["extensionsRequired"] =
        json!(["KHR_mesh_quantization", "EXT_lights_ies", "MSFT_texture_dds", "EXT_made_up"]);
    let error = draft.read().unwrap_err();
    assert!(matches!(&error, SceneError::Extensions { extensions, .. } if extensions.len() == 3));
    let text = error.to_string();
    assert_mentions(&text, &["EXT_lights_ies", "MSFT_texture_dds", "EXT_made_up", "PNG or JPEG"]);
}

#[test]
fn extras_can_have_any_type() {
    fn put(value: &mut serde_json::Value, extras: &serde_json::Value) {
        match value {
            serde_json::Value::Object(object) => {
                object.values_mut().for_each(|part| put(part, extras));
                object.insert("extras".into(), extras.clone());
            }
            serde_json::Value::Array(array) => array.iter_mut().for_each(|part| put(part, extras)),
            _ => {}
        }
    }
    let nested = serde_json::from_str(&("[".repeat(100) + &"]".repeat(100))).unwrap();
    for extras in [json!([1, "a"]), json!("text"), json!(1.5), json!(null), json!(true), json!({"a": {}}), nested] {
        let mut draft = animated();
        // The list of attributes has no extras.
        let attributes = draft.json["meshes"][0]["primitives"][0]["attributes"].take();
        put(&mut draft.json, &extras);
        draft.json["meshes"][0]["primitives"][0]["attributes"] = attributes;
        let scene = draft.scene();
        assert_eq!((scene.triangle_count(), scene.cameras.len(), scene.lights.len()), (1, 1, 1), "{extras}");
        assert!(!scene.motion.is_empty());
    }
}

/// Returns a triangle that moves, with a material, a camera and a light.
fn animated() -> Draft {
    let mut draft = Draft::triangle();
    draft.push("materials", json!({"pbrMetallicRoughness": {"metallicFactor": 0.5}}));
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}));
    draft.json["nodes"][0]["camera"] = json!(0);
    draft.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [{"type": "point"}]}});
    draft.json["nodes"][0]["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
    let input = draft.floats("SCALAR", &[0.0, 1.0]);
    let output = draft.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
    let channel = json!({"sampler": 0, "target": {"node": 0, "path": "translation"}});
    draft.push("animations", json!({"channels": [channel], "samplers": [{"input": input, "output": output}]}));
    draft
}

#[test]
fn integers_can_have_a_fraction_of_zeros() {
    let mut draft = animated();
    draft.json["nodes"][0]["name"] = json!("a \"1.0\" \\");
    draft.json["buffers"] = json!([{"byteLength": draft.bin.len()}]);
    let plain = draft.scene();
    let text = draft.json.to_string();
    // Writes each whole number with a fraction, but not those in strings.
    let mut floats = String::new();
    let mut parts = text.split('"');
    while let Some(part) = parts.next() {
        let digits = |c: char| c.is_ascii_digit() || c == '.';
        let mut rest = part;
        while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
            let end = rest[at..].find(|c| !digits(c)).map_or(rest.len(), |len| at + len);
            let fraction = if rest[at..end].contains('.') { "" } else { ".00" };
            floats += &format!("{}{fraction}", &rest[..end]);
            rest = &rest[end..];
        }
        floats += rest;
        if let Some(string) = parts.next() {
            floats += &format!("\"{string}\"");
        }
    }
    assert!(floats.contains("\"count\":3.00"), "{floats}");
    let mut glb = draft.glb();
    let bin = glb.split_off(12 + 8 + text.len().next_multiple_of(4));
    floats.extend(std::iter::repeat_n(' ', floats.len().next_multiple_of(4) - floats.len()));
    let mut changed = b"glTF".to_vec();
    for word in [2, (12 + 8 + floats.len() + bin.len()) as u32, floats.len() as u32] {
        changed.extend(word.to_le_bytes());
    }
    changed.extend(b"JSON");
    changed.extend(floats.as_bytes());
    changed.extend(bin);
    assert_eq!(format!("{:?}", read(&changed).unwrap()), format!("{plain:?}"));
    draft.json["accessors"][0]["count"] = json!(2.5);
    assert_mentions(&draft.complaint(), &["JSON", "2.5"]);
}

#[test]
fn backslashes_separate_folders() {
    let folder = tempfile::tempdir().unwrap();
    let mut draft = Draft::triangle();
    fs::create_dir(folder.path().join("data")).unwrap();
    fs::write(folder.path().join("data/a.bin"), &draft.bin).unwrap();
    let path = folder.path().join("scene.gltf");
    for uri in ["data\\a.bin", ".\\data\\a.bin", "data%5Ca.bin"] {
        draft.json["buffers"] = json!([{"byteLength": draft.bin.len(), "uri": uri}]);
        fs::write(&path, draft.json.to_string()).unwrap();
        assert_eq!(load(&path).unwrap().triangle_count(), 1, "{uri}");
    }
    draft.json["buffers"][0]["uri"] = json!("data\\..\\..\\a.bin");
    fs::write(&path, draft.json.to_string()).unwrap();
    assert_mentions(&load(&path).unwrap_err().to_string(), &["buffer 0", "allow files outside"]);
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
fn byte_order_mark_is_skipped() {
    let mut draft = Draft::triangle();
    let text = base64::engine::general_purpose::STANDARD.encode(bytemuck::cast_slice::<f32, u8>(&CORNERS));
    draft.json["buffers"] = json!([{"byteLength": 36, "uri": format!("data:;base64,{text}")}]);
    draft.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("indices");
    let text = format!("\u{FEFF}{}", draft.json);
    assert_eq!(read(text.as_bytes()).unwrap().triangle_count(), 1);
}

#[test]
fn empty_scenes_and_pointer_animations_load() {
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
    crate::scene::gltf::load(path, &Play::default(), None, Access::of(&budget))
}

#[test]
fn file_shared_by_buffers_is_read_once() {
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
fn unused_buffers_are_not_read() {
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
