//! Animated scenes: the choice of a file's animations, their time, and the messages about them.

use std::path::{Path, PathBuf};
use std::process::Output;

use diptych::image::exr::read_channels;
use serde_json::{Value, json};

use crate::common::diptych;

/// A scene with a floor and a triangle that animations lift or push aside, and a folder for its shots and results.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        let case = Self { folder: tempfile::tempdir().unwrap() };
        // The buffer holds corners, key times, then two tracks of two positions each.
        let corners: [f32; 9] = [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0];
        let tracks: [f32; 14] = [0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.8, 0.0, 0.0];
        let bytes: Vec<u8> = corners.iter().chain(&tracks).flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(case.path("moves.bin"), &bytes).unwrap();
        let view =
            |offset: usize, floats: usize| json!({"buffer": 0, "byteOffset": 4 * offset, "byteLength": 4 * floats});
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
        std::fs::write(case.path("moves.gltf"), file.to_string()).unwrap();
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, shot: &str, out: &str, options: &[&str]) -> Output {
        let (shot, out) = (self.path(shot), self.path(out));
        let args = ["render", shot.to_str().unwrap(), "--out", out.to_str().unwrap(), "--size", "32x24", "--spp", "1"];
        let view = ["--position=0,0,4", "--target=0,0,0", "--environment=1,1,1", "--warm-up=0"];
        // Without temporal accumulation, rays of all frames go through the pixel centres.
        diptych(&[&args[..], &view, &["--aov", "position", "--denoiser", "none"], options].concat())
    }

    /// Renders one picture; returns its folder.
    #[track_caller]
    fn render(&self, out: &str, options: &[&str]) -> PathBuf {
        let output = self.run("moves.gltf", out, options);
        assert!(output.status.success(), "{options:?}: {}", String::from_utf8_lossy(&output.stderr));
        self.path(out)
    }
}

/// Returns the positions of surfaces in a picture. They depend neither on random numbers nor on earlier frames.
fn surfaces(folder: &Path, frame: Option<usize>) -> Vec<[f32; 3]> {
    let is_it = |name: &str| {
        let of_frame = frame.is_none_or(|i| name.contains(&format!("{i:04}")));
        name.contains("position") && name.contains("left") && name.ends_with(".exr") && of_frame
    };
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<_> = files.filter(|path| is_it(path.file_name().unwrap().to_str().unwrap())).collect();
    found.sort();
    assert_eq!(found.len(), 1, "{found:?} of {frame:?}");
    read_channels(&found[0], ["X", "Y", "Z"]).unwrap().image.pixels
}

fn moves(folder: &Path) -> Value {
    let run: Value = serde_json::from_slice(&std::fs::read(folder.join("run.json")).unwrap()).unwrap();
    run["scene"]["moves"].clone()
}

#[test]
fn options_select_the_animation_that_plays() {
    let case = Case::new();
    let all = case.render("all", &["--time", "1"]);
    let lift = case.render("lift", &["--time", "1", "--animation", "Lift"]);
    let push = case.render("push", &["--time", "1", "--animation", "Push"]);
    let none = case.render("none", &["--time", "1", "--animation", "none"]);
    let rest = case.render("rest", &["--time", "0", "--animation", "Lift"]);
    let [all_at, lift_at, push_at, none_at, rest_at] = [&all, &lift, &push, &none, &rest].map(|f| surfaces(f, None));
    assert!(lift_at != push_at && lift_at != none_at && push_at != none_at && rest_at != lift_at);
    // If two animations drive the same node, the first one wins.
    assert!(all_at == lift_at, "all together are not the first");
    let played = |folder: &Path| -> Vec<Value> {
        let list = moves(folder)["animations"].as_array().unwrap().clone();
        list.iter().map(|one| one["name"].clone()).collect()
    };
    assert_eq!(played(&lift), ["Lift"]);
    assert_eq!(played(&all), ["Lift"], "nothing is left of the other");
    assert_eq!((moves(&lift)["rigid_instances"].clone(), moves(&lift)["nodes"].clone()), (json!(1), json!(1)));
    assert_eq!(moves(&none), Value::Null);

    let unknown = case.run("moves.gltf", "unknown", &["--animation", "Jump"]);
    let said = String::from_utf8_lossy(&unknown.stderr);
    assert_eq!(unknown.status.code(), Some(2), "{said}");
    assert!(said.contains("no animation named 'Jump'") && said.contains("Lift, Push"), "{said}");
    assert!(!case.path("unknown").join("run.json").exists());
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn frames_show_the_scene_at_their_times() {
    let case = Case::new();
    let sequence = case.render("sequence", &["--animation", "Push", "--time", "0.5", "--frames", "4", "--fps", "2"]);
    let at: Vec<_> = (0..4).map(|i| surfaces(&sequence, Some(i))).collect();
    for (time_s, frame) in [("0.5", 0), ("1.5", 2)] {
        let one = case.render(&format!("at-{time_s}"), &["--animation", "Push", "--time", time_s]);
        assert!(surfaces(&one, None) == at[frame], "frame {frame} is not that of {time_s} s");
    }
    assert!(at.iter().enumerate().all(|(i, a)| at[..i].iter().all(|b| a != b)), "frames are of one time");
    // After two seconds the animation repeats; with `loop = false` it does not.
    let again = case.render("again", &["--animation", "Push", "--time", "2.5"]);
    assert!(surfaces(&again, None) == at[0]);
    let shot = "scene = 'moves.gltf'\nanimation = 'Push'\nloop = false\n";
    std::fs::write(case.path("held.toml"), shot).unwrap();
    for (out, time_s) in [("held", "2.5"), ("end", "7")] {
        let output = case.run("held.toml", out, &["--time", time_s]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert!(surfaces(&case.path("held"), None) == surfaces(&case.path("end"), None));
    assert!(surfaces(&case.path("held"), None) != at[0]);
}
