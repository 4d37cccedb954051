//! Motions of the camera in experiments.

use serde::Deserialize;

/// Motion of the camera before the compared frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Camera {
    /// The camera moves along its path during the warm-up, and rests in the compared frames.
    Approaching,
    /// The camera rests all the time.
    Still,
    /// The camera moves along its path to several instants, and the frame at each instant is compared.
    Moving,
    /// The camera rests at several instants of its path in turn.
    Stepping,
    /// The camera moves along its path, and frames are displayed later than their pose was sampled.
    Late,
    /// The camera follows its path, and every frame is timed. There is no reference.
    Following,
}

impl Camera {
    pub fn name(self) -> &'static str {
        match self {
            Self::Approaching => "approaching",
            Self::Still => "still",
            Self::Moving => "moving",
            Self::Stepping => "stepping",
            Self::Late => "late",
            Self::Following => "following",
        }
    }

    /// True if the camera is measured at several instants of its path.
    pub fn visits_instants(self) -> bool {
        matches!(self, Self::Moving | Self::Stepping | Self::Late)
    }
}
