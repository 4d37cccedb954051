//! Tests that reading damaged files ends soon and does not panic.

use std::io::Cursor;
use std::time::{Duration, Instant};

use meshopt::{encode_index_buffer, encode_vertex_buffer_level};
use serde_json::json;

use super::{CORNERS, Draft, F32, U8, U16, read};

const CASES: u32 = 20_000;

/// Returns a file that uses as many parts of the format as fit in a few kilobytes.
fn sample() -> Vec<u8> {
    let mut draft = Draft::triangle();
    let normals = draft.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    draft.attribute("NORMAL", normals);
    let tangents = draft.floats("VEC4", &[1.0, 0.0, 0.0, 1.0].repeat(3));
    draft.attribute("TANGENT", tangents);
    let uvs = draft.floats("VEC2", &[0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    draft.attribute("TEXCOORD_0", uvs);
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let sparse_indices = draft.view(&[1]);
    let sparse_values = draft.view(bytemuck::cast_slice(&[2.0f32, 0.0, 0.0]));
    draft.json["accessors"][0]["sparse"] = json!({
        "count": 1,
        "indices": {"bufferView": sparse_indices, "componentType": U8},
        "values": {"bufferView": sparse_values},
    });
    let corners: &[[f32; 3]] = bytemuck::cast_slice(&CORNERS);
    let stream = encode_vertex_buffer_level(corners, 2, Some(0)).unwrap();
    let view = draft.compressed_view(&stream, 12, 3, "ATTRIBUTES", "NONE");
    let positions = draft.compressed(view, F32, "VEC3", 3);
    let view = draft.compressed_view(&encode_index_buffer(&[0, 1, 2], 3).unwrap(), 2, 3, "TRIANGLES", "NONE");
    let indices = draft.compressed(view, U16, "SCALAR", 3);
    let attributes = json!({"POSITION": positions, "TEXCOORD_0": uvs});
    draft.primitive(json!({"attributes": attributes, "indices": indices, "material": 0, "mode": 5}));

    let mut png = Cursor::new(Vec::new());
    image::RgbaImage::from_pixel(3, 2, image::Rgba([9, 8, 7, 6])).write_to(&mut png, image::ImageFormat::Png).unwrap();
    let view = draft.view(&png.into_inner());
    draft.push("images", json!({"bufferView": view}));
    draft.push("samplers", json!({"magFilter": 9729, "wrapS": 33071}));
    draft.push("textures", json!({"source": 0, "sampler": 0}));
    let texture = json!({"index": 0, "extensions": {"KHR_texture_transform": {"rotation": 0.5}}});
    draft.push(
        "materials",
        json!({
            "pbrMetallicRoughness": {"baseColorTexture": texture, "metallicRoughnessTexture": {"index": 0}},
            "emissiveFactor": [1, 1, 1], "alphaMode": "MASK", "alphaCutoff": 0.25, "normalTexture": texture,
            "extensions": {
                "KHR_materials_clearcoat": {"clearcoatFactor": 1, "clearcoatNormalTexture": {"index": 0}},
                "KHR_materials_pbrSpecularGlossiness": {"specularGlossinessTexture": {"index": 0}},
                "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2},
            },
        }),
    );
    draft.push("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}}));
    draft.json["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {"outerConeAngle": 1}}]}});
    draft.json["nodes"] = json!([
        {"mesh": 0, "children": [1, 2], "rotation": [0, 0, 1, 0]},
        {"camera": 0, "translation": [1, 2, 3]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]},
    ]);
    draft.with_fallback().glb()
}

/// The xorshift32 generator.
pub(super) struct Random(pub u32);

impl Random {
    pub fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0 as usize % end
    }
}

fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(6) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.below(256) as u8,
            2 | 3 => {
                // Most digits are in the JSON's indices and sizes.
                let digits: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i].is_ascii_digit()).collect();
                let Some(&digit) = digits.get(random.below(digits.len().max(1))) else { continue };
                bytes[digit] = b'0' + random.below(10) as u8;
            }
            4 => {
                let end = (at + random.below(8)).min(bytes.len());
                bytes[at..end].fill([0, 0xFF, b'9'][random.below(3)]);
            }
            _ if random.below(4) == 0 => bytes.truncate(at.max(1)),
            _ => {
                let from = random.below(bytes.len());
                bytes[at] = bytes[from];
            }
        }
    }
}

#[test]
fn damaged_files_neither_panic_nor_hang() {
    let whole = sample();
    assert_eq!(read(&whole).unwrap().triangle_count(), 2);
    let mut random = Random(0x9E37_79B9);
    let mut survivors = 0;
    for case in 0..CASES {
        let mut bytes = whole.clone();
        damage(&mut bytes, &mut random);
        let start = Instant::now();
        survivors += u32::from(read(&bytes).is_ok());
        assert!(start.elapsed() < Duration::from_secs(10), "case {case}");
    }
    // Otherwise the damage would only exercise the JSON parser.
    assert!((CASES / 100..CASES).contains(&survivors), "{survivors}");
}

#[test]
fn rejects_files_cut_anywhere() {
    let whole = sample();
    for length in 0..whole.len() {
        assert!(read(&whole[..length]).is_err(), "{length}");
    }
}

#[test]
fn deeply_nested_json_does_not_exhaust_the_stack() {
    const DEPTH: usize = 300_000;
    let nest = "[".repeat(DEPTH) + &"]".repeat(DEPTH);
    for key in ["extras", "unknown", "extensions", "nodes"] {
        // Both success and failure are fine.
        let _ = read(format!(r#"{{"asset": {{"version": "2.0"}}, "{key}": {nest}}}"#).as_bytes());
    }
    let inner = format!(r#"{{"asset": {{"version": "2.0"}}, "nodes": [{{"extensions": {{"A": {nest}}}}}]}}"#);
    assert!(read(inner.as_bytes()).is_err());
}
