//! Plays a frame's graph on a virtual clock, with the costs a model predicts, the way workers carry it out.
//!
//! As in `exec/README.md`: each device takes its tasks in the order of their keys. Stages run one after another on its
//! queue; transfers take its host thread, which waits for the queue before it sends rows and for the rows of others
//! before it hands them to the queue, and holds later stages up meanwhile. Where exec would look for rows of others
//! between two downloads, here all downloads go first, so uploads may be predicted a little late.

use super::cost::CostModel;
use crate::graph::{FrameGraph, Stage, Task, TaskKind};
use crate::scene::rig::Eye;

/// A predicted frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    pub makespan_ms: f64,
    /// Per device, in stages.
    pub busy_ms: Vec<f64>,
    /// Host time in transfers, all devices.
    pub transfer_ms: f64,
    /// Tasks that each waited for the one before, from the frame's begin to its stitch.
    pub critical_path: Vec<Step>,
    pub limit: Limit,
}

/// A task of the critical path; a stage with the gap before it.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    pub kind: StepKind,
    pub view: Eye,
    pub device: usize,
    pub begin_ms: f64,
    pub end_ms: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepKind {
    Stage(Stage),
    Download,
    Upload,
    Stitch,
}

/// What costs a frame most beside the work that one device would have had to do as well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limit {
    /// Nothing else: all but 5 % of the makespan is that work.
    Work,
    /// Devices that wait for slower stripes.
    Imbalance,
    /// Margins that two devices compute.
    Margins,
    /// Transfers that others wait for.
    Transfers,
    /// The host's time before the first stage and after the last task, and gaps between stages.
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

/// Part of a frame's time that may be lost before something else than work limits it.
pub const LOSS_SHARE: f64 = 0.05;

/// The graph makes devices wait for one another in a circle.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("device {device} waits for ever for the rows of transfer {transfer}")]
pub struct Stuck {
    pub device: usize,
    pub transfer: u32,
}

/// Predicts how a frame with this graph will go.
///
/// # Errors
/// When tasks wait for one another in a circle; graphs that [`FrameGraph::build`] makes have none.
pub fn simulate(graph: &FrameGraph, model: &CostModel) -> Result<Prediction, Stuck> {
    let mut play = Play::new(graph, model);
    let mut moved = true;
    while moved {
        moved = false;
        for device in 0..play.clocks.len() {
            while play.advance(device) {
                moved = true;
            }
        }
    }
    play.conclude()
}

/// A task that has been played.
#[derive(Clone, Copy)]
struct Played {
    begin_ms: f64,
    end_ms: f64,
    /// The task whose end let this one begin, as device and position; none: the frame's begin.
    cause: Option<(usize, usize)>,
}

/// When something is free again, and which task makes it wait until then.
#[derive(Clone, Copy)]
struct Free {
    at_ms: f64,
    cause: Option<(usize, usize)>,
}

impl Free {
    fn or_later(self, other: Self) -> Self {
        if other.at_ms > self.at_ms { other } else { self }
    }
}

struct Clock {
    queue: Free,
    host: Free,
    /// Last upload, before which nothing later is submitted.
    gate: Free,
    played: Vec<Played>,
}

struct Play<'a> {
    graph: &'a FrameGraph,
    model: &'a CostModel,
    clocks: Vec<Clock>,
    /// By number of transfer: when its rows have left.
    sent: Vec<Option<Free>>,
    busy_ms: Vec<f64>,
    transfer_ms: f64,
}

impl<'a> Play<'a> {
    fn new(graph: &'a FrameGraph, model: &'a CostModel) -> Self {
        let clock = |device| {
            let begin = Free { at_ms: model.lead_ms(device), cause: None };
            Clock { queue: begin, host: begin, gate: begin, played: Vec::new() }
        };
        let devices = model.spec().devices;
        let clocks = (0..devices).map(clock).collect();
        Self { graph, model, clocks, sent: Vec::new(), busy_ms: vec![0.0; devices], transfer_ms: 0.0 }
    }

    /// Plays the device's next task, if there is one that can begin.
    fn advance(&mut self, device: usize) -> bool {
        let position = self.clocks[device].played.len();
        let Some(task) = self.graph.tasks_of(device).get(position) else { return false };
        let Clock { queue, host, gate, .. } = self.clocks[device];
        let from = match &task.kind {
            TaskKind::Dispatch { .. } => queue.or_later(gate),
            TaskKind::Download { .. } | TaskKind::Stitch => queue.or_later(host),
            TaskKind::Upload { transfer, .. } => match self.sent.get(*transfer as usize).copied().flatten() {
                Some(sent) => sent.or_later(host),
                None => return false,
            },
        };
        let ms = self.task_ms(device, task);
        let gap_ms = if matches!(task.kind, TaskKind::Dispatch { .. }) { self.model.gap_ms(device) } else { 0.0 };
        let end_ms = from.at_ms + gap_ms + ms;
        let end = Free { at_ms: end_ms, cause: Some((device, position)) };
        let clock = &mut self.clocks[device];
        clock.played.push(Played { begin_ms: from.at_ms, end_ms, cause: from.cause });
        match task.kind {
            TaskKind::Dispatch { .. } => {
                clock.queue = end;
                self.busy_ms[device] += ms;
            }
            TaskKind::Download { transfer, .. } => {
                clock.host = end;
                self.transfer_ms += ms;
                let sent = transfer as usize;
                self.sent.resize(self.sent.len().max(sent + 1), None);
                self.sent[sent] = Some(end);
            }
            TaskKind::Upload { .. } => {
                clock.host = end;
                clock.gate = end;
                self.transfer_ms += ms;
            }
            TaskKind::Stitch => {}
        }
        true
    }

    fn task_ms(&self, device: usize, task: &Task) -> f64 {
        match &task.kind {
            TaskKind::Dispatch { stage, .. } => self.model.stage_ms(*stage, task.view, device, &task.rows),
            TaskKind::Download { resource, .. } | TaskKind::Upload { resource, .. } => {
                let image = resource.physical();
                let rows = u64::from(task.rows.end - task.rows.start);
                let bytes = image.row_bytes(self.model.spec().extent.width) * rows;
                match task.kind {
                    TaskKind::Download { .. } => self.model.download_ms(device, bytes),
                    _ => self.model.upload_ms(device, bytes),
                }
            }
            TaskKind::Stitch => 0.0,
        }
    }

    fn conclude(self) -> Result<Prediction, Stuck> {
        for (device, clock) in self.clocks.iter().enumerate() {
            if let Some(Task { kind: TaskKind::Upload { transfer, .. }, .. }) =
                self.graph.tasks_of(device).get(clock.played.len())
            {
                return Err(Stuck { device, transfer: *transfer });
            }
        }
        let primary = self.graph.primary;
        let stitch = self.clocks[primary].played.len().checked_sub(1).map(|last| (primary, last));
        let critical_path = self.path_to(stitch);
        let end_ms = stitch.map_or(0.0, |(device, last)| self.clocks[device].played[last].end_ms);
        let makespan_ms = end_ms + self.model.tail_ms();
        let limit = self.limit(makespan_ms, &critical_path);
        Ok(Prediction { makespan_ms, busy_ms: self.busy_ms, transfer_ms: self.transfer_ms, critical_path, limit })
    }

    fn path_to(&self, mut at: Option<(usize, usize)>) -> Vec<Step> {
        let mut path = Vec::new();
        while let Some((device, position)) = at {
            let task = &self.graph.tasks_of(device)[position];
            let Played { begin_ms, end_ms, cause } = self.clocks[device].played[position];
            let kind = match task.kind {
                TaskKind::Dispatch { stage, .. } => StepKind::Stage(stage),
                TaskKind::Download { .. } => StepKind::Download,
                TaskKind::Upload { .. } => StepKind::Upload,
                TaskKind::Stitch => StepKind::Stitch,
            };
            path.push(Step { kind, view: task.view, device, begin_ms, end_ms });
            at = cause;
        }
        path.reverse();
        path
    }

    /// The largest loss. Steps of the critical path and overhead add up to the makespan, so losses do to what it is
    /// above an even share of the work.
    fn limit(&self, makespan_ms: f64, path: &[Step]) -> Limit {
        let mean_busy_ms = self.busy_ms.iter().sum::<f64>() / self.busy_ms.len() as f64;
        let (mut stages_ms, mut transfers_ms) = (0.0, 0.0);
        for step in path {
            match step.kind {
                StepKind::Stage(_) => stages_ms += step.end_ms - step.begin_ms - self.model.gap_ms(step.device),
                _ => transfers_ms += step.end_ms - step.begin_ms,
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

    /// Time of all devices in rows that another device computes as well.
    fn margins_ms(&self) -> f64 {
        let height = f64::from(self.model.spec().extent.height);
        let mut passes: Vec<(f64, f64)> = Vec::new();
        for (device, clock) in self.clocks.iter().enumerate() {
            for (task, played) in self.graph.tasks_of(device).iter().zip(&clock.played) {
                let TaskKind::Dispatch { .. } = task.kind else { continue };
                let pass = task.key.pass as usize;
                passes.resize(passes.len().max(pass + 1), (0.0, 0.0));
                passes[pass].0 += f64::from(task.rows.end - task.rows.start);
                passes[pass].1 += played.end_ms - played.begin_ms;
            }
        }
        passes.iter().map(|(rows, ms)| ms * (1.0 - height / rows.max(height))).sum()
    }
}
