//! Environment images and textures with damaged bytes.

use std::path::Path;

use ::exr::prelude::{Blocks, Compression, Encoding, LineOrder, SpecificChannels, Vec2, WritableImage};
use diptych::image::{Extent, Image, RgbImage, exr};
use diptych::scene::budget::Budget;
use diptych::scene::environment::read_latlong;
use diptych::scene::folder::Access;
use proptest::prelude::*;
use proptest::sample::select;

use crate::glb;
use crate::{ALLOWED_BYTES, BUDGET, bytes, hold};

fn picture() -> RgbImage {
    let pixels = (0..24 * 12).map(|i| [i as f32 * 0.1, 1.0, (i % 7) as f32]).collect();
    Image { extent: Extent::new(24, 12), pixels }
}

pub fn exr_bytes(compression: Compression, blocks: Blocks) -> Vec<u8> {
    let image = picture();
    let channels = SpecificChannels::rgb(|at: Vec2<usize>| {
        let [r, g, b] = *image.get(at.x() as u32, at.y() as u32);
        (r, g, ::exr::prelude::f16::from_f32(b))
    });
    let encoding = Encoding { compression, blocks, line_order: LineOrder::Increasing };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let whole = ::exr::image::Image::from_encoded_channels((24, 12), encoding, channels);
    whole.write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

fn exr_seeds() -> Vec<Vec<u8>> {
    let lines = Blocks::ScanLines;
    let tiles = Blocks::Tiles(Vec2(8, 8));
    let compressions = [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP1,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
    ];
    compressions.iter().flat_map(|&c| [exr_bytes(c, lines), exr_bytes(c, tiles)]).collect()
}

/// Returns Radiance files, flat and run-length encoded.
pub fn hdr_seeds() -> Vec<Vec<u8>> {
    let header =
        |w: u32, h: u32| format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n-Y {h} +X {w}\n").into_bytes();
    let mut flat = header(4, 3);
    flat.extend((0..48).map(|i| (i * 37 % 251) as u8));
    let mut runs = header(16, 2);
    for _ in 0..2 {
        runs.extend([2, 2, 0, 16]);
        for channel in 0..4u8 {
            runs.extend([128 + 10, 100 + channel, 6, 1, 2, 3, 4, 5, 6]);
        }
    }
    vec![flat, runs]
}

pub fn texture_seeds() -> Vec<Vec<u8>> {
    use ::image::{DynamicImage, ImageFormat, RgbaImage};
    let rgba = RgbaImage::from_fn(19, 7, |x, y| ::image::Rgba([(x * 13) as u8, (y * 31) as u8, 7, (x * y) as u8]));
    let whole = DynamicImage::ImageRgba8(rgba);
    vec![
        bytes::picture(whole.clone(), ImageFormat::Png),
        bytes::picture(whole.to_luma16(), ImageFormat::Png),
        bytes::picture(whole.to_rgb8(), ImageFormat::Jpeg),
        bytes::picture(whole, ImageFormat::WebP),
    ]
}

fn damaged(seeds: Vec<Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    (select(seeds), bytes::several()).prop_map(|(mut bytes, damages)| {
        bytes::apply(&mut bytes, &damages);
        bytes
    })
}

fn read(path: &Path, bytes: &[u8]) -> Option<RgbImage> {
    std::fs::write(path, bytes).unwrap();
    let (image, _) = read_latlong(path, 1.5, Access::of(&Budget::new(BUDGET))).ok()?;
    assert_eq!(image.pixels.len(), image.extent.area());
    assert!(image.pixels.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0));
    Some(image)
}

#[test]
fn damaged_openexr_files_load_or_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    for seed in exr_seeds() {
        assert!(read(&path, &seed).is_some());
    }
    let row = [1.0, -0.5, 0.25, 2.0];
    let (matrix, eye) = (Some([row; 4]), Some("left".to_owned()));
    let tags = exr::Tags { world_to_ndc: matrix, eye, frame: Some(7), time_s: Some(0.5), ..Default::default() };
    exr::write_tagged_rgb(&path, &picture(), &tags).unwrap();
    let seeds = exr_seeds().into_iter().chain([std::fs::read(&path).unwrap()]).collect();
    hold(1000, ALLOWED_BYTES, damaged(seeds), |bytes| drop(read(&path, &bytes)));
}

#[test]
fn damaged_radiance_files_load_or_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    for seed in hdr_seeds() {
        assert!(read(&path, &seed).is_some());
    }
    hold(1000, ALLOWED_BYTES, damaged(hdr_seeds()), |bytes| drop(read(&path, &bytes)));
}

/// Recomputes the checksums of PNG's chunks, which nearly all damage breaks.
fn mend_checksums(png: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = png.get(at..at + 4).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]) as usize) {
        let Some(end) = at.checked_add(8 + length).filter(|end| end + 4 <= png.len()) else { return };
        let crc = crc32(&png[at + 4..end]);
        png[end..end + 4].copy_from_slice(&crc.to_be_bytes());
        at = end + 4;
    }
}

/// Returns the checksum of PNG (ISO/IEC 15948, annex D).
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, _| if crc & 1 == 1 { 0xedb8_8320 ^ (crc >> 1) } else { crc >> 1 };
    !bytes.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), step))
}

#[test]
fn damaged_textures_load_or_are_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("textured.glb");
    for seed in texture_seeds() {
        assert!(glb::load(&path, &glb::textured(&seed)));
    }
    let strategy = (damaged(texture_seeds()), any::<bool>());
    hold(1000, ALLOWED_BYTES, strategy, |(mut bytes, mend)| {
        if mend && bytes.starts_with(b"\x89PNG") {
            mend_checksums(&mut bytes);
        }
        glb::load(&path, &glb::textured(&bytes));
    });
}
