//! Late latching: once the rest of a frame is done, the primary asks for the newest head pose and reprojects the frame
//! to it.

use std::fmt;
use std::sync::Arc;

use glam::DVec3;

use crate::image::Extent;
use crate::scene::rig::Rig;
use crate::stages::frame_constants::late_display_maps;
use crate::stages::layout;

/// Predicts the head pose at the time when the frame of this number is displayed. Only the first key of the rig counts.
/// `None` means that no pose is known that is newer than the frame's own. A worker calls it between two submissions, so
/// it should return at once.
pub type PoseSource = dyn Fn(u32) -> Option<Rig> + Send + Sync;

/// Late latching of a frame: the source of the pose that it is shown from, and the inputs of the resampling.
#[derive(Clone)]
pub struct Late {
    source: Arc<PoseSource>,
    frame: u32,
    /// Rig that the frame is rendered from: one key, relative to `origin`.
    rendered: Rig,
    /// Origin of the scene tables, scene units.
    origin: DVec3,
    /// Extents of the displayed and of the rectified images.
    sizes: [Extent; 2],
}

/// A late-latched pose of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledPose {
    /// Rig that the source returned.
    pub rig: Rig,
    /// Time at which it was sampled, in milliseconds since the renderer's origin.
    pub at_ms: f64,
}

impl Late {
    /// Prepares late latching of a frame rendered from a rig of one key. `sizes` are the extents of the displayed and
    /// of the rectified images.
    pub(super) fn new(source: &Arc<PoseSource>, frame: u32, rendered: &Rig, origin: DVec3, sizes: [Extent; 2]) -> Self {
        Self { source: Arc::clone(source), frame, rendered: rendered.relative_to(origin), origin, sizes }
    }

    /// Samples the pose; returns it with its shader constants.
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

impl PartialEq for Late {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.source, &other.source) && (self.frame, &self.rendered) == (other.frame, &other.rendered)
    }
}
