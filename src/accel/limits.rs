//! Limits of trees and tables, and the error for scenes that exceed them.

use crate::scene::budget::Exceeded;

/// Deepest tree that the shaders' traversal stack holds.
pub const MAX_DEPTH: usize = 32;

/// Largest number of stored triangles. Their tables take 112 bytes each on the host and on every device, 7 GiB in
/// total.
pub(super) const MAX_TRIANGLES: usize = 1 << 26;

/// Flag in a hit's primitive number: the rest is the number of a sphere light, not of a triangle.
pub const SPHERE: u32 = 1 << 31;

/// Limit on triangles after instancing: larger numbers name spheres.
pub(super) const MAX_PRIMS: usize = SPHERE as usize;

/// Largest coordinate. Larger ones would overflow sums of areas in the tree's cost.
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
