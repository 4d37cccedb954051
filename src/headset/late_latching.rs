//! Late latching: locates the head again when a frame is nearly done.

use std::sync::Arc;

use openxr::{Instance, Space, Time};

use super::frame::{HeadSample, HeadsetFrame};
use super::pacing::shown_at;
use super::pose::head_pose;

/// Reference spaces in which poses are located.
pub struct Spaces {
    /// Gravity-aligned space with its origin at the headset's initial position.
    pub local: Space,
    /// Space of the head itself.
    pub head: Space,
}

/// Predicts the head's pose, from any thread.
#[derive(Clone)]
pub struct Locator {
    pub(super) spaces: Arc<Spaces>,
    /// Instance to query the time from, if the runtime has a clock.
    pub(super) clock: Option<Instance>,
}

impl Locator {
    /// Predicts the head's pose for the time at which `frame` will be shown if it is ready now. Returns `None` if the
    /// pose is unknown.
    pub fn head(&self, frame: &HeadsetFrame) -> Option<HeadSample> {
        let shown = self.now().map_or(frame.display, |now| shown_at(frame.display, frame.period_ns, now));
        self.at(shown)
    }

    /// Returns the current time of the runtime's clock, if it has one.
    pub(super) fn now(&self) -> Option<Time> {
        self.clock.as_ref()?.now().ok()
    }

    pub(super) fn at(&self, display: Time) -> Option<HeadSample> {
        let at = self.now();
        let Spaces { local, head } = &*self.spaces;
        Some(HeadSample { head: head_pose(&head.locate(local, display).ok()?.pose)?, at })
    }
}
