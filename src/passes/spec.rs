//! Specification of a frame, from which its passes are declared.

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

/// Specification of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    /// Extent of the images that are traced and filtered.
    pub extent: Extent,
    /// Extent of the screen, if traced images are polar and mapped to it. Otherwise the screen itself is traced. With
    /// `shown`, the screen is the shared (rectified) projection.
    pub screen: Option<Extent>,
    /// Whether polar images are blurred away from the gaze.
    pub blurs: bool,
    /// Extent of the images that the eyes show, if they are resampled from a rectified screen.
    pub shown: Option<Extent>,
    /// Whether late reprojection resamples them from a later pose, by the depth of surfaces.
    pub is_late: bool,
    pub devices: usize,
    pub views: Views,
    /// Whether only listed pixels are path traced.
    pub sparse: bool,
    pub filter: Option<Denoiser>,
    /// Iterations of the filter. With 0 there is no denoising.
    pub iterations: u32,
    /// Maximum vertical motion of a surface since the previous frame for which its history is found, rows. `None`
    /// disables history.
    pub history_rows: Option<u32>,
    pub seam: Seam,
    /// Requested auxiliary images.
    pub aovs: Vec<Aov>,
    /// Whether anything can reflect light. Otherwise only emission is visible.
    pub has_surfaces: bool,
    /// Dynamic geometry of the scene; `None` if it is static.
    pub moving: Option<Moving>,
}

impl FrameSpec {
    /// Creates a frame without history or auxiliary images, with SVGF and a reprojected right eye.
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

    /// Returns the denoiser in effect, if any.
    pub fn denoiser(&self) -> Option<Denoiser> {
        self.filter.filter(|_| self.has_surfaces && self.iterations > 0)
    }

    /// Returns the number of rows that a filter reads from neighbours: `rows`, or 0 if stripes are filtered separately.
    pub fn halo(&self, rows: u32) -> u32 {
        if matches!(self.seam, Seam::Halo(_)) { rows } else { 0 }
    }

    /// Returns the part of [`Self::history_rows`] that may be read from neighbours.
    pub fn history_halo(&self) -> Option<u32> {
        self.history_rows.map(|rows| self.halo(rows))
    }
}
