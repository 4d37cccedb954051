//! Mask compaction: lists the pixels to path trace, in frames whose other pixels the denoiser fills in.

use super::gbuffer::{GUIDE, HIT, TALLY};
use super::path_trace::PARTITION;
use super::resources::{HOLES, RADIANCE};
use crate::graph::{Kernel, Pass, Stage, Use};
use crate::scene::rig::Eye;

pub fn pass(view: Eye) -> Pass {
    Pass::new(Stage("select"), view, PARTITION, Kernel::new("mask_compaction")).uses([
        Use::read(HIT),
        Use::read(GUIDE),
        Use::write(RADIANCE),
        Use::update(TALLY),
        Use::write_then_read(HOLES).cleared().named("new_list"),
    ])
}
