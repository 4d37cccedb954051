//! The images that leave a frame, as messages name them.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::graph::Resource;

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
