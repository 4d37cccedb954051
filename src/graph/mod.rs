//! Describes a frame as plain data: passes, the program that they form, and the DAG of tasks that is derived from the
//! program and from the stripes of each device.
//!
//! A node is a task: a pass on one view and one stripe, the download or the upload of a transfer between devices, or
//! the stitch. An edge is an image that one task passes to another. This module depends neither on wgpu nor on the
//! contents of passes: [`crate::passes`] declares the renderer's own passes, and [`crate::exec`] executes the graph.

mod build;
mod halo;
mod transfer_batches;
mod pass;
mod program;
mod resource;
mod rows;
mod stripes;
mod task;
mod uses;

pub use crate::samples::Launch;
pub use build::FrameGraph;
pub use halo::{HaloPlan, Seam};
pub use pass::{Chain, Dispatch, Kernel, Partition, Pass, SceneUse, Stage, Work};
pub use program::{Bound, Linked, Program, ProgramError};
pub use resource::{Format, Grid, Image, LIST_GROUP, LIST_HEADER, Life, Resource, Scope};
pub use stripes::{Stripes, StripesError};
pub use task::{Key, Task, TaskKind, TimedTask};
pub use uses::{Access, Reach, Use};

use crate::scene::rig::Eye;

/// Distribution of the rows of each view over devices, for each group of passes that use the same stripes.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// The device on which the complete images are gathered.
    primary: usize,
    /// Stripes of all groups and views without an entry in `own`.
    common: Stripes,
    /// Stripes of a group on one view or, without a view, on all others.
    own: Vec<((Partition, Option<Eye>), Stripes)>,
}

impl Assignment {
    /// Makes an assignment with the same stripes for all groups and views.
    pub fn uniform(stripes: Stripes) -> Self {
        Self { primary: 0, common: stripes, own: Vec::new() }
    }

    pub fn primary(&self) -> usize {
        self.primary
    }

    pub fn devices(&self) -> usize {
        self.common.devices()
    }

    /// Returns the stripes of all groups and views without an entry in [`Self::own()`].
    pub fn common(&self) -> &Stripes {
        &self.common
    }

    /// Returns the stripes that were set for a group on a view or, without a view, on all others. All other groups use
    /// [`Self::common()`].
    pub fn own(&self) -> &[((Partition, Option<Eye>), Stripes)] {
        &self.own
    }

    /// Returns this assignment with `primary` as the primary, or `None` if there is no such device.
    pub fn with_primary(self, primary: usize) -> Option<Self> {
        (primary < self.devices()).then_some(Self { primary, ..self })
    }

    /// Returns the number of rows of the frame.
    pub fn height(&self) -> u32 {
        self.common.height()
    }

    /// Returns true for each device that has any rows.
    pub(crate) fn works(&self) -> Vec<bool> {
        let all = || std::iter::once(&self.common).chain(self.own.iter().map(|(_, s)| s));
        (0..self.devices()).map(|d| all().any(|s| !s.rows(d).is_empty())).collect()
    }

    /// Returns this assignment for `count` devices, with other device numbers. The rows of device i go to device
    /// `devices[i]`, all other devices have no rows, and `devices[0]` is the primary. `devices` must be in ascending
    /// order.
    pub fn renumbered(&self, devices: &[usize], count: usize) -> Self {
        let own = self.own.iter().map(|(key, s)| (*key, s.renumbered(devices, count))).collect();
        let common = self.common.renumbered(devices, count);
        Self { primary: devices.first().copied().unwrap_or(0), common, own }
    }

    /// Sets the stripes of a group on one view or, with `None`, on all views.
    pub fn set(&mut self, group: Partition, view: impl Into<Option<Eye>>, stripes: Stripes) {
        let view = view.into();
        self.own.retain(|((g, v), _)| *g != group || (view.is_some() && *v != view));
        self.own.push(((group, view), stripes));
    }

    /// Assigns all rows of a group to the primary.
    pub fn gather(&mut self, group: Partition) {
        let edge = |device: usize| if device <= self.primary { 0 } else { self.height() };
        let stripes = Stripes::from_edges(self.height(), &(1..self.devices()).map(edge).collect::<Vec<_>>());
        self.set(group, None, stripes);
    }

    pub fn stripes(&self, group: Partition, view: Eye) -> &Stripes {
        let of = |view| self.own.iter().find(move |(key, _)| *key == (group, view));
        of(Some(view)).or_else(|| of(None)).map_or(&self.common, |(_, own)| own)
    }
}
