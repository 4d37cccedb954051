//! Simulates a frame's graph on a virtual clock with the costs that a model predicts, following the order in which
//! workers execute it.
//!
//! Each device takes its tasks in the order of their keys (see `exec/README.md`). Stages run one after another on the
//! device's queue. Transfers occupy the device's host thread: a download first waits until the queue is idle, and an
//! upload until its rows have arrived. No later stage starts before the upload has ended. The network delays rows
//! between machines; rows that share a link are sent one after another. The delay counts as part of the upload that
//! waits for the rows. A real worker may receive rows between two downloads. The simulation puts all downloads first,
//! so it may predict uploads a little too late.

use petgraph::Direction;
use petgraph::graph::NodeIndex;

use super::cost::CostModel;
use super::network::Traffic;
use super::relative_cost::RelativeCost;
use crate::graph::{FrameGraph, Task, TaskKind, TimedTask};
use crate::scene::rig::Eye;

/// A predicted frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    pub makespan_ms: f64,
    /// Times of each device's tasks in execution order, without waits.
    pub tasks_ms: Vec<Vec<f64>>,
    /// Time that each device spends in stages.
    pub busy_ms: Vec<f64>,
    /// Host time in transfers, summed over all devices.
    pub transfer_ms: f64,
    /// Critical path from the start of the frame to its end: tasks of which each waited for the previous one.
    pub critical_path: Vec<Step>,
    pub limit: Limit,
}

/// A task of the critical path. The time of a stage includes the gap before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    pub kind: TimedTask,
    pub view: Eye,
    pub device: usize,
    pub begin_ms: f64,
    pub end_ms: f64,
}

/// Bottleneck of a frame: the cause of the largest loss of time, compared with a frame in which all devices share the
/// work of a single device evenly and lose no other time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// No bottleneck: all losses together are at most [`LOSS_SHARE`] of the makespan.
    Work,
    /// Devices that wait for slower stripes.
    Imbalance,
    /// Margin rows, which devices compute redundantly.
    Margins,
    /// Transfers on the critical path.
    Transfers,
    /// Time of the host before the first stage and after the last task, and gaps between stages.
    Overhead,
}

impl Limit {
    pub fn name(self) -> &'static str {
        match self {
            Self::Work => "work",
            Self::Imbalance => "imbalance",
            Self::Margins => "margins",
            Self::Transfers => "transfers",
            Self::Overhead => "overhead",
        }
    }
}

/// Fraction of the makespan up to which losses are ignored and the limit is [`Limit::Work`].
pub const LOSS_SHARE: f64 = 0.05;

/// Predicts the timing of a frame with this graph, at the relative cost of the frames that the model plans.
pub fn simulate(graph: &FrameGraph, model: &CostModel) -> Prediction {
    simulate_at(graph, model, model.relative_cost())
}

/// Predicts the timing of a frame with this graph at another relative cost.
pub fn simulate_at(graph: &FrameGraph, model: &CostModel, relative_cost: &RelativeCost) -> Prediction {
    let mut play = Play::new(graph, model, relative_cost);
    graph.order().iter().for_each(|&node| play.play(node));
    play.conclude()
}

/// A task that has been simulated.
#[derive(Clone, Copy, Default)]
struct Played {
    begin_ms: f64,
    end_ms: f64,
    /// The task whose end let this one begin; `None` if it began with the frame.
    cause: Option<NodeIndex>,
}

/// Time at which a device's queue or host thread is free again, and the task that occupies it until then.
#[derive(Clone, Copy)]
struct Free {
    at_ms: f64,
    cause: Option<NodeIndex>,
}

impl Free {
    fn or_later(self, other: Self) -> Self {
        if other.at_ms > self.at_ms { other } else { self }
    }
}

struct Clock {
    queue: Free,
    host: Free,
    /// End of the last upload, before which no later stage is submitted.
    gate: Free,
    /// The device's task that was simulated last.
    last: Option<NodeIndex>,
}

struct Play<'a> {
    graph: &'a FrameGraph,
    model: &'a CostModel,
    relative_cost: &'a RelativeCost,
    clocks: Vec<Clock>,
    /// The tasks by node. Tasks are simulated in the common order, thus after those that they depend on.
    played: Vec<Played>,
    tasks_ms: Vec<Vec<f64>>,
    busy_ms: Vec<f64>,
    transfer_ms: f64,
    traffic: Traffic,
}

impl<'a> Play<'a> {
    fn new(graph: &'a FrameGraph, model: &'a CostModel, relative_cost: &'a RelativeCost) -> Self {
        let clock = |device| {
            let begin = Free { at_ms: model.lead_ms(device), cause: None };
            Clock { queue: begin, host: begin, gate: begin, last: None }
        };
        let devices = graph.devices();
        let clocks = (0..devices).map(clock).collect();
        let played = vec![Played::default(); graph.dag.node_count()];
        let tasks_ms = (0..devices).map(|device| Vec::with_capacity(graph.tasks_of(device).len())).collect();
        let (busy_ms, traffic) = (vec![0.0; devices], Traffic::default());
        Self { graph, model, relative_cost, clocks, played, tasks_ms, busy_ms, transfer_ms: 0.0, traffic }
    }

    /// Returns the time of a task without waits.
    fn task_ms(&self, task: &Task) -> f64 {
        match task.kind {
            TaskKind::Dispatch { pass, .. } => {
                let pass = &self.graph.program.passes()[pass].pass;
                self.model.pass_ms_at(self.relative_cost, pass, task.device, &task.rows)
            }
            TaskKind::Download { .. } => self.model.download_ms(task.device, self.graph.program.bytes(task)),
            TaskKind::Upload { .. } => self.model.upload_ms(task.device, self.graph.program.bytes(task)),
            TaskKind::Stitch => 0.0,
        }
    }

    /// Returns the time at which the rows of an upload have arrived, and the time at which they left their device.
    fn come(&mut self, node: NodeIndex) -> (Free, f64) {
        let mut before = self.graph.dag.neighbors_directed(node, Direction::Incoming);
        let download = before.next().expect("every upload follows its download");
        let (from, task) = (self.graph.dag[download].device, &self.graph.dag[node]);
        let sent_ms = self.played[download.index()].end_ms;
        let bytes = self.graph.program.bytes(task);
        let at_ms = self.model.network.arrival_ms(&mut self.traffic, from, task.device, bytes, sent_ms);
        (Free { at_ms, cause: Some(download) }, sent_ms)
    }

    fn play(&mut self, node: NodeIndex) {
        let task = &self.graph.dag[node];
        let device = task.device;
        let Clock { queue, host, gate, .. } = self.clocks[device];
        let mut left_ms = f64::INFINITY;
        let from = match task.kind {
            TaskKind::Dispatch { .. } => queue.or_later(gate),
            TaskKind::Download { .. } | TaskKind::Stitch => queue.or_later(host),
            TaskKind::Upload { .. } => {
                let (come, sent_ms) = self.come(node);
                if come.at_ms >= host.at_ms {
                    left_ms = sent_ms;
                }
                come.or_later(host)
            }
        };
        let ms = self.task_ms(task);
        self.tasks_ms[device].push(ms);
        let gap_ms = if matches!(task.kind, TaskKind::Dispatch { .. }) { self.model.gap_ms(device) } else { 0.0 };
        let end_ms = from.at_ms + gap_ms + ms;
        let end = Free { at_ms: end_ms, cause: Some(node) };
        self.played[node.index()] = Played { begin_ms: from.at_ms.min(left_ms), end_ms, cause: from.cause };
        let clock = &mut self.clocks[device];
        clock.last = Some(node);
        match task.kind {
            TaskKind::Dispatch { .. } => {
                clock.queue = end;
                self.busy_ms[device] += ms;
            }
            TaskKind::Download { .. } => {
                clock.host = end;
                self.transfer_ms += ms;
            }
            TaskKind::Upload { .. } => {
                clock.host = end;
                clock.gate = end;
                self.transfer_ms += ms;
            }
            TaskKind::Stitch => {}
        }
    }

    fn conclude(self) -> Prediction {
        let stitch = self.clocks[self.graph.primary].last;
        let end_ms = stitch.map_or(0.0, |node| self.played[node.index()].end_ms);
        let critical_path = self.path_to(stitch);
        let makespan_ms = end_ms + self.model.tail_ms();
        let limit = self.limit(makespan_ms, &critical_path);
        let Self { tasks_ms, busy_ms, transfer_ms, .. } = self;
        Prediction { makespan_ms, tasks_ms, busy_ms, transfer_ms, critical_path, limit }
    }

    fn path_to(&self, mut at: Option<NodeIndex>) -> Vec<Step> {
        let mut path = Vec::new();
        while let Some(node) = at {
            let task = &self.graph.dag[node];
            let Played { begin_ms, end_ms, cause } = self.played[node.index()];
            let step = |kind| Step { kind, view: task.view, device: task.device, begin_ms, end_ms };
            path.extend(self.graph.timed(task).map(step));
            at = cause;
        }
        path.reverse();
        path
    }

    /// Returns the cause of the largest loss. Since the steps of the critical path and the overhead add up to the
    /// makespan, the losses add up to the makespan minus each device's even part of the work without margins.
    fn limit(&self, makespan_ms: f64, path: &[Step]) -> Limit {
        let mean_busy_ms = self.busy_ms.iter().sum::<f64>() / self.busy_ms.len() as f64;
        let (mut stages_ms, mut transfers_ms) = (0.0, 0.0);
        for step in path {
            match step.kind {
                TimedTask::Gpu(_) => stages_ms += step.end_ms - step.begin_ms - self.model.gap_ms(step.device),
                TimedTask::Download | TimedTask::Upload => transfers_ms += step.end_ms - step.begin_ms,
            }
        }
        let losses = [
            (Limit::Imbalance, stages_ms - mean_busy_ms),
            (Limit::Margins, self.margins_ms() / self.busy_ms.len() as f64),
            (Limit::Transfers, transfers_ms),
            (Limit::Overhead, makespan_ms - stages_ms - transfers_ms),
        ];
        let lost_ms: f64 = losses.iter().map(|(_, ms)| ms).sum();
        let largest = losses.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        largest.filter(|_| lost_ms > LOSS_SHARE * makespan_ms).map_or(Limit::Work, |(limit, _)| limit)
    }

    /// Returns the time spent on redundant rows, summed over all devices.
    fn margins_ms(&self) -> f64 {
        let program = &self.graph.program;
        let mut passes = vec![(0.0, 0.0); program.passes().len()];
        for (task, played) in self.graph.dag.node_weights().zip(&self.played) {
            let TaskKind::Dispatch { pass, .. } = &task.kind else { continue };
            passes[*pass].0 += f64::from(task.rows.end - task.rows.start);
            passes[*pass].1 += played.end_ms - played.begin_ms;
        }
        let heights = program.passes().iter().map(|p| f64::from(p.pass.grid.extent(program.extent).height));
        passes.iter().zip(heights).map(|((rows, ms), height)| ms * (1.0 - height / f64::max(*rows, height))).sum()
    }
}
