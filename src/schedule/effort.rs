//! How much work the stages of a frame are at one quality, held against another.

use crate::graph::Stage;

/// Work of a row by stage; of filters, of one iteration. Only ratios of the same stage's efforts mean anything.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effort {
    stages: Vec<(Stage, f64)>,
}

impl Effort {
    /// What is not a number above 0 is left out.
    pub fn new(stages: impl IntoIterator<Item = (Stage, f64)>) -> Self {
        Self { stages: stages.into_iter().filter(|(_, work)| work.is_finite() && *work > 0.0).collect() }
    }

    /// 1 of stages that nothing is known of.
    pub fn of(&self, stage: Stage) -> f64 {
        self.stages.iter().find(|(s, _)| *s == stage).map_or(1.0, |(_, work)| *work)
    }
}
