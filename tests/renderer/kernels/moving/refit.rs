//! The kernel `refit`: boxes contain everything below them in any pose, and are hardly larger.

use diptych::accel::Node;
use diptych::scene::motion::pose::Pose;
use glam::{DMat3, UVec3, Vec3, Vec4};
use obvhs::cwbvh::node::CwBvhNode;

use super::{Device, bodies, pose};
use crate::kernels::harness::{Buffer, Kernel};
use crate::kernels::inputs::{Cases, Random};

type Box3 = [Vec3; 2];

fn around(a: Box3, b: Box3) -> Box3 {
    [a[0].min(b[0]), a[1].max(b[1])]
}

const NOTHING: Box3 = [Vec3::INFINITY, Vec3::NEG_INFINITY];

/// Returns the trees after `skin` and `refit`, and the boxes of triangles.
fn refitted(device: &Device, scene: &diptych::scene::Scene, poses: [&Pose; 2]) -> (Vec<CwBvhNode>, Vec<Box3>) {
    let skins = &device.accel.skins;
    let skinned = device.skin(scene, poses, &vec![[0; 4]; device.rows]);
    let (mut tables, mut boxes) = (skinned.get::<[u32; 4]>("tables"), skinned.get::<[f32; 4]>("boxes"));
    let mut begin = 0;
    for &end in &skins.levels {
        let buffers = [
            ("tables", Buffer::whole(&tables)),
            ("tree_nodes", Buffer::whole(&skins.nodes)),
            ("tree_order", Buffer::whole(&skins.order)),
            ("boxes", Buffer::whole(&boxes)),
        ];
        let groups = [(end - begin).div_ceil(64), 1];
        let outputs =
            Kernel::new("refit", &[]).run_once(&device.frame, [begin, end, skins.first_node], groups, &buffers);
        (tables, boxes) = (outputs.get("tables"), outputs.get("boxes"));
        begin = end;
    }
    let first = 5 * skins.first_node as usize;
    let nodes: &[Node] = bytemuck::cast_slice(&tables[first..first + 5 * skins.nodes.len()]);
    let corners: Vec<Vec3> = boxes[2 * skins.nodes.len()..].iter().map(|b| Vec4::from_array(*b).truncate()).collect();
    let nodes = nodes.iter().map(|node| bytemuck::cast(*node)).collect();
    (nodes, corners.chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect())
}

/// Returns a child's box as rays see it, and the quantisation step of its bounds.
fn child_box(node: &CwBvhNode, slot: usize) -> (Box3, Vec3) {
    let unit = Vec3::from_array(node.e.map(|e| f32::from_bits(u32::from(e) << 23)));
    let at = |x: [u8; 8], y: [u8; 8], z: [u8; 8]| {
        node.p + UVec3::new(x[slot].into(), y[slot].into(), z[slot].into()).as_vec3() * unit
    };
    let low = at(node.child_min_x, node.child_min_y, node.child_min_z);
    ([low, at(node.child_max_x, node.child_max_y, node.child_max_z)], unit)
}

/// Traverses a tree; returns the box around the triangles below a node. Every box must contain its triangles and be at
/// most two steps wider on each side.
fn walk(device: &Device, nodes: &[CwBvhNode], triangles: &[Box3], index: usize, seen: &mut Vec<u32>) -> Box3 {
    let skins = &device.accel.skins;
    let node = &nodes[index];
    let mut whole = NOTHING;
    for slot in (0..8).filter(|slot| !node.is_child_empty(*slot)) {
        let inside = if node.is_leaf(slot) {
            let (first, count) = node.child_primitives(slot);
            let rows = (first..first + count).map(|prim| prim - skins.first_row);
            seen.extend(rows.clone());
            rows.map(|row| triangles[row as usize]).fold(NOTHING, around)
        } else {
            let child = node.child_node_index(slot) - skins.first_node;
            walk(device, nodes, triangles, child as usize, seen)
        };
        let (found, unit) = child_box(node, slot);
        assert!(
            found[0].cmple(inside[0]).all() && found[1].cmpge(inside[1]).all(),
            "the box {found:?} in slot {slot} of node {index} does not hold {inside:?}"
        );
        // Coordinates far from 0 may be rounded more coarsely than a step.
        let room = 2.0 * unit + found[0].abs().max(found[1].abs()) * f32::EPSILON;
        let waste = (inside[0] - found[0]).max(found[1] - inside[1]);
        assert!(waste.cmple(room).all(), "the box {found:?} of slot {slot} of node {index} is far around {inside:?}");
        whole = around(whole, inside);
    }
    // Steps are as short as possible: half of them would not cover the extent.
    let reach = whole[1] - whole[0];
    let step = Vec3::from_array(node.e.map(|e| f32::from_bits(u32::from(e) << 23)));
    assert!((0.5 * step * 254.0).cmple(reach.max(Vec3::splat(1e-30)) * 1.001).all(), "{step} steps for {reach}");
    whole
}

#[test]
fn refitted_boxes_enclose_triangles_in_any_pose() {
    let scene = bodies();
    let device = Device::new(&scene);
    let skins = &device.accel.skins;
    let mut random = Random::new(72);
    let mut cases = Cases::default();
    for round in 0..12 {
        let mut now = pose(&scene, &mut random);
        for world in &mut now.world_from_node {
            match round {
                0..6 => cases.meet("anywhere"),
                6..8 => {
                    cases.meet("far off");
                    world.translation *= 1e4;
                }
                8..10 => {
                    cases.meet("flat");
                    world.matrix3 = DMat3::from_diagonal(glam::DVec3::new(1.0, 0.0, 1e-3)) * world.matrix3;
                }
                _ => {
                    cases.meet("nothing");
                    world.matrix3 = DMat3::ZERO;
                }
            }
        }
        let (nodes, triangles) = refitted(&device, &scene, [&now, &now]);
        let mut seen = Vec::new();
        let mut children = vec![false; nodes.len()];
        for (node, built) in nodes.iter().zip(&skins.nodes) {
            let built: CwBvhNode = bytemuck::cast(*built);
            assert_eq!((node.imask, node.child_meta), (built.imask, built.child_meta));
            for slot in (0..8).filter(|slot| !node.is_child_empty(*slot) && !node.is_leaf(*slot)) {
                children[(node.child_node_index(slot) - skins.first_node) as usize] = true;
            }
        }
        let roots = (0..nodes.len()).filter(|node| !children[*node]);
        let count = roots.map(|root| walk(&device, &nodes, &triangles, root, &mut seen)).count();
        assert_eq!(count, scene.motion.bodies.len());
        seen.sort_unstable();
        assert_eq!(seen, (0..skins.triangles.len() as u32).collect::<Vec<_>>(), "triangles below the trees");
    }
    assert!(skins.levels.len() > 1, "the trees have one level");
    cases.assert_met(&["anywhere", "far off", "flat", "nothing"]);
}
