//! Live status in the terminal: a line per device, and recent frame times relative to the frame budget.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::report::run::FrameRow;
use diptych::control::Budget;
use diptych::device::DeviceInfo;

use crate::progress::Progress;

/// Minimum time between redraws.
const REDRAW: Duration = Duration::from_millis(100);
/// Number of frames on the sparkline.
const SHOWN: usize = 60;
/// Width of a device's name in terminal columns.
const NAME: usize = 24;
/// Width of a device's bar in terminal columns.
const BAR: usize = 24;

/// The status display. Counts every frame, but formats text only for a redraw.
pub struct StatusLines {
    band_ms: [f64; 2],
    denoiser: &'static str,
    rungs: usize,
    /// Number of frames to render, if known.
    wanted: Option<u32>,
    names: Vec<String>,
    recent_ms: VecDeque<f64>,
    frames: usize,
    in_band: usize,
    drawn: Option<Instant>,
}

impl StatusLines {
    pub fn new(band: Budget, gpus: &[DeviceInfo], denoiser: &'static str, rungs: usize, wanted: Option<u32>) -> Self {
        let names = gpus.iter().map(|d| format!("dev{} {}", d.index, d.name)).collect();
        let band_ms = [band.lo_ms(), band.hi_ms()];
        Self { band_ms, denoiser, rungs, wanted, names, recent_ms: VecDeque::new(), frames: 0, in_band: 0, drawn: None }
    }

    /// Adds a frame, with the time that each device was busy, and redraws on a terminal.
    pub fn observe(&mut self, row: &FrameRow, busy_ms: &[f64], progress: &Progress) {
        self.recent_ms.truncate(SHOWN - 1);
        self.recent_ms.push_front(row.makespan_ms);
        self.frames += 1;
        self.in_band += usize::from(row.control.is_some_and(|c| c.in_band));
        if progress.is_drawn() && self.drawn.is_none_or(|at| at.elapsed() >= REDRAW) {
            progress.draw(self.text(row, busy_ms));
            self.drawn = Some(Instant::now());
        }
    }

    fn text(&self, row: &FrameRow, busy_ms: &[f64]) -> String {
        let rows: u32 = row.stripes.iter().sum();
        let device = |((name, stripe), busy_ms): ((&String, &u32), &f64)| {
            device_line(name, f64::from(*stripe) / f64::from(rows.max(1)), busy_ms / row.makespan_ms)
        };
        let mut lines: Vec<String> = self.names.iter().zip(&row.stripes).zip(busy_ms).map(device).collect();
        let times: Vec<f64> = self.recent_ms.iter().rev().copied().collect();
        let [lo_ms, hi_ms] = self.band_ms;
        lines.push(format!("{} {:.1} ms", sparkline(&times, self.band_ms), row.makespan_ms));
        lines.push(format!(
            "{} frames, {:.1} % within {lo_ms} to {hi_ms} ms",
            self.wanted.map_or(self.frames.to_string(), |wanted| format!("{} of {wanted}", self.frames)),
            100.0 * self.in_band as f64 / self.frames as f64,
        ));
        let rung = row.control.map_or(0, |c| c.rung);
        let (last, denoiser) = (self.rungs.saturating_sub(1), self.denoiser);
        lines.push(format!("rung {rung} of 0 to {last}: {denoiser}, {}", row.quality));
        lines.join("\n")
    }
}

/// Formats a device with its fraction of the rows and the fraction of the last frame in which it was busy.
fn device_line(name: &str, rows_share: f64, busy_share: f64) -> String {
    let name = match name.char_indices().nth(NAME - 1) {
        Some((end, last)) if end + last.len_utf8() < name.len() => format!("{}…", &name[..end]),
        _ => name.to_owned(),
    };
    let [rows, busy] = [rows_share, busy_share].map(|share| 100.0 * share);
    format!("{name:NAME$} {} {rows:3.0} % of rows, {busy:3.0} % busy", bar(rows_share))
}

/// Formats a fraction from 0 to 1 as a bar of [`BAR`] columns, with a resolution of an eighth of a column.
fn bar(share: f64) -> String {
    const PARTS: [char; 8] = [' ', '▏', '▎', '▍', '▌', '▋', '▊', '▉'];
    let eighths = (share.clamp(0.0, 1.0) * (8 * BAR) as f64).round() as usize;
    let filled = std::iter::repeat_n('█', eighths / 8);
    filled.chain([PARTS[eighths % 8]]).chain(std::iter::repeat(' ')).take(BAR).collect()
}

/// Formats each frame time as one character. The two lowest levels stand for times below the budget, the next four for
/// times within it, and the two highest for times above it: the highest for more than twice the budget's upper end.
fn sparkline(times_ms: &[f64], [lo_ms, hi_ms]: [f64; 2]) -> String {
    let column = |ms: f64| match ms {
        _ if ms < 0.5 * lo_ms => '▁',
        _ if ms < lo_ms => '▂',
        _ if ms <= hi_ms => {
            let steps = (4.0 * (ms - lo_ms) / (hi_ms - lo_ms)) as usize;
            ['▃', '▄', '▅', '▆'][steps.min(3)]
        }
        _ if ms <= 2.0 * hi_ms => '▇',
        _ => '█',
    };
    times_ms.iter().map(|ms| column(*ms)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sparkline_distinguishes_below_within_and_above() {
        let times = [1.0, 5.9, 6.0, 11.9, 12.0, 13.9, 14.0, 16.0, 18.0, 20.0, 20.1, 40.0, 40.1, f64::INFINITY];
        assert_eq!(sparkline(&times, [12.0, 20.0]), "▁▁▂▂▃▃▄▅▆▆▇▇██");
    }

    #[test]
    fn bars_have_one_width_and_grow_by_eighths() {
        assert_eq!(bar(0.0), " ".repeat(BAR));
        assert_eq!(bar(0.5), format!("{}{}", "█".repeat(12), " ".repeat(12)));
        assert_eq!(bar(1.0 / (8 * BAR) as f64), format!("▏{}", " ".repeat(BAR - 1)));
        assert!([-1.0, 0.33, 0.999, 1.0, 7.0, f64::NAN].iter().all(|s| bar(*s).chars().count() == BAR));
    }

    #[test]
    fn device_lines_align_within_80_columns() {
        let long = device_line("dev0 llvmpipe (LLVM 15.0.6, 256 bits)", 1.0, 1.0);
        assert_eq!(long, format!("dev0 llvmpipe (LLVM 15.… {} 100 % of rows, 100 % busy", "█".repeat(BAR)));
        let short = device_line("dev1 Größe", 0.25, 0.074);
        assert!(short.starts_with("dev1 Größe               ██████ ") && short.ends_with("  25 % of rows,   7 % busy"));
        assert_eq!(short.chars().count(), long.chars().count());
        assert!(long.chars().count() <= 80);
    }
}
