//! Studies render what their tables say.

use serde_json::Value;

use crate::runs::{Run, run};

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
    for part in ["the last frames have the same bytes", "San Miguel", "3.65", "Swimlanes", "filter_once", "rasteriser"]
    {
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
