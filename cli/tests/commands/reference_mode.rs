//! References accumulate in passes. They have the same bytes wherever they are stopped and resumed and on any number of
//! devices, and many samples do not make them drift.

use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::Folder;
use diptych::image::RgbImage;
use diptych::image::exr::read_rgb;
use serde_json::{Value, json};

/// Renders the box in passes; returns the result's entry for the reference.
#[track_caller]
fn render(folder: &Folder, out: &str, options: &str) -> Value {
    let size = if options.contains("--size") { "" } else { "--size 24x14" };
    let line = format!("render builtin:cornell --reference --json {size} --out ./{out} {options}");
    folder.run(&line).json()["references"][0].clone()
}

/// Renders a frame from its samples alone, without filters.
#[track_caller]
fn render_frame(folder: &Folder, out: &str, options: &str) {
    let size = if options.contains("--size") { "" } else { "--size 24x14" };
    folder.run(&format!("render builtin:cornell --denoiser none --reproject off {size} --out ./{out} {options}"));
}

fn image(folder: &Folder, out: &str, eye: &str) -> RgbImage {
    read_rgb(&folder.path(&format!("{out}/{eye}.exr"))).unwrap()
}

/// Options of a run with a checkpoint, and its file.
const KEPT: &str = "--set passes_out=./passes";
const STATE: &str = "passes/reference.state";

#[test]
fn same_bytes_of_resumed_reference_passes() {
    let folder = Folder::new();
    render(&folder, "whole", "--spp 40");
    let done = |spp: &str| {
        let row = render(&folder, "parts", &format!("--spp {spp} {KEPT}"));
        ["spp", "spp_resumed"].map(|name| row[name].as_u64().unwrap())
    };
    assert_eq!(done("16"), [16, 0]);
    // The last pass is incomplete: it is in the picture, but not in the checkpoint.
    assert_eq!(done("20"), [20, 16]);
    assert_eq!(done("40"), [40, 16]);
    folder.assert_same_eyes("whole", "parts");
    // The checkpoint has more samples than requested, so nothing is rendered.
    assert_eq!(done("24"), [40, 40]);
    folder.assert_same_eyes("whole", "parts");
    assert!(folder.path("passes/reference.preview.png").exists());
}

#[test]
fn reference_has_many_samples_by_default() {
    let folder = Folder::new();
    let row = render(&folder, "default", "--size 8x6 --bounces 1");
    assert_eq!((&row["spp"], &row["spp_wanted"]), (&256.into(), &256.into()));
    assert_eq!(render(&folder, "one", "--size 8x6 --spp 1")["spp"], 1);
    render(&folder, "kept", &format!("--spp 16 {KEPT}"));
    let resume = format!("render builtin:cornell --reference --size 24x14 --spp 10 {KEPT} --out ./kept");
    let said = folder.run(&resume).out;
    assert!(said.contains("16 samples per pixel, 10 were asked for, 16 of them from earlier runs"), "{said}");
}

/// The rays of all passes must not be divided by the time of the last pass alone.
#[test]
fn reference_takes_as_long_as_its_passes() {
    let folder = Folder::new();
    render(&folder, "out", "--spp 32");
    let run = folder.json("out/run.json");
    assert_eq!(run["references"][0]["passes"], 4);
    assert!(run["frames"][0]["interval_ms"].is_null(), "{}", run["frames"][0]["interval_ms"]);
}

#[test]
fn same_bytes_of_a_reference_on_two_devices() {
    let folder = Folder::new();
    render(&folder, "one", "--spp 24");
    render(&folder, "two", "--spp 24 --virtual 2");
    folder.assert_same_eyes("one", "two");
}

#[test]
fn killed_reference_resumes_from_its_checkpoint() {
    let folder = Folder::new();
    let line = "render builtin:cornell --reference --spp 100000000 --quiet --size 24x14 --out ./killed";
    let mut run = folder.start(&format!("{line} {KEPT}"), Stdio::null());
    let begin = Instant::now();
    while !folder.path(STATE).exists() && begin.elapsed() < Duration::from_secs(120) {
        std::thread::sleep(Duration::from_millis(50));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    assert!(folder.path("killed").is_dir() && folder.names("killed").is_empty(), "a killed run left pictures");
    let row = render(&folder, "kept", &format!("--spp 8 {KEPT}"));
    let spp = row["spp"].as_u64().unwrap();
    assert!(spp >= 8 && row["spp_resumed"] == row["spp"], "{row}");
    render(&folder, "whole", &format!("--spp {spp}"));
    folder.assert_same_eyes("kept", "whole");
}

#[test]
fn rejects_checkpoints_of_another_traversal() {
    let Some(able) = diptych::device::adapters().into_iter().find(|a| a.ray_queries && a.missing.is_empty()) else {
        eprintln!("\nSKIPPED: no adapter here has ray queries\n");
        return;
    };
    let folder = Folder::new();
    let with = |traversal: &str| format!("{KEPT} --devices {} --set traversal={traversal}", able.index);
    render(&folder, "compute", &format!("--spp 8 {}", with("compute")));
    let other = format!("render builtin:cornell --reference --size 24x14 --spp 16 {} --out ./other", with("hardware"));
    folder.refuses(2, "", &format!("{other} => traversal is compute there and hardware here"));
    let run = folder.json("compute/run.json");
    assert_eq!([&run["devices"][0]["traversal"], &run["settings"]["traversal"]], ["compute"; 2]);
}

#[test]
fn rejects_checkpoints_of_other_renders() {
    let folder = Folder::new();
    render(&folder, "out", &format!("--spp 8 {KEPT}"));
    let resume = format!("render builtin:cornell --reference --out ./other --spp 16 {KEPT}");
    let table = "
    --size 24x14 --seed 5 => reference.state | seed is 0 there and 5 here
    --size 16x16 => reference.state | size is 24x14 there and 16x16 here
    --size 24x14 --bounces 2 => reference.state | bounces is 6 there and 2 here
    --size 24x14 --set sampler=pcg => reference.state | sampler is sobol there and pcg here
    --size 24x14 --set pass_spp=16 => reference.state | pass_spp is 8 there and 16 here
    --size 24x14 --time 1 => reference.state | camera is
    ";
    folder.refuses(2, &resume, table);
    let other = resume.replace("cornell", "checker");
    folder.refuses(2, &other, "--size 24x14 => reference.state | scene is ");
}

#[test]
fn rejects_damaged_checkpoints() {
    let folder = Folder::new();
    render(&folder, "out", &format!("--spp 8 {KEPT}"));
    let whole = folder.bytes(STATE);
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
        folder.write(STATE, bytes);
        let resume = format!("render builtin:cornell --reference --size 24x14 --spp 8 {KEPT} --out ./other");
        folder.refuses(2, "", &format!("{resume} => reference.state | damaged | {part}"));
    }
}

#[test]
fn time_limit_ends_a_reference_early() {
    let folder = Folder::new();
    let row = render(&folder, "limited", "--spp 1000000000 --set time_limit=0.5");
    assert_eq!(row["out_of_time"], true, "{row}");
    let spp = row["spp"].as_u64().unwrap();
    assert!((8..1_000_000).contains(&spp) && spp.is_multiple_of(8), "{row}");
    render(&folder, "whole", &format!("--spp {spp}"));
    folder.assert_same_eyes("limited", "whole");
}

/// The pilot has a fourth of the width, so the noise differs by up to a third.
#[test]
fn wanted_noise_sets_the_number_of_samples() {
    let folder = Folder::new();
    let render = |out: &str, options: &str| {
        folder.run(&format!("render builtin:studio --size 96x54 --bounces 2 --quiet --out ./{out} {options}"));
        folder.json(&format!("{out}/run.json"))
    };
    let reference = |wanted: f64| {
        let run = render("reference", &format!("--reference --noise {wanted}"));
        let row = &run["references"][0];
        let relmse = ["left", "right"].map(|eye| row["noise"][eye]["relmse"].as_f64().unwrap());
        (row["spp"].as_f64().unwrap(), relmse[0].max(relmse[1]).sqrt())
    };
    let [(some, _), (more, noise)] = [reference(0.2), reference(0.1)];
    assert!((3.8..4.2).contains(&(more / some)), "{more} and {some} samples");
    assert!((0.066..0.133).contains(&noise), "{noise}");

    let still = render("still", "--noise 0.1");
    assert_eq!([&still["frames"][0]["spp"], &still["settings"]["spp"]], [&json!(more as u32); 2]);
    let bounded = render("bounded", "--noise 0.001 --spp 2 --warm-up 0");
    assert_eq!(bounded["frames"][0]["spp"], 2);
}

/// Half of the picture is sky or the white sphere's front, which show radiance 1 in every sample.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn constant_radiance_does_not_drift() {
    let folder = Folder::new();
    let sampled = "--reference --spp 65536 --set pass_spp=1024";
    folder.run(&format!("render builtin:furnace {sampled} --bounces 1 --size 6x4 --quiet --out ./furnace"));
    let image = image(&folder, "furnace", "left");
    let off = |p: &[f32; 3]| p.iter().map(|c| (c - 1.0).abs()).fold(0.0, f32::max);
    let constant = image.pixels.iter().filter(|p| off(p) < 1e-4).count();
    let brightest = image.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
    assert!(brightest < 1.0 + 1e-4, "light is made: {brightest}");
    assert!(constant >= 8, "{constant} pixels show 1: {:?}", image.pixels);
}

/// Passes continue the same sample sequences: together they take the samples of one long frame.
#[test]
fn passes_take_the_samples_of_one_frame() {
    let folder = Folder::new();
    // In a frame, pixels share Sobol sequences; in a reference they do not. PCG is the same for both.
    let sampled = "--spp 28 --set sampler=pcg";
    render(&folder, "passes", sampled);
    render_frame(&folder, "frame", sampled);
    for eye in ["left", "right"] {
        let (passes, frame) = (image(&folder, "passes", eye), image(&folder, "frame", eye));
        let pairs = passes.pixels.as_flattened().iter().zip(frame.pixels.as_flattened());
        // The sums have 28 terms in a different order, and the albedo is divided out and multiplied back.
        let apart = pairs.map(|(a, b)| (a - b).abs() / b.abs().max(0.01)).fold(0.0, f32::max);
        assert!(apart < 1e-4, "{eye}: {apart}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn reference_jitters_a_single_sample() {
    let folder = Folder::new();
    render(&folder, "reference", "--spp 1");
    render_frame(&folder, "frame", "--spp 1");
    let [a, b] = ["reference", "frame"].map(|out| image(&folder, out, "left").pixels);
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
    let folder = Folder::new();
    let common = "--size 96x54 --bounces 2";
    render(&folder, "converged", &format!("{common} --spp 256"));
    let converged = image(&folder, "converged", "left");
    let [mut shared, mut own] = [[0.0; 2]; 2];
    for seed in 1..=4 {
        let options = format!("{common} --spp 4 --seed {seed}");
        render_frame(&folder, "shared", &options);
        render(&folder, "own", &options);
        for (sum, out) in [(&mut shared, "shared"), (&mut own, "own")] {
            let image = image(&folder, out, "left");
            sum.iter_mut().zip([1, 4]).for_each(|(sum, size)| *sum += block_error(&image, &converged, size));
        }
    }
    println!("errors over pixels and blocks: shared sequences {shared:?}, own {own:?}");
    assert!((shared[0] / own[0] - 1.0).abs() < 0.2, "a pixel by itself is neither better nor worse");
    assert!(shared[1] < 0.8 * own[1], "blocks are better");
}
