//! What a frame must do.

use super::denoise::Denoiser;
use super::{Aov, Moving};
use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;

/// How the two eyes are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Views {
    /// Both eyes are path traced.
    Traced,
    /// The left eye is path traced, the right one is reprojected from it, and its holes are path traced.
    Reprojected,
}

/// What a frame must do.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    /// Of the images that are traced and filtered.
    pub extent: Extent,
    /// Of the screen, where those images are polar and mapped to it; else they are of the screen itself, which is rectified
    /// where eyes show other images.
    pub screen: Option<Extent>,
    /// Whether polar images are blurred away from the gaze.
    pub blurs: bool,
    /// Of the images that the eyes show, where those of the screen are rectified and resampled to them.
    pub shown: Option<Extent>,
    /// Whether that is as from another place, by the depth of surfaces.
    pub is_late: bool,
    pub devices: usize,
    pub views: Views,
    /// Whether only listed pixels are path traced.
    pub sparse: bool,
    pub filter: Option<Denoiser>,
    /// Iterations of the filter. With 0 there is no denoising.
    pub iterations: u32,
    /// How many rows up and down a surface may have moved since the frame before for its history to be found. With none
    /// there is no history.
    pub history_rows: Option<u32>,
    pub seam: Seam,
    /// Auxiliary images asked for.
    pub aovs: Vec<Aov>,
    /// Whether anything can reflect light. Otherwise only emission is visible.
    pub has_surfaces: bool,
    /// What of the scene moves, if anything does.
    pub moving: Option<Moving>,
}

impl FrameSpec {
    /// A frame without history or auxiliary images, with SVGF and a reprojected right eye.
    pub fn new(extent: Extent, devices: usize) -> Self {
        Self {
            extent,
            screen: None,
            blurs: true,
            shown: None,
            is_late: false,
            devices,
            views: Views::Reprojected,
            sparse: false,
            filter: Some(Denoiser::SVGF),
            iterations: Denoiser::DEFAULT_ITERATIONS,
            history_rows: None,
            seam: Seam::Halo(HaloPlan::RECOMPUTE),
            aovs: Vec::new(),
            has_surfaces: true,
            moving: None,
        }
    }

    /// The denoiser that is in effect, if there is one.
    pub fn denoiser(&self) -> Option<Denoiser> {
        self.filter.filter(|_| self.has_surfaces && self.iterations > 0)
    }

    /// The number of rows of neighbours that a filter reads, which is 0 where stripes are filtered separately.
    pub fn halo(&self, rows: u32) -> u32 {
        if matches!(self.seam, Seam::Halo(_)) { rows } else { 0 }
    }

    /// The part of [`Self::history_rows`] that may be read from neighbours.
    pub fn history_halo(&self) -> Option<u32> {
        self.history_rows.map(|rows| self.halo(rows))
    }
}
