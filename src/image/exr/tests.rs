use ::exr::image::{Layer, Layers, Levels};
use ::exr::math::RoundingMode;
use ::exr::meta::attribute::IntegerBounds;
use ::exr::meta::header::{ImageAttributes, LayerAttributes};

use super::*;

type Part = Layer<AnyChannels<FlatSamples>>;

/// Returns small deterministic numbers in 0 … 1.
fn noise(count: usize, seed: u32) -> impl Iterator<Item = f32> {
    let mut state = seed;
    (0..count).map(move |_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    })
}

fn noise_image(extent: Extent, seed: u32) -> RgbImage {
    let values: Vec<f32> = noise(3 * extent.area(), seed).collect();
    Image { extent, pixels: values.as_chunks().0.to_vec() }
}

fn bits(image: &RgbImage) -> Vec<u32> {
    image.pixels.as_flattened().iter().map(|v| v.to_bits()).collect()
}

fn part(name: &str, extent: Extent, channels: &[(&str, FlatSamples)], encoding: Encoding) -> Part {
    let list = channels.iter().map(|(n, s)| AnyChannel::new(Text::from(*n), s.clone())).collect();
    let size = (extent.width as usize, extent.height as usize);
    Layer::new(size, LayerAttributes::named(name), encoding, AnyChannels::sort(list))
}

fn encoded(parts: Vec<Part>) -> Vec<u8> {
    let window = parts[0].absolute_bounds();
    let layer_data: Layers<_> = parts.into();
    let mut bytes = Vec::new();
    let image = ::exr::image::Image { attributes: ImageAttributes::new(window), layer_data };
    image.write().to_buffered(Cursor::new(&mut bytes)).unwrap();
    bytes
}

fn f32s(values: &[f32]) -> FlatSamples {
    FlatSamples::F32(values.to_vec())
}

fn decode_colour(bytes: &[u8]) -> Result<ColourFile, Refusal> {
    decode(bytes, u64::MAX, Colour::find)
}

fn decoded(bytes: &[u8]) -> RgbImage {
    decoded_colour(bytes).image
}

fn decoded_colour(bytes: &[u8]) -> ColourFile {
    decode_colour(bytes).unwrap_or_else(|e| match e {
        Refusal::Unreadable(why) | Refusal::Unsupported(why) | Refusal::NotThere(why) => panic!("{why}"),
        Refusal::TooLarge(needed) => panic!("{needed} bytes"),
    })
}

#[track_caller]
fn assert_unsupported(bytes: &[u8], named: &str) {
    match decode_colour(bytes) {
        Err(Refusal::Unsupported(what)) => assert!(what.contains(named), "{what}"),
        Err(Refusal::Unreadable(why) | Refusal::NotThere(why)) => panic!("{why}"),
        Err(Refusal::TooLarge(needed)) => panic!("{needed} bytes"),
        Ok(_) => panic!("it was read"),
    }
}

const PLAIN: Encoding =
    Encoding { compression: Compression::ZIP16, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };

#[test]
fn colour_survives_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    for extent in [Extent::new(1, 1), Extent::new(37, 41), Extent::new(1, 100), Extent::new(100, 1)] {
        let mut image = noise_image(extent, 7);
        let odd = [f32::NAN, f32::from_bits(0x7fc0_1234), f32::INFINITY, f32::NEG_INFINITY, -0.0, f32::MAX, 1e-45];
        for (slot, value) in image.pixels.as_flattened_mut().iter_mut().zip(odd) {
            *slot = value;
        }
        write_rgb(&path, &image).unwrap();
        let back = read_rgb(&path).unwrap();
        assert_eq!(back.extent, extent);
        assert_eq!(bits(&back), bits(&image));
    }
}

#[test]
fn same_bytes_for_equal_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let image = noise_image(Extent::new(33, 20), 3);
    let bytes = ["a.exr", "b.exr"].map(|name| {
        let path = folder.path().join(name);
        write_rgb(&path, &image).unwrap();
        fs::read(path).unwrap()
    });
    assert_eq!(bytes[0], bytes[1]);
}

#[test]
fn single_channel_reads_as_grey() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("depth.exr");
    let depth: Vec<f32> = noise(6, 1).collect();
    write_tagged_channels(&path, Extent::new(3, 2), &[("Z", &depth)], &Tags::default()).unwrap();
    assert_eq!(read_rgb(&path).unwrap().pixels, depth.iter().map(|&z| [z; 3]).collect::<Vec<_>>());
}

#[test]
fn rejects_channels_that_do_not_fit() {
    let folder = tempfile::tempdir().unwrap();
    let write = |extent, channels: &[(&str, &[f32])]| {
        write_tagged_channels(&folder.path().join("a.exr"), extent, channels, &Tags::default())
    };
    let two = Extent::new(2, 1);
    assert!(write(two, &[("Z", &[1.0])]).is_err());
    assert!(write(two, &[("", &[1.0, 2.0])]).is_err());
    assert!(write(two, &[("Z", &[1.0, 2.0]), ("Z", &[1.0, 2.0])]).is_err());
    assert!(write(two, &[]).is_err());
    assert!(write(Extent::new(0, 0), &[("Z", &[])]).is_err());
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn half_and_uint_channels_are_read_as_floats() {
    let extent = Extent::new(2, 1);
    let half = FlatSamples::F16([0.5, 65504.0].map(f16::from_f32).to_vec());
    let uint = FlatSamples::U32(vec![3, 70_000]);
    let channels = [("R", half.clone()), ("G", uint), ("B", f32s(&[-1.5, 0.25])), ("A", half)];
    let image = decoded(&encoded(vec![part("", extent, &channels, PLAIN)]));
    assert_eq!(image.pixels, [[0.5, 3.0, -1.5], [65504.0, 70_000.0, 0.25]]);
}

#[test]
fn tiles_and_any_lossless_compression_are_read() {
    let extent = Extent::new(45, 19);
    let planes = [1, 2, 3].map(|seed| noise(extent.area(), seed).collect::<Vec<f32>>());
    let channels = [("R", f32s(&planes[0])), ("G", f32s(&planes[1])), ("B", f32s(&planes[2]))];
    let compressions =
        [Compression::Uncompressed, Compression::RLE, Compression::ZIP1, Compression::ZIP16, Compression::PIZ];
    for compression in compressions {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 8))] {
            let encoding = Encoding { compression, blocks, ..PLAIN };
            let mut layer = part("", extent, &channels, encoding);
            layer.attributes.layer_position = Vec2(-7, 1000);
            let image = decoded(&encoded(vec![layer]));
            assert_eq!(image.extent, extent);
            for (i, pixel) in image.pixels.iter().enumerate() {
                assert_eq!(*pixel, [planes[0][i], planes[1][i], planes[2][i]], "{compression} {blocks:?} pixel {i}");
            }
        }
    }
}

#[test]
fn picture_covers_the_display_window() {
    let extent = Extent::new(5, 4);
    let planes = [1, 2, 3].map(|seed| noise(extent.area(), seed).collect::<Vec<f32>>());
    let channels = [("R", f32s(&planes[0])), ("G", f32s(&planes[1])), ("B", f32s(&planes[2]))];
    let read = |blocks, data: Vec2<i32>, picture: (Vec2<i32>, Vec2<usize>)| {
        let mut layer = part("", extent, &channels, Encoding { blocks, ..PLAIN });
        layer.attributes.layer_position = data;
        let layer_data: Layers<_> = vec![layer].into();
        let attributes = ImageAttributes::new(IntegerBounds { position: picture.0, size: picture.1 });
        let mut bytes = Vec::new();
        let image = ::exr::image::Image { attributes, layer_data };
        image.write().to_buffered(Cursor::new(&mut bytes)).unwrap();
        decode_colour(&bytes).map(|file| file.image)
    };
    // Overscan, a crop, both, a window far off, and windows that do not meet.
    let far = Vec2(-1_000_000, 1_000_000_000);
    for (data, position, size) in [
        (Vec2(-1, -2), Vec2(0, 0), Vec2(3, 1)),
        (Vec2(2, 1), Vec2(0, 0), Vec2(9, 7)),
        (Vec2(-3, 2), Vec2(0, 0), Vec2(4, 4)),
        (Vec2(far.0 - 2, far.1 + 1), far, Vec2(6, 3)),
        (Vec2(7, 0), Vec2(0, 0), Vec2(5, 4)),
        (far, Vec2(0, 0), Vec2(5, 4)),
    ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(2, 2))] {
            let Ok(image) = read(blocks, data, (position, size)) else { panic!("{data:?} {size:?}") };
            assert_eq!(image.extent, Extent::new(size.0 as u32, size.1 as u32));
            for (i, pixel) in image.pixels.iter().enumerate() {
                let x = (i % size.0) as i64 + i64::from(position.0) - i64::from(data.0);
                let y = (i / size.0) as i64 + i64::from(position.1) - i64::from(data.1);
                let is_there = (0..5).contains(&x) && (0..4).contains(&y);
                let expected = [0, 1, 2].map(|c: usize| if is_there { planes[c][(5 * y + x) as usize] } else { 0.0 });
                assert_eq!(*pixel, expected, "{data:?} {size:?} pixel {i}");
            }
        }
    }
    let huge = read(Blocks::ScanLines, Vec2(0, 0), (Vec2(0, 0), Vec2(60_000, 60_000)));
    assert!(matches!(huge, Err(Refusal::Unreadable(why)) if why.contains("60000x60000")));
}

#[test]
fn plain_rgb_is_preferred_to_layers_and_luminance() {
    let extent = Extent::new(1, 1);
    let one = |name: &'static str, v: f32| (name, f32s(&[v]));
    let depth = || part("depth", extent, &[one("Z", 9.0)], PLAIN);
    let layered = || {
        let channels = [one("a.X", 8.0), one("diffuse.R", 4.0), one("diffuse.G", 5.0), one("diffuse.B", 6.0)];
        part("layered", extent, &channels, PLAIN)
    };
    let plain = || part("plain", extent, &[one("R", 1.0), one("G", 2.0), one("B", 3.0)], PLAIN);
    let grey = || part("grey", extent, &[one("Y", 7.0), one("A", 1.0)], PLAIN);

    for (parts, colour, source, is_plain) in [
        (vec![plain()], [1.0, 2.0, 3.0], "channels R, G, B", true),
        (vec![depth(), layered(), plain()], [1.0, 2.0, 3.0], "channels R, G, B of part 3 of 3, \"plain\"", false),
        (
            vec![grey(), layered()],
            [4.0, 5.0, 6.0],
            "channels diffuse.R, diffuse.G, diffuse.B of part 2 of 2, \"layered\"",
            false,
        ),
        (vec![grey()], [7.0; 3], "channels Y, Y, Y", false),
    ] {
        let ColourFile { image, source: found, .. } = decoded_colour(&encoded(parts));
        assert_eq!(image.pixels, [colour]);
        assert_eq!((found.to_string().as_str(), found.is_plain()), (source, is_plain));
    }
}

#[test]
fn largest_mip_level_is_read() {
    let level = |count: usize, value: f32| FlatSamples::F32(vec![value; count]);
    let levels = |value: f32| Levels::Mip {
        rounding_mode: RoundingMode::Down,
        level_data: vec![level(15, value), level(2, 100.0), level(1, 200.0)],
    };
    let list = [("R", 1.0), ("G", 2.0), ("B", 3.0)].map(|(name, v)| AnyChannel::new(Text::from(name), levels(v)));
    let encoding = Encoding { blocks: Blocks::Tiles(Vec2(2, 2)), ..PLAIN };
    let channels = AnyChannels::sort(list.into_iter().collect());
    let image = ::exr::image::Image::from_layer(Layer::new((5, 3), LayerAttributes::named(""), encoding, channels));
    let mut bytes = Vec::new();
    image.write().to_buffered(Cursor::new(&mut bytes)).unwrap();
    let image = decoded(&bytes);
    assert_eq!((image.extent, image.pixels), (Extent::new(5, 3), vec![[1.0, 2.0, 3.0]; 15]));
}

/// B44 keeps differences within 4x4 blocks that fit in six bits of a half; PXR24 keeps 24 bits of a float.
#[test]
fn representable_values_survive_lossy_compression() {
    let extent = Extent::new(9, 6);
    let steps: Vec<f32> = (0..extent.area()).map(|n| 1.0 + (n % 9 + 2 * (n / 9)) as f32 / 1024.0).collect();
    let halves = FlatSamples::F16(steps.iter().map(|&v| f16::from_f32(v)).collect());
    for compression in [Compression::B44, Compression::B44A, Compression::PXR24] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(8, 8))] {
            let channels = [("R", halves.clone()), ("G", f32s(&steps)), ("B", halves.clone())];
            let image = decoded(&encoded(vec![part("", extent, &channels, Encoding { compression, blocks, ..PLAIN })]));
            let expected: Vec<_> = steps.iter().map(|&v| [v; 3]).collect();
            assert_eq!(image.pixels, expected, "{compression} {blocks:?}");
        }
    }
}

#[test]
fn rejects_files_without_colour_by_channels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("uv.exr");
    write_tagged_channels(&path, Extent::new(1, 1), &[("U", &[1.0]), ("V", &[2.0])], &Tags::default()).unwrap();
    let message = read_rgb(&path).unwrap_err().to_string();
    assert!(message.contains("uv.exr") && message.contains("U, V"), "{message}");
}

#[test]
fn channels_are_read_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.exr");
    write_tagged_channels(
        &path,
        Extent::new(2, 1),
        &[("X", &[1.0, 2.0]), ("Y", &[3.0, f32::INFINITY])],
        &Tags::default(),
    )
    .unwrap();
    let found = read_channels(&path, ["X", "Y", "Y"]).unwrap().image;
    assert_eq!(found.pixels, [[1.0, 3.0, 3.0], [2.0, f32::INFINITY, f32::INFINITY]]);
    let message = read_channels(&path, ["X", "Y", "Z"]).unwrap_err().to_string();
    assert!(message.contains("motion.exr has no channels X, Y, Z, only X, Y"), "{message}");
}

#[test]
fn rejects_missing_empty_and_foreign_files() {
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(read_rgb(&folder.path().join("none.exr")), Err(ImageError::Read { .. })));
    assert!(read_rgb(folder.path()).is_err());
    for bytes in [&b""[..], b"\x76\x2f\x31\x01", b"\x89PNG\r\n\x1a\n and so on"] {
        let path = folder.path().join("a.exr");
        fs::write(&path, bytes).unwrap();
        assert!(matches!(read_rgb(&path), Err(ImageError::Decode { .. })));
    }
}

/// Written by OpenEXR 3.5.3 through its Python binding: RGBA half, 32x32 tiles, ZIP, data window (-3, 5) to (4, 10).
/// Value n of the 8x6x3 colours, in row order, is n / 16. The display window is (0, 0) to (7, 5).
#[test]
fn file_by_the_reference_library_is_read() {
    let mut bytes = include_bytes!("openexr_tiled_half.exr").to_vec();
    let image = decoded(&bytes);
    assert_eq!(image.extent, Extent::new(8, 6));
    for (i, pixel) in image.pixels.iter().enumerate() {
        let n = |c: usize| if i >= 5 * 8 && i % 8 < 5 { 3 * (i % 8 + 3) + c } else { 0 };
        assert_eq!(*pixel, [0, 1, 2].map(|c| n(c) as f32 / 16.0), "{i}");
    }
    // The same with the data window as display window.
    let value = |name: &[u8]| bytes.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4;
    let (from, to) = (value(b"dataWindow\0box2i\0"), value(b"displayWindow\0box2i\0"));
    bytes.copy_within(from..from + 16, to);
    for (n, value) in decoded(&bytes).pixels.as_flattened().iter().enumerate() {
        assert_eq!(*value, n as f32 / 16.0);
    }
}

#[test]
fn rejects_dwa_by_name() {
    let plane = f32s(&[1.0; 64]);
    let encoding = Encoding { compression: Compression::DWAA(None), ..PLAIN };
    let bytes = encoded(vec![part("", Extent::new(8, 8), &[("Y", plane)], encoding)]);
    assert_unsupported(&bytes, "DWA");
}

#[test]
fn rejects_subsampled_channels_by_name() {
    let plane = f32s(&[1.0; 64]);
    let mut bytes = encoded(vec![part("", Extent::new(8, 8), &[("BY", plane.clone()), ("Y", plane)], PLAIN)]);
    // The crate cannot write subsampled channels. In the header a name and a zero are followed by the type, flags, and
    // the sampling in x and y.
    let sampling = bytes.windows(3).position(|w| w == b"BY\0").unwrap() + 3 + 8;
    assert_eq!(bytes[sampling..sampling + 8], [1, 0, 0, 0, 1, 0, 0, 0]);
    bytes[sampling] = 2;
    bytes[sampling + 4] = 2;
    assert_unsupported(&bytes, "subsampl");
}

/// Both files were written by OpenEXR 3.5.3 through its Python binding.
#[test]
fn rejects_deep_data_and_htj2k_by_name() {
    assert_unsupported(include_bytes!("openexr_deep.exr"), "deep data");
    assert_unsupported(include_bytes!("openexr_htj2k.exr"), "ht j2k");
}

/// Each truncation must fail. A mutation may change a sample only, but it must not panic.
#[test]
fn damaged_files_give_errors_and_no_panics() {
    let extent = Extent::new(23, 18);
    let planes = [4, 5, 6].map(|seed| f32s(&noise(extent.area(), seed).collect::<Vec<f32>>()));
    let half = FlatSamples::F16(noise(extent.area(), 9).map(f16::from_f32).collect());
    let [r, g, b] = planes;
    let channels = [("R", r), ("G", g), ("B", b), ("A", half)];
    for compression in [
        Compression::Uncompressed,
        Compression::RLE,
        Compression::ZIP16,
        Compression::PIZ,
        Compression::PXR24,
        Compression::B44,
        Compression::B44A,
    ] {
        for blocks in [Blocks::ScanLines, Blocks::Tiles(Vec2(16, 16))] {
            let good = encoded(vec![part("a", extent, &channels, Encoding { compression, blocks, ..PLAIN })]);
            for i in 0..40 {
                assert!(decode_colour(&good[..good.len() * i / 40]).is_err(), "{compression} cut to {i}/40");
            }
            let mut random = noise(usize::MAX, 11);
            let mut pick = |n: usize| (random.next().unwrap() * n as f32) as usize;
            for i in 0..variants() {
                let mut bad = good.clone();
                // Half of the mutations go to the header, where they matter most.
                let reach = if i % 2 == 0 { 400.min(bad.len()) } else { bad.len() };
                for _ in 0..=pick(4) {
                    bad[pick(reach)] = [0, 1, 0x7f, 0x80, 0xff, pick(256) as u8][pick(6)];
                }
                let _ = decode_colour(&bad);
            }
        }
    }
}

/// Number of mutations per encoding; `DIPTYCH_FUZZ=100000` runs more.
fn variants() -> usize {
    std::env::var("DIPTYCH_FUZZ").ok().and_then(|n| n.parse().ok()).unwrap_or(60)
}
