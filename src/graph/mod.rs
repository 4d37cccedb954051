//! What must happen: the stages of a frame, what they read and write, and the DAG of tasks that follows.
//!
//! A node is a task: a stage on one view and one stripe, or a transfer between devices. An edge is a resource that one
//! task leaves for another. Nothing here knows of wgpu; [`crate::exec`] carries the graph out.

mod build;
mod resource;
mod stripes;
mod table;

#[cfg(test)]
pub(crate) use build::tests as build_tests;
pub use build::{FrameGraph, Key, Task, TaskKind};
pub use resource::{PhysicalImage, Resource};
pub use stripes::{Stripes, StripesError};
pub use table::{FrameSpec, HaloPlan, Pass, Read, Seam, Stage, Views, atrous_step, passes, svgf_step};

use crate::scene::rig::Eye;

/// Who owns which rows of a view at a stage.
///
/// Stages that leave device-local lists behind (reprojection's holes) hand their stripes on; see [`Stage::ratio_group`].
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// The device that ends up with the whole images.
    primary: usize,
    stripes: Vec<((Stage, Eye), Stripes)>,
}

impl Assignment {
    /// The same stripes everywhere.
    pub fn uniform(stripes: Stripes) -> Self {
        let all = Stage::RATIO_GROUPS.iter().flat_map(|&s| Eye::ALL.map(|e| ((s, e), stripes.clone())));
        Self { primary: 0, stripes: all.collect() }
    }

    pub fn primary(&self) -> usize {
        self.primary
    }

    /// The same rows for other numbers: device i becomes `devices[i]` of `count`, those between have no rows, and
    /// `devices[0]` is the primary. `devices` rise.
    pub fn renumbered(&self, devices: &[usize], count: usize) -> Self {
        let spread = |(key, s): &((Stage, Eye), Stripes)| (*key, s.renumbered(devices, count));
        Self { primary: devices.first().copied().unwrap_or(0), stripes: self.stripes.iter().map(spread).collect() }
    }

    pub fn set(&mut self, stage: Stage, view: Eye, stripes: Stripes) {
        let key = (stage.ratio_group(), view);
        for (k, s) in &mut self.stripes {
            if *k == key {
                *s = stripes;
                return;
            }
        }
    }

    /// # Panics
    /// Never: both constructors fill every ratio group.
    pub fn stripes(&self, stage: Stage, view: Eye) -> &Stripes {
        let key = (stage.ratio_group(), view);
        let found = self.stripes.iter().find(|(k, _)| *k == key);
        &found.expect("an assignment covers every ratio group").1
    }
}
