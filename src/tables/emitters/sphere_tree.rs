//! A bounding volume hierarchy over spherical lights: boxes in depth-first order, each with the index of the node to
//! skip to after a miss (Smits, "Efficiency Issues for Ray Tracing", JGT 3(2), 1998), so that rays need no stack.

use glam::{DVec3, Vec3};

use crate::layout::NO_LIGHT;

/// Rows of the shader's table that a node takes.
pub(super) const ROWS: u32 = 2;

/// A node: low corner, row to skip to after a miss, high corner, and sphere ([`NO_LIGHT`] in inner nodes).
pub(super) type Node = [u32; 8];

/// Builds the tree over spheres of (centre, radius). Its rows start at `first_row` of the shader's table of nodes. The
/// same spheres give the same tree.
pub(super) fn build(spheres: &[(Vec3, f32)], first_row: u32) -> Vec<Node> {
    let mut order: Vec<usize> = (0..spheres.len()).collect();
    let mut nodes = Vec::with_capacity(2 * spheres.len());
    // The nodes of a subtree are contiguous, so its size tells where it ends.
    let mut open = vec![(0, spheres.len())];
    while let Some((first, last)) = open.pop() {
        let members = &mut order[first..last];
        let Some(&one) = members.first() else { continue };
        let (low, high) = bounds(spheres, members);
        let skip = first_row + ROWS * (nodes.len() + 2 * members.len() - 1) as u32;
        let sphere = if members.len() == 1 { one as u32 } else { NO_LIGHT };
        let (low, high) = (low.map(outwards::<false>), high.map(outwards::<true>));
        nodes.push([low[0], low[1], low[2], skip, high[0], high[1], high[2], sphere]);
        if members.len() > 1 {
            let middle = first + halve(spheres, members);
            open.extend([(middle, last), (first, middle)]);
        }
    }
    nodes
}

/// Partitions `members` at the median sphere along the longest side of the box around their centres. Returns the size
/// of the first part.
fn halve(spheres: &[(Vec3, f32)], members: &mut [usize]) -> usize {
    let centres = members.iter().map(|&i| spheres[i].0);
    let (low, high) = centres.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
    let axis = (0..3).max_by(|&a, &b| (high - low)[a].total_cmp(&(high - low)[b])).unwrap_or(0);
    let middle = members.len() / 2;
    let key = |i: &usize| spheres[*i].0[axis];
    members.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
    middle
}

fn bounds(spheres: &[(Vec3, f32)], members: &[usize]) -> ([f64; 3], [f64; 3]) {
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for (centre, radius) in members.iter().map(|&i| spheres[i]) {
        low = low.min(centre.as_dvec3() - f64::from(radius));
        high = high.max(centre.as_dvec3() + f64::from(radius));
    }
    (low.to_array(), high.to_array())
}

/// Returns the bits of an f32 above `x` if `UP`, otherwise of one below it.
fn outwards<const UP: bool>(x: f64) -> u32 {
    let nearest = x as f32;
    (if UP { nearest.next_up() } else { nearest.next_down() }).to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spheres_lie_in_one_leaf_and_in_all_boxes_above() {
        let spheres: Vec<_> = (0..37u32)
            .map(|i| (Vec3::new((i * 7 % 13) as f32, (i * 5 % 11) as f32 * 1e3, (i % 3) as f32), 0.1 + i as f32))
            .collect();
        let first_row = 10;
        let nodes = build(&spheres, first_row);
        assert_eq!(nodes.len(), 2 * spheres.len() - 1);
        let mut seen = vec![0; spheres.len()];
        for (i, node) in nodes.iter().enumerate() {
            let end = (node[3] - first_row) as usize / 2;
            assert!(end > i && end <= nodes.len());
            for leaf in nodes[i..end].iter().filter(|n| n[7] != NO_LIGHT) {
                let (centre, radius) = spheres[leaf[7] as usize];
                for axis in 0..3 {
                    assert!(f32::from_bits(node[axis]) < centre[axis] - radius);
                    assert!(f32::from_bits(node[4 + axis]) > centre[axis] + radius);
                }
            }
            if node[7] != NO_LIGHT {
                seen[node[7] as usize] += 1;
                assert_eq!(end, i + 1);
            }
        }
        assert!(seen.iter().all(|&n| n == 1));
    }
}
