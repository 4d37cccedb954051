//! Planning of a frame: the assignment of rows to devices, and the graph that follows from the plan.

use std::ops::RangeInclusive;
use std::sync::{Arc, Mutex, PoisonError};

use super::inputs::Inputs;
use super::output::Output;
use super::plan::{History, Plan};
use crate::frame::RunConfig;
use crate::graph::{Assignment, FrameGraph, Program, ProgramError, Resource, Seam};
use crate::passes::{Declarations, FrameSpec, LATE_PARTITION, ROW_TALLY};
use crate::quality::Denoiser;
use crate::schedule::{CostModel, Policy, RelativeCost, choose_halo};

/// Number of cached graphs in addition to those of the frames in flight: one for each number of denoiser iterations
/// that predictions may use.
const OTHER_GRAPHS: usize = Denoiser::MAX_ITERATIONS as usize + 1;
/// Number of cached programs. Frames of a run need several, since the number of denoiser iterations, the halo plan and
/// the search range of history vary.
const PROGRAMS: usize = 32;

/// The programs of a run's frames, and the graphs of their plans. The renderer and the workers of a process share the
/// latest of both, so each is built once.
pub struct Graphs {
    /// Spec of the run's frames. [`Self::spec()`] replaces the fields that depend on the plan.
    spec: FrameSpec,
    /// Numbers of denoiser iterations that frames may have.
    iterations: RangeInclusive<u32>,
    declarations: Declarations,
    programs: Mutex<Latest<FrameSpec, Arc<Program>>>,
    graphs: Mutex<Latest<Plan, Arc<FrameGraph>>>,
}

impl Graphs {
    /// Creates the programs and graphs of frames of this spec with these numbers of denoiser iterations. Up to `capacity`
    /// graphs are kept, which must be at least the number of frames in flight.
    ///
    /// # Errors
    /// [`ProgramError`] if the declared passes of some frame contradict one another.
    pub fn new(
        spec: FrameSpec,
        iterations: RangeInclusive<u32>,
        declarations: Declarations,
        capacity: usize,
    ) -> Result<Self, ProgramError> {
        declarations.programs(&spec, iterations.clone())?;
        let (programs, graphs) = (Latest::new(PROGRAMS).into(), Latest::new(capacity).into());
        Ok(Self { spec, iterations, declarations, programs, graphs })
    }

    /// Creates the graphs of a run on `devices` devices. `has_surfaces` is true if anything in the scene reflects light.
    ///
    /// # Errors
    /// Errors of [`Self::new`].
    pub fn of_config(config: &RunConfig, devices: usize, has_surfaces: bool) -> Result<Self, ProgramError> {
        let capacity = config.execution.frames_in_flight + OTHER_GRAPHS;
        let (spec, iterations) = (config.spec(devices, has_surfaces), config.envelope.iterations());
        Self::new(spec, iterations, config.buffers.declarations.clone(), capacity)
    }

    /// Returns programs that together contain every pass that any frame may need.
    pub fn programs(&self) -> Vec<Program> {
        self.declarations.programs(&self.spec, self.iterations.clone()).unwrap_or_default()
    }

    /// Returns the spec of a frame of this plan.
    pub fn spec(&self, plan: &Plan) -> FrameSpec {
        let history_rows = plan.history.as_ref().map(|history| history.rows);
        FrameSpec { history_rows, ..self.planned_spec(plan.seam, plan.iterations) }
    }

    /// Returns the spec of frames that are being planned: the search range of history is not known yet.
    fn planned_spec(&self, seam: Seam, iterations: u32) -> FrameSpec {
        FrameSpec { seam, iterations, ..self.spec.clone() }
    }

    /// Returns the program of frames that are being planned.
    pub fn planned_program(&self, seam: Seam, iterations: u32) -> Arc<Program> {
        self.program(self.planned_spec(seam, iterations))
    }

    fn program(&self, spec: FrameSpec) -> Arc<Program> {
        let mut programs = self.programs.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(programs.get(&spec, || self.declarations.program(&spec)))
    }

    /// Returns the graph of a plan.
    pub fn of(&self, plan: &Plan) -> Arc<FrameGraph> {
        let mut graphs = self.graphs.lock().unwrap_or_else(PoisonError::into_inner);
        let graph = graphs.get(plan, || {
            let program = self.program(self.spec(plan));
            let before = plan.history.as_ref().map(|history| (&history.before, &history.lost[..]));
            let is_read = |image: &Resource| {
                let is_listed = |outputs: &Vec<Output>| outputs.contains(&Output::from(*image));
                *image == ROW_TALLY || plan.outputs.as_ref().is_none_or(is_listed)
            };
            Arc::new(FrameGraph::build_for(&program, &plan.assignment, before, is_read))
        });
        Arc::clone(graph)
    }
}

/// The values that were used last, with their keys.
struct Latest<K, V> {
    /// The most recently used value is last.
    values: Vec<(K, V)>,
    capacity: usize,
}

impl<K: Clone + PartialEq, V> Latest<K, V> {
    fn new(capacity: usize) -> Self {
        Self { values: Vec::new(), capacity: capacity.max(1) }
    }

    /// Returns the value of a key, which `make` creates unless it is among the latest.
    fn get(&mut self, key: &K, make: impl FnOnce() -> V) -> &V {
        match self.values.iter().position(|(known, _)| known == key) {
            Some(place) => self.values[place..].rotate_left(1),
            None => {
                let value = make();
                if self.values.len() == self.capacity {
                    self.values.remove(0);
                }
                self.values.push((key.clone(), value));
            }
        }
        &self.values[self.values.len() - 1].1
    }
}

/// Plans frames with the cost model.
pub struct Planner {
    policy: Box<dyn Policy>,
    seam: Seam,
    /// True if the halo plan adapts to its measured cost.
    adapts_halo: bool,
    /// Number of devices at the start.
    devices: usize,
    graphs: Arc<Graphs>,
    /// Assignment of the next frame, if it was already needed for a prediction.
    ahead: Option<Assignment>,
}

impl Planner {
    pub fn new(policy: Box<dyn Policy>, config: &RunConfig, devices: usize, graphs: Arc<Graphs>) -> Self {
        Self {
            policy,
            seam: config.execution.seam,
            adapts_halo: config.execution.adapts_halo,
            devices,
            graphs,
            ahead: None,
        }
    }

    pub fn policy_name(&self) -> &'static str {
        self.policy.name()
    }

    /// Removes the device with this index among the remaining ones.
    pub fn remove_device(&mut self, place: usize) {
        self.policy.remove_device(place);
        self.ahead = None;
    }

    /// Returns the spec of a frame of this plan.
    pub fn spec(&self, plan: &Plan) -> FrameSpec {
        self.graphs.spec(plan)
    }

    /// Returns the rows of each device in the next frame on the devices in `left`. The policy decides once per frame, at
    /// the quality of the frame before if a prediction comes first.
    fn take_assignment(&mut self, costs: &CostModel, left: &[usize]) -> Assignment {
        let assign = || self.policy.assign(&costs.of_devices(left)).renumbered(left, self.devices);
        self.ahead.take().unwrap_or_else(assign)
    }

    /// Discards the assignment of the next frame, if a prediction already needed it.
    pub fn assign_anew(&mut self) {
        self.ahead = None;
    }

    /// Returns the graph of the next frame if it runs this many filter iterations. `last` is the plan of the last frame.
    pub fn next_graph(&mut self, costs: &CostModel, left: &[usize], iterations: u32, last: &Plan) -> Arc<FrameGraph> {
        let before = last.assignment.clone();
        let history = last.history.as_ref().map(|history| History { before, ..history.clone() });
        let assignment = self.take_assignment(costs, left);
        self.ahead = Some(assignment.clone());
        self.graphs.of(&Plan { seam: self.seam, iterations, assignment, history, outputs: last.outputs.clone() })
    }

    /// Plans the next frame on the devices in `left`.
    pub fn plan(
        &mut self,
        costs: &mut CostModel,
        inputs: &Inputs,
        left: &[usize],
        history: Option<History>,
    ) -> (Plan, Arc<FrameGraph>) {
        let iterations = inputs.quality.most_iterations();
        self.cost_frame(costs, iterations, &inputs.relative_cost);
        if let Seam::Halo(now) = self.seam
            && self.adapts_halo
        {
            let next = choose_halo(&costs.of_devices(left), now);
            if next != now {
                self.seam = Seam::Halo(next);
                self.cost_frame(costs, iterations, &inputs.relative_cost);
            }
        }
        let mut assignment = self.take_assignment(costs, left);
        if inputs.late.is_some() {
            // Only the primary asks for the pose, so it executes all passes of late reprojection.
            assignment.gather(LATE_PARTITION);
        }
        let outputs = inputs.outputs.as_ref().map(|outputs| outputs.to_vec());
        let plan = Plan { seam: self.seam, iterations, assignment, history, outputs };
        let graph = self.graphs.of(&plan);
        (plan, graph)
    }

    /// Makes `costs` those of the frame to plan.
    fn cost_frame(&self, costs: &mut CostModel, iterations: u32, relative_cost: &RelativeCost) {
        costs.plan_for(&self.graphs.planned_program(self.seam, iterations), relative_cost);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Assignment, Stripes};
    use crate::image::Extent;

    fn graphs(capacity: usize) -> Graphs {
        let frame = FrameSpec::new(Extent::new(16, 12), 2);
        let spec = FrameSpec { filter: Some(Denoiser::ATROUS), iterations: 3, seam: Seam::None, ..frame };
        Graphs::new(spec, 1..=3, Declarations::default(), capacity).unwrap()
    }

    fn plan(edge: u32, iterations: u32) -> Plan {
        let assignment = Assignment::uniform(Stripes::from_edges(12, &[edge]));
        Plan { seam: Seam::Filter, iterations, assignment, history: None, outputs: None }
    }

    #[test]
    fn graph_is_cached_for_the_latest_plans() {
        let graphs = graphs(2);
        let first = graphs.of(&plan(4, 3));
        graphs.of(&plan(5, 3));
        assert!(Arc::ptr_eq(&first, &graphs.of(&plan(4, 3))));
        graphs.of(&plan(6, 3));
        assert!(Arc::ptr_eq(&first, &graphs.of(&plan(4, 3))));
        graphs.of(&plan(7, 3));
        graphs.of(&plan(8, 3));
        assert!(!Arc::ptr_eq(&first, &graphs.of(&plan(4, 3))));
    }

    #[test]
    fn frame_spec_follows_from_its_plan() {
        let graphs = graphs(1);
        let history = Some(History { before: plan(4, 3).assignment, rows: 8, lost: Vec::new() });
        let spec = graphs.spec(&Plan { history, ..plan(4, 2) });
        assert_eq!((spec.seam, spec.iterations, spec.history_rows), (Seam::Filter, 2, Some(8)));
        assert_eq!(FrameSpec { seam: Seam::None, iterations: 3, history_rows: None, ..spec }, graphs.spec);
    }
}
