//! Files that a glTF file or a shot references: outside its folder, damaged, truncated, with a wrong length, or very
//! many.

use std::path::Path;
use std::time::Instant;

use ::exr::prelude::{Blocks, Compression};
use ::image::ImageFormat;
use diptych::scene::budget::{Budget, ByteSize};
use diptych::scene::complete::Overrides;
use diptych::scene::folder::Access;
use diptych::scene::load::load_shot_within;
use diptych::scene::{Environment, Scene};
use proptest::prelude::*;
use proptest::sample::select;
use serde_json::{Value, json};

use crate::bytes::{self, Damage};
use crate::effort::is_thorough;
use crate::{ALLOWED_BYTES, BUDGET, PATIENCE, allocations, glb, hold, images};

/// Value in the files outside the folder and in none inside: a coordinate and a colour.
const OUTSIDE: f32 = 7777.0;
const OUTSIDE_RGBA: [u8; 4] = [77, 177, 7, 255];

const NAMES: &str = r#"own.bin | ./own.bin | below/../own.bin | below/own.bin | own.png | %6Fwn.bin | lost.bin | below | . |  |
    %00 | %ff | ../outside.bin | ..%2Foutside.bin | below/../../outside.bin | ../outside.png | link.bin |
    up/outside.bin | ..\outside.bin | file:///etc/hostname | C:/outside.bin |
    //127.0.0.1/share/outside.bin | /dev/zero | data:;base64,AAAAAAAAAAA"#;

#[derive(Clone, Debug)]
struct Case {
    buffer: String,
    picture: String,
    /// Declared length of the buffer.
    length: u64,
    /// Number of additional buffers and pictures that reference the same files.
    copies: u16,
    /// Damage of the buffer and of the picture.
    damages: (Vec<Damage>, Vec<Damage>),
}

fn case(absolute: String) -> impl Strategy<Value = Case> {
    let name = |usual: &'static str| {
        let absolute = absolute.clone();
        prop_oneof![
            4 => Just(usual.to_owned()),
            4 => select(bytes::listed(NAMES)).prop_map(str::to_owned),
            1 => Just(absolute),
            1 => "[./a-z%0-9\\\\:]{0,12}",
        ]
    };
    let length = prop_oneof![6 => Just(48), 1 => 0..100u64, 1 => any::<u64>(), 1 => Just(1 << 40)];
    let damages = || prop_oneof![1 => Just(Vec::new()), 1 => bytes::several()];
    let damages = (damages(), damages());
    (name("own.bin"), name("own.png"), length, 0..300u16, damages)
        .prop_map(|(buffer, picture, length, copies, damages)| Case { buffer, picture, length, copies, damages })
}

/// Returns a quad with a picture, each in a file of its own.
fn gltf(case: &Case) -> Value {
    let copies = usize::from(case.copies) + 1;
    let picture = json!({"uri": case.picture});
    let material = |i: usize| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}});
    json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0, "mode": 6}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC2"}],
        "bufferViews": [{"buffer": copies - 1, "byteLength": 48}],
        "buffers": vec![json!({"uri": case.buffer, "byteLength": case.length}); copies],
        "images": vec![picture; copies],
        "textures": (0..copies).map(|i| json!({"source": i})).collect::<Vec<_>>(),
        "materials": (0..copies).map(material).collect::<Vec<_>>(),
    })
}

fn quad(far: f32) -> Vec<u8> {
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, far, 1.0, 0.1, 0.0, 1.0, 0.0];
    bytemuck::cast_slice(&corners).to_vec()
}

fn png(rgba: [u8; 4]) -> Vec<u8> {
    bytes::picture(::image::RgbaImage::from_pixel(64, 64, ::image::Rgba(rgba)), ImageFormat::Png)
}

/// Creates `outside.*` beside `inner/`, which contains `own.*` and links that lead out.
fn folders() -> tempfile::TempDir {
    let outer = tempfile::tempdir().unwrap();
    let path = |name: &str| outer.path().join(name);
    std::fs::create_dir_all(path("inner/below")).unwrap();
    std::fs::write(path("outside.bin"), quad(OUTSIDE)).unwrap();
    std::fs::write(path("outside.png"), png(OUTSIDE_RGBA)).unwrap();
    std::fs::write(path("inner/below/own.bin"), quad(3.0)).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("../outside.bin", path("inner/link.bin")).unwrap();
        std::os::unix::fs::symlink("..", path("inner/up")).unwrap();
    }
    outer
}

fn is_from_outside(scene: &Scene) -> bool {
    let far = scene.meshes.iter().any(|mesh| mesh.positions.iter().any(|p| p.x == OUTSIDE));
    far || scene.images.iter().any(|image| image.pixels.contains(&OUTSIDE_RGBA))
}

#[test]
fn files_outside_the_folder_are_never_read() {
    let outer = folders();
    let inner = outer.path().join("inner");
    let absolute = outer.path().join("outside.bin").to_str().unwrap().to_owned();
    let (own, picture) = (quad(1.0), png([1, 2, 3, 255]));
    let [buffer, name] = ["own.bin", "own.png"].map(str::to_owned);
    let whole = Case { buffer, picture: name, length: 48, copies: 9, damages: Default::default() };
    let read = |case: &Case| {
        let (mut own, mut picture) = (own.clone(), picture.clone());
        bytes::apply(&mut own, &case.damages.0);
        bytes::apply(&mut picture, &case.damages.1);
        std::fs::write(inner.join("own.bin"), own).unwrap();
        std::fs::write(inner.join("own.png"), picture).unwrap();
        std::fs::write(inner.join("scene.gltf"), gltf(case).to_string()).unwrap();
        glb::load_as_is(&inner.join("scene.gltf"), &Budget::new(BUDGET))
    };
    let scene = read(&whole).unwrap();
    assert_eq!((scene.materials.len(), scene.images.len()), (10, 1));
    hold(1000, ALLOWED_BYTES, case(absolute), |case| {
        let scene = read(&case);
        assert!(!scene.as_ref().is_some_and(is_from_outside), "a file outside was read");
    });
}

/// Damages the environment file of a shot.
#[test]
fn damaged_skies_of_shots_load_or_are_rejected() {
    let outer = folders();
    let lines = images::exr_bytes(Compression::ZIP16, Blocks::ScanLines);
    let exrs = [lines, images::exr_bytes(Compression::PIZ, Blocks::Tiles(::exr::prelude::Vec2(8, 8)))];
    let seeds = exrs.into_iter().map(|bytes| ("sky.exr", bytes)).chain(
        // Some headers claim far more pixels than the file has.
        images::hdr_seeds().into_iter().chain([huge_hdr(30_000, 8_000), huge_hdr(32_768, 1)]).map(|b| ("sky.hdr", b)),
    );
    let shot = |name: &str| {
        format!(
            "scene = 'builtin:cornell'\n[rig]\n[[rig.key]]\nposition = [0, 1, 4]\ntarget = [0, 1, 0]\n\
             [environment]\nimage = '{name}'\n"
        )
    };
    let path = outer.path().join("inner/shot.toml");
    let read = |name: &str, bytes: &[u8]| {
        std::fs::write(outer.path().join("inner").join(name), bytes).unwrap();
        std::fs::write(&path, shot(name)).unwrap();
        glb::load_as_is(&path, &Budget::new(BUDGET))
    };
    let seeds: Vec<_> = seeds.collect();
    let is_read = |(name, bytes): &(&str, Vec<u8>)| {
        read(name, bytes).is_some_and(|scene| matches!(scene.environment, Environment::Map { .. }))
    };
    assert_eq!(seeds.iter().map(is_read).collect::<Vec<_>>(), [true, true, true, true, false, false]);
    let damaged = (select(seeds), bytes::several());
    hold(1000, ALLOWED_BYTES, damaged, |((name, mut bytes), damages)| {
        bytes::apply(&mut bytes, &damages);
        read(name, &bytes);
    });
}

fn huge_hdr(width: u32, height: u32) -> Vec<u8> {
    format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n").into_bytes()
}

/// Reads a scene with that budget and prepares it for upload; returns the peak of allocated memory, and the scene.
fn peak(path: &Path, budget: ByteSize) -> (usize, Option<Scene>) {
    let before = allocations::start();
    let scene = glb::load_as_is(path, &Budget::new(budget));
    (allocations::peak() - before, scene)
}

/// Bound on the peak of allocated memory, in multiples of the scene's size.
const AMPLE: u64 = 8;

/// If any part of a scene exceeds the memory budget, the scene is rejected before that part is allocated. With ample
/// memory it is accepted.
#[test]
fn scenes_keep_within_their_budgets() {
    let _turn = crate::turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.gltf");
    for (name, json) in large_scenes(folder.path()) {
        std::fs::write(&path, json.to_string()).unwrap();
        let (needed, scene) = peak(&path, ByteSize(4 << 30));
        assert!(scene.is_some(), "{name}");
        assert!(needed > 8 << 20, "{name} takes only {needed} bytes");
        for share in (1..20).step_by(if is_thorough() { 1 } else { 6 }) {
            let budget = needed / 20 * share;
            let (taken, scene) = peak(&path, ByteSize(budget as u64));
            assert!(scene.is_none(), "{name}: not refused with {budget} bytes of {needed}");
            assert!(taken <= budget + (1 << 20), "{name}: {taken} bytes of {budget}, of {needed} in all");
        }
        let ample = needed as u64 * AMPLE;
        assert!(peak(&path, ByteSize(ample)).1.is_some(), "{name}: {ample} bytes are too few for {needed}");
    }
}

/// Returns scenes that each have one large part.
fn large_scenes(folder: &Path) -> Vec<(&'static str, Value)> {
    const COUNT: usize = 1 << 16;
    let corners: Vec<[f32; 3]> = (0..COUNT as u32 * 3)
        .map(|i| [(i * 37 % 1009) as f32, (i * 71 % 911) as f32, (i * 113 % 509) as f32])
        .collect();
    let uvs: Vec<[f32; 2]> = (0..COUNT as u32 * 3).map(|i| [(i % 7) as f32, (i % 11) as f32]).collect();
    std::fs::write(folder.join("corners.bin"), bytemuck::cast_slice::<_, u8>(&corners)).unwrap();
    std::fs::write(folder.join("uvs.bin"), bytemuck::cast_slice::<_, u8>(&uvs)).unwrap();
    let jpeg = ::image::RgbImage::from_fn(2048, 1024, |x, y| ::image::Rgb([x as u8, y as u8, 9]));
    std::fs::write(folder.join("picture.jpg"), bytes::picture(jpeg, ImageFormat::Jpeg)).unwrap();
    let scene = |nodes: usize, material: Value| {
        json!({
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..nodes).collect::<Vec<_>>()}],
            "nodes": vec![json!({"mesh": 0}); nodes],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": COUNT * 3, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5126, "count": COUNT * 3, "type": "VEC2"}],
            "bufferViews": [{"buffer": 0, "byteLength": COUNT * 36}, {"buffer": 1, "byteLength": COUNT * 24}],
            "buffers": [{"uri": "corners.bin", "byteLength": COUNT * 36}, {"uri": "uvs.bin", "byteLength": COUNT * 24}],
            "images": [{"uri": "picture.jpg"}], "textures": [{"source": 0}], "materials": [material],
        })
    };
    let texture = json!({"index": 0});
    let with = |list: &str, value: Value| {
        let mut scene = scene(0, json!({}));
        scene[list] = value;
        scene
    };
    vec![
        ("nodes", with("nodes", vec![json!({}); 30_000].into())),
        ("materials", with("materials", vec![json!({}); 10_000].into())),
        ("animations", with("animations", vec![json!({"channels": [], "samplers": []}); 50_000].into())),
        ("extensions", with("extensions", json!({"A": vec![json!({"a": {}}); 50_000]}))),
        ("children", with("nodes", json!([{"extensions": {"A": vec![0; 1_000_000]}}]))),
        ("triangles", scene(1, json!({}))),
        ("flattened instances", scene(20, json!({}))),
        ("instances of one tree", scene(40, json!({}))),
        ("tangents", scene(1, json!({"normalTexture": texture}))),
        ("lights", scene(1, json!({"emissiveFactor": [1, 1, 1]}))),
        ("a picture", scene(0, json!({"pbrMetallicRoughness": {"baseColorTexture": texture}}))),
    ]
}

/// A picture is scanned once even if many emissive materials use it.
#[test]
fn picture_shared_by_materials_is_scanned_once() {
    let _turn = crate::turn();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("own.bin"), quad(1.0)).unwrap();
    let large = ::image::GrayImage::from_pixel(2048, 2048, ::image::Luma([200]));
    std::fs::write(folder.path().join("own.png"), bytes::picture(large, ImageFormat::Png)).unwrap();
    let mut scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 6}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}], "buffers": [{"uri": "own.bin", "byteLength": 48}],
        "images": [{"uri": "own.png"}], "textures": [{"source": 0}],
    });
    let glow = json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}});
    scene["materials"] = vec![glow; 1000].into();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, scene.to_string()).unwrap();
    let begin = Instant::now();
    assert!(glb::load_as_is(&path, &Budget::unlimited()).is_some());
    assert!(begin.elapsed() < PATIENCE, "took {:?}", begin.elapsed());
}

/// The user may allow reading the same file.
#[test]
fn files_outside_are_read_only_if_allowed() {
    let outer = folders();
    let inner = outer.path().join("inner");
    std::fs::write(inner.join("own.png"), png([1, 2, 3, 255])).unwrap();
    let [buffer, picture] = ["../outside.bin", "../outside.png"].map(str::to_owned);
    let case = Case { buffer, picture, length: 48, copies: 0, damages: Default::default() };
    let path = inner.join("scene.gltf");
    std::fs::write(&path, gltf(&case).to_string()).unwrap();
    let load = |allow_outside| {
        load_shot_within(
            path.to_str().unwrap(),
            &Overrides::default(),
            Access { allow_outside, ..Access::of(&Budget::new(BUDGET)) },
        )
    };
    assert!(is_from_outside(&load(true).unwrap().1));
    let error = load(false).unwrap_err().to_string();
    assert!(error.contains("../outside.") && error.contains("allow files outside"), "{error}");
}
