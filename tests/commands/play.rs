//! `play` tells all of every frame, drops quality when a device slows down and takes it back, and says what is wrong with
//! its options. Nothing here hangs on how fast the machine is: bands are wide, or follow from what it took before.

use std::path::Path;

use crate::common::diptych;
use diptych::report::play::SETTLING_FRAMES;
use serde_json::Value;

/// Plays a small sequence; returns the events and `run.json`.
fn play(out: &Path, options: &[&str]) -> (Vec<Value>, Value) {
    let args =
        ["play", "builtin:cornell", "--size", "48x32", "--json", "--fps", "1000", "--out", out.to_str().unwrap()];
    let output = diptych(&[&args, options].concat());
    assert!(output.status.success(), "{options:?}: {}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let events = text.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let run = std::fs::read_to_string(out.join("run.json")).unwrap();
    (events, serde_json::from_str(&run).unwrap())
}

/// Two rungs that are far apart, for `--ladder`.
const LADDER: &str = r#"
[origin]
shot = "builtin:cornell"
size = "48x32"
devices = ["any"]
version = "0"

[[rung]]
time_ms = 1.0
flip = 0.4
relmse = 0.4
knobs = { spp = 1, bounces = 1, denoiser = "atrous", iterations = 1, scale = 1.0 }

[[rung]]
time_ms = 10.0
flip = 0.1
relmse = 0.1
knobs = { spp = 16, bounces = 6, denoiser = "atrous", iterations = 3, scale = 1.0 }
"#;

#[test]
fn a_run_tells_all_of_every_frame() {
    let folder = tempfile::tempdir().unwrap();
    let (out, trace) = (folder.path().join("out"), folder.path().join("trace.json"));
    let traced = ["--trace", trace.to_str().unwrap(), "--disturb", "scene-cut@20", "--disturb", "slow:dev1@9..12"];
    let shape = ["--virtual", "2", "--budget-ms", "0.01..30000", "--frames", "40", "--save-every", "25"];
    let (events, run) = play(&out, &[&traced[..], &shape].concat());
    let told: Vec<&Value> = events.iter().filter(|e| e["event"] == "frame").collect();
    let rows = run["frames"].as_array().unwrap();
    assert_eq!((told.len(), rows.len()), (40, 40));
    let text = std::fs::read_to_string(out.join("ladder.toml")).unwrap();
    let ladder = ::diptych::control::Ladder::parse(&text).unwrap();
    // FLIP is estimated, of images at an exposure of its own; nothing is known of relMSE.
    assert!(ladder.rungs().iter().all(|r| r.relmse.is_none()) && text.contains("flip is estimated"), "{text}");
    assert_eq!(ladder.origin().exposure_ev, 0.0);
    for (i, (row, event)) in rows.iter().zip(told).enumerate() {
        let rung = &ladder.rungs()[row["rung"].as_u64().unwrap() as usize];
        let knobs = [("spp", rung.knobs.spp), ("bounces", rung.knobs.bounces), ("iterations", rung.knobs.iterations)];
        assert!(knobs.iter().all(|(name, value)| row[name] == *value && event[name] == *value), "{row}");
        for name in ["index", "rung", "makespan_ms", "expected_ms", "late_ms", "fits", "in_band"] {
            assert!(row[name] == event[name] && !row[name].is_null(), "frame {i}: {name} is {}", row[name]);
        }
        assert!(!row["predicted_ms"].is_null(), "{row}");
    }
    // Everything fits, so that the best rung is taken.
    assert_eq!(rows[39]["rung"], ladder.rungs().len() - 1);
    let sum = &run["play"];
    assert_eq!((&sum["in_band_share"], &sum["judged_frames"]), (&1.0.into(), &10.into()), "{sum}");
    assert!(sum["makespan_ms_p50"].as_f64() <= sum["makespan_ms_p99"].as_f64() && sum["longest_excursion"].is_null());
    for name in ["left.exr", "right.exr", "stereo.png", "left.0000.exr", "left.0025.exr"] {
        assert!(out.join(name).is_file(), "there is no {name}");
    }
    assert!(!out.join("left.0001.exr").exists());
    let trace = std::fs::read_to_string(&trace).unwrap();
    assert!(["budget_lo", "budget_hi", "rung"].iter().all(|name| trace.contains(name)));
}

#[test]
fn quality_falls_when_a_device_slows_down_and_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let ladder = folder.path().join("two.toml");
    std::fs::write(&ladder, LADDER).unwrap();
    let ladder = ["--ladder", ladder.to_str().unwrap()];
    let (_, free) =
        play(&folder.path().join("free"), &[&ladder[..], &["--budget-ms", "0.01..30000", "--frames", "20"]].concat());
    let median_ms = free["play"]["makespan_ms_p50"].as_f64().unwrap();
    assert!(free["frames"].as_array().unwrap().iter().all(|row| row["rung"] == 1));
    // Work takes 64 times as long where no frame may take more than 6 times what it took.
    let budget = format!("0.01..{}", 6.0 * median_ms);
    let slow = ["--disturb", "slow:dev0@30..50"].repeat(6);
    let (_, run) =
        play(&folder.path().join("slow"), &[&ladder[..], &slow, &["--budget-ms", &budget, "--frames", "110"]].concat());
    let rungs: Vec<u64> = run["frames"].as_array().unwrap().iter().map(|r| r["rung"].as_u64().unwrap()).collect();
    assert!(rungs[..30].contains(&1), "{rungs:?}");
    assert!(rungs[31..50].contains(&0), "{rungs:?}");
    assert!(rungs[50..].contains(&1), "{rungs:?}");
    assert_eq!(run["settings"]["denoiser"], "atrous");
    let is_in_band: Vec<bool> = run["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            let in_band = (0.01..=6.0 * median_ms).contains(&row["makespan_ms"].as_f64().unwrap());
            assert_eq!(row["in_band"], in_band, "{row}");
            in_band
        })
        .collect();
    let judged = &is_in_band[SETTLING_FRAMES..];
    let share = judged.iter().filter(|within| **within).count() as f64 / judged.len() as f64;
    assert!(share < 1.0, "64 times the work took no longer");
    assert_eq!((&run["play"]["in_band_share"], &run["play"]["judged_frames"]), (&share.into(), &judged.len().into()));
    let excursion = &run["play"]["longest_excursion"];
    let [from, frames] = ["first_frame", "frames"].map(|key| excursion[key].as_u64().unwrap() as usize);
    assert!(frames > 0 && is_in_band[from..from + frames].iter().all(|within| !within), "{excursion}");
}

#[test]
fn options_that_are_wrong_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let (none, two, falling) = (
        file("none.toml", "[origin]\nshot = 1\n"),
        file("two.toml", LADDER),
        file("falling.toml", &LADDER.replace("time_ms = 10.0", "time_ms = 0.5")),
    );
    let cases: [(&[&str], &str); 13] = [
        (&["--budget-ms", "20..11"], "give two times, 0 < LO < HI"),
        (&["--budget-ms", "20"], "write LO..HI"),
        (&["--budget-ms", "a..b"], "'a' is not a time"),
        (&["--ladder", "/nowhere/ladder.toml"], "cannot read the ladder"),
        (&["--ladder", &none], "is no ladder"),
        (&["--ladder", &falling], "rung 2"),
        (&["--ladder", &two, "--denoiser", "svgf"], "none of its 2 rungs is for --denoiser svgf"),
        (&["--disturb", "earthquake"], "write slow:devI@FROM..TO"),
        (&["--disturb", "slow:dev1@7..3"], "no frame from 7 up to 3"),
        (&["--disturb", "slow:dev5@1..3", "--frames", "9"], "there is no device 5"),
        (&["--disturb", "scene-cut@9", "--frames", "9"], "there is no frame 9"),
        (&["--iterations", "0"], "choose --denoiser none"),
        (&["--fps", "0"], "is not a rate"),
    ];
    for (options, reason) in cases {
        let out = folder.path().join("out");
        let to = ["play", "builtin:cornell", "--size", "32x18", "--out", out.to_str().unwrap()];
        let output = diptych(&[&to, options].concat());
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{options:?}: {text}");
        assert!(text.starts_with("error: ") && text.contains(reason), "{options:?}: {text}");
        assert!(!out.join("run.json").exists());
    }
}

#[cfg(not(feature = "view"))]
#[test]
fn without_its_window_view_says_how_to_build_it() {
    for options in [&["view"][..], &["view", "builtin:cornell", "--size", "96x64", "--nonsense"]] {
        let output = diptych(options);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.lines().count() == 1 && text.contains("--features view"), "{text}");
    }
    assert!(String::from_utf8_lossy(&diptych(&["--help"]).stdout).contains("view"));
}
