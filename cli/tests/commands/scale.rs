//! `scale` reports its measurements in a table for programs and on a self-contained page.

use crate::common::{Folder, Share};
use crate::runs::run;
use serde_json::Value;

/// Scales a small scene with files in `out`; returns the result.
fn scale(folder: &Folder, options: &str) -> Value {
    let line = "scale builtin:checker --size 48x32 --frames 5 --threads-per-device 1 --json --out ./";
    folder.run(&format!("{line} {options}")).json()
}

#[test]
fn rows_have_spread_and_transferred_bytes() {
    let run = run("scale");
    let rows = run.rows();
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap_or_else(|| panic!("no {key} in {row}"));
    for row in rows {
        let [median, least, most, iqr] =
            ["makespan_ms", "makespan_ms_min", "makespan_ms_max", "makespan_ms_iqr"].map(|key| number(row, key));
        assert!(least <= median && median <= most && (0.0..=most - least).contains(&iqr), "{row}");
        // Frames take a few milliseconds beside other load. An error in the model would exceed this by far.
        assert!((0.0..1.0).contains(&number(row, "prediction_error")) && row["frames"] == 12, "{row}");
    }
    assert_eq!((number(&rows[0], "bytes_per_frame"), number(&rows[0], "speedup_error")), (0.0, 0.0));
    let interval = |row: &Value, name: &str| ["low", "high"].map(|end| number(row, &format!("{name}_{end}")));
    let [low, high] = interval(&rows[1], "speedup");
    assert!((low..=high).contains(&number(&rows[1], "speedup")), "{}", rows[1]);
    let [low, high] = interval(&rows[0], "makespan_ms");
    assert!((low..=high).contains(&number(&rows[0], "makespan_ms")), "{}", rows[0]);
    assert_eq!((&rows[0]["limit"], rows[1]["limit"].is_string()), (&Value::Null, true));
    assert!((0.0..1.0).contains(&number(&rows[1], "others_share")), "{}", rows[1]);
    let law = &run.result["laws"][0];
    assert!(law["policy"] == "measured" && law["name"] == "Amdahl" && law["interval"].is_array(), "{law}");
    assert!(number(&rows[1], "bytes_per_frame") > 0.0 && number(&rows[1], "speedup_error") > 0.0, "{}", rows[1]);

    let (columns, lines) = run.csv("scale.csv");
    assert_eq!(lines.len(), 2, "{lines:?}");
    let bytes = columns.iter().position(|column| *column == "bytes_per_frame").unwrap();
    assert_eq!(lines[1][bytes].parse::<f64>().unwrap(), number(&rows[1], "bytes_per_frame"));
}

/// Each device has the same threads whatever the count, so that speed-ups compare devices of equal power. Measured and
/// simulated ones have the same base.
#[test]
fn all_counts_have_equal_threads_per_device() {
    let folder = Folder::new();
    let line = "scale builtin:checker --size 48x32 --counts 2 --simulate 2,4 --json --out ./";
    let result = folder.run(line).json();
    let (rows, simulated) = (result["rows"].as_array().unwrap(), result["simulated"].as_array().unwrap());
    let run = folder.json("run.json");
    let is_software = run["devices"][0]["threads"].is_number();
    let cores = std::thread::available_parallelism().unwrap().get();
    let expected = if is_software { Value::from((cores / 2).max(1)) } else { Value::Null };
    assert!(rows.iter().all(|row| row["threads_per_device"] == expected), "{rows:?}");
    assert_eq!(run["settings"]["threads_per_device"], expected);
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let base_ms = number(&rows[0], "makespan_ms");
    for row in simulated {
        assert_eq!(number(row, "base_ms"), base_ms);
        assert!((number(row, "speedup") - base_ms / number(row, "predicted_ms")).abs() < 1e-9, "{row}");
    }
    assert_eq!(simulated[0]["measured_ms"], rows[1]["makespan_ms"]);
}

#[test]
fn same_bytes_of_scaled_rows_of_views() {
    let folder = Folder::new();
    let result = scale(&folder, "--views 3 --baseline 0.01 --counts 2 --simulate 4 --report");
    assert!(folder.text("report.html").contains("All counts gave the same bytes."));
    let simulated: Vec<_> = result["simulated"].as_array().unwrap().iter().map(|row| &row["devices"]).collect();
    assert_eq!(simulated, [4, 1, 2]);
    let run = folder.json("run.json");
    let stages = run["frames"][0]["stages"].as_array().unwrap();
    let views = |stage: &str| stages.iter().filter(|sum| sum["stage"] == stage).count();
    assert_eq!((views("path_trace"), views("reproject"), views("svgf")), (1, 2, 3), "{stages:?}");
}

/// Counts may be given in any order.
#[test]
fn speedup_is_relative_to_one_device() {
    for (counts, expected) in [("2,1,2", &[1, 2][..]), ("1", &[1])] {
        let folder = Folder::new();
        let result = scale(&folder, &format!("--counts {counts}"));
        let rows = result["rows"].as_array().unwrap();
        let devices: Vec<u64> = rows.iter().map(|row| row["devices"].as_u64().unwrap()).collect();
        assert_eq!(devices, expected, "{counts}");
        let period_ms = |row: &Value| row["period_ms"].as_f64().unwrap();
        for row in rows {
            let [devices, speedup, efficiency] =
                ["devices", "speedup", "efficiency"].map(|name| row[name].as_f64().unwrap());
            assert_eq!(row["base_devices"], 1, "{row}");
            assert!((speedup - period_ms(&rows[0]) / period_ms(row)).abs() < 1e-9, "{row}");
            assert!((efficiency - speedup / devices).abs() < 1e-9, "{row}");
        }
        assert!(!folder.path("simulate.csv").exists());
        assert!(!folder.path("report.html").exists());
    }
}

/// A list with a value for each of two devices applies its first value to a run on one device. That run is measured as
/// the base although it is not among the counts.
#[test]
fn options_per_device_spare_the_run_on_one_device() {
    let folder = Folder::new();
    let result = scale(&folder, "--counts 2 --set slowdown=1,2 --ratios 2,1");
    let devices: Vec<_> = result["rows"].as_array().unwrap().iter().map(|row| &row["devices"]).collect();
    assert_eq!(devices, [1, 2]);
    let run = folder.json("run.json");
    let rows: Vec<&Value> = run["frames"].as_array().unwrap().iter().map(|frame| &frame["stripes"]).collect();
    assert!(*rows[0] == serde_json::json!([32]) && *rows[9] == serde_json::json!([21, 11]), "{rows:?}");
}

/// Ratios are those of the policy static alone.
#[test]
fn static_rows_have_ratios_beside_other_policies() {
    let folder = Folder::new();
    let result = scale(&folder, "--counts 2 --balance even,static --ratios 2,1");
    let policies: Vec<_> = result["rows"].as_array().unwrap().iter().map(|row| &row["policy"]).collect();
    assert_eq!(policies, ["even", "even", "static"]);
    let run = folder.json("run.json");
    let rows: Vec<&Value> = run["frames"].as_array().unwrap().iter().map(|frame| &frame["stripes"]).collect();
    assert!(*rows[9] == serde_json::json!([16, 16]) && *rows[14] == serde_json::json!([21, 11]), "{rows:?}");
}

#[test]
fn page_of_scale_is_complete() {
    let run = run("scale");
    assert_eq!(run.result["simulated"].as_array().unwrap().len(), 3);
    let page = run.text("report.html");
    for heading in ["Settings", "Devices", "Scene", "Scaling", "Simulation", "What limits each count"] {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "no {heading}");
    }
    assert!(page.contains("All counts gave the same bytes."));
    assert_eq!((page.matches("<svg").count(), page.matches("</table>").count()), (2, 6));
    assert!(page.contains(run.text("scale.svg").trim()));
    assert_eq!(run.text("simulate.csv").lines().count(), 4);
}

/// Each frame is timed while others are in flight before and behind it, which are not timed.
#[test]
fn frames_in_flight_are_timed_from_end_to_end() {
    for row in run("in flight").rows() {
        assert_eq!((&row["frames"], &row["periods"]), (&12.into(), &12.into()), "{row}");
        assert_eq!(row["period_ms"], row["interval_ms"], "{row}");
    }
}

/// A second passes in each turn. Before the turns, the time of other programs is read three times.
#[test]
fn turns_beside_busy_programs_do_not_count() {
    let cases: [(Share, u64, f64, &str); 3] = [
        (|_| 0.04, 12, 0.04, ""),
        (
            |reading| if reading < 3 + 7 { 0.0 } else { 0.5 },
            7,
            0.0,
            "50 % of the cores in 5 of 12 turns: these turns do",
        ),
        (
            |reading| if reading < 3 + 4 { 0.0 } else { 0.6 },
            12,
            0.4,
            "60 % of the cores in 8 of 12 turns: this run cannot",
        ),
    ];
    for (share, frames, of_frames, expected) in cases {
        let folder = Folder::new();
        let line = "scale builtin:checker --size 48x32 --counts 2 --threads-per-device 1 --warm-up 1 --out ./";
        let said = folder.run_beside(share, &format!("{line} --json"));
        let warnings: Vec<&str> = said.errors.lines().filter(|line| line.contains("other programs")).collect();
        assert!(warnings.len() == usize::from(!expected.is_empty()) && said.errors.contains(expected), "{warnings:?}");
        for row in said.json()["rows"].as_array().unwrap() {
            assert_eq!(row["frames"], frames, "{row}");
            assert!((row["others_share"].as_f64().unwrap() - of_frames).abs() < 1e-9, "{row}");
        }
        assert_eq!(folder.json("run.json")["frames"].as_array().unwrap().len(), 24);
    }
}

#[test]
fn every_measured_count_is_simulated() {
    let folder = Folder::new();
    let result = scale(&folder, "--counts 1,2 --simulate 4");
    let simulated = result["simulated"].as_array().unwrap();
    let devices: Vec<_> = simulated.iter().map(|row| row["devices"].as_u64().unwrap()).collect();
    assert_eq!(devices, [4, 1, 2]);
    assert!(simulated[0]["measured_ms"].is_null());
    let rows = result["rows"].as_array().unwrap();
    for (row, measured) in simulated[1..].iter().zip(rows) {
        assert_eq!(row["measured_ms"], measured["makespan_ms"], "{row}");
    }
    let off: Vec<String> = folder.text("simulate.csv").lines().map(|l| l.rsplit(',').next().unwrap().into()).collect();
    assert!(off[0] == "predicted_off" && off[1].is_empty() && off[2].parse::<f64>().is_ok(), "{off:?}");
}

/// Four devices render twice as many rows and columns.
#[test]
fn weak_scaling_lets_the_pixels_grow() {
    let folder = Folder::new();
    let result = scale(&folder, "--weak --counts 4 --report");
    let rows = result["rows"].as_array().unwrap();
    assert_eq!(rows.iter().map(|row| row["work"].as_f64().unwrap()).collect::<Vec<_>>(), [1.0, 4.0]);
    let number = |row: &Value, key: &str| row[key].as_f64().unwrap();
    let speedup = 4.0 * number(&rows[0], "period_ms") / number(&rows[1], "period_ms");
    assert!((number(&rows[1], "speedup") - speedup).abs() < 1e-9, "{}", rows[1]);
    let run = folder.json("run.json");
    let heights = |frame: usize| -> u64 {
        run["frames"][frame]["stripes"].as_array().unwrap().iter().map(|rows| rows.as_u64().unwrap()).sum()
    };
    assert_eq!((heights(0), heights(9)), (32, 64));
    assert!(folder.text("report.html").contains("Counts have different sizes."));
    folder.refuses(2, "scale builtin:checker --out ./out", "--weak --simulate 2 => --simulate");
}
