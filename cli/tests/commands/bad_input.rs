//! Bad input ends in one clear error that names the cause. The exit status is 2 for the command line and input files
//! and 1 for a run that cannot be done. Nothing panics, and nothing appears under a final name.

mod options;

use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};

use crate::common::{diptych, program};

/// A folder for results, which must stay empty.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes an input file and returns its path.
    fn file(&self, name: &str, bytes: &[u8]) -> String {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    }

    fn render_into(&self, out: &Path, shot: &str, options: &[&str]) -> Output {
        let mut args = vec!["render", shot, "--out", out.to_str().unwrap()];
        if !options.contains(&"--size") {
            args.extend(["--size", "32x18"]);
        }
        args.extend(options);
        diptych(&args)
    }

    /// Renders into a new folder and expects an error with `status` that contains all of `parts`.
    #[track_caller]
    fn refused(&self, shot: &str, options: &[&str], status: i32, parts: &[&str]) {
        let out = self.path("out");
        let output = self.render_into(&out, shot, options);
        assert_refused(&format!("{shot} {options:?}"), &output, status, parts);
        assert_eq!(files_in(&out), Vec::<PathBuf>::new(), "{shot} {options:?} left files");
    }
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    entries.map(|e| e.unwrap().path()).collect()
}

#[track_caller]
fn assert_refused(what: &str, output: &Output, status: i32, parts: &[&str]) {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "{what}: {text}");
    assert!(!text.contains("panicked"), "{what}: {text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error:")).collect();
    assert_eq!(errors.len(), 1, "{what}: not one error: {text}");
    assert!(errors[0].len() > "error: ".len(), "{what}: {text}");
    for part in parts {
        assert!(text.contains(part), "{what}: '{part}' is not in: {text}");
    }
}

/// Expects these options to be rejected.
#[track_caller]
fn assert_option_refused(options: &[&str], parts: &[&str]) {
    Case::new().refused("builtin:cornell", options, 2, parts);
}

const SHOT: &str = "scene = 'builtin:cornell'\n[rig]\nyfov_deg = 40.0\n[[rig.key]]\nposition = [0.0, 1.0, 4.0]\n\
                    target = [0.0, 1.0, 0.0]\n";

#[test]
fn renders_a_valid_shot() {
    let case = Case::new();
    let shot = case.file("good.toml", SHOT.as_bytes());
    let out = case.path("out");
    let output = case.render_into(&out, &shot, &[]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(files_in(&out).len(), 7, "{:?}", files_in(&out));
}

#[test]
fn rejects_missing_shots() {
    let case = Case::new();
    case.refused("no/such/shot.toml", &[], 2, &["no/such/shot.toml"]);
    case.refused("no/such/scene.gltf", &[], 2, &["no/such/scene.gltf"]);
    case.refused("builtin:nonesuch", &[], 2, &["nonesuch", "cornell", "atrium"]);
    case.refused("builtin:", &[], 2, &["cornell"]);
    let picture = case.file("picture.png", b"not a shot");
    case.refused(&picture, &[], 2, &["picture.png", ".toml", ".glb"]);
    case.refused(case.folder.path().to_str().unwrap(), &[], 2, &[case.folder.path().to_str().unwrap()]);
}

#[test]
fn rejects_invalid_values_in_shots() {
    let case = Case::new();
    for (name, from, to, parts) in [
        ("nan", "40.0", "nan", &["yfov_deg"][..]),
        ("infinite", "[0.0, 1.0, 4.0]", "[0.0, inf, 4.0]", &["position"]),
        ("text", "40.0", "'wide'", &["yfov_deg"]),
        ("typo", "yfov_deg", "yfov_degs", &["yfov_degs"]),
        ("no view", "[0.0, 1.0, 0.0]", "[0.0, 1.0, 4.0]", &["target"]),
        ("no scene", "scene = 'builtin:cornell'\n", "", &["scene"]),
        ("lost scene", "builtin:cornell", "lost/scene.gltf", &["lost/scene.gltf"]),
        ("no toml", "[rig]", "[rig", &[]),
    ] {
        let file = format!("{name}.toml");
        let text = SHOT.replacen(from, to, 1);
        assert_ne!(text, SHOT, "{name}");
        let shot = case.file(&file, text.as_bytes());
        let parts: Vec<&str> = parts.iter().copied().chain((name != "lost scene").then_some(file.as_str())).collect();
        case.refused(&shot, &[], 2, &parts);
    }
}

#[test]
fn rejects_invalid_head_motion() {
    let case = Case::new();
    let sample = "{\"time_s\": 0, \"position_m\": [0, 0, 0], \"orientation\": [0, 0, 0, 1]}\n";
    let head = "{\"diptych_motion\": 1}\n";
    for (name, text, part) in [
        ("twice", format!("{head}{sample}{sample}"), "line 3: time_s 0 is not after"),
        ("nan", format!("{head}{}", sample.replace("[0, 0, 0]", "[0, NaN, 0]")), "line 2: "),
        ("bytes", format!("{head}{sample}\u{0}\u{1}"), "line 3: "),
        ("headless", sample.to_owned(), "line 1: "),
        ("empty", String::new(), "empty"),
    ] {
        let path = case.file(&format!("{name}.jsonl"), text.as_bytes());
        case.refused("builtin:cornell", &["--set", &format!("motion={path}")], 2, &[part, &format!("{name}.jsonl")]);
    }
    case.refused("builtin:cornell", &["--set", "motion=no/such.jsonl"], 2, &["no/such.jsonl"]);
    let folder = case.folder.path().to_str().unwrap();
    case.refused("builtin:cornell", &["--set", &format!("motion={folder}")], 2, &["not a regular file"]);
}

/// Returns a binary glTF file of one triangle.
fn glb() -> Vec<u8> {
    glb_of(TRIANGLE)
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
    let binary: Vec<u8> = corners.iter().flat_map(|c| c.to_le_bytes()).collect();
    let mut out = Vec::new();
    let length = 12 + 8 + json.len() + 8 + binary.len();
    let words = |values: [u32; 2]| values.map(u32::to_le_bytes).concat();
    out.extend(b"glTF");
    out.extend(words([2, length as u32]));
    out.extend(words([json.len() as u32, 0x4e4f_534a]));
    out.extend(&json);
    out.extend(words([binary.len() as u32, 0x004e_4942]));
    out.extend(&binary);
    out
}

#[test]
fn rejects_damaged_glb_files() {
    let case = Case::new();
    let whole = glb();
    let good = case.file("whole.glb", &whole);
    let output = case.render_into(&case.path("good"), &good, &[]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    // Truncate within and at the ends of the header, the JSON chunk and the binary chunk.
    for keep in
        [0, 3, 4, 8, 11, 12, 16, 19, 20, 100, whole.len() - 44, whole.len() - 37, whole.len() - 36, whole.len() - 1]
    {
        let name = format!("cut-{keep}.glb");
        let cut = case.file(&name, &whole[..keep]);
        case.refused(&cut, &[], 2, &[&name]);
    }
    let corners = whole.len() - 36;
    let mut bytes = whole.clone();
    bytes[corners..corners + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let broken = case.file("nan.glb", &bytes);
    case.refused(&broken, &[], 2, &["nan.glb"]);
}

/// Errors name the faulty place in a file.
#[test]
fn rejects_inconsistent_glb_files() {
    let case = Case::new();
    let image = r#""materials":[{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}],"textures":[{"source":0}],
        "images":[{"uri":"URI"}],"meshes":[{"primitives":[{"material":0,"#;
    let image_of = |uri: &str| image.replace("URI", uri);
    let meshes = r#""meshes":[{"primitives":[{"#;
    for (name, from, to, parts) in [
        ("own ancestor", r#"{"mesh":0}"#, r#"{"mesh":0,"children":[1]},{"children":[1]}"#, &["node 1"][..]),
        ("cycle", r#"[{"mesh":0}]"#, r#"[{"mesh":0},{"children":[2]},{"children":[1]}]"#, &["ancestor"]),
        ("no mesh", r#"{"mesh":0}"#, r#"{"mesh":7}"#, &["mesh", "7"]),
        ("no node", r#""nodes":[0]"#, r#""nodes":[9]"#, &["node", "9"]),
        ("no accessor", r#""POSITION":0"#, r#""POSITION":4"#, &["accessor", "4"]),
        ("too many", r#""count":3"#, r#""count":4"#, &["accessor 0"]),
        ("far too many", r#""count":3"#, r#""count":4000000000"#, &["accessor 0"]),
        (
            "zeros",
            r#""bufferView":0,"componentType":5126,"count":3"#,
            r#""componentType":5126,"count":4000000000"#,
            &["accessor 0"],
        ),
        ("bad index", r#"{"POSITION":0}"#, r#"{"POSITION":0},"indices":0"#, &["indices", "accessor 0"]),
        ("beyond", r#""buffer":0,"byteLength":36"#, r#""buffer":0,"byteOffset":8,"byteLength":36"#, &["buffer"]),
        (
            "infinite",
            r#"{"mesh":0}"#,
            r#"{"mesh":0,"scale":[1e38,1e38,1e38],"children":[1]},{"scale":[1e9,1,1]}"#,
            &["node 1"],
        ),
        ("huge", r#"{"mesh":0}"#, r#"{"mesh":0,"scale":[1e30,1e30,1e30]}"#, &["units"]),
        ("no turn", r#"{"mesh":0}"#, r#"{"mesh":0,"rotation":[0,0,0,0]}"#, &["node 0"]),
        ("version", r#""2.0""#, r#""3.0""#, &["3.0"]),
        ("lost image", meshes, &image_of("lost.png"), &["lost.png"]),
        ("no image", meshes, &image_of("data:image/png;base64,AAAA"), &["image 0"]),
        ("no JSON", r#"{"asset""#, r#"{"asset"#, &["JSON"]),
    ] {
        let json = TRIANGLE.replacen(from, to, 1);
        assert_ne!(json, TRIANGLE, "{name}");
        let file = case.file(&format!("{name}.glb"), &glb_of(&json));
        // Without this option, images that cannot be read are left out.
        case.refused(&file, &["--set", "strict=on"], 2, parts);
    }
}

/// Invalid radiance in a sky counts as 0, with a warning.
#[test]
fn invalid_pixels_of_skies_are_replaced() {
    use diptych::image::{Extent, Image, exr};
    let case = Case::new();
    let mut sky = Image::filled(Extent::new(8, 4), [0.5f32; 3]);
    sky.pixels[3] = [f32::NAN, 1.0, 1.0];
    sky.pixels[9] = [1.0, f32::INFINITY, 1.0];
    sky.pixels[12] = [1.0, 1.0, -1.0];
    exr::write_rgb(&case.path("sky.exr"), &sky).unwrap();
    let shot = case.file("sky.toml", format!("{SHOT}[environment]\nimage = 'sky.exr'\n").as_bytes());
    let out = case.path("out");
    let output = case.render_into(&out, &shot, &["--spp", "8"]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("3 pixels") && text.contains("sky.exr"), "{text}");
    for name in ["left.exr", "right.exr"] {
        let image = exr::read_rgb(&out.join(name)).unwrap();
        assert!(image.pixels.as_flattened().iter().all(|v| v.is_finite() && *v >= 0.0), "{name}");
    }
    let run = std::fs::read_to_string(out.join("run.json")).unwrap();
    assert!(run.replace(' ', "").contains("\"nonfinite_samples\":0"), "{run}");
}

#[test]
fn rejects_skies_that_do_not_decode() {
    let case = Case::new();
    let whole = {
        use diptych::image::{Extent, Image, exr};
        exr::write_rgb(&case.path("whole.exr"), &Image::filled(Extent::new(8, 4), [0.5f32; 3])).unwrap();
        std::fs::read(case.path("whole.exr")).unwrap()
    };
    let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 40000 +X 40000\n";
    for (name, bytes) in [
        ("empty.exr", &[][..]),
        ("half.exr", &whole[..whole.len() / 2]),
        ("text.exr", b"not an image"),
        ("empty.hdr", b""),
        ("huge.hdr", huge),
    ] {
        case.file(name, bytes);
        let shot = case.file("sky.toml", format!("{SHOT}[environment]\nimage = '{name}'\n").as_bytes());
        case.refused(&shot, &[], 2, &[name]);
    }
    let shot = case.file("sky.toml", format!("{SHOT}[environment]\nimage = 'lost.hdr'\n").as_bytes());
    case.refused(&shot, &[], 2, &["lost.hdr"]);
}

#[test]
fn rejects_scenes_beyond_the_memory_budget() {
    let case = Case::new();
    let scene = case.file("scene.glb", &glb());
    let says = ["scene.glb", "max_scene_memory", "500 bytes"];
    case.refused(&scene, &["--set", "max_scene_memory=0.5kB"], 2, &says);
    // The file fits, but the scene made from it does not.
    case.refused(&scene, &["--set", "max_scene_memory=3kB"], 2, &["max_scene_memory", "2.9 KiB"]);
    let output =
        case.render_into(&case.path("good"), &scene, &["--set", "max_scene_memory=1MiB", "--environment", "white"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    for size in ["0", "much", "4G", "-1GiB"] {
        assert_option_refused(&["--set", &format!("max_scene_memory={size}")], &["max_scene_memory", size]);
    }
}

/// A shot, a scene or a sky may come from anyone. Files outside its own folder are read only with permission.
#[test]
fn rejects_files_outside_the_folder_of_the_shot() {
    use diptych::image::{Extent, Image, exr};
    let case = Case::new();
    std::fs::create_dir(case.path("inner")).unwrap();
    let (_, outside) = (case.file("scene.glb", &glb()), case.path("scene.glb"));
    exr::write_rgb(&case.path("sky.exr"), &Image::filled(Extent::new(8, 4), [0.5f32; 3])).unwrap();
    std::fs::write(case.path("corners.bin"), &glb()[glb().len() - 36..]).unwrap();
    let buffer = r#"{"byteLength":36,"uri":"../corners.bin"}"#;
    let shot_of = |scene: &str| SHOT.replacen("builtin:cornell", scene, 1);
    for (name, text, refused) in [
        ("scene.toml", shot_of("../scene.glb"), "../scene.glb"),
        ("absolute.toml", shot_of(outside.to_str().unwrap()), "scene.glb"),
        ("sky.toml", format!("{SHOT}[environment]\nimage = '../sky.exr'\n"), "../sky.exr"),
        ("buffer.gltf", TRIANGLE.replacen(r#"{"byteLength":36}"#, buffer, 1), "../corners.bin"),
    ] {
        let shot = case.file(&format!("inner/{name}"), text.as_bytes());
        case.refused(&shot, &[], 2, &[name, refused, "--set allow_outside=on"]);
        let output = case.render_into(&case.path(&format!("{name} out")), &shot, &["--allow-outside"]);
        assert_eq!(output.status.code(), Some(0), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

/// Without a private runtime folder, no shared one takes its place: anyone could plant a display server there, and the
/// program would connect to it.
#[cfg(target_os = "linux")]
#[test]
fn program_ignores_display_servers_in_shared_folders() {
    let shared = tempfile::tempdir().unwrap();
    let planted = std::os::unix::net::UnixListener::bind(shared.path().join("wayland-0")).unwrap();
    planted.set_nonblocking(true).unwrap();
    let mut command = program(&["info"]);
    command.env("TMPDIR", shared.path());
    for variable in ["XDG_RUNTIME_DIR", "WAYLAND_DISPLAY", "WAYLAND_SOCKET", "NODEVICE_SELECT"] {
        command.env_remove(variable);
    }
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut spoken_to = false;
    while child.try_wait().unwrap().is_none() {
        spoken_to |= planted.accept().is_ok();
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !text.contains("XDG_RUNTIME_DIR"), "{text}");
    assert!(!spoken_to && planted.accept().is_err());
}

#[test]
fn rejects_a_file_as_output_folder() {
    let case = Case::new();
    let file = case.file("file", b"in the way");
    for out in [PathBuf::from(&file), Path::new(&file).join("below")] {
        let output = case.render_into(&out, "builtin:cornell", &[]);
        assert_refused("--out at a file", &output, 1, &[&file, "--out"]);
    }
    assert_eq!(std::fs::read(&file).unwrap(), b"in the way");
}

#[cfg(target_os = "linux")]
#[test]
fn rejects_read_only_output_folders() {
    // Not even root can create folders there.
    let out = Path::new("/proc/diptych-test");
    let output = Case::new().render_into(out, "builtin:cornell", &[]);
    assert_refused("--out in /proc", &output, 1, &["/proc/diptych-test"]);
}

/// An existing picture is replaced completely or not at all.
#[test]
fn failed_run_keeps_earlier_results() {
    let case = Case::new();
    let out = case.path("out");
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("left.exr"), b"earlier").unwrap();
    let output = case.render_into(&out, "builtin:cornell", &["--virtual", "3", "--ratios", "1,2"]);
    assert_refused("ratios", &output, 2, &["ratios"]);
    assert_eq!(files_in(&out), [out.join("left.exr")]);
    assert_eq!(std::fs::read(out.join("left.exr")).unwrap(), b"earlier");
}
