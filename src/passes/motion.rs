//! Passes for dynamic geometry: they skin and morph deforming bodies, refit the BVHs of these bodies, and track
//! surfaces back to the previous frame.

use glam::UVec4;

use super::denoise::Denoiser;
use super::gbuffer::{GUIDE, HIT, PARTITION};
use super::resources::last_surface;
use super::{Declared, FrameSpec, Moving};
use crate::accel::COLUMNS;
use crate::graph::{Kernel, Pass, Stage, Use};
use crate::scene::rig::Eye;
use crate::wgsl::arguments;

/// Number of invocations in a workgroup.
const GROUP: u32 = 64;

const SKIN: Kernel = Kernel::changing_scene("skin");

arguments! {
    struct SkinArguments {
        /// Number of vertices or triangles.
        pub count: u32,
        /// Index of the first triangle's bounding box.
        pub first_box: u32,
        /// 1 to transform vertices, 0 to bound triangles.
        pub of_vertices: u32,
    }
}

arguments! {
    /// A level of the BVHs of deforming bodies.
    struct RefitArguments {
        /// Its nodes: the first, and the one after the last.
        pub begin: u32,
        pub end: u32,
        /// Index of the BVHs' first node in the scene's table.
        pub first_node: u32,
    }
}

/// Returns the number of workgroups along x, y and z for `count` invocations, arranged in rows of at most [`COLUMNS`].
fn groups(count: u32) -> [u32; 3] {
    [count.min(COLUMNS).div_ceil(GROUP), count.div_ceil(COLUMNS), 1]
}

/// Adds the passes that deform bodies and refit their BVHs. With hardware traversal, no pass reads these BVHs, so there
/// is no refit. Instead, devices rebuild the acceleration structures of all dynamic geometry after the pass `skin`.
pub fn bring(spec: &FrameSpec, frame: &mut Declared) {
    let still = Moving::default();
    let moving = spec.moving.as_ref().unwrap_or(&still);
    let why_not = if spec.moving.is_some() { "no geometry is deformed" } else { "nothing in the scene moves" };
    let most = groups(moving.triangles.max(moving.vertices));
    let launches = [
        SkinArguments { count: moving.vertices, first_box: 0, of_vertices: 1 },
        SkinArguments { count: moving.triangles, first_box: 2 * moving.nodes, of_vertices: 0 },
    ];
    let skin = Pass::once(Stage("skin"), PARTITION, SKIN, most)
        .uses([
            Use::read(moving.skin_triangles()),
            Use::read(moving.skin_vertices()),
            Use::read(moving.skin_morphs()),
            Use::read(moving.pose()),
            Use::write_then_read(moving.skinned()),
            Use::write(moving.boxes()),
        ])
        .with(launches);
    let skin = if moving.hardware { skin.builds_from(moving.skinned()) } else { skin };
    let begins = std::iter::once(0).chain(moving.levels.iter().copied());
    let first_node = moving.first_node;
    let levels = begins.zip(&moving.levels).map(|(begin, &end)| RefitArguments { begin, end, first_node });
    let widest = levels.clone().map(|level| level.end - level.begin).max().unwrap_or(0);
    let refit = Pass::once(Stage("refit"), PARTITION, Kernel::changing_scene("refit"), groups(widest))
        .uses([
            Use::read(moving.tree_nodes()).viewed_as::<UVec4>(),
            Use::read(moving.tree_order()),
            Use::update(moving.boxes()),
        ])
        .with(levels);
    frame.add_if(moving.triangles > 0 || (moving.hardware && moving.bodies), why_not, skin);
    let why_not = if moving.hardware { "devices rebuild hardware structures" } else { why_not };
    frame.add_if(moving.triangles > 0 && !moving.hardware, why_not, refit);
}

/// Adds the pass that tracks the surfaces of a view back to the previous frame.
pub fn follow(spec: &FrameSpec, view: Eye, frame: &mut Declared) {
    let pass = Pass::new(Stage("motion"), view, PARTITION, Kernel::new("motion").reading_scene()).uses([
        Use::read(HIT),
        Use::read(GUIDE),
        Use::write(last_surface(spec)).named("last_surface_image"),
    ]);
    let is_read = spec.denoiser().is_some_and(Denoiser::keeps_history);
    match spec.moving.is_some() {
        true => frame.add_if(is_read, "no denoiser keeps a history", pass),
        false => frame.add_if(false, "nothing in the scene moves", pass),
    }
}
