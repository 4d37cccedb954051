//! Limits of trees and tables, and the error for scenes that exceed them.

use crate::scene::budget::Exceeded;

/// Deepest tree that the shaders' traversal stack holds.
pub const MAX_DEPTH: usize = 32;

/// Depth above which the tree over instances is replaced by a balanced one. A tree over triangles may take the rest of
/// [`MAX_DEPTH`].
pub(super) const MAX_INSTANCE_DEPTH: usize = 12;

/// Maximum number of stored triangles. Each takes 112 bytes in the tables, which are then 7 GiB on the host and on
/// every device.
pub(super) const MAX_TRIANGLES: usize = 1 << 26;

/// Flag in a hit's primitive number: the rest is the number of a sphere light, not of a triangle.
pub const SPHERE: u32 = 1 << 31;

/// Limit on the number of triangles after instancing, since larger primitive numbers denote sphere lights.
pub(super) const MAX_PRIMS: usize = SPHERE as usize;

/// Maximum distance of a coordinate from the origin of the tables, scene units. Larger ones would overflow the sums of
/// areas in the cost of a BVH.
pub(super) const MAX_REACH: f64 = 1e14;

#[derive(Debug, thiserror::Error)]
pub enum AccelError {
    #[error(
        "the scene's BVH is {depth} levels deep, more than the {MAX_DEPTH} that a ray's traversal stack holds: too many triangles overlap, simplify the scene"
    )]
    TooDeep { depth: usize },
    #[error(
        "the scene has {0} triangles (those shared by instances counted once), more than the limit of {MAX_TRIANGLES}: simplify it"
    )]
    TooMany(usize),
    #[error("the scene has {0} triangles after instancing, more than the limit of {MAX_PRIMS}: simplify it")]
    TooManyInstances(usize),
    #[error("the scene extends to {0:e} units, beyond the limit of {MAX_REACH:e}: scale it down")]
    TooLarge(f64),
    #[error("the BVH of the scene's {triangles} triangles (after instancing) does not fit into memory: {exceeded}")]
    Memory { triangles: usize, exceeded: Exceeded },
}
