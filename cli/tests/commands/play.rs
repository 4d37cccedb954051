//! `play` reports every frame completely, lowers quality when a device slows down and raises it again, and names a size
//! that fits its budget. The tests do not depend on the machine's speed: bands are wide, or derived from earlier times.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use crate::common::{Folder, Said, Share};
use diptych::quality::FrameQuality;
use diptych_cli::report::play::SETTLING_FRAMES;
use serde_json::Value;

/// Plays the box into this folder; returns the output and `run.json`.
fn play(folder: &Folder, out: &str, options: &str) -> (Said, Value) {
    let said = folder.run(&format!("play builtin:cornell --fps 1000 --out ./{out} {options}"));
    (said, folder.json(&format!("{out}/run.json")))
}

/// Size and budget of a small sequence, which every rung fits.
pub const SMALL: &str = "--size 48x32 --budget-ms 0.01..30000";

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
    let folder = Folder::new();
    let shape = "--json --virtual 2 --frames 40 --save-every 25 --disturb scene-cut@20 --disturb slow:dev1@9..12";
    let (said, run) = play(&folder, "out", &format!("{SMALL} {shape}"));
    let (events, out) = (said.events(), folder.path("out"));
    let told: Vec<&Value> = events.iter().filter(|e| e["event"] == "frame").collect();
    let rows = run["frames"].as_array().unwrap();
    assert_eq!((told.len(), rows.len()), (40, 40));
    let text = folder.text("out/ladder.toml");
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
    let folder = Folder::new();
    folder.write("two.toml", LADDER);
    play(&folder, "out", &format!("{SMALL} --ladder ./two.toml --trace ./trace.json --frames 2"));
    let trace = folder.text("trace.json");
    assert!(["budget_lo", "budget_hi", "rung"].iter().all(|name| trace.contains(name)));
}

#[test]
fn quality_falls_while_a_device_is_slow() {
    let folder = Folder::new();
    folder.write("two.toml", LADDER);
    let (_, free) = play(&folder, "free", &format!("{SMALL} --ladder ./two.toml --frames 12"));
    let median_ms = free["play"]["makespan_ms_p50"].as_f64().unwrap();
    assert!(free["frames"].as_array().unwrap().iter().all(|row| row["rung"] == 1));
    // Work takes 64 times as long, but no frame may take more than 6 times its earlier time.
    let budget = format!("0.01..{}", 6.0 * median_ms);
    let slow = "--disturb slow:dev0@30..36 ".repeat(6);
    // The limit for hung devices is high enough for a device with 64 times the work on a busy machine.
    let limits = format!("--size 48x32 --budget-ms {budget} --frames 90 --set watchdog_ms=600000");
    let (_, run) = play(&folder, "slow", &format!("{slow} --ladder ./two.toml {limits}"));
    let rungs = rungs(&run);
    assert!(rungs[..30].contains(&1), "{rungs:?}");
    assert!(rungs[31..36].contains(&0), "{rungs:?}");
    assert!(rungs[36..].contains(&1), "{rungs:?}");
    assert_eq!(run["settings"]["denoiser"], "atrous");
    let is_in_band = run["frames"].as_array().unwrap().iter().map(|row| {
        let in_band = (0.01..=6.0 * median_ms).contains(&row["makespan_ms"].as_f64().unwrap());
        assert_eq!(row["in_band"], in_band, "{row}");
        in_band
    });
    let is_in_band: Vec<bool> = is_in_band.collect();
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
    let folder = Folder::new();
    folder.write("slow.toml", LADDER.replace("time_ms = 10.0", "time_ms = 1e9"));
    let (_, run) = play(&folder, "out", &format!("{SMALL} --ladder ./slow.toml --frames 4"));
    assert_eq!(rungs(&run), [1; 4]);
}

fn rungs(run: &Value) -> Vec<u64> {
    run["frames"].as_array().unwrap().iter().map(|row| row["rung"].as_u64().unwrap()).collect()
}

#[test]
fn play_drops_hung_devices_and_keeps_slow_ones() {
    let devices = "--virtual 3 --disturb hang:dev1@frame12 --disturb slow:dev2@18..28";
    let options = format!("{devices} --size 48x32 --budget-ms 0.01..60 --frames 32");
    let (_, run) = play(&Folder::new(), "out", &options);
    let rows = run["frames"].as_array().unwrap();
    let ms = |row: &Value| row["makespan_ms"].as_f64().unwrap();
    let [fault] = &run["faults"].as_array().unwrap()[..] else { panic!("{}", run["faults"]) };
    assert_eq!((&fault["frame"], &fault["device"], &fault["kind"]), (&12.into(), &1.into(), &"hang".into()));
    assert_eq!(fault["recovery_ms"], rows[12]["makespan_ms"]);
    // On a busy machine frames are slower, and the limits scale with them.
    let slowest_ms = rows[..12].iter().map(ms).fold(0.0, f64::max);
    let (allowed_ms, scheduling_ms) = ((10.0 * slowest_ms).max(1000.0), 300.0);
    assert!(ms(&rows[12]) < allowed_ms + scheduling_ms, "{} ms after {slowest_ms} ms", ms(&rows[12]));
    assert!(rows[13..].iter().all(|row| row["devices"] == 2 && ms(row) < allowed_ms), "{run}");
}

#[test]
fn killed_play_keeps_its_finished_frames() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("out")).unwrap();
    let recorded = "--record-motion ./out/head.jsonl --out ./out";
    let line = format!("play builtin:cornell {SMALL} --json --fps 1000 --frames 1000000 {recorded}");
    let mut run = folder.start(&line, Stdio::piped());
    // A frame event means that the frame is in the files.
    let events = BufReader::new(run.stdout.take().unwrap()).lines().map(Result::unwrap);
    let told = events.filter(|event| event.contains("\"event\":\"frame\"")).take(12).count();
    run.kill().unwrap();
    run.wait().unwrap();
    assert_eq!(told, 12);
    let names = || {
        let is_picture = |name: &String| name.contains(".exr") || name.contains(".png");
        folder.names("out").into_iter().filter(|name| !is_picture(name)).collect::<Vec<_>>()
    };
    assert_eq!(names(), ["frames.csv", "head.jsonl.part", "run.json.rows.part"]);
    let whole = |name: &str| -> Vec<String> {
        let text = folder.text(&format!("out/{name}"));
        text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n')).map(str::to_owned).collect()
    };
    let (lines, rows) = (whole("frames.csv"), whole("run.json.rows.part"));
    assert!(lines.len() > 12 && rows.len() >= lines.len() - 1 && whole("head.jsonl.part").len() > 12, "{lines:?}");
    let [begin, end] = ["frame,time_s,devices,makespan_ms,", ",over_deadline_ms,cause,others_share"];
    assert!(lines[0].starts_with(begin) && lines[0].ends_with(end), "{}", lines[0]);
    for (i, (line, row)) in lines[1..].iter().zip(&rows).enumerate() {
        let row: Value = serde_json::from_str(row).unwrap();
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells.len(), cells[0], &row["index"]), (35, i.to_string().as_str(), &i.into()), "{line}");
        assert_eq!(cells[28], "32");
        assert_eq!(cells[3], format!("{:.4}", row["makespan_ms"].as_f64().unwrap()));
    }

    let again = format!("{SMALL} --frames 3");
    let (Said { errors, .. }, next) = play(&folder, "out", &format!("{again} --record-motion ./out/head.jsonl"));
    let said = format!("did not finish: its {} frame(s) are kept in run.unfinished.jsonl and frames.unf", rows.len());
    assert!(errors.contains(&said) && errors.contains("head.unfinished.jsonl"), "{said}: {errors}");
    assert_eq!(next["frames"].as_array().unwrap().len(), 3);
    assert_eq!(whole("frames.csv").len(), 4);
    assert_eq!(whole("run.unfinished.jsonl"), rows);
    assert_eq!(whole("frames.unfinished.csv")[..lines.len()], lines);
    let kept = ["frames.unfinished.csv", "head.unfinished.jsonl", "run.unfinished.jsonl"];
    let all = ["frames.csv", kept[0], "head.jsonl", kept[1], "ladder.toml", "run.json", kept[2]];
    assert_eq!(names(), all);
    // The last run finished, so there is no warning.
    let (Said { errors, .. }, _) = play(&folder, "out", &again);
    assert!(!errors.contains("did not finish") && names() == all, "{errors}");
}

#[test]
fn play_uses_the_rungs_of_one_denoiser() {
    let folder = Folder::new();
    let third = "[[rung]]\ntime_ms = 20.0\nflip = 0.05\n\
        knobs = { spp = 2, bounces = 2, denoiser = \"none\", iterations = 0, scale = 1.0 }\n";
    folder.write("mixed.toml", format!("{LADDER}{third}"));
    let options = format!("{SMALL} --frames 6 --ladder ./mixed.toml");
    let (Said { out, errors, .. }, run) = play(&folder, "most", &options);
    assert!(errors.contains("2 of atrous, 1 of none: those of atrous are played"), "{errors}");
    let table = out.lines().skip_while(|l| !l.starts_with("rung ")).take(3).collect::<Vec<_>>();
    let columns: Vec<&str> = table[0].split("  ").map(str::trim).filter(|c| !c.is_empty()).collect();
    let expected = "rung, spp, bounces, denoiser, iterations, scale, layers, expected ms, FLIP, which is, frames";
    assert_eq!(columns.join(", "), expected, "{out}");
    let cells: Vec<&str> = table[2].split_whitespace().collect();
    assert_eq!(cells[..7], ["1", "16", "6", "atrous", "3", "1", "none"], "{out}");
    assert_eq!(cells[8..], ["0.1000", "measured", "100.0", "%"], "{out}");
    for part in ["48x32, denoiser atrous, 2 rungs", "(FLIP measured on builtin:cornell"] {
        assert!(out.contains(part), "no {part}: {out}");
    }
    assert_eq!((&run["play"]["rung_uses"][0]["error"], &run["play"]["denoiser"]), (&0.1.into(), &"atrous".into()));

    // With fewer iterations, the measured error does not apply.
    let (Said { errors, .. }, run) = play(&folder, "fewer", &format!("{options} --denoiser atrous --iterations 1"));
    assert!(!errors.contains("several denoisers"), "{errors}");
    let rung = &run["play"]["rung_uses"][0];
    let found = serde_json::json!([rung["estimated"], rung["estimated_error"], rung["iterations"]]);
    assert_eq!(found, serde_json::json!([true, 0.1, 1]));
}

#[test]
fn replay_repeats_rungs_and_bytes_of_a_run() {
    let folder = Folder::new();
    let disturbed = "--disturb scene-cut@7 --disturb slow:dev0@4..9";
    let options = format!("--size 48x32 --budget-ms 4..12 --frames 14 --save-every 5 {disturbed}");
    let (_, mut run) = play(&folder, "out", &options);
    // Earlier versions wrote null for no motion.
    run["settings"]["motion"] = Value::Null;
    folder.write("out/run.json", run.to_string());
    let recorded = "--replay ./out/run.json --save-every 5";
    folder.run(&format!("play builtin:cornell --size 48x32 --quiet --virtual 2 {recorded} --out ./again"));
    let replayed = folder.json("again/run.json");
    assert_eq!(rungs(&run), rungs(&replayed));
    assert!(replayed["frames"].as_array().unwrap().iter().all(|row| row["devices"] == 2));
    for name in ["left.0005.exr", "right.0010.exr", "left.exr", "right.exr"] {
        let [then, now] = ["out", "again"].map(|out| folder.bytes(&format!("{out}/{name}")));
        assert!(then == now, "{name}");
    }
    let table = "
    --size 48x32 --set seed=3 --save-every 5 => seed=0, not 3
    --set controller=pid => exclude each other | --replay | controller
    --set fps=10 => exclude each other | --replay | fps
    ";
    folder.refuses(2, "play builtin:cornell --out ./refused --replay ./out/run.json", table);
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn play_compares_controllers_in_turns() {
    let folder = Folder::new();
    folder.write("two.toml", LADDER);
    let frames = SETTLING_FRAMES + 9;
    let turns = "--set controller=pinned:0,pinned:1 --set runs=2 --set report_spp=64 --disturb slow:dev0@3";
    let line = format!("play builtin:cornell {SMALL} --json --fps 1000 {turns} --ladder ./two.toml");
    let result = folder.run(&format!("{line} --frames {frames} --out ./out")).json();
    let runs = result["runs"].as_array().unwrap();
    let names: Vec<&str> = runs.iter().map(|run| run["controller"].as_str().unwrap()).collect();
    assert_eq!(names, ["pinned:0", "pinned:1", "pinned:0", "pinned:1"]);
    let flip = |i: usize| runs[i]["flip"].as_f64().unwrap();
    // 16 samples are better than one, and each run of a rung has the same images.
    assert!(0.0 < flip(1) && flip(1) < 0.7 * flip(0), "{result}");
    assert_eq!([flip(0), flip(1)], [flip(2), flip(3)]);
    let table = folder.text("out/comparison.csv");
    assert_eq!(table.lines().count(), 5, "{table}");
    assert!(folder.text("out/comparison.svg").contains("pinned rungs"));
    let recovery = folder.text("out/recovery.svg");
    assert!(recovery.contains("pinned:1") && recovery.contains("frames since the disturbance"));
    let run = folder.json("out/pinned-1.0/run.json");
    assert_eq!((run["frames"].as_array().unwrap().len(), &run["settings"]["controller"]), (frames, &"pinned:1".into()));
}

/// Returns a folder with a ladder of one rung.
pub fn one_rung() -> Folder {
    let folder = Folder::new();
    folder.write("one.toml", LADDER.split_inclusive("\n\n").take(2).collect::<String>());
    folder
}

#[test]
fn play_names_a_size_that_fits_and_fit_takes_it() {
    let folder = one_rung();
    let play = |out: &str, options: &str| {
        let (Said { out, errors, .. }, run) =
            play(&folder, out, &format!("--size 480x320 --ladder ./one.toml {options}"));
        (out, errors, run)
    };
    let (_, errors, free) = play("free", "--budget-ms 0.01..30000 --frames 5 --fit");
    assert!(!errors.contains("fit") && free["play"]["fit"].is_null(), "{errors}");
    // The budget is a sixth of the time, which leaves room for other load on the machine.
    let median_ms = free["play"]["makespan_ms_p50"].as_f64().unwrap();
    let budget = format!("--budget-ms {}..{} --frames 3", median_ms / 10.0, median_ms / 6.0);

    let (_, errors, asked) = play("asked", &budget);
    let fit = &asked["play"]["fit"];
    let fitting = fit["fitting_size"].as_str().unwrap();
    assert_eq!([&fit["asked_size"], &fit["played_size"], &asked["settings"]["size"]], ["480x320"; 3]);
    let (width, height) = fitting.split_once('x').unwrap();
    let [width, height] = [width, height].map(|n| n.parse::<u32>().unwrap());
    assert!(width < 480 && width * 2 == height * 3, "{fitting}");
    assert!(fit["fitting_ms"].as_f64().unwrap() < median_ms / 6.0, "{fit}");
    let advice = format!("--size {fitting} should fit; --fit takes it");
    for part in ["at 480x320 the cheapest rung takes", &advice, "3 frames will take"] {
        assert!(errors.contains(part), "{part}: {errors}");
    }

    let (out, errors, taken) = play("taken", &format!("{budget} --fit"));
    let fit = &taken["play"]["fit"];
    let played = fit["played_size"].as_str().unwrap();
    assert_eq!((&fit["asked_size"], &fit["fitting_size"]), (&"480x320".into(), &played.into()));
    assert!(played != "480x320" && taken["settings"]["size"] == played, "{fit}");
    assert!(out.contains(&format!("playing at {played} instead")) && !errors.contains("will take"), "{out}");
    assert!(out.contains(&format!("{played}, denoiser atrous, 1 rung of ")), "{out}");
    let image = ::diptych::image::exr::read_rgb(&folder.path("taken/left.exr")).unwrap();
    assert_eq!(image.extent.to_string(), played);
}

#[test]
fn play_stops_if_nothing_fits_unless_it_keeps_going() {
    let folder = one_rung();
    // No machine renders a frame in 2 microseconds.
    let run = |options: &str| {
        let fixed = "play builtin:cornell --size 48x32 --ladder ./one.toml --budget-ms 0.001..0.002";
        let Said { status, errors, .. } =
            folder.try_run(&format!("{fixed} --fps 1000 --quiet --out ./out --frames {options}"));
        (status, folder.json("out/run.json")["frames"].as_array().unwrap().len(), errors)
    };
    let (status, frames, errors) = run("90");
    assert_eq!((status, frames), (Some(1), 30), "{errors}");
    let error = errors.lines().last().unwrap();
    assert!(error.starts_with("error: nothing fits the budget of 0.001 to 0.002 ms at 48x32: each of the"), "{errors}");
    assert!(error.ends_with("raise --budget-ms, or --set keep_going=on to play on"), "{errors}");
    assert!(folder.path("out/left.exr").is_file() && !folder.path("out/run.json.rows.part").exists());
    for (frames, options) in [(31, "31 --set keep_going=on"), (30, "30"), (31, "31 --disturb slow:dev0@3")] {
        let (status, played, errors) = run(options);
        assert_eq!((status, played), (Some(0), frames), "{options}: {errors}");
    }
}

/// The time of other programs is read before the preparations, before the frames, for both frames and after them.
#[test]
fn play_tells_once_that_others_are_busy() {
    let cases: [(Share, f64, &str); 4] = [
        (|_| 0.04, 0.04, ""),
        (|_| 0.4, 0.4, "other programs take 40 % of the cores"),
        (|reading| if reading >= 2 { 0.3 } else { 0.0 }, 0.3, "other programs took 30 % of the cores"),
        (|reading| if reading == 1 { 0.2 } else { 0.0 }, 0.0, "other programs take 20 % of the cores"),
    ];
    for (share, of_frames, expected) in cases {
        let folder = Folder::new();
        let said = folder.run_beside(share, &format!("play builtin:cornell {SMALL} --fps 1000 --frames 2 --out ./"));
        let warnings: Vec<&str> = said.errors.lines().filter(|line| line.contains("other programs")).collect();
        assert_eq!(warnings.len(), usize::from(!expected.is_empty()), "{warnings:?}");
        assert!(said.errors.contains(expected), "{}", said.errors);
        let run = folder.json("run.json");
        assert!((run["others_share"].as_f64().unwrap() - of_frames).abs() < 1e-9, "{}", run["others_share"]);
        let of_frame = run["frames"][1]["others_share"].as_f64();
        assert!(of_frame.is_none_or(|share| (share - of_frames).abs() < 1e-9), "{of_frame:?}");
        let host = &run["host"];
        assert!(host["cores"].as_u64() > Some(0) && host["memory_mib"].as_u64() > Some(0), "{host}");
        assert!(host["kernel"].as_str().is_some_and(|kernel| !kernel.is_empty()), "{host}");
    }
}
