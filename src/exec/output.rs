//! Names by which messages refer to a frame's output images.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::graph::{Program, Resource};
use crate::passes::ROW_TALLY;

/// An image that is complete on the primary and can be sent to the host.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Output {
    pub name: Cow<'static, str>,
    /// Index among the images of this name.
    pub number: u8,
}

impl From<Resource> for Output {
    fn from(resource: Resource) -> Self {
        Self { name: resource.name.into(), number: resource.number }
    }
}

impl Output {
    /// Returns the images that are sent with a frame's answer: the row tallies, if its passes count them, then `reads`.
    pub fn of_frame(program: &Program, reads: &[Self]) -> Vec<Self> {
        let counts = program.images().iter().any(|image| image.resource == ROW_TALLY);
        counts.then(|| ROW_TALLY.into()).into_iter().chain(reads.iter().cloned()).collect()
    }
}
