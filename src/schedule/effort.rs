//! The amount of work of a frame's stages at one quality, relative to other qualities.

use crate::graph::Stage;

/// The work of a row by stage, and for filters that of one iteration. Only ratios of efforts of the same stage have a
/// meaning.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effort {
    stages: Vec<(Stage, f64)>,
}

impl Effort {
    /// Sets an effort. Anything but a number above 0 is left out.
    pub fn new(stages: impl IntoIterator<Item = (Stage, f64)>) -> Self {
        Self { stages: stages.into_iter().filter(|(_, work)| work.is_finite() && *work > 0.0).collect() }
    }

    /// The effort of a stage, which is 1 if nothing is known of it.
    pub fn of(&self, stage: Stage) -> f64 {
        self.stages.iter().find(|(s, _)| *s == stage).map_or(1.0, |(_, work)| *work)
    }
}
