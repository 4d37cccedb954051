//! References accumulate in passes. They have the same bytes wherever they are stopped and resumed and on any number of
//! devices, and many samples do not make them drift.

use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{diptych, program};
use diptych::image::RgbImage;
use diptych::image::exr::read_rgb;

const SIZE: &str = "24x14";

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

    /// Runs `render` on the box into `out`, with a small size unless `options` override it.
    fn try_render(&self, out: &str, options: &[&str]) -> Output {
        let out = self.path(out);
        let mut args = vec!["render", "builtin:cornell", "--json", "--out", out.to_str().unwrap()];
        if !options.contains(&"--size") {
            args.extend(["--size", SIZE]);
        }
        args.extend(options);
        diptych(&args)
    }

    /// Renders; returns the result's entry for the reference.
    #[track_caller]
    fn render(&self, out: &str, options: &[&str]) -> serde_json::Value {
        let output = self.try_render(out, &[&["--reference"], options].concat());
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{options:?}: {errors}");
        let text = String::from_utf8(output.stdout).unwrap();
        let last: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        last["references"][0].clone()
    }

    /// Renders a frame from its samples alone, without filters.
    #[track_caller]
    fn render_frame(&self, out: &str, options: &[&str]) {
        let output = self.try_render(out, &[options, &["--denoiser", "none", "--reproject", "off"]].concat());
        assert!(output.status.success(), "{options:?}: {}", String::from_utf8_lossy(&output.stderr));
    }

    fn kept(&self) -> String {
        self.path("passes").to_str().unwrap().to_owned()
    }

    fn state(&self) -> PathBuf {
        self.path("passes/reference.state")
    }

    #[track_caller]
    fn assert_same_bytes(&self, one: &str, other: &str) {
        for eye in ["left.exr", "right.exr"] {
            let [a, b] = [one, other].map(|folder| std::fs::read(self.path(folder).join(eye)).unwrap());
            assert!(a == b, "{eye} of {one} and {other} differ");
        }
    }

    fn image(&self, out: &str, eye: &str) -> RgbImage {
        read_rgb(&self.path(out).join(format!("{eye}.exr"))).unwrap()
    }

    /// Expects an error that contains all of `parts`, and no picture.
    #[track_caller]
    fn refused(&self, options: &[&str], parts: &[&str]) {
        let output = self.try_render("refused", options);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {text}");
        parts.iter().for_each(|part| assert!(text.contains(part), "{options:?}: no '{part}' in {text}"));
        assert!(!self.path("refused/left.exr").exists());
    }
}

#[test]
fn resumed_passes_have_the_bytes_of_uninterrupted_ones() {
    let case = Case::new();
    case.render("whole", &["--spp", "40"]);
    let kept = case.kept();
    let done = |spp: &str| {
        let row = case.render("parts", &["--spp", spp, "--set", &format!("passes_out={kept}")]);
        ["spp", "spp_resumed"].map(|name| row[name].as_u64().unwrap())
    };
    assert_eq!(done("16"), [16, 0]);
    // The last pass is incomplete: it is in the picture, but not in the checkpoint.
    assert_eq!(done("20"), [20, 16]);
    assert_eq!(done("40"), [40, 16]);
    case.assert_same_bytes("whole", "parts");
    // The checkpoint has more samples than requested, so nothing is rendered.
    assert_eq!(done("24"), [40, 40]);
    case.assert_same_bytes("whole", "parts");
    assert!(case.path("passes/reference.preview.png").exists());
}

#[test]
fn reference_has_many_samples_by_default() {
    let case = Case::new();
    let row = case.render("default", &["--size", "8x6", "--bounces", "1"]);
    assert_eq!((&row["spp"], &row["spp_wanted"]), (&256.into(), &256.into()));
    assert_eq!(case.render("one", &["--size", "8x6", "--spp", "1"])["spp"], 1);
    let kept = case.kept();
    case.render("kept", &["--spp", "16", "--set", &format!("passes_out={kept}")]);
    let out = case.path("kept");
    let output = diptych(&[
        "render",
        "builtin:cornell",
        "--reference",
        "--size",
        SIZE,
        "--spp",
        "10",
        "--set",
        &format!("passes_out={kept}"),
        "--out",
        out.to_str().unwrap(),
    ]);
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("16 samples per pixel, 10 were asked for, 16 of them from earlier runs"), "{said}");
}

#[test]
fn rejects_options_that_a_reference_overrides() {
    let case = Case::new();
    for given in [
        ["--denoiser", "svgf"],
        ["--iterations", "3"],
        ["--foveation", "layers"],
        ["--foveation", "visual-polar"],
        ["--set", "polar=kernel"],
        ["--set", "render_scale=0.5"],
        ["--reproject", "on"],
        ["--set", "frames_in_flight=2"],
    ] {
        case.refused(&["--reference", given[0], given[1]], &["a reference"]);
    }
    let agreed = ["--denoiser", "none", "--foveation", "none", "--set", "render_scale=1", "--reproject", "off"];
    case.render("agreed", &[&agreed[..], &["--spp", "2", "--set", "frames_in_flight=1"]].concat());
}

/// The rays of all passes must not be divided by the time of the last pass alone.
#[test]
fn reference_takes_as_long_as_its_passes() {
    let case = Case::new();
    case.render("out", &["--spp", "32"]);
    let run: serde_json::Value = serde_json::from_slice(&std::fs::read(case.path("out/run.json")).unwrap()).unwrap();
    assert_eq!(run["references"][0]["passes"], 4);
    assert!(run["frames"][0]["interval_ms"].is_null(), "{}", run["frames"][0]["interval_ms"]);
}

#[test]
fn same_bytes_of_a_reference_on_two_devices() {
    let case = Case::new();
    case.render("one", &["--spp", "24"]);
    case.render("two", &["--spp", "24", "--virtual", "2"]);
    case.assert_same_bytes("one", "two");
}

#[test]
fn killed_reference_resumes_from_its_checkpoint() {
    let case = Case::new();
    let out = case.path("killed");
    let mut run = program(&["render", "builtin:cornell", "--reference", "--spp", "100000000", "--quiet"])
        .args(["--size", SIZE, "--out"])
        .arg(&out)
        .args(["--set", &format!("passes_out={}", case.kept())])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let begin = Instant::now();
    while !case.state().exists() && begin.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(50));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0, "a killed run left pictures");
    let kept = case.kept();
    let row = case.render("kept", &["--spp", "8", "--set", &format!("passes_out={kept}")]);
    let spp = row["spp"].as_u64().unwrap();
    assert!(spp >= 8 && row["spp_resumed"] == row["spp"], "{row}");
    case.render("whole", &["--spp", &spp.to_string()]);
    case.assert_same_bytes("kept", "whole");
}

#[test]
fn rejects_checkpoints_of_another_traversal() {
    let Some(able) = diptych::device::adapters().into_iter().find(|a| a.ray_queries && a.missing.is_empty()) else {
        eprintln!("\nSKIPPED: no adapter here has ray queries\n");
        return;
    };
    let (case, adapter) = (Case::new(), able.index.to_string());
    let passes = format!("passes_out={}", case.kept());
    let with = |traversal: &'static str| ["--devices", &adapter, "--set", traversal, "--set", &passes];
    case.render("compute", &[&["--spp", "8"], &with("traversal=compute")[..]].concat());
    case.refused(
        &[&["--reference", "--spp", "16"], &with("traversal=hardware")[..]].concat(),
        &["traversal is compute there and hardware here"],
    );
    let run = std::fs::read(case.path("compute/run.json")).unwrap();
    let run: serde_json::Value = serde_json::from_slice(&run).unwrap();
    assert_eq!(run["devices"][0]["traversal"], "compute");
    assert_eq!(run["settings"]["traversal"], "compute");
}

#[test]
fn rejects_checkpoints_of_other_renders() {
    let case = Case::new();
    let kept = case.kept();
    let passes = format!("passes_out={kept}");
    let with = ["--reference", "--spp", "16", "--set", &passes];
    let first = ["--reference", "--spp", "8", "--set", &format!("passes_out={kept}")];
    assert!(case.try_render("out", &first).status.success());
    let before = std::fs::read(case.state()).unwrap();
    for (options, part) in [
        (["--seed", "5"], "seed is 0 there and 5 here"),
        (["--size", "16x16"], "size is 24x14 there and 16x16 here"),
        (["--bounces", "2"], "bounces is 6 there and 2 here"),
        (["--set", "sampler=pcg"], "sampler is sobol there and pcg here"),
        (["--set", "pass_spp=16"], "pass_spp is 8 there and 16 here"),
        (["--time", "1"], "camera is"),
    ] {
        case.refused(&[&with[..], &options].concat(), &["reference.state", part]);
    }
    let out = case.path("refused");
    let other = ["render", "builtin:checker", "--size", SIZE, "--out", out.to_str().unwrap()];
    let output = diptych(&[&other[..], &first[..]].concat());
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && text.contains("scene is "), "{text}");
    assert!(std::fs::read(case.state()).unwrap() == before, "a refused checkpoint was touched");
}

#[test]
fn rejects_damaged_checkpoints() {
    let case = Case::new();
    let kept = case.kept();
    let options = ["--reference", "--spp", "8", "--set", &format!("passes_out={kept}")];
    assert!(case.try_render("out", &options).status.success());
    let whole = std::fs::read(case.state()).unwrap();
    let mut flipped = whole.clone();
    *flipped.last_mut().unwrap() ^= 1;
    for (bytes, part) in [
        (&whole[..whole.len() - 1], "bytes of sums"),
        (&whole[..whole.len() / 2], "bytes of sums"),
        (&whole[..60], "ends within its header"),
        (&whole[..5], "does not begin as a checkpoint does"),
        (&[], "does not begin as a checkpoint does"),
        (&flipped, "not those it was written with"),
    ] {
        std::fs::write(case.state(), bytes).unwrap();
        case.refused(&options, &["reference.state", "damaged", part]);
    }
}

#[test]
fn time_limit_ends_a_reference_early() {
    let case = Case::new();
    let row = case.render("limited", &["--spp", "1000000000", "--set", "time_limit=0.5"]);
    assert_eq!(row["out_of_time"], true, "{row}");
    let spp = row["spp"].as_u64().unwrap();
    assert!((8..1_000_000).contains(&spp) && spp.is_multiple_of(8), "{row}");
    case.render("whole", &["--spp", &spp.to_string()]);
    case.assert_same_bytes("limited", "whole");
}

/// Half of the picture is sky or the white sphere's front, which show radiance 1 in every sample.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn constant_radiance_does_not_drift() {
    let case = Case::new();
    let out = case.path("furnace");
    let output = diptych(&[
        "render",
        "builtin:furnace",
        "--reference",
        "--spp",
        "65536",
        "--set",
        "pass_spp=1024",
        "--bounces",
        "1",
        "--size",
        "6x4",
        "--out",
        out.to_str().unwrap(),
        "--quiet",
    ]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let image = case.image("furnace", "left");
    let off = |p: &[f32; 3]| p.iter().map(|c| (c - 1.0).abs()).fold(0.0, f32::max);
    let constant = image.pixels.iter().filter(|p| off(p) < 1e-4).count();
    let brightest = image.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
    assert!(brightest < 1.0 + 1e-4, "light is made: {brightest}");
    assert!(constant >= 8, "{constant} pixels show 1: {:?}", image.pixels);
}

/// Passes continue the same sample sequences: together they take the samples of one long frame.
#[test]
fn passes_take_the_samples_of_one_frame() {
    let case = Case::new();
    // In a frame, pixels share Sobol sequences; in a reference they do not. PCG is the same for both.
    let sampled = ["--spp", "28", "--set", "sampler=pcg"];
    case.render("passes", &sampled);
    case.render_frame("frame", &sampled);
    for eye in ["left", "right"] {
        let (passes, frame) = (case.image("passes", eye), case.image("frame", eye));
        let pairs = passes.pixels.as_flattened().iter().zip(frame.pixels.as_flattened());
        // The sums have 28 terms in a different order, and the albedo is divided out and multiplied back.
        let apart = pairs.map(|(a, b)| (a - b).abs() / b.abs().max(0.01)).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{eye}: {apart}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn reference_jitters_a_single_sample() {
    let case = Case::new();
    case.render("reference", &["--spp", "1"]);
    case.render_frame("frame", &["--spp", "1"]);
    let [a, b] = ["reference", "frame"].map(|out| case.image(out, "left").pixels);
    // Outside the box, all of a pixel is black.
    let seen: Vec<_> = a.iter().zip(&b).filter(|(a, b)| **a != [0.0; 3] || **b != [0.0; 3]).collect();
    let different = seen.iter().filter(|(a, b)| a != b).count();
    assert!(10 * different > 9 * seen.len() && seen.len() > a.len() / 4, "{different} of {}", seen.len());
}

/// Returns the root mean square of an image's error over blocks of `size` pixels, times `size`. It does not depend on
/// the size if errors are independent.
fn block_error(image: &RgbImage, reference: &RgbImage, size: u32) -> f64 {
    let extent = image.extent;
    let error = |x: u32, y: u32| {
        let at = (y * extent.width + x) as usize;
        f64::from(image.pixels[at].iter().sum::<f32>() - reference.pixels[at].iter().sum::<f32>())
    };
    let [columns, rows] = [extent.width / size, extent.height / size];
    let block = |bx: u32, by: u32| -> f64 {
        (0..size * size).map(|i| error(bx * size + i % size, by * size + i / size)).sum::<f64>() / f64::from(size)
    };
    let squares: f64 = (0..columns * rows).map(|i| block(i % columns, i / columns).powi(2)).sum();
    (squares / f64::from(columns * rows)).sqrt()
}

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn errors_of_neighbouring_pixels_cancel() {
    let case = Case::new();
    let common = ["--size", "96x54", "--bounces", "2"];
    case.render("converged", &[&common[..], &["--spp", "256"]].concat());
    let converged = case.image("converged", "left");
    let [mut shared, mut own] = [[0.0; 2]; 2];
    for seed in ["1", "2", "3", "4"] {
        let options = [&common[..], &["--spp", "4", "--seed", seed]].concat();
        case.render_frame("shared", &options);
        case.render("own", &options);
        for (sum, out) in [(&mut shared, "shared"), (&mut own, "own")] {
            let image = case.image(out, "left");
            sum.iter_mut().zip([1, 4]).for_each(|(sum, size)| *sum += block_error(&image, &converged, size));
        }
    }
    println!("errors over pixels and blocks: shared sequences {shared:?}, own {own:?}");
    assert!((shared[0] / own[0] - 1.0).abs() < 0.2, "a pixel by itself is neither better nor worse");
    assert!(shared[1] < 0.8 * own[1], "blocks are better");
}

#[test]
fn rejects_invalid_limits() {
    let case = Case::new();
    case.refused(&["--set", "time_limit=5"], &["--reference"]);
    case.refused(&["--set", "passes_out=x"], &["--reference"]);
    for limit in ["0", "-1", "nan", "soon"] {
        case.refused(&["--reference", "--set", &format!("time_limit={limit}")], &["time_limit"]);
    }
    for pass in ["0", "1", "12", "8192"] {
        case.refused(&["--reference", "--set", &format!("pass_spp={pass}")], &["pass_spp"]);
    }
    case.refused(&["--spp", "2000000"], &["spp 2000000", "--reference"]);
    assert!(!Path::new("x").exists());
}
