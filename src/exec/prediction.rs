//! Prediction of frame times.

use super::Renderer;
use crate::quality::Quality;
use crate::schedule::{RelativeCost, simulate_at};

impl Renderer {
    /// Makes the policy assign the rows of the next frame again, if it has done so for a prediction.
    pub fn assign_anew(&mut self) {
        self.planner.assign_anew();
    }

    /// Predicts the makespan in milliseconds of the next frame at this quality and relative cost, on the stripes that
    /// the next frame will have. Returns `None` before the cost model has learned from a frame.
    pub fn predicted_ms(&mut self, quality: &Quality, relative_cost: &RelativeCost) -> Option<f64> {
        let (last, _) = self.planned.as_ref().filter(|_| self.costs.has_learned())?;
        let left = self.frames.devices_left();
        let graph = self.planner.next_graph(&self.costs, &left, quality.most_iterations(), last);
        Some(simulate_at(&graph, &self.costs, relative_cost).makespan_ms)
    }
}
