//! Poses located by the runtime.

use openxr::Time;

use crate::scene::head::HeadPose;

/// Predicted pose of the head, with the time at which it was predicted.
#[derive(Clone, Copy, Debug)]
pub struct HeadSample {
    pub head: HeadPose,
    pub(super) at: Option<Time>,
}
