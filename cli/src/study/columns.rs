//! Columns of studies, and how their numbers follow from measurements.

use std::collections::BTreeMap;

use super::times::{FrameTimes, TRANSFERS, median_over, stage_ms};
use crate::report::bench::Measured;
use crate::report::frames::FrameLine;
use crate::report::median_of;
use crate::report::statistics::{deviation, interquartile_range, interval_of_median, mean};

/// Measures of an arrangement other than its times and errors, by name.
pub type Measures = BTreeMap<&'static str, f64>;

/// Measures of the fovea under a moving gaze, for which additional frames are rendered.
pub const FOVEA: [&str; 2] = ["fovea_flip", "fovea_flicker"];

/// Measures of rings around the gaze: SSIM against the reference in the innermost ring, and in the outermost ring whose
/// SSIM is defined; then SSIM against the first arrangement in the same two rings.
pub const RINGS: [&str; 4] = ["ssim_gaze", "ssim_edge", "ssim_basic_gaze", "ssim_basic_edge"];

/// Measurements of an arrangement.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// Times of each frame, and its line in `frames.csv`. Simulated frames have no line.
    pub times: Vec<FrameTimes>,
    pub lines: Vec<FrameLine>,
    /// Errors at each instant.
    pub instants: Vec<Measured>,
    pub others: Measures,
}

/// A column of numbers.
pub struct Column {
    pub name: &'static str,
    /// Header in printed tables; empty for a column that only the CSV file has.
    pub head: &'static str,
    /// Decimals of printed tables; the CSV file has four more.
    pub decimals: usize,
    /// True to print percentages of fractions.
    pub is_percent: bool,
    /// Index of the printed table.
    pub table: usize,
    pub value: fn(&Cell) -> Option<f64>,
}

impl Column {
    pub const fn new(name: &'static str, head: &'static str, decimals: usize, value: fn(&Cell) -> Option<f64>) -> Self {
        Self { name, head, decimals, is_percent: false, table: 0, value }
    }

    pub const fn percent(self) -> Self {
        Self { is_percent: true, ..self }
    }

    /// Returns the column in another printed table than the first.
    pub const fn in_table(self, table: usize) -> Self {
        Self { table, ..self }
    }
}

/// Measurements that a cell follows from: those of its row's arrangement, and those of the first arrangement.
pub struct Cell<'a> {
    pub found: &'a Found,
    pub first: &'a Found,
}

impl Cell<'_> {
    fn makespans_ms(&self) -> Vec<f64> {
        self.found.times.iter().map(|frame| frame.makespan_ms).collect()
    }

    /// Returns the median makespan.
    pub fn time_ms(&self) -> Option<f64> {
        (!self.found.times.is_empty()).then(|| median_of(self.makespans_ms()))
    }

    pub fn least_ms(&self) -> Option<f64> {
        self.makespans_ms().into_iter().reduce(f64::min)
    }

    pub fn most_ms(&self) -> Option<f64> {
        self.makespans_ms().into_iter().reduce(f64::max)
    }

    /// Returns the interquartile range of the makespans.
    pub fn range_ms(&self) -> Option<f64> {
        (!self.found.times.is_empty()).then(|| interquartile_range(self.makespans_ms()))
    }

    /// Returns the speed-ups over the first arrangement, frame by frame.
    fn speedups(&self) -> Vec<f64> {
        let pairs = self.first.times.iter().zip(&self.found.times);
        pairs.map(|(first, own)| first.makespan_ms / own.makespan_ms).collect()
    }

    /// Returns the speed-up over the first arrangement: the median over frames.
    pub fn speedup(&self) -> Option<f64> {
        let speedups = self.speedups();
        (!speedups.is_empty()).then(|| median_of(speedups))
    }

    /// Returns an end of the 95 % interval of the median speed-up: the lower one (0) or the upper one (1).
    pub fn speedup_end(&self, end: usize) -> Option<f64> {
        interval_of_median(&self.speedups()).map(|ends| ends[end])
    }

    /// Returns the time of stages, summed over devices: the median over frames. `None` if none of the stages ran.
    pub fn stages_ms(&self, stages: &[&str]) -> Option<f64> {
        stages_of(self.found, stages)
    }

    /// Returns the time of stages in the first arrangement over that in this one.
    pub fn stages_speedup(&self, stages: &[&str]) -> Option<f64> {
        Some(stages_of(self.first, stages)? / self.stages_ms(stages)?)
    }

    /// Returns the time of stages as a fraction of the time of all stages, without transfers.
    pub fn stages_fraction(&self, stages: &[&str]) -> Option<f64> {
        let all = stage_ms(&self.found.times);
        let is_own = |stage: &str| !TRANSFERS.contains(&stage);
        let whole: f64 = all.iter().filter(|(stage, _)| is_own(stage)).map(|(_, ms)| ms).sum();
        self.stages_ms(stages).map(|ms| ms / whole)
    }

    /// Returns the time of stages, averaged over the devices that ran any of them: the median over frames.
    pub fn mean_of_devices_ms(&self, stages: &[&str]) -> Option<f64> {
        median_over(&self.found.times, |frame| frame.mean_ms(stages))
    }

    /// Returns the busy fraction of the primary (0) or the mean of that of the other devices (1): the median over
    /// frames.
    pub fn busy(&self, which: usize) -> Option<f64> {
        median_over(&self.found.times, |frame| frame.busy()[which])
    }

    /// Returns a measure by its name.
    pub fn other(&self, name: &str) -> Option<f64> {
        self.found.others.get(name).copied()
    }

    /// Returns an error at each instant, as the mean of both eyes. `None` if it is undefined anywhere.
    fn errors(&self, name: &str) -> Option<Vec<f64>> {
        let mean_of_eyes = |at: &Measured| Some((at.errors.left().get(name)? + at.errors.right().get(name)?) / 2.0);
        let all: Option<Vec<f64>> = self.found.instants.iter().map(mean_of_eyes).collect();
        all.filter(|all| !all.is_empty())
    }

    /// Returns the mean of an error over instants and eyes.
    pub fn error(&self, name: &str) -> Option<f64> {
        self.errors(name).map(|all| mean(&all))
    }

    /// Returns the standard deviation of an error over instants, with divisor n − 1, of the mean of both eyes.
    pub fn error_deviation(&self, name: &str) -> Option<f64> {
        self.errors(name).filter(|all| all.len() > 1).map(|all| deviation(&all))
    }

    /// Returns the RMSE as a percentage of the display range, which is the peak value of the PSNR.
    pub fn rmse_percent(&self) -> Option<f64> {
        let of = |psnr: &f64| 100.0 * 10f64.powf(-psnr / 20.0);
        self.errors("psnr").map(|all| mean(&all.iter().map(of).collect::<Vec<_>>()))
    }
}

fn stages_of(found: &Found, stages: &[&str]) -> Option<f64> {
    let all = stage_ms(&found.times);
    let own: Vec<f64> = stages.iter().filter_map(|stage| all.get(*stage).copied()).collect();
    (!own.is_empty()).then(|| own.iter().sum())
}
