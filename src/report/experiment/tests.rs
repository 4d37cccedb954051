use super::*;
use crate::exec::Stereo;
use crate::report::bench::{Errors, Measured};

const BMFR: &str = include_str!("../../cli/bench/experiments/bmfr.toml");
const ANDERSSON: &str = include_str!("../../cli/bench/experiments/andersson.toml");
const KOSKELA: &str = include_str!("../../cli/bench/experiments/koskela.toml");
const LERIA: &str = include_str!("../../cli/bench/experiments/leria.toml");
const LATE: &str = include_str!("../../cli/bench/experiments/late.toml");
const PERES: &str = include_str!("../../cli/bench/experiments/peres.toml");

/// Returns an experiment as long as the process lives.
fn experiment(text: &str) -> &'static Experiment {
    Box::leak(Box::new(Experiment::parse(text).unwrap()))
}

/// Returns the texts of a measured row.
fn of_shot(scene: &str, more: &[(&str, &str)]) -> Texts {
    let texts = [("source", "measured"), ("scene", scene), ("shot", scene)];
    texts.iter().chain(more).map(|(label, text)| ((*label).to_owned(), (*text).into())).collect()
}

/// Returns what was measured at an instant. `errors` are those of each eye.
fn at_instant(errors: [serde_json::Value; 2]) -> Measured {
    let [left, right] = errors.map(|errors| Errors::mean_of(&[errors]));
    Measured {
        time_ms: 0.0,
        time_ms_min: 0.0,
        time_ms_max: 0.0,
        stage_ms: std::collections::BTreeMap::new(),
        rays: std::collections::BTreeMap::new(),
        errors: Stereo { left, right },
        relmse_repeats: Stereo { left: Vec::new(), right: Vec::new() },
        frames: Vec::new(),
    }
}

fn frame(makespan_ms: f64, stages: &[(usize, &str, f64)]) -> FrameTimes {
    FrameTimes::new(makespan_ms, 3, stages.iter().copied())
}

/// Returns frames that took `times_ms` and ran these stages.
fn measured(times_ms: [f64; 3], stages: &[&[(&str, f64)]], others: OtherMeasures) -> Found {
    let eye = |flip: f64| serde_json::json!({ "flip": flip, "flicker": flip / 10.0 });
    let stages: Vec<_> = stages.concat().into_iter().map(|(stage, ms)| (0, stage, ms)).collect();
    let times = times_ms.map(|ms| frame(ms, &stages)).to_vec();
    Found { times, instants: vec![at_instant([eye(0.1), eye(0.2)])], others, ..Found::default() }
}

fn first_table(of: &'static Experiment, rows: &[ExperimentRow]) -> Vec<Vec<String>> {
    of.tables(rows, Vec::new()).swap_remove(0).2.rows
}

#[test]
fn a_filter_is_the_fit_or_what_stands_in_its_place() {
    let bmfr = experiment(BMFR);
    let paths = [("path_trace", 6.0), ("hole_fill", 2.0), ("accumulate", 4.0)];
    let of = |filter: &[(&str, f64)]| measured([20.0, 19.0, 22.0], &[&paths, filter], OtherMeasures::new());
    let rows = bmfr
        .measured(&of_shot("builtin:cornell", &[]), &[of(&[("variance", 1.0), ("svgf", 3.0)]), of(&[("fit", 4.0)])]);
    let csv = bmfr.csv(&rows);
    for (line, denoiser) in ["svgf", "bmfr"].into_iter().enumerate() {
        let found = ["denoiser", "frames_per_s", "path_ms", "filter_ms", "filter_share", "flip", "flicker"];
        let found = found.map(|name| csv.value(line, name));
        assert_eq!(found, [denoiser, "50.0000", "8.0000", "4.0000", "0.25000", "0.150000", "0.015000"]);
    }
    assert_eq!(bmfr.json(&rows[0])["time_ms"], serde_json::json!([20.0, 19.0, 22.0]));
    let shown = first_table(bmfr, &bmfr.cited());
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
        measured([2.0 * path_ms, path_ms, 3.0 * path_ms], &[&stages, more], beside)
    };
    let rows = koskela.measured(
        &of_shot("builtin:cornell", &[]),
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
    let shown = first_table(koskela, &koskela.cited());
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
    let shown = first_table(andersson, &rows);
    let moving = shown.iter().find(|row| row[2] == "moving").unwrap();
    assert_eq!((moving[3].as_str(), moving[18].as_str(), moving[6].as_str()), ("fov", "0.960, 0.920", "-"));
    let [first, last] = [&rows[0], &rows[rows.len() - 1]].map(|row| andersson.json(row));
    assert!(first["camera"].is_null() && first["ssim"] == serde_json::json!([null, null]), "{first}");
    assert!(last["camera"] == "moving" && last["time_ms"].is_null() && last["ssim"][1] == 0.92, "{last}");
}

fn peres_row(resolution: &str, stands_for: &str) -> Texts {
    let texts = [("resolution", resolution), ("size", "240x270"), ("stands_for", stands_for)];
    of_shot("builtin:forest", &texts)
}

/// The thesis prints two digits and truncates the rest.
#[test]
fn cited_times_give_the_cited_speed_ups() {
    let peres = experiment(PERES);
    let printed = [[[1.16, 1.26], [1.33, 1.35], [1.23, 1.30]], [[1.11, 1.15], [1.31, 1.33], [1.22, 1.24]]];
    for (resolution, scenes) in ["FHD", "Quest 2"].into_iter().zip(printed) {
        for (scene, speedups) in ["Pink Room", "Sponza", "Forest"].into_iter().zip(scenes) {
            let csv = peres.csv(&peres.measured(&peres_row(resolution, scene), &[0; 3].map(|_| Found::default())));
            for (line, printed) in (1..).zip(speedups) {
                let cut = (csv.value(line, "thesis_speedup").parse::<f64>().unwrap() * 100.0).floor() / 100.0;
                assert!((cut - printed).abs() < 1e-9, "{resolution}, {scene}: {cut}");
            }
        }
    }
}

#[test]
fn an_error_of_a_tenth_of_the_range_is_20_db() {
    let peres = experiment(PERES);
    let of = |psnr: f64| {
        let instants = vec![at_instant([0, 1].map(|_| serde_json::json!({ "psnr": psnr })))];
        Found { times: vec![frame(1.0, &[])], instants, ..Found::default() }
    };
    let csv = peres.csv(&peres.measured(&peres_row("FHD", "Forest"), &[of(20.0), of(40.0)]));
    assert_eq!([0, 1].map(|line| csv.value(line, "rmse_percent").to_owned()), ["10.0000", "1.0000"]);
    // A single instant has no deviation.
    assert_eq!(["instants", "psnr_deviation"].map(|name| csv.value(0, name)), ["1", ""]);
}

#[test]
fn what_was_not_measured_leaves_the_cited_numbers_alone() {
    let peres = experiment(PERES);
    let eyes = |psnr: f64| [psnr - 1.0, psnr + 1.0].map(|psnr| serde_json::json!({ "psnr": psnr, "ssim": 0.5 }));
    let instants = vec![at_instant(eyes(20.0)), at_instant(eyes(22.0))];
    let times = [8.0, 10.0, 12.0, 14.0].map(|ms| frame(ms, &[])).to_vec();
    let base = Found { times, instants, others: OtherMeasures::from([("exposure_ev", 2.0)]), ..Found::default() };
    let rows = peres.measured(&peres_row("FHD", "Forest"), &[base, Found::default(), Found::default()]);
    let [time, quality] = [0, 1].map(|i| peres.tables(&rows, Vec::new()).swap_remove(i).2.rows);
    assert_eq!(
        time[0],
        ["FHD", "240x270", "builtin:forest", "Forest", "Base", "11.00", "3.00", "1.00", "22.84", "1.00"]
    );
    assert_eq!(time[2][5..], ["-", "-", "-", "17.54", "1.30"]);
    assert_eq!(quality[0][5..9], ["2.00", "8.9716 ± 1.4543", "0.500000 ± 0.000000", "21.000 ± 1.414"]);
    assert_eq!(quality[2][5..], ["-", "-", "-", "-", "4.1787", "0.778536", "21.692"]);
    let csv = peres.csv(&rows);
    let names = ["time_ms", "speedup", "psnr", "psnr_deviation", "instants", "thesis_time_ms"];
    assert_eq!(names.map(|name| csv.value(0, name)), ["11.0000", "1.0000", "21.0000", "1.4142", "2", "22.84"]);
    assert_eq!(names.map(|name| csv.value(2, name)), ["", "", "", "", "", "17.54"]);
    assert!(peres.cited().is_empty());
}

#[test]
fn layers_are_those_of_table_2() {
    let peres = experiment(PERES);
    let [fhd, quest] = &peres.resolutions[..] else { panic!("{:?}", peres.resolutions) };
    assert_eq!(fhd.layer_radii(), Some(crate::frame::Foveation::RADII));
    let [inner, middle] = quest.layer_radii().unwrap();
    assert!((inner - 0.1447).abs() < 1e-4 && (middle - 0.2893).abs() < 1e-4, "{inner}, {middle}");
    assert_eq!(quest.size(0.04).to_string(), "73x77");
}

#[test]
fn late_rows_are_means_over_instants_and_eyes() {
    let late = experiment(LATE);
    let at = |left: f64, right: f64| at_instant([left, right].map(|flip| serde_json::json!({ "flip": flip })));
    let others = OtherMeasures::from([("latency_ms", 40.0), ("turned_deg", 1.5)]);
    let found = Found {
        times: vec![frame(1.0, &[]); 2],
        instants: vec![at(0.1, 0.3), at(0.2, 0.6)],
        corrected: vec![at(0.02, 0.02), at(0.04, 0.04)],
        repeated: vec![at(0.01, 0.01); 2],
        others,
        ..Found::default()
    };
    let csv = late.csv(&late.measured(&of_shot("builtin:cornell", &[]), &[found]));
    let names = [
        "latency_ms",
        "turned_deg",
        "instants",
        "flip",
        "flip_most",
        "flip_corrected",
        "flip_corrected_most",
        "flip_noise",
    ];
    let values = names.map(|name| csv.value(0, name).parse::<f64>().unwrap());
    assert_eq!(values, [40.0, 1.5, 2.0, 0.3, 0.6, 0.03, 0.04, 0.01]);
    assert_eq!(late.frame_labels(), ["shot", "latency"]);
}

/// The mean of the paper's three speedups is 2.25.
#[test]
fn cited_times_give_the_cited_speed_ups_of_frames_and_stages() {
    let leria = experiment(LERIA);
    let csv = leria.csv(&leria.cited());
    let value = |line, name| csv.value(line, name).parse::<f64>().unwrap();
    for (line, printed) in [(1, 1.83), (3, 2.80), (5, 2.11)] {
        let speedup = value(line, "speedup");
        assert!((speedup - printed).abs() < 0.01, "{speedup} and {printed}");
        assert!((value(line - 1, "total_s") / value(line, "total_s") - speedup).abs() < 1e-4, "{speedup}");
    }
    for (name, printed) in [("reprojection_ms", 2.75), ("hole_filling_ms", 2.89), ("denoising_ms", 4.2)] {
        assert!((value(0, name) / value(1, name) - printed).abs() < 0.01, "{name}");
    }
    assert_eq!(
        first_table(leria, &leria.cited())[0],
        ["cited", "San Miguel", "-", "baseline", "104", "1.590", "-", "-", "1.00", "99 | 53"]
    );
}

#[test]
fn stages_are_means_over_the_devices_that_ran_them() {
    let leria = experiment(LERIA);
    let paths = [(0, "path_trace", 4.0), (1, "path_trace", 4.0), (0, "svgf", 2.0), (0, "resolve", 1.0)];
    let sent = [(1, "download", 1.0), (2, "download", 3.0), (0, "upload", 0.5)];
    let baseline = vec![frame(10.0, &[&paths[..], &sent].concat()); 3];
    let filter = [(0, "svgf", 0.5), (1, "svgf", 1.0), (2, "svgf", 1.5)];
    let proposed = [5.0, 4.0, 1.0].map(|ms| frame(ms, &filter)).to_vec();
    let found = [baseline, proposed].map(|times| Found { times, ..Found::default() });
    let mut texts = of_shot("builtin:cornell", &[]);
    texts.insert("devices".to_owned(), 3.into());
    let rows = leria.measured(&texts, &found);
    let csv = leria.csv(&rows);
    let names = ["path_tracing_ms", "denoising_ms", "sending_ms", "receiving_ms", "hole_filling_ms"];
    assert_eq!(names.map(|name| csv.value(0, name)), ["4.0000", "3.0000", "2.0000", "0.5000", ""]);
    // Transfers do not count as work of the device; the third device did nothing.
    let busy = ["primary_busy_share", "others_busy_share"].map(|name| csv.value(0, name));
    assert_eq!(busy, ["0.70000", "0.20000"]);
    // The speedup is the median over frames.
    let names = ["source", "devices", "arrangement", "frames", "total_s", "makespan_ms", "speedup", "denoising_ms"];
    let expected = ["measured", "3", "proposed", "3", "0.010000", "4.0000", "2.5000", "1.0000"];
    assert_eq!(names.map(|name| csv.value(1, name)), expected);
    assert_eq!((csv.value(0, "speedup"), &leria.json(&rows[1])["devices"]), ("1.0000", &3.into()));
    assert_eq!(leria.frame_labels(), ["arrangement"]);
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
        ("title =", "labels = ['scene', 'seen']\ntitle =", &["labels", "'seen'", "stands_for"]),
        ("title =", "labels = ['scene', 'scene']\ntitle =", &["labels", "once"]),
        ("title =", "overscan_deg = 90\ntitle =", &["overscan_deg"]),
        ("title =", "cameras = ['late', 'still']\ntitle =", &["cameras", "late"]),
        ("title =", "cameras = ['late']\ntitle =", &["arrangement", "svgf", "late_frames"]),
        ("title =", "cameras = ['following']\ntitle =", &["flip", "following"]),
        ("measure = \"flip\"", "measure = \"rays\", mean_of_devices = true", &["flip: mean_of_devices"]),
        ("title =", "resolutions = [{ name = 'A', width = 0, height = 1 }]\ntitle =", &["resolutions", "width"]),
        ("measure = \"flip\"", "cited = \"flop\"", &["flip: cited", "'flop'"]),
        ("measure = \"flip\"", "measure = \"flip\", statistic = \"sum\"", &["statistic", "sum", "maximum"]),
        ("measure = \"flip\"", "measure = \"rays\", statistic = \"maximum\"", &["flip: statistic"]),
        ("measure = \"flip\"", "measure = \"flip\", of = \"corrected\"", &["flip: of"]),
        ("scene = \"Falcor's", "resolution = \"A\"\nscene = \"Falcor's", &["cited", "resolution 'A'"]),
    ] {
        assert!(BMFR.contains(old), "{old}");
        let error = Experiment::parse(&BMFR.replacen(old, new, 1)).unwrap_err();
        assert!(says.iter().all(|part| error.contains(part)), "{new}: {error}");
    }
}
