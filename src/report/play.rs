//! Reports how well a budget was kept.

use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::run::FrameRow;
use super::study::cell;
use super::{Table, median_of};
use crate::control::{Measure, Rung};
use crate::quality::FrameQuality;

/// The number of frames before the control loop is judged.
pub const SETTLING_FRAMES: usize = 30;

/// What the control loop did with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct ControlRow {
    /// The number of the rung in the ladder, from 0.
    pub rung: usize,
    /// The expected time of the rung, which is the corrected prediction of the cost model.
    pub expected_ms: f64,
    /// Whether any rung was expected to be within the budget.
    pub fits: bool,
    pub in_band: bool,
    /// The time between when the frame was due and when it was begun.
    pub late_ms: f64,
    /// The host time that choosing the rung took.
    pub decide_ms: f64,
}

/// A rung and the share of frames that it had.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RungUse {
    pub rung: usize,
    pub denoiser: &'static str,
    #[serde(flatten)]
    pub quality: FrameQuality,
    /// The median of the expected times of its frames.
    pub expected_ms: f64,
    /// The error by the ladder's measure, where it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
    /// Whether the error is an estimate, as the rung's time was before it was played.
    pub estimated: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_error: Option<f64>,
    pub share: f64,
}

/// Says that the budget could not be kept at the size that was asked for, and at which size it can.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SizeFit {
    /// The size of each eye.
    pub asked_size: String,
    /// The median time of the cheapest rung at that size.
    pub asked_ms: f64,
    /// A smaller size at which the budget can be kept, if one was found.
    pub fitting_size: Option<String>,
    pub fitting_ms: Option<f64>,
    pub played_size: String,
}

/// A run of frames outside the band.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Excursion {
    pub first_frame: u32,
    pub frames: u32,
}

/// How a run kept its budget, judged over the frames after the first [`SETTLING_FRAMES`], or all of a shorter run.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PlaySummary {
    pub budget_ms: [f64; 2],
    pub denoiser: &'static str,
    /// The origin of the ladder, the measure of its errors, and its number of rungs.
    pub ladder: String,
    pub measure: Measure,
    pub rungs: usize,
    pub fps: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<SizeFit>,
    pub judged_frames: usize,
    pub in_band_share: f64,
    pub above_share: f64,
    pub below_share: f64,
    pub makespan_ms_p50: f64,
    pub makespan_ms_p95: f64,
    pub makespan_ms_p99: f64,
    /// Frames that were begun more than a millisecond after they were due.
    pub late_share: f64,
    pub rung_changes: usize,
    pub longest_excursion: Option<Excursion>,
    pub rung_uses: Vec<RungUse>,
}

/// What all frames of a run have in common.
#[derive(Clone, Debug)]
pub struct Play {
    pub budget_ms: [f64; 2],
    pub denoiser: &'static str,
    pub ladder: String,
    pub measure: Measure,
    pub rungs: Vec<Rung>,
    pub fps: f64,
    pub fit: Option<SizeFit>,
}

const LATE_MS: f64 = 1.0;

impl PlaySummary {
    /// The summary of rows that the control loop made, none without any.
    pub fn of(play: &Play, rows: &[FrameRow]) -> Option<Self> {
        let skipped = if rows.len() > SETTLING_FRAMES { SETTLING_FRAMES } else { 0 };
        let judged: Vec<(&FrameRow, &ControlRow)> =
            rows[skipped..].iter().filter_map(|r| Some((r, r.control.as_ref()?))).collect();
        let share = |is: &dyn Fn(&(&FrameRow, &ControlRow)) -> bool| {
            judged.iter().filter(|row| is(row)).count() as f64 / judged.len() as f64
        };
        let [lo_ms, hi_ms] = play.budget_ms;
        let mut times_ms: Vec<f64> = judged.iter().map(|(r, _)| r.makespan_ms).collect();
        times_ms.sort_by(f64::total_cmp);
        let quantile = |q: f64| times_ms.get((q * (times_ms.len() - 1) as f64).round() as usize).copied();
        (!judged.is_empty()).then_some(())?;
        Some(Self {
            budget_ms: play.budget_ms,
            denoiser: play.denoiser,
            ladder: play.ladder.clone(),
            measure: play.measure,
            rungs: play.rungs.len(),
            fps: play.fps,
            fit: play.fit.clone(),
            judged_frames: judged.len(),
            in_band_share: share(&|(_, c)| c.in_band),
            above_share: share(&|(r, _)| r.makespan_ms > hi_ms),
            below_share: share(&|(r, _)| r.makespan_ms < lo_ms),
            makespan_ms_p50: quantile(0.5)?,
            makespan_ms_p95: quantile(0.95)?,
            makespan_ms_p99: quantile(0.99)?,
            late_share: share(&|(_, c)| c.late_ms > LATE_MS),
            rung_changes: judged.windows(2).filter(|pair| pair[0].1.rung != pair[1].1.rung).count(),
            longest_excursion: longest_excursion(&judged),
            rung_uses: rung_uses(play, &judged),
        })
    }

    /// Describes how the budget was kept, in words and rounded numbers.
    pub fn table(&self) -> Table {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let ms = |ms: f64| format!("{ms:.1} ms");
        let [lo_ms, hi_ms] = self.budget_ms;
        let rows = [
            ("budget", format!("{lo_ms} to {hi_ms} ms")),
            ("frames judged", self.judged_frames.to_string()),
            ("within the budget", percent(self.in_band_share)),
            ("longer", percent(self.above_share)),
            ("shorter", percent(self.below_share)),
            ("begun late", percent(self.late_share)),
            ("median makespan", ms(self.makespan_ms_p50)),
            ("95th percentile", ms(self.makespan_ms_p95)),
            ("99th percentile", ms(self.makespan_ms_p99)),
            ("changes of the rung", self.rung_changes.to_string()),
            ("longest excursion", self.longest_excursion.as_ref().map_or("none".to_owned(), ToString::to_string)),
        ];
        let rows = rows.map(|(name, value)| vec![name.to_owned(), value]).into();
        Table { headers: vec!["what", "value"], rows }
    }

    /// The rungs that were used, from the cheapest.
    pub fn rungs_table(&self) -> Table {
        let row = |u: &RungUse| {
            let FrameQuality { spp, bounces, iterations, scale, fovea } = u.quality;
            let mut line = vec![u.rung.to_string()];
            line.extend([spp, bounces].map(|n| n.to_string()));
            line.extend([u.denoiser.to_owned(), iterations.to_string(), scale.to_string()]);
            line.push(fovea.map_or("none".to_owned(), |[inner, outer]| format!("{inner}, {outer}")));
            line.extend([format!("{:.1}", u.expected_ms), cell(u.error.or(u.estimated_error), 4)]);
            line.push(if u.estimated { "estimated" } else { "measured" }.to_owned());
            line.push(format!("{:.1} %", 100.0 * u.share));
            line
        };
        let error = match self.measure {
            Measure::Estimate => "error",
            measured => measured.name(),
        };
        let mut headers = vec!["rung", "spp", "bounces", "denoiser", "iterations", "scale", "layers"];
        headers.extend(["expected ms", error, "which is", "frames"]);
        Table { headers, rows: self.rung_uses.iter().map(row).collect() }
    }
}

fn longest_excursion(judged: &[(&FrameRow, &ControlRow)]) -> Option<Excursion> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (i, _) in judged.iter().enumerate().filter(|(_, (_, control))| !control.in_band) {
        match runs.last_mut().filter(|run| run.end == i) {
            Some(run) => run.end += 1,
            None => runs.push(i..i + 1),
        }
    }
    let longest = runs.into_iter().rev().max_by_key(ExactSizeIterator::len)?;
    Some(Excursion { first_frame: judged[longest.start].0.index, frames: longest.len() as u32 })
}

fn rung_uses(play: &Play, judged: &[(&FrameRow, &ControlRow)]) -> Vec<RungUse> {
    let mut frames: BTreeMap<usize, Vec<(&FrameRow, &ControlRow)>> = BTreeMap::new();
    for frame in judged {
        frames.entry(frame.1.rung).or_default().push(*frame);
    }
    let of = |(rung, frames): (usize, Vec<(&FrameRow, &ControlRow)>)| {
        let quality = frames[0].0.quality;
        let known = play.rungs.get(rung);
        // With fewer iterations than the rung has, its error is not known either.
        let estimated = known.is_none_or(|r| r.is_estimated || r.quality.most_iterations() != quality.iterations);
        let error = known.map(|r| r.error);
        RungUse {
            rung,
            denoiser: play.denoiser,
            quality,
            expected_ms: median_of(frames.iter().map(|(_, c)| c.expected_ms).collect()),
            error: error.filter(|_| !estimated),
            estimated,
            estimated_error: error.filter(|_| estimated),
            share: frames.len() as f64 / judged.len() as f64,
        }
    };
    frames.into_iter().map(of).collect()
}

impl fmt::Display for Excursion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} frame(s) from frame {} on", self.frames, self.first_frame)
    }
}

impl fmt::Display for PlaySummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let [lo_ms, hi_ms] = self.budget_ms;
        writeln!(
            f,
            "{} of {} frames took {lo_ms} to {hi_ms} ms; {} took longer, {} less; {} were begun late",
            percent(self.in_band_share),
            self.judged_frames,
            percent(self.above_share),
            percent(self.below_share),
            percent(self.late_share),
        )?;
        let [p50, p95, p99] = [self.makespan_ms_p50, self.makespan_ms_p95, self.makespan_ms_p99];
        write!(f, "makespan ms: median {p50:.1}, 95 % {p95:.1}, 99 % {p99:.1}; {} rung changes; ", self.rung_changes)?;
        match &self.longest_excursion {
            Some(excursion) => write!(f, "longest excursion: {excursion}"),
            None => write!(f, "no excursion"),
        }
    }
}
