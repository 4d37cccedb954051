//! Animated scenes: the choice of a file's animations, their time, and the messages about them.

use diptych::image::exr::read_channels;
use serde_json::{Value, json};

use crate::common::Folder;

/// Returns a folder with a scene of a floor and a triangle that animations lift or push aside.
fn folder() -> Folder {
    let folder = Folder::new();
    // The buffer holds corners, key times, then two tracks of two positions each.
    let corners: [f32; 9] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0];
    let tracks: [f32; 14] = [0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.8, 0.0, 0.0];
    let bytes: Vec<u8> = corners.iter().chain(&tracks).flat_map(|v| v.to_le_bytes()).collect();
    folder.write("moves.bin", &bytes);
    let view = |offset: usize, floats: usize| json!({"buffer": 0, "byteOffset": 4 * offset, "byteLength": 4 * floats});
    let accessor = |view: usize, kind: &str, count: usize| json!({"bufferView": view, "componentType": 5126, "type": kind, "count": count});
    let animation = |name: &str, output: usize| {
        json!({
            "name": name,
            "samplers": [{"input": 1, "output": output}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
        })
    };
    let mut positions = accessor(0, "VEC3", 3);
    (positions["min"], positions["max"]) = (json!([-1, -1, 0]), json!([1, 1, 0]));
    let mut seconds = accessor(1, "SCALAR", 2);
    (seconds["min"], seconds["max"]) = (json!([0]), json!([2]));
    let file = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "moves.bin", "byteLength": bytes.len()}],
        "bufferViews": [view(0, 9), view(9, 2), view(11, 6), view(17, 6)],
        "accessors": [positions, seconds, accessor(2, "VEC3", 2), accessor(3, "VEC3", 2)],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"name": "Leaf", "mesh": 0}, {"mesh": 0, "translation": [0, -1, -1], "scale": [3, 3, 3]}],
        "scenes": [{"nodes": [0, 1]}],
        "scene": 0,
        "animations": [animation("Lift", 2), animation("Push", 3)],
    });
    folder.write("moves.gltf", file.to_string());
    folder
}

/// Renders one picture; returns its folder.
#[track_caller]
fn render<'a>(folder: &Folder, shot: &str, out: &'a str, options: &str) -> &'a str {
    // Without temporal accumulation, rays of all frames go through the pixel centres.
    let fixed = "--size 32x24 --spp 1 --warm-up=0 --aov position --denoiser none";
    let view = "--position=0,0,4 --target=0,0,0 --environment=1,1,1";
    folder.run(&format!("render ./{shot} {fixed} {view} --out ./{out} {options}"));
    out
}

/// Returns the positions of surfaces in a picture. They depend neither on random numbers nor on earlier frames.
fn surfaces(folder: &Folder, out: &str, frame: Option<usize>) -> Vec<[f32; 3]> {
    let is_it = |name: &String| {
        let of_frame = frame.is_none_or(|i| name.contains(&format!("{i:04}")));
        name.contains("position") && name.contains("left") && name.ends_with(".exr") && of_frame
    };
    let found: Vec<_> = folder.names(out).into_iter().filter(is_it).collect();
    let [name] = &found[..] else { panic!("{found:?} of {frame:?}") };
    read_channels(&folder.path(out).join(name), ["X", "Y", "Z"]).unwrap().image.pixels
}

#[test]
fn options_select_the_animation_that_plays() {
    let folder = folder();
    let [all, lift, push, none, rest] = [
        ("all", "--time 1"),
        ("lift", "--time 1 --animation Lift"),
        ("push", "--time 1 --animation Push"),
        ("none", "--time 1 --animation none"),
        ("rest", "--time 0 --animation Lift"),
    ]
    .map(|(out, options)| surfaces(&folder, render(&folder, "moves.gltf", out, options), None));
    assert!(lift != push && lift != none && push != none && rest != lift);
    // If two animations drive the same node, the first one wins.
    assert!(all == lift, "all together are not the first");
    let moves = |out: &str| folder.json(&format!("{out}/run.json"))["scene"]["moves"].clone();
    let played = |out: &str| -> Vec<Value> {
        moves(out)["animations"].as_array().unwrap().iter().map(|one| one["name"].clone()).collect()
    };
    assert_eq!(played("lift"), ["Lift"]);
    assert_eq!(played("all"), ["Lift"], "nothing is left of the other");
    assert_eq!((&moves("lift")["rigid_instances"], &moves("lift")["nodes"]), (&json!(1), &json!(1)));
    assert_eq!(moves("none"), Value::Null);
    folder.refuses(
        2,
        "",
        "render ./moves.gltf --animation Jump --out ./unknown => no animation named 'Jump' | Lift, Push",
    );
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn frames_show_the_scene_at_their_times() {
    let folder = folder();
    let push = |out: &str, options: &str| {
        render(&folder, "moves.gltf", out, &format!("--animation Push {options}"));
    };
    push("sequence", "--time 0.5 --frames 4 --fps 2");
    let at: Vec<_> = (0..4).map(|i| surfaces(&folder, "sequence", Some(i))).collect();
    assert!(at.iter().enumerate().all(|(i, a)| at[..i].iter().all(|b| a != b)), "frames are of one time");
    // After two seconds the animation repeats; with `loop = false` it does not.
    for (time_s, frame) in [("0.5", 0), ("1.5", 2), ("2.5", 0)] {
        push(time_s, &format!("--time {time_s}"));
        assert!(surfaces(&folder, time_s, None) == at[frame], "frame {frame} is not that of {time_s} s");
    }
    folder.write("held.toml", "scene = 'moves.gltf'\nanimation = 'Push'\nloop = false\n");
    let [held, end] = ["2.5", "7"]
        .map(|time_s| surfaces(&folder, render(&folder, "held.toml", "held", &format!("--time {time_s}")), None));
    assert!(held == end && held != at[0]);
}
