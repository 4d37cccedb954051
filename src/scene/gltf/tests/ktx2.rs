//! Tests of KTX2 images (`KHR_texture_basisu`).

use serde_json::json;

use super::{Draft, assert_mentions};
use crate::scene::budget::Budget;
use crate::scene::gltf::images;

/// Returns an image of UASTC blocks of one colour each, in KTX2 2.0 without supercompression.
fn uastc(width: u32, height: u32, colors: &[[u8; 4]]) -> Vec<u8> {
    const HEAD: u32 = 80 + 24;
    const DESCRIPTOR: u32 = 44;
    let mut file = b"\xABKTX 20\xBB\r\n\x1A\n".to_vec();
    // Format, size of a word, extent, layers, faces, levels, supercompression; descriptor; key and value data.
    for word in [0, 1, width, height, 0, 0, 1, 1, 0, HEAD, DESCRIPTOR, 0, 0] {
        file.extend_from_slice(&u32::to_le_bytes(word));
    }
    let (start, length) = ((HEAD + DESCRIPTOR).next_multiple_of(16), 16 * colors.len() as u64);
    for word in [0, 0, start.into(), length, length] {
        file.extend_from_slice(&u64::to_le_bytes(word));
    }
    // A basic descriptor of version 2: colour model 166 (UASTC), BT.709, sRGB; blocks of 4 x 4; a sample of RGBA.
    for word in [DESCRIPTOR, 0, 2 | 40 << 16, 166 | 1 << 8 | 2 << 16, 3 | 3 << 8, 16, 0, 127 << 16 | 3 << 24, 0, 0, !0]
    {
        file.extend_from_slice(&u32::to_le_bytes(word));
    }
    file.resize(start as usize, 0);
    // Mode 8, whose code has 5 bits, is a block of one colour.
    for color in colors {
        let bits = 0x17 | u128::from(u32::from_le_bytes(*color)) << 5;
        file.extend_from_slice(&bits.to_le_bytes());
    }
    file
}

/// Returns a triangle whose texture is a KTX2 image.
fn textured(image: &[u8]) -> Draft {
    let mut draft = Draft::triangle();
    let view = draft.view(image);
    draft.push("images", json!({"bufferView": view, "mimeType": "image/ktx2"}));
    draft.push("textures", json!({"extensions": {"KHR_texture_basisu": {"source": 0}}}));
    draft.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft.json["extensionsRequired"] = json!(["KHR_texture_basisu"]);
    draft
}

#[test]
fn blocks_become_texels_row_by_row() {
    let colors = [[200, 30, 40, 255], [10, 20, 250, 128]];
    let scene = textured(&uastc(6, 3, &colors)).scene();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let image = &scene.images[0];
    assert_eq!((image.extent.width, image.extent.height), (6, 3));
    for (i, pixel) in image.pixels.iter().enumerate() {
        assert_eq!(*pixel, colors[usize::from(i % 6 >= 4)], "pixel {i}");
    }
}

#[test]
fn rejects_other_ktx2_images_with_the_reason() {
    let good = uastc(6, 3, &[[1, 2, 3, 4]; 2]);
    let with = |at: usize, word: u32| {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        textured(&bytes).complaint()
    };
    assert_mentions(&with(12, 37), &["image 0", "Basis"]);
    assert_mentions(&with(20, 1 << 20), &["image 0", "1048576 x 3"]);
    assert_mentions(&with(32, 3), &["image 0", "array"]);
}

#[test]
fn damaged_ktx2_images_never_panic() {
    let good = uastc(6, 3, &[[1, 2, 3, 4]; 2]);
    for length in 12..good.len() {
        assert!(images::decode(&good[..length], &Budget::unlimited()).is_err(), "{length} bytes");
    }
    for at in 12..good.len() {
        for value in [0, 1, 127, 255] {
            let mut bytes = good.clone();
            bytes[at] = value;
            let _ = images::decode(&bytes, &Budget::default());
        }
    }
}
