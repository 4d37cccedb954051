//! Who does it, when: policies that cut each view into stripes, stage by stage.
//!
//! A policy sees what past frames cost and answers with an [`crate::graph::Assignment`]; it knows neither devices nor wgpu. No result
//! may depend on its answer, only the time it takes to get there.

mod policy;

pub use policy::{Even, Measured, Policy, RatioRule, Static};

/// What one stage cost one device in a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct StageCost {
    pub stage: crate::graph::Stage,
    pub view: crate::scene::rig::Eye,
    pub device: usize,
    pub rows: std::ops::Range<u32>,
    pub busy_ms: f64,
}
