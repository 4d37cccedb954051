//! The policy `measured`: stripes of equal predicted cost.

use super::balance::{MovingStripes, balanced};
use super::cost::CostModel;
use super::policy::Policy;
use crate::graph::Assignment;

/// Policy that gives every device a stripe of equal predicted time, so faster devices get more rows.
pub struct Measured {
    stripes: MovingStripes,
}

impl Measured {
    pub fn new(height: u32, devices: usize) -> Self {
        Self { stripes: MovingStripes::new(height, devices) }
    }
}

impl Policy for Measured {
    fn name(&self) -> &'static str {
        "measured"
    }

    fn assign(&mut self, model: &CostModel) -> Assignment {
        self.stripes.follow(model, |_, costs| balanced(costs, &vec![1.0; costs.devices()]))
    }

    fn remove_device(&mut self, _device: usize) {
        self.stripes.remove_device();
    }
}
