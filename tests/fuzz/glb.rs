//! Binary glTF files with damage to JSON values and keys, to bytes, and to the container.

mod edits;

use std::path::Path;

use diptych::accel::{Accel, Layout, TreeCache};
use diptych::scene::Scene;
use diptych::scene::budget::Budget;
use diptych::scene::complete::Overrides;
use diptych::scene::folder::Access;
use diptych::scene::load::{load_shot, load_shot_within};
use diptych::scene::rig::Eye;
use diptych::tables::SceneTables;
use proptest::prelude::*;
use proptest::sample::{Index, select};
use serde_json::{Value, json};

use crate::bytes::{self, Damage};
use crate::{ALLOWED_BYTES, BUDGET, hold};
use edits::{apply, edit};

/// Reads a file and prepares its scene for upload; returns true on success.
pub fn load(path: &Path, bytes: &[u8]) -> bool {
    std::fs::write(path, bytes).unwrap();
    load_as_is(path, &Budget::new(BUDGET)).is_some()
}

/// Returns the scene, if the existing file can be read and prepared.
pub fn load_as_is(path: &Path, budget: &Budget) -> Option<Scene> {
    let folder = path.parent().unwrap().to_str().unwrap();
    let (shot, scene) = match load_shot_within(path.to_str().unwrap(), &Overrides::default(), Access::of(budget)) {
        Ok(read) => read,
        Err(error) => {
            assert!(error.to_string().contains(folder), "the error does not name a file: {error}");
            return None;
        }
    };
    check(&scene);
    for time_s in [0.0, 0.3, -1e9] {
        check(&scene.at(time_s));
    }
    let view = shot.rig.view(0.0, Eye::LEFT);
    assert!([view.origin, view.right, view.up, view.forward].iter().all(|v| v.is_finite()), "{view:?}");
    let accel = Accel::build_within(&scene, Layout::Auto, budget, &TreeCache::off()).ok()?;
    let tables = SceneTables::within(&scene, accel, budget).ok()?;
    for (now_s, last_s) in [(0.3, 0.0), (1e9, -1e9)] {
        let mut frame = bytemuck::Zeroable::zeroed();
        tables.update(&mut frame, now_s, last_s);
    }
    Some(scene)
}

/// Checks the invariants on which the rest of the program relies.
fn check(scene: &Scene) {
    for mesh in &scene.meshes {
        let n = mesh.positions.len();
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-3), "{:?}", mesh.normals);
        assert!(mesh.triangles.as_flattened().iter().all(|&v| (v as usize) < n));
        let lengths = [mesh.normals.len(), mesh.uvs[0].len(), mesh.uvs[1].len(), mesh.colors.len()];
        assert!(lengths.iter().all(|&l| l == 0 || l == n), "{lengths:?} for {n}");
        assert!(
            [0, n].contains(&mesh.influences.len()) && mesh.morphs.iter().all(|m| [0, n].contains(&m.positions.len()))
        );
        assert!(mesh.uvs.iter().flatten().all(|uv| uv.is_finite()) && mesh.material < scene.materials.len());
    }
    for instance in &scene.instances {
        assert!(instance.mesh < scene.meshes.len() && instance.world_from_local.is_finite());
    }
    for m in &scene.materials {
        assert!(m.base_color.is_finite() && m.emissive.is_finite() && m.emissive.min_element() >= 0.0, "{m:?}");
        assert!((0.0..=1.0).contains(&m.roughness) && (0.0..=1.0).contains(&m.metallic), "{m:?}");
        let textures = [m.base_color_texture, m.emissive_texture];
        assert!(textures.iter().flatten().all(|t| t.texture < scene.textures.len() && t.uv_set < 2));
    }
    assert!(scene.textures.iter().all(|t| t.image < scene.images.len()));
    assert!(scene.images.iter().all(|i| i.pixels.len() == i.extent.area() && i.extent.area() > 0));
    assert!(scene.lights.iter().all(|l| l.strength.is_finite() && l.strength.min_element() >= 0.0));
}

/// A glTF file under construction.
#[derive(Clone, Debug)]
struct Draft {
    json: Value,
    bin: Vec<u8>,
}

impl Draft {
    /// Appends bytes to the binary chunk with a buffer view for them; returns the view's number.
    fn view(&mut self, bytes: &[u8], more: Value) -> usize {
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()});
        merge(&mut view, more);
        self.push("bufferViews", view)
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = if kind == "SCALAR" { 1 } else { kind[3..].parse().unwrap() };
        let view = self.view(bytemuck::cast_slice(values), json!({}));
        self.accessor(view, 5126, values.len() / width, kind, json!({}))
    }

    fn accessor(&mut self, view: usize, component: u32, count: usize, kind: &str, more: Value) -> usize {
        let mut accessor = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        merge(&mut accessor, more);
        self.push("accessors", accessor)
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.json.as_object_mut().unwrap().entry(list).or_insert_with(|| json!([]));
        let list = list.as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    /// Returns the complete file. `lengths` are added to the lengths that the header and the chunks declare.
    fn pack(&self, json: String, lengths: [i32; 3]) -> Vec<u8> {
        let mut json = json.into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let claim = |length: usize, off: i32| (length as u32).wrapping_add_signed(off).to_le_bytes();
        let mut out = b"glTF\x02\0\0\0".to_vec();
        out.extend(claim(28 + json.len() + self.bin.len(), lengths[0]));
        out.extend(claim(json.len(), lengths[1]));
        out.extend(b"JSON");
        out.extend(&json);
        out.extend(claim(self.bin.len(), lengths[2]));
        out.extend(b"BIN\0");
        out.extend(&self.bin);
        out
    }

    fn whole(&mut self) -> Vec<u8> {
        self.json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        self.pack(self.json.to_string(), [0; 3])
    }
}

fn merge(into: &mut Value, more: Value) {
    if let (Value::Object(into), Value::Object(more)) = (into, more) {
        into.extend(more);
    }
}

fn start() -> Draft {
    let json = json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]});
    Draft { json, bin: Vec::new() }
}

const CORNERS: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.1, 0.0, 1.0, 0.0];

/// Returns a quad with a picture on it.
pub fn textured(picture: &[u8]) -> Vec<u8> {
    let mut draft = start();
    let positions = draft.floats("VEC3", &CORNERS);
    let uvs = draft.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let view = draft.view(picture, json!({}));
    let attributes = json!({"POSITION": positions, "TEXCOORD_0": uvs});
    draft.push("nodes", json!({"mesh": 0}));
    draft.push("meshes", json!({"primitives": [{"attributes": attributes, "material": 0, "mode": 6}]}));
    draft.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    draft.push("textures", json!({"source": 0}));
    draft.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    draft.whole()
}

/// Returns a file that uses every supported feature.
fn everything() -> Draft {
    let mut draft = start();
    let positions = draft.floats("VEC3", &CORNERS);
    let normals = draft.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.8, 0.0, 0.0, 1.0]);
    let uvs = draft.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let more_uvs = draft.view(&[0, 0, 255, 255, 0, 128, 9, 9, 0, 0, 1, 1, 2, 2, 3, 3], json!({"byteStride": 4}));
    let more_uvs = draft.accessor(more_uvs, 5123, 4, "VEC2", json!({"normalized": true}));
    let colors = draft.view(&[255; 16], json!({}));
    let colors = draft.accessor(colors, 5121, 4, "VEC4", json!({"normalized": true}));
    let indices = draft.view(&[0, 0, 1, 0, 2, 0, 0, 0, 2, 0, 3, 0], json!({"target": 34963}));
    let indices = draft.accessor(indices, 5123, 6, "SCALAR", json!({}));
    let at = draft.view(&[1, 3], json!({}));
    let moved = draft.view(bytemuck::cast_slice(&[1.5f32, 0.0, 0.0, 0.0, 1.5, 0.0]), json!({}));
    let sparse = json!({"count": 2, "indices": {"bufferView": at, "componentType": 5121},
        "values": {"bufferView": moved, "byteOffset": 0}});
    let sparse = draft.accessor(0, 5126, 4, "VEC3", json!({"sparse": sparse}));
    let vertices: Vec<[f32; 3]> = CORNERS.as_chunks::<3>().0.to_vec();
    let packed = meshopt::encode_vertex_buffer(&vertices).unwrap();
    let length = packed.len();
    let packed = draft.view(&packed, json!({}));
    let offset = draft.json["bufferViews"][packed]["byteOffset"].clone();
    draft.json["bufferViews"][packed] = json!({"buffer": 1, "byteLength": 48, "byteStride": 12, "extensions": {
        "EXT_meshopt_compression": {"buffer": 0, "byteOffset": offset, "byteLength": length, "byteStride": 12,
            "count": 4, "mode": "ATTRIBUTES", "filter": "NONE"}}});
    let packed = draft.accessor(packed, 5126, 4, "VEC3", json!({}));
    let attributes = json!({"POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "TEXCOORD_1": more_uvs,
        "COLOR_0": colors});
    draft.push(
        "meshes",
        json!({"name": "Quad", "primitives": [
        {"attributes": attributes, "indices": indices, "material": 0},
        {"attributes": {"POSITION": sparse}, "mode": 5, "material": 1}]}),
    );
    draft.push("meshes", json!({"primitives": [{"attributes": {"POSITION": packed}, "mode": 6}]}));
    furnish(&mut draft);
    animate(&mut draft, positions);
    draft.json["buffers"] = json!([{"byteLength": draft.bin.len()},
        {"byteLength": 48, "extensions": {"EXT_meshopt_compression": {"fallback": true}}}]);
    draft
}

/// Adds nodes, materials, textures, lights and cameras.
fn furnish(draft: &mut Draft) {
    let png = ::image::RgbaImage::from_pixel(2, 2, ::image::Rgba([9, 99, 199, 128]));
    let picture = draft.view(&bytes::picture(png, ::image::ImageFormat::Png), json!({}));
    let mut more: Value = serde_json::from_str(include_str!("furniture.json")).unwrap();
    more["images"][0]["bufferView"] = json!(picture);
    merge(&mut draft.json, more);
}

/// Adds a skinned and morphed quad at these positions with two joints, and animations with all kinds of interpolation.
fn animate(draft: &mut Draft, positions: usize) {
    let bytes = |draft: &mut Draft, values: [u8; 16]| {
        let view = draft.view(&values, json!({}));
        draft.accessor(view, 5121, 4, "VEC4", json!({"normalized": true}))
    };
    let joints = bytes(draft, [0, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]);
    draft.json["accessors"][joints]["normalized"] = json!(false);
    let weights = bytes(draft, [200, 55, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 0, 0, 0, 0]);
    let mut binds = [[0.0f32; 16]; 2];
    binds.iter_mut().for_each(|m| [0, 5, 10, 15].iter().for_each(|&i| m[i] = 1.0));
    let view = draft.view(bytemuck::cast_slice(&binds), json!({}));
    let binds = draft.accessor(view, 5126, 2, "MAT4", json!({}));
    let attributes = json!({"POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights});
    let primitive = json!({"attributes": attributes, "mode": 6, "targets": [{"POSITION": positions}]});
    let mesh = draft.push("meshes", json!({"primitives": [primitive], "weights": [0.25]}));
    draft.push("skins", json!({"joints": [7, 8], "inverseBindMatrices": binds}));
    draft.push("nodes", json!({"name": "Hip", "children": [8]}));
    draft.push("nodes", json!({"name": "Knee", "translation": [0.0, 0.5, 0.0]}));
    draft.push("nodes", json!({"mesh": mesh, "skin": 0}));
    draft.json["scenes"][0]["nodes"] = json!([0, 7, 9]);
    let times = draft.floats("SCALAR", &[0.0, 0.5, 1.0]);
    let turns = draft.floats("VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8, 0.0, 1.0, 0.0, 0.0]);
    let places = draft.floats("VEC3", &[0.0; 27]);
    let numbers = draft.floats("SCALAR", &[0.0, 1.0, 0.5]);
    let pointer = "/materials/1/extensions/KHR_materials_emissive_strength/emissiveStrength";
    let pointer = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}});
    let animation = json!({"name": "Walk",
        "samplers": [{"input": times, "output": turns}, {"input": times, "output": numbers, "interpolation": "STEP"},
            {"input": times, "output": places, "interpolation": "CUBICSPLINE"}],
        "channels": [{"sampler": 0, "target": {"node": 8, "path": "rotation"}},
            {"sampler": 1, "target": {"node": 9, "path": "weights"}},
            {"sampler": 2, "target": {"node": 3, "path": "translation"}},
            {"sampler": 1, "target": pointer}]});
    draft.push("animations", animation);
}

#[test]
fn damaged_glb_files_load_or_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fuzz.glb");
    let seed = everything();
    let whole = seed.pack(seed.json.to_string(), [0; 3]);
    assert!(load(&path, &whole), "{:?}", load_shot(path.to_str().unwrap()).map(drop));
    hold(2000, ALLOWED_BYTES, prop::collection::vec(edit(), 1..6), |edits| {
        load(&path, &apply(&seed, &edits));
    });
}

/// A truncated file is rejected, wherever it ends.
#[test]
fn rejects_glb_files_cut_anywhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.glb");
    let seed = everything();
    let whole = seed.pack(seed.json.to_string(), [0; 3]);
    for length in 0..whole.len() {
        assert!(!load(&path, &whole[..length]), "{length} of {} bytes are enough", whole.len());
    }
}
