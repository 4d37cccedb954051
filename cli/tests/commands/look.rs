//! The look of glTF files without a shot: studio, metered exposure, tone curve and views.

use std::path::{Path, PathBuf};

use diptych::image::RgbImage;
use diptych::image::exr::read_rgb;
use diptych::scene::{Instance, Material, Mesh, Scene, gltf};
use glam::{Affine3A, Vec3};

use crate::common::{diptych, program};

/// A white block as a glTF file without camera or lights, in a folder.
struct Case {
    folder: tempfile::TempDir,
}

impl Case {
    fn new() -> Self {
        let case = Self { folder: tempfile::tempdir().unwrap() };
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
        let quads = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() };
        let instances = vec![Instance { mesh: 0, world_from_local: Affine3A::IDENTITY }];
        let materials = vec![Material::default()];
        let scene = Scene { meshes: vec![mesh], instances, materials, ..Scene::empty("block") };
        gltf::write(&case.path("block.glb"), &scene).unwrap();
        case
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Renders the block; returns the folder and the messages.
    #[track_caller]
    fn render(&self, out: &str, options: &[&str]) -> (PathBuf, String) {
        let (file, folder) = (self.path("block.glb"), self.path(out));
        let args = ["render", file.to_str().unwrap(), "--size", "96x72", "--out", folder.to_str().unwrap()];
        let output = diptych(&[&args, options].concat());
        let [said, errors] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        assert!(output.status.success(), "{options:?}: {errors}");
        (folder, said + &errors)
    }
}

fn left(folder: &Path) -> RgbImage {
    read_rgb(&folder.join("left.exr")).unwrap()
}

/// Returns the left eye's picture as grey values from 0 to 1.
fn shown(folder: &Path) -> Vec<Vec<f32>> {
    let both = image::open(folder.join("stereo.png")).unwrap().to_luma32f();
    let half = both.width() / 2;
    (0..both.height()).map(|y| (0..half).map(|x| both.get_pixel(x, y).0[0]).collect()).collect()
}

/// Several samples per pixel are the hard case: pixels at the rim of the ground show both ground and background.
#[test]
fn white_object_stands_out_from_a_seamless_ground() {
    let case = Case::new();
    for (out, options) in [("one", &[][..]), ("several", &["--spp", "4", "--warm-up", "3"])] {
        let (folder, _) = case.render(out, options);
        let rows = shown(&folder);
        let mean = rows.iter().flatten().sum::<f32>() / (96.0 * 72.0);
        assert!((0.15..0.7).contains(&mean), "{mean}");
        let [object, background] = [rows[36][48], rows[36][4]];
        assert!(object - background > 0.2, "{object} on {background}");
        // The horizon is above the object.
        let above: Vec<f32> = rows[..9].iter().flatten().copied().collect();
        let (least, most) = above.iter().fold((1.0f32, 0.0f32), |(a, b), v| (a.min(*v), b.max(*v)));
        assert!(most - least < 0.06, "{out}: {least} to {most}");
    }
}

#[test]
fn metered_exposure_is_equal_on_any_number_of_devices() {
    let case = Case::new();
    let dim = ["--environment", "0.01,0.01,0.01", "--warm-up", "0"];
    let (one, said) = case.render("one", &dim);
    let (two, _) = case.render("two", &[&dim[..], &["--virtual", "2"]].concat());
    for name in ["left.exr", "right.exr", "stereo.png"] {
        assert!(std::fs::read(one.join(name)).unwrap() == std::fs::read(two.join(name)).unwrap(), "{name}");
    }
    let run: serde_json::Value = serde_json::from_slice(&std::fs::read(one.join("run.json")).unwrap()).unwrap();
    let ev = run["settings"]["exposure_ev"].as_f64().unwrap();
    assert!((3.0..6.0).contains(&ev), "{ev}");
    assert_eq!(run["settings"]["exposure"], "auto");
    assert!(said.contains(&format!("metered exposure: +{ev} EV")), "{said}");
    let (fixed, said) = case.render("fixed", &[&dim[..], &["--exposure", &ev.to_string()]].concat());
    assert!(!said.contains("metered") && shown(&fixed) == shown(&one));
    assert_eq!(left(&fixed).pixels, left(&one).pixels, "EXR files are scene-referred");
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn options_select_views_and_tone_curves() {
    let case = Case::new();
    let render = |out: &str, options: &[&str]| shown(&case.render(out, &[options, &["--warm-up", "0"]].concat()).0);
    let first = render("first", &[]);
    assert!(first == render("view", &["--set", "orbit=three-quarter"]));
    assert!(first == render("orbit", &["--set", "orbit=30,20"]));
    assert!(first != render("top", &["--set", "orbit=top"]) && first != render("near", &["--set", "orbit=30,20,1.5"]));
    assert!(
        first == render("neutral", &["--set", "tonemap=neutral"]) && first != render("agx", &["--set", "tonemap=agx"])
    );
    let file = case.path("block.glb");
    let out = case.path("out");
    let args = ["render", file.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let output = diptych(&[&args[..], &["--set", "orbit=top", "--position", "0,0,9"]].concat());
    assert_eq!(output.status.code(), Some(2));
}

/// Runs the program in a folder and returns its exit status and all of its messages.
fn run_in(folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    let output = program(args).current_dir(folder).output().unwrap();
    let said = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap()).concat();
    (output.status.code(), said)
}

#[test]
fn file_alone_renders_into_a_folder_of_its_name() {
    let case = Case::new();
    let (status, said) = run_in(case.folder.path(), &["block.glb", "--size", "32x24", "--warm-up", "0"]);
    assert_eq!(status, Some(0), "{said}");
    let out = case.path("out/block");
    let run: serde_json::Value = serde_json::from_slice(&std::fs::read(out.join("run.json")).unwrap()).unwrap();
    assert_eq!(run["settings"]["out"], Path::new("out").join("block").to_str().unwrap());
    let [left, right, both] =
        ["left", "right", "stereo"].map(|name| image::open(out.join(format!("{name}.png"))).unwrap().to_rgb8());
    assert_eq!((left.dimensions(), right.dimensions()), ((32, 24), (32, 24)));
    assert!(left.enumerate_pixels().all(|(x, y, pixel)| both.get_pixel(x, y) == pixel));
    assert!(run["pictures"].as_array().unwrap().contains(&"right.png".into()));
}

#[test]
fn rejects_a_shot_as_head_motion() {
    let case = Case::new();
    std::fs::write(case.path("shot.toml"), "scene = 'block.glb'").unwrap();
    for (name, says) in [("shot.toml", "this is a shot"), ("block.glb", "this is a scene")] {
        let (status, said) = run_in(case.folder.path(), &["block.glb", "--set", &format!("motion={name}")]);
        assert!(status == Some(2) && said.contains(says) && said.contains("motion"), "{said}");
    }
}

#[test]
fn rejects_unknown_variants() {
    let case = Case::new();
    let (status, said) = run_in(case.folder.path(), &["block.glb", "--set", "variant=night"]);
    assert!(status == Some(2) && said.contains("no variant named 'night'"), "{said}");
}

/// Most light arrives at the object directly, so that ending paths in a cache would save nothing.
#[test]
fn radiance_cache_of_studio_scenes_is_off_by_default() {
    let case = Case::new();
    let caches = |options: &[&str]| {
        let (folder, _) = case.render("out", &[&["--warm-up", "0"], options].concat());
        let run = std::fs::read_to_string(folder.join("run.json")).unwrap();
        run.contains("\"radiance_cache\"")
    };
    assert!(!caches(&[]), "by default");
    assert!(caches(&["--cache", "on"]), "--cache on");
    assert!(caches(&["--environment", "white"]), "without the ground");
    assert!(!caches(&["--environment", "white", "--cache", "off"]), "--cache off");
}
