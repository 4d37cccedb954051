//! Construction of the tables: BVHs over static geometry, over deforming bodies and over meshes that instances share.

use glam::{DVec3, Vec3};
use obvhs::cwbvh::CwBvh;

use super::flatten::{self, Flat, Present};
use super::instances::{self, Shared};
use super::moving::{By, Placement};
use super::tree::{Room, Tree, depth, tree_over};
use super::{Accel, AccelError, MAX_DEPTH, MAX_PRIMS, MAX_REACH, Node, Triangle};
use crate::scene::motion::bake::deformed;
use crate::scene::{Bounds, Scene};

impl Accel {
    /// Adds triangles in tree order and the tree over them. Returns the tree and that order.
    pub(super) fn push_tree(&mut self, flat: &Flat, splits: bool, room: &Room) -> Result<(Tree, Vec<u32>), AccelError> {
        self.dropped += flat.dropped;
        let (root, first_row) = (self.nodes.len() as u32, self.triangles.len() as u32);
        if flat.triangles.is_empty() {
            // One node without children: every ray misses it.
            self.nodes.push(Node::default());
            self.trees.push(first_row..first_row);
            return Ok((Tree { root, first_row, rows: 0, levels: 1 }, Vec::new()));
        }
        let mut points = flat.triangles.iter().flat_map(|t| [t.v0, t.v1, t.v2]);
        points.try_for_each(|v| check_reach(v.abs().as_dvec3()))?;
        let bvh = tree_over(&flat.triangles, splits, room)?;
        let levels = self.push_nodes(&bvh, first_row)?;
        let order = &bvh.primitive_indices;
        let mut firsts = vec![None; flat.triangles.len()];
        self.triangles.extend((first_row..).zip(order).map(|(row, &i)| {
            let triangle = flat.triangles[i as usize];
            let first = *firsts[i as usize].get_or_insert(row);
            Triangle { first_copy: triangle.first_copy | first, ..triangle }
        }));
        self.shadings.extend(order.iter().map(|&i| flat.shadings[i as usize]));
        self.colors.extend(corners(order, &flat.colors));
        self.second_uvs.extend(corners(order, &flat.second_uvs));
        self.tangents.extend(corners(order, &flat.tangents));
        let rows = order.len() as u32;
        self.trees.push(first_row..first_row + rows);
        Ok((Tree { root, first_row, rows, levels }, bvh.primitive_indices))
    }

    /// Adds deforming bodies in their pose at time 0, each with its own tree. Returns the depth of the deepest tree.
    pub(super) fn push_bodies(
        &mut self,
        scene: &Scene,
        bodies: &[usize],
        present: &Present,
        room: &Room,
    ) -> Result<usize, AccelError> {
        let (motion, pose) = (&scene.motion, scene.motion.pose(0.0));
        (self.skins.first_row, self.skins.first_node) = (self.triangles.len() as u32, self.nodes.len() as u32);
        let mut deepest = 0;
        for &number in bodies {
            let mesh = &scene.meshes[scene.instances[motion.bodies[number].instance].mesh];
            let joints = motion.joints(&pose, number);
            let shape = deformed(mesh, &pose.weights[number], Some(&joints));
            let flat = flatten::deforming(scene, &shape, self.origin, present);
            let (tree, order) = self.push_tree(&flat, false, room)?;
            if tree.rows == 0 {
                continue;
            }
            deepest = deepest.max(tree.levels);
            let corners: Vec<_> = order.iter().map(|&i| shape.triangles[i as usize]).collect();
            self.skins.push(number, mesh, &joints, &corners, &self.triangles[tree.first_row as usize..]);
            let by = By::Skin(self.skins.bodies() - 1);
            self.placements.push(Placement { tree, first_prim: tree.first_row, by });
        }
        self.skins.nodes = self.nodes[self.skins.first_node as usize..].to_vec();
        self.skins.finish();
        Ok(deepest)
    }

    /// Adds shared meshes, each with its own tree, and the placements of their instances. Returns the depth of the
    /// deepest tree.
    pub(super) fn push_shared(
        &mut self,
        scene: &Scene,
        shared: &[Shared],
        present: &Present,
        room: &Room,
    ) -> Result<usize, AccelError> {
        let mut bodies = vec![None; scene.instances.len()];
        for (number, body) in scene.motion.bodies.iter().enumerate() {
            bodies[body.instance] = Some(number);
        }
        let mut first_prim = self.triangles.len();
        let mut deepest = 0;
        for &Shared { mesh, mirrored, ref users } in shared {
            let (tree, _) = self.push_tree(&flatten::local(scene, mesh, mirrored, present), true, room)?;
            deepest = deepest.max(tree.levels);
            let mesh = &scene.meshes[mesh];
            let (low, high) = ends(&mesh.positions);
            for &user in users.iter().filter(|_| tree.rows > 0) {
                let by = bodies[user].map_or_else(
                    || {
                        let place = flatten::near_from_local(&scene.instances[user], self.origin);
                        By::Place(place, instances::bounds(mesh, &place))
                    },
                    |number| By::Body { number, low, high },
                );
                self.placements.push(Placement { tree, first_prim: first_prim as u32, by });
                first_prim += tree.rows as usize;
            }
        }
        if first_prim >= MAX_PRIMS {
            return Err(AccelError::TooManyInstances(first_prim));
        }
        Ok(deepest)
    }

    /// Adds a tree's nodes, with leaf indices offset by `first`. Returns its depth.
    pub(super) fn push_nodes(&mut self, bvh: &CwBvh, first: u32) -> Result<usize, AccelError> {
        let depth = depth(bvh);
        if depth > MAX_DEPTH {
            return Err(AccelError::TooDeep { depth });
        }
        let root = self.nodes.len() as u32;
        self.nodes.extend(nodes_from(bvh, root, first));
        Ok(depth)
    }
}

/// Returns a tree's nodes for a table in which its root has index `root` and its leaf indices start at `first`.
pub fn nodes_from(bvh: &CwBvh, root: u32, first: u32) -> impl Iterator<Item = Node> {
    bvh.nodes.iter().map(move |node| {
        let mut node = *node;
        node.child_base_idx = node.child_base_idx.wrapping_add(root);
        node.primitive_base_idx = node.primitive_base_idx.wrapping_add(first);
        bytemuck::cast::<_, Node>(node)
    })
}

/// Returns the component-wise minimum and maximum of the positions.
fn ends(positions: &[Vec3]) -> (Vec3, Vec3) {
    positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

/// Returns the point that positions are relative to. Fails if the scene reaches too far from it.
pub fn checked_origin(scene: &Scene) -> Result<DVec3, AccelError> {
    let bounds = scene.bounds();
    let origin = origin_for(bounds);
    if scene.triangle_count() > 0 {
        check_reach((bounds.min.as_dvec3() - origin).abs().max((bounds.max.as_dvec3() - origin).abs()))?;
    }
    Ok(origin)
}

fn check_reach(reach: DVec3) -> Result<(), AccelError> {
    let is_within = reach.cmple(DVec3::splat(MAX_REACH)).all();
    if is_within { Ok(()) } else { Err(AccelError::TooLarge(reach.max_element())) }
}

/// Returns the attributes of each triangle's corners in tree order, or an empty list if the attribute is absent.
fn corners<T: Copy>(order: &[u32], of_triangle: &[[T; 3]]) -> Vec<T> {
    if of_triangle.is_empty() { Vec::new() } else { order.iter().flat_map(|&i| of_triangle[i as usize]).collect() }
}

/// Returns the point nearest to the scene's centre on a lattice coarser than the scene. Subtracting it is exact for
/// positions that f32 can tell apart there. It is (0, 0, 0) for all scenes around the origin.
pub fn origin_for(bounds: Bounds) -> DVec3 {
    let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let size = (max - min).max_element();
    if !(size.is_finite() && size > 0.0) {
        return DVec3::ZERO;
    }
    let cell = 4.0 * size.log2().ceil().exp2();
    ((min + max) / 2.0 / cell).round() * cell
}
