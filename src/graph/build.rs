//! From passes and stripes to the DAG of one frame.

use std::collections::HashMap;
use std::ops::Range;

use petgraph::graph::{DiGraph, NodeIndex};

use super::Assignment;
use super::resource::Resource;
use super::table::{FrameSpec, Pass, Stage, passes};
use crate::scene::rig::Eye;

/// Position of a task in the one order that all devices keep to. Downloads follow their producer, uploads wait for their
/// consumer. Every edge of the graph goes from a smaller key to a larger one, so workers that each take their
/// tasks by key cannot wait for one another in a circle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Key {
    /// Index of the pass.
    pub pass: u32,
    /// Upload, dispatch, download.
    pub phase: u8,
    pub serial: u32,
}

#[derive(Clone, Debug, PartialEq)]
pub enum TaskKind {
    Dispatch {
        stage: Stage,
        index: u32,
        /// Rows that may be read.
        valid: Range<u32>,
        filter: Option<(Resource, Resource)>,
    },
    /// Rows leave the device; `transfer` names the upload that takes them.
    Download {
        resource: Resource,
        transfer: u32,
        to: usize,
    },
    Upload {
        resource: Resource,
        transfer: u32,
    },
    /// Both whole images are on the primary.
    Stitch,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    pub kind: TaskKind,
    pub view: Eye,
    pub device: usize,
    /// Rows computed or moved.
    pub rows: Range<u32>,
    pub key: Key,
}

/// The DAG of one frame.
#[derive(Debug)]
pub struct FrameGraph {
    pub dag: DiGraph<Task, Resource>,
    /// The device that ends up with the whole images.
    pub primary: usize,
    /// The pass that no other waits for, after all others.
    stitch_pass: u32,
    /// Per device, in the order of keys.
    orders: Vec<Vec<Task>>,
}

impl FrameGraph {
    /// `before`: who had which rows in the frame before, if this one is to know its history
    /// ([`FrameSpec::history_rows`]).
    pub fn build(spec: &FrameSpec, assignment: &Assignment, before: Option<&Assignment>) -> Self {
        let passes = passes(spec);
        let mut builder = Builder::default();
        if let Some(before) = before {
            builder.know_history(spec, before);
        }
        for (i, pass) in passes.iter().enumerate() {
            builder.add_pass(i as u32, pass, spec, assignment);
        }
        let stitch_pass = passes.len() as u32;
        builder.stitch(stitch_pass, spec, assignment.primary());
        let mut orders = vec![Vec::new(); spec.devices];
        for task in builder.dag.node_weights() {
            orders[task.device].push(task.clone());
        }
        orders.iter_mut().for_each(|tasks| tasks.sort_by_key(|t| t.key));
        Self { dag: builder.dag, primary: assignment.primary(), stitch_pass, orders }
    }

    /// A device's tasks in the order it carries them out: first those that others may wait for, then those of the
    /// stitch, which it may put off.
    pub fn parts_of(&self, device: usize) -> (&[Task], &[Task]) {
        let tasks = &self.orders[device];
        tasks.split_at(tasks.partition_point(|t| t.key.pass < self.stitch_pass))
    }

    /// A device's tasks in the order it carries them out.
    pub fn tasks_of(&self, device: usize) -> &[Task] {
        &self.orders[device]
    }
}

/// Rows that a device holds in their newest version, and the task that left them there; none: the frame before did.
#[derive(Clone, Debug)]
struct Holding {
    rows: Range<u32>,
    device: usize,
    node: Option<NodeIndex>,
}

/// Newest version of one resource of one view.
#[derive(Clone, Debug, Default)]
struct Version {
    /// Covers the frame without overlap.
    owned: Vec<Holding>,
    /// Rows that devices hold beside their own.
    copies: Vec<Holding>,
}

#[derive(Default)]
struct Builder {
    dag: DiGraph<Task, Resource>,
    versions: HashMap<(Resource, Eye), Version>,
    transfers: u32,
    serial: u32,
}

const UPLOAD: u8 = 0;
const DISPATCH: u8 = 1;
const DOWNLOAD: u8 = 2;

impl Builder {
    fn key(&mut self, pass: u32, phase: u8) -> Key {
        self.serial += 1;
        Key { pass, phase, serial: self.serial }
    }

    fn know_history(&mut self, spec: &FrameSpec, before: &Assignment) {
        for (resource, stage) in spec.kept() {
            for (last, view) in resource.next_frames().into_iter().flat_map(|last| Eye::ALL.map(|view| (last, view))) {
                let stripes = before.stripes(*stage, view);
                let owned = stripes.iter().map(|(device, rows)| Holding { rows, device, node: None }).collect();
                self.versions.insert((last, view), Version { owned, copies: Vec::new() });
            }
        }
    }

    fn add_pass(&mut self, number: u32, pass: &Pass, spec: &FrameSpec, assignment: &Assignment) {
        let stripes = assignment.stripes(pass.stage, pass.view);
        let mut written = Version::default();
        for (device, own) in stripes.iter() {
            let rows = widen(&own, pass.margin_rows, spec);
            let reach = pass.reads.iter().map(|r| r.halo_rows).max().unwrap_or(0);
            let kind = TaskKind::Dispatch {
                stage: pass.stage,
                index: pass.index,
                valid: widen(&own, reach, spec),
                filter: pass.filter,
            };
            let key = self.key(number, DISPATCH);
            let node = self.dag.add_node(Task { kind, view: pass.view, device, rows: rows.clone(), key });
            let first_transfer = self.transfers;
            for read in &pass.reads {
                let wanted = widen(&own, read.halo_rows, spec);
                self.need((read.resource, read.view), wanted, node, number);
            }
            self.join_downloads(first_transfer);
            written.owned.push(Holding { rows: own.clone(), device, node: Some(node) });
            for margin in [rows.start..own.start, own.end..rows.end] {
                if !margin.is_empty() {
                    written.copies.push(Holding { rows: margin, device, node: Some(node) });
                }
            }
        }
        for &resource in &pass.writes {
            self.versions.insert((resource, pass.view), written.clone());
        }
    }

    /// Makes `consumer` follow whatever brings `rows` of a resource to its device.
    fn need(&mut self, what: (Resource, Eye), rows: Range<u32>, consumer: NodeIndex, pass: u32) {
        let device = self.dag[consumer].device;
        let version = self.versions.get(&what).cloned().unwrap_or_default();
        let mut missing = vec![rows.clone()];
        let here = |h: &&Holding| h.device == device && overlap(&h.rows, &rows).is_some();
        for held in version.owned.iter().chain(&version.copies).filter(here) {
            if let Some(node) = held.node {
                self.dag.update_edge(node, consumer, what.0);
            }
            missing = missing.iter().flat_map(|m| subtract(m, &held.rows)).collect();
        }
        for gap in missing {
            for owner in &version.owned {
                if let Some(part) = overlap(&owner.rows, &gap) {
                    self.transfer(what, part, owner, consumer, pass);
                }
            }
        }
    }

    fn transfer(&mut self, what: (Resource, Eye), rows: Range<u32>, owner: &Holding, consumer: NodeIndex, pass: u32) {
        let (resource, view) = what;
        let to = self.dag[consumer].device;
        let transfer = self.transfers;
        self.transfers += 1;
        // What the frame before left can go at once.
        let produced = owner.node.map_or(0, |node| self.dag[node].key.pass);
        let down = Task {
            kind: TaskKind::Download { resource, transfer, to },
            view,
            device: owner.device,
            rows: rows.clone(),
            key: self.key(produced, DOWNLOAD),
        };
        let up = Task {
            kind: TaskKind::Upload { resource, transfer },
            view,
            device: to,
            rows: rows.clone(),
            key: self.key(pass, UPLOAD),
        };
        let (down, up) = (self.dag.add_node(down), self.dag.add_node(up));
        if let Some(node) = owner.node {
            self.dag.update_edge(node, down, resource);
        }
        self.dag.update_edge(down, up, resource);
        self.dag.update_edge(up, consumer, resource);
        let version = self.versions.entry(what).or_default();
        version.copies.push(Holding { rows, device: to, node: Some(up) });
    }

    /// Brings what leaves the frame to the primary.
    fn stitch(&mut self, pass: u32, spec: &FrameSpec, primary: usize) {
        let key = Key { pass, phase: DISPATCH, serial: u32::MAX };
        let rows = spec.extent.rows();
        let task = Task { kind: TaskKind::Stitch, view: Eye::Left, device: primary, rows: rows.clone(), key };
        let node = self.dag.add_node(task);
        let aovs = (0..spec.aovs).map(Resource::Aov);
        let outputs: Vec<_> =
            [Resource::Linear, Resource::Display, Resource::RowTally].into_iter().chain(aovs).collect();
        for view in Eye::ALL {
            let first_transfer = self.transfers;
            for &resource in &outputs {
                self.need((resource, view), rows.clone(), node, pass);
            }
            self.join_downloads(first_transfer);
        }
    }

    /// Lets the downloads that one consumer waits for leave a device together, when the last of them is there: a
    /// submission each would gain nothing.
    fn join_downloads(&mut self, first_transfer: u32) {
        let is_new = |t: &Task| matches!(t.kind, TaskKind::Download { transfer, .. } if transfer >= first_transfer);
        let mut last: HashMap<usize, u32> = HashMap::new();
        for task in self.dag.node_weights().filter(|t| is_new(t)) {
            let pass = last.entry(task.device).or_default();
            *pass = task.key.pass.max(*pass);
        }
        for task in self.dag.node_weights_mut().filter(|t| is_new(t)) {
            task.key.pass = last[&task.device];
        }
    }
}

fn widen(rows: &Range<u32>, by: u32, spec: &FrameSpec) -> Range<u32> {
    rows.start.saturating_sub(by)..(rows.end + by).min(spec.extent.height)
}

fn overlap(a: &Range<u32>, b: &Range<u32>) -> Option<Range<u32>> {
    let both = a.start.max(b.start)..a.end.min(b.end);
    (!both.is_empty()).then_some(both)
}

fn subtract(from: &Range<u32>, hole: &Range<u32>) -> impl Iterator<Item = Range<u32>> + use<> {
    let above = from.start..hole.start.clamp(from.start, from.end);
    let below = hole.end.clamp(from.start, from.end)..from.end;
    let parts = if overlap(from, hole).is_some() { [above, below] } else { [from.clone(), 0..0] };
    parts.into_iter().filter(|r| !r.is_empty())
}

#[cfg(test)]
pub mod tests;
