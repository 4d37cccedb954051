//! The images that leave a frame, as messages name them.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::graph::{Program, Resource};
use crate::passes::ROW_TALLY;

/// An image that the primary has whole and can send to the host.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Output {
    pub name: Cow<'static, str>,
    /// Which of several alike.
    pub number: u8,
}

impl From<Resource> for Output {
    fn from(resource: Resource) -> Self {
        Self { name: resource.name.into(), number: resource.number }
    }
}

impl Output {
    /// What comes with the answer to a frame: the counts of its rows, if its passes count, then what was asked for.
    pub fn of_frame(program: &Program, reads: &[Self]) -> Vec<Self> {
        let counts = program.images().iter().any(|image| image.resource == ROW_TALLY);
        counts.then(|| ROW_TALLY.into()).into_iter().chain(reads.iter().cloned()).collect()
    }
}
