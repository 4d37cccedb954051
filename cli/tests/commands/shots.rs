//! Rendering your own scene: files without a shot, minimal shots, options that override them, shots to edit, and
//! stills.

use std::path::{Path, PathBuf};

use diptych::image::RgbImage;
use diptych::image::exr::read_rgb;
use diptych::metrics::compare;

use crate::common::diptych;

/// The classic box as a glTF file without camera or lights except the emitter in it, in a folder.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let case = Self { folder };
        case.run(&["export", "builtin:cornell", "--out", &case.path("box")]);
        case
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// Runs a command; returns its results, then its messages.
    #[track_caller]
    fn run(&self, args: &[&str]) -> String {
        let output = diptych(args);
        let [said, errors] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(output.status.success(), "{args:?}: {errors}");
        said + &errors
    }

    /// Renders a small picture; returns its folder and the messages.
    #[track_caller]
    fn render(&self, shot: &str, out: &str, options: &[&str]) -> (PathBuf, String) {
        let out = self.path(out);
        let said = self.run(&[&["render", shot, "--size", "32x18", "--out", &out], options].concat());
        (out.into(), said)
    }
}

fn bytes(folder: &Path) -> [Vec<u8>; 3] {
    ["left.exr", "right.exr", "stereo.png"].map(|name| std::fs::read(folder.join(name)).unwrap())
}

/// Camera in front of the box, and an environment.
const OPTIONS: [&str; 16] = [
    "--set",
    "position=0,1,4",
    "--set",
    "target=-0.1,1,0",
    "--set",
    "yfov=40",
    "--set",
    "baseline=0.1",
    "--set",
    "exposure=-1",
    "--environment",
    "0.5,0.25,0.125",
    "--set",
    "tonemap=reinhard",
    "--warm-up",
    "0",
];

/// Shot file with the same settings.
const SAME: &str = "scene = 'cornell.glb'\n[rig]\nyfov_deg = 40\nbaseline_m = 0.1\n[[rig.key]]\nposition = [0, 1, 4]\n\
                    target = [-0.1, 1, 0]\n[environment]\nradiance = [0.5, 0.25, 0.125]\n[exposure]\nev = -1\n";

#[test]
fn options_equal_the_keys_of_a_shot() {
    let case = Case::new();
    let file = case.path("box/cornell.glb");
    let (by_options, said) = case.render(&file, "by-options", &OPTIONS);
    assert!(!said.contains("warning"), "{said}");
    std::fs::write(case.path("box/same.toml"), SAME).unwrap();
    let (by_shot, _) = case.render(&case.path("box/same.toml"), "by-shot", &["--warm-up", "0"]);
    assert!(bytes(&by_options) == bytes(&by_shot));

    // Write a shot to edit, in another folder than its scene.
    let written = case.path("shots/box.toml");
    let said = case.run(&[&["export", &file, "--out", &written], &OPTIONS[..12]].concat());
    assert!(said.contains("--allow-outside"), "{said}");
    let (by_written, _) = case.render(&written, "by-written", &["--warm-up", "0", "--allow-outside"]);
    assert!(bytes(&by_options) == bytes(&by_written));
    let output = diptych(&["export", &file, "--out", &written]);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && errors.contains("the file exists"), "{errors}");
}

#[test]
fn scene_alone_renders_and_empty_pictures_warn() {
    let case = Case::new();
    let file = case.path("box/cornell.glb");
    let plain = ["--environment", "white", "--exposure", "0", "--set", "tonemap=reinhard", "--warm-up", "0"];
    let (alone, said) = case.render(&file, "alone", &plain);
    assert!(said.contains("no camera in the file: placed"), "{said}");
    assert!(!said.contains("picture is"), "{said}");
    std::fs::write(case.path("box/alone.toml"), "scene = 'cornell.glb'").unwrap();
    let (by_shot, _) = case.render(&case.path("box/alone.toml"), "by-shot", &["--warm-up", "0"]);
    assert!(bytes(&alone) == bytes(&by_shot));

    let away = ["--position", "0,1,40", "--target", "0,1,80", "--warm-up", "0"];
    let (_, said) = case.render(&file, "away", &[&away[..], &["--environment", "white"]].concat());
    assert!(said.contains("left eye's picture is of a single colour"), "{said}");
    let bright = ["--environment", "1e4,1e4,1e4", "--warm-up", "0"];
    let (_, said) = case.render(&file, "metered", &bright);
    assert!(said.contains("metered exposure: -1") && !said.contains("very bright"), "{said}");
    let (_, said) = case.render(&file, "bright", &[&bright[..], &["--exposure", "0"]].concat());
    assert!(said.contains("very bright: --exposure -1"), "{said}");
    let (_, said) = case.render(&file, "exposed", &[&bright[..], &["--exposure", "-14"]].concat());
    assert!(!said.contains("very bright"), "{said}");
    let (_, said) = case.render(&file, "dark", &[&away[..], &["--environment", "0,0,0"]].concat());
    assert!(said.contains("left eye's picture is black"), "{said}");
}

#[test]
fn still_has_the_history_of_warm_up_frames() {
    let case = Case::new();
    let shot = "builtin:cornell";
    let left = |folder: &Path| -> RgbImage { read_rgb(&folder.join("left.exr")).unwrap() };
    let (still, said) = case.render(shot, "still", &[]);
    assert!(said.contains("with 15 frame(s) of history"), "{said}");
    let (raw, said) = case.render(shot, "raw", &["--warm-up", "0"]);
    assert!(!said.contains("of history"), "{said}");
    let (reference, _) = case.render(shot, "reference", &["--reference", "--spp", "512"]);
    let error = |folder: &Path| compare(&left(&reference), &left(folder)).unwrap().rmse;
    assert!(error(&still) < 0.7 * error(&raw), "{} {}", error(&still), error(&raw));

    // A sequence starts without history by default, so its first frame equals the raw one.
    let (frames, _) = case.render(shot, "frames", &["--frames", "2"]);
    assert!(std::fs::read(frames.join("left.0000.exr")).unwrap() == bytes(&raw)[0]);
    let (warm, _) = case.render(shot, "warm", &["--frames", "2", "--warm-up", "15"]);
    assert!(std::fs::read(warm.join("left.0000.exr")).unwrap() == bytes(&still)[0]);
}

#[test]
fn rejects_options_without_a_view() {
    let case = Case::new();
    let shot = case.path("box/cornell.toml");
    for (options, part) in [
        (&["--position", "1,2"][..], "three numbers"),
        (&["--yfov", "180"], "below 180"),
        (&["--exposure", "25"], "-24 to 24"),
        (&["--set", "baseline=-1"], "0 or a number above"),
        (&["--environment", "sky.png"], ".hdr"),
        (&["--environment", "no-such-sky.hdr"], "no-such-sky.hdr"),
        (&["--set", "camera=0"], "no camera (--set camera=N)"),
        (&["--position", "1,1,1", "--target", "1,1,1"], "same point"),
        (&["--position", "1,1,1", "--target", "1,1,1"], "(--set position=X,Y,Z, --set target=X,Y,Z)"),
    ] {
        let out = case.path("out");
        let output = diptych(&[&["render", &shot, "--out", &out], options].concat());
        let errors = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && errors.contains(part), "{options:?}: {errors}");
    }
}
