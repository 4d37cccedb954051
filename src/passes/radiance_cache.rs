//! The radiance cache: a hash table, in world space, of the light that surfaces reflect. Paths end in it instead of
//! sampling lights and bouncing on.
//!
//! A frame reads the table of the previous frame. Some paths of the left eye record the light that they find in a cell;
//! the devices exchange these records, and each adds all of them to its own table. Since light and albedo are summed in
//! integers, all devices have the same table.

use glam::UVec4;

use super::FrameSpec;
use crate::graph::{Grid, Kernel, Partition, Pass, Reach, Resource, Stage, Use};
use crate::image::Extent;
use crate::scene::rig::Eye;
use crate::wgsl::{Texel, arguments, constants};

/// Partition of its own: passes that all devices run in full must not move path tracing to another set of partitions.
const PARTITION: Partition = Partition("radiance_cache");

/// Number of pixels in a row of which half may record a path.
pub const RECORD_SEGMENT: u32 = 16;

/// Number of words of a record: cell, packed light and packed albedo.
pub const RECORD_WORDS: u32 = 3;

/// Number of invocations in a workgroup.
const GROUP: u32 = 64;

/// Bounds on the number of slots.
const SLOTS: [u32; 2] = [1 << 12, 1 << 17];

/// Columns of the table, which are arbitrary.
const COLUMNS: u32 = 64;

arguments! {
    struct SumArguments {
        /// 0 to let new cells claim empty slots, 1 to add records to the sums of their cells.
        pub adds: u32,
        /// Number of records.
        pub count: u32,
    }
}

/// Number of 32-bit words in the [`Sums`] of a slot.
const SUM_WORDS: u32 = size_of::<Sums>() as u32 / 4;

const SUM: Kernel = Kernel::new("cache_sums").workgroup([GROUP, 1, 1]).with(constants![SUM_WORDS, RECORD_WORDS]);
const RENEW: Kernel = Kernel::new("radiance_cache").workgroup([GROUP, 1, 1]);

/// Sums of the records of a slot: the key of the new cell, the number of records, and the low and the high word of the
/// sum of each channel of their light and of their albedo. Two words are not used.
struct Sums(#[expect(dead_code, reason = "only its size is used")] [u32; 16]);

/// Invocations add to sums concurrently.
impl Texel for Sums {
    const ELEMENT: &'static str = "atomic<u32>";
}

/// Returns a resource if frames use the cache, and otherwise a dummy of one texel.
fn if_used(spec: &FrameSpec, resource: Resource) -> Resource {
    if spec.caches() { resource } else { resource.on(Grid::Fixed(Extent::new(1, 1))) }
}

/// Returns the number of slots, each of which holds a cell: about one for each pixel.
fn slots(spec: &FrameSpec) -> u32 {
    let pixels = u32::try_from(spec.extent.area()).unwrap_or(u32::MAX);
    pixels.clamp(SLOTS[0], SLOTS[1]).next_power_of_two()
}

/// Returns a table with a texel for each slot.
fn of_slots<T: Texel>(spec: &FrameSpec, name: &'static str) -> Resource {
    if_used(spec, Resource::table::<T>(name, Extent::new(COLUMNS, slots(spec) / COLUMNS)))
}

fn table(spec: &FrameSpec) -> Resource {
    of_slots::<[UVec4; 3]>(spec, "cache")
}

/// Returns the image of the records of half of the pixels' paths.
fn records(spec: &FrameSpec) -> Resource {
    let lanes =
        Resource::image::<[u32; (RECORD_WORDS * RECORD_SEGMENT / 2) as usize]>("cache_records").bound_as("records");
    if_used(spec, lanes.on(Grid::FrameColumnsOver(RECORD_SEGMENT)))
}

/// Returns the bindings of passes that path trace a view. Paths of other views than the main one record nothing.
pub fn uses(spec: &FrameSpec, view: Eye) -> [Use; 2] {
    let records = Use::write(records(spec));
    [read_table(spec), Use { is_cleared: spec.caches() && view.is_main(), ..records }]
}

fn read_table(spec: &FrameSpec) -> Use {
    Use::read(table(spec)).before(spec.history_rows.filter(|_| spec.caches()).map(|_| 0))
}

/// Returns the passes that add the records of a frame to the table.
pub fn passes(spec: &FrameSpec) -> [Pass; 2] {
    let records = records(spec);
    let extent = records.extent(spec.extent);
    let count = extent.width * extent.height * (RECORD_SEGMENT / 2);
    let sums = of_slots::<Sums>(spec, "cache_sums");
    let of_device =
        |kernel: Kernel| Pass::once(Stage(kernel.name), PARTITION, kernel, [slots(spec).div_ceil(GROUP), 1, 1]);
    [
        of_device(SUM)
            .uses([
                read_table(spec),
                Use::write_then_read(sums).cleared(),
                Use::read(records).reaching(Reach::All).named("records"),
            ])
            .with([0, 1].map(|adds| SumArguments { adds, count })),
        of_device(RENEW).uses([read_table(spec), Use::read(sums).viewed_as::<UVec4>(), Use::write(table(spec))]),
    ]
}
