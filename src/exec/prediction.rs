//! Prediction of frame times.

use super::Renderer;
use super::plan::Plan;
use crate::quality::Quality;
use crate::schedule::{RelativeCost, simulate_at};

impl Renderer {
    /// Predicts the makespan in milliseconds of a frame with this quality and relative cost, on the stripes of the last
    /// frame. Returns `None` before the cost model has learned from a frame.
    pub fn predicted_ms(&self, quality: &Quality, relative_cost: &RelativeCost) -> Option<f64> {
        let (plan, _) = self.planned.as_ref().filter(|_| self.costs.has_learned())?;
        let graph = self.planner.graph(&Plan { iterations: quality.most_iterations(), ..plan.clone() });
        simulate_at(&graph, &self.costs, relative_cost).ok().map(|p| p.makespan_ms)
    }
}
