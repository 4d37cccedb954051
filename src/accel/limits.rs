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
        "the scene's tree is {depth} levels deep, more than the {MAX_DEPTH} a ray's stack holds: its triangles are stacked on one another, simplify the scene"
    )]
    TooDeep { depth: usize },
    #[error(
        "the scene has {0} triangles, those that instances share counted once, more than the {MAX_TRIANGLES} that fit into memory: simplify it"
    )]
    TooMany(usize),
    #[error(
        "the scene has {0} triangles after instancing, more than the {MAX_PRIMS} that can be told apart: simplify it"
    )]
    TooManyInstances(usize),
    #[error(
        "the scene reaches to {0:e} units, more than the {MAX_REACH:e} that areas can be reckoned with: scale it down"
    )]
    TooLarge(f64),
    #[error("the scene's {triangles} triangles after instancing are refused: {exceeded}")]
    Memory { triangles: usize, exceeded: Exceeded },
}
