//! Result files: `run.json` fits its schema and lists every option, CSV files are tidy, and the script in `examples/`
//! plots all of them.

use std::collections::BTreeSet;
use std::process::Command;

use serde_json::Value;

use crate::common::{Folder, Said};
use crate::runs::{self, run};
use crate::schema;

/// Studies over several shots or many views, which write no run.json.
const WITHOUT_RUN_JSON: [&str; 6] = ["leria", "leria-lightfield", "bmfr", "koskela", "andersson", "peres"];

#[test]
fn run_json_fits_its_schema() {
    let schema = include_str!("../../../docs/run.schema.json");
    let schema = serde_json::from_str(schema).unwrap();
    for name in runs::names().filter(|name| !WITHOUT_RUN_JSON.contains(name)) {
        let errors = schema::errors(&schema, &run(name).json());
        assert!(errors.is_empty(), "{name}: {errors:?}");
    }
    // The check finds missing members and members of the wrong type.
    for (key, value) in [("devices", Value::Null), ("frames", 3.into()), ("version", 1.into())] {
        let mut json = run("render").json();
        json[key] = value;
        let errors = schema::errors(&schema, &json);
        assert!(errors.len() == 1 && errors[0].starts_with(&format!("/{key}: ")), "{errors:?}");
    }
    let mut json = run("render").json();
    json["frames"][1].as_object_mut().unwrap().remove("rays");
    assert!(schema::errors(&schema, &json)[0].starts_with("/frames/1: "));
}

/// Returns the long options in the help of a command.
fn options_of(command: &str) -> BTreeSet<String> {
    let help = Folder::new().run(&format!("{command} --help")).out;
    // Descriptions are indented further.
    let lines = help.lines().filter(|line| line.trim_start().starts_with('-') && !line.starts_with("        "));
    let names = lines.filter_map(|line| line.split_once("--")?.1.split([' ', '.', '[']).next());
    let names: BTreeSet<String> = names.map(str::to_owned).collect();
    assert!(names.contains("out") && names.contains("size") && names.len() > 20, "{names:?}");
    names.into_iter().filter(|name| name != "help").collect()
}

#[test]
fn settings_in_run_json_have_every_option() {
    for (name, command) in
        [("render", "render"), ("reference", "render"), ("play", "play"), ("scale", "scale"), ("bench", "bench")]
    {
        let json = run(name).json();
        for option in options_of(command).into_iter().filter(|option| option != "set") {
            let setting = option.replace('-', "_");
            assert!(json["settings"].get(&setting).is_some(), "{name}: no {setting} in {}", json["settings"]);
        }
    }
    let of = |name: &str, setting: &str| run(name).json()["settings"][setting].clone();
    assert_eq!(of("render", "virtual"), 2);
    assert_eq!(of("render", "aov"), serde_json::json!(["depth", "albedo"]));
    assert_eq!(of("render", "threads_per_device").as_array().unwrap().len(), 2);
    assert_eq!(of("render", "traversal"), run("render").json()["devices"][0]["traversal"]);
    assert_eq!((of("render", "iterations"), of("render", "denoiser")), (5.into(), "svgf".into()));
    assert_eq!((of("reference", "spp"), of("reference", "denoiser")), (16.into(), "none".into()));
    assert_eq!((of("play", "budget_ms"), of("play", "denoiser")), ("0.01..30000".into(), "svgf".into()));
    assert_eq!(of("bench", "spp"), serde_json::json!([1, 2]));
}

#[test]
fn frames_csv_has_a_line_per_frame() {
    let mut known: Option<Vec<String>> = None;
    let runs_and_lines = [
        ("render", 3, 0),
        ("reference", 2, 0),
        ("play", 8, 0),
        ("scale", 24, 0),
        // Turns of each setting.
        ("bench", 5 * 5, 2),
        ("seams", 4 * 2, 1),
        ("leria", 2 * 2 * 3 * 3, 5),
        ("leria-lightfield", 2 * 5 * 3 * 2, 5),
        ("koskela", 2 * 5 * 2, 5),
        ("andersson", 2 * 7 * (2 + 2), 5),
        ("peres", 2 * 6 * 2, 5),
    ];
    for (name, lines, own) in runs_and_lines.into_iter().filter(|(name, ..)| runs::is_looked_at(name)) {
        let (columns, found) = run(name).csv("frames.csv");
        let common = columns[own..].to_vec();
        let known = known.get_or_insert_with(|| common.clone());
        assert!(common.starts_with(known) && (common.len() > known.len()) == (name == "play"), "{name}: {columns:?}");
        assert_eq!(found.len(), lines, "{name}: {found:?}");
        let at = columns.iter().position(|name| name == "makespan_ms").unwrap();
        assert!(found.iter().all(|line| line[at].parse::<f64>().unwrap() > 0.0), "{name}");
    }
    // Values that run.json shares are equal.
    let (columns, lines) = run("render").csv("frames.csv");
    for (line, row) in lines.iter().zip(run("render").json()["frames"].as_array().unwrap()) {
        for name in ["makespan_ms", "aov_ms", "plan_ms", "rays", "hole_fraction", "transferred_bytes", "spp"] {
            let value: f64 = line[columns.iter().position(|column| column == name).unwrap()].parse().unwrap();
            assert!((value - row[name].as_f64().unwrap()).abs() < 1e-4, "{name}: {value} and {}", row[name]);
        }
    }
    let devices = |line: &[String]| line[columns.iter().position(|name| name == "devices").unwrap()].clone();
    let counts: Vec<String> = run("scale").csv("frames.csv").1.iter().map(|line| devices(line)).collect();
    assert_eq!(counts, [["1"; 12], ["2"; 12]].concat());
}

#[test]
fn csv_files_are_tidy() {
    // Tests run concurrently. The reverse order means that they rarely wait for the same runs.
    let runs_and_files = [
        ("peres", "peres.csv"),
        ("andersson", "rings.csv"),
        ("andersson", "andersson.csv"),
        ("koskela", "koskela.csv"),
        ("bmfr", "bmfr.csv"),
        ("leria-lightfield", "leria-lightfield.csv"),
        ("leria", "leria.csv"),
        ("seams", "seams.csv"),
        ("bench", "frames.csv"),
        ("bench", "bench.csv"),
        ("scale", "simulate.csv"),
        ("scale", "scale.csv"),
        ("play", "frames.csv"),
        ("render", "frames.csv"),
    ];
    for (name, file) in runs_and_files.into_iter().filter(|(name, _)| runs::is_looked_at(name)) {
        let (columns, lines) = run(name).csv(file);
        let is_snake = |name: &String| {
            !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
        };
        assert!(columns.iter().all(is_snake), "{name}/{file}: {columns:?}");
        assert_eq!(columns.iter().collect::<BTreeSet<_>>().len(), columns.len(), "{name}/{file}: {columns:?}");
        assert!(!lines.is_empty(), "{name}/{file}");
        for (column, cell) in lines.iter().flat_map(|line| columns.iter().zip(line)) {
            let is_name = ["resolution", "stands_for", "scene", "arrangement", "cause"].contains(&column.as_str());
            let is_one = !cell.contains([' ', ',', '%', '±']) && cell != "-";
            assert!(is_name || is_one, "{name}/{file}: {column} is '{cell}'");
        }
    }
}

/// Each stage appears once. Filters of other denoisers did not run.
#[test]
fn stripes_are_reported_for_stages_that_ran() {
    let json = run("render").json();
    let frame = &json["frames"][1];
    let told: BTreeSet<&str> = frame["stage_stripes"].as_object().unwrap().keys().map(String::as_str).collect();
    let sums = frame["stages"].as_array().unwrap().iter().filter(|sum| sum.get("bytes").is_none());
    let name = |sum: &Value| format!("{}.{}", sum["stage"].as_str().unwrap(), sum["view"].as_str().unwrap());
    let ran: BTreeSet<String> = sums.map(name).collect();
    assert!(told.iter().copied().eq(ran.iter().map(String::as_str)), "{told:?} and {ran:?}");
    assert!(told.contains("svgf.left") && !told.contains("atrous.left"), "{told:?}");
    for rows in frame["stage_stripes"].as_object().unwrap().values() {
        let rows: Vec<u64> = rows.as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
        assert!(rows.len() == 2 && rows.iter().sum::<u64>() == 24, "{rows:?}");
    }
}

/// The time of auxiliary images is separate from the makespan; their sum lasts at least until the last task ends.
#[test]
fn makespan_excludes_auxiliary_images() {
    let number = |value: &Value| value.as_f64().unwrap();
    for frame in run("render").json()["frames"].as_array().unwrap() {
        let (aov_ms, makespan_ms) = (number(&frame["aov_ms"]), number(&frame["makespan_ms"]));
        let tasks = frame["tasks"].as_array().unwrap();
        let end_ms = tasks.iter().map(|t| number(&t["end_ms"])).fold(0.0, f64::max);
        let of_aovs = tasks.iter().filter(|t| t["stage"] == "aov");
        let longest_ms = of_aovs.map(|t| number(&t["end_ms"]) - number(&t["begin_ms"])).fold(0.0, f64::max);
        assert!(aov_ms > 0.0 && aov_ms >= longest_ms - 1e-3, "{aov_ms} and {longest_ms}");
        // Device clocks have errors of up to a millisecond.
        assert!(makespan_ms > 0.0 && makespan_ms + aov_ms > end_ms - 1.0, "{makespan_ms}, {aov_ms}, {end_ms}");
    }
    let without = run("play").json();
    assert!(without["frames"].as_array().unwrap().iter().all(|frame| frame["aov_ms"] == 0.0));
}

/// Returns the command that runs Python with pandas and matplotlib: `DIPTYCH_PYTHON`, or `python3`.
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
fn example_plots_every_kind_of_file() {
    let Some(python) = python() else { return };
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../examples/plot_runs.py");
    let runs_and_plots = [
        ("render", &["frames", "stages"][..]),
        ("reference", &["frames", "stages", "references"]),
        ("play", &["frames", "rungs", "stages"]),
        ("scale", &["frames", "stages", "scale", "simulate"]),
        ("bench", &["frames", "bench"]),
        ("seams", &["frames", "stages", "seams"]),
        ("leria", &["frames", "leria"]),
        ("leria-lightfield", &["frames", "leria-lightfield"]),
        ("bmfr", &["bmfr", "frames"]),
        ("koskela", &["frames", "koskela"]),
        ("andersson", &["andersson", "frames"]),
        ("peres", &["frames", "peres"]),
    ];
    for (name, plots) in runs_and_plots.into_iter().filter(|(name, _)| runs::is_looked_at(name)) {
        let out = Folder::new();
        let mut command = Command::new(&python);
        command.args(["-W", "error", script]).arg(run(name).folder()).arg(out.path(""));
        Said::new(command.env("MPLCONFIGDIR", out.path("config")).output().unwrap()).success(name);
        let found = out.names("");
        assert!(
            found.iter().filter_map(|name| name.strip_suffix(".png")).eq(plots.iter().copied()),
            "{name}: {found:?}"
        );
    }
}

/// Runs the box; returns the text on both streams.
fn said(options: &str) -> String {
    Folder::new().run(&format!("render builtin:cornell --size 16x10 --bounces 1 --out ./ {options}")).all()
}

#[test]
fn warns_of_frames_beyond_the_path_of_the_camera() {
    for (options, part) in [
        ("--time 100 --frames 1", "path ends at 4 s, and its last key is held to 100 s"),
        ("--time 3.99 --frames 3", "its last key is held to 4.01"),
        ("--time -1 --frames 1", "path begins at 0 s, and its first key is held from -1 s"),
    ] {
        let text = said(options);
        assert!(text.contains("warning: the camera's path") && text.contains(part), "{options}: {text}");
    }
    assert!(!said("--time 4 --frames 1").contains("warning"));
}

#[test]
fn summary_counts_only_devices_that_are_left() {
    let two = "--virtual 2 --threads-per-device 1";
    assert!(said(two).contains(" on 2 device(s): "));
    let text = said(&format!("{two} --disturb loss:dev1@frame0"));
    assert!(text.contains(" on 1 of 2 device(s): "), "{text}");
}
