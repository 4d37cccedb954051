//! Relative cost of a frame's stages at one quality, compared with other qualities.

use crate::graph::Stage;

/// Relative cost of a row for each stage; for filters, of a row in one iteration. Only ratios between qualities within
/// the same stage are meaningful.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RelativeCost {
    stages: Vec<(Stage, f64)>,
}

impl RelativeCost {
    /// Creates relative costs. Values that are not positive and finite are ignored.
    pub fn new(stages: impl IntoIterator<Item = (Stage, f64)>) -> Self {
        Self { stages: stages.into_iter().filter(|(_, work)| work.is_finite() && *work > 0.0).collect() }
    }

    /// Returns the relative cost of a stage, which is 1 if unknown.
    pub fn of(&self, stage: Stage) -> f64 {
        self.stages.iter().find(|(s, _)| *s == stage).map_or(1.0, |(_, work)| *work)
    }
}
