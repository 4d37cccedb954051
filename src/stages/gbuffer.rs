//! Primary visibility of one view.

use super::{Dispatch, Room, Slot, Work};
use crate::graph::{PhysicalImage as P, Stage};
use crate::scene::rig::Eye;

pub(super) const ROOM: Room = Room {
    stage: Stage::Gbuffer,
    shader: "gbuffer",
    reads_scene: true,
    slots: &SAMPLE_SLOTS,
    clears: &[],
    dispatches,
};

/// Group 1 of `pixel.inc.wgsl`.
pub(super) const SAMPLE_SLOTS: [Slot; 6] = [
    Slot::Write(P::Hit),
    Slot::Write(P::Albedo),
    Slot::Write(P::Emission),
    Slot::Write(P::Radiance),
    Slot::Write(P::Tally),
    Slot::Write(P::Guide),
];

fn dispatches(work: &Work<'_>) -> Vec<Dispatch> {
    // Path tracing brings means over the pixel; what is reprojected into needs them from here.
    let footprint = work.settings.reproject && work.view == Eye::Right;
    vec![Dispatch::Rows { columns: work.settings.extent.width, args: [u32::from(footprint), 0, 0] }]
}
