//! Measures the host time of planning a frame, without a device: learn, choose the halo plan, assign and predict.
//!
//! `cargo bench --bench schedule`
//!
//! Costs change a little from frame to frame, so that stripes move now and then. Like in the renderer, the graph is
//! rebuilt only if they or the halo plan have changed. That is timed separately.

use std::sync::Arc;
use std::time::Instant;

use diptych::graph::{Assignment, FrameGraph, HaloPlan, Seam, TaskKind};
use diptych::image::Extent;
use diptych::passes::{Declarations, FrameSpec};
use diptych::quality::Denoiser;
use diptych::schedule::{
    CostModel, FrameCosts, Measured, Policy, RelativeCost, StageCost, TransferCost, choose_halo, simulate,
};

const FRAMES: usize = 2000;
const DEVICES: usize = 8;
const EXTENT: Extent = Extent::new(1280, 720);
const ITERATIONS: u32 = 5;

/// Returns the costs of a graph for a picture whose upper half is sky, on devices of equal speed.
fn costs(spec: &FrameSpec, graph: &FrameGraph, frame: usize) -> FrameCosts {
    let Extent { width, height } = spec.extent;
    let rays = |per_pixel: u32| (0..height).map(|y| width * (1 + per_pixel * (y / (height / 2).max(1)))).collect();
    let mut costs = FrameCosts { rays: vec![rays(8), rays(1)], tail_ms: 0.1, ..Default::default() };
    for device in 0..spec.devices {
        costs.lead_ms.push((device, 0.3));
        // Each device in turn is slower.
        let slowness = if frame % spec.devices == device { 1.03 } else { 1.0 };
        for task in graph.tasks_of(device) {
            let (view, rows) = (task.view, task.rows.clone());
            match task.kind {
                TaskKind::Dispatch { pass, .. } => {
                    let stage = graph.program.passes()[pass].pass.stage;
                    let busy_ms = 0.01 * rows.len() as f64 * slowness;
                    costs.stages.push(StageCost { stage, view, device, rows, busy_ms });
                }
                TaskKind::Download { .. } | TaskKind::Upload { .. } => {
                    let is_upload = matches!(task.kind, TaskKind::Upload { .. });
                    let bytes = 16 * u64::from(width) * rows.len() as u64;
                    costs.transfers.push(TransferCost { device, is_upload, bytes, ms: 0.02 + 1e-6 * bytes as f64 });
                }
                TaskKind::Stitch => {}
            }
        }
    }
    costs
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn main() {
    let frame = FrameSpec::new(EXTENT, DEVICES);
    let spec = FrameSpec { filter: Some(Denoiser::ATROUS), iterations: ITERATIONS, ..frame };
    let mut policy = Measured::new(EXTENT.height, DEVICES);
    let declarations = Declarations::default();
    let mut model = CostModel::new(&declarations.program(&spec), DEVICES);
    let mut halo = HaloPlan::RECOMPUTE;
    let mut planned: Option<(Assignment, Arc<FrameGraph>)> = None;
    let [mut learn, mut choose, mut assign, mut predict, mut plan, mut build] = [const { Vec::new() }; 6];
    let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
    for frame in 0..FRAMES {
        let begin = Instant::now();
        let next = choose_halo(&model, halo);
        if next != halo {
            halo = next;
            let program = declarations.program(&FrameSpec { seam: Seam::Halo(halo), ..spec.clone() });
            model.plan_for(&program, &RelativeCost::default());
            planned = None;
        }
        let choose_ms = ms(begin);
        let begin = Instant::now();
        let assignment = policy.assign(&model);
        let assign_ms = ms(begin);
        let begin = Instant::now();
        let graph = match planned.take() {
            Some((old, graph)) if old == assignment => graph,
            _ => {
                let graph = Arc::new(FrameGraph::build(model.program(), &assignment, None));
                build.push(ms(begin));
                graph
            }
        };
        planned = Some((assignment, Arc::clone(&graph)));
        let begin = Instant::now();
        std::hint::black_box(simulate(&graph, &model));
        let predict_ms = ms(begin);
        let costs = costs(&spec, &graph, frame);
        let begin = Instant::now();
        model.learn(&costs);
        let learn_ms = ms(begin);
        learn.push(learn_ms);
        choose.push(choose_ms);
        assign.push(assign_ms);
        predict.push(predict_ms);
        plan.push(choose_ms + assign_ms + predict_ms + learn_ms);
    }
    println!(
        "{:.4} ms per frame, median of {FRAMES}, {DEVICES} devices, {EXTENT}: halo plan {:.4}, assign {:.4}, predict {:.4}, learn {:.4}; graph {:.4}, built {} times",
        median(&mut plan),
        median(&mut choose),
        median(&mut assign),
        median(&mut predict),
        median(&mut learn),
        median(&mut build),
        build.len()
    );
}
