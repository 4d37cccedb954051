//! Late latching: once the rest of a frame is done, the primary asks for the newest head pose and reprojects the frame
//! to it.

use std::fmt;
use std::sync::Arc;

use glam::DVec3;

use crate::frame::constants::late_display_maps;
use crate::image::Extent;
use crate::layout;
use crate::scene::rig::Rig;

/// Function that takes a frame number and returns a rig at the head pose predicted for the frame's display time. Only
/// the first key of the rig is used. `None` means that no pose is newer than the one that the frame was rendered from.
/// A worker calls the function between two submissions, so it should return at once.
pub type PoseSource = dyn Fn(u32) -> Option<Rig> + Send + Sync;

/// Late latching of a frame: the source of the pose from which the frame is displayed, and the inputs of the display
/// resampling.
#[derive(Clone)]
pub struct Late {
    source: Arc<PoseSource>,
    frame: u32,
    /// Rig that the frame is rendered from: one key, relative to `origin`.
    rendered: Rig,
    /// World position of the scene tables' origin, in scene units.
    origin: DVec3,
    /// Extents of the displayed and of the rectified images.
    sizes: [Extent; 2],
}

/// A late-latched pose of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledPose {
    /// Rig that the source returned.
    pub rig: Rig,
    /// Time at which the pose was sampled, in milliseconds since the renderer's origin.
    pub at_ms: f64,
}

impl Late {
    /// Prepares late latching of a frame rendered from a rig of one key. `sizes` are the extents of the displayed and
    /// of the rectified images.
    pub(super) fn new(source: &Arc<PoseSource>, frame: u32, rendered: &Rig, origin: DVec3, sizes: [Extent; 2]) -> Self {
        Self { source: Arc::clone(source), frame, rendered: rendered.relative_to(origin), origin, sizes }
    }

    /// Samples the pose source at the current time `at_ms`. Returns the pose and each eye's mapping for the display
    /// resampling; `None` if there is no newer pose, or the rig has no custom optics.
    pub fn ask(&self, at_ms: f64) -> Option<(SampledPose, [layout::DisplayMap; 2])> {
        let rig = (self.source)(self.frame)?;
        let optics = self.rendered.optics.as_ref()?;
        let maps = late_display_maps(optics, self.sizes, [&self.rendered, &rig.relative_to(self.origin)]);
        Some((SampledPose { rig, at_ms }, maps))
    }
}

impl fmt::Debug for Late {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Late").field("frame", &self.frame).finish_non_exhaustive()
    }
}
