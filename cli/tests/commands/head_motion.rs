//! Head motion: one run records, another replays on any number of devices, and invalid files are rejected.

use serde_json::Value;

use crate::common::Folder;

/// Returns all numbers of both eyes' matrices, frame by frame.
fn cameras(run: &Value) -> Vec<Vec<f64>> {
    let frames = run["frames"].as_array().unwrap();
    let numbers = |frame: &Value| {
        let eyes = ["left", "right"].map(|eye| frame["cameras"][eye]["world_to_camera"].clone());
        eyes.iter().flat_map(|m| m.as_array().unwrap()).flat_map(|r| r.as_array().unwrap()).map(number).collect()
    };
    frames.iter().map(numbers).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn play_records_motion_that_render_replays() {
    let folder = crate::play::one_rung();
    let common = "builtin:atrium --size 32x18 --fps 5 --frames 8 --quiet --set time=0.7";
    let recorded = "--ladder ./one.toml --record-motion ./motion.jsonl --out ./played";
    folder.run(&format!("play {common} --budget-ms 0.01..30000 {recorded}"));
    folder.run(&format!("render {common} --set motion=./motion.jsonl --out ./replayed"));
    let [played, replayed] = ["played", "replayed"].map(|out| folder.json(&format!("{out}/run.json")));
    assert_eq!(replayed["settings"]["motion"], folder.word("./motion.jsonl"));
    let [played, replayed] = [played, replayed].map(|run| cameras(&run));
    assert!(played.len() == 8 && played[0] != played[7], "the camera moves");
    for (a, b) in played.iter().flatten().zip(replayed.iter().flatten()) {
        assert!((a - b).abs() <= 1e-5 * a.abs().max(1.0), "{a} {b}");
    }
}

#[test]
fn same_bytes_of_replayed_motion_on_three_devices() {
    let folder = Folder::new();
    let rendered = |devices: u32| {
        let head = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/head.jsonl");
        let shape = "--size 48x40 --frames 3 --fps 6 --time 0.5 --foveation layers";
        let line = format!("render builtin:cornell {shape} --set motion={head} --virtual {devices}");
        folder.run(&format!("{line} --out ./{devices}"));
        let name = |i: usize| ["left", "right"].map(|eye| format!("{devices}/{eye}.{i:04}.exr"));
        (0..3).flat_map(name).map(|name| folder.bytes(&name)).collect::<Vec<_>>()
    };
    let one = rendered(1);
    assert_ne!(one[0], one[4], "the head moves");
    for devices in [2, 3] {
        assert!(rendered(devices) == one, "{devices} devices");
    }
}

/// The guide's example of eyes, for a head at rest.
const EYES: &str = concat!(
    r#"{"diptych_motion": 1, "eyes": {"left": {"position_m": [-0.032, 0, 0], "orientation": [0, 0.0436, 0, 0.999], "#,
    r#""fov": {"left": -0.9, "right": 0.7, "up": 0.75, "down": -0.85}}, "#,
    r#""right": {"position_m": [0.032, 0, 0], "orientation": [0, -0.0436, 0, 0.999], "#,
    r#""fov": {"left": -0.7, "right": 0.9, "up": 0.75, "down": -0.85}}}}"#,
    "\n",
    r#"{"time_s": 0, "position_m": [0, 0, 0], "orientation": [0, 0, 0, 1], "gaze": [0.3, 0.4]}"#,
);

/// Foveation follows the gaze: the layers and their overlay are at the gaze, and polar images have their own size.
#[test]
fn asymmetric_eyes_have_a_gaze() {
    let folder = Folder::new();
    folder.write("eyes.jsonl", EYES);
    let line = "render builtin:cornell --set motion=./eyes.jsonl --size 36x40 --frames 1 --warm-up 0";
    folder.run(&format!("{line} --foveation layers --also overlay --aov motion --virtual 2 --out ./layers"));
    folder.run(&format!("{line} --foveation visual-polar --out ./polar"));
    let drawn = image::open(folder.path("layers/stereo.png")).unwrap().to_rgb8();
    let of_colour = |colour: [u8; 3], columns: std::ops::Range<u32>| {
        let all = drawn.enumerate_pixels().filter(|(x, _, pixel)| columns.contains(x) && pixel.0 == colour);
        all.map(|(x, y, _)| [f64::from(x - columns.start), f64::from(y)]).collect::<Vec<_>>()
    };
    for columns in [0..36, 36..72] {
        let circles = of_colour([0, 220, 255], columns.clone());
        let mean = [0, 1].map(|i| circles.iter().map(|at| at[i]).sum::<f64>() / circles.len() as f64);
        assert!(circles.len() > 20 && (mean[0] - 10.8).abs() < 3.0 && (mean[1] - 16.0).abs() < 3.0, "{mean:?}");
        assert!(of_colour([255, 160, 0], columns).len() >= 20, "stripes meet somewhere");
    }
    assert!(folder.json("polar/run.json")["rectified"]["pixels_ratio"].as_f64().unwrap() > 1.0);
    folder.refuses(2, line, "--foveation visual-polar --also overlay --out ./none => --also overlay");
}
