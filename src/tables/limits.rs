//! Checks the needs of a scene and a frame against a device's limits, before anything is created on it.

use std::borrow::Cow;
use std::fmt;

use crate::device::Tables;
use crate::graph::{Format, Pass, Program, SceneUse};
use crate::image::Extent;
use crate::layout::{PAGE, PassConstants, TABLE_WIDTH};
use crate::plan::{Groups, groups};
use crate::wgsl::ROW_BYTES;

/// A WebGPU limit.
#[derive(Clone, Copy, Debug)]
struct Limit {
    /// Name in wgpu.
    name: &'static str,
    unit: &'static str,
    value: fn(&wgpu::Limits) -> u64,
}

/// Declares limits with the names that they have in wgpu.
macro_rules! limits {
    ($($constant:ident: $name:ident in $unit:literal;)*) => {
        $(const $constant: Limit = Limit { name: stringify!($name), unit: $unit, value: |all| all.$name.into() };)*
    };
}

limits! {
    STORAGE_BINDING: max_storage_buffer_binding_size in "bytes";
    BUFFER: max_buffer_size in "bytes";
    UNIFORM_BINDING: max_uniform_buffer_binding_size in "bytes";
    STORAGE_BUFFERS: max_storage_buffers_per_shader_stage in "storage buffers";
    TEXTURE_EDGE: max_texture_dimension_2d in "texels an edge";
    TEXTURE_LAYERS: max_texture_array_layers in "texture layers";
    WORKGROUPS: max_compute_workgroups_per_dimension in "workgroups a row or column";
    INVOCATIONS: max_compute_invocations_per_workgroup in "invocations a workgroup";
    IMMEDIATES: max_immediate_size in "bytes";
    CORNERS: max_blas_primitive_count in "corners of triangles";
    TLAS_INSTANCES: max_tlas_instance_count in "instances";
}

/// An instance's custom index has 24 bits.
const INSTANCES: Limit = Limit { value: |limits| (TLAS_INSTANCES.value)(limits).min(1 << 24), ..TLAS_INSTANCES };

/// An amount that may exceed a device's limit.
#[derive(Clone, Debug)]
pub struct Need {
    what: Cow<'static, str>,
    limit: Limit,
    amount: u64,
    remedy: Remedy,
}

/// Change that lowers a need, on the same device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    FewerTriangles,
    SmallerTextures,
    SmallerEnvironment,
    /// Smaller images.
    SmallerSize,
    /// Traversal in compute shaders.
    ComputeTraversal,
    /// A pass that declares fewer storage buffers, smaller constants or smaller workgroups.
    SmallerPass,
}

impl Remedy {
    fn text(self) -> &'static str {
        match self {
            Self::FewerTriangles => "use fewer triangles",
            Self::SmallerTextures => "make them smaller",
            Self::SmallerEnvironment => "make it smaller",
            Self::SmallerSize => "choose a smaller size",
            Self::ComputeTraversal => "choose compute traversal",
            Self::SmallerPass => "use fewer buffers, smaller constants or smaller workgroups",
        }
    }
}

/// A limit that is exceeded.
#[derive(Clone, Debug)]
pub struct LimitExceeded {
    need: Need,
    limit: u64,
    device: usize,
}

impl LimitExceeded {
    /// Returns the change that lowers the need. Another adapter may have a higher limit instead.
    pub fn remedy(&self) -> Remedy {
        self.need.remedy
    }
}

impl std::error::Error for LimitExceeded {}

impl fmt::Display for LimitExceeded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { need: Need { what, limit, amount, remedy }, limit: most, device } = self;
        let [amount, most] = [*amount, *most].map(|amount| match limit.unit {
            "bytes" if amount >= 10 << 20 => format!("{} MiB", amount >> 20),
            unit => format!("{amount} {unit}"),
        });
        let verb = if what.ends_with('s') { "need" } else { "needs" };
        write!(f, "{what} {verb} {amount}, and device {device} takes {most} (its {}): ", limit.name)?;
        write!(f, "{}, or choose another adapter", remedy.text())
    }
}

/// Checks needs against the limits of a device.
///
/// # Errors
/// [`LimitExceeded`] with the first need that exceeds its limit.
pub fn check(limits: &wgpu::Limits, device: usize, needs: impl IntoIterator<Item = Need>) -> Result<(), LimitExceeded> {
    let exceeding = needs.into_iter().find(|need| need.amount > (need.limit.value)(limits));
    exceeding.map_or(Ok(()), |need| Err(LimitExceeded { limit: (need.limit.value)(limits), need, device }))
}

fn storage(what: &str, bytes: u64, remedy: Remedy) -> [Need; 2] {
    let need = |limit| Need { what: what.to_owned().into(), limit, amount: bytes, remedy };
    [STORAGE_BINDING, BUFFER].map(need)
}

/// Sizes of a scene's tables and images.
pub struct SceneSizes {
    /// Number of 16-byte rows of all tables. `tables` is the kind of resource that holds them.
    pub rows: u64,
    pub tables: Tables,
    pub texels: usize,
    pub environment: Extent,
}

pub fn of_scene(sizes: &SceneSizes) -> Vec<Need> {
    let edges = |what: &'static str, edges: [u32; 2], remedy| {
        edges.map(|edge| Need { what: what.into(), limit: TEXTURE_EDGE, amount: edge.into(), remedy })
    };
    let tables = "the scene's tables";
    let mut needs = match sizes.tables {
        Tables::Buffer => Vec::from(storage(tables, sizes.rows * ROW_BYTES as u64, Remedy::FewerTriangles)),
        Tables::Texture => Vec::from(edges(tables, table_size(sizes.rows), Remedy::FewerTriangles)),
    };
    let Pages { edge, count } = Pages::of(sizes.texels);
    let what = "the scene's textures";
    needs.extend(edges(what, [edge; 2], Remedy::SmallerTextures));
    needs.push(Need { what: what.into(), limit: TEXTURE_LAYERS, amount: count, remedy: Remedy::SmallerTextures });
    let Extent { width, height } = sizes.environment;
    needs.extend(edges("the environment image", [width, height], Remedy::SmallerEnvironment));
    needs
}

/// Returns the needs of a scene's acceleration structures. `triangles` is the number of triangles in its largest BLAS.
pub fn of_structures(triangles: usize, instances: usize) -> [Need; 2] {
    let need =
        |what: &'static str, limit, amount| Need { what: what.into(), limit, amount, remedy: Remedy::ComputeTraversal };
    [
        need("the scene's largest BLAS", CORNERS, 3 * triangles as u64),
        need("the scene's instances", INSTANCES, instances as u64),
    ]
}

/// Returns the needs of the images and passes of these programs. `scene_buffers` is the number of storage buffers that
/// a pass binds to read the scene.
pub fn of_frames<'a>(programs: &'a [Program], scene_buffers: usize) -> impl Iterator<Item = Need> + 'a {
    let images = programs.iter().flat_map(|program| program.images().iter().map(|image| (program.extent, image)));
    let images = images.flat_map(|(extent, image)| {
        let resource = &image.resource;
        let what = format!("the image {} at {extent}", resource.name);
        let bytes = resource.bytes(extent);
        match resource.format {
            Format::Uniform { .. } => {
                vec![Need { what: what.into(), limit: UNIFORM_BINDING, amount: bytes, remedy: Remedy::SmallerPass }]
            }
            Format::Texels { .. } | Format::List => Vec::from(storage(&what, bytes, Remedy::SmallerSize)),
        }
    });
    let passes = programs.iter().flat_map(|program| program.passes().iter().map(|p| (program.extent, &p.pass)));
    images.chain(passes.flat_map(move |(extent, pass)| of_pass(pass, extent, scene_buffers)))
}

fn of_pass(pass: &Pass, frame: Extent, scene_buffers: usize) -> [Need; 5] {
    let what = || Cow::from(format!("the pass {}", pass.stage.name()));
    let need = |limit, amount, remedy| Need { what: what(), limit, amount, remedy };
    let own = pass.uses.iter().filter(|u| !matches!(u.image.resource.format, Format::Uniform { .. })).count();
    let buffers = own + if pass.kernel.scene == SceneUse::No { 0 } else { scene_buffers };
    let extent = pass.grid.extent(frame);
    let [columns, rows] = match groups(pass.dispatch, pass.kernel.workgroup, extent.width, &extent.rows()) {
        Groups::Direct([x, y, z]) => [x, y.max(z)],
        // The shader that fills a list requests at most as many workgroups as every device supports.
        Groups::Listed(_) => [1; 2],
    };
    [
        need(STORAGE_BUFFERS, buffers as u64, Remedy::SmallerPass),
        need(WORKGROUPS, columns.into(), Remedy::SmallerSize),
        need(WORKGROUPS, rows.into(), Remedy::SmallerSize),
        need(INVOCATIONS, pass.kernel.workgroup.map(u64::from).iter().product(), Remedy::SmallerPass),
        need(IMMEDIATES, size_of::<PassConstants>() as u64, Remedy::SmallerPass),
    ]
}

/// Returns the size of a texture that holds this many table rows.
pub fn table_size(rows: u64) -> [u32; 2] {
    [TABLE_WIDTH, u32::try_from(rows.div_ceil(TABLE_WIDTH.into())).unwrap_or(u32::MAX)]
}

/// Layers of the array texture that stores the texels of all images consecutively: edge length in texels, and number.
pub struct Pages {
    pub edge: u32,
    pub count: u64,
}

impl Pages {
    pub fn of(texels: usize) -> Self {
        let edge = if texels == 0 { 1 } else { PAGE };
        Self { edge, count: (texels as u64).div_ceil(u64::from(edge) * u64::from(edge)).max(1) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::passes::{Declarations, FrameSpec};
    use crate::tables::scene_buffers;

    fn programs(width: u32, height: u32) -> Vec<Program> {
        Declarations::default().programs(&FrameSpec::new(Extent::new(width, height), 2), 1..=5).unwrap()
    }

    /// Returns the limits of a recent GPU, with WebGPU's default sizes.
    fn limits() -> wgpu::Limits {
        let (max_storage_buffers_per_shader_stage, max_immediate_size) = (13, 64);
        wgpu::Limits { max_storage_buffers_per_shader_stage, max_immediate_size, ..wgpu::Limits::defaults() }
    }

    #[track_caller]
    fn assert_said(limits: &wgpu::Limits, needs: impl IntoIterator<Item = Need>, expected: &str) {
        let said = check(limits, 3, needs).map_or_else(|e| e.to_string(), |()| "all is well".to_owned());
        assert!(said.contains(expected), "`{said}` and not `{expected}`");
    }

    #[test]
    fn needs_of_a_scene_are_checked_against_limits() {
        let environment = Extent::new(4096, 2048);
        let scene = |rows, tables, texels| of_scene(&SceneSizes { rows, tables, texels, environment });
        let (small, million, pages) = (scene(1000, Tables::Texture, 70_000), 1 << 20, 257 * (PAGE * PAGE) as usize);
        assert_said(&limits(), small.clone(), "all is well");
        assert_said(
            &wgpu::Limits::downlevel_defaults(),
            small.clone(),
            "the scene's tables need 8192 texels an edge, and device 3 takes 2048 texels an edge (its \
             max_texture_dimension_2d): use fewer triangles, or choose another adapter",
        );
        let binding =
            "the scene's tables need 192 MiB, and device 3 takes 128 MiB (its max_storage_buffer_binding_size)";
        assert_said(&limits(), scene(12 * million, Tables::Buffer, 0), binding);
        let bindings = wgpu::Limits { max_storage_buffer_binding_size: 1 << 32, ..limits() };
        let buffer = "the scene's tables need 288 MiB, and device 3 takes 256 MiB (its max_buffer_size)";
        assert_said(&bindings, scene(18 * million, Tables::Buffer, 0), buffer);
        let texture = "the scene's tables need 10240 texels an edge, and device 3 takes 8192 texels an edge";
        assert_said(&limits(), scene(80 * million, Tables::Texture, 0), texture);
        let layers = "the scene's textures need 257 texture layers, and device 3 takes 256 texture layers";
        assert_said(&limits(), scene(1, Tables::Texture, pages), layers);
        let image = "the environment image needs 4096 texels an edge";
        let narrow = wgpu::Limits { max_texture_dimension_2d: 2048, ..limits() };
        assert_said(&narrow, small.into_iter().skip(5), image);
    }

    #[test]
    fn textures_fill_layers_and_tables_fill_rows() {
        let layers = |texels| Pages::of(texels).count;
        let page = (PAGE * PAGE) as usize;
        assert_eq!([0, 1, page, page + 1, 257 * page].map(layers), [1, 1, 1, 2, 257]);
        assert_eq!((Pages::of(0).edge, Pages::of(1).edge), (1, PAGE));
        assert_eq!([1, 8192, 8193].map(table_size), [[8192, 1], [8192, 1], [8192, 2]]);
    }

    #[test]
    fn needs_of_frames_are_checked_against_limits() {
        let frames = |programs: &[Program]| of_frames(programs, scene_buffers(Tables::Buffer)).collect::<Vec<_>>();
        let (hd, narrow, huge) = (programs(1920, 1080), programs(64, 1080), programs(4096, 4096));
        assert_said(&limits(), frames(&hd), "all is well");
        let text =
            "at 4096x4096 needs 256 MiB, and device 3 takes 128 MiB (its max_storage_buffer_binding_size): choose a";
        assert_said(&limits(), frames(&huge), text);
        assert_eq!(check(&limits(), 3, frames(&huge)).unwrap_err().remedy(), Remedy::SmallerSize);
        let few = wgpu::Limits { max_compute_workgroups_per_dimension: 100, ..limits() };
        assert_said(&few, frames(&hd), "needs 240 workgroups a row or column, and device 3 takes 100 workgroups");
        assert_said(&few, frames(&narrow), "needs 270 workgroups a row or column, and device 3 takes 100 workgroups");
        for (limits, expected) in [
            // WebGPU's default.
            (
                wgpu::Limits { max_storage_buffers_per_shader_stage: 8, ..limits() },
                "the pass path_trace needs 10 storage buffers",
            ),
            (wgpu::Limits { max_immediate_size: 32, ..limits() }, "needs 44 bytes, and device 3 takes 32 bytes"),
            (wgpu::Limits { max_compute_invocations_per_workgroup: 32, ..limits() }, "64 invocations a workgroup"),
            (wgpu::Limits { max_uniform_buffer_binding_size: 64, ..limits() }, "previous frame at 1920x1080 needs 288"),
        ] {
            assert_said(&limits, frames(&hd), expected);
        }
    }
}
