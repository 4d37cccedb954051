//! The connection to the other processes of a run.

use std::sync::{Arc, OnceLock};

use crate::exec::ranks::Node;

/// This process among those that were started together.
pub static NODE: OnceLock<Arc<Node>> = OnceLock::new();

/// What leads from rank 0 to others, if there are any.
pub fn others() -> Option<&'static Arc<Node>> {
    NODE.get().filter(|node| node.rank() == 0 && node.ranks() > 1)
}
