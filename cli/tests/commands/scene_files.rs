//! glTF files with triangles of extreme size, many copies of a mesh, and missing textures.

use std::time::{Duration, Instant};

use diptych::image::RgbImage;
use diptych::image::exr::read_rgb;
use serde_json::{Value, json};

use crate::common::Folder;

/// Writes `floor.gltf`: a square floor with half sides of two units, below a camera and a directional light of irradiance pi. Its
/// albedo is 0.5, so its radiance is too.
fn write_floor(folder: &Folder, unit: f64, change: impl FnOnce(&mut Value)) {
    let corners = [[-2.0, 0.0, -2.0], [-2.0, 0.0, 2.0], [2.0, 0.0, 2.0], [2.0, 0.0, -2.0]];
    let positions: Vec<f32> = corners.iter().flatten().map(|x: &f64| (x * unit) as f32).collect();
    let indices: [u16; 6] = [0, 1, 2, 0, 2, 3];
    let bytes = [bytemuck::cast_slice::<f32, u8>(&positions), bytemuck::cast_slice(&indices)].concat();
    folder.write("floor.bin", bytes);
    let down = json!([-std::f64::consts::FRAC_1_SQRT_2, 0, 0, std::f64::consts::FRAC_1_SQRT_2]);
    let matte = json!({"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0, "roughnessFactor": 1});
    let mut json = json!({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [
            {"mesh": 0},
            {"rotation": down, "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"rotation": down, "translation": [0, unit, 0], "camera": 0},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 12},
        ],
        "buffers": [{"byteLength": 60, "uri": "floor.bin"}],
        "materials": [{
            "pbrMetallicRoughness": matte,
            "extensions": {"KHR_materials_specular": {"specularFactor": 0}},
        }],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "extensions": {"KHR_lights_punctual": {"lights": [
            {"type": "directional", "intensity": std::f64::consts::PI},
        ]}},
    });
    change(&mut json);
    folder.write("floor.gltf", json.to_string());
}

/// Renders the floor. Returns the left eye's image and the messages.
#[track_caller]
fn render(folder: &Folder, options: &str) -> (RgbImage, String) {
    let plain = "--spp 1 --exposure 0 --denoiser none --environment 0,0,0 --set baseline=0";
    let said = folder.run(&format!("render ./floor.gltf --size 16x9 {plain} --out ./out {options}")).errors;
    (read_rgb(&folder.path("out/left.exr")).unwrap(), said)
}

#[test]
fn floor_of_any_size_is_lit() {
    let folder = Folder::new();
    for unit in [1e-15, 1e-12, 1.0, 1.2e9, 2e13] {
        write_floor(&folder, unit, |_| ());
        let (image, said) = render(&folder, "");
        let is_lit = |pixel: &[f32; 3]| pixel.iter().all(|channel| (channel - 0.5).abs() < 1e-3);
        assert!(image.pixels.iter().all(is_lit), "{unit:e}: {:?} {said}", image.pixels[0]);
    }
}

#[test]
fn copies_in_one_place_look_like_one() {
    let folder = Folder::new();
    write_floor(&folder, 1.0, |_| ());
    let (one, _) = render(&folder, "");
    for alpha_mode in ["OPAQUE", "MASK"] {
        write_floor(&folder, 1.0, |json| {
            json["materials"][0]["alphaMode"] = json!(alpha_mode);
            let nodes = json["nodes"].as_array_mut().unwrap();
            nodes.resize(2000, json!({"mesh": 0}));
            json["scenes"][0]["nodes"] = (0..2000).collect();
        });
        let begin = Instant::now();
        let (image, said) = render(&folder, "--set scene_cache=off");
        assert!(begin.elapsed() < Duration::from_secs(60), "{alpha_mode}: {:?}", begin.elapsed());
        assert_eq!(image, one, "{alpha_mode} {said}");
    }
}

#[test]
fn rejects_missing_textures_in_strict_mode() {
    let folder = Folder::new();
    write_floor(&folder, 1.0, |json| {
        json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": 0});
        json["textures"] = json!([{"source": 0}]);
        json["images"] = json!([{"uri": "textures\\grey.png"}]);
    });
    let (image, said) = render(&folder, "");
    assert!(image.pixels.iter().flatten().all(|channel| (channel - 0.5).abs() < 1e-3));
    assert!(said.contains("images that cannot be read are left out"), "{said}");
    folder.refuses(2, "", "info ./floor.gltf --set strict=on => cannot read | grey.png");
}
