//! Distributes rows among devices: a cost model, policies that partition each view into stripes, and a simulation of a
//! frame on a virtual clock.
//!
//! A policy asks the [`CostModel`] and returns an [`crate::graph::Assignment`]. It knows neither devices nor wgpu. Its
//! result may only affect the time to render, never an image.

mod cost;
mod balance;
mod splits;
mod relative_cost;
mod halo;
pub(crate) mod learned;
mod network;
mod policy;
mod simulate;
mod choice;

pub use balance::Measured;
pub use choice::Balance;
pub use cost::stripes::StripeCosts;
pub use cost::{CostModel, FrameCosts, StageCost, TransferCost};
pub use halo::choose_halo;
pub use network::Network;
pub use policy::{Even, Policy, RatioRule, Static};
pub use relative_cost::RelativeCost;
pub use simulate::{LOSS_SHARE, Limit, Prediction, Step, simulate, simulate_at};
pub use splits::{Divisible, Position, Split, Splits, UNKNOWN_PATH_MS, parts, rows_in, splits};

#[cfg(test)]
mod tests;
