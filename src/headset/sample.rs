//! A pose that the runtime has told.

use openxr::Time;

use crate::scene::head::HeadPose;

/// Where the head will be, as it was told at a time.
#[derive(Clone, Copy, Debug)]
pub struct HeadSample {
    pub head: HeadPose,
    pub(super) at: Option<Time>,
}
