//! Published experiments are set up as published, and accept only their own options.

use serde_json::Value;

use crate::common::diptych;
use crate::runs::run;

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

#[track_caller]
fn refused(args: &[&str], parts: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    let output = diptych(&[&["study"], args, &["--out", folder.path().to_str().unwrap()]].concat());
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(2) && parts.iter().all(|p| text.contains(p)), "{args:?}: {text}");
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn the_baseline_shares_out_path_tracing_alone() {
    let run = run("leria");
    let rows = run.rows();
    let of = |source: &str| rows.iter().filter(|r| r["source"] == source).collect::<Vec<_>>();
    let counts = |source| of(source).iter().map(|r| r["devices"].clone()).collect::<Vec<_>>();
    assert_eq!(counts("measured"), [2, 2]);
    assert_eq!(counts("simulated"), [4, 4, 2, 2]);
    assert_eq!(of("cited").len(), 6);
    for row in of("measured").iter().chain(&of("simulated")) {
        let [primary, others] = ["primary_busy_share", "others_busy_share"].map(|name| number(&row[name]));
        let is_baseline = row["arrangement"] == "baseline";
        let [paths, filter] = ["path_tracing_ms", "denoising_ms"].map(|name| number(&row[name]));
        assert!(paths > 0.0 && filter > 0.0 && row["skinning_ms"].is_null(), "{row}");
        assert!(primary > 0.0 && primary < 1.1 && others > 0.0, "{row}");
        assert!(number(&row["speedup"]) == 1.0 || !is_baseline, "{row}");
        assert!(primary > others || !is_baseline, "the primary does what the others do and more: {row}");
    }

    let json = run.json();
    let frames = json["frames"].as_array().unwrap();
    assert_eq!(frames.len(), 2 * 3);
    for (i, frame) in frames.iter().enumerate() {
        let rows = &frame["stage_stripes"];
        let later = if i < 3 { [24, 0] } else { [12, 12] };
        let shared = ["gbuffer.left", "path_trace.left"].map(|stage| rows[stage] == serde_json::json!([12, 12]));
        assert_eq!(shared, [true; 2], "{rows}");
        for stage in ["gbuffer.right", "reproject.right", "hole_fill.right", "svgf.left", "svgf.right", "resolve.left"]
        {
            assert_eq!(rows[stage], serde_json::json!(later), "{stage}: {rows}");
        }
        // Both arrangements render the same times.
        assert!((number(&frame["time_s"]) - (i % 3) as f64 / 72.0).abs() < 1e-9, "{}", frame["time_s"]);
    }
    let csv = run.text("leria.csv");
    assert_eq!(csv.lines().count(), 1 + rows.len(), "{csv}");
    let page = run.text("report.html");
    for part in ["Its bytes are the same in both", "San Miguel", "3.65", "99 | 53", "Swimlanes"] {
        assert!(page.contains(part), "no {part}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn dependent_features_are_left_out_beside_noise_and_svgf() {
    let run = run("bmfr");
    let rows = run.rows();
    let denoisers = rows.iter().map(|r| r["denoiser"].as_str().unwrap()).collect::<Vec<_>>();
    assert_eq!(denoisers, ["svgf", "bmfr", "bmfr_noise", "bmfr", "bmfr_noise"]);
    for row in &rows[..3] {
        let [frame, path, filter] = [&row["time_ms"][0], &row["path_ms"], &row["filter_ms"]].map(number);
        assert!((number(&row["frames_per_s"]) * frame - 1e3).abs() < 1e-6, "{row}");
        // The fraction covers all stages; these are two of them.
        let all_ms = filter / number(&row["filter_share"]);
        assert!(path > 0.0 && filter > 0.0 && all_ms >= (path + filter) * (1.0 - 1e-9), "{row}");
        assert!(number(&row["flip"]) > 0.0 && number(&row["flicker"]) > 0.0, "{row}");
    }
    // Noise on features has a visible but small effect.
    let flips = [&rows[1], &rows[2]].map(|row| number(&row["flip"]));
    assert!(flips[0] != flips[1] && (flips[0] / flips[1] - 1.0).abs() < 0.1, "{flips:?}");
    let frames = run.text("frames.csv");
    assert_eq!(frames.lines().filter(|line| line.starts_with("builtin:checker,bmfr_noise,")).count(), 2, "{frames}");
    assert_eq!(run.text("bmfr.csv").lines().count(), 1 + rows.len());
    assert!(run.text("report.html").contains("42.7 %"));
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn visual_polar_images_stand_beside_as_many_samples_elsewhere() {
    let run = run("koskela");
    let rows = run.rows();
    let arrangements = rows.iter().map(|r| r["arrangement"].as_str().unwrap()).collect::<Vec<_>>();
    let all = ["full", "uniform", "linear", "visual-polar", "log-polar"];
    assert_eq!(arrangements, [&all[..], &["full", "visual-polar"].repeat(2)].concat());
    let of = |name: &str| rows[..5].iter().map(|row| number(&row[name])).collect::<Vec<_>>();
    // All arrangements but the first trace about as many pixels, except for a few at silhouettes.
    let paths = of("paths_left");
    assert!(paths[0] == 1.0 && paths[3] > 0.3 && paths[3] < 0.45, "{paths:?}");
    assert!(paths[1..].iter().all(|share| (share / paths[3] - 1.0).abs() < 0.1), "{paths:?}");
    let sigma = number(&rows[4]["sigma"]);
    assert!(sigma > 1.0 && sigma < 2.0 && rows[3]["sigma"].is_null(), "{sigma}");
    let floor = number(&rows[2]["floor"]);
    assert!(floor > 0.0 && floor < paths[2] && rows[1]["floor"].is_null(), "{floor}");
    for row in &rows[..5] {
        let is_polar = row["arrangement"].as_str().unwrap().ends_with("-polar");
        for name in ["map_ms", "blur_ms"] {
            assert!(row[name].as_f64().is_some_and(|ms| ms > 0.0) == is_polar, "{name}: {row}");
        }
    }
    for name in
        ["path_ms", "filter_ms", "path_speedup", "paths_right", "flip", "flicker", "fovea_flip", "fovea_flicker"]
    {
        assert!(of(name).iter().all(|value| *value > 0.0), "{name}: {:?}", of(name));
    }
    // All arrangements render different images.
    for name in ["flip", "flip_acuity", "flip_foveated", "fovea_flip", "fovea_flicker"] {
        let found = of(name);
        assert!((0..5).all(|i| !found[..i].contains(&found[i])), "{name}: {found:?}");
    }
    let frames = run.text("frames.csv");
    assert_eq!(frames.lines().filter(|line| line.starts_with("builtin:checker,visual-polar,")).count(), 2, "{frames}");
    assert_eq!(run.text("koskela.csv").lines().count(), 1 + rows.len());
    let page = run.text("report.html");
    assert!(page.contains("linear of builtin:checker") && page.contains("56.00"));
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn log_polar_images_stand_beside_every_pixel_by_rings() {
    let run = run("andersson");
    let rows = run.rows();
    let modes = ["basic", "fov", "kernel", "composite", "composite-kernel"];
    let (measured, cited) = rows.split_at(2 * modes.len());
    assert!(measured.iter().all(|row| row["source"] == "measured") && cited.iter().all(|row| row["source"] == "cited"));
    for (camera, rows) in ["still", "moving"].into_iter().zip(measured.chunks(modes.len())) {
        for (row, mode) in rows.iter().zip(modes) {
            assert_eq!((&row["camera"], &row["mode"]), (&camera.into(), &mode.into()));
            let [dispatched, traced] = ["dispatched", "traced"].map(|name| number(&row[name]));
            assert!(dispatched >= traced && traced > 0.2 && (traced == 1.0) == (mode == "basic"), "{row}");
            assert_eq!(row["map_ms"].as_f64().is_some_and(|ms| ms > 0.0), mode != "basic", "{row}");
            for name in ["gbuffer_ms", "reproject_ms", "path_ms", "filter_ms", "resolve_ms", "flip", "flip_acuity"] {
                assert!(number(&row[name]) > 0.0, "{name}: {row}");
            }
            assert_eq!(row["flicker"].is_null(), camera == "moving", "{row}");
            let [near, far] = ["ssim", "ssim_basic"].map(|name| row[name].as_array().unwrap());
            assert!(near.iter().all(|ssim| number(ssim) < 1.0) && far.iter().all(|s| s.is_null() == (mode == "basic")));
        }
        assert!(number(&rows[1]["dispatched"]) > 1.2 && number(&rows[3]["dispatched"]) < 0.8, "{rows:?}");
        // All rows render different images.
        let flips = rows.iter().map(|row| number(&row["flip"])).collect::<Vec<_>>();
        assert!((0..5).all(|i| !flips[..i].contains(&flips[i])), "{flips:?}");
    }
    let rings = run.text("rings.csv");
    assert_eq!(rings.lines().count(), 1 + 2 * modes.len() * 20, "{rings}");
    let frames = run.text("frames.csv");
    assert_eq!(frames.lines().filter(|line| line.starts_with("builtin:cornell,moving,fov,")).count(), 2, "{frames}");
    assert_eq!(run.text("andersson.csv").lines().count(), 1 + rows.len());
    let page = run.text("report.html");
    for part in ["10.58", "kernel of builtin:cornell, moving", "camera still: against reference", "0.960, 0.920"] {
        assert!(page.contains(part), "no {part}");
    }
}

/// A longer latency gives a larger error, and correction removes more of it.
#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn late_frames_are_off_and_corrected_ones_hardly() {
    let run = run("late");
    let rows = run.rows();
    assert_eq!(rows.iter().map(|row| row["latency_frames"].clone()).collect::<Vec<_>>(), [1, 2, 4]);
    for row in rows {
        let [late, corrected, noise] = ["flip", "flip_corrected", "flip_noise"].map(|name| number(&row[name]));
        assert!(noise > 0.0 && corrected < late && corrected < 1.5 * noise, "{row}");
        assert!(number(&row["flip_most"]) >= late && number(&row["flip_corrected_most"]) >= corrected, "{row}");
        assert!(row["instants"] == 2 && number(&row["turned_deg"]) > 0.0 && number(&row["moved_mm"]) > 0.0, "{row}");
    }
    assert!(number(&rows[2]["flip"]) > 1.3 * number(&rows[0]["flip"]), "{rows:?}");
    assert_eq!(run.text("late.csv").lines().count(), 1 + rows.len());
    assert!(run.text("report.html").contains("eyes are resampled from a frame that they share"));
}

/// The settings of all arrangements are read before the scene.
#[test]
fn every_preset_is_valid_up_to_its_scene() {
    for preset in ["leria", "bmfr", "koskela", "andersson", "late", "peres"] {
        let more = match preset {
            "leria" => &["--virtual", "2"][..],
            "late" => &["--motion", "missing.jsonl"],
            _ => &["--shots", "missing.toml"],
        };
        let scene = if more[0] == "--shots" { &[][..] } else { &["missing.toml"] };
        refused(&[&[preset], scene, more].concat(), &["missing."]);
    }
}

#[test]
fn experiments_refuse_what_does_not_go_with_them() {
    refused(&["leria", "builtin:cornell", "--devices", "0"], &["two devices", "--virtual 2"]);
    refused(&["leria", "--virtual", "2", "--shots", "builtin:cornell"], &["study leria", "--shots"]);
    refused(&["leria", "--virtual", "2", "--repeats", "3"], &["study leria", "--repeats"]);
    refused(&["leria", "--virtual", "2", "--ratios", "1,2"], &["--simulate", "--ratios"]);
    refused(&["leria", "--set", "denoiser=svgf"], &["study leria", "denoiser"]);
    refused(&["bmfr", "--frames", "3"], &["study bmfr", "--frames"]);
    refused(&["bmfr", "builtin:cornell", "--shots", "builtin:checker"], &["SHOT", "--shots"]);
    refused(&["koskela", "--instants", "3"], &["study koskela", "--instants"]);
    refused(&["andersson", "--frames", "3"], &["study andersson", "--frames"]);
    refused(&["late"], &["--motion"]);
    refused(&["late", "--repeats", "2"], &["study late", "--repeats"]);
    refused(&["peres", "builtin:cornell"], &["study peres", "SHOT"]);
    refused(&["peres", "--size", "32x20"], &["study peres", "size"]);
    refused(&["nobody"], &["nobody", "leria", "bmfr", "koskela", "andersson", "peres", "late"]);
}

/// The example of the documentation.
fn own_experiment() -> String {
    let text = include_str!("../../docs/experiments.md");
    text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap().to_owned()
}

#[test]
fn an_experiment_of_your_own_has_its_own_arrangements_and_columns() {
    let folder = tempfile::tempdir().unwrap();
    let [file, out] = ["own.toml", "out"].map(|name| folder.path().join(name).to_str().unwrap().to_owned());
    std::fs::write(&file, own_experiment()).unwrap();
    let args =
        ["study", &file, "builtin:checker", "--size", "32x20", "--repeats", "2", "--reference-spp", "16", "--json"];
    let output = diptych(&[&args[..], &["--out", &out]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let result: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
    let rows = result["rows"].as_array().unwrap();
    assert_eq!(rows.iter().map(|row| row["bounces"].as_str().unwrap()).collect::<Vec<_>>(), ["six", "two"].repeat(2));
    assert!(rows[..2].iter().all(|row| number(&row["path_ms"]) > 0.0 && number(&row["path_fraction"]) < 1.0));
    assert!(number(&rows[0]["speedup"]) == 1.0 && rows[0]["flip"] != rows[1]["flip"] && rows[3]["speedup"] == 2.5);
    let csv = std::fs::read_to_string(format!("{out}/bounces.csv")).unwrap();
    assert!(csv.starts_with("source,scene,bounces,time_ms,path_ms,path_fraction,speedup,flip\n"), "{csv}");
    // The command line has the last word on the number of frames.
    let frames = std::fs::read_to_string(format!("{out}/frames.csv")).unwrap();
    assert!(frames.starts_with("shot,bounces,frame,") && frames.lines().count() == 1 + 2 * 2, "{frames}");
}

#[test]
fn a_wrong_experiment_is_refused_by_file_and_key() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("own.toml");
    let path = file.to_str().unwrap();
    let run = |more: &[&str]| {
        let output = diptych(&[&["study", path, "--out", "unused"], more].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (status, text) = run(&[]);
    assert!(status == Some(2) && text.contains("own.toml"), "{text}");
    for (old, new, key) in [
        ("title =", "titel =", "titel"),
        ("\"flip\" },", "\"flop\" },", "flop"),
        ("options.bounces = 2", "options.bounces = -2", "bounces"),
        ("options.bounces = 2", "options.jumps = 2", "jumps"),
    ] {
        std::fs::write(&file, own_experiment().replacen(old, new, 1)).unwrap();
        let (status, text) = run(&[]);
        assert!(status == Some(2) && text.contains("own.toml") && text.contains(key), "{new}: {text}");
    }
    std::fs::write(&file, own_experiment()).unwrap();
    for (more, part) in [(["--set", "spp=1"], "spp"), (["--frames", "3"], "--frames")] {
        let (status, text) = run(&more);
        assert!(status == Some(2) && text.contains(part), "{more:?}: {text}");
    }
}
