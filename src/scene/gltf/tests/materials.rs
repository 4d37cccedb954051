//! Tests of materials, textures and images.

use std::f32::consts::FRAC_PI_2;
use std::fs;
use std::io::Cursor;

use glam::{Affine2, Vec2, Vec3, Vec4};
use image::{DynamicImage, ImageFormat, Rgba, RgbaImage};
use serde_json::{Value, json};

use super::{Draft, assert_mentions, load};
use crate::scene::budget::Budget;
use crate::scene::folder::Access;
use crate::scene::motion::play::Play;
use crate::scene::{AlphaMode, Material, NormalMap, TextureRef, Wrap};

/// Two texels in a row.
pub(super) const LEFT: [u8; 4] = [10, 20, 30, 40];
pub(super) const RIGHT: [u8; 4] = [110, 120, 130, 140];

fn encoded(format: ImageFormat) -> Vec<u8> {
    let image = RgbaImage::from_fn(2, 1, |x, _| Rgba(if x == 0 { LEFT } else { RIGHT }));
    let image = DynamicImage::from(image);
    let image = if format == ImageFormat::Jpeg { DynamicImage::from(image.into_rgb8()) } else { image };
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

pub(super) fn with_material(material: Value) -> Draft {
    let mut draft = Draft::triangle();
    draft.push("materials", material);
    draft.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    draft
}

/// Returns a file whose texture 0 shows image 0, a PNG in the buffer.
pub(super) fn with_texture(material: Value) -> Draft {
    let mut draft = with_material(material);
    let view = draft.view(&encoded(ImageFormat::Png));
    draft.push("images", json!({"bufferView": view, "mimeType": "image/png", "name": "Bricks"}));
    draft.push("textures", json!({"source": 0}));
    draft
}

#[test]
fn factors_are_read_and_defaults_are_gltfs() {
    let draft = with_material(json!({
        "name": "Lamp",
        "pbrMetallicRoughness": {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.25, "roughnessFactor": 0.5},
        "emissiveFactor": [1, 0.5, 0],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}},
        "alphaMode": "MASK",
        "doubleSided": true,
    }));
    let expected = Material {
        name: "Lamp".into(),
        base_color: Vec4::new(0.1, 0.2, 0.3, 0.4),
        metallic: 0.25,
        roughness: 0.5,
        emissive: Vec3::new(10.0, 5.0, 0.0),
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        specular: 1.0,
        ..Material::default()
    };
    assert_eq!(draft.scene().materials, [expected]);
    let bare = Material { metallic: 1.0, specular: 1.0, ..Material::default() };
    assert_eq!(with_material(json!({})).scene().materials, [bare]);
}

#[test]
fn primitives_without_material_get_the_default() {
    let mut draft = with_material(json!({"name": "First"}));
    draft.primitive(json!({"attributes": {"POSITION": 0}}));
    let scene = draft.scene();
    assert_eq!(scene.meshes.iter().map(|m| m.material).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(scene.materials[1], Material::default());
}

#[test]
fn factors_out_of_range_are_clamped_or_named() {
    let scene = with_material(json!({"pbrMetallicRoughness": {"roughnessFactor": 7, "metallicFactor": -1}})).scene();
    assert_eq!((scene.materials[0].roughness, scene.materials[0].metallic), (1.0, 0.0));
    assert_eq!(scene.warnings.len(), 2);
    let cases = [
        json!({"emissiveFactor": [1e39, 0, 0]}),
        json!({"pbrMetallicRoughness": {"roughnessFactor": 1e39}}),
        json!({"pbrMetallicRoughness": {"metallicFactor": -1e39}}),
        json!({"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 1e39, 0]}}),
        json!({
            "emissiveFactor": [1, 1, 1],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e39}},
        }),
        json!({"alphaMode": "MASK", "alphaCutoff": -1}),
    ];
    for case in cases {
        assert_mentions(&with_material(case).complaint(), &["material 0"]);
    }
}

#[test]
fn one_image_serves_all_its_textures() {
    let mut draft = with_texture(json!({
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "emissiveTexture": {"index": 1, "texCoord": 1},
    }));
    draft.push("samplers", json!({"magFilter": 9728, "wrapS": 33071, "wrapT": 33648}));
    draft.push("textures", json!({"source": 0, "sampler": 0}));
    draft.push("images", json!({"uri": "never-opened.png"}));
    draft.push("textures", json!({"source": 1}));
    let scene = draft.scene();
    assert_eq!((scene.images.len(), scene.textures.len()), (1, 2));
    assert_eq!(scene.images[0].pixels, [LEFT, RIGHT]);
    let (base, emissive) =
        (scene.materials[0].base_color_texture.unwrap(), scene.materials[0].emissive_texture.unwrap());
    assert_eq!((base.texture, base.uv_set, base.uv_from_uv), (0, 0, Affine2::IDENTITY));
    assert_eq!((emissive.texture, emissive.uv_set), (1, 1));
    assert!(scene.textures[0].linear && !scene.textures[1].linear);
    assert_eq!((scene.textures[0].wrap_u, scene.textures[0].wrap_v), (Wrap::Repeat, Wrap::Repeat));
    assert_eq!((scene.textures[1].wrap_u, scene.textures[1].wrap_v), (Wrap::ClampToEdge, Wrap::MirroredRepeat));
}

#[test]
fn png_jpeg_and_webp_are_decoded() {
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP] {
        let mut draft = with_texture(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
        let view = draft.view(&encoded(format));
        draft.push("images", json!({"bufferView": view}));
        draft.json["textures"][0] = match format {
            ImageFormat::WebP => json!({"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}}),
            _ => json!({"source": 1}),
        };
        let texels = &draft.scene().images[0].pixels;
        let tolerance = if format == ImageFormat::Jpeg { 12 } else { 0 };
        for (texel, expected) in texels.iter().zip([LEFT, RIGHT]) {
            for (a, b) in texel.iter().zip(expected).take(3) {
                assert!(a.abs_diff(b) <= tolerance, "{format:?} {texels:?}");
            }
        }
    }
}

#[test]
fn sixteen_bit_images_are_reduced_to_eight() {
    let wide = image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(1, 1, image::Luma([0x8080u16]));
    let mut bytes = Cursor::new(Vec::new());
    DynamicImage::from(wide).write_to(&mut bytes, ImageFormat::Png).unwrap();
    let mut draft = with_texture(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let view = draft.view(&bytes.into_inner());
    draft.json["images"][0]["bufferView"] = json!(view);
    assert_eq!(draft.scene().images[0].pixels, [[128, 128, 128, 255]]);
}

#[test]
fn bad_images_beside_the_file_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.glb");
    let mut draft = with_texture(json!({"emissiveTexture": {"index": 0}}));
    draft.json["images"][0] = json!({"uri": "a%20wall.png"});
    fs::write(&path, draft.glb()).unwrap();
    let mentions = |words: &[&str]| {
        let scene = load(&path).unwrap();
        assert_eq!((scene.images.len(), scene.textures.len(), scene.warnings.len()), (0, 0, 1));
        assert_mentions(&scene.warnings[0], &["images that cannot be read are left out", "image 0 'a%20wall.png'"]);
        assert_mentions(&scene.warnings[0], words);
        let budget = Budget::unlimited();
        let access = Access { strict: true, ..Access::of(&budget) };
        let strict = crate::scene::gltf::load(&path, &Play::default(), None, access);
        assert_mentions(&strict.unwrap_err().to_string(), words);
    };
    mentions(&["a wall.png", "cannot read"]);
    fs::write(folder.path().join("a wall.png"), encoded(ImageFormat::Png)).unwrap();
    assert_eq!(load(&path).unwrap().images.len(), 1);
    fs::write(folder.path().join("a wall.png"), b"no picture").unwrap();
    mentions(&["not a PNG, JPEG, WebP or KTX2 image"]);

    let mut cut = with_texture(json!({"emissiveTexture": {"index": 0}}));
    cut.json["bufferViews"][2]["byteLength"] = json!(50);
    assert_mentions(&cut.complaint(), &["material 0", "image 0 'Bricks'"]);
}

#[test]
fn material_without_its_image_keeps_its_factor() {
    let texture = |index: u32| json!({"index": index});
    let mut draft = with_texture(json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.1, 0.2, 0.3, 1], "baseColorTexture": texture(1), "metallicFactor": 0,
        },
        "normalTexture": texture(0),
    }));
    for image in [
        json!({"uri": "no-such.png"}),
        json!({"uri": "https://example.com/wall.png"}),
        json!({"uri": "data:image/png;base64,AAAA"}),
        json!({"bufferView": 0}),
        json!({"mimeType": "image/png"}),
    ] {
        draft.json["images"] = json!([draft.json["images"][0], image]);
        draft.json["textures"] = json!([{"source": 0}, {"source": 1}]);
        let scene = draft.scene();
        let material = &scene.materials[0];
        assert_eq!((material.base_color, material.base_color_texture), (Vec4::new(0.1, 0.2, 0.3, 1.0), None));
        assert!(material.normal_map.is_some(), "{image}");
        assert!(scene.warnings.iter().any(|w| w.contains("image 1")), "{image}: {:?}", scene.warnings);
        let said = draft.complaint();
        assert!(said.contains("material 0: texture 1: image 1") || said.contains("no-such.png"), "{said}");
    }
    // What a file may not do stays an error, which says how to allow it.
    draft.json["images"][1] = json!({"uri": "../outside.png"});
    assert_mentions(&draft.read().unwrap_err().to_string(), &["material 0", "allow files outside"]);
}

#[test]
fn unknown_values_count_as_the_default() {
    let mut draft = with_texture(json!({
        "alphaMode": "GLASS",
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
    }));
    draft.push("samplers", json!({"magFilter": 1, "wrapS": 2, "wrapT": 33071}));
    draft.json["textures"][0]["sampler"] = json!(0);
    draft.primitive(json!({"attributes": {"POSITION": 0}, "mode": 9}));
    let scene = draft.scene();
    assert_eq!((scene.materials[0].alpha_mode, scene.meshes.len()), (AlphaMode::Opaque, 1));
    let texture = &scene.textures[0];
    assert_eq!((texture.wrap_u, texture.wrap_v, texture.linear), (Wrap::Repeat, Wrap::ClampToEdge, true));
    let warnings = scene.warnings.join("\n");
    assert_mentions(&warnings, &["alphaMode", "sampler 0", "mode is none of 0 to 6", "primitive 1"]);
}

#[test]
fn rejects_huge_images_by_their_header() {
    let mut png = encoded(ImageFormat::Png);
    png[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    let crc = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    let mut draft = with_texture(json!({"emissiveTexture": {"index": 0}}));
    let view = draft.view(&png);
    draft.json["images"][0]["bufferView"] = json!(view);
    assert_mentions(&draft.complaint(), &["image 0 'Bricks'"]);
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { (c >> 1) ^ 0xEDB8_8320 } else { c >> 1 })
    })
}

#[test]
fn every_texture_has_its_transform_and_coordinates() {
    let transform = json!({"offset": [0, 1], "rotation": FRAC_PI_2, "scale": [0.5, 0.5], "texCoord": 1});
    let info = json!({"index": 0, "extensions": {"KHR_texture_transform": transform}});
    let draft = with_texture(json!({
        "pbrMetallicRoughness": {"baseColorTexture": info, "metallicRoughnessTexture": info},
        "normalTexture": info,
        "emissiveTexture": info,
        "extensions": {
            "KHR_materials_specular": {"specularTexture": info, "specularColorTexture": info},
            "KHR_materials_transmission": {"transmissionTexture": info, "transmissionFactor": 1},
            "KHR_materials_clearcoat": {
                "clearcoatFactor": 1,
                "clearcoatTexture": info,
                "clearcoatRoughnessTexture": info,
                "clearcoatNormalTexture": info,
            },
        },
    }));
    let scene = draft.scene();
    let textures: Vec<_> = scene.materials[0].textures().collect();
    assert_eq!((textures.len(), scene.textures.len(), scene.images.len()), (10, 1, 1));
    assert!(textures.iter().all(|t| t.uv_set == 1 && *t == textures[0]));
    // Transforms of the extension's example: the lower left quadrant of the image.
    for (uv, expected) in [(Vec2::ZERO, Vec2::Y), (Vec2::X, Vec2::new(0.0, 0.5)), (Vec2::ONE, Vec2::splat(0.5))] {
        assert!(textures[0].uv_from_uv.transform_point2(uv).distance(expected) < 1e-6, "{uv}");
    }
}

#[test]
fn rejects_broken_extensions_of_textures() {
    for (transform, words) in [
        (json!({"scale": [1e39, 1]}), &["material 0", "KHR_texture_transform"][..]),
        (json!({"scale": "large"}), &["material 0", "normal map"]),
    ] {
        let info = json!({"index": 0, "extensions": {"KHR_texture_transform": transform}});
        assert_mentions(&with_texture(json!({"normalTexture": info})).complaint(), words);
    }
    let info = json!({"index": 0, "scale": 1e39});
    assert_mentions(&with_texture(json!({"normalTexture": info})).complaint(), &["material 0", "scale", "normal map"]);
}

#[test]
fn maps_of_metalness_roughness_and_normals_are_kept() {
    let draft = with_texture(json!({
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}, "roughnessFactor": 0.5},
        "normalTexture": {"index": 0, "scale": -0.5, "texCoord": 1},
        "occlusionTexture": {"index": 7},
    }));
    let scene = draft.scene();
    let material = &scene.materials[0];
    assert_eq!((material.metallic, material.roughness), (1.0, 0.5));
    let texture = TextureRef { texture: 0, uv_set: 0, uv_from_uv: Affine2::IDENTITY };
    assert_eq!(material.metallic_roughness_texture, Some(texture));
    let texture = TextureRef { uv_set: 1, ..texture };
    assert_eq!(material.normal_map, Some(NormalMap { texture, scale: -0.5 }));
    assert_eq!(scene.images[0].pixels, [LEFT, RIGHT]);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    assert_mentions(&scene.warnings[0], &["occlusion", "material 0"]);
    assert_mentions(&scene.warnings[1], &["normal maps", "mesh 0"]);
}

#[test]
fn unusable_texture_references_are_warned_of_or_named() {
    let beyond = with_texture(json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0, "texCoord": 2}}));
    let scene = beyond.scene();
    assert_eq!((scene.materials[0].emissive, scene.warnings.len()), (Vec3::ZERO, 1));
    let mut dds = with_texture(json!({
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}},
        "extensions": {"KHR_materials_transmission": {"transmissionTexture": {"index": 0}, "transmissionFactor": 1}},
    }));
    dds.json["textures"][0] = json!({"extensions": {"MSFT_texture_dds": {"source": 0}}});
    let scene = dds.scene();
    assert_eq!((scene.materials[0].metallic, scene.materials[0].transmission), (0.0, 0.0));
    assert_eq!(scene.warnings.len(), 1);
    assert_mentions(&scene.warnings[0], &["material 0", "1 more"]);
    assert_mentions(&with_texture(json!({"emissiveTexture": {"index": 3}})).complaint(), &["material 0", "texture 3"]);
    let mut lost = with_texture(json!({"emissiveTexture": {"index": 0}}));
    lost.json["textures"][0]["sampler"] = json!(2);
    assert_mentions(&lost.complaint(), &["texture 0", "sampler 2"]);
    lost.json["textures"][0] = json!({"source": 8});
    assert_mentions(&lost.complaint(), &["texture 0", "image 8"]);
}
