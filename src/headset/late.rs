//! Where the head is found to be when a frame is nearly done.

use std::sync::Arc;

use openxr::{Instance, Space, Time};

use super::frame::HeadsetFrame;
use super::pacing::shown_at;
use super::pose::head_pose;
pub use super::sample::HeadSample;

/// The spaces that poses are told in.
pub struct Spaces {
    /// Level, where the headset was at first.
    pub local: Space,
    /// The head's own.
    pub head: Space,
}

/// Asks the runtime where the head will be, from any thread.
#[derive(Clone)]
pub struct Locator {
    pub(super) spaces: Arc<Spaces>,
    /// If it tells the time.
    pub(super) clock: Option<Instance>,
}

impl Locator {
    /// When the frame is shown that is nearly done; none where nothing is known of it.
    pub fn head(&self, frame: &HeadsetFrame) -> Option<HeadSample> {
        let shown = self.now().map_or(frame.display, |now| shown_at(frame.display, frame.period_ns, now));
        self.at(shown)
    }

    fn now(&self) -> Option<Time> {
        self.clock.as_ref()?.now().ok()
    }

    pub(super) fn at(&self, display: Time) -> Option<HeadSample> {
        let at = self.now();
        let Spaces { local, head } = &*self.spaces;
        Some(HeadSample { head: head_pose(&head.locate(local, display).ok()?.pose)?, at })
    }
}
