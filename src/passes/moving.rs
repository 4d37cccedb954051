//! Sizes of the dynamic geometry in a scene, and the GPU tables that hold it.

use glam::Vec4;

use crate::accel::{Node, SkinMorph, SkinTriangle, SkinVertex, Skinned, Skins};
use crate::graph::{Life, Resource};
use crate::image::Extent;
use crate::wgsl::Texel;

/// Sizes of the dynamic geometry in a scene that the passes depend on.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Moving {
    /// Number of triangles, vertices and morph entries of deforming bodies.
    pub triangles: u32,
    pub vertices: u32,
    pub morphs: u32,
    /// Number of 16-byte rows in the pose table, which holds joint matrices and morph weights.
    pub pose: u32,
    /// Number of nodes in the BVHs of the deforming bodies, and the index of the first of them.
    pub nodes: u32,
    pub first_node: u32,
    /// For each level of these BVHs, starting at the deepest: the number of nodes in that level and all deeper ones.
    pub levels: Vec<u32>,
    /// True if any geometry is dynamic, rigid bodies included.
    pub bodies: bool,
    /// True if rays traverse hardware acceleration structures instead of these BVHs.
    pub hardware: bool,
}

impl Moving {
    pub fn of(skins: &Skins) -> Self {
        Self {
            triangles: skins.triangles.len() as u32,
            vertices: skins.vertices.len() as u32,
            morphs: skins.morphs.len() as u32,
            pose: skins.pose_len() as u32,
            nodes: skins.nodes.len() as u32,
            first_node: skins.first_node,
            levels: skins.levels.clone(),
            ..Self::default()
        }
    }

    /// Returns the resources that the host sets once, at the start.
    pub fn inputs(&self) -> [Resource; 5] {
        [self.skin_triangles(), self.skin_vertices(), self.skin_morphs(), self.tree_nodes(), self.tree_order()]
    }

    pub(super) fn skin_triangles(&self) -> Resource {
        input::<SkinTriangle>("skin_triangles", self.triangles)
    }

    pub(super) fn skin_vertices(&self) -> Resource {
        input::<SkinVertex>("skin_vertices", self.vertices)
    }

    pub(super) fn skin_morphs(&self) -> Resource {
        input::<SkinMorph>("skin_morphs", self.morphs)
    }

    pub(super) fn tree_nodes(&self) -> Resource {
        input::<Node>("tree_nodes", self.nodes)
    }

    pub(super) fn tree_order(&self) -> Resource {
        input::<u32>("tree_order", self.nodes)
    }

    /// Returns the table of joint matrices, for this frame and the previous one, and of morph weights. The host uploads
    /// it every frame.
    pub fn pose(&self) -> Resource {
        input::<Vec4>("pose", self.pose)
    }

    /// Returns the table of the deforming bodies' vertices in world space, which the pass `skin` writes.
    pub(super) fn skinned(&self) -> Resource {
        Resource::table::<Skinned>("skinned", Extent::new(self.vertices.max(1), 1))
    }

    /// Returns the table of bounding boxes: first those of BVH nodes, then those of triangles.
    pub(super) fn boxes(&self) -> Resource {
        Resource::table::<[Vec4; 2]>("boxes", Extent::new((self.nodes + self.triangles).max(1), 1))
    }
}

fn input<T: Texel>(name: &'static str, count: u32) -> Resource {
    Resource { life: Life::Input, ..Resource::table::<T>(name, Extent::new(count.max(1), 1)) }
}
