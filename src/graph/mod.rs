//! Says what must happen in a frame: passes as plain data, the program that they form, and the DAG of tasks that
//! follows from the program and from the stripes of each device.
//!
//! A node is a task: a pass on one view and one stripe, or a transfer between devices. An edge is an image that one
//! task leaves for another. Nothing here knows wgpu, nor what a pass computes: [`crate::passes`] declares the renderer's
//! own passes, and [`crate::exec`] carries the graph out.

mod build;
mod halo;
mod launch;
mod parcels;
mod pass;
mod program;
mod resource;
mod rows;
mod stripes;
mod task;

pub use build::FrameGraph;
pub use halo::{HaloPlan, Seam};
pub use launch::{Launch, Run, runs};
pub use pass::{Access, Chain, CutGroup, Dispatch, Kernel, Pass, Reach, SceneUse, Stage, Use, Work};
pub use program::{Bound, Linked, Program, ProgramError};
pub use resource::{Format, Grid, Image, LIST_HEADER, Life, Projection, Resource, Scope, Size};
pub use stripes::{Stripes, StripesError};
pub use task::{Key, Task, TaskKind};

use crate::scene::rig::Eye;

/// Says which device has which rows of a view, for each group of passes that have the same stripes.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// The device that ends up with the whole images.
    primary: usize,
    /// The stripes of groups that have none of their own.
    common: Stripes,
    own: Vec<((CutGroup, Eye), Stripes)>,
}

impl Assignment {
    /// An assignment with the same stripes everywhere.
    pub fn uniform(stripes: Stripes) -> Self {
        Self { primary: 0, common: stripes, own: Vec::new() }
    }

    pub fn primary(&self) -> usize {
        self.primary
    }

    pub fn devices(&self) -> usize {
        self.common.devices()
    }

    /// The stripes of groups that have none of their own.
    pub fn common(&self) -> &Stripes {
        &self.common
    }

    /// The stripes that groups have for themselves.
    pub fn own(&self) -> &[((CutGroup, Eye), Stripes)] {
        &self.own
    }

    /// The same stripes with another primary; none if there is no such device.
    pub fn with_primary(self, primary: usize) -> Option<Self> {
        (primary < self.devices()).then_some(Self { primary, ..self })
    }

    /// The number of rows of the frame.
    pub fn height(&self) -> u32 {
        self.common.height()
    }

    /// Says of each device whether it has any rows.
    pub(crate) fn works(&self) -> Vec<bool> {
        let all = || std::iter::once(&self.common).chain(self.own.iter().map(|(_, s)| s));
        (0..self.devices()).map(|d| all().any(|s| !s.rows(d).is_empty())).collect()
    }

    /// The same rows with other device numbers. Device i becomes `devices[i]` of `count`, devices between them have no
    /// rows, and `devices[0]` is the primary. The numbers in `devices` rise.
    pub fn renumbered(&self, devices: &[usize], count: usize) -> Self {
        let own = self.own.iter().map(|(key, s)| (*key, s.renumbered(devices, count))).collect();
        let common = self.common.renumbered(devices, count);
        Self { primary: devices.first().copied().unwrap_or(0), common, own }
    }

    pub fn set(&mut self, group: CutGroup, view: Eye, stripes: Stripes) {
        let key = (group, view);
        match self.own.iter_mut().find(|(k, _)| *k == key) {
            Some((_, own)) => *own = stripes,
            None => self.own.push((key, stripes)),
        }
    }

    /// Has the primary compute all rows of a group.
    pub fn gather(&mut self, group: CutGroup) {
        let edge = |device: usize| if device <= self.primary { 0 } else { self.height() };
        let stripes = Stripes::from_edges(self.height(), &(1..self.devices()).map(edge).collect::<Vec<_>>());
        Eye::ALL.into_iter().for_each(|view| self.set(group, view, stripes.clone()));
    }

    pub fn stripes(&self, group: CutGroup, view: Eye) -> &Stripes {
        let key = (group, view);
        self.own.iter().find(|(k, _)| *k == key).map_or(&self.common, |(_, own)| own)
    }
}
