//! The plan of a frame: who has which rows, and the graph that follows.

use std::sync::{Arc, Mutex, PoisonError};

use super::RenderSettings;
use super::frames::Inputs;
use crate::graph::{Assignment, FrameGraph, Program, ProgramError, Seam};
use crate::passes::{Declarations, FrameSpec};
use crate::schedule::{CostModel, Policy, choose_halo};

/// What distinguishes the graphs of a run from one another.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    pub seam: Seam,
    pub iterations: u32,
    pub assignment: Assignment,
    /// Who had which rows in the frame before, and how many rows its surfaces may have moved.
    pub history: Option<(Assignment, u32)>,
}

/// The graphs of the latest plans. The renderer and the workers of a process share them, so that each is built once.
pub struct Graphs {
    /// What the frames of the run have in common.
    spec: FrameSpec,
    declarations: Declarations,
    /// Newest last.
    built: Mutex<Vec<(Plan, Arc<FrameGraph>)>>,
    capacity: usize,
}

impl Graphs {
    /// `capacity` is the number of graphs that are kept, at least as many as there are frames in flight.
    ///
    /// # Errors
    /// [`ProgramError`] where the declared passes of some frame contradict one another.
    pub fn new(spec: FrameSpec, declarations: Declarations, capacity: usize) -> Result<Self, ProgramError> {
        declarations.programs(&spec)?;
        Ok(Self { spec, declarations, built: Mutex::default(), capacity })
    }

    /// Programs that have every pass that some frame may need.
    pub fn programs(&self) -> Vec<Program> {
        self.declarations.programs(&self.spec).unwrap_or_default()
    }

    /// What a frame of this plan must do.
    pub fn spec(&self, plan: &Plan) -> FrameSpec {
        let history_rows = plan.history.as_ref().map(|(_, rows)| *rows);
        FrameSpec { seam: plan.seam, iterations: plan.iterations, history_rows, ..self.spec.clone() }
    }

    /// The graph of a plan, built if it is none of the latest.
    pub fn of(&self, plan: &Plan) -> Arc<FrameGraph> {
        let mut built = self.built.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, graph)) = built.iter().rev().find(|(old, _)| old == plan) {
            return Arc::clone(graph);
        }
        let before = plan.history.as_ref().map(|(before, _)| before);
        let spec = self.spec(plan);
        let is_same = |(old, _): &&(Plan, _)| self.spec(old) == spec;
        let program = built.iter().rev().find(is_same).map(|(_, graph)| Arc::clone(&graph.program));
        let program = program.unwrap_or_else(|| self.declarations.program(&spec));
        let graph = Arc::new(FrameGraph::build(&program, &plan.assignment, before));
        if built.len() == self.capacity {
            built.remove(0);
        }
        built.push((plan.clone(), Arc::clone(&graph)));
        graph
    }
}

/// Plans frames by what the cost model has learned.
pub struct Planner {
    policy: Box<dyn Policy>,
    seam: Seam,
    /// Whether the halo plan follows what it costs.
    adapts_halo: bool,
    /// How many devices there were at the start.
    devices: usize,
    graphs: Arc<Graphs>,
}

impl Planner {
    pub fn new(policy: Box<dyn Policy>, settings: &RenderSettings, devices: usize, graphs: Arc<Graphs>) -> Self {
        Self { policy, seam: settings.seam, adapts_halo: settings.adapts_halo, devices, graphs }
    }

    pub fn policy_name(&self) -> &'static str {
        self.policy.name()
    }

    /// The device at this place among those that are left is out.
    pub fn remove_device(&mut self, place: usize) {
        self.policy.remove_device(place);
    }

    /// What a frame of this plan must do.
    pub fn spec(&self, plan: &Plan) -> FrameSpec {
        self.graphs.spec(plan)
    }

    /// Plans the next frame on the devices that are `left`. `history` has who had which rows in the frame before, and
    /// how many rows its surfaces may have moved.
    pub fn plan(
        &mut self,
        costs: &mut CostModel,
        inputs: &Inputs,
        left: &[usize],
        history: Option<(Assignment, u32)>,
    ) -> (Plan, Arc<FrameGraph>) {
        let iterations = inputs.quality.most_iterations();
        costs.set_quality(iterations, &inputs.effort);
        self.plan_halo(costs, left);
        let assignment = self.policy.assign(&costs.of_devices(left)).renumbered(left, self.devices);
        let plan = Plan { seam: self.seam, iterations, assignment, history };
        let graph = self.graphs.of(&plan);
        (plan, graph)
    }

    fn plan_halo(&mut self, costs: &mut CostModel, left: &[usize]) {
        let Seam::Halo(now) = self.seam else { return };
        if self.adapts_halo {
            let next = Seam::Halo(choose_halo(&costs.of_devices(left), now));
            if next != self.seam {
                self.seam = next;
                costs.set_seam(next);
            }
        }
    }
}
