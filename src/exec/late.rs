//! Frames that are shown from where the head is found to be when all else of them is done.

use std::fmt;
use std::sync::Arc;

use glam::DVec3;

use super::constants::shown_later;
use super::{FrameParams, Renderer};
use crate::image::Extent;
use crate::scene::rig::Rig;
use crate::stages::layout;

/// Says where the head will be when the frame of this number is shown, as a rig of which the first key counts; none: nothing
/// newer is known than what the frame began with. A worker asks it, between two submissions: it should answer at once.
pub type PoseSource = dyn Fn(u32) -> Option<Rig> + Send + Sync;

/// What a frame needs to be shown from a pose that is asked for.
#[derive(Clone)]
pub struct Late {
    source: Arc<PoseSource>,
    frame: u32,
    /// As it is rendered: one key, relative to `origin`.
    rendered: Rig,
    /// Of the tables, scene units.
    origin: DVec3,
    /// Of what eyes show and of the rectified frame.
    sizes: [Extent; 2],
}

/// A pose that a frame is shown from.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledPose {
    /// As the source gave it.
    pub rig: Rig,
    /// When it was asked for, milliseconds since the renderer's origin.
    pub at_ms: f64,
}

impl Late {
    /// Of a frame that is rendered as a rig of one key sees it; `sizes` are those of what eyes show and of the rectified frame.
    fn new(source: &Arc<PoseSource>, frame: u32, rendered: &Rig, origin: DVec3, sizes: [Extent; 2]) -> Self {
        Self { source: Arc::clone(source), frame, rendered: rendered.relative_to(origin), origin, sizes }
    }

    /// Asks for the pose; returns it with what shaders need of it.
    pub fn ask(&self, at_ms: f64) -> Option<(SampledPose, [layout::Shown; 2])> {
        let rig = (self.source)(self.frame)?;
        let optics = self.rendered.optics.as_ref()?;
        let shown = shown_later(optics, self.sizes, [&self.rendered, &rig.relative_to(self.origin)]);
        Some((SampledPose { rig, at_ms }, shown))
    }
}

impl Renderer {
    /// Has frames that are begun from here on shown from a pose that the source is asked for when all else of them is done,
    /// by the primary, which then resamples them alone. [`super::FrameReport::shown_from`] has it. Where the source knows
    /// none, or the primary is on another rank, it is [`FrameParams::shown_from`]. Of use with
    /// [`crate::stages::StageSettings::is_late`].
    pub fn set_pose_source(&mut self, source: Option<Arc<PoseSource>>) {
        self.pose_source = source;
    }

    /// Returns what a frame asks the source, if there is one.
    pub(super) fn late(&self, params: &FrameParams) -> Option<Late> {
        let FrameParams { rig, time_s, index, .. } = params;
        let stages = &self.settings.stages;
        let source = self.pose_source.as_ref().filter(|_| stages.is_late)?;
        Some(Late::new(source, *index, &rig.at(*time_s), self.tables.origin(), [stages.extent, stages.screen()]))
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
