//! What a frame must do.

use super::Aov;
use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;
use crate::quality::Denoiser;

/// Which eyes are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Views {
    /// Both path traced.
    Traced,
    /// Left path traced, right reprojected from it with its holes traced.
    Reprojected,
}

/// What a frame must do.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    pub extent: Extent,
    pub devices: usize,
    pub views: Views,
    /// Whether only listed pixels are path traced.
    pub sparse: bool,
    pub filter: Option<Denoiser>,
    /// Of the filter; 0: no denoising.
    pub iterations: u32,
    /// How many rows up and down a surface may have moved since the frame before for its history to be found; none:
    /// there is no history.
    pub history_rows: Option<u32>,
    pub seam: Seam,
    /// Auxiliary images asked for.
    pub aovs: Vec<Aov>,
    /// Whether anything can reflect light; without, only emission is seen.
    pub has_surfaces: bool,
}

impl FrameSpec {
    /// A frame without history or auxiliary images, with SVGF and a reprojected right eye.
    pub fn new(extent: Extent, devices: usize) -> Self {
        Self {
            extent,
            devices,
            views: Views::Reprojected,
            sparse: false,
            filter: Some(Denoiser::Svgf),
            iterations: Denoiser::DEFAULT_ITERATIONS,
            history_rows: None,
            seam: Seam::Halo(HaloPlan::RECOMPUTE),
            aovs: Vec::new(),
            has_surfaces: true,
        }
    }

    /// What denoises, if anything does.
    pub fn denoiser(&self) -> Option<Denoiser> {
        self.filter.filter(|_| self.has_surfaces && self.iterations > 0)
    }

    /// Rows of neighbours that a filter reads: none where stripes are filtered apart.
    pub fn halo(&self, rows: u32) -> u32 {
        if matches!(self.seam, Seam::Halo(_)) { rows } else { 0 }
    }

    /// [`Self::history_rows`] that may be read of neighbours.
    pub fn history_halo(&self) -> Option<u32> {
        self.history_rows.map(|rows| self.halo(rows))
    }
}
