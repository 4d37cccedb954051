//! Specification of a frame, from which its passes are declared.

use super::denoise::Denoiser;
use super::{Aov, Moving};
use crate::graph::{HaloPlan, Seam};
use crate::image::Extent;
use crate::projection::PolarSpace;
use crate::scene::rig::Eye;

/// How the views are rendered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Views {
    /// Each view is path traced.
    Traced,
    /// Sources are path traced, the other views are reprojected from the nearest one, and their holes are path traced.
    Reprojected,
}

/// How the screen image becomes the displayed one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Display {
    /// The screen image is displayed unchanged.
    #[default]
    Direct,
    /// Each eye resamples its image from a shared (rectified) projection.
    Resampled {
        /// Extent of the shared projection, which is then the screen image.
        projection: Extent,
        /// True if late reprojection may resample the shared projection for a newer head pose, using surface depth.
        is_late: bool,
    },
}

impl Display {
    pub fn is_late(self) -> bool {
        matches!(self, Self::Resampled { is_late: true, .. })
    }
}

/// The images of an eye: traced, mapped to the screen, displayed. If a step is left out, the images before and after it
/// are the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageChain {
    /// Polar projection of the traced image, which a pass maps to the screen image; `None` if the screen image is
    /// traced.
    pub polar: Option<PolarSpace>,
    /// The step from the screen image, which has a pinhole projection, to the displayed image.
    pub display: Display,
    /// Extent of the displayed image.
    pub displayed: Extent,
}

impl ImageChain {
    /// Returns the chain of an image that is displayed as traced.
    pub fn direct(extent: Extent) -> Self {
        Self { polar: None, display: Display::Direct, displayed: extent }
    }

    /// Returns the extent of the screen image.
    pub fn screen(&self) -> Extent {
        self.projection().unwrap_or(self.displayed)
    }

    /// Returns the extent of the shared projection, if there is one.
    pub fn projection(&self) -> Option<Extent> {
        match self.display {
            Display::Direct => None,
            Display::Resampled { projection, .. } => Some(projection),
        }
    }
}

/// Specification of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSpec {
    /// Extent of the images that are traced and filtered.
    pub extent: Extent,
    /// The steps from the traced image to the displayed one.
    pub chain: ImageChain,
    pub devices: usize,
    /// Number of views. Two are the eyes.
    pub view_count: usize,
    /// Number of views from which others are reprojected, an odd one.
    pub sources: usize,
    pub views: Views,
    /// True if reprojected views take over their source's light after the filter instead of before, if the denoiser can.
    pub filter_once: bool,
    /// True if views share holes: those that a view's partner has traced as well are taken over from it.
    pub share_holes: bool,
    /// Number of the first iterations of `atrous` that ignore differences in radiance.
    pub blind_iterations: u32,
    /// True if only the pixels that the pass `select` lists are path traced. The filter fills in the others.
    pub sparse: bool,
    pub filter: Option<Denoiser>,
    /// Iterations of the filter. With 0 there is no denoising.
    pub iterations: u32,
    /// Search range of history: the largest vertical motion in rows, since the previous frame, at which a surface's
    /// history is still found. `None` disables history.
    pub history_rows: Option<u32>,
    pub seam: Seam,
    /// Requested auxiliary images.
    pub aovs: Vec<Aov>,
    /// True if any surface of the scene can reflect light. Otherwise only emission is visible.
    pub has_surfaces: bool,
    /// True if paths may end in a radiance cache.
    pub cache: bool,
    /// True if another renderer gives surfaces and light, which one pass then imports instead of tracing rays.
    pub imported: bool,
    /// Dynamic geometry of the scene; `None` if it is static.
    pub moving: Option<Moving>,
}

impl FrameSpec {
    /// Creates a frame without history or auxiliary images, with SVGF and a reprojected right eye.
    pub fn new(extent: Extent, devices: usize) -> Self {
        Self {
            extent,
            chain: ImageChain::direct(extent),
            devices,
            view_count: 2,
            sources: 1,
            views: Views::Reprojected,
            filter_once: true,
            share_holes: true,
            blind_iterations: 3,
            sparse: false,
            filter: Some(Denoiser::SVGF),
            iterations: Denoiser::DEFAULT_ITERATIONS,
            history_rows: None,
            seam: Seam::Halo(HaloPlan::RECOMPUTE),
            aovs: Vec::new(),
            has_surfaces: true,
            cache: false,
            imported: false,
            moving: None,
        }
    }

    /// Returns true if paths end in a radiance cache.
    pub fn caches(&self) -> bool {
        self.cache && self.has_surfaces
    }

    /// Returns the denoiser in effect, if any.
    pub fn denoiser(&self) -> Option<Denoiser> {
        self.filter.filter(|_| self.has_surfaces && self.iterations > 0)
    }

    /// Returns the views: sources first, and partners before the views that take over their light.
    pub fn eyes(&self) -> impl Iterator<Item = Eye> {
        let mut eyes: Vec<Eye> = Eye::of_rig(self.view_count).map(|eye| eye.among(self.sources)).collect();
        eyes.sort_by_key(|eye| (!eye.is_source(), eye.partner().is_some()));
        eyes.into_iter()
    }

    /// Returns the view from which a view is reprojected; `None` if it is path traced.
    pub fn source(&self, view: Eye) -> Option<Eye> {
        (self.views == Views::Reprojected && !view.is_source()).then_some(view.source())
    }

    /// Returns the view from which a reprojected view takes over light that its source lacks.
    pub fn partner(&self, view: Eye) -> Option<Eye> {
        view.partner().filter(|_| self.share_holes && self.views == Views::Reprojected)
    }

    /// Returns true if reprojected views take over the filtered light of their source.
    pub fn takes_over_filtered_light(&self) -> bool {
        let can = self.denoiser().is_some_and(|denoiser| denoiser.method().leaves_finished_light());
        self.filter_once && self.views == Views::Reprojected && self.view_count > self.sources && can
    }

    /// Returns the number of rows that a filter with a reach of `rows` rows reads from each neighbouring stripe:
    /// `rows`, or 0 if stripes are filtered separately.
    pub fn halo(&self, rows: u32) -> u32 {
        if matches!(self.seam, Seam::Halo(_)) { rows } else { 0 }
    }

    /// Returns the number of rows of history that a device reads from each neighbouring stripe: [`Self::history_rows`],
    /// or 0 if stripes are filtered separately. Returns `None` if history is disabled.
    pub fn history_halo(&self) -> Option<u32> {
        self.history_rows.map(|rows| self.halo(rows))
    }
}
