//! `play` reports every frame completely, lowers quality when a device slows down and raises it again, and explains
//! invalid options. The tests do not depend on the machine's speed: bands are wide, or derived from earlier times.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use crate::common::{diptych, program};
use diptych::quality::FrameQuality;
use diptych_cli::report::play::SETTLING_FRAMES;
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

/// Ladder of two very different rungs, for `--ladder`.
pub const LADDER: &str = r#"
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
fn play_reports_every_frame_completely() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let disturbed = ["--disturb", "scene-cut@20", "--disturb", "slow:dev1@9..12"];
    let shape = ["--virtual", "2", "--budget-ms", "0.01..30000", "--frames", "40", "--save-every", "25"];
    let (events, run) = play(&out, &[&disturbed[..], &shape].concat());
    let told: Vec<&Value> = events.iter().filter(|e| e["event"] == "frame").collect();
    let rows = run["frames"].as_array().unwrap();
    assert_eq!((told.len(), rows.len()), (40, 40));
    let text = std::fs::read_to_string(out.join("ladder.toml")).unwrap();
    let ladder = ::diptych::control::Ladder::parse(&text).unwrap();
    // Unmeasured values are absent or marked as estimates.
    assert!(ladder.rungs().iter().all(|r| r.is_estimated && r.relmse.or(r.flip).or(r.flicker).is_none()), "{text}");
    assert!(!text.contains("flip") && !text.contains("\ntime_ms"), "{text}");
    assert_eq!(text.matches("estimated = true").count(), ladder.rungs().len());
    for (i, (row, event)) in rows.iter().zip(told).enumerate() {
        let rung = &ladder.rungs()[row["rung"].as_u64().unwrap() as usize];
        let FrameQuality { spp, bounces, iterations, .. } = (&rung.quality).into();
        let numbers = [("spp", spp.least), ("bounces", bounces), ("iterations", iterations)];
        assert!(numbers.iter().all(|(name, value)| row[name] == *value && event[name] == *value), "{row}");
        for name in ["index", "rung", "makespan_ms", "expected_ms", "late_ms", "fits", "in_band"] {
            assert!(row[name] == event[name] && !row[name].is_null(), "frame {i}: {name} is {}", row[name]);
        }
        assert!(!row["predicted_ms"].is_null(), "{row}");
    }
    // Every rung fits, so the best one is chosen.
    assert_eq!(rows[39]["rung"], ladder.rungs().len() - 1);
    let sum = &run["play"];
    assert_eq!((&sum["denoiser"], &sum["measure"], &sum["fit"]), (&"svgf".into(), &"estimate".into(), &Value::Null));
    for rung in sum["rung_uses"].as_array().unwrap() {
        assert!(rung["estimated"] == true && rung["error"].is_null() && rung["denoiser"] == "svgf", "{rung}");
        let number = rung["rung"].as_u64().unwrap() as usize;
        assert_eq!(rung["estimated_error"], ladder.rungs()[number].error, "{rung}");
        let of_rung = rows.iter().filter(|row| row["rung"] == rung["rung"]);
        let expected: Vec<f64> = of_rung.map(|row| row["expected_ms"].as_f64().unwrap()).collect();
        let [least, most] = [f64::min, f64::max].map(|of| expected.iter().copied().reduce(of).unwrap());
        assert!((least..=most).contains(&rung["expected_ms"].as_f64().unwrap()), "{rung}: {expected:?}");
    }
    assert_eq!((&sum["in_band_share"], &sum["judged_frames"]), (&1.0.into(), &10.into()), "{sum}");
    let missed: u64 = rows[SETTLING_FRAMES..].iter().map(|row| row["missed_periods"].as_u64().unwrap()).sum();
    // Frames of 1 ms are not rendered at a thousand frames per second.
    assert!(missed > 0 && sum["missed_fraction"] == missed as f64 / (missed + 10) as f64, "{missed}: {sum}");
    assert!(sum["makespan_ms_p50"].as_f64() <= sum["makespan_ms_p99"].as_f64() && sum["longest_excursion"].is_null());
    for name in ["left.exr", "right.exr", "stereo.png", "left.0000.exr", "left.0025.exr"] {
        assert!(out.join(name).is_file(), "there is no {name}");
    }
    assert!(!out.join("left.0001.exr").exists());
}

#[test]
fn trace_has_the_budget_and_the_rung() {
    let folder = tempfile::tempdir().unwrap();
    let (ladder, trace) = (folder.path().join("ladder.toml"), folder.path().join("trace.json"));
    std::fs::write(&ladder, LADDER).unwrap();
    let files = ["--ladder", ladder.to_str().unwrap(), "--trace", trace.to_str().unwrap()];
    play(folder.path(), &[&files[..], &["--budget-ms", "0.01..30000", "--frames", "2"]].concat());
    let trace = std::fs::read_to_string(&trace).unwrap();
    assert!(["budget_lo", "budget_hi", "rung"].iter().all(|name| trace.contains(name)));
}

#[test]
fn quality_falls_while_a_device_is_slow() {
    let folder = tempfile::tempdir().unwrap();
    let ladder = folder.path().join("two.toml");
    std::fs::write(&ladder, LADDER).unwrap();
    let ladder = ["--ladder", ladder.to_str().unwrap()];
    let (_, free) =
        play(&folder.path().join("free"), &[&ladder[..], &["--budget-ms", "0.01..30000", "--frames", "12"]].concat());
    let median_ms = free["play"]["makespan_ms_p50"].as_f64().unwrap();
    assert!(free["frames"].as_array().unwrap().iter().all(|row| row["rung"] == 1));
    // Work takes 64 times as long, but no frame may take more than 6 times its earlier time.
    let budget = format!("0.01..{}", 6.0 * median_ms);
    let slow = ["--disturb", "slow:dev0@30..36"].repeat(6);
    let (_, run) =
        // The limit for hung devices is high enough for a device with 64 times the work on a busy machine.
        play(
            &folder.path().join("slow"),
            &[&ladder[..], &slow, &["--budget-ms", &budget, "--frames", "90", "--set", "watchdog_ms=600000"]].concat(),
        );
    let rungs: Vec<u64> = run["frames"].as_array().unwrap().iter().map(|r| r["rung"].as_u64().unwrap()).collect();
    assert!(rungs[..30].contains(&1), "{rungs:?}");
    assert!(rungs[31..36].contains(&0), "{rungs:?}");
    assert!(rungs[36..].contains(&1), "{rungs:?}");
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

/// A ladder may contain times of another machine, size or shot. Here the more expensive rung claims to take eleven
/// days, which no budget allows, but it fits.
#[test]
fn play_ignores_the_times_of_its_ladder() {
    let folder = tempfile::tempdir().unwrap();
    let ladder = folder.path().join("slow.toml");
    std::fs::write(&ladder, LADDER.replace("time_ms = 10.0", "time_ms = 1e9")).unwrap();
    let (_, run) =
        play(folder.path(), &["--ladder", ladder.to_str().unwrap(), "--budget-ms", "0.01..30000", "--frames", "4"]);
    let rungs: Vec<u64> = run["frames"].as_array().unwrap().iter().map(|r| r["rung"].as_u64().unwrap()).collect();
    assert_eq!(rungs, [1; 4]);
}

#[test]
fn a_hung_device_costs_a_second_and_a_slow_one_stays() {
    let folder = tempfile::tempdir().unwrap();
    let devices = ["--virtual", "3", "--disturb", "hang:dev1@frame12", "--disturb", "slow:dev2@18..28"];
    let (_, run) = play(folder.path(), &[&devices[..], &["--budget-ms", "0.01..60", "--frames", "32"]].concat());
    let rows = run["frames"].as_array().unwrap();
    let ms = |row: &Value| row["makespan_ms"].as_f64().unwrap();
    let faults = run["faults"].as_array().unwrap();
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert_eq!(
        (&faults[0]["frame"], &faults[0]["device"], &faults[0]["kind"]),
        (&12.into(), &1.into(), &"hang".into())
    );
    assert_eq!(faults[0]["recovery_ms"], rows[12]["makespan_ms"]);
    // On a busy machine frames are slower, and the limits scale with them.
    let slowest_ms = rows[..12].iter().map(ms).fold(0.0, f64::max);
    let (allowed_ms, scheduling_ms) = ((10.0 * slowest_ms).max(1000.0), 300.0);
    assert!(ms(&rows[12]) < allowed_ms + scheduling_ms, "{} ms after {slowest_ms} ms", ms(&rows[12]));
    assert!(rows[13..].iter().all(|row| row["devices"] == 2 && ms(row) < allowed_ms), "{run}");
}

/// Returns the names of the files in a folder that are not pictures.
fn names(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| !name.contains(".exr") && !name.contains(".png")).collect();
    names.sort();
    names
}

#[test]
fn a_killed_run_leaves_every_finished_frame_and_the_next_one_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let motion = out.join("head.jsonl");
    let mut run = program(&["play", "builtin:cornell", "--size", "48x32", "--json", "--fps", "1000"])
        .args(["--budget-ms", "0.01..30000"])
        .args(["--frames", "1000000", "--record-motion", motion.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // A frame event means that the frame is in the files.
    let events = BufReader::new(run.stdout.take().unwrap()).lines().map(Result::unwrap);
    let told = events.filter(|event| event.contains("\"event\":\"frame\"")).take(12).count();
    run.kill().unwrap();
    run.wait().unwrap();
    assert_eq!(told, 12);
    assert_eq!(names(out), ["frames.csv", "head.jsonl.part", "run.json.rows.part"]);
    let whole = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(out.join(name)).unwrap();
        text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n')).map(str::to_owned).collect()
    };
    let (lines, rows) = (whole("frames.csv"), whole("run.json.rows.part"));
    assert!(lines.len() > 12 && rows.len() >= lines.len() - 1 && whole("head.jsonl.part").len() > 12, "{lines:?}");
    assert!(
        lines[0].starts_with("frame,time_s,devices,makespan_ms,") && lines[0].ends_with(",missed_periods,rows_dev0")
    );
    for (i, (line, row)) in lines[1..].iter().zip(&rows).enumerate() {
        let row: Value = serde_json::from_str(row).unwrap();
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells.len(), cells[0], &row["index"]), (29, i.to_string().as_str(), &i.into()), "{line}");
        assert_eq!(cells[28], "32");
        assert_eq!(cells[3], format!("{:.4}", row["makespan_ms"].as_f64().unwrap()));
    }

    let again = ["--size", "48x32", "--frames", "3", "--budget-ms", "0.01..30000"];
    let recorded = [&again[..], &["--record-motion", motion.to_str().unwrap()]].concat();
    let (_, stderr, next) = says(out, &recorded);
    let said = format!("did not finish: its {} frame(s) are kept in run.unfinished.jsonl and frames.unf", rows.len());
    assert!(stderr.contains(&said) && stderr.contains("head.unfinished.jsonl"), "{said}: {stderr}");
    assert_eq!(next["frames"].as_array().unwrap().len(), 3);
    assert_eq!(whole("frames.csv").len(), 4);
    assert_eq!(whole("run.unfinished.jsonl"), rows);
    assert_eq!(whole("frames.unfinished.csv")[..lines.len()], lines);
    let kept = ["frames.unfinished.csv", "head.unfinished.jsonl", "run.unfinished.jsonl"];
    let all = ["frames.csv", kept[0], "head.jsonl", kept[1], "ladder.toml", "run.json", kept[2]];
    assert_eq!(names(out), all);
    // The last run finished, so there is no warning.
    let (_, stderr, _) = says(out, &again);
    assert!(!stderr.contains("did not finish") && names(out) == all, "{stderr}");
}

/// Plays into `out`; returns standard output, standard error and `run.json`.
pub fn says(out: &Path, options: &[&str]) -> (String, String, Value) {
    let args = ["play", "builtin:cornell", "--fps", "1000", "--out", out.to_str().unwrap()];
    let output = diptych(&[&args, options].concat());
    let [stdout, stderr] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
    assert!(output.status.success(), "{options:?}: {stderr}");
    let run = std::fs::read_to_string(out.join("run.json")).unwrap();
    (stdout, stderr, serde_json::from_str(&run).unwrap())
}

#[test]
fn play_uses_the_rungs_of_one_denoiser() {
    let folder = tempfile::tempdir().unwrap();
    let mixed = folder.path().join("mixed.toml");
    let third = "[[rung]]\ntime_ms = 20.0\nflip = 0.05\n\
        knobs = { spp = 2, bounces = 2, denoiser = \"none\", iterations = 0, scale = 1.0 }\n";
    std::fs::write(&mixed, format!("{LADDER}{third}")).unwrap();
    let options =
        ["--size", "48x32", "--frames", "6", "--budget-ms", "0.01..30000", "--ladder", mixed.to_str().unwrap()];
    let (stdout, stderr, run) = says(&folder.path().join("most"), &options);
    assert!(stderr.contains("2 of atrous, 1 of none: those of atrous are played"), "{stderr}");
    let table = stdout.lines().skip_while(|l| !l.starts_with("rung ")).take(3).collect::<Vec<_>>();
    let columns: Vec<&str> = table[0].split("  ").map(str::trim).filter(|c| !c.is_empty()).collect();
    let expected = [
        "rung",
        "spp",
        "bounces",
        "denoiser",
        "iterations",
        "scale",
        "layers",
        "expected ms",
        "FLIP",
        "which is",
        "frames",
    ];
    assert_eq!(columns, expected, "{stdout}");
    let cells: Vec<&str> = table[2].split_whitespace().collect();
    assert_eq!(cells[..7], ["1", "16", "6", "atrous", "3", "1", "none"], "{stdout}");
    assert_eq!(cells[8..], ["0.1000", "measured", "100.0", "%"], "{stdout}");
    assert!(
        stdout.contains("48x32, denoiser atrous, 2 rungs") && stdout.contains("(FLIP measured on builtin:cornell"),
        "{stdout}"
    );
    assert_eq!((&run["play"]["rung_uses"][0]["error"], &run["play"]["denoiser"]), (&0.1.into(), &"atrous".into()));

    // With fewer iterations, the measured error does not apply.
    let fewer = [&options[..], &["--denoiser", "atrous", "--iterations", "1"]].concat();
    let (_, stderr, run) = says(&folder.path().join("fewer"), &fewer);
    assert!(!stderr.contains("several denoisers"), "{stderr}");
    let rung = &run["play"]["rung_uses"][0];
    assert_eq!(
        (&rung["estimated"], &rung["estimated_error"], &rung["iterations"]),
        (&true.into(), &0.1.into(), &1.into())
    );
}

#[test]
fn rejects_invalid_options() {
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
    let cases: [(&[&str], &str); 14] = [
        (&["--budget-ms", "20..11"], "give two times, 0 < LO < HI"),
        (&["--budget-ms", "20"], "write LO..HI"),
        (&["--budget-ms", "a..b"], "'a' is not a time"),
        (&["--ladder", "/nowhere/ladder.toml"], "cannot read the ladder"),
        (&["--ladder", &none], "is not a quality ladder"),
        (&["--ladder", &falling], "rung 2"),
        (&["--ladder", &two, "--denoiser", "svgf"], "none of its 2 rungs uses --denoiser svgf"),
        (&["--disturb", "earthquake"], "slow:devI@FROM..TO, or scene-cut@FRAME"),
        (&["--disturb", "slow:dev1@7..3"], "the frame range 7..3 is empty"),
        (&["--disturb", "slow:dev5@1..3", "--frames", "9"], "there is no device 5"),
        (&["--disturb", "scene-cut@9", "--frames", "9"], "there is no frame 9"),
        (&["--iterations", "0"], "choose --denoiser none"),
        (&["--denoiser", "none", "--iterations", "3"], "iterations has no effect"),
        (&["--fps", "0"], "fps cannot be 0"),
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
fn rejects_view_without_its_feature() {
    for options in [&["view"][..], &["view", "builtin:cornell", "--size", "96x64", "--nonsense"]] {
        let output = diptych(options);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.lines().count() == 1 && text.contains("--features view"), "{text}");
    }
    assert!(String::from_utf8_lossy(&diptych(&["--help"]).stdout).contains("view"));
}

/// Runs `diptych play` and returns its standard error.
fn refused(options: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let output = diptych(&[&["play", "builtin:cornell", "--out", folder.path().to_str().unwrap()], options].concat());
    assert_eq!(output.status.code(), Some(2), "{options:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn replay_repeats_rungs_and_bytes_of_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let [out, again] = ["out", "again"].map(|name| folder.path().join(name));
    let cut = ["--disturb", "scene-cut@7", "--disturb", "slow:dev0@4..9"];
    let (_, run) = play(&out, &[&["--budget-ms", "4..12", "--frames", "14", "--save-every", "5"], &cut[..]].concat());
    let path = out.join("run.json");
    let recorded = ["--replay", path.to_str().unwrap(), "--save-every", "5"];
    let arguments = ["play", "builtin:cornell", "--size", "48x32", "--quiet", "--virtual", "2"];
    let output = diptych(&[&arguments, &recorded[..], &["--out", again.to_str().unwrap()]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let replayed: Value = serde_json::from_str(&std::fs::read_to_string(again.join("run.json")).unwrap()).unwrap();
    let rungs = |run: &Value| -> Vec<u64> {
        run["frames"].as_array().unwrap().iter().map(|row| row["rung"].as_u64().unwrap()).collect()
    };
    assert_eq!(rungs(&run), rungs(&replayed));
    assert!(replayed["frames"].as_array().unwrap().iter().all(|row| row["devices"] == 2));
    for name in ["left.0005.exr", "right.0010.exr", "left.exr", "right.exr"] {
        let [then, now] = [&out, &again].map(|folder| std::fs::read(folder.join(name)).unwrap());
        assert!(then == now, "{name}");
    }
    let other = refused(&[&["--size", "48x32", "--set", "seed=3"], &recorded[..]].concat());
    assert!(other.contains("seed=0, not 3"), "{other}");
    for (options, conflict) in
        [(&recorded[..2], "controller=pid"), (&recorded[..2], "fps=10"), (&["--report"], "controller=pid,pinned:0")]
    {
        let text = refused(&[options, &["--set", conflict]].concat());
        let parts = [options[0], conflict.split('=').next().unwrap()];
        assert!(text.contains("exclude each other") && parts.iter().all(|part| text.contains(part)), "{text}");
    }
    let none = refused(&["--replay", folder.path().to_str().unwrap()]);
    assert!(none.contains("cannot use --replay"), "{none}");
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn play_compares_controllers_in_turns() {
    let folder = tempfile::tempdir().unwrap();
    let (out, ladder) = (folder.path().join("out"), folder.path().join("ladder.toml"));
    std::fs::write(&ladder, LADDER).unwrap();
    let frames = SETTLING_FRAMES + 9;
    let output =
        diptych(
            &[
                &[
                    "play",
                    "builtin:cornell",
                    "--size",
                    "48x32",
                    "--json",
                    "--fps",
                    "1000",
                    "--budget-ms",
                    "0.01..30000",
                ][..],
                &["--set", "controller=pinned:0,pinned:1", "--set", "runs=2", "--set", "report_spp=64"],
                &["--disturb", "slow:dev0@3"],
                &[
                    "--ladder",
                    ladder.to_str().unwrap(),
                    "--frames",
                    &frames.to_string(),
                    "--out",
                    out.to_str().unwrap(),
                ],
            ]
            .concat(),
        );
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let last = String::from_utf8(output.stdout).unwrap();
    let result: Value = serde_json::from_str(last.lines().last().unwrap()).unwrap();
    let runs = result["runs"].as_array().unwrap();
    let names: Vec<&str> = runs.iter().map(|run| run["controller"].as_str().unwrap()).collect();
    assert_eq!(names, ["pinned:0", "pinned:1", "pinned:0", "pinned:1"]);
    let flip = |i: usize| runs[i]["flip"].as_f64().unwrap();
    // 16 samples are better than one, and each run of a rung has the same images.
    assert!(0.0 < flip(1) && flip(1) < 0.7 * flip(0), "{result}");
    assert_eq!([flip(0), flip(1)], [flip(2), flip(3)]);
    let table = std::fs::read_to_string(out.join("comparison.csv")).unwrap();
    assert_eq!(table.lines().count(), 5, "{table}");
    assert!(std::fs::read_to_string(out.join("comparison.svg")).unwrap().contains("pinned rungs"));
    let recovery = std::fs::read_to_string(out.join("recovery.svg")).unwrap();
    assert!(recovery.contains("pinned:1") && recovery.contains("frames since the disturbance"));
    let run = std::fs::read_to_string(out.join("pinned-1.0/run.json")).unwrap();
    let run: Value = serde_json::from_str(&run).unwrap();
    assert_eq!((run["frames"].as_array().unwrap().len(), &run["settings"]["controller"]), (frames, &"pinned:1".into()));
    let alone = refused(&["--set", "report_spp=8"]);
    assert!(alone.contains("--report, or several controllers"), "{alone}");
}
