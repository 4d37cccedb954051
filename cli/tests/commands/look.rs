//! The look of glTF files without a shot: studio, metered exposure, tone curve and views.

use diptych::image::exr::read_rgb;
use diptych::scene::{Instance, Material, Mesh, Scene, gltf};
use glam::{Affine3A, Vec3};

use crate::common::{Folder, Said};

/// Returns a folder with a white block as a glTF file without camera or lights.
fn folder() -> Folder {
    let folder = Folder::new();
    let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
    let quads = [[0u32, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() };
    let instances = vec![Instance { mesh: 0, world_from_local: Affine3A::IDENTITY }];
    let materials = vec![Material::default()];
    let scene = Scene { meshes: vec![mesh], instances, materials, ..Scene::empty("block") };
    gltf::write(&folder.path("block.glb"), &scene).unwrap();
    folder
}

/// Renders the block; returns all messages.
#[track_caller]
fn render(folder: &Folder, out: &str, options: &str) -> String {
    folder.run(&format!("render ./block.glb --size 96x72 --out ./{out} {options}")).all()
}

/// Returns the left eye's picture as grey values from 0 to 1.
fn shown(folder: &Folder, out: &str) -> Vec<Vec<f32>> {
    let both = image::open(folder.path(out).join("stereo.png")).unwrap().to_luma32f();
    let half = both.width() / 2;
    (0..both.height()).map(|y| (0..half).map(|x| both.get_pixel(x, y).0[0]).collect()).collect()
}

/// Several samples per pixel are the hard case: pixels at the rim of the ground show both ground and background.
#[test]
fn white_object_stands_out_from_a_seamless_ground() {
    let folder = folder();
    for (out, options) in [("one", ""), ("several", "--spp 4 --warm-up 3")] {
        render(&folder, out, options);
        let rows = shown(&folder, out);
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
    let folder = folder();
    let dim = "--environment 0.01,0.01,0.01 --warm-up 0";
    let said = render(&folder, "one", dim);
    render(&folder, "two", &format!("{dim} --virtual 2"));
    folder.assert_same_eyes("one", "two");
    assert!(folder.bytes("one/stereo.png") == folder.bytes("two/stereo.png"));
    let run = folder.json("one/run.json");
    let ev = run["settings"]["exposure_ev"].as_f64().unwrap();
    assert!((3.0..6.0).contains(&ev), "{ev}");
    assert_eq!(run["settings"]["exposure"], "auto");
    assert!(said.contains(&format!("metered exposure: +{ev} EV")), "{said}");
    let said = render(&folder, "fixed", &format!("{dim} --exposure {ev}"));
    assert!(!said.contains("metered") && shown(&folder, "fixed") == shown(&folder, "one"));
    // EXR files are scene-referred.
    let [fixed, one] = ["fixed", "one"].map(|out| read_rgb(&folder.path(out).join("left.exr")).unwrap().pixels);
    assert_eq!(fixed, one);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn options_select_views_and_tone_curves() {
    let folder = folder();
    let picture = |options: &str| {
        render(&folder, "out", &format!("{options} --warm-up 0"));
        shown(&folder, "out")
    };
    let first = picture("");
    for (setting, is_default) in [
        ("orbit=three-quarter", true),
        ("orbit=30,20", true),
        ("orbit=top", false),
        ("orbit=30,20,1.5", false),
        ("tonemap=neutral", true),
        ("tonemap=agx", false),
    ] {
        assert_eq!(picture(&format!("--set {setting}")) == first, is_default, "{setting}");
    }
    folder.refuses(2, "", "render ./block.glb --set orbit=top --position 0,0,9 --out ./none => orbit | position");
}

#[test]
fn file_alone_renders_into_a_folder_of_its_name() {
    let folder = folder();
    let line = "block.glb --size 32x24 --warm-up 0";
    Said::new(folder.program(line).current_dir(folder.path("")).output().unwrap()).success(line);
    let out = folder.path("out/block");
    let run = folder.json("out/block/run.json");
    assert_eq!(run["settings"]["out"], std::path::Path::new("out").join("block").to_str().unwrap());
    let [left, right, both] =
        ["left", "right", "stereo"].map(|name| image::open(out.join(format!("{name}.png"))).unwrap().to_rgb8());
    assert_eq!((left.dimensions(), right.dimensions()), ((32, 24), (32, 24)));
    assert!(left.enumerate_pixels().all(|(x, y, pixel)| both.get_pixel(x, y) == pixel));
    assert!(run["pictures"].as_array().unwrap().contains(&"right.png".into()));
}

/// Most light arrives at the object directly, so that ending paths in a cache would save nothing.
#[test]
fn radiance_cache_of_studio_scenes_is_off_by_default() {
    let folder = folder();
    let white = "--environment white";
    for (options, caches) in
        [("", false), ("--cache on", true), (white, true), (&format!("{white} --cache off"), false)]
    {
        render(&folder, "out", &format!("--warm-up 0 {options}"));
        assert_eq!(folder.text("out/run.json").contains("\"radiance_cache\""), caches, "{options}");
    }
}
