//! Reports how well a run kept its time budget.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use super::frame_row::FrameRow;
pub use super::frame_row::{ControlRow, DeadlineRow};
use super::quantiles::Quantiles;
use super::{Table, cell, percent};
use diptych::control::{Measure, Rung};
use diptych::quality::FrameQuality;

/// Number of frames at the start of a run that the summary leaves out, while the control loop settles.
pub const SETTLING_FRAMES: usize = 30;

/// A rung, with the fraction of frames that used it.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct RungUse {
    pub rung: usize,
    pub denoiser: &'static str,
    #[serde(flatten)]
    pub quality: FrameQuality,
    /// Median, over the frames that used the rung, of the makespan that the control loop expected.
    pub expected_ms: f64,
    /// Error by the ladder's measure, if it was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
    /// True if the error is an estimate instead of a measurement. `estimated_error` then holds it.
    pub estimated: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub estimated_error: Option<f64>,
    pub share: f64,
}

/// Report that the budget cannot be kept at the requested size, with a smaller size at which it can be kept.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct SizeFit {
    /// Requested image size per eye.
    pub asked_size: String,
    /// Median time of the cheapest rung at the requested size.
    pub asked_ms: f64,
    /// A smaller size at which the budget can be kept, if there is one.
    pub fitting_size: Option<String>,
    pub fitting_ms: Option<f64>,
    pub played_size: String,
}

/// Number of frames that were late for the same cause.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CauseCount {
    pub cause: String,
    pub frames: usize,
}

/// A sequence of consecutive frames above the budget.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Excursion {
    pub first_frame: u32,
    pub frames: u32,
}

/// Summary of how well a run kept its time budget. It covers the frames after the first [`SETTLING_FRAMES`], or all
/// frames of a shorter run.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct PlaySummary {
    pub budget_ms: [f64; 2],
    pub denoiser: &'static str,
    /// Origin of the ladder, measure of its errors, and number of its rungs.
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
    /// Fraction of frames that began more than a millisecond after they were due.
    pub late_share: f64,
    /// Fraction of display periods that showed no new frame because none was complete: the sum of `missed_periods` over
    /// that sum plus the number of frames.
    pub missed_fraction: f64,
    /// Fraction of frames that were complete at the refresh at which they were due.
    pub on_time_share: f64,
    /// Causes of the other frames with their numbers of frames, the most frequent first.
    pub late_causes: Vec<CauseCount>,
    pub rung_changes: usize,
    pub longest_excursion: Option<Excursion>,
    pub rung_uses: Vec<RungUse>,
}

/// Settings that all frames of a run share.
#[derive(Clone, Debug)]
pub struct Play {
    pub denoiser: &'static str,
    pub ladder: String,
    pub measure: Measure,
    pub rungs: Vec<Rung>,
    pub fps: f64,
    pub fit: Option<SizeFit>,
}

const LATE_MS: f64 = 1.0;
/// Number of causes of late frames that the summary names.
const CAUSES_SHOWN: usize = 4;

/// Sums over the frames of a run, in memory that does not grow with their number.
#[derive(Clone, Debug)]
pub struct PlayTally {
    budget_ms: [f64; 2],
    /// Number of frames added so far.
    rows: usize,
    /// Sums over the first [`SETTLING_FRAMES`], which are reported only if there are no later frames.
    settling: Judged,
    judged: Judged,
    /// True if there was a frame for which no rung was expected to fit the budget.
    pub lacked_rung: bool,
}

impl PlayTally {
    pub fn new(budget_ms: [f64; 2]) -> Self {
        let [settling, judged] = Default::default();
        Self { budget_ms, rows: 0, settling, judged, lacked_rung: false }
    }

    /// Adds the row of a frame.
    pub fn add(&mut self, row: &FrameRow) {
        let part = if self.rows < SETTLING_FRAMES { &mut self.settling } else { &mut self.judged };
        self.rows += 1;
        if let Some(control) = &row.control {
            part.add(row, control, self.budget_ms);
            self.lacked_rung |= !control.fits;
        }
    }

    /// Returns the summary of the frames with a control decision; `None` if there were none.
    pub fn summary(&self, play: &Play) -> Option<PlaySummary> {
        let judged = if self.rows > SETTLING_FRAMES { &self.judged } else { &self.settling };
        let share = |frames: usize| frames as f64 / judged.frames as f64;
        Some(PlaySummary {
            budget_ms: self.budget_ms,
            denoiser: play.denoiser,
            ladder: play.ladder.clone(),
            measure: play.measure,
            rungs: play.rungs.len(),
            fps: play.fps,
            fit: play.fit.clone(),
            judged_frames: judged.frames,
            in_band_share: share(judged.in_band),
            above_share: share(judged.above),
            below_share: share(judged.below),
            makespan_ms_p50: judged.makespans_ms.quantile(0.5)?,
            makespan_ms_p95: judged.makespans_ms.quantile(0.95)?,
            makespan_ms_p99: judged.makespans_ms.quantile(0.99)?,
            late_share: share(judged.late),
            missed_fraction: judged.missed as f64 / (judged.missed + judged.frames as u64) as f64,
            on_time_share: 1.0 - share(judged.missed_frames),
            late_causes: judged.late_causes(),
            rung_changes: judged.rung_changes,
            longest_excursion: judged.longest.clone(),
            rung_uses: judged.rungs.iter().map(|(rung, frames)| rung_use(play, *rung, frames, judged.frames)).collect(),
        })
    }
}

/// Counts and distributions over consecutive frames, from which the summary is computed.
#[derive(Clone, Debug, Default)]
struct Judged {
    frames: usize,
    in_band: usize,
    above: usize,
    below: usize,
    late: usize,
    /// Sum of the missed display periods, and number of frames that missed any.
    missed: u64,
    missed_frames: usize,
    causes: BTreeMap<String, usize>,
    makespans_ms: Quantiles,
    rung_changes: usize,
    last_rung: Option<usize>,
    /// Current sequence of frames above the budget, if the last frame was above it; and the longest sequence so far, the
    /// earliest if several are equally long.
    excursion: Option<Excursion>,
    longest: Option<Excursion>,
    rungs: BTreeMap<usize, RungFrames>,
}

/// Statistics of the frames that used a rung.
#[derive(Clone, Debug)]
struct RungFrames {
    quality: FrameQuality,
    expected_ms: Quantiles,
    frames: usize,
}

impl Judged {
    fn add(&mut self, row: &FrameRow, control: &ControlRow, [lo_ms, hi_ms]: [f64; 2]) {
        self.frames += 1;
        self.above += usize::from(row.makespan_ms > hi_ms);
        self.below += usize::from(row.makespan_ms < lo_ms);
        self.in_band += usize::from(control.in_band);
        self.late += usize::from(control.late_ms > LATE_MS);
        self.missed += u64::from(control.missed_periods);
        self.missed_frames += usize::from(control.missed_periods > 0);
        if let Some(cause) = row.deadline.as_ref().and_then(|deadline| deadline.cause.as_ref()) {
            *self.causes.entry(cause.clone()).or_default() += 1;
        }
        self.makespans_ms.add(row.makespan_ms);
        let changes = self.last_rung.replace(control.rung).is_some_and(|last| last != control.rung);
        self.rung_changes += usize::from(changes);
        if row.makespan_ms <= hi_ms {
            self.excursion = None;
        } else {
            let excursion = self.excursion.get_or_insert(Excursion { first_frame: row.index, frames: 0 });
            excursion.frames += 1;
            if self.longest.as_ref().is_none_or(|longest| longest.frames < excursion.frames) {
                self.longest = Some(excursion.clone());
            }
        }
        let new = || RungFrames { quality: row.quality, expected_ms: Quantiles::default(), frames: 0 };
        let rung = self.rungs.entry(control.rung).or_insert_with(new);
        rung.frames += 1;
        rung.expected_ms.add(control.expected_ms);
    }

    fn late_causes(&self) -> Vec<CauseCount> {
        let counts = self.causes.iter().map(|(cause, frames)| CauseCount { cause: cause.clone(), frames: *frames });
        let mut causes: Vec<_> = counts.collect();
        causes.sort_by_key(|count| std::cmp::Reverse(count.frames));
        causes
    }
}

impl PlaySummary {
    /// Returns a table of named, rounded values that show how well the budget was kept.
    pub fn table(&self) -> Table {
        let ms = |ms: f64| format!("{ms:.1} ms");
        let [lo_ms, hi_ms] = self.budget_ms;
        let rows = [
            ("budget", format!("{lo_ms} to {hi_ms} ms")),
            ("frames judged", self.judged_frames.to_string()),
            ("on time", percent(self.on_time_share)),
            ("late by cause", self.causes_text()),
            ("within the budget or shorter", percent(1.0 - self.above_share)),
            ("display periods missed", percent(self.missed_fraction)),
            ("begun late", percent(self.late_share)),
            ("longest excursion", self.longest_excursion.as_ref().map_or("none".to_owned(), ToString::to_string)),
            ("median makespan", ms(self.makespan_ms_p50)),
            ("95th percentile", ms(self.makespan_ms_p95)),
            ("99th percentile", ms(self.makespan_ms_p99)),
            ("changes of the rung", self.rung_changes.to_string()),
            ("shorter than the budget", percent(self.below_share)),
        ];
        let rows = rows.map(|(name, value)| vec![name.to_owned(), value]).into();
        Table { headers: vec!["what", "value"], rows }
    }

    /// Lists the most frequent causes of late frames with their numbers of frames.
    fn causes_text(&self) -> String {
        let (most, others) = self.late_causes.split_at(self.late_causes.len().min(CAUSES_SHOWN));
        let texts = most.iter().map(|CauseCount { cause, frames }| format!("{frames} by {cause}"));
        let others: usize = others.iter().map(|count| count.frames).sum();
        let texts = texts.chain((others > 0).then(|| format!("{others} by other causes")));
        if most.is_empty() { "none".to_owned() } else { texts.collect::<Vec<_>>().join(", ") }
    }

    /// Returns a table of the rungs that were used, cheapest first.
    pub fn rungs_table(&self) -> Table {
        let row = |u: &RungUse| {
            let FrameQuality { bounces, iterations, scale, fovea, .. } = u.quality;
            let mut line = vec![u.rung.to_string()];
            line.extend([u.quality.spp.to_string(), bounces.to_string()]);
            line.extend([u.denoiser.to_owned(), iterations.to_string(), scale.to_string()]);
            line.push(fovea.map_or("none".to_owned(), |[inner, outer]| format!("{inner}, {outer}")));
            line.extend([format!("{:.1}", u.expected_ms), cell(u.error.or(u.estimated_error), 4)]);
            line.push(if u.estimated { "estimated" } else { "measured" }.to_owned());
            line.push(percent(u.share));
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

fn rung_use(play: &Play, rung: usize, of: &RungFrames, judged: usize) -> RungUse {
    let known = play.rungs.get(rung);
    // If the frames had fewer iterations than the rung, its error is only an estimate, too.
    let estimated = known.is_none_or(|r| r.is_estimated || r.quality.most_iterations() != of.quality.iterations);
    let error = known.map(|r| r.error);
    RungUse {
        rung,
        denoiser: play.denoiser,
        quality: of.quality,
        expected_ms: of.expected_ms.median().unwrap_or(0.0),
        error: error.filter(|_| !estimated),
        estimated,
        estimated_error: error.filter(|_| estimated),
        share: of.frames as f64 / judged as f64,
    }
}

impl fmt::Display for Excursion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} frame(s) from frame {} on", self.frames, self.first_frame)
    }
}

impl fmt::Display for PlaySummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [lo_ms, hi_ms] = self.budget_ms;
        let [in_time, missed, late, below] =
            [1.0 - self.above_share, self.missed_fraction, self.late_share, self.below_share].map(percent);
        let longest =
            self.longest_excursion.as_ref().map_or(String::new(), |most| format!("; longest excursion: {most}"));
        let on_time = percent(self.on_time_share);
        writeln!(f, "{on_time} of {} frames were on time; late frames: {}", self.judged_frames, self.causes_text())?;
        writeln!(f, "{missed} of display periods were missed; {late} of frames began late")?;
        writeln!(f, "{in_time} of frames took at most {hi_ms} ms{longest}")?;
        let [p50, p95, p99] = [self.makespan_ms_p50, self.makespan_ms_p95, self.makespan_ms_p99];
        write!(f, "makespan ms: median {p50:.1}, 95 % {p95:.1}, 99 % {p99:.1}; {} rung changes; ", self.rung_changes)?;
        write!(f, "{below} of frames took less than {lo_ms} ms")
    }
}
