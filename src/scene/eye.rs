//! The two eyes.

use std::fmt;

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Eye {
    Left,
    Right,
}

impl Eye {
    /// The views of a rig, the main one first.
    pub const ALL: [Eye; 2] = [Eye::Left, Eye::Right];
    /// The view that is path traced in every frame. Other views may take over its light and its history, and it holds
    /// the images that all views share.
    pub const MAIN: Self = Self::Left;

    pub fn is_main(self) -> bool {
        self == Self::MAIN
    }

    /// Returns the sign of the eye's offset along the rig's right vector.
    pub(super) fn side(self) -> f64 {
        match self {
            Eye::Left => -1.0,
            Eye::Right => 1.0,
        }
    }
}

impl fmt::Display for Eye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Eye::Left => "left",
            Eye::Right => "right",
        })
    }
}
