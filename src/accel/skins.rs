//! Deforming bodies: the data with which the passes `skin` and `refit` transform their triangles to world space and
//! refit their trees in each frame.

use glam::{DAffine3, DVec3, Mat4, UVec3, Vec2, Vec3, Vec4};
use obvhs::aabb::Aabb;

use super::instances::{box_in, farthest, matrix_rows};
use super::tree::Node;
use super::triangle::Triangle;
use crate::scene::Mesh;
use crate::scene::motion::Influence;
use crate::scene::motion::bake::is_mirrored;
use crate::wgsl::{Texel, shared_constants, shared_structs};

shared_structs! {
    /// A deforming body's triangle: the data that does not change from frame to frame.
    pub struct SkinTriangle {
        /// Indices of its vertices, counter-clockwise from the front.
        pub corners: UVec3,
        pub material: u32,
        /// Row of its first copy and the alpha flag, as in [`Triangle::first_copy`].
        pub first_copy: u32,
        pub light: u32,
        pub uv0: Vec2,
        pub uv1: Vec2,
        pub uv2: Vec2,
    }

    /// A vertex in the rest pose.
    pub struct SkinVertex {
        pub position: Vec3,
        /// Index of its first [`SkinMorph`]. Those of the body's other morph targets follow.
        pub first_morph: u32,
        /// Normal at rest; zero if the mesh has no normals.
        pub normal: Vec3,
        pub morph_count: u32,
        /// Tangent with the bitangent's sign in w.
        pub tangent: Vec4,
        /// Indices of its joints, counted over all bodies. Joints with nonzero weights come first.
        pub joints: [u32; JOINTS_PER_VERTEX as usize],
        pub weights: [f32; JOINTS_PER_VERTEX as usize],
        /// Pose row that holds the weight of its body's first morph target.
        pub first_weight: u32,
        pub pad0: u32,
        pub pad1: u32,
        pub pad2: u32,
    }

    /// Offsets that a morph target adds to a vertex at weight 1.
    pub struct SkinMorph {
        pub position: Vec3,
        pub pad0: u32,
        pub normal: Vec3,
        pub pad1: u32,
        pub tangent: Vec3,
        pub pad2: u32,
    }
}

shared_constants! {
    pub const JOINTS_PER_VERTEX: u32 = 8;
    /// Width of the 2D grid of invocations over triangles or nodes.
    pub const COLUMNS: u32 = 1 << 16;
    /// Pose rows per joint: three for its current matrix, three for the previous one.
    const ROWS_PER_JOINT: u32 = 6;
}

/// A vertex that the pass `skin` writes. It begins with the world-space position.
pub struct Skinned(#[expect(dead_code)] [Vec4; 4]);

/// The shader `skin` declares the struct.
impl Texel for Skinned {
    const ELEMENT: &'static str = "Skinned";
}

/// Number of pose rows per joint, as `usize`.
const JOINT_ROWS: usize = ROWS_PER_JOINT as usize;

/// All deforming bodies.
#[derive(Debug, Default)]
pub struct Skins {
    /// Triangles in the order of their table rows, which start at `first_row`.
    pub triangles: Vec<SkinTriangle>,
    pub first_row: u32,
    pub vertices: Vec<SkinVertex>,
    pub morphs: Vec<SkinMorph>,
    /// Nodes of the trees as built. In the node table, they start at `first_node`.
    pub nodes: Vec<Node>,
    pub first_node: u32,
    /// Node indices, deepest first.
    pub order: Vec<u32>,
    /// End of each level in `order`.
    pub levels: Vec<u32>,
    bodies: Vec<Body>,
    joints: usize,
    weights: usize,
}

/// Data of a body besides its triangles.
#[derive(Debug)]
struct Body {
    /// Index into [`Motion::bodies`](crate::scene::motion::Motion::bodies).
    number: usize,
    first_joint: usize,
    first_weight: usize,
    targets: usize,
    /// Rest-pose bounds of the vertices that each joint influences. Morphs widen them by up to `reach` times the
    /// weights.
    boxes: Vec<Aabb>,
    /// Largest displacement, on each axis, of any vertex by each morph target at weight 1.
    reach: Vec<Vec3>,
}

impl Skins {
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Returns an upper bound on the bytes of a body with this mesh, both while it is added and afterwards, since lists
    /// grow to at most twice their length.
    pub(super) fn bytes(mesh: &Mesh) -> u64 {
        let vertex = size_of::<SkinVertex>() + mesh.morphs.len() * size_of::<SkinMorph>();
        let triangle = size_of::<SkinTriangle>() + 2 * size_of::<Node>();
        let shape = 2 * (mesh.bytes() - mesh.motion_bytes());
        shape + 2 * (mesh.positions.len() * vertex + mesh.triangles.len() * triangle) as u64
    }

    /// Returns the number of bodies.
    pub(super) fn bodies(&self) -> usize {
        self.bodies.len()
    }

    /// Adds a body: its mesh at rest, its joints at time 0, and its triangles in tree order. A body that is mirrored at
    /// time 0 counts as mirrored at all times: its normals and bitangents are flipped.
    pub(super) fn push(
        &mut self,
        number: usize,
        mesh: &Mesh,
        joints: &[DAffine3],
        corners: &[[u32; 3]],
        rows: &[Triangle],
    ) {
        let handedness = if is_mirrored(joints) { -1.0 } else { 1.0 };
        let first_vertex = self.vertices.len() as u32;
        let first_joint = self.joints;
        for i in 0..mesh.positions.len() {
            let influence = mesh
                .influences
                .get(i)
                .copied()
                .unwrap_or(Influence { weights: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..Default::default() });
            let (joints, weights) = sorted(&influence, first_joint);
            let tangent = mesh.tangents.get(i).copied().unwrap_or_default();
            self.vertices.push(SkinVertex {
                position: mesh.positions[i],
                first_morph: self.morphs.len() as u32,
                normal: handedness * mesh.normals.get(i).copied().unwrap_or_default(),
                morph_count: mesh.morphs.len() as u32,
                tangent: tangent.truncate().extend(handedness * tangent.w),
                joints,
                weights,
                first_weight: self.weights as u32,
                ..Default::default()
            });
            let has_tangent = tangent.truncate() != Vec3::ZERO;
            self.morphs.extend(mesh.morphs.iter().map(|morph| SkinMorph {
                position: morph.positions.get(i).copied().unwrap_or_default(),
                normal: handedness * morph.normals.get(i).copied().unwrap_or_default(),
                tangent: morph.tangents.get(i).copied().filter(|_| has_tangent).unwrap_or_default(),
                ..Default::default()
            }));
        }
        let uv = |i: u32| mesh.uvs[0].get(i as usize).copied().unwrap_or_default();
        self.triangles.extend(corners.iter().zip(rows).map(|(&[a, b, c], row)| SkinTriangle {
            corners: UVec3::new(a, b, c) + first_vertex,
            material: row.material,
            first_copy: row.first_copy,
            light: row.light,
            uv0: uv(a),
            uv1: uv(b),
            uv2: uv(c),
        }));
        let reach = mesh.morphs.iter().map(|m| m.positions.iter().fold(Vec3::ZERO, |most, p| most.max(p.abs())));
        self.bodies.push(Body {
            number,
            first_joint,
            first_weight: self.weights,
            targets: mesh.morphs.len(),
            boxes: boxes_of_joints(mesh, joints.len()),
            reach: reach.collect(),
        });
        self.joints += joints.len();
        self.weights += mesh.morphs.len();
    }

    /// Completes the tables once all bodies are added: sorts nodes by level, and places the rows of morph weights after
    /// those of joints.
    pub(super) fn finish(&mut self) {
        for vertex in &mut self.vertices {
            vertex.first_weight += (self.joints * JOINT_ROWS) as u32;
        }
        let mut level_of = vec![0u32; self.nodes.len()];
        // Parents precede their children.
        for node in 0..self.nodes.len() {
            let [.., imask] = self.nodes[node][3].to_le_bytes();
            let first = self.nodes[node][4].wrapping_sub(self.first_node) as usize;
            for child in (0..imask.count_ones() as usize).map(|i| first + i) {
                level_of[child] = level_of[node] + 1;
            }
        }
        self.order = (0..self.nodes.len() as u32).collect();
        self.order.sort_by_key(|&node| std::cmp::Reverse(level_of[node as usize]));
        let level = |i: usize| level_of[self.order[i] as usize];
        self.levels = (1..=self.order.len())
            .filter(|&end| end == self.order.len() || level(end) != level(end - 1))
            .map(|end| end as u32)
            .collect();
    }

    /// Returns the current and the previous pose as rows for shaders. `of` returns a body's joints and weights for
    /// both. Positions are relative to `origin`.
    pub fn pose_rows(&self, of: impl Fn(usize) -> [(Vec<DAffine3>, Vec<f32>); 2], origin: DVec3) -> Vec<Vec4> {
        let mut rows = vec![Vec4::ZERO; self.pose_len()];
        for body in &self.bodies {
            for (which, (joints, weights)) in of(body.number).into_iter().enumerate() {
                for (j, joint) in joints.iter().take(body.boxes.len()).enumerate() {
                    let at = (body.first_joint + j) * JOINT_ROWS + 3 * which;
                    rows[at..at + 3].copy_from_slice(&matrix_rows(joint.matrix3, joint.translation - origin));
                }
                for (i, weight) in weights.iter().take(body.targets).enumerate() {
                    rows[self.joints * JOINT_ROWS + body.first_weight + i][which] = *weight;
                }
            }
        }
        rows
    }

    /// Returns the number of pose rows, at least one.
    pub fn pose_len(&self) -> usize {
        (self.joints * JOINT_ROWS + self.weights).max(1)
    }

    /// Returns bounds of body `index` in the current pose. A skinned point is a convex combination of points in its
    /// joints' boxes, so the box around these bounds it.
    pub(super) fn bounds(&self, index: usize, pose: &[Vec4]) -> Aabb {
        let body = &self.bodies[index];
        let weight = |i: usize| pose[self.joints * JOINT_ROWS + body.first_weight + i].x.abs();
        let grown: Vec3 = body.reach.iter().enumerate().map(|(i, reach)| *reach * weight(i)).sum();
        let mut out = Aabb::empty();
        for (j, joint) in body.boxes.iter().enumerate().filter(|(_, b)| b.valid()) {
            let m = matrix(&pose[(body.first_joint + j) * JOINT_ROWS..]);
            let (low, high) = (Vec3::from(joint.min) - grown, Vec3::from(joint.max) + grown);
            let joint = box_in(&m, low, high);
            if !(joint.min.is_finite() && joint.max.is_finite()) {
                // A union would ignore NaN bounds.
                return joint;
            }
            out = out.union(&joint);
        }
        out
    }

    /// Returns an upper bound on the distance that any point of body `index` has moved since the previous frame.
    pub(super) fn moved(&self, index: usize, pose: &[Vec4]) -> f32 {
        let body = &self.bodies[index];
        let weights = |i: usize| pose[self.joints * JOINT_ROWS + body.first_weight + i];
        let reaches = |of: &dyn Fn(usize) -> f32| body.reach.iter().enumerate().map(|(i, r)| *r * of(i).abs()).sum();
        let grown: Vec3 = reaches(&|i| weights(i).x.abs().max(weights(i).y.abs()));
        let morphed: Vec3 = reaches(&|i| weights(i).x - weights(i).y);
        let mut most: f32 = 0.0;
        for (j, joint) in body.boxes.iter().enumerate().filter(|(_, b)| b.valid()) {
            let rows = &pose[(body.first_joint + j) * JOINT_ROWS..];
            let [now, last] = [matrix(rows), matrix(&rows[3..])];
            let (low, high) = (Vec3::from(joint.min) - grown, Vec3::from(joint.max) + grown);
            let linear = Mat4 { w_axis: Vec4::W, ..now };
            let by_joint = farthest(&box_in(&(now - last), low, high));
            most = most.max(by_joint + farthest(&box_in(&linear, -morphed, morphed)));
        }
        most
    }

    /// Returns a triangle's corners in the current pose, as the shader computes them.
    pub fn corners(&self, triangle: usize, pose: &[Vec4]) -> [Vec3; 3] {
        self.triangles[triangle].corners.to_array().map(|v| self.position(v as usize, pose))
    }

    fn position(&self, vertex: usize, pose: &[Vec4]) -> Vec3 {
        let v = &self.vertices[vertex];
        let morphs = self.morphs[v.first_morph as usize..].iter().take(v.morph_count as usize);
        let moved = morphs.enumerate().map(|(i, m)| pose[v.first_weight as usize + i].x * m.position);
        let p = moved.fold(v.position, |sum, by| sum + by).extend(1.0);
        let used = v.joints.iter().zip(&v.weights).take_while(|(_, w)| **w != 0.0);
        used.fold(Vec3::ZERO, |sum, (&joint, &weight)| {
            let row = joint as usize * JOINT_ROWS;
            sum + weight * Vec3::new(pose[row].dot(p), pose[row + 1].dot(p), pose[row + 2].dot(p))
        })
    }
}

/// Returns joints and weights, nonzero weights first.
fn sorted(influence: &Influence, first_joint: usize) -> ([u32; 8], [f32; 8]) {
    let (mut joints, mut weights) = ([0; 8], [0.0; 8]);
    let used = influence.joints.iter().zip(influence.weights).filter(|(_, weight)| *weight != 0.0);
    for (i, (&joint, weight)) in used.enumerate() {
        (joints[i], weights[i]) = (first_joint as u32 + u32::from(joint), weight);
    }
    (joints, weights)
}

/// Returns the rest-pose bounds of the vertices that each joint influences; empty if it influences none.
fn boxes_of_joints(mesh: &Mesh, joints: usize) -> Vec<Aabb> {
    let mut boxes = vec![Aabb::empty(); joints];
    for (i, &p) in mesh.positions.iter().enumerate() {
        match mesh.influences.get(i) {
            None => _ = boxes[0].extend(p.into()),
            Some(Influence { joints, weights }) => {
                for (&joint, _) in joints.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
                    boxes[usize::from(joint)].extend(p.into());
                }
            }
        }
    }
    boxes
}

/// Returns the affine matrix whose first three rows are the first of `rows`.
fn matrix(rows: &[Vec4]) -> Mat4 {
    Mat4::from_cols(rows[0], rows[1], rows[2], Vec4::W).transpose()
}
