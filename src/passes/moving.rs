//! Dynamic geometry: skins and morphs deforming bodies, refits the trees over them, and follows surfaces back to the
//! previous frame.

use super::denoise::Denoiser;
use super::gbuffer::{CUT, GUIDE, HIT};
use super::{Declared, FrameSpec};
use crate::accel::{COLUMNS, Node, SKINNED_BYTES, SkinMorph, SkinTriangle, SkinVertex, Skins};
use crate::graph::{Grid, Kernel, Launch, Life, Pass, Resource, Size, Stage, Use};
use crate::image::Extent;
use crate::scene::rig::Eye;
use crate::wgsl::constants;

/// Amount of dynamic geometry in a scene, as far as passes depend on it.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Moving {
    /// Number of triangles, vertices and morph entries of deforming bodies.
    pub triangles: u32,
    pub vertices: u32,
    pub morphs: u32,
    /// Rows of a pose.
    pub pose: u32,
    /// Number of nodes of the trees over these bodies, and the index of the first.
    pub nodes: u32,
    pub first_node: u32,
    /// Cumulative number of nodes up to each level, starting at the deepest.
    pub levels: Vec<u32>,
    /// Whether any geometry moves, rigid bodies included.
    pub bodies: bool,
    /// Whether rays traverse hardware acceleration structures instead of these trees.
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

    fn skin_triangles(&self) -> Resource {
        input("skin_triangles", size_of::<SkinTriangle>(), self.triangles)
    }

    fn skin_vertices(&self) -> Resource {
        input("skin_vertices", size_of::<SkinVertex>(), self.vertices)
    }

    fn skin_morphs(&self) -> Resource {
        input("skin_morphs", size_of::<SkinMorph>(), self.morphs)
    }

    fn tree_nodes(&self) -> Resource {
        input("tree_nodes", size_of::<Node>(), self.nodes)
    }

    fn tree_order(&self) -> Resource {
        input("tree_order", 4, self.nodes)
    }

    /// Returns the table of joints, in this frame and the previous one, and of morph weights. The host sets it every
    /// frame.
    pub fn pose(&self) -> Resource {
        input("pose", 16, self.pose)
    }

    /// Returns the table of world-space vertices.
    fn skinned(&self) -> Resource {
        Resource::table("skinned", SKINNED_BYTES as u32, Extent::new(self.vertices.max(1), 1))
    }

    /// Returns the table of bounding boxes, of nodes and then of triangles.
    fn boxes(&self) -> Resource {
        Resource::table("boxes", 32, Extent::new((self.nodes + self.triangles).max(1), 1))
    }
}

fn input(name: &'static str, bytes: usize, count: u32) -> Resource {
    Resource { life: Life::Input, ..Resource::table(name, bytes as u32, Extent::new(count.max(1), 1)) }
}

/// Returns the image of each surface's position and packed shading normal in the previous frame. A static scene has a
/// dummy.
pub fn last_surface(spec: &FrameSpec) -> Resource {
    let image = Resource::image("last_surface", 16);
    let nothing = Grid::table(Size::Fixed(Extent::new(1, 1)));
    if spec.moving.is_some() { image } else { image.on(nothing) }
}

/// Invocations of a workgroup.
const GROUP: u32 = 64;

/// Third kernel argument: transform vertices instead of triangles.
const VERTICES: u32 = 1;

const SKIN: Kernel = Kernel::changing_scene("skin").with(constants![VERTICES]);

/// Returns the workgroups for this many invocations.
fn groups(count: u32) -> [u32; 3] {
    [count.min(COLUMNS).div_ceil(GROUP), count.div_ceil(COLUMNS), 1]
}

/// Adds the passes that deform bodies and refit their trees. With hardware traversal, devices instead rebuild the
/// acceleration structures of all dynamic geometry after the pass `skin`, since no pass reads the trees.
pub fn bring(spec: &FrameSpec, frame: &mut Declared) {
    let still = Moving::default();
    let moving = spec.moving.as_ref().unwrap_or(&still);
    let why_not = if spec.moving.is_some() { "nothing changes its shape" } else { "nothing in the scene moves" };
    let most = groups(moving.triangles.max(moving.vertices));
    let launches = [[moving.vertices, 0, VERTICES], [moving.triangles, 2 * moving.nodes, 0]].map(Launch::Once);
    let skin = Pass::once(Stage("skin"), CUT, SKIN, most)
        .uses([
            Use::read(moving.skin_triangles()),
            Use::read(moving.skin_vertices()),
            Use::read(moving.skin_morphs()),
            Use::read(moving.pose()),
            Use::write_then_read(moving.skinned()),
            Use::write(moving.boxes()),
        ])
        .launches(launches.to_vec());
    let skin = if moving.hardware { skin.builds_from(moving.skinned()) } else { skin };
    let begins = std::iter::once(0).chain(moving.levels.iter().copied());
    let levels = begins.zip(&moving.levels).map(|(begin, &end)| [begin, end, moving.first_node]);
    let widest = levels.clone().map(|[begin, end, _]| end - begin).max().unwrap_or(0);
    let refit = Pass::once(Stage("refit"), CUT, Kernel::changing_scene("refit"), groups(widest))
        .uses([Use::read(moving.tree_nodes()), Use::read(moving.tree_order()), Use::update(moving.boxes())])
        .launches(levels.map(Launch::Once).collect());
    frame.add_if(moving.triangles > 0 || (moving.hardware && moving.bodies), why_not, skin);
    let why_not = if moving.hardware { "devices have structures of their own" } else { why_not };
    frame.add_if(moving.triangles > 0 && !moving.hardware, why_not, refit);
}

/// Adds the pass that tracks the surfaces of a view back to the previous frame.
pub fn follow(spec: &FrameSpec, view: Eye, frame: &mut Declared) {
    let pass = Pass::new(Stage("motion"), view, CUT, Kernel::with_scene("motion")).uses([
        Use::read(HIT),
        Use::read(GUIDE),
        Use::write(last_surface(spec)),
    ]);
    let is_read = spec.denoiser().is_some_and(Denoiser::keeps_history);
    match spec.moving.is_some() {
        true => frame.add_if(is_read, "no pass builds on the frame before", pass),
        false => frame.add_if(false, "nothing in the scene moves", pass),
    }
}
