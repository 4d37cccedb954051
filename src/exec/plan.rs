//! The plan of a frame: the parameters that determine its graph.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::output::Output;
use super::wire;
use crate::graph::{Assignment, Program, Seam};

/// Description of the previous frame's images, which remain on the devices as history.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct History {
    /// Assignment of the previous frame.
    #[serde(with = "wire::assignment")]
    pub before: Assignment,
    /// Search range of the planned frame's temporal reprojection, in rows above and below. Surfaces that moved further
    /// have no history.
    pub rows: u32,
    /// Devices that have failed since the previous frame. The history of their rows is lost.
    pub lost: Vec<usize>,
}

impl History {
    /// Returns the smallest range that contains the rows of all failed devices in all history images.
    pub fn lost_rows(&self, program: &Program) -> Range<u32> {
        let kept = program.images().iter().filter(|image| image.is_before);
        let of_image =
            kept.flat_map(|image| program.eyes().iter().map(|&view| (program.writer(&image.resource, view), view)));
        let stripes = of_image.filter_map(|(group, view)| Some(self.before.stripes(group?, view)));
        let rows = stripes.flat_map(|stripes| self.lost.iter().map(|&device| stripes.rows(device)).collect::<Vec<_>>());
        let lost = rows.filter(|rows| !rows.is_empty());
        lost.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or(0..0)
    }
}

/// Parameters in which the graphs of a run differ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    pub seam: Seam,
    pub iterations: u32,
    #[serde(with = "wire::assignment")]
    pub assignment: Assignment,
    pub history: Option<History>,
    /// Images to gather on the primary, in addition to the row tallies; `None` gathers all outputs.
    pub outputs: Option<Vec<Output>>,
}
