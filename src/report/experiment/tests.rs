use super::*;
use crate::exec::Stereo;
use crate::report::bench::{Errors, Measured};

const BMFR: &str = include_str!("../../cli/bench/experiments/bmfr.toml");
const ANDERSSON: &str = include_str!("../../cli/bench/experiments/andersson.toml");
const KOSKELA: &str = include_str!("../../cli/bench/experiments/koskela.toml");

/// Returns an experiment as long as the process lives.
fn experiment(text: &str) -> &'static Experiment {
    Box::leak(Box::new(Experiment::parse(text).unwrap()))
}

fn measured(time_ms: [f64; 3], stages: &[&[(&str, f64)]]) -> Measured {
    let eye = |flip: f64| Errors::mean_of(&[serde_json::json!({ "flip": flip, "flicker": flip / 10.0 })]);
    Measured {
        time_ms: time_ms[0],
        time_ms_min: time_ms[1],
        time_ms_max: time_ms[2],
        stage_ms: stages.concat().into_iter().map(|(name, ms)| (name.to_owned(), ms)).collect(),
        errors: Stereo { left: eye(0.1), right: eye(0.2) },
        relmse_repeats: Stereo { left: Vec::new(), right: Vec::new() },
        frames: Vec::new(),
    }
}

#[test]
fn a_filter_is_the_fit_or_what_stands_in_its_place() {
    let bmfr = experiment(BMFR);
    let paths = [("path_trace", 6.0), ("hole_fill", 2.0), ("accumulate", 4.0)];
    let of = |filter: &[(&str, f64)]| (measured([20.0, 19.0, 22.0], &[&paths, filter]), OtherMeasures::new());
    let rows = bmfr.measured(
        "builtin:cornell",
        Camera::Approaching,
        &[of(&[("variance", 1.0), ("svgf", 3.0)]), of(&[("fit", 4.0)])],
    );
    let csv = bmfr.csv(&rows);
    for (line, denoiser) in ["svgf", "bmfr"].into_iter().enumerate() {
        let found = ["denoiser", "frames_per_s", "path_ms", "filter_ms", "filter_share", "flip", "flicker"];
        let found = found.map(|name| csv.value(line, name));
        assert_eq!(found, [denoiser, "50.0000", "8.0000", "4.0000", "0.25000", "0.150000", "0.015000"]);
    }
    assert_eq!(bmfr.json(&rows[0])["time_ms"], serde_json::json!([20.0, 19.0, 22.0]));
    let shown = bmfr.table(&bmfr.cited()).rows;
    assert_eq!(shown[0][3..8], ["-", "-", "78.0", "-", "-"]);
    assert_eq!(shown[1][3..8], ["-", "-", "71.0", "7.08", "6.42, 42.7 %"]);
}

#[test]
fn path_tracing_is_held_against_that_of_every_pixel() {
    let koskela = experiment(KOSKELA);
    let of = |path_ms: f64, more: &[(&str, f64)], floor: Option<f64>, left| {
        let stages = [("path_trace", path_ms - 1.0), ("hole_fill", 1.0), ("accumulate", 2.0), ("svgf", 3.0)];
        let measures = [("paths_left", left), ("paths_right", 0.1), ("fovea_flip", 0.02), ("fovea_flicker", 0.01)];
        let beside = measures.into_iter().chain(floor.map(|floor| ("floor", floor))).collect();
        (measured([2.0 * path_ms, path_ms, 3.0 * path_ms], &[&stages, more]), beside)
    };
    let rows = koskela.measured(
        "builtin:cornell",
        Camera::Approaching,
        &[
            of(10.0, &[], None, 1.0),
            of(5.0, &[], None, 0.4),
            of(8.0, &[], Some(0.2), 0.4),
            of(4.0, &[("to_screen", 0.5), ("polar_blur", 0.25)], None, 0.4),
        ],
    );
    let csv = koskela.csv(&rows);
    let of_row = |i, names: [&str; 6]| names.map(|name| csv.value(i, name));
    let names = ["arrangement", "time_ms", "path_speedup", "filter_ms", "map_ms", "blur_ms"];
    assert_eq!(of_row(0, names), ["full", "20.0000", "1.0000", "5.0000", "", ""]);
    assert_eq!(of_row(3, names), ["visual-polar", "8.0000", "2.5000", "5.0000", "0.5000", "0.2500"]);
    let names = ["floor", "paths_left", "flip", "flicker", "fovea_flip", "fovea_flicker"];
    assert_eq!(of_row(2, names), ["0.20000", "0.40000", "0.150000", "0.015000", "0.020000", "0.010000"]);
    let shown = koskela.table(&koskela.cited()).rows;
    assert_eq!(shown[0][5..13], ["100.0, -", "-", "20.00", "1.00", "-", "-", "-", "-"]);
    assert_eq!(shown[3][5..13], ["39.0, -", "-", "22.00", "2.50", "2.40", "0.80", "0.80", "-"]);
}

/// The paper's factor is rounded.
#[test]
fn cited_times_give_the_cited_factor() {
    let koskela = experiment(KOSKELA);
    let value = |row: &ExperimentRow, name| row.values[koskela.at(name).unwrap()].unwrap();
    let cited = koskela.cited();
    assert_eq!(cited.len(), 4);
    for [full, polar] in cited.as_chunks::<2>().0 {
        let ratio = value(full, "path_ms") / value(polar, "path_ms");
        assert!((ratio - value(polar, "path_speedup")).abs() < 0.05, "{polar:?}: {ratio}");
    }
}

#[test]
fn what_is_cited_is_as_fast_as_the_thesis_says() {
    let andersson = experiment(ANDERSSON);
    let rows = andersson.cited();
    assert_eq!(rows.len(), 4 * 4 + 3 * 4);
    let csv = andersson.csv(&rows);
    let of = |scene: &str, mode: &str, name: &str| {
        let is = |i: &usize| csv.value(*i, "scene") == scene && csv.value(*i, "mode") == mode;
        csv.value((0..rows.len()).find(is).unwrap(), name).to_owned()
    };
    assert_eq!(of("Sponza", "composite", "speedup"), "1.6382");
    assert_eq!(of("Bistro, antialiased", "composite-kernel", "speedup"), "1.7816");
    assert_eq!(of("Bistro", "fov", "speedup"), "0.7705");
    assert_eq!(of("Sponza", "kernel", "traced"), "0.65700");
    let shown = andersson.table(&rows).rows;
    let moving = shown.iter().find(|row| row[2] == "moving").unwrap();
    assert_eq!((moving[3].as_str(), moving[18].as_str(), moving[6].as_str()), ("fov", "0.960, 0.920", "-"));
    let [first, last] = [&rows[0], &rows[rows.len() - 1]].map(|row| andersson.json(row));
    assert!(first["camera"].is_null() && first["ssim"] == serde_json::json!([null, null]), "{first}");
    assert!(last["camera"] == "moving" && last["time_ms"].is_null() && last["ssim"][1] == 0.92, "{last}");
}

#[test]
fn what_is_wrong_is_named_with_its_key() {
    for (old, new, says) in [
        ("title =", "titel =", &["titel"][..]),
        ("title = ", "frames.count = 3\ntitle = ", &["count"]),
        ("name = \"bmfr\"\ntitle", "name = \"frames\"\ntitle", &["name", "'frames'"]),
        ("title =", "frames.repeats = 1001\ntitle =", &["frames", "1000"]),
        ("title =", "cameras = []\ntitle =", &["cameras"]),
        ("title =", "cameras = ['lost']\ntitle =", &["cameras", "lost"]),
        ("arrangements = \"denoiser\"", "arrangements = \"flip\"", &["columns", "'flip'"]),
        ("measure = \"flip\"", "measure = \"flop\"", &["flip: measure", "'flop'", "flicker"]),
        ("measure = \"flip\"", "speedup = \"flip\"", &["flip: speedup", "'flip'"]),
        ("measure = \"flip\"", "measure = \"flip\", stages = []", &["flip", "one of measure"]),
        ("decimals = 6, measure = \"flip\"", "decimals = 60, measure = \"flip\"", &["flip: decimals"]),
        ("{flip:4}", "{flop:4}", &["table: FLIP: cell", "'flop'"]),
        ("{flip:4}", "{flip}", &["table: FLIP: cell", "'{flip}'"]),
        ("{flip:4}", "{flip:4", &["table: FLIP: cell", "no end"]),
        ("{flip:4}", "{flip:%x}", &["table: FLIP: cell", "{flip:%x}"]),
        ("name = \"bmfr_noise\"", "name = \"bmfr\"", &["arrangement", "'bmfr'"]),
        ("arrangement = \"bmfr_noise\"", "arrangement = \"noise\"", &["cited", "'noise'"]),
        ("values = { frames_per_s = 78.0", "values = { fps = 78.0", &["cited", "'fps'"]),
    ] {
        assert!(BMFR.contains(old), "{old}");
        let error = Experiment::parse(&BMFR.replacen(old, new, 1)).unwrap_err();
        assert!(says.iter().all(|part| error.contains(part)), "{new}: {error}");
    }
}
