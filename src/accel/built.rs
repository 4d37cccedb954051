//! A finished tree over triangles.

use obvhs::cwbvh::node::CwBvhNode;

/// A tree over triangles: its nodes, of which the first is the root, and the triangle of each leaf entry.
#[derive(Clone, Debug, PartialEq)]
pub struct Built {
    pub nodes: Vec<CwBvhNode>,
    pub order: Vec<u32>,
}

impl Built {
    /// Returns true if all children, leaf entries and triangles exist, and each node but the root has one parent, which
    /// comes before it.
    pub fn is_sound(&self, triangles: usize) -> bool {
        let mut has_parent = vec![false; self.nodes.len()];
        let mut is_parent = |(index, node): (usize, &CwBvhNode)| {
            let first = node.child_base_idx as usize;
            let children = node.imask.count_ones() as usize;
            let are_new = children == 0 || {
                let range = has_parent.get_mut(first..first.saturating_add(children));
                first > index && range.is_some_and(|range| range.iter_mut().all(|has| !std::mem::replace(has, true)))
            };
            let has_entries = |(slot, meta): (usize, &u8)| {
                let is_leaf = node.imask & (1 << slot) == 0;
                let end =
                    u64::from(node.primitive_base_idx) + u64::from(meta & 31) + u64::from((meta >> 5).count_ones());
                !is_leaf || *meta == 0 || end <= self.order.len() as u64
            };
            are_new && node.child_meta.iter().enumerate().all(has_entries)
        };
        let is_within = !self.nodes.is_empty() && self.order.iter().all(|&i| (i as usize) < triangles);
        is_within && self.order.len() >= triangles && self.nodes.iter().enumerate().all(&mut is_parent)
    }
}

/// Returns the tree's depth, without recursion.
pub fn depth(nodes: &[CwBvhNode]) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0u32, 1usize)];
    while let Some((index, level)) = open.pop() {
        deepest = deepest.max(level);
        let node = &nodes[index as usize];
        let children = node.imask.count_ones();
        open.extend((0..children).map(|c| (node.child_base_idx + c, level + 1)));
    }
    deepest
}
