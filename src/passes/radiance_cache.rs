//! The radiance cache: a hash table, in world space, of the light that surfaces reflect. Paths end in it instead of
//! sampling lights and bouncing on.
//!
//! A frame reads the table of the previous frame. Some paths of the left eye record the light that they find in a cell;
//! the devices exchange these records, and each adds all of them to its own table. Since light is summed in integers,
//! all devices have the same table.

use glam::{UVec2, UVec4};

use super::{FrameSpec, path_trace};
use crate::graph::{Grid, Kernel, Launch, Pass, Reach, Resource, Size, Stage, Use};
use crate::image::Extent;
use crate::scene::rig::Eye;
use crate::wgsl::{Texel, constants};

/// Number of slots in the table, one for each cell.
pub const CACHE_SLOTS: u32 = 1 << 16;

/// Number of pixels in a row of which half may record a path.
pub const RECORD_SEGMENT: u32 = 16;

/// Number of invocations in a workgroup.
const GROUP: u32 = 64;

/// First kernel argument: new cells claim empty slots, records are added to the cells' sums, or sums are added to the
/// table. The second argument is the number of records.
const CLAIM: u32 = 0;
const ADD: u32 = 1;
const RENEW: u32 = 2;

const KERNEL: Kernel =
    Kernel::new("radiance_cache").workgroup([GROUP, 1, 1]).with(constants![CACHE_SLOTS, CLAIM, RENEW]);

/// Size of the table in cells. The number of columns is arbitrary.
const SIZE: Extent = Extent { width: 256, height: CACHE_SLOTS / 256 };

/// Sums of a cell's records; see the shader.
struct Sums(#[expect(dead_code, reason = "only its size counts")] [u32; 8]);

/// Invocations add to sums concurrently.
impl Texel for Sums {
    const ELEMENT: &'static str = "atomic<u32>";
}

/// Returns a resource if frames use the cache, and otherwise a dummy of one texel.
fn if_used(spec: &FrameSpec, resource: Resource) -> Resource {
    if spec.caches() { resource } else { resource.on(Grid::table(Size::Fixed(Extent::new(1, 1)))) }
}

/// Returns the table.
fn table(spec: &FrameSpec) -> Resource {
    if_used(spec, Resource::table::<[UVec4; 2]>("cache", SIZE))
}

/// Returns the image of the records of paths: the cell and the packed light of half of the pixels.
fn records(spec: &FrameSpec) -> Resource {
    let lanes = Resource::image::<[UVec2; RECORD_SEGMENT as usize / 2]>("cache_records").bound_as("records");
    if_used(spec, lanes.on(Grid::table(Size::FrameColumnsOver(RECORD_SEGMENT))))
}

/// Returns the bindings of a pass that path traces all pixels of a view, or of one that traces listed pixels.
pub fn uses(spec: &FrameSpec, is_listed: bool) -> [Use; 2] {
    let records = records(spec);
    let records = if is_listed { Use::update(records).if_written() } else { Use::write_then_read(records).cleared() };
    [read_table(spec), records]
}

fn read_table(spec: &FrameSpec) -> Use {
    Use::read(table(spec)).before(spec.history_rows.filter(|_| spec.caches()).map(|_| 0))
}

/// Returns the pass that adds the records of a frame to the table.
pub fn pass(spec: &FrameSpec) -> Pass {
    let records = records(spec);
    let extent = records.extent(spec.extent);
    let count = extent.width * extent.height * (RECORD_SEGMENT / 2);
    Pass::once(Stage("radiance_cache"), path_trace::PARTITION, KERNEL, [CACHE_SLOTS / GROUP, 1, 1])
        .uses([
            read_table(spec),
            Use::write(table(spec)),
            Use::write_then_read(Resource::table::<Sums>("cache_sums", SIZE)).cleared(),
            Use::read(records).of(Eye::Left).reaching(Reach::All).named("records"),
        ])
        .launches([CLAIM, ADD, RENEW].map(|step| Launch::Once([step, count, 0])).into())
}
