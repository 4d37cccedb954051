//! The images that leave a frame.

use serde::{Deserialize, Serialize};

use crate::graph::PhysicalImage;

/// An image that the primary has whole and can send to the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Output {
    RowTally,
    Linear,
    Display,
    /// The i-th auxiliary image that was asked for.
    Aov(u8),
}

impl Output {
    /// None: the image stays on the devices that made it.
    pub fn of(image: PhysicalImage) -> Option<Self> {
        match image {
            PhysicalImage::RowTally => Some(Self::RowTally),
            PhysicalImage::Linear => Some(Self::Linear),
            PhysicalImage::Display => Some(Self::Display),
            PhysicalImage::Aov(i) => Some(Self::Aov(i)),
            _ => None,
        }
    }

    pub fn image(self) -> PhysicalImage {
        match self {
            Self::RowTally => PhysicalImage::RowTally,
            Self::Linear => PhysicalImage::Linear,
            Self::Display => PhysicalImage::Display,
            Self::Aov(i) => PhysicalImage::Aov(i),
        }
    }
}
