//! Input files that are missing, damaged, inconsistent, too large or elsewhere.

use diptych::image::{Extent, Image, exr};

use crate::common::Folder;

const RENDER: &str = "--size 32x18 --out ./out";

const SHOT: &str = "scene = 'builtin:cornell'\n[rig]\nyfov_deg = 40.0\n[[rig.key]]\nposition = [0.0, 1.0, 4.0]\n\
                    target = [0.0, 1.0, 0.0]\n";

/// Renders a file; expects an error with these parts, between which is ` | `.
#[track_caller]
fn refuses(folder: &Folder, file: &str, parts: &str) {
    folder.refuses(2, "", &format!("render {file} {RENDER} => {parts}"));
}

/// Writes a shot with this sky.
fn write_sky(folder: &Folder, name: &str, image: &str) {
    folder.write(name, format!("{SHOT}[environment]\nimage = '{image}'\n"));
}

#[test]
fn rejects_missing_shots_and_invalid_head_motion() {
    let folder = Folder::new();
    folder.write("picture.png", "not a shot");
    folder.write("shot.toml", SHOT);
    folder.write("scene.glb", glb_of(TRIANGLE));
    let sample = "{\"time_s\": 0, \"position_m\": [0, 0, 0], \"orientation\": [0, 0, 0, 1]}\n";
    let head = "{\"diptych_motion\": 1}\n";
    folder.write("twice.jsonl", format!("{head}{sample}{sample}"));
    folder.write("nan.jsonl", format!("{head}{}", sample.replace("[0, 0, 0]", "[0, NaN, 0]")));
    folder.write("bytes.jsonl", format!("{head}{sample}\u{0}\u{1}"));
    folder.write("headless.jsonl", sample);
    folder.write("empty.jsonl", "");
    let table = "
    render no/such/shot.toml --size 32x18 --out ./out => no/such/shot.toml
    render no/such/scene.gltf --size 32x18 --out ./out => no/such/scene.gltf
    render builtin:nonesuch --size 32x18 --out ./out => nonesuch | cornell | atrium
    render builtin: --size 32x18 --out ./out => cornell
    render ./picture.png --size 32x18 --out ./out => picture.png | .toml | .glb
    render ./ --size 32x18 --out ./out => ./

    --set motion=./twice.jsonl => twice.jsonl | line 3: time_s 0 is not after
    --set motion=./nan.jsonl => nan.jsonl | line 2:
    --set motion=./bytes.jsonl => bytes.jsonl | line 3:
    --set motion=./headless.jsonl => headless.jsonl | line 1:
    --set motion=./empty.jsonl => empty.jsonl | empty
    --set motion=no/such.jsonl => no/such.jsonl
    --set motion=./ => not a regular file
    --set motion=./shot.toml => motion | this is a shot
    --set motion=./scene.glb => motion | this is a scene
    --set variant=night => no variant named 'night'
    ";
    folder.refuses(2, "render ./scene.glb --size 32x18 --out ./out", table);
}

#[test]
fn rejects_invalid_values_in_shots() {
    let folder = Folder::new();
    for (name, from, to, parts) in [
        ("nan", "40.0", "nan", "nan.toml | yfov_deg"),
        ("infinite", "[0.0, 1.0, 4.0]", "[0.0, inf, 4.0]", "infinite.toml | position"),
        ("text", "40.0", "'wide'", "text.toml | yfov_deg"),
        ("typo", "yfov_deg", "yfov_degs", "typo.toml | yfov_degs"),
        ("no-view", "[0.0, 1.0, 0.0]", "[0.0, 1.0, 4.0]", "no-view.toml | target"),
        ("no-scene", "scene = 'builtin:cornell'\n", "", "no-scene.toml | scene"),
        ("lost-scene", "builtin:cornell", "lost/scene.gltf", "lost/scene.gltf"),
        ("no-toml", "[rig]", "[rig", "no-toml.toml"),
    ] {
        let text = SHOT.replacen(from, to, 1);
        assert_ne!(text, SHOT, "{name}");
        folder.write(&format!("{name}.toml"), text);
        refuses(&folder, &format!("./{name}.toml"), parts);
    }
    folder.write("good.toml", SHOT);
    folder.run(&format!("render ./good.toml {RENDER}"));
    assert_eq!(folder.names("out").len(), 7, "{:?}", folder.names("out"));
}

const TRIANGLE: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]}"#;

/// Returns a binary glTF file with three corners in its binary chunk.
fn glb_of(json: &str) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let binary = corners.map(f32::to_le_bytes).concat();
    let words = |values: [u32; 2]| values.map(u32::to_le_bytes).concat();
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let heads = [[2, length as u32], [json.len() as u32, 0x4e4f_534a], [binary.len() as u32, 0x004e_4942]].map(words);
    [&b"glTF"[..], &heads[0], &heads[1], &json, &heads[2], &binary].concat()
}

#[test]
fn rejects_damaged_glb_files() {
    let folder = Folder::new();
    let whole = glb_of(TRIANGLE);
    // Truncate within and at the ends of the header, the JSON chunk and the binary chunk.
    let from_end = [44, 37, 36, 1].map(|bytes| whole.len() - bytes);
    for keep in [0, 3, 4, 8, 11, 12, 16, 19, 20, 100].into_iter().chain(from_end) {
        let name = format!("cut-{keep}.glb");
        folder.write(&name, &whole[..keep]);
        refuses(&folder, &format!("./{name}"), &name);
    }
    let corners = whole.len() - 36;
    let not_finite = [&whole[..corners], &f32::NAN.to_le_bytes(), &whole[corners + 4..]].concat();
    folder.write("nan.glb", not_finite);
    refuses(&folder, "./nan.glb", "nan.glb");
    folder.write("whole.glb", whole);
    folder.run(&format!("render ./whole.glb {RENDER}"));
}

/// Errors name the faulty place in a file.
#[test]
fn rejects_inconsistent_glb_files() {
    let folder = Folder::new();
    let image = r#""materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],
        "images":[{"uri":"URI"}],"meshes":[{"primitives":[{"material":0,"#;
    let [lost, invalid] = ["lost.png", "data:image/png;base64,AAAA"].map(|uri| image.replace("URI", uri));
    let meshes = r#""meshes":[{"primitives":[{"#;
    let view = r#""bufferView":0,"componentType":5126,"count":3"#;
    let large = r#"{"mesh":0,"scale":[1e38,1e38,1e38],"children":[1]},{"scale":[1e9,1,1]}"#;
    for (name, from, to, parts) in [
        ("own-ancestor", r#"{"mesh":0}"#, r#"{"mesh":0,"children":[1]},{"children":[1]}"#, "node 1"),
        ("cycle", r#"[{"mesh":0}]"#, r#"[{"mesh":0},{"children":[2]},{"children":[1]}]"#, "ancestor"),
        ("no-mesh", r#"{"mesh":0}"#, r#"{"mesh":7}"#, "mesh | 7"),
        ("no-node", r#""nodes":[0]"#, r#""nodes":[9]"#, "node | 9"),
        ("no-accessor", r#""POSITION":0"#, r#""POSITION":4"#, "accessor | 4"),
        ("too-many", r#""count":3"#, r#""count":4"#, "accessor 0"),
        ("far-too-many", r#""count":3"#, r#""count":4000000000"#, "accessor 0"),
        ("zeros", view, r#""componentType":5126,"count":4000000000"#, "accessor 0"),
        ("bad-index", r#"{"POSITION":0}"#, r#"{"POSITION":0},"indices":0"#, "indices | accessor 0"),
        ("beyond", r#""buffer":0,"byteLength":36"#, r#""buffer":0,"byteOffset":8,"byteLength":36"#, "buffer"),
        ("infinite", r#"{"mesh":0}"#, large, "node 1"),
        ("huge", r#"{"mesh":0}"#, r#"{"mesh":0,"scale":[1e30,1e30,1e30]}"#, "units"),
        ("no-turn", r#"{"mesh":0}"#, r#"{"mesh":0,"rotation":[0,0,0,0]}"#, "node 0"),
        ("version", r#""2.0""#, r#""3.0""#, "3.0"),
        ("lost-image", meshes, &lost, "lost.png"),
        ("no-image", meshes, &invalid, "image 0"),
        ("no-json", r#"{"asset""#, r#"{"asset"#, "JSON"),
    ] {
        let json = TRIANGLE.replacen(from, to, 1);
        assert_ne!(json, TRIANGLE, "{name}");
        folder.write(&format!("{name}.glb"), glb_of(&json));
        // Without this option, images that cannot be read are left out.
        refuses(&folder, &format!("./{name}.glb --set strict=on"), parts);
    }
}

/// Invalid radiance in a sky counts as 0, with a warning.
#[test]
fn invalid_pixels_of_skies_are_replaced() {
    let folder = Folder::new();
    let mut sky = Image::filled(Extent::new(8, 4), [0.5f32; 3]);
    sky.pixels[3] = [f32::NAN, 1.0, 1.0];
    sky.pixels[9] = [1.0, f32::INFINITY, 1.0];
    sky.pixels[12] = [1.0, 1.0, -1.0];
    exr::write_rgb(&folder.path("sky.exr"), &sky).unwrap();
    write_sky(&folder, "sky.toml", "sky.exr");
    let said = folder.run(&format!("render ./sky.toml --spp 8 {RENDER}")).errors;
    assert!(said.contains("3 pixels") && said.contains("sky.exr"), "{said}");
    for name in ["left.exr", "right.exr"] {
        let image = exr::read_rgb(&folder.path("out").join(name)).unwrap();
        assert!(image.pixels.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0), "{name}");
    }
    assert_eq!(folder.json("out/run.json")["frames"][0]["nonfinite_samples"], 0);
}

#[test]
fn rejects_skies_that_do_not_decode() {
    let folder = Folder::new();
    let whole = folder.path("whole.exr");
    exr::write_rgb(&whole, &Image::filled(Extent::new(8, 4), [0.5f32; 3])).unwrap();
    let whole = std::fs::read(whole).unwrap();
    for (name, bytes) in [
        ("empty.exr", &[][..]),
        ("half.exr", &whole[..whole.len() / 2]),
        ("text.exr", b"not an image"),
        ("empty.hdr", b""),
        ("huge.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 40000\n"),
    ] {
        folder.write(name, bytes);
        write_sky(&folder, "sky.toml", name);
        refuses(&folder, "./sky.toml", name);
    }
    write_sky(&folder, "sky.toml", "lost.hdr");
    refuses(&folder, "./sky.toml", "lost.hdr");
}

#[test]
fn rejects_scenes_beyond_the_memory_budget() {
    let folder = Folder::new();
    folder.write("scene.glb", glb_of(TRIANGLE));
    refuses(&folder, "./scene.glb --set max_scene_memory=0.5kB", "scene.glb | max_scene_memory | 500 bytes");
    // The file fits, but the scene made from it does not.
    refuses(&folder, "./scene.glb --set max_scene_memory=3kB", "max_scene_memory | 2.9 KiB");
    folder.run(&format!("render ./scene.glb --set max_scene_memory=1MiB --environment white {RENDER}"));
}

/// A shot, a scene or a sky may come from anyone. Files outside its own folder are read only with permission.
#[test]
fn rejects_files_outside_the_folder_of_the_shot() {
    let folder = Folder::new();
    let glb = glb_of(TRIANGLE);
    let outside = folder.write("scene.glb", &glb);
    folder.write("corners.bin", &glb[glb.len() - 36..]);
    exr::write_rgb(&folder.path("sky.exr"), &Image::filled(Extent::new(8, 4), [0.5f32; 3])).unwrap();
    for (name, scene) in [("scene", "../scene.glb"), ("absolute", outside.to_str().unwrap())] {
        folder.write(&format!("inner/{name}.toml"), SHOT.replacen("builtin:cornell", scene, 1));
    }
    write_sky(&folder, "inner/sky.toml", "../sky.exr");
    let buffer = r#"{"byteLength":36,"uri":"../corners.bin"}"#;
    folder.write("inner/buffer.gltf", TRIANGLE.replacen(r#"{"byteLength":36}"#, buffer, 1));
    let files = [
        ("scene.toml", "../scene.glb"),
        ("absolute.toml", "scene.glb"),
        ("sky.toml", "../sky.exr"),
        ("buffer.gltf", "../corners.bin"),
    ];
    for (name, refused) in files {
        refuses(&folder, &format!("./inner/{name}"), &format!("{name} | {refused} | --set allow_outside=on"));
    }
    for (name, _) in files {
        folder.run(&format!("render ./inner/{name} --allow-outside {RENDER}"));
    }
}
