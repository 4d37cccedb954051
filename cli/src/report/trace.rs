//! Formats traces as text: the summary of a trace, the details of one frame, and the comparison of two traces.

use super::text_table;
use diptych::trace::Lane;
use diptych::trace::compare::{Change, Comparison};
use diptych::trace::rank_transfers::RankTransferSummary;
use diptych::trace::summary::{DeviceSummary, FrameDetail, PathShare, Summary, median};

/// Parts of the critical path below this fraction are combined into one.
const SMALL_SHARE: f64 = 0.005;

pub fn summary_text(summary: &Summary) -> String {
    let mut text = devices_table(&summary.devices) + "\n" + &totals(summary);
    if !summary.critical_path.is_empty() {
        text += "\ncritical path, mean of frames\n";
        text += &path_table(summary);
    }
    text + &rank_transfers_text(summary) + &notes(&summary.warnings)
}

pub fn frame_text(detail: &FrameDetail) -> String {
    let summary = &detail.summary;
    let mut text = devices_table(&summary.devices) + "\n" + &totals(summary);
    text += "\nstages, all devices together\n";
    let stages = summary.frames.iter().flat_map(|frame| &frame.stages);
    let rows: Vec<_> = stages.map(|s| vec![s.stage.clone(), s.lane.name().to_owned(), ms(s.time_ms)]).collect();
    text += &text_table(&["stage", "lane", "ms"], &rows);
    text += "\ncritical path, step by step\n";
    let rows: Vec<_> = detail
        .steps
        .iter()
        .map(|step| {
            let rows = step.rows.map_or(String::new(), |[begin, end]| format!("{begin}..{end}"));
            let what = path_name(&step.what, step.lane);
            vec![ms(step.begin_ms), ms(step.time_ms), device(step.pid, &summary.devices), what, rows]
        })
        .collect();
    text += &text_table(&["at ms", "ms", "device", "what", "rows"], &rows);
    text += "\ncritical path, summed\n";
    text += &path_table(summary);
    text + &rank_transfers_text(summary) + &notes(&summary.warnings)
}

pub fn comparison_text(comparison: &Comparison) -> String {
    let mut text = String::new();
    for (letter, side) in [("A", &comparison.a), ("B", &comparison.b)] {
        text += &format!("{letter}: {}, {} device(s), {} frame(s)\n", side.name, side.devices, side.frames);
    }
    text += "\nmedian frame\n";
    text += &changes_table(&comparison.frames);
    text += "\nstages and transfers, ms in the median frame, all devices together\n";
    text += &changes_table(&comparison.stages);
    text + &notes(&comparison.a.warnings) + &notes(&comparison.b.warnings)
}

fn changes_table(changes: &[Change]) -> String {
    let rows: Vec<_> = changes
        .iter()
        .map(|c| {
            let ratio = c.ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.3}"));
            let sign = if c.difference > 0.0 { "+" } else { "" };
            vec![c.what.clone(), ms(c.a), ms(c.b), format!("{sign}{:.3}", c.difference), ratio]
        })
        .collect();
    text_table(&["", "A", "B", "B - A", "B / A"], &rows)
}

fn devices_table(devices: &[DeviceSummary]) -> String {
    let rows: Vec<_> = devices
        .iter()
        .map(|d| {
            let residual = d.clock_residual_us.map_or("-".to_owned(), |us| format!("{us:.1}"));
            let [busy, transfer, hidden, idle] = [d.busy_ms, d.transfer_ms, d.hidden_transfer_ms, d.idle_ms].map(ms);
            vec![d.name.clone(), busy, percent(d.busy_share), transfer, hidden, idle, residual]
        })
        .collect();
    text_table(&["device", "busy ms", "busy", "transfer ms", "of it hidden", "idle ms", "clock error µs"], &rows)
}

fn totals(summary: &Summary) -> String {
    let mut text = String::new();
    let mut line = |what: &str, value: String| text += &format!("{what:18}{value}\n");
    let times_ms: Vec<f64> = summary.frames.iter().map(|frame| frame.makespan_ms).collect();
    let least_ms = times_ms.iter().copied().fold(f64::INFINITY, f64::min);
    let most_ms = times_ms.iter().copied().fold(0.0, f64::max);
    match (&summary.frames[..], median(times_ms)) {
        ([frame], _) => line("frame", format!("{}, makespan {:.3} ms", frame.frame, frame.makespan_ms)),
        ([..], Some(median_ms)) => {
            let count = summary.frames.len();
            let spread = format!("median {median_ms:.3} ms, least {least_ms:.3}, most {most_ms:.3}");
            line("frames", format!("{count}, makespan {spread}"));
        }
        _ => line("time", format!("{:.3} ms from the first task to the last", summary.total_ms)),
    }
    line("overlap", format!("{} with two or more devices busy", percent(summary.overlap_share)));
    if let Some(share) = summary.hidden_transfer_share {
        line("hidden transfers", format!("{} of transfer time", percent(share)));
    }
    if let Some(imbalance) = summary.imbalance {
        line("imbalance", format!("{imbalance:.3} (largest over mean busy time)"));
    }
    text
}

fn path_table(summary: &Summary) -> String {
    let (large, small): (Vec<&PathShare>, Vec<_>) =
        summary.critical_path.iter().partition(|part| part.share >= SMALL_SHARE);
    let row = |part: &&PathShare| {
        let what = path_name(&part.what, part.lane);
        vec![what, device(part.pid, &summary.devices), ms(part.ms_per_frame), percent(part.share)]
    };
    let mut rows: Vec<_> = large.iter().map(row).collect();
    if !small.is_empty() {
        let sum = |of: fn(&PathShare) -> f64| small.iter().map(|part| of(part)).sum();
        let what = format!("{} smaller parts", small.len());
        rows.push(vec![what, String::new(), ms(sum(|p| p.ms_per_frame)), percent(sum(|p| p.share))]);
    }
    text_table(&["what", "device", "ms", "share"], &rows)
}

/// Describes the transfers of rows between ranks, if there were any.
fn rank_transfers_text(summary: &Summary) -> String {
    let Some(passages) = &summary.passages else { return String::new() };
    let RankTransferSummary { count, bytes, waited_ms, parts } = passages;
    let rows: Vec<_> = parts
        .iter()
        .map(|part| {
            let us = |value: f64| format!("{value:.1}");
            let thread = if part.is_of_thread { "yes" } else { "" };
            vec![part.what.clone(), us(part.median_us), us(part.most_us), ms(part.waited_ms), thread.to_owned()]
        })
        .collect();
    let thread_ms = passages.thread_ms();
    let share = if *waited_ms > 0.0 { thread_ms / waited_ms } else { 0.0 };
    format!(
        "\nrows from rank to rank: {count}, of {bytes} bytes; workers waited for them for {waited_ms:.3} ms\n{}\
         MPI threads caused at most {thread_ms:.3} ms of the workers' wait, {} of it\n",
        text_table(&["rows", "median µs", "most µs", "waited ms", "MPI thread's"], &rows),
        percent(share)
    )
}

fn path_name(what: &str, lane: Option<Lane>) -> String {
    match lane {
        Some(lane) => format!("{what} {}", lane.name()),
        None => format!("wait: {what}"),
    }
}

/// Returns the index of the device with process id `pid` in `devices`; empty if there is no such device.
fn device(pid: u32, devices: &[DeviceSummary]) -> String {
    devices.iter().position(|d| d.pid == pid).map_or(String::new(), |number| number.to_string())
}

fn notes(warnings: &[String]) -> String {
    warnings.iter().map(|warning| format!("note: {warning}\n")).collect()
}

fn ms(value: f64) -> String {
    format!("{value:.3}")
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::trace::work::{Device, FrameTime, Task, Trace};

    /// Makes a trace with one frame of 10 ms: 2 ms before the first task, 6 ms of work on the left eye, then an upload.
    fn trace() -> Trace {
        let task = |lane, name: &str, begin_us, end_us| Task {
            pid: 10,
            lane,
            name: name.to_owned(),
            begin_us,
            end_us,
            frame: Some(4),
            rows: Some(0..90),
            transfer: None,
            order: None,
            submissions: None,
            bytes: Some(1000),
        };
        Trace {
            devices: [(10, Device { name: "gpu".to_owned(), clock_residual_us: Some(2.5) })].into(),
            tasks: vec![task(Lane::Left, "atrous", 2e3, 8e3), task(Lane::Upload, "linear", 9e3, 10e3)],
            frame_times: vec![FrameTime { frame: 4, begin_us: 0.0, end_us: 10e3, devices: None }],
            passages: Vec::new(),
            warnings: vec!["odd".to_owned()],
        }
    }

    #[test]
    fn summary_text_lists_devices_and_critical_path() {
        let expected = "\
device  busy ms    busy  transfer ms  of it hidden  idle ms  clock error µs
------  -------  ------  -----------  ------------  -------  --------------
gpu       6.000  60.0 %        1.000         0.000    3.000             2.5

frame             4, makespan 10.000 ms
overlap           0.0 % with two or more devices busy
hidden transfers  0.0 % of transfer time
imbalance         1.000 (largest over mean busy time)

critical path, mean of frames
what                  device     ms   share
--------------------  ------  -----  ------
atrous left                0  6.000  60.0 %
wait: start of frame       0  2.000  20.0 %
linear upload              0  1.000  10.0 %
wait: read-back            0  1.000  10.0 %
note: odd
";
        assert_eq!(summary_text(&Summary::of(&trace())), expected);
    }

    #[test]
    fn frame_text_lists_critical_path_steps() {
        let text = frame_text(&FrameDetail::of(&trace(), 4, "t").unwrap());
        let expected = "
critical path, step by step
at ms     ms  device  what                  rows
-----  -----  ------  --------------------  -----
0.000  2.000       0  wait: start of frame
2.000  6.000       0  atrous left           0..90
8.000  1.000       0  wait: read-back
9.000  1.000       0  linear upload         0..90
";
        assert!(text.contains(expected), "{text}");
    }

    #[test]
    fn comparison_text_lists_changes() {
        let (a, mut b) = (trace(), trace());
        b.tasks[0].end_us = 5e3;
        let text = comparison_text(&Comparison::of([(&a, "a.json"), (&b, "b.json")]).unwrap());
        for line in ["A: a.json, 1 device(s), 1 frame(s)", "atrous left  6.000  3.000  -3.000  0.500", "note: odd"] {
            assert!(text.contains(line), "no `{line}` in\n{text}");
        }
    }
}
