//! Construction of the scene's tables: BVHs over static geometry, over deforming bodies and over meshes that instances
//! share.

use glam::Vec3;
use rayon::prelude::*;

use super::built::{Built, depth};
use super::cache::TreeCache;
use super::flatten::{self, Flat, Present};
use super::instances::{self, Division, Layout, Shared};
use super::limits::{AccelError, MAX_DEPTH, MAX_PRIMS, MAX_TRIANGLES};
use super::moving::{By, Placement, Poses};
use super::origin::{check_reach, checked_origin};
use super::skins::Skins;
use super::tables::Accel;
use super::tree::{BUILD_BYTES, Node, Room, Tree, nodes_from, tree_over};
use super::triangle::{Shading, Triangle};
use crate::scene::Scene;
use crate::scene::budget::Budget;
use crate::scene::motion::bake::deformed;

/// Fewer rows are not worth a thread.
const LEAST_PER_THREAD: usize = 4096;
/// Upper bound on the bytes per instance while the tree over instances is built, including that tree.
const INSTANCE_BYTES: usize = 1000;

impl Accel {
    /// Builds with [`Layout::Auto`].
    ///
    /// # Errors
    /// The errors of [`Self::build_with`].
    pub fn build(scene: &Scene) -> Result<Self, AccelError> {
        Self::build_with(scene, Layout::Auto)
    }

    /// Builds the trees deterministically: the same scene gives the same trees.
    ///
    /// # Errors
    /// [`AccelError::TooMany`], [`AccelError::TooManyInstances`] or [`AccelError::TooLarge`] if the scene is too large
    /// for the tables, [`AccelError::TooDeep`] if a tree is too deep for the traversal stack of rays.
    pub fn build_with(scene: &Scene, layout: Layout) -> Result<Self, AccelError> {
        Self::build_within(scene, layout, &Budget::unlimited(), &TreeCache::off())
    }

    /// Builds like [`Self::build_with`], or takes trees from the cache. The budget keeps the bytes of the finished tables
    /// reserved.
    ///
    /// # Errors
    /// The errors of [`Self::build_with`], and [`AccelError::Memory`] if the budget is too small.
    pub fn build_within(scene: &Scene, layout: Layout, budget: &Budget, cache: &TreeCache) -> Result<Self, AccelError> {
        let count = scene.triangle_count();
        if count >= MAX_PRIMS {
            return Err(AccelError::TooManyInstances(count));
        }
        let origin = checked_origin(scene)?;
        let refused = |exceeded| AccelError::Memory { triangles: count, exceeded };
        let instances = scene.instances.len() * INSTANCE_BYTES;
        let _instances = budget.reserve(instances as u64).map_err(refused)?;
        let division = Division::new(scene, layout);
        let stored = division.stored_triangles(scene);
        if stored > MAX_TRIANGLES {
            return Err(AccelError::TooMany(stored));
        }
        let present = Present::of(scene);
        // Reserves memory for the tables, which grow to at most twice their length, and for the tree.
        let making = stored as u64 * (2 * present.row_bytes() + BUILD_BYTES) as u64;
        let mut reserved = budget.reserve(making).map_err(refused)?;
        let bodies =
            division.deforming.iter().map(|&b| &scene.meshes[scene.instances[scene.motion.bodies[b].instance].mesh]);
        budget.reserve(bodies.map(Skins::bytes).sum()).map_err(refused)?.keep();
        let mut accel = Self { origin, ..Self::default() };
        let room = Room { budget, row_bytes: present.row_bytes(), triangles: count, cache };
        let still = division.flat.iter().map(|&i| &scene.instances[i]);
        let flat = flatten::flatten(scene, still, origin);
        let (flat, _) = accel.push_tree(&flat, &present, true, &room)?;
        let deepest = accel.push_bodies(scene, &division.deforming, &present, &room)?;
        let deepest = deepest.max(accel.push_shared(scene, &division.shared, &present, &room)?);
        let pose = scene.motion.pose(0.0);
        let rows = accel.pose_rows(&scene.motion, [&pose, &pose]);
        let poses = Poses { motion: &scene.motion, now: &pose, last: &pose, rows: &rows };
        accel.instance_tree = accel.nodes.len() as u32;
        let placed = accel.placed_at((!scene.motion.bodies.is_empty()).then_some(&poses));
        (accel.instances, accel.numbers) = (placed.instances, placed.numbers);
        if !accel.placements.is_empty() {
            accel.nodes.extend(placed.nodes);
            // Reserves nodes for the largest number of instances in any frame.
            let last = accel.instance_tree as usize + accel.placements.len();
            accel.nodes.resize(accel.nodes.len().max(if accel.moves() { last } else { 0 }), Node::default());
        }
        // The root over instances stays on the stack while rays traverse the flattened triangles.
        let waiting = usize::from(!accel.placements.is_empty());
        let levels = (flat.levels + waiting).max(deepest + placed.levels);
        if levels > MAX_DEPTH {
            return Err(AccelError::TooDeep { depth: levels });
        }
        if accel.triangles.is_empty() {
            // Buffers must not be empty.
            accel.triangles.push(Triangle::default());
            accel.shadings.push(Shading::default());
        }
        reserved.shrink_to((stored * room.stored_bytes()) as u64);
        reserved.keep();
        Ok(accel)
    }

    /// Adds triangles in tree order and the tree over them. Returns the tree and that order.
    fn push_tree(
        &mut self,
        flat: &Flat<'_>,
        present: &Present,
        splits: bool,
        room: &Room,
    ) -> Result<(Tree, Vec<u32>), AccelError> {
        let (root, first_row) = (self.nodes.len() as u32, self.triangles.len() as u32);
        if flat.len() == 0 {
            // One node without children: every ray misses it.
            self.nodes.push(Node::default());
            self.trees.push(first_row..first_row);
            return Ok((Tree { root, first_row, rows: 0, levels: 1 }, Vec::new()));
        }
        let mut points = (0..flat.len()).flat_map(|i| flat.vertices(i));
        points.try_for_each(|v| check_reach(v.abs().as_dvec3()))?;
        let built = room.cache.tree(flat, splits, || tree_over(flat, splits, room))?;
        let copies = built.order.len().saturating_sub(flat.len());
        let refused = |exceeded| AccelError::Memory { triangles: room.triangles, exceeded };
        room.budget.reserve((copies * room.stored_bytes()) as u64).map_err(refused)?.keep();
        let levels = self.push_nodes(&built, first_row)?;
        let order = built.order;
        if self.triangles.is_empty() {
            // Most scenes have most triangles in their first tree.
            self.triangles.reserve_exact(order.len());
            self.shadings.reserve_exact(order.len());
        }
        self.triangles.resize(self.triangles.len() + order.len(), Triangle::default());
        self.shadings.resize(self.triangles.len(), Shading::default());
        let mut first_of = vec![None; flat.len()];
        let firsts: Vec<u32> =
            (first_row..).zip(&order).map(|(row, &i)| *first_of[i as usize].get_or_insert(row)).collect();
        let own = first_row as usize..;
        let rows = self.triangles[own.clone()].par_iter_mut().zip(&mut self.shadings[own]).zip(&order).zip(&firsts);
        rows.with_min_len(LEAST_PER_THREAD).for_each(|(((triangle, shading), &i), &first)| {
            (*triangle, *shading) = (flat.triangle(i as usize, first), flat.shading(i as usize));
        });
        let triangles = || order.iter().map(|&i| i as usize);
        if present.colors {
            self.colors.extend(triangles().flat_map(|i| flat.colors(i)));
        }
        if present.second_uvs {
            self.second_uvs.extend(triangles().flat_map(|i| flat.second_uvs(i)));
        }
        if present.tangents {
            self.tangents.extend(triangles().flat_map(|i| flat.tangents(i)));
        }
        let rows = order.len() as u32;
        self.trees.push(first_row..first_row + rows);
        Ok((Tree { root, first_row, rows, levels }, order))
    }

    /// Adds deforming bodies in their pose at time 0, each with its own tree. Returns the depth of the deepest tree.
    fn push_bodies(
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
            let flat = flatten::deforming(scene, &shape, self.origin);
            let (tree, order) = self.push_tree(&flat, present, false, room)?;
            if tree.rows == 0 {
                continue;
            }
            deepest = deepest.max(tree.levels);
            let corners: Vec<_> = order.iter().map(|&i| shape.triangles[i as usize]).collect();
            self.skins.push(number, mesh, &joints, &corners, &self.triangles[tree.first_row as usize..]);
            let is_mirror = scene.materials[mesh.material].is_link();
            let by = By::Skin(self.skins.bodies() - 1);
            self.placements.push(Placement { tree, first_prim: tree.first_row, is_mirror, by });
        }
        self.skins.nodes = self.nodes[self.skins.first_node as usize..].to_vec();
        self.skins.finish();
        Ok(deepest)
    }

    /// Adds shared meshes, each with its own tree, and the placements of their instances. Returns the depth of the
    /// deepest tree.
    fn push_shared(
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
            let (tree, _) = self.push_tree(&flatten::local(scene, mesh, mirrored), present, true, room)?;
            deepest = deepest.max(tree.levels);
            let mesh = &scene.meshes[mesh];
            let (low, high) = ends(&mesh.positions);
            let is_mirror = scene.materials[mesh.material].is_link();
            for &user in users.iter().filter(|_| tree.rows > 0) {
                let by = bodies[user].map_or_else(
                    || {
                        let place = flatten::near_from_local(&scene.instances[user], self.origin);
                        By::Place(place, instances::bounds(mesh, &place))
                    },
                    |number| By::Body { number, low, high },
                );
                self.placements.push(Placement { tree, first_prim: first_prim as u32, is_mirror, by });
                first_prim += tree.rows as usize;
            }
        }
        if first_prim >= MAX_PRIMS {
            return Err(AccelError::TooManyInstances(first_prim));
        }
        Ok(deepest)
    }

    /// Adds a tree's nodes, with leaf indices offset by `first`. Returns its depth.
    fn push_nodes(&mut self, built: &Built, first: u32) -> Result<usize, AccelError> {
        let depth = depth(&built.nodes);
        if depth > MAX_DEPTH {
            return Err(AccelError::TooDeep { depth });
        }
        let root = self.nodes.len() as u32;
        self.nodes.extend(nodes_from(&built.nodes, root, first));
        Ok(depth)
    }
}

/// Returns the component-wise minimum and maximum of the positions.
fn ends(positions: &[Vec3]) -> (Vec3, Vec3) {
    positions.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::builtin;

    #[test]
    fn building_keeps_every_triangle_with_area() {
        let scene = builtin::find("cornell").unwrap().build();
        let accel = Accel::build(&scene).unwrap();
        let is_first = |&(row, t): &(usize, &Triangle)| t.is_first(row);
        let firsts = accel.triangles.iter().enumerate().filter(is_first).count();
        assert_eq!(firsts, scene.triangle_count());
        assert!(accel.triangles.iter().all(|t| t.area() > 0.0));
    }

    #[test]
    fn rejects_more_triangles_than_indices() {
        let mut scene = builtin::find("cornell").unwrap().build();
        let mesh = scene.instances[0].mesh;
        scene.meshes[mesh].triangles = vec![[0, 1, 2]; 1 << 20];
        scene.instances = vec![scene.instances[0]; 1 << 11];
        assert!(matches!(Accel::build(&scene), Err(AccelError::TooManyInstances(count)) if count == MAX_PRIMS));
    }

    #[test]
    fn bodies_out_of_range_are_rejected_or_omitted() {
        let studio = builtin::find("studio").unwrap().build();
        let accel = Accel::build(&studio).unwrap();
        let with_joints = |scale: f32| {
            let mut scene = studio.clone();
            let binds = scene.motion.skins.iter_mut().flat_map(|skin| &mut skin.inverse_bind);
            binds.for_each(|bind| bind.matrix3 *= scale);
            scene
        };
        for far in [1e20, 1e38] {
            let scene = with_joints(far);
            assert!(matches!(Accel::build(&scene), Err(AccelError::TooLarge(_))));
            let pose = scene.motion.pose(0.0);
            let rows = accel.pose_rows(&scene.motion, [&pose, &pose]);
            let poses = Poses { motion: &scene.motion, now: &pose, last: &pose, rows: &rows };
            let placed = accel.placed_at(Some(&poses));
            assert_eq!(placed.left_out as usize, studio.motion.skins.len());
            assert_eq!(placed.instances.len() + studio.motion.skins.len(), accel.instances.len());
        }
    }

    #[test]
    fn building_twice_gives_the_same_tree() {
        let scene = builtin::find("checker").unwrap().build();
        let (a, b) = (Accel::build(&scene).unwrap(), Accel::build(&scene).unwrap());
        assert_eq!(a.nodes, b.nodes);
        assert_eq!(bytemuck::cast_slice::<_, u32>(&a.triangles), bytemuck::cast_slice::<_, u32>(&b.triangles));
    }
}
