//! Metadata of image files: cameras, and the origin of the right eye's pixels.

use crate::common::{Folder, Said, stage};
use diptych::image::exr::{Tags, read_channels, read_colour, read_layer, read_rgb};
use serde_json::Value;

const WIDTH: usize = 64;
const HEIGHT: usize = 40;

/// Renders `shot` at 64x40 into this folder; returns the printed text and `run.json`.
fn render(folder: &Folder, shot: &str, out: &str, options: &str) -> (String, Value) {
    let said = folder.run(&format!("render {shot} --size 64x40 --bounces 1 --out ./{out} {options}"));
    (said.out, folder.json(&format!("{out}/run.json")))
}

/// Projects a point; returns pixels from the top left corner.
fn projected(point: [f32; 3], world_to_ndc: [[f32; 4]; 4]) -> [f64; 2] {
    let row = [point[0], point[1], point[2], 1.0].map(f64::from);
    let of = |column: usize| (0..4).map(|r| row[r] * f64::from(world_to_ndc[r][column])).sum::<f64>();
    [of(0) / of(3) * WIDTH as f64, of(1) / of(3) * HEIGHT as f64]
}

/// With temporal accumulation, each frame looks through different points of the pixels.
#[test]
fn positions_project_onto_their_pixels() {
    let folder = Folder::new();
    let options = "--frames 2 --fps 2 --time 0.25 --aov position,depth";
    let (_, run) = render(&folder, "builtin:cornell", "out", options);
    for (eye, frame) in [("left", 0), ("right", 0), ("left", 1), ("right", 1)] {
        let path = |name: &str| folder.path(&format!("out/{eye}.{name}{frame:04}.exr"));
        let colour = read_colour(&path("")).unwrap().tags;
        let time_s = 0.25 + 0.5 * f64::from(frame);
        let said = (colour.eye.as_deref(), colour.frame, colour.time_s, colour.exposure_ev, colour.pixel_centre);
        assert_eq!(said, (Some(eye), Some(frame), Some(time_s), Some(0.0), None));
        assert_eq!((colour.yfov_deg, colour.baseline_m, colour.baseline_units), (Some(40.0), Some(0.064), Some(0.064)));

        let row = &run["frames"][frame as usize];
        let camera = &row["cameras"][eye];
        assert_eq!(row["time_s"], time_s);
        for (name, matrix) in [("world_to_camera", colour.world_to_camera), ("world_to_ndc", colour.world_to_ndc)] {
            let said: [[f32; 4]; 4] = serde_json::from_value(camera[name].clone()).unwrap();
            assert_eq!(Some(said), matrix, "{name}");
        }

        let [x, y, z] = ["X", "Y", "Z"];
        let positions = read_channels(&path("position."), [x, y, z]).unwrap().image;
        let depths = read_rgb(&path("depth.")).unwrap();
        let file = read_colour(&path("depth.")).unwrap().tags;
        let centre = file.pixel_centre.unwrap();
        assert_eq!(centre == [0.5; 2], frame == 0, "{centre:?}");
        assert_eq!(Tags { pixel_centre: None, exposure_ev: colour.exposure_ev, ..file }, colour);
        let mut seen = 0;
        for (i, (position, depth)) in positions.pixels.iter().zip(&depths.pixels).enumerate() {
            if depth[0] > 0.0 {
                let at = projected(*position, colour.world_to_ndc.unwrap());
                let expected = [(i % WIDTH) as f64, (i / WIDTH) as f64];
                let off = [0, 1].map(|c| (at[c] - expected[c] - f64::from(centre[c])).abs());
                assert!(off[0] < 1e-3 && off[1] < 1e-3, "pixel {i}, {eye}, frame {frame}: at {at:?}");
                seen += 1;
            }
        }
        assert!(seen > WIDTH * HEIGHT / 2, "{seen}");
    }
}

/// Returns the number of pixels of a fraction.
fn pixels(share: &Value) -> usize {
    (share.as_f64().unwrap() * (WIDTH * HEIGHT) as f64).round() as usize
}

/// Without a denoiser, pixels that show several surfaces are traced again; with one, they take over light.
#[test]
fn most_retraced_pixels_are_at_edges_without_a_filter() {
    let counts = ["none", "svgf"].map(|denoiser| {
        let folder = Folder::new();
        render(&folder, "builtin:checker", "out", &format!("--spp 4 --denoiser {denoiser} --aov holes"));
        let holes = read_rgb(&folder.path("out/right.holes.exr")).unwrap();
        let count = |value: f32| holes.pixels.iter().filter(|p| p[0] == value).count();
        (count(5.0), [1.0, 2.0, 3.0, 4.0, 6.0].map(count).iter().sum::<usize>())
    });
    let [(edges, holes), (edges_filtered, _)] = counts;
    assert!(edges > holes, "{edges} pixels at edges and {holes} holes");
    assert!(2 * edges_filtered < edges, "{edges_filtered} pixels of {edges} at edges are traced in a filtered frame");
}

#[test]
fn antialiased_edges_are_no_disocclusions() {
    let folder = Folder::new();
    let (said, run) = render(&folder, "builtin:checker", "out", "--spp 4 --set render_scale=0.8 --aov holes");
    let holes = read_rgb(&folder.path("out/right.holes.exr")).unwrap();
    let count = |value: f32| holes.pixels.iter().filter(|p| p[0] == value).count();
    let row = &run["frames"][0];
    let true_holes = [1.0, 2.0, 3.0, 4.0, 6.0].map(count);
    assert_eq!(pixels(&row["reprojected_fraction"]), count(0.0));
    assert_eq!(pixels(&row["antialiasing_fraction"]), count(5.0));
    assert_eq!(pixels(&row["unsampled_fraction"]), count(7.0));
    assert_eq!(pixels(&row["hole_fraction"]), true_holes.iter().sum::<usize>());
    for (name, count) in ["outside", "normal", "distance", "material", "view"].iter().zip(true_holes) {
        assert_eq!(pixels(&row["hole_fractions"][name]), count, "{name}");
    }
    assert!([0.0, 4.0, 5.0, 7.0].into_iter().all(|value| count(value) > 0), "all of them are there");
    let line = said.lines().find(|line| line.starts_with("right eye: ")).unwrap();
    let percent = |name: &str| format!("{:.1} %", 100.0 * row[name].as_f64().unwrap());
    for (name, what) in [
        ("reprojected_fraction", "reprojected"),
        ("antialiasing_fraction", "traced again for antialiasing"),
        ("unsampled_fraction", "filled in by the denoiser"),
        ("hole_fraction", "holes ("),
    ] {
        assert!(line.contains(&format!("{} {what}", percent(name))), "{line}");
    }

    let picture = image::open(folder.path("out/holes.png")).unwrap().into_rgb8();
    // In a picture as small as this one, the key adds width and height.
    assert!(picture.width() > 2 * WIDTH as u32 && picture.height() > HEIGHT as u32 + 100);
    let right = |i: usize| picture.get_pixel((WIDTH + i % WIDTH) as u32, (i / WIDTH) as u32).0;
    for (value, colour) in [(0.0, [0, 0, 0]), (4.0, [240, 228, 66]), (5.0, [86, 180, 233]), (7.0, [0, 158, 115])] {
        let shown = holes.pixels.iter().enumerate().filter(|(_, p)| p[0] == value).map(|(i, _)| right(i));
        assert!(shown.into_iter().all(|c| c == colour), "{value} is not {colour:?}");
    }
}

#[test]
fn eyes_rendered_apart_report_no_reprojection() {
    let folder = Folder::new();
    let (said, run) = render(&folder, "builtin:cornell", "out", "--reproject off");
    assert!(!said.contains("right eye"), "{said}");
    assert!(run["frames"][0].get("hole_fraction").is_none() && run["frames"][0]["rays"].as_u64() > Some(0));
}

/// Layers hold the same values as files, and `compare` finds them.
#[test]
fn auxiliary_images_can_be_layers_of_one_file() {
    let folder = Folder::new();
    let options = "--frames 2 --aov motion,position,normal";
    render(&folder, "builtin:cornell", "files", options);
    render(&folder, "builtin:cornell", "layers", &format!("{options} --also layers --also over-under"));
    let [files, layers] = ["files", "layers"].map(|name| folder.path(name));
    assert!(!folder.names("layers").iter().any(|name| name.contains("normal")), "{:?}", folder.names("layers"));
    for eye in ["left", "right"] {
        let of_files = read_channels(&files.join(format!("{eye}.normal.0001.exr")), ["X", "Y", "Z"]).unwrap();
        let of_layers = read_layer(&layers.join(format!("{eye}.0001.exr")), "normal.", ["X", "Y", "Z"]).unwrap();
        assert!(of_files.image == of_layers.image, "{eye}");
        assert_eq!(of_layers.tags.pixel_centre, of_files.tags.pixel_centre);
        let [a, b] = [&files, &layers].map(|out| read_rgb(&out.join(format!("{eye}.0001.exr"))).unwrap());
        assert!(a == b, "{eye}");
    }
    let [of_files, of_layers] =
        ["files", "layers"].map(|image| folder.run(&format!("compare ./files ./{image} --json")).json());
    assert!(of_files["rivalry"].is_number(), "{of_files}");
    assert_eq!(of_files, of_layers);
    let stereo = image::open(layers.join("stereo.0001.png")).unwrap();
    assert_eq!((stereo.width(), stereo.height()), (WIDTH as u32, 2 * HEIGHT as u32));
}

/// `compare` reads eyes from folders, and exposure and cameras from the files, and rejects images that do not match.
#[test]
fn compare_reads_both_eyes_from_folders() {
    let folder = Folder::new();
    let cornell = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/cornell.toml")).unwrap();
    folder.write("shot.toml", format!("{cornell}\n[exposure]\nev = -1.5\n"));
    render(&folder, "./shot.toml", "reference", "--spp 16 --denoiser none");
    render(&folder, "./shot.toml", "image", "");
    render(&folder, "./shot.toml", "late", "--time 1");
    let compare = |line: &str| {
        let Said { out, errors, .. } = folder.run(&format!("compare {line}"));
        (out, errors)
    };
    let (said, warned) = compare("./reference ./image --by rings=3");
    assert_eq!(warned, "");
    let parts = ["exposure_ev", "-1.5", "as the reference says"];
    assert!(said.lines().any(|line| parts.iter().all(|part| line.contains(part))), "{said}");
    for eye in ["left", "right"] {
        let rings =
            format!("rings around 0.5,0.5, {eye} eye; vertical field of view 40 degrees, as the reference says");
        assert!(said.contains(&rings), "{said}");
    }
    let both: Value = serde_json::from_str(&compare("./reference ./image --json --by rings=3").0).unwrap();
    assert_eq!(both["left"]["rings"]["yfov_deg"], 40.0);
    for eye in ["left", "right"] {
        let (alone, warned) = compare(&format!("./reference/{eye}.exr ./image/{eye}.exr --json --by rings=3"));
        assert_eq!((serde_json::from_str::<Value>(&alone).unwrap(), warned.as_str()), (both[eye].clone(), ""));
    }
    for name in ["rmse", "flip", "psnr", "block16", "nonfinite_px"] {
        let [left, right, mean] = ["left", "right", "mean"].map(|of| both[of][name].as_f64().unwrap());
        assert!((mean - (left + right) / 2.0).abs() < 1e-12, "{name}");
        let decimals = if name == "nonfinite_px" { 0 } else { 6 };
        let values = [left, right, mean].map(|v| format!("{v:.decimals$}"));
        let line = said.lines().find(|l| l.split_whitespace().next() == Some(name)).unwrap();
        assert!(line.split_whitespace().skip(1).take(3).eq(values.iter()), "{line} instead of {values:?}");
    }

    let (said, _) = compare("./reference ./image --maps ./maps");
    let map = image::open(folder.path("maps/flip.png")).unwrap().into_rgb8();
    assert_eq!(map.dimensions(), (2 * WIDTH as u32, HEIGHT as u32));
    // These folders have no auxiliary images.
    let missing = |name: &str, aov: &str| {
        said.lines().any(|l| l.starts_with(&format!("{name} is not written: ")) && l.contains(aov))
    };
    assert!(missing("kind.png", "left.depth.exr") && missing("rivalry.png", "--aov position,normal"), "{said}");
    assert_eq!(folder.names("maps").len(), 2);
    let (_, warned) = compare("./reference ./late");
    for eye in ["left", "right"] {
        let warning = format!("warning: {eye} eye: the reference is of frame 0 at 0 s, the image of frame 0 at 1 s");
        assert!(warned.contains(&warning), "{warned}");
    }
    let (_, warned) = compare("./reference/left.exr ./image/right.exr");
    assert_eq!(warned, "warning: the reference is of the left eye, the image of the right one\n");
}

#[test]
fn files_hold_the_eye_that_they_are_named_after() {
    let subject = stage::Subject::load("builtin:checker");
    let mut settings = subject.settings(48, 32);
    settings.buffers.reproject = true;
    let expected = stage::Stage::alone(&subject, &settings).frame(0).linear;
    let folder = Folder::new();
    folder.run("render builtin:checker --size 48x32 --denoiser none --quiet --out ./");
    let [left, right] = ["left.exr", "right.exr"].map(|name| read_rgb(&folder.path(name)).unwrap());
    assert!(left == *expected.left() && right == *expected.right() && left != right);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn same_bytes_of_files_with_frames_in_flight() {
    let folder = Folder::new();
    let aovs = "albedo,normal,position,depth,motion,roughness,holes,spp";
    let line = format!("render builtin:checker --size 96x54 --aov {aovs} --frames 2 --fps 2");
    folder.run(&format!("{line} --virtual 1 --set frames_in_flight=1 --out ./one"));
    folder.run(&format!("{line} --virtual 3 --set frames_in_flight=2 --out ./three"));
    let mut names = folder.names("one");
    names.retain(|n| n != "run.json" && n != "frames.csv");
    assert_eq!(names.len(), 2 * (2 + 2 * 8 + 2 + 3), "{names:?}");
    for name in names {
        assert!(folder.bytes(&format!("one/{name}")) == folder.bytes(&format!("three/{name}")), "{name} differs");
    }
}
