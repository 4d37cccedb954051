//! Studies measure correctly and render what their tables say: sequences against their references, seams by policy.

use crate::common::Folder;
use crate::runs::{Run, run};
use serde_json::Value;

/// Renders frames of the checker scene with the auxiliary images for a comparison.
fn render(folder: &Folder, out: &str, options: &str) {
    let fixed = "render builtin:checker --size 64x40 --frames 3 --fps 6 --quiet";
    folder.run(&format!("{fixed} --out ./{out} {options}"));
}

const AOVS: &str = "--aov motion,position,normal";

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn noise_flickers_and_filtering_calms_it() {
    let folder = Folder::new();
    render(&folder, "right", "--spp 64 --denoiser none --seed 9");
    render(&folder, "noisy", &format!("{AOVS} --denoiser none"));
    // Frames of both runs look through the same points of their pixels.
    render(&folder, "filtered", &format!("{AOVS} --denoiser atrous"));
    let of = |found: &Value, eye: &str, name: &str| found[eye][name].as_f64().unwrap();

    let [noisy_found, filtered_found] =
        ["noisy", "filtered"].map(|image| folder.run(&format!("compare ./right ./{image} --json")).json());
    for eye in ["left", "right"] {
        println!("{eye}: {} and {}", noisy_found[eye], filtered_found[eye]);
        let per_frame = noisy_found[eye]["per_frame"].as_array().unwrap();
        assert_eq!((&noisy_found[eye]["frames"], per_frame.len()), (&3.into(), 3));
        let flicker = [&noisy_found, &filtered_found].map(|found| of(found, eye, "flicker"));
        assert!(flicker[1] < 0.7 * flicker[0], "{eye}: {flicker:?}");
        let new_share = of(&noisy_found, eye, "new_share");
        assert!(new_share > 0.0 && new_share < 0.5, "{new_share}");
        assert_eq!(new_share, of(&filtered_found, eye, "new_share"), "surfaces are the same for both");
    }
    // Twelve stops darker, the image is almost black.
    let dark = folder.run("compare ./right ./noisy --json --exposure -12").json();
    assert_eq!((of(&noisy_found, "left", "exposure_ev"), of(&dark, "left", "exposure_ev")), (0.0, -12.0));
    assert!(of(&dark, "left", "flicker") < 0.1 * of(&noisy_found, "left", "flicker"), "{dark}");

    let same = folder.run("compare ./noisy ./noisy --json").json();
    assert_eq!((of(&same, "left", "flicker"), &same["left"]["ghosting"]), (0.0, &Value::Null));

    let text = folder.run("compare ./right ./noisy").out;
    assert!(["flicker", "relmse"].iter().all(|name| text.lines().any(|l| l.starts_with(name))), "{text}");
    assert!(text.lines().any(|l| l.starts_with("exposure_ev     as the reference says")), "{text}");
}

#[test]
fn rejects_sequences_that_lack_something() {
    let folder = Folder::new();
    render(&folder, "with", AOVS);
    render(&folder, "without", "");
    std::fs::create_dir(folder.path("empty")).unwrap();
    let table = "
        compare ./with ./without => left.motion.0000.exr | --aov motion,position,normal
        compare ./with ./with --by rings => --by rings
        compare ./with ./with/left.0000.exr => with
        compare ./empty ./empty => 0 frame(s)
    ";
    folder.refuses(2, "", table);
    std::fs::remove_file(folder.path("with/right.normal.0002.exr")).unwrap();
    folder.refuses(2, "", "compare ./without ./with => frame 2, right eye | right.normal.0002.exr");
    std::fs::remove_file(folder.path("with/left.0001.exr")).unwrap();
    let table = "
        compare ./without ./with => with/left.0001.exr
        compare ./with ./with => no frame between 0 and 2
    ";
    folder.refuses(2, "", table);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn only_the_halo_leaves_no_seam() {
    let run = run("seams");
    let rows = run.rows();
    assert_eq!(rows.len(), 2 + 3 * 2);
    for row in rows {
        let is_same = row["same_bytes"] == true;
        assert_eq!(is_same, ["-", "halo"].contains(&row["policy"].as_str().unwrap()), "{row}");
        // The PSNR of equal images is infinite.
        assert_eq!(is_same, row["psnr_one"].is_null(), "{row}");
        if row["devices"] == 2 {
            let [near, over_one] = ["seam_rmse_one", "seam_over_one"].map(|name| row[name].as_f64().unwrap());
            assert_eq!((near == 0.0, over_one == 1.0), (is_same, is_same), "{row}");
            assert!(row["seam"].as_f64().unwrap() > 0.0 && row["cambi"].as_f64().unwrap() >= 0.0, "{row}");
        }
    }
    let csv = run.text("seams.csv");
    assert_eq!(csv.lines().count(), 1 + rows.len(), "{csv}");
    let page = run.text("report.html");
    assert!(["builtin:checker", "same bytes", "20.30 (-0.53)"].iter().all(|part| page.contains(part)));
    for (setting, value) in [("bounces", "6"), ("denoiser", "svgf"), ("hard_shadows", "off")] {
        let row = format!("<td>{setting}</td><td>{value}</td>");
        assert!(page.contains(&row), "no {row}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn peres_has_the_layers_of_the_thesis() {
    let run = run("peres");
    for row in run.rows().iter().filter(|row| row["source"] == "measured") {
        let [rmse, psnr] = ["rmse_percent", "psnr"].map(|name| row[name].as_f64().unwrap());
        // At each instant one follows from the other. The mean of a convex function is above the function of the mean.
        let excess = rmse / (100.0 * 10f64.powf(-psnr / 20.0)) - 1.0;
        assert!((0.0..0.1).contains(&excess), "{row}");
        // The box looks different from the end of the path than from its begin.
        assert!(row["psnr_deviation"].as_f64().unwrap() > 0.0, "{row}");
    }
    // The layers are those of the thesis at each resolution, at both instants.
    let (columns, frames) = run.csv("frames.csv");
    let at = |name: &str| columns.iter().position(|column| column == name).unwrap();
    let [resolution, configuration, time_s, inner] = ["resolution", "arrangement", "time_s", "fovea_inner"].map(at);
    assert_eq!(frames.len(), 2 * 2 * 2 * 3);
    for frame in &frames {
        let width = if &frame[resolution] == "FHD" { 144.0 / 960.0 } else { 265.0 / 1832.0 };
        let expected = if &frame[configuration] == "Base" { None } else { Some(width) };
        assert_eq!(frame[inner].parse::<f64>().ok(), expected, "{frame:?}");
    }
    assert_eq!([&frames[0], &frames[3]].map(|frame| frame[time_s].to_owned()), ["0", "4"]);
    let page = run.text("report.html");
    assert!(["27.62", "12.81", "builtin:cornell"].iter().all(|part| page.contains(part)));
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// Returns the rows of a study under some conditions.
fn rows<'a>(run: &'a Run, conditions: &str) -> Vec<&'a Value> {
    run.rows().iter().filter(|row| row["source"] != "cited" && row["conditions"] == conditions).collect()
}

fn cited(run: &Run) -> usize {
    run.rows().iter().filter(|row| row["source"] == "cited").count()
}

fn names<'a>(rows: &[&'a Value]) -> Vec<&'a str> {
    rows.iter().map(|row| row["arrangement"].as_str().unwrap()).collect()
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn leria_times_sequences_and_predicts_devices() {
    let run = run("leria");
    for conditions in ["published", "today"] {
        let rows = rows(run, conditions);
        let devices: Vec<&str> = rows.iter().map(|row| row["devices"].as_str().unwrap()).collect();
        assert_eq!(devices, ["2", "2", "4", "4", "2", "2"]);
        for row in &rows {
            let is_baseline = row["arrangement"] == "baseline";
            let [primary, others] = ["primary_busy_share", "others_busy_share"].map(|name| number(&row[name]));
            assert!(primary > 0.0 && others > 0.0 && (primary > others || !is_baseline), "{row}");
            assert!(number(&row["path_tracing_ms"]) > 0.0 && number(&row["denoising_ms"]) > 0.0, "{row}");
            assert!(number(&row["speedup"]) == 1.0 || !is_baseline, "{row}");
        }
        assert!(rows[..2].iter().all(|row| number(&row["frames"]) == 3.0 && number(&row["total_s"]) > 0.0));
    }
    assert_eq!(cited(run), 6);
    let frames = run.text("frames.csv");
    assert_eq!(frames.lines().count(), 1 + 2 * 2 * 3 * 3, "{frames}");
    let page = run.text("report.html");
    for part in [
        "the last frames of the same settings have the same bytes",
        "San Miguel",
        "3.65",
        "Swimlanes",
        "filter_once",
        "rasteriser",
    ] {
        assert!(page.contains(part), "no {part}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn light_fields_scale_over_devices() {
    let run = run("leria-lightfield");
    for conditions in ["published", "today"] {
        let rows = rows(run, conditions);
        let devices: Vec<&str> = rows.iter().map(|row| row["devices"].as_str().unwrap()).collect();
        assert_eq!(devices, ["2", "1", "2", "2", "2", "4", "1", "4", "4", "4"]);
        for row in &rows {
            let arrangement = row["arrangement"].as_str().unwrap();
            assert!(number(&row["views"]) == 5.0 && number(&row["denoising_ms"]) > 0.0, "{row}");
            assert_eq!(number(&row["speedup"]) == 1.0, arrangement == "baseline", "{row}");
            assert_eq!(number(&row["over_one"]) == 1.0, arrangement == "one device", "{row}");
            assert_eq!(row["hole_filling_ms"].is_f64(), arrangement != "traced", "{row}");
            let shares = conditions == "today" && arrangement != "traced";
            assert_eq!(row["shared_holes_ms"].is_f64(), shares, "{row}");
        }
        let flips: Vec<f64> = rows[..5].iter().map(|row| number(&row["flip_traced"])).collect();
        assert!(flips[0] == flips[1] && flips[1] == flips[2] && flips[2] != flips[3], "{flips:?}");
        assert!(flips[3] > 0.0 && flips[4] == 0.0, "{flips:?}");
        // Four devices with the costs of two share all work but that of the first one.
        let [scaled, alone] = [&rows[7], &rows[6]].map(|row| number(&row["path_tracing_ms"]));
        assert!(scaled < 0.5 * alone, "{scaled} and {alone}");
    }
    assert_eq!(cited(run), 4);
    let page = run.text("report.html");
    for part in ["the last frames of the same settings have the same bytes", "4.63", "DaSH", "share_holes"] {
        assert!(page.contains(part), "no {part}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn bmfr_measures_each_departure() {
    let run = run("bmfr");
    assert_eq!(names(&rows(run, "published")), ["svgf", "bmfr", "bmfr_noise"]);
    let flips = rows(run, "published").into_iter().map(|row| number(&row["flip"])).collect::<Vec<_>>();
    // Noise on features has a visible but small effect.
    assert!(flips[1] != flips[2] && (flips[1] / flips[2] - 1.0).abs() < 0.1, "{flips:?}");
    let departed = rows(run, "published+reproject=on");
    assert_eq!(names(&departed), ["svgf", "bmfr", "bmfr_noise"]);
    assert!((0..3).all(|i| number(&departed[i]["flip"]) != flips[i]), "{departed:?}");
    assert_eq!(run.text("bmfr.csv").lines().count(), 1 + run.rows().len());
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn koskela_traces_as_many_pixels_everywhere() {
    let run = run("koskela");
    for conditions in ["published", "today"] {
        let rows = rows(run, conditions);
        assert_eq!(names(&rows), ["full", "uniform", "linear", "visual-polar", "log-polar"]);
        let of = |name: &str| rows.iter().map(|row| number(&row[name])).collect::<Vec<_>>();
        // All arrangements but the first trace about as many pixels, except for a few at silhouettes.
        let paths = of("paths_left");
        assert!(paths[0] == 1.0 && paths[3] > 0.3 && paths[3] < 0.45, "{paths:?}");
        assert!(paths[1..].iter().all(|share| (share / paths[3] - 1.0).abs() < 0.1), "{paths:?}");
        let [floor, sigma] = [&rows[2]["floor"], &rows[4]["sigma"]].map(number);
        assert!(floor > 0.0 && floor < paths[2] && sigma > 1.0 && sigma < 2.0, "{floor}, {sigma}");
        for row in &rows {
            let is_polar = row["arrangement"].as_str().unwrap().ends_with("-polar");
            assert!(["map_ms", "blur_ms"].iter().all(|name| row[name].is_f64() == is_polar), "{row}");
        }
        // All arrangements render different images.
        for name in ["flip", "flip_acuity", "flip_foveated", "fovea_flip", "fovea_flicker"] {
            let found = of(name);
            assert!((0..5).all(|i| !found[..i].contains(&found[i])), "{name}: {found:?}");
        }
    }
    assert!(run.text("report.html").contains("56.00"));
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn andersson_has_no_filter_as_published() {
    let run = run("andersson");
    for (conditions, is_filtered) in [("published", false), ("today", true)] {
        let rows = rows(run, conditions);
        assert_eq!(rows.len(), 2 * 7);
        for (camera, rows) in ["still", "moving"].into_iter().zip(rows.chunks(7)) {
            for row in rows {
                let is_basic = row["arrangement"] == "basic";
                let [dispatched, traced] = ["dispatched", "traced"].map(|name| number(&row[name]));
                assert!(row["camera"] == camera && dispatched >= traced && (traced == 1.0) == is_basic, "{row}");
                assert!(row["map_ms"].is_f64() != is_basic && row["filter_ms"].is_f64() == is_filtered, "{row}");
                assert!(row["resolve_ms"].is_f64() == is_filtered, "{row}");
                assert!(row["ssim_gaze"].is_f64() && row["ssim_basic_gaze"].is_f64() != is_basic, "{row}");
            }
            let of = |name: &str| number(&rows.iter().find(|row| row["arrangement"] == name).unwrap()["traced"]);
            assert!(of("composite") > of("composite-1.7") && of("composite-1.7") > of("composite-2.0"));
        }
    }
    assert_eq!(run.text("rings.csv").lines().count(), 1 + 2 * 2 * 7 * 20);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn peres_measures_two_sizes() {
    let run = run("peres");
    for conditions in ["published", "today"] {
        let rows = rows(run, conditions);
        assert_eq!(names(&rows), ["Base", "NH2LD", "NH3LD"].repeat(2));
        assert_eq!([&rows[0]["size"], &rows[3]["size"]], ["38x43", "73x77"]);
        for row in rows {
            let [rmse, psnr] = ["rmse_percent", "psnr"].map(|name| number(&row[name]));
            assert!(rmse > 0.0 && psnr > 10.0 && row["stands_for"] == "Pink Room", "{row}");
        }
    }
    assert_eq!(cited(run), 18 + 9);
}
