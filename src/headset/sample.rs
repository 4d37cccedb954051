//! Poses located by the runtime.

use openxr::Time;

use crate::scene::head::HeadPose;

/// Predicted pose of the head, and the time at which the prediction was made.
#[derive(Clone, Copy, Debug)]
pub struct HeadSample {
    pub head: HeadPose,
    pub(super) at: Option<Time>,
}
