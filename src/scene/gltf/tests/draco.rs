//! Tests of compressed primitives (`KHR_draco_mesh_compression`).

use glam::{Vec2, Vec3};
use serde_json::{Value, json};

use super::{Draft, F32, U8, U16, assert_mentions};

const NAME: &str = "KHR_draco_mesh_compression";

/// Streams of a square of two triangles, with positions (attribute 0, quantised to 11 bits) and texture coordinates
/// (attribute 1, 10 bits), as `draco-core` 1.2 encodes them with connectivity by edge-breaking and in sequence.
const SQUARES: [&str; 2] = [
    "445241434f02020101000000040201020000011fff0111ff011102ff000000000001000903000002010309020001020101010003030130011003002882980000000000ff0700000000000000000000000000000000803f0b01010100030301300110030028822c0000000000ff03000000000000000000000000803f0a",
    "445241434f02020100000002040100010200020301020009030000030902000102020001010003030130011003003482880400000000ff0700000001010003030130011003003482a40000000000ff0300000000000000000000000000000000803f0b00000000000000000000803f0a",
];

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn square(stream: &[u8]) -> Draft {
    let mut draft = Draft::empty();
    let view = draft.view(stream);
    let mut accessor = |component: u32, type_: &str, count: usize| {
        draft.push("accessors", json!({"componentType": component, "type": type_, "count": count}))
    };
    let (indices, positions, uvs) = (accessor(U16, "SCALAR", 6), accessor(F32, "VEC3", 4), accessor(F32, "VEC2", 4));
    draft.primitive(json!({
        "attributes": {"POSITION": positions, "TEXCOORD_0": uvs},
        "indices": indices,
        "extensions": {NAME: {"bufferView": view, "attributes": {"POSITION": 0, "TEXCOORD_0": 1}}},
    }));
    draft.json["extensionsRequired"] = json!([NAME]);
    draft
}

#[test]
fn both_codings_of_triangles_are_read() {
    for stream in SQUARES {
        let scene = square(&bytes(stream)).scene();
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let mesh = &scene.meshes[0];
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4, 2));
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
            (b - a).cross(c - a) / 2.0
        };
        assert!(mesh.triangles.iter().map(area).sum::<Vec3>().distance(Vec3::Z) < 1e-2);
        for (position, uv) in mesh.positions.iter().zip(&mesh.uvs[0]) {
            assert!(position.truncate().distance(*uv) < 2e-3 && (*uv - uv.round()).length() < 2e-3, "{position} {uv}");
            assert!(*uv == uv.clamp(Vec2::ZERO, Vec2::ONE));
        }
    }
}

#[test]
fn draco_stream_overrides_accessor_counts() {
    let mut draft = square(&bytes(SQUARES[0]));
    for accessor in 0..3 {
        draft.json["accessors"][accessor]["count"] = json!(1000);
    }
    assert_eq!(draft.scene().meshes[0].triangles.len(), 2);
}

#[test]
fn shared_accessors_keep_their_own_elements() {
    let mut draft = square(&bytes(SQUARES[0]));
    let positions: Vec<f32> = (0..12).map(|i| 10.0 + i as f32).collect();
    let view = draft.view(bytemuck::cast_slice(&positions));
    draft.json["accessors"][1]["bufferView"] = json!(view);
    let indices = draft.packed(U16, "SCALAR", 3, &[0, 0, 1, 0, 3, 0]);
    draft.primitive(json!({"attributes": {"POSITION": 1}, "indices": indices}));
    let scene = draft.scene();
    assert_eq!(scene.meshes[0].positions.len(), 4);
    assert_eq!(scene.meshes[1].positions[2], Vec3::new(19.0, 20.0, 21.0));
}

#[test]
fn rejects_primitives_that_differ_from_their_stream() {
    let cases: [(&str, Value, &str); 6] = [
        ("/accessors/1/type", json!("VEC4"), "POSITION"),
        ("/accessors/1/componentType", json!(U8), "POSITION"),
        ("/meshes/0/primitives/0/mode", json!(5), "triangles"),
        ("/meshes/0/primitives/0/indices", Value::Null, "indices"),
        ("/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression/attributes/POSITION", json!(7), "attribute 7"),
        ("/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression/bufferView", json!(9), "buffer view 9"),
    ];
    for (place, value, word) in cases {
        let mut draft = square(&bytes(SQUARES[1]));
        if place.ends_with("mode") {
            draft.json["meshes"][0]["primitives"][0]["mode"] = json!(4);
        }
        *draft.json.pointer_mut(place).unwrap() = value;
        assert_mentions(&draft.complaint(), &["mesh 0", NAME, word]);
    }
}

#[test]
fn damaged_streams_never_panic() {
    for stream in SQUARES.map(bytes) {
        for length in 0..stream.len() / 2 {
            assert_mentions(&square(&stream[..length]).complaint(), &["mesh 0", NAME]);
        }
        for at in 0..stream.len() {
            for value in [0, 1, 127, 255] {
                let mut damaged = stream.clone();
                damaged[at] = value;
                let _ = square(&damaged).read();
            }
        }
    }
}
