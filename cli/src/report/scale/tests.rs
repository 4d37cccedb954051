//! Tests of tables and charts of scaling.

use super::chart::{Law, scale_sections, scale_svg};
use super::*;

fn row(devices: usize, makespan_ms: f64, idle_share: f64, imbalance: f64) -> ScaleRow {
    let (makespan_ms_iqr, period_ms, period_spread) = (0.09 * makespan_ms, makespan_ms, 0.09);
    let row = ScaleRow { devices, makespan_ms, makespan_ms_iqr, period_ms, period_spread, ..ScaleRow::default() };
    let row = ScaleRow { work: 1.0, ..row };
    ScaleRow { frames: 10, periods: 9, idle_share, imbalance, ..row }
}

#[test]
fn scale_csv_begins_with_known_columns() {
    let table = scale_csv(&[row(2, 50.0, 0.0, 1.0).over(Some(&row(1, 80.0, 0.0, 1.0).over(None)))]);
    let known = "devices,makespan_ms,makespan_ms_min,makespan_ms_max,speedup,efficiency,imbalance,transfer_share,\
        oversubscribed,base_devices,";
    assert!(table.columns.join(",").starts_with(known), "{:?}", table.columns);
    let found = ["devices", "makespan_ms", "speedup", "efficiency", "base_devices", "makespan_ms_iqr"];
    assert_eq!(found.map(|name| table.value(0, name)), ["2", "50.0000", "1.6000", "0.8000", "1", "4.5000"]);
    assert_eq!(table.value(0, "prediction_error"), "");
}

#[test]
fn policy_column_appears_for_several_policies() {
    let of = |devices, policy: &str| ScaleRow { policy: policy.to_owned(), ..row(devices, 50.0, 0.0, 1.0) };
    let rows = [of(1, "even"), of(2, "even"), of(2, "mine")];
    let table = scale_table(&rows);
    assert_eq!((table.headers[1], table.rows[2][1].as_str()), ("policy", "mine"));
    assert_eq!(scale_table(&rows[..2]).headers[1], "makespan ms");
    assert_eq!(scale_csv(&rows).value(2, "policy"), "mine");
    let figure = scale_svg("two policies".to_owned(), &rows).unwrap();
    assert!(figure.contains("mine") && figure.contains("even"));
}

#[test]
fn speedup_error_combines_both_times() {
    let first = row(1, 100.0, 0.0, 1.0).over(None);
    assert_eq!((first.speedup, first.speedup_error, first.efficiency), (1.0, 0.0, 1.0));
    let second = row(2, 50.0, 0.0, 1.0).over(Some(&first));
    assert_eq!((second.speedup, second.efficiency), (2.0, 1.0));
    // 1.25 * 0.09 / (1.35 * 3) for each of the two times.
    let expected = 2.0 * 2f64.sqrt() * 0.1125 / 4.05;
    assert!((second.speedup_error - expected).abs() < 1e-12, "{}", second.speedup_error);
}

#[test]
fn losses_and_work_are_all_of_the_time() {
    let first = row(1, 100.0, 0.04, 1.0).over(None);
    // 96 ms of work in 4 times 40 ms; 128 ms of these are busy, 36 ms on the busiest device.
    let mut fourth = row(4, 40.0, 0.2, 1.125);
    fourth.causes.serial_ms = 1.0;
    fourth.causes.path = vec![("path_trace".into(), 0.7), ("transfers".into(), 0.05), ("waits".into(), 0.25)];
    let fourth = fourth.over(Some(&first));
    let Losses { lost_slower, lost_redundant, lost_imbalance, lost_transfers, lost_serial, lost_waits } = fourth.losses;
    let found = [lost_slower, lost_redundant, lost_imbalance, lost_transfers, lost_serial, lost_waits];
    let expected = [0.2, 0.0, 0.1, 0.05, 0.025, 0.025];
    assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-12), "{found:?}");
    assert_eq!((fourth.limit, first.limit), (Some("slower stages"), None));
}

#[test]
fn largest_loss_limits_the_speedup() {
    let none = Losses::default();
    for (losses, on_cores, expected) in [
        (Losses { lost_slower: 0.04, ..none }, true, "work"),
        (Losses { lost_slower: 0.2, lost_waits: 0.1, ..none }, true, "cores"),
        (Losses { lost_slower: 0.2, lost_waits: 0.1, ..none }, false, "slower stages"),
        (Losses { lost_slower: -0.2, lost_redundant: 0.3, ..none }, true, "too few rows"),
        (Losses { lost_transfers: 0.2, lost_imbalance: 0.1, ..none }, true, "transfers"),
        (Losses { lost_serial: 0.2, lost_imbalance: 0.1, ..none }, true, "serial part"),
    ] {
        assert_eq!(losses.limit(on_cores), expected);
    }
}

/// Load that comes in the last turns slows both counts, or only two devices.
#[test]
fn interval_contains_the_speedup_beside_other_load() {
    let turns = |quiet_ms: f64, busy_ms: f64, quiet: usize| [vec![quiet_ms; quiet], vec![busy_ms; 12 - quiet]].concat();
    for (base_ms, own_ms) in [(180.0, 100.0), (100.0, 90.0)] {
        let first = ScaleRow { turns_ms: turns(100.0, base_ms, 6), ..row(1, 100.0, 0.0, 1.0) }.over(None);
        let second = ScaleRow { turns_ms: turns(55.0, own_ms, 6), ..row(2, 55.0, 0.0, 1.0) }.over(Some(&first));
        let (low, high) = (second.speedup_low.unwrap(), second.speedup_high.unwrap());
        assert!((low..=high).contains(&(100.0 / 55.0)), "{low} {high}");
    }
    let few = ScaleRow { turns_ms: vec![1.0; 5], ..row(2, 55.0, 0.0, 1.0) }.over(Some(&row(1, 100.0, 0.0, 1.0)));
    assert_eq!((few.speedup_low, few.speedup_high), (None, None));
}

#[test]
fn efficiency_above_one_has_a_warning() {
    let first = row(1, 100.0, 0.0, 1.0).over(None);
    let warning = |ms| row(2, ms, 0.0, 1.0).over(Some(&first)).warning();
    assert_eq!((first.warning(), warning(50.0)), (None, None));
    assert!(warning(40.0).unwrap().contains("the efficiency of 2 devices is 1.25, above 1"));
}

#[test]
fn amdahl_fit_recovers_the_serial_part() {
    let of = |devices: usize, share: f64| {
        let ms = 100.0 * (share + (1.0 - share) / devices as f64);
        ScaleRow { policy: "mine".into(), turns_ms: vec![ms; 8], ..row(devices, ms, 0.0, 1.0) }
    };
    let laws = Law::of_rows(&[of(1, 0.2), of(2, 0.2), of(4, 0.2)]);
    let [Law { policy, name: "Amdahl", serial_share, interval: Some([low, high]) }] = &laws[..] else {
        panic!("{laws:?}")
    };
    assert!(policy == "mine" && (serial_share - 0.2).abs() < 1e-9, "{laws:?}");
    assert!((low..=high).contains(&serial_share) && high - low < 1e-9, "{laws:?}");
    assert!(laws[0].to_string().ends_with(
        "20.0 % of the time is serial (20.0 to 20.0), at most 5.0 times as fast with any number of devices"
    ));
    let oversubscribed = ScaleRow { oversubscribed: true, ..of(2, 0.2) };
    assert_eq!(Law::of_rows(&[of(1, 0.2), oversubscribed]), []);
    assert_eq!(Law::of_rows(&[]), []);
}

/// Two devices render twice the pixels in 1.1 times the time.
#[test]
fn gustafson_fit_recovers_the_serial_part() {
    let of = |devices: usize, ms: f64| ScaleRow {
        work: devices as f64,
        turns_ms: vec![ms; 8],
        ..row(devices, ms, 0.0, 1.0)
    };
    let first = of(1, 100.0).over(None);
    let second = of(2, 110.0).over(Some(&first));
    assert!((second.speedup - 2.0 / 1.1).abs() < 1e-9 && second.speedup_low.unwrap() > 1.8, "{second:?}");
    let laws = Law::of_rows(&[first, second]);
    let [Law { name: "Gustafson", serial_share, interval: Some(_), .. }] = &laws[..] else { panic!("{laws:?}") };
    assert!((serial_share - (2.0 - 2.0 / 1.1)).abs() < 1e-9 && !laws[0].to_string().contains("at most"), "{laws:?}");
}

#[test]
fn chart_names_the_limit_of_each_count() {
    let first = row(1, 100.0, 0.0, 1.0).over(None);
    let second = row(2, 60.0, 0.3, 1.0).over(Some(&first));
    let figure = scale_svg("checker".to_owned(), &[first, second]).unwrap();
    for text in ["ideal", "measured", "Amdahl&apos;s law, 20 % serial", "waits"] {
        assert!(figure.contains(text), "{text}: {figure}");
    }
}

#[test]
fn oversubscription_note_appears_only_if_needed() {
    let rows = [row(1, 100.0, 0.04, 1.0).over(None)];
    let notes = |rows: &[ScaleRow]| scale_sections(rows, String::new())[0].notes.len();
    assert_eq!((notes(&rows), notes(&[ScaleRow { oversubscribed: true, ..rows[0].clone() }])), (1, 2));
}
