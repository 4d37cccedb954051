//! Tests of compressed buffer views.

use glam::Vec3;
use meshopt::{
    EncodeExpMode, encode_filter_exp, encode_filter_oct, encode_index_buffer, encode_index_sequence,
    encode_vertex_buffer_level,
};
use serde_json::{Value, json};

use super::{CORNERS, Draft, F32, U16, U32, assert_mentions};

impl Draft {
    /// Adds a view that decompresses to `count` elements of `stride` bytes. Its own buffer is a placeholder.
    pub fn compressed_view(&mut self, stream: &[u8], stride: usize, count: usize, mode: &str, filter: &str) -> usize {
        let source = self.view(stream);
        let offset = self.json["bufferViews"][source]["byteOffset"].clone();
        let extension = json!({
            "buffer": 0, "byteOffset": offset, "byteLength": stream.len(),
            "byteStride": stride, "count": count, "mode": mode, "filter": filter,
        });
        let size = stride * count;
        self.json["bufferViews"][source] = json!({
            "buffer": 1, "byteLength": size, "extensions": {"EXT_meshopt_compression": extension},
        });
        source
    }

    pub fn compressed(&mut self, view: usize, component: u32, type_: &str, count: usize) -> usize {
        self.push("accessors", json!({"bufferView": view, "componentType": component, "count": count, "type": type_}))
    }

    /// Adds the placeholder; call when the views are complete.
    pub fn with_fallback(mut self) -> Self {
        let fallback = json!({"byteLength": 1 << 20, "extensions": {"EXT_meshopt_compression": {"fallback": true}}});
        self.json["buffers"] = json!([{"byteLength": self.bin.len()}, fallback]);
        self.json["extensionsRequired"] = json!(["EXT_meshopt_compression", "KHR_mesh_quantization"]);
        self
    }
}

fn stream_of<T>(vertices: &[T]) -> Vec<u8> {
    encode_vertex_buffer_level(vertices, 2, Some(0)).unwrap()
}

/// Returns a triangle with compressed positions and indices.
fn compressed_triangle() -> Draft {
    let mut draft = Draft::empty();
    let corners: &[[f32; 3]] = bytemuck::cast_slice(&CORNERS);
    let view = draft.compressed_view(&stream_of(corners), 12, 3, "ATTRIBUTES", "NONE");
    let positions = draft.compressed(view, F32, "VEC3", 3);
    let view = draft.compressed_view(&encode_index_buffer(&[0, 1, 2], 3).unwrap(), 2, 3, "TRIANGLES", "NONE");
    let indices = draft.compressed(view, U16, "SCALAR", 3);
    draft.primitive(json!({"attributes": {"POSITION": positions}, "indices": indices}));
    draft.with_fallback()
}

#[test]
fn attributes_and_triangles_decompress() {
    let mesh = &compressed_triangle().scene().meshes[0];
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
}

#[test]
fn khr_meshopt_compression_is_read() {
    let mut draft = Draft::empty();
    let corners: &[[f32; 3]] = bytemuck::cast_slice(&CORNERS);
    let stream = encode_vertex_buffer_level(corners, 2, Some(1)).unwrap();
    let view = draft.compressed_view(&stream, 12, 3, "ATTRIBUTES", "NONE");
    let positions = draft.compressed(view, F32, "VEC3", 3);
    draft.primitive(json!({"attributes": {"POSITION": positions}}));
    let mut draft = draft.with_fallback();
    let extension = draft.json["bufferViews"][view]["extensions"]["EXT_meshopt_compression"].take();
    draft.json["bufferViews"][view]["extensions"] = json!({"KHR_meshopt_compression": extension});
    draft.json["buffers"][1]["extensions"] = json!({"KHR_meshopt_compression": {"fallback": true}});
    draft.json["extensionsRequired"] = json!(["KHR_meshopt_compression"]);
    assert_eq!(draft.scene().meshes[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn index_sequences_decompress_in_both_widths() {
    for (stride, component) in [(2, U16), (4, U32)] {
        let mut draft = Draft::empty();
        let positions = draft.floats("VEC3", &[CORNERS, CORNERS].concat());
        let stream = encode_index_sequence(&[5, 4, 3, 2, 1, 0], 6).unwrap();
        let view = draft.compressed_view(&stream, stride, 6, "INDICES", "NONE");
        let indices = draft.compressed(view, component, "SCALAR", 6);
        draft.primitive(json!({"attributes": {"POSITION": positions}, "indices": indices}));
        assert_eq!(draft.with_fallback().scene().meshes[0].triangles, [[5, 4, 3], [2, 1, 0]]);
    }
}

#[test]
fn octahedral_and_exponential_filters_are_undone() {
    let mut draft = Draft::empty();
    let words: Vec<[u32; 3]> =
        encode_filter_exp(bytemuck::cast_slice::<_, [f32; 3]>(&CORNERS), 15, EncodeExpMode::Separate);
    let view = draft.compressed_view(&stream_of(&words), 12, 3, "ATTRIBUTES", "EXPONENTIAL");
    let positions = draft.compressed(view, F32, "VEC3", 3);
    let normals = [Vec3::X, Vec3::new(0.0, 0.6, -0.8), Vec3::NEG_Y];
    let padded = normals.map(|n| n.extend(0.0).to_array());
    let octahedral: Vec<[i8; 4]> = encode_filter_oct(&padded, 8);
    let view = draft.compressed_view(&stream_of(&octahedral), 4, 3, "ATTRIBUTES", "OCTAHEDRAL");
    draft.json["bufferViews"][view]["byteStride"] = json!(4);
    let accessor = draft.compressed(view, 5120, "VEC3", 3);
    draft.json["accessors"][accessor]["normalized"] = json!(true);
    draft.primitive(json!({"attributes": {"POSITION": positions, "NORMAL": accessor}}));
    let mesh = &draft.with_fallback().scene().meshes[0];
    assert_eq!(mesh.positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    for (found, expected) in mesh.normals.iter().zip(normals) {
        assert!(found.distance(expected) < 0.02, "{found} {expected}");
    }
}

#[test]
fn rejects_wrong_layouts() {
    let cases: [(&str, Value); 11] = [
        ("count", json!(4)),
        ("count", json!(u64::MAX)),
        ("byteStride", json!(0)),
        ("byteStride", json!(6)),
        ("byteStride", json!(260)),
        ("byteLength", json!(1 << 30)),
        ("byteLength", json!(5)),
        ("byteOffset", json!(u64::MAX)),
        ("buffer", json!(1)),
        ("mode", json!("ZIP")),
        ("filter", json!("QUATERNION")),
    ];
    for (key, value) in cases {
        let mut draft = compressed_triangle();
        draft.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"][key] = value;
        assert_mentions(&draft.complaint(), &["mesh 0", "POSITION", "accessor 0", "buffer view 0"]);
    }
    let mut filtered = compressed_triangle();
    filtered.json["bufferViews"][1]["extensions"]["EXT_meshopt_compression"]["filter"] = json!("OCTAHEDRAL");
    assert_mentions(&filtered.complaint(), &["buffer view 1", "no filter"]);
}

#[test]
fn rejects_counts_beyond_a_short_stream() {
    let mut draft = compressed_triangle();
    let view = &mut draft.json["bufferViews"][0];
    view["byteLength"] = json!(12u64 << 29);
    view["extensions"]["EXT_meshopt_compression"]["count"] = json!(1u64 << 29);
    assert_mentions(&draft.complaint(), &["buffer view 0", "cannot hold"]);
}

#[test]
fn rejects_reads_from_a_placeholder_buffer() {
    let mut draft = compressed_triangle();
    draft.json["bufferViews"][0].as_object_mut().unwrap().remove("extensions");
    assert_mentions(&draft.complaint(), &["buffer view 0", "buffer 1 has no bytes"]);
}
