//! The two eyes.

use std::fmt;

use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Eye {
    Left,
    Right,
}

impl Eye {
    pub const ALL: [Eye; 2] = [Eye::Left, Eye::Right];

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
