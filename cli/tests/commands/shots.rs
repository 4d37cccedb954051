//! Rendering your own scene: files without a shot, minimal shots, options that override them, shots to edit, and
//! stills.

use diptych::image::RgbImage;
use diptych::image::exr::read_rgb;
use diptych::metrics::compare;

use crate::common::Folder;

/// Returns a folder with the classic box as a glTF file without camera or lights except the emitter in it.
fn folder() -> Folder {
    let folder = Folder::new();
    folder.run("export builtin:cornell --out ./box");
    folder
}

/// Renders a small picture; returns all messages.
#[track_caller]
fn render(folder: &Folder, shot: &str, out: &str, options: &str) -> String {
    folder.run(&format!("render {shot} --size 32x18 --out ./{out} {options}")).all()
}

fn bytes(folder: &Folder, out: &str) -> [Vec<u8>; 3] {
    ["left.exr", "right.exr", "stereo.png"].map(|name| folder.bytes(&format!("{out}/{name}")))
}

const BOX: &str = "./box/cornell.glb";

/// Camera in front of the box, and an environment.
const OPTIONS: &str = "--set position=0,1,4 --set target=-0.1,1,0 --set yfov=40 --set baseline=0.1 --set exposure=-1 \
                       --environment 0.5,0.25,0.125";

/// Shot file with the same settings.
const SAME: &str = "scene = 'cornell.glb'\n[rig]\nyfov_deg = 40\nbaseline_m = 0.1\n[[rig.key]]\nposition = [0, 1, 4]\n\
                    target = [-0.1, 1, 0]\n[environment]\nradiance = [0.5, 0.25, 0.125]\n[exposure]\nev = -1\n";

#[test]
fn options_equal_the_keys_of_a_shot() {
    let folder = folder();
    let said = render(&folder, BOX, "by-options", &format!("{OPTIONS} --set tonemap=reinhard --warm-up 0"));
    assert!(!said.contains("warning"), "{said}");
    folder.write("box/same.toml", SAME);
    render(&folder, "./box/same.toml", "by-shot", "--warm-up 0");
    assert!(bytes(&folder, "by-options") == bytes(&folder, "by-shot"));

    // Write a shot to edit, in another folder than its scene.
    let said = folder.run(&format!("export {BOX} --out ./shots/box.toml {OPTIONS}")).all();
    assert!(said.contains("--allow-outside"), "{said}");
    render(&folder, "./shots/box.toml", "by-written", "--warm-up 0 --allow-outside");
    assert!(bytes(&folder, "by-options") == bytes(&folder, "by-written"));
}

#[test]
fn scene_alone_renders_and_empty_pictures_warn() {
    let folder = folder();
    let plain = "--environment white --exposure 0 --set tonemap=reinhard --warm-up 0";
    let said = render(&folder, BOX, "alone", plain);
    assert!(said.contains("no camera in the file: placed"), "{said}");
    assert!(!said.contains("picture is"), "{said}");
    folder.write("box/alone.toml", "scene = 'cornell.glb'");
    render(&folder, "./box/alone.toml", "by-shot", "--warm-up 0");
    assert!(bytes(&folder, "alone") == bytes(&folder, "by-shot"));

    let away = "--position 0,1,40 --target 0,1,80 --environment";
    let bright = "--environment 1e4,1e4,1e4";
    for (options, is_said, part) in [
        (&*format!("{away} white"), true, "left eye's picture is of a single colour"),
        (&format!("{away} 0,0,0"), true, "left eye's picture is black"),
        (bright, true, "metered exposure: -1"),
        (bright, false, "very bright"),
        (&format!("{bright} --exposure 0"), true, "very bright: --exposure -1"),
        (&format!("{bright} --exposure -14"), false, "very bright"),
    ] {
        let said = render(&folder, BOX, "out", &format!("{options} --warm-up 0"));
        assert_eq!(said.contains(part), is_said, "{options}: {said}");
    }
}

#[test]
fn still_has_the_history_of_warm_up_frames() {
    let folder = Folder::new();
    let shot = "builtin:cornell";
    let left = |out: &str| -> RgbImage { read_rgb(&folder.path(out).join("left.exr")).unwrap() };
    let said = render(&folder, shot, "still", "");
    assert!(said.contains("with 15 frame(s) of history"), "{said}");
    let said = render(&folder, shot, "raw", "--warm-up 0");
    assert!(!said.contains("of history"), "{said}");
    render(&folder, shot, "reference", "--reference --spp 512");
    let [still, raw] = ["still", "raw"].map(|out| compare(&left("reference"), &left(out)).unwrap().rmse);
    assert!(still < 0.7 * raw, "{still} {raw}");

    // A sequence starts without history by default, so its first frame equals the raw one.
    render(&folder, shot, "frames", "--frames 2");
    assert!(folder.bytes("frames/left.0000.exr") == folder.bytes("raw/left.exr"));
    render(&folder, shot, "warm", "--frames 2 --warm-up 15");
    assert!(folder.bytes("warm/left.0000.exr") == folder.bytes("still/left.exr"));
}

#[test]
fn same_bytes_from_an_exported_shot() {
    // It has spheres, whose normals lie along no axes.
    let shot = "builtin:gallery";
    let folder = Folder::new();
    let exported = folder.run(&format!("export {shot} --out ./files")).out;
    for (shot, out) in [(exported.trim(), "exported"), (shot, "own")] {
        folder.run(&format!("render {shot} --size 48x32 --spp 2 --quiet --out ./{out}"));
    }
    folder.assert_same_eyes("exported", "own");
}

#[test]
fn wrong_units_are_told_and_mended() {
    let folder = Folder::new();
    let rig = "rig.metres_per_unit = 1000\n[[rig.key]]\nposition = [0, 1, 3]\ntarget = [0, 1, 0]\n";
    folder.write("far.toml", format!("scene = 'builtin:cornell'\n{rig}"));
    let warns = |line: &str| folder.run(line).errors.contains("both eyes see almost the same picture");
    let render = "render ./far.toml --size 32x18 --spp 1 --denoiser none --out ./out";
    assert!(warns("info ./far.toml") && warns(render));
    assert!(!warns("info ./far.toml --set metres_per_unit=1") && !warns(&format!("{render} --metres-per-unit 1")));
    let run: serde_json::Value = serde_json::from_str(&folder.text("out/run.json")).unwrap();
    assert_eq!(run["settings"]["metres_per_unit"], 1.0);
    folder.refuses(2, "", "info ./far.toml --set metres_per_unit=0 => metres_per_unit | above 0");
}
