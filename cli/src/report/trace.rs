//! Formats traces as text: the summary of a trace, the details of one frame, and the comparison of two traces.

use super::{cell, percent, text_table};
use diptych::trace::Lane;
use diptych::trace::compare::{Change, Comparison};
use diptych::trace::deadline::DisplayedFrame;
use diptych::trace::late::{CauseSum, LateSummary};
use diptych::trace::rank_transfers::{RankTransferSummary, TransferStep};
use diptych::trace::summary::{DeviceSummary, FrameDetail, PathShare, Step, Summary, median};

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
    let row = |step: &Step| {
        let rows = step.rows.map_or(String::new(), |[begin, end]| format!("{begin}..{end}"));
        let what = path_name(&step.what, step.lane);
        let predicted = cell(step.predicted_ms, 3);
        vec![ms(step.begin_ms), ms(step.time_ms), predicted, device(step.pid, &summary.devices), what, rows]
    };
    let rows: Vec<_> = detail.steps.iter().map(row).collect();
    text += &text_table(&["at ms", "ms", "predicted", "device", "what", "rows"], &rows);
    text += "\ncritical path, summed\n";
    text += &path_table(summary);
    text + &rank_transfers_text(summary) + &notes(&summary.warnings)
}

pub fn late_text(found: &LateSummary) -> String {
    let LateSummary { frames, period_ms, causes, late } = found;
    let on_time = percent((frames - late.len()) as f64 / *frames as f64);
    let mut text =
        format!("{on_time} of {frames} frames on time, {} late; a frame is due every {period_ms:.3} ms\n", late.len());
    if late.is_empty() {
        return text;
    }
    let row = |sum: &CauseSum| {
        let (frames, missed) = (sum.frames.to_string(), sum.missed_periods.to_string());
        vec![sum.cause.clone(), frames, missed, ms(sum.over_deadline_ms), ms(sum.most_ms)]
    };
    let headers = ["cause", "frames", "missed periods", "late ms, sum", "most"];
    text += &format!("\n{}", text_table(&headers, &causes.iter().map(row).collect::<Vec<_>>()));
    let row = |frame: &DisplayedFrame| {
        let times = [frame.over_deadline_ms, frame.whole_ms, frame.host_before_ms, frame.makespan_ms];
        let mut line = vec![frame.frame.to_string()];
        line.extend(times.map(ms));
        line.extend([cell(frame.expected_ms, 3), ms(frame.host_after_ms)]);
        line.push(frame.rung.map_or(String::new(), |rung| rung.to_string()));
        line.push(frame.others_share.map_or(String::new(), percent));
        line.push(frame.cause.clone().unwrap_or_default());
        line
    };
    let headers = [
        "frame",
        "late ms",
        "whole ms",
        "host before",
        "makespan",
        "expected",
        "host after",
        "rung",
        "others",
        "cause",
    ];
    text += &format!(
        "\nlate frames, the longest delay first\n{}",
        text_table(&headers, &late.iter().map(row).collect::<Vec<_>>())
    );
    text + "\n`diptych trace FILE --frame N` shows the critical path of a frame beside its prediction\n"
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
    let row = |c: &Change| {
        let sign = if c.difference > 0.0 { "+" } else { "" };
        vec![c.what.clone(), ms(c.a), ms(c.b), format!("{sign}{:.3}", c.difference), cell(c.ratio, 3)]
    };
    text_table(&["", "A", "B", "B - A", "B / A"], &changes.iter().map(row).collect::<Vec<_>>())
}

fn devices_table(devices: &[DeviceSummary]) -> String {
    let row = |d: &DeviceSummary| {
        let [busy, transfer, hidden, idle] = [d.busy_ms, d.transfer_ms, d.hidden_transfer_ms, d.idle_ms].map(ms);
        vec![d.name.clone(), busy, percent(d.busy_share), transfer, hidden, idle, cell(d.clock_residual_us, 1)]
    };
    let headers = ["device", "busy ms", "busy", "transfer ms", "of it hidden", "idle ms", "clock error µs"];
    text_table(&headers, &devices.iter().map(row).collect::<Vec<_>>())
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
    let row = |part: &TransferStep| {
        let us = |value: f64| format!("{value:.1}");
        let thread = if part.is_of_thread { "yes" } else { "" };
        vec![part.what.clone(), us(part.median_us), us(part.most_us), ms(part.waited_ms), thread.to_owned()]
    };
    let rows: Vec<_> = parts.iter().map(row).collect();
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
