//! Tests of tables and charts of scaling.

use super::*;

fn row(devices: usize, makespan_ms: f64, idle_share: f64, imbalance: f64) -> ScaleRow {
    let (makespan_ms_iqr, period_ms, period_spread) = (0.09 * makespan_ms, makespan_ms, 0.09);
    let row = ScaleRow { devices, makespan_ms, makespan_ms_iqr, period_ms, period_spread, ..ScaleRow::default() };
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
fn half_of_the_values_lie_between_the_quartiles() {
    assert_eq!(interquartile_range(vec![5.0, 1.0, 2.0, 4.0, 3.0]), 2.0);
    assert_eq!(interquartile_range(vec![1.0, 2.0]), 0.5);
    assert_eq!(interquartile_range(Vec::new()), 0.0);
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
    let first = row(1, 100.0, 0.04, 1.0);
    // 96 ms of work in 4 times 40 ms; 128 ms of these are busy, 36 ms on the busiest device.
    let fourth = row(4, 40.0, 0.2, 1.125);
    let shares = fourth.shares(&first);
    let found = [shares.work, shares.more, shares.uneven, shares.waits];
    let expected = [0.6, 0.2, 0.1, 0.1];
    assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-12), "{found:?}");
    assert_eq!((shares.limit(), first.shares(&first).limit()), ("more work", "work"));
}

#[test]
fn oversubscription_note_appears_only_if_needed() {
    let rows = [row(1, 100.0, 0.04, 1.0).over(None)];
    let notes = |rows: &[ScaleRow]| scale_sections(rows, String::new())[0].notes.len();
    assert_eq!((notes(&rows), notes(&[ScaleRow { oversubscribed: true, ..rows[0].clone() }])), (1, 2));
}
