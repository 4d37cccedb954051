//! Head motion: one run records, another replays on any number of devices, and invalid files are rejected.

use std::path::Path;

use serde_json::Value;

use crate::common::diptych;

fn ran(args: &[&str]) -> String {
    let output = diptych(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn run_json(out: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(out.join("run.json")).unwrap()).unwrap()
}

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

const HEAD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/head.jsonl");

#[test]
fn what_play_records_render_replays() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (motion, played, replayed) = (path("motion.jsonl"), path("played"), path("replayed"));
    let common = ["--size", "32x18", "--fps", "5", "--frames", "8", "--quiet"];
    let play = ["play", "builtin:atrium", "--set", "time=0.7", "--budget-ms", "0.01..30000", "--ladder"];
    let ladder = path("ladder.toml");
    std::fs::write(
        &ladder,
        "[origin]\nshot = 'any'\nsize = '32x18'\ndevices = ['any']\nversion = '0'\n[[rung]]\ntime_ms = 1.0\nflip = 0.4\n\
         relmse = 0.4\nknobs = { spp = 1, bounces = 1, denoiser = 'svgf', iterations = 1, scale = 1.0 }\n",
    )
    .unwrap();
    ran(&[&play[..], &[&*ladder, "--record-motion", &motion, "--out", &played], &common].concat());
    let replay =
        ["render", "builtin:atrium", "--time", "0.7", "--set", &format!("motion={motion}"), "--out", &replayed];
    ran(&[&replay[..], &common].concat());
    let [played, replayed] = [played, replayed].map(|out| run_json(Path::new(&out)));
    assert_eq!(replayed["settings"]["motion"], *motion);
    let [played, replayed] = [cameras(&played), cameras(&replayed)];
    assert!(played.len() == 8 && played[0] != played[7], "the camera moves");
    for (a, b) in played.iter().flatten().zip(replayed.iter().flatten()) {
        assert!((a - b).abs() <= 1e-5 * a.abs().max(1.0), "{a} {b}");
    }
}

#[test]
fn replayed_motion_gives_the_same_bytes_on_one_to_three_devices() {
    let folder = tempfile::tempdir().unwrap();
    let rendered = |devices: &str| {
        let out = folder.path().join(devices);
        let shape = ["--size", "48x40", "--frames", "3", "--fps", "6", "--time", "0.5", "--foveation", "layers"];
        let run = [
            "render",
            "builtin:cornell",
            "--set",
            &format!("motion={HEAD}"),
            "--virtual",
            devices,
            "--out",
            out.to_str().unwrap(),
        ];
        ran(&[&run[..], &shape].concat());
        let name = |i: usize| ["left", "right"].map(|eye| format!("{eye}.{i:04}.exr"));
        (0..3).flat_map(name).map(|name| std::fs::read(out.join(name)).unwrap()).collect::<Vec<_>>()
    };
    let one = rendered("1");
    assert_ne!(one[0], one[4], "the head moves");
    for devices in ["2", "3"] {
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
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (motion, layers, polar) = (path("eyes.jsonl"), path("layers"), path("polar"));
    std::fs::write(&motion, EYES).unwrap();
    let run = [
        "render",
        "builtin:cornell",
        "--set",
        &format!("motion={motion}"),
        "--size",
        "36x40",
        "--frames",
        "1",
        "--warm-up",
        "0",
    ];
    let with = |more: &[&'static str], out| [&run[..], more, &["--out", out]].concat();
    ran(&with(&["--foveation", "layers", "--also", "overlay", "--aov", "motion", "--virtual", "2"], &layers));
    ran(&with(&["--foveation", "visual-polar"], &polar));
    let drawn = image::open(Path::new(&layers).join("stereo.png")).unwrap().to_rgb8();
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
    assert!(run_json(Path::new(&polar))["rectified"]["pixels_ratio"].as_f64().unwrap() > 1.0);
    let output = diptych(&with(&["--foveation", "visual-polar", "--also", "overlay"], &polar));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && text.contains("--also overlay") && text.lines().count() == 1, "{text}");
}
