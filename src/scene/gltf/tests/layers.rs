//! Tests of material extensions.

use glam::{Affine2, Vec3, Vec4, vec3};
use serde_json::{Value, json};

use super::materials::{LEFT, RIGHT, with_material, with_texture};
use super::{Draft, assert_mentions};
use crate::scene::{
    AlphaMode, Anisotropy, Clearcoat, DiffuseTransmission, Iridescence, Material, NormalMap, Scene, Sheen, TextureRef,
    Volume,
};

const TEXTURE: TextureRef = TextureRef { texture: 0, uv_set: 0, uv_from_uv: Affine2::IDENTITY };

fn with_extension(name: &str, extension: Value) -> Draft {
    let mut draft = with_texture(json!({"extensions": {name: extension}}));
    draft.json["extensionsUsed"] = json!([name]);
    draft.json["extensionsRequired"] = json!([name]);
    draft
}

/// Returns the first material, and asserts that there are no warnings.
#[track_caller]
fn quietly(scene: &Scene) -> &Material {
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    &scene.materials[0]
}

fn bare() -> Material {
    Material { metallic: 1.0, specular: 1.0, ..Material::default() }
}

#[test]
fn indices_of_refraction_are_0_or_at_least_1() {
    for (written, read, warnings) in [(1.33, 1.33, 0), (0.0, 0.0, 0), (1.0, 1.0, 0), (0.5, 1.0, 1), (-1.0, 1.0, 1)] {
        let scene = with_extension("KHR_materials_ior", json!({"ior": written})).scene();
        assert_eq!((scene.materials[0].ior, scene.warnings.len()), (read, warnings));
    }
    assert_eq!(*quietly(&with_extension("KHR_materials_ior", json!({})).scene()), bare());
    assert_mentions(&with_extension("KHR_materials_ior", json!({"ior": 1e39})).complaint(), &["material 0", "index"]);
}

#[test]
fn specular_reflection_is_read() {
    let name = "KHR_materials_specular";
    let scene = with_extension(
        name,
        json!({
            "specularFactor": 0.25,
            "specularTexture": {"index": 0},
            "specularColorFactor": [0, 0.5, 3],
            "specularColorTexture": {"index": 0, "texCoord": 1},
        }),
    )
    .scene();
    let expected = Material {
        specular: 0.25,
        specular_texture: Some(TEXTURE),
        specular_color: Vec3::new(0.0, 0.5, 3.0),
        specular_color_texture: Some(TextureRef { uv_set: 1, ..TEXTURE }),
        ..bare()
    };
    assert_eq!(*quietly(&scene), expected);
    assert_eq!(*quietly(&with_extension(name, json!({})).scene()), bare());
    let clamped = with_extension(name, json!({"specularFactor": 2, "specularColorFactor": [-1, 0, 0]})).scene();
    assert_eq!((clamped.materials[0].specular, clamped.materials[0].specular_color), (1.0, Vec3::ZERO));
    assert_eq!(clamped.warnings.len(), 2);
    for broken in [json!({"specularFactor": 1e39}), json!({"specularColorFactor": [1e39, 0, 0]})] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "specular", "finite"]);
    }
}

#[test]
fn transmission_is_read_and_clamped() {
    let name = "KHR_materials_transmission";
    let scene = with_extension(name, json!({"transmissionFactor": 0.5, "transmissionTexture": {"index": 0}})).scene();
    let expected = Material { transmission: 0.5, transmission_texture: Some(TEXTURE), ..bare() };
    assert_eq!(*quietly(&scene), expected);
    let none = with_extension(name, json!({"transmissionTexture": {"index": 0}})).scene();
    assert_eq!((quietly(&none), none.images.len()), (&bare(), 0));
    let scene = with_extension(name, json!({"transmissionFactor": 2})).scene();
    assert_eq!((scene.materials[0].transmission, scene.warnings.len()), (1.0, 1));
    assert_mentions(&with_extension(name, json!({"transmissionFactor": 1e39})).complaint(), &["transmission"]);
}

#[test]
fn volumes_have_a_thickness() {
    let name = "KHR_materials_volume";
    let read = |extension| with_extension(name, extension).scene();
    let filled = |attenuation_color, attenuation_distance| Some(Volume { attenuation_color, attenuation_distance });
    let jade = json!({"thicknessFactor": 2, "attenuationDistance": 0.5, "attenuationColor": [0, 0.5, 1]});
    assert_eq!(quietly(&read(jade)).volume, filled(Vec3::new(0.0, 0.5, 1.0), 0.5));
    assert_eq!(quietly(&read(json!({"thicknessFactor": 1}))).volume, filled(Vec3::ONE, f32::INFINITY));
    assert_eq!(quietly(&read(json!({"attenuationDistance": 3}))).volume, None);

    let textured = read(json!({"thicknessFactor": 1, "thicknessTexture": {"index": 0}}));
    assert!(textured.materials[0].volume.is_some() && textured.images.is_empty());
    assert_mentions(&textured.warnings[0], &["thickness textures"]);
    for distance in [0.0, -1.0] {
        let scene = read(json!({"thicknessFactor": 1, "attenuationDistance": distance}));
        assert_eq!(scene.materials[0].volume, filled(Vec3::ONE, f32::INFINITY));
        assert_mentions(&scene.warnings[0], &["attenuation distances", "material 0"]);
    }
    let clamped = read(json!({"thicknessFactor": -1, "attenuationColor": [2, 0, 0]}));
    assert_eq!((clamped.materials[0].volume, clamped.warnings.len()), (None, 2));
    for broken in [json!({"thicknessFactor": 1e39}), json!({"attenuationColor": [1e39, 0, 0]})] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "finite"]);
    }
}

#[test]
fn clearcoats_are_read() {
    let name = "KHR_materials_clearcoat";
    let coat = json!({
        "clearcoatFactor": 0.5,
        "clearcoatTexture": {"index": 0},
        "clearcoatRoughnessFactor": 0.25,
        "clearcoatRoughnessTexture": {"index": 0, "texCoord": 1},
        "clearcoatNormalTexture": {"index": 0, "scale": 2},
    });
    let mut draft = with_extension(name, coat);
    let uvs = draft.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    draft.attribute("TEXCOORD_0", uvs);
    let expected = Clearcoat {
        factor: 0.5,
        factor_texture: Some(TEXTURE),
        roughness: 0.25,
        roughness_texture: Some(TextureRef { uv_set: 1, ..TEXTURE }),
        normal_map: Some(NormalMap { texture: TEXTURE, scale: 2.0 }),
    };
    let scene = draft.scene();
    assert_eq!(*quietly(&scene), Material { clearcoat: expected, ..bare() });
    assert_eq!(scene.meshes[0].tangents.len(), 3);

    draft.json["materials"][0]["extensions"][name]["clearcoatFactor"] = json!(0);
    let scene = draft.scene();
    assert_eq!((quietly(&scene), scene.images.len()), (&bare(), 0));
    assert!(scene.meshes[0].tangents.is_empty());
    let clamped = with_extension(name, json!({"clearcoatFactor": 2, "clearcoatRoughnessFactor": 3})).scene();
    let expected = Clearcoat { factor: 1.0, roughness: 1.0, ..Clearcoat::default() };
    assert_eq!((clamped.materials[0].clearcoat, clamped.warnings.len()), (expected, 2));
    for broken in [json!({"clearcoatFactor": 1e39}), json!({"clearcoatTexture": 3}), json!("thick")] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "clearcoat"]);
    }
}

#[test]
fn sheens_are_read() {
    let name = "KHR_materials_sheen";
    let sheen = json!({
        "sheenColorFactor": [0.5, 0.25, 1],
        "sheenColorTexture": {"index": 0},
        "sheenRoughnessFactor": 0.25,
        "sheenRoughnessTexture": {"index": 0, "texCoord": 1},
    });
    let mut draft = with_extension(name, sheen);
    let expected = Sheen {
        color: vec3(0.5, 0.25, 1.0),
        color_texture: Some(TEXTURE),
        roughness: 0.25,
        roughness_texture: Some(TextureRef { uv_set: 1, ..TEXTURE }),
    };
    assert_eq!(*quietly(&draft.scene()), Material { sheen: expected, ..bare() });
    // Without a colour there is no sheen.
    draft.json["materials"][0]["extensions"][name]["sheenColorFactor"] = json!([0, 0, 0]);
    let scene = draft.scene();
    assert_eq!((quietly(&scene), scene.images.len()), (&bare(), 0));
    let clamped = with_extension(name, json!({"sheenColorFactor": [2, 0, 0], "sheenRoughnessFactor": 3})).scene();
    let expected = Sheen { color: Vec3::X, roughness: 1.0, ..Sheen::default() };
    assert_eq!((clamped.materials[0].sheen, clamped.warnings.len()), (expected, 2));
    for broken in [json!({"sheenColorFactor": [1e39, 0, 0]}), json!({"sheenColorFactor": [1]}), json!("velvet")] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "sheen"]);
    }
}

#[test]
fn diffuse_transmission_is_read() {
    let name = "KHR_materials_diffuse_transmission";
    let through = json!({
        "diffuseTransmissionFactor": 0.25,
        "diffuseTransmissionTexture": {"index": 0},
        "diffuseTransmissionColorFactor": [0.5, 0.25, 1],
        "diffuseTransmissionColorTexture": {"index": 0, "texCoord": 1},
    });
    let mut draft = with_extension(name, through);
    let expected = DiffuseTransmission {
        factor: 0.25,
        factor_texture: Some(TEXTURE),
        color: vec3(0.5, 0.25, 1.0),
        color_texture: Some(TextureRef { uv_set: 1, ..TEXTURE }),
    };
    assert_eq!(*quietly(&draft.scene()), Material { diffuse_transmission: expected, ..bare() });
    draft.json["materials"][0]["extensions"][name]["diffuseTransmissionFactor"] = json!(0);
    let scene = draft.scene();
    assert_eq!((quietly(&scene), scene.images.len()), (&bare(), 0));
    let white = with_extension(name, json!({"diffuseTransmissionFactor": 2})).scene();
    let expected = DiffuseTransmission { factor: 1.0, ..DiffuseTransmission::default() };
    assert_eq!((white.materials[0].diffuse_transmission, white.warnings.len()), (expected, 1));
    for broken in [json!({"diffuseTransmissionFactor": 1e39}), json!({"diffuseTransmissionTexture": 3}), json!(1)] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "transmission"]);
    }
}

#[test]
fn iridescence_is_read() {
    let name = "KHR_materials_iridescence";
    let film = json!({
        "iridescenceFactor": 0.5,
        "iridescenceTexture": {"index": 0},
        "iridescenceIor": 1.7,
        "iridescenceThicknessMinimum": 50,
        "iridescenceThicknessMaximum": 700,
        "iridescenceThicknessTexture": {"index": 0, "texCoord": 1},
    });
    let mut draft = with_extension(name, film);
    let expected = Iridescence {
        factor: 0.5,
        factor_texture: Some(TEXTURE),
        ior: 1.7,
        thickness_nm: [50.0, 700.0],
        thickness_texture: Some(TextureRef { uv_set: 1, ..TEXTURE }),
    };
    assert_eq!(*quietly(&draft.scene()), Material { iridescence: expected, ..bare() });
    draft.json["materials"][0]["extensions"][name]["iridescenceFactor"] = json!(0);
    assert_eq!(*quietly(&draft.scene()), bare());
    let usual = with_extension(name, json!({"iridescenceFactor": 1})).scene();
    assert_eq!(quietly(&usual).iridescence, Iridescence { factor: 1.0, ..Iridescence::default() });
    let odd = json!({"iridescenceFactor": 1, "iridescenceIor": 0.5, "iridescenceThicknessMaximum": -3});
    let odd = with_extension(name, odd).scene();
    let expected = Iridescence { factor: 1.0, ior: 1.0, thickness_nm: [100.0, 0.0], ..Iridescence::default() };
    assert_eq!((odd.materials[0].iridescence, odd.warnings.len()), (expected, 2));
    for broken in [json!({"iridescenceIor": 1e39}), json!({"iridescenceTexture": 3}), json!("oil")] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "iridescence"]);
    }
}

#[test]
fn unlit_materials_keep_colour_and_alpha_only() {
    let mut draft = with_texture(json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 1, 0.5],
            "baseColorTexture": {"index": 0},
            "metallicRoughnessTexture": {"index": 1},
        },
        "normalTexture": {"index": 1},
        "emissiveFactor": [1, 1, 1],
        "alphaMode": "BLEND",
        "doubleSided": true,
        "extensions": {"KHR_materials_unlit": {}},
    }));
    draft.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let expected = Material {
        base_color: Vec4::new(0.5, 0.25, 1.0, 0.5),
        base_color_texture: Some(TEXTURE),
        alpha_mode: AlphaMode::Blend,
        double_sided: true,
        unlit: true,
        ..Material::default()
    };
    assert_eq!(*quietly(&draft.scene()), expected);
}

#[test]
fn specular_glossiness_becomes_a_dielectric() {
    let name = "KHR_materials_pbrSpecularGlossiness";
    let plain = json!({"diffuseFactor": [0.2, 0.3, 0.4, 1], "specularFactor": [0.9, 0.5, 0], "glossinessFactor": 0.25});
    let expected = Material {
        base_color: Vec4::new(0.2, 0.3, 0.4, 1.0),
        roughness: 0.75,
        ior: 0.0,
        specular: 1.0,
        specular_color: Vec3::new(0.9, 0.5, 0.0),
        ..Material::default()
    };
    let mut draft = with_extension(name, plain);
    assert_eq!(*quietly(&draft.scene()), expected);
    draft.json["materials"][0]["pbrMetallicRoughness"] = json!({"metallicFactor": 0.5});
    assert_eq!(*quietly(&draft.scene()), expected);

    let mut draft = with_extension(
        name,
        json!({"diffuseTexture": {"index": 0}, "specularGlossinessTexture": {"index": 0}, "glossinessFactor": 0.5}),
    );
    draft.push("materials", draft.json["materials"][0].clone());
    let scene = draft.scene();
    let material = quietly(&scene);
    assert_eq!((material.base_color_texture, material.specular_color_texture), (Some(TEXTURE), Some(TEXTURE)));
    let rough = &scene.textures[material.metallic_roughness_texture.unwrap().texture];
    assert_eq!((material.roughness, material.specular_color, scene.images.len()), (1.0, Vec3::ONE, 2));
    // Green is 1 - glossiness / 2.
    let greens: Vec<_> = scene.images[rough.image].pixels.iter().map(|p| p[1]).collect();
    assert_eq!(greens, [LEFT, RIGHT].map(|p| (255.0 - 0.5 * f32::from(p[3])).round() as u8));
}

#[test]
fn anisotropy_is_read() {
    let name = "KHR_materials_anisotropy";
    let brushed = json!({"anisotropyStrength": 0.5, "anisotropyRotation": -0.7, "anisotropyTexture": {"index": 0}});
    let mut draft = with_extension(name, brushed);
    let expected = Anisotropy { strength: 0.5, rotation: -0.7, texture: Some(TEXTURE) };
    // The mesh has no texture coordinates.
    let scene = draft.scene();
    assert_eq!(scene.materials[0], Material { anisotropy: expected, ..bare() });
    assert_mentions(&scene.warnings.join(""), &["anisotropy", "texture coordinates", "Thing"]);
    draft.json["materials"][0]["extensions"][name]["anisotropyStrength"] = json!(0);
    assert_eq!(*quietly(&draft.scene()), bare());
    let strong = with_extension(name, json!({"anisotropyStrength": 2})).scene();
    let expected = Anisotropy { strength: 1.0, ..Anisotropy::default() };
    assert_eq!((strong.materials[0].anisotropy, strong.warnings.len()), (expected, 2));
    for broken in [json!({"anisotropyRotation": 1e39}), json!({"anisotropyTexture": 3}), json!(true)] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "anisotropy"]);
    }
}

#[test]
fn dispersion_is_read() {
    let name = "KHR_materials_dispersion";
    let scene = with_extension(name, json!({"dispersion": 0.4})).scene();
    assert_eq!(*quietly(&scene), Material { dispersion: 0.4, ..bare() });
    let odd = with_extension(name, json!({"dispersion": -1})).scene();
    assert_eq!((odd.materials[0].dispersion, odd.warnings.len()), (0.0, 1));
    for broken in [json!({"dispersion": 1e39}), json!({"dispersion": "rainbow"})] {
        assert_mentions(&with_extension(name, broken).complaint(), &["material 0", "dispersion"]);
    }
}

#[test]
fn unknown_extensions_warn_once_or_are_rejected() {
    let name = "EXT_materials_bump";
    let mut draft = with_material(json!({"extensions": {name: {"bumpFactor": 1}}}));
    draft.push("materials", draft.json["materials"][0].clone());
    draft.json["extensionsUsed"] = json!([name]);
    let scene = draft.scene();
    assert_eq!((&scene.materials[0], scene.warnings.len()), (&bare(), 1));
    assert_mentions(&scene.warnings[0], &[name]);
    draft.json["extensionsRequired"] = json!([name]);
    assert_mentions(&draft.complaint(), &[name]);
}
