//! Builder of the BVH over triangles, its nodes, and its memory bounds.

use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::node::CwBvhNode;
use obvhs::ploc::PlocSearchDistance;
use obvhs::splits::split_aabbs_preset;

use super::boxes::tree_over_boxes;
use super::built::Built;
use super::cache::TreeCache;
use super::flatten::Flat;
use super::limits::{AccelError, MAX_DEPTH, MAX_INSTANCE_DEPTH};
use crate::scene::budget::Budget;

/// Upper bound on the bytes per triangle that a build takes in addition to the tables. `NODE_BYTES` is the bound for
/// the finished tree.
pub const BUILD_BYTES: usize = 320;
const NODE_BYTES: usize = 80;

/// Number of triangles above which the fraction of nodes that are inserted again falls, and its minimum relative to that
/// of smaller scenes.
const LARGE: usize = 2_000_000;
const LEAST_REINSERTED: f32 = 0.3;

/// A node of 80 bytes in obvhs's layout.
pub type Node = [u32; 20];

/// Position and depth of a tree in the scene tables.
#[derive(Clone, Copy, Debug)]
pub struct Tree {
    pub root: u32,
    pub first_row: u32,
    pub rows: u32,
    pub levels: usize,
}

/// Memory available for the triangles of a scene.
pub struct Room<'a> {
    pub budget: &'a Budget,
    /// Bytes of one triangle across all tables.
    pub row_bytes: usize,
    /// Number of triangles after instancing.
    pub triangles: usize,
    pub cache: &'a TreeCache,
}

impl Room<'_> {
    /// Returns the bytes budgeted per triangle once its tree is built.
    pub fn stored_bytes(&self) -> usize {
        2 * self.row_bytes + NODE_BYTES
    }
}

/// Builds the tree over triangles. If `splits`, first splits the bounding boxes of relatively large triangles (Karras &
/// Aila, "Fast Parallel Construction of High-Quality Bounding Volume Hierarchies", HPG 2013). Several small boxes
/// enclose a large triangle of a wall or a beam more tightly than one box, so fewer rays test it. Splitting adds at
/// most 0.9 boxes per triangle.
///
/// Inserting nodes again takes most of the time. Of large scenes, a smaller fraction of the nodes is inserted again, those
/// of the largest area, and more neighbours are considered for pairs before.
pub fn tree_over(flat: &Flat<'_>, splits: bool, room: &Room) -> Result<Built, AccelError> {
    const PARAMS: BvhBuildParams = BvhBuildParams::slow_build();
    const MOST_IN_A_LEAF: u32 = 3;
    let count = flat.len();
    let triangle = |i: usize| {
        let [v0, v1, v2] = flat.vertices(i).map(Into::into);
        obvhs::triangle::Triangle { v0, v1, v2 }
    };
    let mut boxes: Vec<Aabb> = (0..count).map(|i| triangle(i).aabb()).collect();
    let mut indices: Vec<u32> = (0..count as u32).collect();
    if splits {
        let areas = || boxes.iter().map(Aabb::half_area);
        let (average, largest) = (areas().sum::<f32>() / boxes.len() as f32, areas().fold(0.0, f32::max));
        let triangles: Vec<_> = (0..count).map(triangle).collect();
        split_aabbs_preset(&mut boxes, &mut indices, &triangles, average, largest);
    }
    let copies = boxes.len() - count;
    let making = copies * (2 * room.row_bytes + BUILD_BYTES);
    let refused = |exceeded| AccelError::Memory { triangles: room.triangles, exceeded };
    let _reserved = room.budget.reserve(making as u64).map_err(refused)?;
    let params = BvhBuildParams {
        ploc_search_distance: if count > LARGE { PlocSearchDistance::VeryHigh } else { PARAMS.ploc_search_distance },
        reinsertion_batch_ratio: PARAMS.reinsertion_batch_ratio
            * (LARGE as f32 / count as f32).clamp(LEAST_REINSERTED, 1.0),
        max_prims_per_leaf: MOST_IN_A_LEAF,
        ..PARAMS
    };
    Ok(tree_over_boxes(boxes, indices, &params, MAX_DEPTH - MAX_INSTANCE_DEPTH))
}

/// Returns a tree's nodes for a table in which its root has index `root` and its leaf indices start at `first`.
pub fn nodes_from(nodes: &[CwBvhNode], root: u32, first: u32) -> impl Iterator<Item = Node> {
    nodes.iter().map(move |node| {
        let mut node = *node;
        node.child_base_idx = node.child_base_idx.wrapping_add(root);
        node.primitive_base_idx = node.primitive_base_idx.wrapping_add(first);
        bytemuck::cast::<_, Node>(node)
    })
}

#[cfg(test)]
mod tests {
    use crate::accel::{Accel, TRIANGLE_ALPHA};
    use crate::scene::builtin;

    #[test]
    fn split_triangles_refer_to_their_first_row() {
        let scene = builtin::find("atrium").unwrap().build();
        let accel = Accel::build(&scene).unwrap();
        let firsts = accel.triangles.iter().enumerate().filter(|(row, t)| t.is_first(*row)).count();
        assert_eq!(firsts, scene.triangle_count());
        assert!((1..firsts * 9 / 10).contains(&(accel.triangles.len() - firsts)));
        for (row, t) in accel.triangles.iter().enumerate() {
            let first = (t.first_copy & !TRIANGLE_ALPHA) as usize;
            assert!(first <= row && accel.triangles[first].is_first(first));
            assert_eq!(
                [t.v0, t.v1, t.v2],
                [accel.triangles[first].v0, accel.triangles[first].v1, accel.triangles[first].v2]
            );
        }
    }
}
