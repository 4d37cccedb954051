//! State of the tasks that a device divides itself.

use std::collections::HashMap;
use std::time::Instant;

/// State of the tasks that a device divides itself.
#[derive(Default)]
pub struct Probing {
    /// Number of submissions of each task.
    pub submissions: HashMap<usize, u32>,
    /// Estimated cost of the work that is done.
    pub done: f64,
    /// Instant from which tasks end early.
    pub ending: Option<Instant>,
    /// Samples of the task that has ended with the fewest, of those that count.
    pub least: Option<u32>,
}

impl Probing {
    /// Returns the samples of each pixel if the frame has ended early.
    pub fn spp_done(&self) -> Option<u32> {
        self.ending.and(self.least)
    }
}
