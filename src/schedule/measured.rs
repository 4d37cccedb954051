//! `measured` stripes, which are even by the predicted cost of every row on the device that gets it.

use super::cost::CostModel;
use super::cut::{MovingStripes, cut};
use super::policy::Policy;
use crate::graph::Assignment;

/// Cuts stripes of even predicted cost. Devices of different speed get different shares.
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
        self.stripes.follow(model, |_, costs| cut(costs, &vec![1.0; costs.devices()]))
    }

    fn remove_device(&mut self, _device: usize) {
        self.stripes.remove_device();
    }
}
