//! Keeps frames inside a time budget: a controller picks the quality of each frame from a ladder, a list of settings
//! ordered by cost. An entry of the ladder is called a rung.
//!
//! The [`Ladder`] is measured in advance (`diptych bench`). For each frame the [`Controller`] asks a predictor for the
//! current cost of rungs, and corrects it by the error of recent predictions. It then stays, climbs slowly, or jumps to
//! the most expensive rung that fits. This module does not use wgpu, so tests simulate whole runs.

mod budget;
mod builtin;
mod controller;
mod correction;
mod front;
mod ladder;
mod rung;

pub use budget::{Budget, BudgetError};
pub use builtin::{
    BOUNCES, ESTIMATES_EV, TRACING, candidates, guessed_error, guessed_paths, guessed_relative_cost, lack_path_times,
    relative_costs,
};
pub use controller::{CLIMB_BACK_AFTER, CLIMB_EVERY, Controller, Decision, Predict};
pub use front::{front, mean_error};
pub use ladder::{Ladder, LadderError, MIN_STEP, Origin, STEEPEST};
pub use rung::{Measure, Rung};
