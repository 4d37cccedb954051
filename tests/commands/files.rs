//! Files of numbers: `run.json` fits its schema and tells every option, CSV files are tidy, and the script in `examples/`
//! plots all of them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use serde_json::Value;

use crate::common::diptych;
use crate::schema;

/// Runs of every kind that writes numbers: a name, and what it is run with.
const RUNS: [(&str, &[&str]); 11] = [
    ("render", &["render", "--frames", "3", "--virtual", "2", "--aov", "depth,albedo", "--details"]),
    ("reference", &["render", "--reference", "--spp", "16", "--frames", "2"]),
    ("play", &["play", "--frames", "8", "--budget-ms", "0.01..30000", "--fps", "1000"]),
    ("scale", &["scale", "--counts", "2", "--threads-per-device", "1", "--simulate", "1,4"]),
    ("bench", &["bench", "--quick", "--spp", "1,2", "--bounces", "2", "--denoiser", "none,atrous"]),
    ("seams", &["bench", "--seam-study", "--counts", "2", "--bounces", "2"]),
    ("leria", &["bench", "--preset", "leria", "--virtual", "2", "--threads-per-device", "1", "--frames", "2"]),
    ("bmfr", &["bench", "--preset", "bmfr", "--warm-up", "0"]),
    ("koskela", &["bench", "--preset", "koskela", "--warm-up", "0"]),
    ("andersson", &["bench", "--preset", "andersson", "--instants", "1"]),
    (
        "peres",
        &["bench", "--preset", "peres", "--shots", "builtin:cornell", "--size-factor", "0.03", "--instants", "1"],
    ),
];

/// Those of several shots, which write no run.json.
const MANY_SHOTS: [&str; 4] = ["bmfr", "koskela", "andersson", "peres"];

/// The folder of all runs, each in a folder of its name.
fn runs() -> &'static Path {
    static FOLDER: OnceLock<tempfile::TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let run = |(name, options): (&str, &[&str])| {
            let out = folder.path().join(name);
            let mut args = [options, &["--quiet", "--out", out.to_str().unwrap()]].concat();
            if name != "peres" {
                args.extend(["builtin:cornell", "--size", "40x24"]);
            }
            if options[0] == "bench" && name != "leria" {
                args.extend(["--repeats", "2", "--reference-spp", "16"]);
            }
            let output = diptych(&args);
            assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        };
        // Tests on other threads wait for them.
        let (some, others) = RUNS.split_at(4);
        std::thread::scope(|threads| {
            threads.spawn(|| some.iter().copied().for_each(run));
            others.iter().copied().for_each(run);
        });
        folder
    });
    folder.path()
}

fn json(path: PathBuf) -> Value {
    let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_slice(&bytes).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn run_json(name: &str) -> Value {
    json(runs().join(name).join("run.json"))
}

/// A CSV file: names of columns, and lines. Lines of another length are an error.
fn csv(run: &str, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(runs().join(run).join(name)).unwrap();
    let columns = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let lines = reader.records().map(|r| r.unwrap_or_else(|e| panic!("{run}/{name}: {e}")));
    (columns, lines.map(|line| line.iter().map(str::to_owned).collect()).collect())
}

#[test]
fn run_json_fits_its_schema() {
    let schema = json(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/run.schema.json"));
    for name in RUNS.map(|(name, _)| name).into_iter().filter(|name| !MANY_SHOTS.contains(name)) {
        let errors = schema::errors(&schema, &run_json(name));
        assert!(errors.is_empty(), "{name}: {errors:?}");
    }
    // What is missing or of another kind is found.
    for (key, value) in [("devices", Value::Null), ("frames", 3.into()), ("version", 1.into())] {
        let mut run = run_json("render");
        run[key] = value;
        let errors = schema::errors(&schema, &run);
        assert!(errors.len() == 1 && errors[0].starts_with(&format!("/{key}: ")), "{errors:?}");
    }
    let mut run = run_json("render");
    run["frames"][1].as_object_mut().unwrap().remove("rays");
    assert!(schema::errors(&schema, &run)[0].starts_with("/frames/1: "));
}

/// The long options that the help of a command lists.
fn options_of(command: &str) -> BTreeSet<String> {
    let output = diptych(&[command, "--help"]);
    let help = String::from_utf8(output.stdout).unwrap();
    // What is about them stands further to the right.
    let lines = help.lines().filter(|line| line.trim_start().starts_with('-') && !line.starts_with("        "));
    let names = lines.filter_map(|line| line.split_once("--")?.1.split([' ', '.', '[']).next());
    let names: BTreeSet<String> = names.map(str::to_owned).collect();
    assert!(names.contains("out") && names.contains("size") && names.len() > 20, "{names:?}");
    names.into_iter().filter(|name| name != "help").collect()
}

#[test]
fn settings_hold_every_option_that_help_lists() {
    for (name, command) in
        [("render", "render"), ("reference", "render"), ("play", "play"), ("scale", "scale"), ("bench", "bench")]
    {
        let run = run_json(name);
        for option in options_of(command) {
            let setting = option.replace('-', "_");
            assert!(run["settings"].get(&setting).is_some(), "{name}: no {setting} in {}", run["settings"]);
        }
    }
    let of = |run: &str, setting: &str| run_json(run)["settings"][setting].clone();
    assert_eq!(of("render", "virtual"), 2);
    assert_eq!(of("render", "aov"), serde_json::json!(["depth", "albedo"]));
    assert_eq!(of("render", "threads_per_device").as_array().unwrap().len(), 2);
    assert_eq!(of("render", "traversal"), run_json("render")["devices"][0]["traversal"]);
    assert_eq!((of("render", "iterations"), of("render", "denoiser")), (5.into(), "svgf".into()));
    assert_eq!((of("reference", "spp"), of("reference", "denoiser")), (16.into(), "none".into()));
    assert_eq!((of("play", "budget_ms"), of("play", "denoiser")), ("0.01..30000".into(), "svgf".into()));
    assert_eq!(of("bench", "spp"), serde_json::json!([1, 2]));
}

#[test]
fn frames_have_a_line_each_with_the_same_columns() {
    let mut known: Option<Vec<String>> = None;
    for (run, lines, own) in [
        ("render", 3, 0),
        ("reference", 2, 0),
        ("play", 8, 0),
        ("scale", 10, 0),
        ("bench", 5 * 2, 2),
        ("seams", 4 * 2, 1),
        ("leria", 2 * 2, 1),
        ("bmfr", 3 * 2, 2),
        ("koskela", 5 * 2, 2),
        ("andersson", 5 * (2 + 1), 3),
        ("peres", 6 * 2, 3),
    ] {
        let (columns, found) = csv(run, "frames.csv");
        let common = columns[own..].to_vec();
        let known = known.get_or_insert_with(|| common.clone());
        assert!(common.starts_with(known) && (common.len() > known.len()) == (run == "play"), "{run}: {columns:?}");
        assert_eq!(found.len(), lines, "{run}: {found:?}");
        let at = columns.iter().position(|name| name == "makespan_ms").unwrap();
        assert!(found.iter().all(|line| line[at].parse::<f64>().unwrap() > 0.0), "{run}");
    }
    // What run.json has as well is the same there.
    let (columns, lines) = csv("render", "frames.csv");
    for (line, row) in lines.iter().zip(run_json("render")["frames"].as_array().unwrap()) {
        for name in ["makespan_ms", "aov_ms", "plan_ms", "rays", "hole_fraction", "transferred_bytes", "spp"] {
            let value: f64 = line[columns.iter().position(|column| column == name).unwrap()].parse().unwrap();
            assert!((value - row[name].as_f64().unwrap()).abs() < 1e-4, "{name}: {value} and {}", row[name]);
        }
    }
    let devices = |line: &[String]| line[columns.iter().position(|name| name == "devices").unwrap()].clone();
    let counts: Vec<String> = csv("scale", "frames.csv").1.iter().map(|line| devices(line)).collect();
    assert_eq!(counts, [["1"; 5], ["2"; 5]].concat());
}

#[test]
fn columns_are_named_in_snake_case_and_cells_hold_one_value() {
    for (run, name) in [
        ("render", "frames.csv"),
        ("play", "frames.csv"),
        ("scale", "scale.csv"),
        ("scale", "simulate.csv"),
        ("bench", "bench.csv"),
        ("bench", "frames.csv"),
        ("seams", "seams.csv"),
        ("leria", "leria.csv"),
        ("bmfr", "bmfr.csv"),
        ("koskela", "koskela.csv"),
        ("andersson", "andersson.csv"),
        ("andersson", "rings.csv"),
        ("peres", "peres.csv"),
    ] {
        let (columns, lines) = csv(run, name);
        let is_snake = |name: &String| {
            !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
        };
        assert!(columns.iter().all(is_snake), "{run}/{name}: {columns:?}");
        assert_eq!(columns.iter().collect::<BTreeSet<_>>().len(), columns.len(), "{run}/{name}: {columns:?}");
        assert!(!lines.is_empty(), "{run}/{name}");
        for (column, cell) in lines.iter().flat_map(|line| columns.iter().zip(line)) {
            let is_name = ["resolution", "stands_for", "scene"].contains(&column.as_str());
            let is_one = !cell.contains([' ', ',', '%', '±']) && cell != "-";
            assert!(is_name || is_one, "{run}/{name}: {column} is '{cell}'");
        }
    }
}

/// Each stage once; filters of other denoisers did not run.
#[test]
fn rows_are_told_of_stages_that_ran() {
    let run = run_json("render");
    let frame = &run["frames"][1];
    let told: BTreeSet<&str> = frame["stage_stripes"].as_object().unwrap().keys().map(String::as_str).collect();
    let ran: BTreeSet<String> = frame["stages"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|sum| sum.get("bytes").is_none())
        .map(|sum| format!("{}.{}", sum["stage"].as_str().unwrap(), sum["view"].as_str().unwrap()))
        .collect();
    assert!(told.iter().copied().eq(ran.iter().map(String::as_str)), "{told:?} and {ran:?}");
    assert!(told.contains("svgf.left") && !told.contains("atrous.left"), "{told:?}");
    for rows in frame["stage_stripes"].as_object().unwrap().values() {
        let rows: Vec<u64> = rows.as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
        assert!(rows.len() == 2 && rows.iter().sum::<u64>() == 24, "{rows:?}");
    }
}

/// The time of auxiliary images stands beside the makespan; both together last at least until the last task ended.
#[test]
fn auxiliary_images_are_not_in_the_makespan() {
    let number = |value: &Value| value.as_f64().unwrap();
    for frame in run_json("render")["frames"].as_array().unwrap() {
        let (aov_ms, makespan_ms) = (number(&frame["aov_ms"]), number(&frame["makespan_ms"]));
        let tasks = frame["tasks"].as_array().unwrap();
        let end_ms = tasks.iter().map(|t| number(&t["end_ms"])).fold(0.0, f64::max);
        let of_aovs = tasks.iter().filter(|t| t["stage"] == "aov");
        let longest_ms = of_aovs.map(|t| number(&t["end_ms"]) - number(&t["begin_ms"])).fold(0.0, f64::max);
        assert!(aov_ms > 0.0 && aov_ms >= longest_ms - 1e-3, "{aov_ms} and {longest_ms}");
        // Clocks of devices are off by up to a millisecond.
        assert!(makespan_ms > 0.0 && makespan_ms + aov_ms > end_ms - 1.0, "{makespan_ms}, {aov_ms}, {end_ms}");
    }
    let without = run_json("play");
    assert!(without["frames"].as_array().unwrap().iter().all(|frame| frame["aov_ms"] == 0.0));
}

/// The command that runs Python with pandas and matplotlib: `DIPTYCH_PYTHON`, else `python3`.
fn python() -> Option<String> {
    let python = std::env::var("DIPTYCH_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let found = Command::new(&python).args(["-c", "import pandas, matplotlib"]).output();
    if found.is_ok_and(|output| output.status.success()) {
        return Some(python);
    }
    eprintln!(
        "\nSKIPPED: examples/plot_runs.py: {python} has no pandas and matplotlib (DIPTYCH_PYTHON names another; \
         `pip install pandas matplotlib`)\n"
    );
    None
}

#[test]
fn the_example_plots_every_kind_of_file() {
    let Some(python) = python() else { return };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/plot_runs.py");
    for (run, plots) in [
        ("render", &["frames", "stages"][..]),
        ("reference", &["frames", "stages", "references"]),
        ("play", &["frames", "rungs", "stages"]),
        ("scale", &["frames", "stages", "scale", "simulate"]),
        ("bench", &["frames", "bench"]),
        ("seams", &["frames", "stages", "seams"]),
        ("leria", &["frames", "leria", "stages"]),
        ("bmfr", &["bmfr", "frames"]),
        ("koskela", &["frames", "koskela"]),
        ("andersson", &["andersson", "frames"]),
        ("peres", &["frames", "peres"]),
    ] {
        let out = tempfile::tempdir().unwrap();
        let output = Command::new(&python)
            .args(["-W", "error", script])
            .arg(runs().join(run))
            .arg(out.path())
            .env("MPLCONFIGDIR", out.path().join("config"))
            .output()
            .unwrap();
        assert!(output.status.success(), "{run}: {}", String::from_utf8_lossy(&output.stderr));
        let found: BTreeSet<String> = std::fs::read_dir(out.path())
            .unwrap()
            .filter_map(|e| e.unwrap().file_name().to_str()?.strip_suffix(".png").map(str::to_owned))
            .collect();
        assert_eq!(found, plots.iter().map(|name| (*name).to_owned()).collect(), "{run}");
    }
}

/// What a run of the box says, on both streams.
fn said(options: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let fixed = ["render", "builtin:cornell", "--size", "16x10", "--bounces", "1"];
    let output = diptych(&[&fixed[..], options, &["--out", folder.path().to_str().unwrap()]].concat());
    let text = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap()).concat();
    assert!(output.status.success(), "{options:?}: {text}");
    text
}

#[test]
fn frames_beyond_the_cameras_path_are_warned_of() {
    for (options, part) in [
        (["--time", "100", "--frames", "1"], "path ends at 4 s, and its last key is held to 100 s"),
        (["--time", "3.99", "--frames", "3"], "its last key is held to 4.01"),
        (["--time", "-1", "--frames", "1"], "path begins at 0 s, and its first key is held from -1 s"),
    ] {
        let text = said(&options);
        assert!(text.contains("warning: the camera's path") && text.contains(part), "{options:?}: {text}");
    }
    assert!(!said(&["--time", "4", "--frames", "1"]).contains("warning"));
}

#[test]
fn devices_that_were_taken_out_are_not_counted() {
    let two = ["--virtual", "2", "--threads-per-device", "1"];
    assert!(said(&two).contains(" on 2 device(s): "));
    let text = said(&[&two[..], &["--inject", "loss:dev1@frame0"]].concat());
    assert!(text.contains(" on 1 of 2 device(s): "), "{text}");
}
