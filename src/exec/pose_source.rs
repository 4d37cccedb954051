//! The renderer's pose source for late latching.

use std::sync::Arc;

use super::late_latching::{Late, PoseSource};
use super::{FrameParams, Renderer};

impl Renderer {
    /// Sets the pose source for late reprojection of frames begun from now on. Once all other passes of a frame are
    /// done, the primary asks the source for a pose and resamples all rows of both eyes to it.
    /// [`super::FrameReport::shown_from`] records the pose. If the source returns `None`, or the primary is on another
    /// rank, frames use [`FrameParams::shown_from`]. The source is used only with [`crate::passes::Display::is_late`].
    pub fn set_pose_source(&mut self, source: Option<Arc<PoseSource>>) {
        self.pose_source = source;
    }

    /// Returns the inputs of a frame's late latching; `None` without a pose source or without
    /// [`crate::passes::Display::is_late`].
    pub(super) fn late(&self, params: &FrameParams) -> Option<Late> {
        let FrameParams { rig, time_s, index, .. } = params;
        let source = self.pose_source.as_ref().filter(|_| self.config.buffers.display.is_late())?;
        Some(Late::new(
            source,
            *index,
            &rig.at(*time_s),
            self.tables.origin(),
            [self.config.buffers.extent, self.config.screen()],
        ))
    }
}
