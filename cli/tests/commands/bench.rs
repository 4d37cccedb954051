//! `bench` measures correctly: the error of independent samples falls as their number to the −1/2, and that of Sobol'
//! samples at least as fast. Its files can be read, and nothing is measured twice.

use std::fs::OpenOptions;
use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;

use crate::common::{Folder, is_thorough};
use diptych::control::{Ladder, MIN_STEP, Measure, Rung};
use diptych::quality::{Denoiser, Filter, Quality};
use serde_json::Value;

/// Measures the box; returns the events.
fn bench(folder: &Folder, options: &str) -> Vec<Value> {
    folder.run(&format!("bench builtin:cornell --json --out ./bench {options}")).events()
}

fn event<'a>(events: &'a [Value], name: &str) -> &'a Value {
    events.iter().find(|e| e["event"] == name).unwrap()
}

/// Bound that Student's t with 11 degrees of freedom exceeds with a probability below 1e-4.
const T: f64 = 6.0;

#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn errors_fall_as_the_square_root_of_samples() {
    let folder = Folder::new();
    let size = if is_thorough() { "96x64" } else { "48x32" };
    let grid = "--reproject off --denoiser none --spp 2,8,32 --bounces 6 --repeats 12 --warm-up 0 --reference-spp 512";
    for sampler in ["pcg", "sobol"] {
        let events = bench(&folder, &format!("--size {size} {grid} --set sampler={sampler}"));
        let origin = event(&events, "reference")["origin"].as_str().unwrap();
        assert_eq!(origin.contains("kept from an earlier run"), sampler == "sobol", "{origin}");
        let slopes = event(&events, "result")["slopes"].as_array().unwrap();
        assert_eq!(slopes.len(), 2);
        for found in slopes {
            println!("{sampler}: {found}");
            let [slope, error] = ["slope", "standard_error"].map(|name| found[name].as_f64().unwrap());
            let most = if is_thorough() { 0.01 } else { 0.02 };
            assert!(error < most && found["points"] == 3, "too coarse to tell: {found}");
            assert!(slope < -0.5 + T * error, "{sampler}: {found}");
            assert!(sampler == "sobol" || slope > -0.5 - T * error, "{sampler}: {found}");
        }
    }
}

#[test]
fn grid_writes_rows_plot_and_reference() {
    let folder = Folder::new();
    let few = "--bounces 6 --iterations 3 --reference-spp 64 --virtual 2";
    let events = bench(&folder, &format!("--size 32x18 --quick --repeats 1 --latex {few}"));
    let rows = event(&events, "result")["rows"].as_array().unwrap().clone();
    assert!(rows.len() >= 4);
    assert!(rows.iter().all(|r| r["time_ms"].as_f64().unwrap() > 0.0 && r["errors"]["right"]["rmse"].is_f64()));
    assert!(rows.iter().any(|r| r["on_front"] == true));
    let csv = folder.text("bench/bench.csv");
    assert_eq!(csv.lines().count(), 1 + 2 * rows.len(), "{csv}");
    let columns =
        ["denoiser", "scale", "spp", "eye", "time_ms", "rmse", "flip", "flicker", "flip_flicker", "flip_foveated"];
    for column in columns {
        assert!(csv.lines().next().unwrap().split(',').any(|c| c == column), "no {column} in {csv}");
    }
    let latex = folder.text("bench/bench.tex");
    assert_eq!(latex.lines().filter(|line| line.ends_with(r" \\")).count(), 1 + 2 * rows.len(), "{latex}");
    let svg = folder.text("bench/bench.svg");
    assert!(["atrous", "none", "noise of the reference"].iter().all(|text| svg.contains(text)));

    // The kept reference has the format of any image.
    let kept = format!("./bench/reference/{}", folder.names("bench/reference")[0]);
    let given = format!("--denoiser none --bounces 6 --spp 4 --reference-images {kept} --out ./again");
    let events = folder.run(&format!("bench builtin:cornell --json --size 32x18 --quick --repeats 1 {given}")).events();
    assert!(event(&events, "reference")["noise"].is_null());
    let same = &event(&events, "result")["rows"][0]["errors"]["left"]["rmse"];
    let first = rows.iter().find(|r| r["denoiser"] == "none" && r["spp"] == 4).unwrap();
    assert_eq!(same, &first["errors"]["left"]["rmse"]);
}

/// Black frames on the screen have almost no FLIP, however large the error of their radiance. A different exposure
/// invalidates kept measurements, but not the kept reference.
#[test]
fn grid_measures_errors_at_the_exposure_of_its_shot() {
    let folder = Folder::new();
    let at = |ev: &str| {
        let text = include_str!("../../../scenes/cornell.toml").to_owned() + &format!("\n[exposure]\nev = {ev}\n");
        folder.write("shot.toml", text);
        let setting = "--size 32x18 --spp 1 --bounces 2 --denoiser none --repeats 1 --reference-spp 16";
        let events = folder.run(&format!("bench ./shot.toml --json {setting} --out ./bench")).events();
        let result = event(&events, "result");
        assert_eq!(result["exposure_ev"].to_string(), ev);
        assert_eq!(Ladder::read(&folder.path("bench/ladder.toml")).unwrap().origin().exposure_ev.to_string(), ev);
        let csv = folder.text("bench/bench.csv");
        assert!(csv.starts_with("size,exposure_ev,") && csv.contains(&format!("32x18,{ev},")), "{csv}");
        let origin = event(&events, "reference")["origin"].as_str().unwrap().to_owned();
        (["rmse", "flip", "psnr"].map(|name| result["rows"][0]["errors"]["left"][name].as_f64().unwrap()), origin)
    };
    let ([rmse, flip, psnr], _) = at("0.5");
    let ([dark_rmse, dark_flip, dark_psnr], origin) = at("-12.3");
    assert!(origin.contains("kept from an earlier run"), "{origin}");
    assert_eq!(dark_rmse, rmse);
    assert!(flip > 0.05 && dark_flip < 0.1 * flip && dark_psnr > psnr + 20.0, "{flip} {dark_flip}, {psnr} {dark_psnr}");
}

/// Returns the contents of all result files.
fn results(folder: &Folder) -> [String; 5] {
    ["bench.csv", "bench.svg", "frames.csv", "ladder.toml", "ladder.svg"]
        .map(|name| folder.text(&format!("bench/{name}")))
}

fn count(events: &[Value], name: &str) -> usize {
    events.iter().filter(|e| e["event"] == name).count()
}

#[test]
fn killed_bench_resumes_with_the_same_files() {
    let folder = Folder::new();
    let options = "--size 32x18 --quick --repeats 2 --reference-spp 32";
    let line = format!("bench builtin:cornell --json --out ./bench {options} --set fresh=on");
    let mut killed = folder.start(&line, Stdio::piped());
    let mut lines = BufReader::new(killed.stdout.take().unwrap()).lines();
    let first = lines.find_map(|l| Some(l.unwrap()).filter(|l| l.contains(r#""event":"setting""#))).unwrap();
    killed.kill().unwrap();
    killed.wait().unwrap();
    let first: Value = serde_json::from_str(&first).unwrap();
    assert!(!folder.path("bench/bench.csv").exists());
    let kept = folder.text("bench/bench.journal.jsonl").lines().count();
    let journal = folder.path("bench/bench.journal.jsonl");
    // A run that is killed may leave a truncated line.
    OpenOptions::new().append(true).open(&journal).unwrap().write_all(br#"{"subject":"#).unwrap();

    let events = bench(&folder, options);
    let rows = event(&events, "result")["rows"].as_array().unwrap();
    assert_eq!((rows.len(), count(&events, "setting"), count(&events, "turn")), (16, 16 - kept, 5));
    let [left, right] = ["left", "right"].map(|eye| rows[0]["errors"][eye]["flip_flicker"].as_f64().unwrap());
    assert_eq!(first["error"], (left + right) / 2.0);
    // Each turn times all settings, and its frames are in frames.csv.
    assert!(rows.iter().all(|r| r["frames"].as_array().unwrap().len() == 5));
    let frames = folder.text("bench/frames.csv");
    assert_eq!(frames.lines().count(), 1 + 16 * 5, "{frames}");
    let settings = |r: &Value| ["denoiser", "iterations", "bounces", "scale", "spp"].map(|name| r[name].to_string());
    let mut different: Vec<_> = rows.iter().map(settings).collect();
    different.sort();
    different.dedup();
    assert_eq!(different.len(), 16);

    let done = results(&folder);
    let events = bench(&folder, options);
    assert_eq!((count(&events, "setting"), count(&events, "frame")), (0, 0));
    assert_eq!(results(&folder), done);
    // A run that ends within a turn begins this turn again.
    let lines = folder.text("bench/bench.journal.jsonl");
    let before = lines.trim_end().rsplit_once('\n').unwrap().0.to_owned() + "\n";
    assert!(lines[before.len()..].contains("\"turn\""), "{lines}");
    folder.write("bench/bench.journal.jsonl", before);
    let events = bench(&folder, options);
    assert_eq!((count(&events, "setting"), count(&events, "turn")), (0, 1));
    // Fewer settings keep their turns, and further turns add to them.
    let events = bench(&folder, &format!("{options} --denoiser none --spp 1 --turns 6"));
    assert_eq!((count(&events, "setting"), count(&events, "turn")), (0, 1));
    folder.write("peers.toml", "[[peer]]\nname = 'a'\ntime_ms = 1.0\nflip = 0.1");
    let events = bench(&folder, &format!("{options} --report --set peers=./peers.toml --set time_limit=500"));
    assert_eq!(count(&events, "setting"), 0);

    // Different settings do not count as measured, and fresh ignores earlier results.
    for (more, measured) in [("--set seed=3 --bounces 6", 1), ("--set fresh=on", 2)] {
        let events = bench(&folder, &format!("{options} --spp 1 --denoiser none {more}"));
        assert_eq!(count(&events, "setting"), measured, "{more}");
    }
}

#[test]
fn ladder_holds_the_best_measured_settings() {
    let folder = Folder::new();
    let options = "--size 48x27 --quick --spp 1,8 --iterations 3 --reference-spp 64";
    let events = bench(&folder, options);
    let rows = event(&events, "result")["rows"].as_array().unwrap();
    let ladder = Ladder::read(&folder.path("bench/ladder.toml")).unwrap();
    let rungs = ladder.rungs();
    assert!(rungs.len() > 1, "{ladder:?}");
    assert!(rungs.windows(2).all(|p| p[0].time_ms < p[1].time_ms && p[0].error > p[1].error), "{ladder:?}");
    assert_eq!((ladder.origin().measure, ladder.denoisers().len()), (Measure::FlipFlicker, 1));
    assert_eq!((ladder.origin().shot.as_str(), ladder.origin().size.as_str()), ("builtin:cornell", "48x27"));
    for rung in rungs {
        let row = rows.iter().find(|r| r["time_ms"] == rung.time_ms).unwrap();
        let denoiser = Denoiser::name_of(rung.quality.denoiser());
        assert_eq!((&row["spp"], &row["denoiser"]), (&rung.quality.spp.least.into(), &denoiser.into()));
        for (name, found) in [("flip", rung.flip), ("flicker", rung.flicker), ("flip_flicker", Some(rung.error))] {
            let [left, right] = ["left", "right"].map(|eye| row["errors"][eye][name].as_f64().unwrap());
            assert!((found.unwrap() - (left + right) / 2.0).abs() < 1e-12, "{name}");
        }
        assert!((rung.error - rung.flip.unwrap() - rung.flicker.unwrap()).abs() < 1e-12);
        assert!(rung.stage_ms["path_trace"] > 0.0, "{rung:?}");
        assert_eq!(rung.stage_ms.contains_key("atrous"), denoiser == "atrous", "{rung:?}");
    }
    // Each denoiser has a ladder of its own, and one of them is the best; which one depends on the machine. Denoisers
    // that fit blocks are measured only on request.
    let others = [None, Some(Denoiser::ATROUS), Some(Denoiser::SVGF)].map(|denoiser| {
        let name = Denoiser::name_of(denoiser);
        let ladder = Ladder::read(&folder.path(&format!("bench/ladder.{name}.toml"))).unwrap();
        assert!(ladder.rungs().iter().all(|r| r.quality.denoiser() == denoiser), "{ladder:?}");
        ladder
    });
    assert!(others.contains(&ladder));
    // Independent noise in every frame flickers; light accumulated over frames hardly does.
    let flicker = |denoiser: &str| {
        let is = |r: &&Value| r["denoiser"] == denoiser && r["spp"] == 1 && r["bounces"] == 6 && r["scale"] == 1.0;
        rows.iter().find(is).unwrap()["errors"]["left"]["flicker"].as_f64().unwrap()
    };
    assert!(flicker("none") > 4.0 * flicker("svgf"), "{} and {}", flicker("none"), flicker("svgf"));
    let judge = || bench(&folder, &format!("{options} --ladder ./bench/ladder.toml"));
    let judged = judge();
    let regrets = event(&judged, "result")["regrets"].as_array().unwrap();
    assert_eq!((count(&judged, "setting"), regrets.len()), (0, rungs.len()));
    let error =
        |r: &Value| ["left", "right"].map(|eye| r["errors"][eye]["flip_flicker"].as_f64().unwrap()).iter().sum::<f64>();
    for (regret, rung) in regrets.iter().zip(rungs) {
        let no_longer = rows.iter().filter(|r| r["time_ms"].as_f64().unwrap() <= rung.time_ms * (1.0 + MIN_STEP));
        let best = no_longer.map(error).fold(f64::INFINITY, f64::min) / 2.0;
        assert!((regret["best_error"].as_f64().unwrap() - best).abs() < 1e-9, "{regret}: {best}");
    }
    // A ladder with only the worst setting has regret.
    let worst = rows.iter().max_by(|a, b| error(a).total_cmp(&error(b))).unwrap();
    let [spp, bounces, iterations] = ["spp", "bounces", "iterations"].map(|name| worst[name].as_u64().unwrap() as u32);
    let denoiser = Denoiser::from_name(worst["denoiser"].as_str().unwrap()).unwrap();
    let filter = denoiser.map(|denoiser| Filter::new(denoiser, iterations));
    let scale = worst["scale"].as_f64().unwrap();
    let quality = Quality { spp: spp.into(), bounces, filter, scale, ..Quality::default() };
    let alone = Ladder::new(ladder.origin().clone(), vec![Rung { quality, ..rungs[0].clone() }]).unwrap();
    alone.write(&folder.path("bench/ladder.toml")).unwrap();
    let judged = judge();
    let found = &event(&judged, "result")["regrets"][0];
    let [of_rung, best, regret] = ["error", "best_error", "regret"].map(|name| found[name].as_f64().unwrap());
    assert!((of_rung - error(worst) / 2.0).abs() < 1e-9 && (regret - (of_rung / best - 1.0)).abs() < 1e-9, "{found}");
    // Fewer bounces than the reference's lose some of its light.
    let ratio = |bounces: u32| {
        let is = |r: &&Value| r["denoiser"] == "none" && r["spp"] == 8 && r["bounces"] == bounces;
        rows.iter().find(is).unwrap()["errors"]["left"]["mean_ratio"].as_f64().unwrap()
    };
    assert!(ratio(2) < 0.97 * ratio(6), "{} and {}", ratio(2), ratio(6));
}

#[test]
fn rejects_missing_or_unfit_references() {
    let folder = Folder::new();
    folder.run("render builtin:cornell --size 16x8 --quiet --out ./small");
    let table = "
    --reference-images ./small => 16x8
    --reference-images /nowhere => left.exr
    ";
    folder.refuses(2, "bench builtin:cornell --size 32x18 --out ./bench", table);
}

/// Returns the folder of the reference that `bench` kept.
fn reference(folder: &Folder) -> String {
    let names = folder.names("bench/reference").into_iter().map(|name| format!("bench/reference/{name}"));
    let path = names.into_iter().find(|name| folder.path(name).is_dir()).unwrap();
    format!("./{path}")
}

/// Errors by kind of pixel are the same in `bench` and in `compare` of the same frame.
#[test]
fn errors_by_kind_of_pixel_have_columns_and_a_map() {
    let folder = Folder::new();
    let grid = "--size 48x32 --spp 1 --bounces 2 --denoiser svgf --iterations 5 --render-scale 1 --reference-spp 64";
    let events = bench(&folder, &format!("{grid} --set by_kind=on --report"));
    let errors = &event(&events, "result")["rows"][0]["errors"]["left"];
    let value = |name: &str| errors[name].as_f64().unwrap();
    let kinds = ["silhouette", "crease", "reflection", "texture", "light_edge", "rest"];
    let parts: f64 = kinds.iter().map(|kind| value(&format!("part_{kind}"))).sum();
    assert!((parts - 1.0).abs() < 1e-6, "{errors}");
    assert!(errors["flip_reflection"].is_null() && value("flip_silhouette") > value("flip_rest"), "{errors}");
    let csv = folder.text("bench/bench.csv");
    assert!(csv.lines().next().unwrap().contains("flip_silhouette") && csv.contains("part_rest"), "{csv}");
    assert!(folder.text("bench/report.html").contains("Errors by kind of pixel"));

    let aovs = "depth,normal,base_color,diffuse_albedo,specular_albedo,roughness";
    folder.run(&format!("render builtin:cornell --size 48x32 --bounces 2 --out ./frame --aov {aovs}"));
    let compare = format!("compare {} ./frame --by kind --maps ./maps", reference(&folder));
    let text = folder.run(&compare).out;
    assert!(text.contains("by kind of pixel, left eye") && text.contains("light_edge"), "{text}");
    assert_eq!(image::open(folder.path("maps/kind.png")).unwrap().into_rgb8().dimensions(), (96, 32));
    let json = folder.run(&format!("{compare} --json")).json();
    let found = json["left"]["by_kind"].as_array().unwrap();
    let pixels: f64 = found.iter().map(|kind| kind["pixels"].as_f64().unwrap()).sum();
    assert!((pixels - 1.0).abs() < 1e-9 && found[0]["kind"] == "silhouette", "{json}");
    assert_eq!(json["maps"], serde_json::json!(["error.png", "flip.png", "kind.png"]));
    assert!((0.02..0.4).contains(&found[0]["pixels"].as_f64().unwrap()), "{json}");

    std::fs::remove_file(folder.path("frame/right.depth.exr")).unwrap();
    folder.refuses(2, "", &format!("{compare} => right.depth.exr | {aovs}"));
}

/// Rivalry between the eyes is that of `compare`.
#[test]
fn rivalry_between_the_eyes_has_columns_and_maps() {
    let folder = Folder::new();
    let quality = "--size 48x32 --bounces 2 --denoiser atrous --iterations 5";
    let grid = "--spp 1 --render-scale 1 --reference-spp 64 --repeats 1 --warm-up 0 --report";
    let events = bench(&folder, &format!("{quality} {grid}"));
    let errors = &event(&events, "result")["rows"][0]["errors"];
    assert_eq!(errors["left"]["rivalry"], errors["right"]["rivalry"]);
    let csv = folder.text("bench/bench.csv");
    assert!(csv.lines().next().unwrap().contains(",rivalry,") && csv.contains("rivalry_seen"), "{csv}");
    assert!(folder.text("bench/report.html").contains("Rivalry between the eyes"));

    folder.run(&format!("render builtin:cornell {quality} --aov position,normal --out ./frame"));
    let found = folder.run(&format!("compare {} ./frame --json", reference(&folder))).json();
    for measure in ["rivalry", "rivalry_seen", "rivalry_mean", "rivalry_p99", "unmatched"] {
        let [a, b] = [&errors["left"][measure], &found[measure]].map(|value| value.as_f64().unwrap());
        // bench has a second frame, with other noise.
        assert!((a - b).abs() < 0.05 * b, "{measure}: {a} in bench, {b} in compare");
    }
}
