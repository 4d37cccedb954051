//! Builds a tree over boxes whose depth is bounded, however the boxes lie.
//!
//! The builder of obvhs joins neighbours whose common box is small (Meister & Bittner, "Parallel Locally-Ordered
//! Clustering for Bounding Volume Hierarchy Construction", TVCG 24(3), 2018). Boxes at one place have the same common box,
//! so it joins one pair of them at a time: into a chain as deep as there are boxes, in quadratic time. Such boxes get a
//! balanced subtree instead, which splits them by size and number.

use std::borrow::Cow;

use glam::DVec3;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use obvhs::ploc::morton::morton_encode_u64_unorm;

use super::built::{Built, depth};

/// Largest number of boxes at one place that the builder of obvhs joins.
const MOST_TOGETHER: usize = 16;
/// Number of rounds of the builder above which its tree may be too deep for the recursion that converts it.
const MOST_ROUNDS: usize = 1024;

/// Builds a tree over boxes. `order` holds the number to store for each box. A tree of more than `most_levels` levels is
/// replaced by a balanced one.
pub fn tree_over_boxes(boxes: Vec<Aabb>, order: Vec<u32>, params: &BvhBuildParams, most_levels: usize) -> Built {
    let crowds = crowds(&boxes);
    let mut numbers: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut bounds = Cow::Borrowed(&boxes[..]);
    if !crowds.is_empty() {
        let mut is_alone = vec![true; boxes.len()];
        crowds.iter().flatten().for_each(|leaf| is_alone[leaf.first_index as usize] = false);
        numbers.retain(|&i| is_alone[i as usize]);
        let alone = numbers.iter().map(|&i| boxes[i as usize]);
        bounds = alone.chain(crowds.iter().map(|crowd| common_box(crowd))).collect();
        numbers.extend((boxes.len() as u32..).zip(&crowds).map(|(number, _)| number));
    }
    let mut bvh = PlocBuilder::with_capacity(bounds.len()).build(
        params.ploc_search_distance,
        &bounds,
        numbers,
        params.sort_precision,
        params.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut bvh, params.reinsertion_batch_ratio, None);
    if !crowds.is_empty() {
        for leaf in 0..bvh.nodes.len() {
            let node = bvh.nodes[leaf];
            if let Some(crowd) = (node.first_index as usize).checked_sub(boxes.len()).filter(|_| node.is_leaf()) {
                expand(&mut bvh, leaf, &crowds[crowd]);
            }
        }
    }
    drop((boxes, crowds));
    bvh.primitive_indices = order;
    if bvh.max_depth <= MOST_ROUNDS {
        let built = converted(&bvh, params);
        if depth(&built.nodes) <= most_levels {
            return built;
        }
    }
    converted(&balanced(bvh), params)
}

fn converted(bvh: &Bvh2, params: &BvhBuildParams) -> Built {
    let bvh = bvh2_to_cwbvh(bvh, params.max_prims_per_leaf, true, false);
    Built { nodes: bvh.nodes, order: bvh.primitive_indices }
}

/// Returns the groups of more than [`MOST_TOGETHER`] boxes at one place as leaves, in the order of size and number.
fn crowds(boxes: &[Aabb]) -> Vec<Vec<Bvh2Node>> {
    if boxes.len() <= MOST_TOGETHER {
        return Vec::new();
    }
    // Places that have the same hash are told apart by sorting.
    let bits = boxes.len().next_power_of_two().trailing_zeros();
    let hash = |bounds: &Aabb| {
        let mix = |hash: u64, part: u64| (hash.rotate_left(5) ^ part).wrapping_mul(0x517c_c1b7_2722_0a95);
        (place(bounds).into_iter().fold(0, mix) >> (64 - bits)) as usize
    };
    let mut counts = vec![0u32; 1 << bits];
    boxes.iter().for_each(|bounds| counts[hash(bounds)] += 1);
    let is_crowded = |(_, bounds): &(u32, &Aabb)| counts[hash(bounds)] as usize > MOST_TOGETHER;
    let mut crowded: Vec<([u64; 4], u32, u32)> = (0..)
        .zip(boxes)
        .filter(is_crowded)
        .map(|(number, bounds)| (place(bounds), bounds.half_area().to_bits(), number))
        .collect();
    crowded.sort_unstable();
    let groups = crowded.chunk_by(|a, b| a.0 == b.0).filter(|group| group.len() > MOST_TOGETHER);
    groups.map(|group| group.iter().map(|(.., i)| Bvh2Node::new(boxes[*i as usize], 1, *i)).collect()).collect()
}

/// Returns the place of a box: its size as a power of two, and its centre in a grid of 2^20 cells per size. The areas
/// of the common boxes of boxes at one place are the same or differ by little more than rounding errors.
fn place(bounds: &Aabb) -> [u64; 4] {
    let exponent = (bounds.max - bounds.min).max_element().max(f32::MIN_POSITIVE).to_bits() >> 23;
    let cell = f64::from(f32::from_bits(exponent << 23)) / f64::from(1 << 20);
    let centre = (bounds.min.as_dvec3() + bounds.max.as_dvec3()) / (2.0 * cell);
    // The sum turns -0 into 0.
    let [x, y, z] = (centre.round() + DVec3::ZERO).to_array().map(f64::to_bits);
    [x, y, z, u64::from(exponent)]
}

fn common_box(leaves: &[Bvh2Node]) -> Aabb {
    leaves.iter().fold(Aabb::empty(), |all, leaf| all.union(leaf.aabb()))
}

/// Replaces a leaf by a balanced tree over these leaves, in this order.
fn expand(bvh: &mut Bvh2, leaf: usize, leaves: &[Bvh2Node]) {
    let mut open = vec![(leaf, leaves)];
    while let Some((node, leaves)) = open.pop() {
        if let &[one] = leaves {
            bvh.nodes[node] = one;
            continue;
        }
        let first = bvh.nodes.len();
        bvh.nodes[node] = Bvh2Node::new(common_box(leaves), 0, first as u32);
        bvh.nodes.resize(first + 2, Bvh2Node::default());
        let (left, right) = leaves.split_at(leaves.len() / 2);
        open.extend([(first, left), (first + 1, right)]);
    }
}

/// Returns a balanced tree over the leaves of a tree, along a curve through their centres.
fn balanced(bvh: Bvh2) -> Bvh2 {
    let mut leaves: Vec<Bvh2Node> = bvh.nodes.into_iter().filter(Bvh2Node::is_leaf).collect();
    let all = common_box(&leaves);
    let scale = all.diagonal().as_dvec3().max(DVec3::splat(f64::MIN_POSITIVE)).recip();
    let code = |leaf: &Bvh2Node| {
        let centre = (leaf.aabb().min.as_dvec3() + leaf.aabb().max.as_dvec3()) / 2.0;
        morton_encode_u64_unorm((centre - all.min.as_dvec3()) * scale)
    };
    leaves.sort_by_cached_key(|leaf| (code(leaf), leaf.first_index));
    let mut balanced =
        Bvh2 { nodes: vec![Bvh2Node::default()], primitive_indices: bvh.primitive_indices, ..Bvh2::default() };
    expand(&mut balanced, 0, &leaves);
    balanced
}

#[cfg(test)]
mod tests;
