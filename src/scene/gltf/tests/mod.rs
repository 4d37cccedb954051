//! Tests that read small files built in memory.

mod damaged;
mod draco;
mod files;
mod forgiving;
mod geometry;
mod hierarchy;
mod ktx2;
mod layers;
mod materials;
mod meshopt;
mod motion;
mod placed;
mod real_scenes;
mod tangents;

use std::path::Path;

use serde_json::{Value, json};

use crate::scene::budget::Budget;
use crate::scene::folder::Access;
use crate::scene::motion::play::Play;
use crate::scene::{Scene, SceneError};

const F32: u32 = 5126;
const U8: u32 = 5121;
const U16: u32 = 5123;
const U32: u32 = 5125;

/// Corners of a right triangle that faces +z.
const CORNERS: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A glTF file under construction. `bin` becomes the binary chunk of a GLB.
#[derive(Clone)]
struct Draft {
    json: Value,
    bin: Vec<u8>,
}

impl Draft {
    /// Returns a file with one node and one mesh, without primitives.
    fn empty() -> Self {
        let json = json!({
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"name": "Thing", "primitives": []}],
            "accessors": [],
            "bufferViews": [],
        });
        Self { json, bin: Vec::new() }
    }

    /// Returns a triangle. Accessor 0 holds its positions, accessor 1 its indices.
    fn triangle() -> Self {
        let mut draft = Self::empty();
        let positions = draft.floats("VEC3", &CORNERS);
        let indices = draft.packed(U16, "SCALAR", 3, &[0, 0, 1, 0, 2, 0]);
        draft.primitive(json!({"attributes": {"POSITION": positions}, "indices": indices}));
        draft
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let slot = &mut self.json[list];
        if slot.is_null() {
            *slot = json!([]);
        }
        let list = slot.as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn primitive(&mut self, primitive: Value) {
        self.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    }

    /// Sets an attribute of the first primitive.
    fn attribute(&mut self, name: &str, accessor: usize) {
        self.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    fn packed(&mut self, component: u32, type_: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.push("accessors", json!({"bufferView": view, "componentType": component, "count": count, "type": type_}))
    }

    fn floats(&mut self, type_: &str, values: &[f32]) -> usize {
        let width = match type_ {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        self.packed(F32, type_, values.len() / width, bytemuck::cast_slice(values))
    }

    fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if json["buffers"].is_null() {
            json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        }
        let mut text = json.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut glb = Vec::new();
        glb.extend_from_slice(b"glTF");
        for word in [2, (12 + 8 + text.len() + 8 + bin.len()) as u32, text.len() as u32] {
            glb.extend_from_slice(&word.to_le_bytes());
        }
        glb.extend_from_slice(b"JSON");
        glb.extend_from_slice(&text);
        glb.extend_from_slice(&(bin.len() as u32).to_le_bytes());
        glb.extend_from_slice(b"BIN\0");
        glb.extend_from_slice(&bin);
        glb
    }

    fn read(&self) -> Result<Scene, SceneError> {
        read(&self.glb())
    }

    fn scene(&self) -> Scene {
        self.read().unwrap()
    }

    /// Returns the message of the error, also of faults that are otherwise left out; panics if there is no error.
    fn complaint(&self) -> String {
        let (path, budget) = (Path::new("draft.glb"), Budget::unlimited());
        let access = Access { strict: true, ..any(&budget) };
        let read = super::parse(&self.glb(), path, &Play::default(), None, access);
        read.map_err(|fault| fault.in_file(path)).unwrap_err().to_string()
    }
}

fn read(bytes: &[u8]) -> Result<Scene, SceneError> {
    let path = Path::new("draft.glb");
    read_variant(bytes, None).map_err(|fault| fault.in_file(path))
}

fn read_variant(bytes: &[u8], variant: Option<&str>) -> super::Outcome<Scene> {
    super::parse(bytes, Path::new("draft.glb"), &Play::default(), variant, any(&Budget::unlimited()))
}

/// Grants default access, for tests that don't limit memory.
fn any(budget: &Budget) -> Access<'_> {
    Access::of(budget)
}

fn load(path: &Path) -> Result<Scene, SceneError> {
    super::load(path, &Play::default(), None, any(&Budget::unlimited()))
}

#[track_caller]
fn assert_mentions(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "'{word}' is not in: {text}");
    }
}
