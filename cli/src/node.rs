//! The connection to the other processes of a run.

use std::sync::{Arc, OnceLock};

use diptych::exec::ranks::Node;

/// The connection of this process, if MPI started it together with others.
pub static NODE: OnceLock<Arc<Node>> = OnceLock::new();

/// Returns the node if this process is rank 0 of several ranks.
pub fn others() -> Option<&'static Arc<Node>> {
    NODE.get().filter(|node| node.rank() == 0 && node.ranks() > 1)
}
