//! Builds the DAG of one frame from its program and the stripes.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use petgraph::Direction;
use petgraph::graph::{DiGraph, NodeIndex};

use super::program::{Linked, Program};
use super::resource::{Resource, Scope};
use super::rows::{overlap, scale, share, subtract, widen};
use super::task::{Key, Task, TaskKind, TimedTask};
use super::transfer_batches::{TransferBatch, schedule_batches};
use super::{Assignment, Dispatch};
use crate::scene::rig::Eye;

/// The DAG of one frame. An edge holds the index of the image that one task passes to another.
#[derive(Debug)]
pub struct FrameGraph {
    pub dag: DiGraph<Task, usize>,
    pub program: Arc<Program>,
    /// The device on which the complete images are gathered.
    pub primary: usize,
    /// Pass number of the stitch, which comes after all passes. No pass waits for it.
    stitch_pass: u32,
    /// All tasks in key order, which is a topological order.
    order: Vec<NodeIndex>,
    /// The tasks of each device, in key order.
    orders: Vec<Vec<Task>>,
    /// The DAG nodes of the tasks in `orders`, in the same order.
    nodes: Vec<Vec<NodeIndex>>,
    /// For each DAG node, the device of its task and the task's index in that device's list in `orders`.
    places: Vec<(usize, usize)>,
}

impl FrameGraph {
    /// Builds the graph of a frame. `before` is the assignment of the previous frame, or `None` if the frame reuses no
    /// history. All outputs are gathered on the primary.
    pub fn build(program: &Arc<Program>, assignment: &Assignment, before: Option<&Assignment>) -> Self {
        Self::build_for(program, assignment, before.map(|before| (before, &[][..])), |_| true)
    }

    /// Builds the graph like [`Self::build`], but gathers only the outputs that `is_read` selects. `before` also lists
    /// the devices that have failed since the previous frame, whose rows are lost.
    pub fn build_for(
        program: &Arc<Program>,
        assignment: &Assignment,
        before: Option<(&Assignment, &[usize])>,
        is_read: impl Fn(&Resource) -> bool,
    ) -> Self {
        let mut builder = Builder::new(program, assignment);
        if let Some((before, lost)) = before {
            builder.know_history(before, lost);
        }
        for (number, linked) in program.passes().iter().enumerate() {
            builder.add_pass(number as u32, linked, assignment);
        }
        let stitch_pass = program.passes().len() as u32;
        builder.stitch(stitch_pass, assignment.primary(), is_read);
        let dag = builder.dag;
        let mut order: Vec<NodeIndex> = dag.node_indices().collect();
        order.sort_by_key(|&node| dag[node].key);
        let mut orders = vec![Vec::new(); assignment.devices()];
        let mut nodes = vec![Vec::new(); assignment.devices()];
        let mut places = vec![(0, 0); order.len()];
        for &node in &order {
            let device = dag[node].device;
            places[node.index()] = (device, orders[device].len());
            orders[device].push(dag[node].clone());
            nodes[device].push(node);
        }
        let (program, primary) = (Arc::clone(program), assignment.primary());
        Self { dag, program, primary, stitch_pass, order, orders, nodes, places }
    }

    /// Returns a device's tasks in execution order, in two parts: the tasks that other devices may wait for, and the
    /// tasks of the stitch, which the device may postpone.
    pub fn parts_of(&self, device: usize) -> (&[Task], &[Task]) {
        let tasks = &self.orders[device];
        tasks.split_at(tasks.partition_point(|t| t.key.pass < self.stitch_pass))
    }

    /// Returns a device's tasks in execution order.
    pub fn tasks_of(&self, device: usize) -> &[Task] {
        &self.orders[device]
    }

    /// Returns all tasks in topological order. The tasks of each device are in their execution order.
    pub fn order(&self) -> &[NodeIndex] {
        &self.order
    }

    pub fn devices(&self) -> usize {
        self.orders.len()
    }

    /// Returns the dependencies of a task. A task is identified by its device and its index among the device's tasks.
    pub fn dependencies(&self, device: usize, number: usize) -> Vec<(usize, usize)> {
        let before = |&node: &NodeIndex| self.dag.neighbors_directed(node, Direction::Incoming);
        self.nodes[device].get(number).into_iter().flat_map(before).map(|node| self.places[node.index()]).collect()
    }

    /// Returns the pass that a task runs, if it is a dispatch.
    pub fn pass(&self, task: &Task) -> Option<&Linked> {
        match task.kind {
            TaskKind::Dispatch { pass, .. } => self.program.passes().get(pass),
            _ => None,
        }
    }

    /// Returns the kind of a task; `None` for the stitch, which takes no time.
    pub fn timed(&self, task: &Task) -> Option<TimedTask> {
        match task.kind {
            TaskKind::Dispatch { pass, .. } => Some(TimedTask::Gpu(self.program.passes()[pass].pass.stage)),
            TaskKind::Download { .. } => Some(TimedTask::Download),
            TaskKind::Upload { .. } => Some(TimedTask::Upload),
            TaskKind::Stitch => None,
        }
    }
}

/// Rows whose newest version is on a device. `node` is the task that computed them there or uploaded them. It is `None`
/// for rows of the previous frame.
#[derive(Clone, Debug)]
struct Holding {
    rows: Range<u32>,
    device: usize,
    node: Option<NodeIndex>,
}

/// The newest version of one image of one view.
#[derive(Clone, Debug, Default)]
struct Version {
    /// Owners of the rows. For an image, the entries do not overlap, and they cover all rows except lost ones. For a
    /// table, there is one entry for each device that computes it.
    owned: Vec<Holding>,
    /// Rows of other owners that devices have received or computed as margins.
    copies: Vec<Holding>,
}

struct Builder<'a> {
    program: &'a Program,
    dag: DiGraph<Task, usize>,
    /// The versions by image and view.
    versions: Vec<Vec<Version>>,
    /// True for each device that has any rows.
    works: Vec<bool>,
    transfers: u32,
    serial: u32,
    /// Transfers of rows that the task being added (the consumer) reads.
    moved: Vec<Transfer>,
    /// Transfer batches of earlier consumers, each with its transfers.
    batches: Vec<(TransferBatch, Vec<Transfer>)>,
}

/// The download and the upload of a transfer.
#[derive(Clone, Copy, Debug)]
struct Transfer {
    down: NodeIndex,
    up: NodeIndex,
}

const UPLOAD: u8 = 0;
const DISPATCH: u8 = 1;
const DOWNLOAD: u8 = 2;

impl<'a> Builder<'a> {
    fn new(program: &'a Program, assignment: &Assignment) -> Self {
        Self {
            program,
            dag: DiGraph::new(),
            versions: vec![vec![Version::default(); program.views()]; program.images().len()],
            works: assignment.works(),
            transfers: 0,
            serial: 0,
            moved: Vec::new(),
            batches: Vec::new(),
        }
    }

    fn key(&mut self, pass: u32, phase: u8) -> Key {
        self.serial += 1;
        Key { pass, phase, serial: self.serial }
    }

    fn know_history(&mut self, before: &Assignment, lost: &[usize]) {
        let works = before.works();
        for (number, bound) in self.program.images().iter().enumerate().filter(|(_, b)| b.is_before) {
            if bound.resource.scope == Scope::Device {
                let main = self.program.main_eye();
                if self.program.writer(&bound.resource, main).is_none() {
                    continue;
                }
                let rows = bound.resource.extent(self.program.extent).rows();
                let kept = (0..before.devices()).filter(|d| works[*d] && !lost.contains(d));
                let holding = |device| Holding { rows: rows.clone(), device, node: None };
                self.versions[number][main.index()].owned = kept.map(holding).collect();
                continue;
            }
            for &view in self.program.eyes() {
                let Some(group) = self.program.writer(&bound.resource, view) else { continue };
                let (from, to) = (before.height(), bound.resource.extent(self.program.extent).height);
                let holding = |(device, rows)| Holding { rows: share(&rows, from, to), device, node: None };
                let stripes = before.stripes(group, view);
                let kept = stripes.iter().filter(|(device, _)| !lost.contains(device));
                self.versions[number][view.index()].owned = kept.map(holding).collect();
            }
        }
    }

    fn add_pass(&mut self, number: u32, linked: &Linked, assignment: &Assignment) {
        let pass = &linked.pass;
        let stripes = assignment.stripes(pass.partition, pass.view);
        let height = pass.grid.extent(self.program.extent).height;
        let mut written = Version::default();
        for device in 0..stripes.devices() {
            let own = match pass.dispatch {
                Dispatch::Once(_) if self.works[device] => 0..1,
                Dispatch::Once(_) => continue,
                _ => share(&stripes.rows(device), stripes.height(), height),
            };
            if own.is_empty() {
                continue;
            }
            let rows = widen(&own, linked.margin_rows, height);
            let key = self.key(number, DISPATCH);
            let kind = TaskKind::Dispatch { pass: number as usize, valid: own.clone() };
            let node = self.dag.add_node(Task { kind, view: pass.view, device, rows: rows.clone(), key });
            let mut valid = own.clone();
            for (used, &image) in pass.uses.iter().zip(&linked.images).filter(|(u, _)| u.is_read()) {
                let image_height = used.image.resource.extent(self.program.extent).height;
                let wanted = used.reach.rows(&scale(&rows, height, image_height), image_height);
                if image_height == height {
                    valid = valid.start.min(wanted.start)..valid.end.max(wanted.end);
                }
                let view = pass.eye_of(used);
                match used.image.resource.scope {
                    Scope::View => self.need(image, view, wanted, node, number),
                    Scope::Device => self.need_table(image, node, number),
                }
            }
            self.close_batches(number);
            if let TaskKind::Dispatch { valid: rows, .. } = &mut self.dag[node].kind {
                *rows = valid;
            }
            written.owned.push(Holding { rows: own.clone(), device, node: Some(node) });
            for margin in [rows.start..own.start, own.end..rows.end] {
                if !margin.is_empty() {
                    written.copies.push(Holding { rows: margin, device, node: Some(node) });
                }
            }
        }
        for (used, &image) in pass.uses.iter().zip(&linked.images).filter(|(u, _)| u.access.writes()) {
            self.versions[image][pass.eye_of(used).index()].clone_from(&written);
        }
    }

    /// Makes `consumer` depend on the task that wrote its device's copy of a table. A device that had no rows in the
    /// previous frame has no copy of that frame's tables, and receives one.
    fn need_table(&mut self, image: usize, consumer: NodeIndex, pass: u32) {
        let (device, main) = (self.dag[consumer].device, self.program.main_eye());
        let version = &self.versions[image][main.index()];
        let held = version.owned.iter().chain(&version.copies).find(|h| h.device == device);
        match (held, version.owned.first().cloned()) {
            (Some(held), _) => {
                if let Some(node) = held.node {
                    self.dag.update_edge(node, consumer, image);
                }
            }
            (None, Some(owner)) => {
                let copy = self.transfer((image, main), owner.rows.clone(), &owner, consumer, pass);
                self.versions[image][main.index()].copies.push(copy);
            }
            (None, None) => {}
        }
    }

    /// Makes `consumer` depend on the tasks that bring `rows` of an image to its device, and adds the missing
    /// transfers.
    fn need(&mut self, image: usize, view: Eye, rows: Range<u32>, consumer: NodeIndex, pass: u32) {
        let device = self.dag[consumer].device;
        let mut version = std::mem::take(&mut self.versions[image][view.index()]);
        let mut missing = vec![rows.clone()];
        let here = |h: &&Holding| h.device == device && overlap(&h.rows, &rows).is_some();
        for held in version.owned.iter().chain(&version.copies).filter(here) {
            if let Some(node) = held.node {
                self.dag.update_edge(node, consumer, image);
            }
            missing = missing.iter().flat_map(|m| subtract(m, &held.rows)).collect();
        }
        for gap in missing {
            for owner in &version.owned {
                if let Some(part) = overlap(&owner.rows, &gap) {
                    version.copies.push(self.transfer((image, view), part, owner, consumer, pass));
                }
            }
        }
        self.versions[image][view.index()] = version;
    }

    fn transfer(
        &mut self,
        (image, view): (usize, Eye),
        rows: Range<u32>,
        owner: &Holding,
        consumer: NodeIndex,
        pass: u32,
    ) -> Holding {
        let to = self.dag[consumer].device;
        let transfer = self.transfers;
        self.transfers += 1;
        // Rows of the previous frame have no task in this graph, and are available from its first pass on.
        let produced = owner.node.map_or(0, |node| self.dag[node].key.pass);
        let down = Task {
            kind: TaskKind::Download { image, transfer, to },
            view,
            device: owner.device,
            rows: rows.clone(),
            key: self.key(produced, DOWNLOAD),
        };
        let up = Task {
            kind: TaskKind::Upload { image, transfer },
            view,
            device: to,
            rows: rows.clone(),
            key: self.key(pass, UPLOAD),
        };
        let (down, up) = (self.dag.add_node(down), self.dag.add_node(up));
        if let Some(node) = owner.node {
            self.dag.update_edge(node, down, image);
        }
        self.dag.update_edge(down, up, image);
        self.dag.update_edge(up, consumer, image);
        self.moved.push(Transfer { down, up });
        Holding { rows, device: to, node: Some(up) }
    }

    /// Adds the stitch: its task, and the transfers to the primary of all outputs that `is_read` selects.
    fn stitch(&mut self, pass: u32, primary: usize, is_read: impl Fn(&Resource) -> bool) {
        let key = Key { pass, phase: DISPATCH, serial: u32::MAX };
        let rows = self.program.extent.rows();
        let task = Task { kind: TaskKind::Stitch, view: self.program.main_eye(), device: primary, rows, key };
        let node = self.dag.add_node(task);
        let is_read = |image: &usize| is_read(&self.program.images()[*image].resource);
        let outputs: Vec<usize> = self.program.outputs().filter(is_read).collect();
        for &view in self.program.eyes() {
            for &image in &outputs {
                let rows = self.program.images()[image].resource.extent(self.program.extent).rows();
                self.need(image, view, rows, node, pass);
            }
            self.close_batches(pass);
        }
        self.dispatch_batches(pass);
    }

    /// Groups the transfers that the newest consumer waits for into one batch per source device. The consumer waits for
    /// all of them, so separate submissions would gain nothing. `due` is the consumer's pass.
    fn close_batches(&mut self, due: u32) {
        let mut of_devices: BTreeMap<usize, (TransferBatch, Vec<Transfer>)> = BTreeMap::new();
        for transfer in self.moved.drain(..) {
            let task = &self.dag[transfer.down];
            let (batch, transfers) =
                of_devices.entry(task.device).or_insert((TransferBatch { ready: 0, due, bytes: 0 }, vec![]));
            batch.ready = batch.ready.max(task.key.pass);
            batch.bytes += self.program.bytes(task);
            transfers.push(transfer);
        }
        self.batches.extend(of_devices.into_values());
    }

    /// Schedules the transfer batches. `end` is one past the last pass.
    fn dispatch_batches(&mut self, end: u32) {
        let (batches, transfers): (Vec<_>, Vec<_>) = self.batches.drain(..).unzip();
        for (schedule, transfers) in schedule_batches(&batches, end).into_iter().zip(transfers) {
            for Transfer { down, up } in transfers {
                self.dag[down].key.pass = schedule.leaves_behind;
                self.dag[up].key.pass = schedule.arrives_before;
            }
        }
    }
}

#[cfg(test)]
pub mod tests;
