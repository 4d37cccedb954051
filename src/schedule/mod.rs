//! Who does it, when: what work costs, policies that cut each view into stripes, and a virtual clock to play a frame on.
//!
//! A policy asks the [`CostModel`] and answers with an [`crate::graph::Assignment`]; it knows neither devices nor wgpu. No
//! result may depend on its answer, only the time it takes to get there.

mod cost;
mod cut;
mod effort;
mod halo;
mod heft;
mod learned;
mod measured;
mod policy;
mod simulate;

pub use cost::{CostModel, FrameCosts, StageCost, StripeCosts, TransferCost};
pub use cut::step_rows;
pub use effort::Effort;
pub use halo::choose_halo;
pub use heft::Heft;
pub use measured::Measured;
pub use policy::{Even, Policy, RatioRule, Static};
pub use simulate::{LOSS_SHARE, Limit, Prediction, Step, StepKind, Stuck, simulate, simulate_at};

#[cfg(test)]
mod tests;
