//! Stops a run whose first frames show that no setting fits the budget.

use crate::report::median_of;
use crate::report::play::SizeFit;
use crate::report::run::FrameRow;
use diptych::control::Budget;

use super::args::Args;
use super::fitting_size;
use crate::options::RenderOptions;

/// Number of frames after which a run stops.
pub const FRAMES: u32 = 30;
/// Multiple of the budget's upper end that all of them exceed.
const FAR: f64 = 2.0;

/// Judges the first frames of a run. One frame near the budget, or for which a rung was expected to fit, clears the run.
#[derive(Default)]
pub struct Misfit {
    makespans_ms: Vec<f64>,
    is_cleared: bool,
}

impl Misfit {
    /// Starts to judge a run, unless it is to go on whatever happens: with --set keep_going=on, with --fit, with disturbances,
    /// which would not be reached, or if it ends with these frames.
    pub fn of_run(args: &Args, options: &RenderOptions) -> Self {
        let is_disturbed = !options.settings.disturb.is_empty();
        let is_cleared = args.options.run.settings.keep_going || args.fit || options.frames <= FRAMES || is_disturbed;
        Self { makespans_ms: Vec::new(), is_cleared }
    }

    /// True if the run may stop after this frame.
    pub fn may_stop_after(&self, index: u32) -> bool {
        !self.is_cleared && index + 1 == FRAMES
    }

    /// Adds a frame. Returns the median makespan, in milliseconds, if the run cannot fit the budget.
    pub fn add(&mut self, row: &FrameRow, budget: Budget) -> Option<f64> {
        let lacks_rung = row.control.is_some_and(|control| control.rung == 0 && !control.fits);
        self.is_cleared |= !lacks_rung || row.makespan_ms <= FAR * budget.hi_ms();
        if self.is_cleared {
            return None;
        }
        self.makespans_ms.push(row.makespan_ms);
        let is_enough = self.makespans_ms.len() == FRAMES as usize;
        is_enough.then(|| median_of(std::mem::take(&mut self.makespans_ms)))
    }
}

/// Returns the reason why the run stops, with a size that should fit.
pub fn reason(options: &RenderOptions, budget: Budget, fit: Option<&SizeFit>, median_ms: f64) -> String {
    let [lo_ms, hi_ms] = [budget.lo_ms(), budget.hi_ms()];
    let size = match fit {
        Some(fit) => fit.fitting_size.clone(),
        None => fitting_size::estimate(options.settings.size, median_ms, budget).map(|size| size.to_string()),
    };
    let remedy = match size {
        Some(size) => format!("use --size {size} or --fit"),
        None => "raise --budget-ms".to_owned(),
    };
    format!(
        "nothing fits the budget of {lo_ms} to {hi_ms} ms at {}: each of the first {FRAMES} frames took more than {} ms \
         at the cheapest rung (median {}): {remedy}, or --set keep_going=on to play on",
        options.settings.size,
        FAR * hi_ms,
        fitting_size::duration(median_ms),
    )
}
