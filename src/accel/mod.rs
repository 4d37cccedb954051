//! Acceleration structures: instanced meshes flattened to world space under one compressed wide BVH, in the layout that
//! `shaders/shared/traverse_compute.inc.wgsl` traverses. If that takes too much memory, meshes that several instances
//! share stay in local space with a tree each, under a top-level tree over the instances.
//!
//! Triangles are stored in tree order, so a leaf's triangle index is the triangle's row in every table.

mod boxes;
mod build;
mod built;
mod cache;
mod clearance;
mod flatten;
mod instances;
mod limits;
mod moving;
mod origin;
mod skins;
mod tables;
mod tree;
mod triangle;

pub use self::cache::TreeCache;
pub use self::instances::{Instance, Layout};
pub use self::limits::{AccelError, MAX_DEPTH, SPHERE};
pub use self::moving::{Moved, Placed, Poses};
pub use self::skins::{COLUMNS, SkinMorph, SkinTriangle, SkinVertex, Skinned, Skins};
pub(crate) use self::skins::{CONSTANTS as SKIN_CONSTANTS, structs as skin_structs};
pub use self::tables::Accel;
pub use self::tree::Node;
pub use self::triangle::{Shading, TRIANGLE_ALPHA, Triangle, structs};
