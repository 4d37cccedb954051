//! Keeps frames inside a time budget: a controller picks the quality of each frame from a ladder, a list of settings
//! ordered by cost. An entry of the ladder is called a rung.
//!
//! The [`Ladder`] is measured in advance (`diptych bench`). For each frame the [`Controller`] asks a predictor for the
//! current cost of rungs, and chooses the one of least error that fits the budget with headroom. This module does not
//! use wgpu, so tests simulate whole runs.

mod baselines;
mod budget;
mod builtin;
mod controller;
mod front;
mod ladder;
mod rung;

pub use baselines::ControllerKind;
pub use budget::{Budget, BudgetError};
pub use builtin::{
    BOUNCES, BlurErrors, ESTIMATES_EV, MOST_ITERATIONS, TRACING, candidates, guessed_error, guessed_paths,
    guessed_relative_cost, lack_path_times, relative_costs,
};
pub use controller::{Control, Controller, Decision, LATE, QUIET};
pub use front::{front, mean_error};
pub use ladder::{Ladder, LadderError, MIN_STEP, Origin, STEEPEST};
pub use rung::{Measure, Rung, mix};
