//! Checks invariants of all policies, and that predictions are right in a world that follows the model.

mod predictions;

use proptest::prelude::*;

use super::balance::step_rows;
use super::*;
use crate::graph::{Assignment, FrameGraph, HaloPlan, Partition, Pass, Seam, Stripes, TaskKind};
use crate::image::Extent;
use crate::passes::graph_tests::{check_order, graph, replay};
use crate::passes::path_trace::PARTITION;
use crate::passes::{Declarations, FrameSpec, denoise, partitions};
use crate::quality::Denoiser;
use crate::scene::rig::Eye;

const WIDTH: u32 = 64;

fn spec(height: u32, devices: usize, iterations: u32, seam: Seam) -> FrameSpec {
    let frame = FrameSpec::new(Extent::new(WIDTH, height), devices);
    FrameSpec { filter: Some(Denoiser::ATROUS), iterations, seam, ..frame }
}

/// Returns a model that has learned nothing yet.
fn model(spec: &FrameSpec) -> CostModel {
    CostModel::new(&Declarations::default().program(spec), spec.devices)
}

/// A scene and devices whose true costs are known.
#[derive(Debug)]
struct World {
    spec: FrameSpec,
    rays: [Vec<u32>; 2],
    /// Cost of a pixel besides its rays, in rays.
    idle_rays: f64,
    /// Time per ray of each row. Rays cost more where they scatter.
    ms_per_ray: Vec<f64>,
    speeds: Vec<f64>,
}

const LATENCY_MS: f64 = 0.02;
const MS_PER_BYTE: f64 = 1e-6;
const LEAD_MS: f64 = 0.3;
const TAIL_MS: f64 = 0.1;
const GAP_MS: f64 = 0.01;

impl World {
    /// Returns sky over a city that takes ever more rays towards the bottom.
    fn sky_over_city(spec: FrameSpec, speeds: &[f64]) -> Self {
        let height = spec.extent.height;
        let rays = |per_pixel: u32| {
            let row =
                move |y| if y < height * 3 / 5 { WIDTH } else { WIDTH * (1 + per_pixel + y * per_pixel / height) };
            (0..height).map(row).collect::<Vec<u32>>()
        };
        let ms_per_ray = (0..height).map(|y| if y < height * 4 / 5 { 2e-4 } else { 3e-4 }).collect();
        Self { spec, rays: [rays(8), rays(2)], idle_rays: 1.0 / 32.0, ms_per_ray, speeds: speeds.to_vec() }
    }

    fn pass_ms(&self, pass: &Pass, device: usize, rows: &std::ops::Range<u32>) -> f64 {
        let ms: f64 = match pass.stage.name() {
            "path_trace" | "hole_fill" => {
                let row_ms = |y: u32| {
                    let paths = f64::from(self.rays[pass.view.index()][y as usize] - WIDTH);
                    (paths + f64::from(WIDTH) * self.idle_rays) * self.ms_per_ray[y as usize]
                };
                rows.clone().map(row_ms).sum()
            }
            "gbuffer" => 0.01 * rows.len() as f64,
            "atrous" => 0.02 * rows.len() as f64,
            _ => 0.002 * rows.len() as f64,
        };
        ms / self.speeds[device]
    }

    /// Returns the costs of a frame of this graph on these devices.
    fn costs(&self, graph: &FrameGraph) -> FrameCosts {
        let mut costs = FrameCosts { rays: self.rays.to_vec(), tail_ms: TAIL_MS, ..Default::default() };
        for device in 0..self.spec.devices {
            costs.lead_ms.push((device, LEAD_MS));
            costs.gap_ms.push((device, GAP_MS));
            for task in graph.tasks_of(device) {
                let rows = task.rows.clone();
                match task.kind {
                    TaskKind::Dispatch { pass, .. } => {
                        let pass = &graph.program.passes()[pass].pass;
                        let busy_ms = self.pass_ms(pass, device, &rows);
                        costs.stages.push(StageCost { stage: pass.stage, view: task.view, device, rows, busy_ms });
                    }
                    TaskKind::Download { .. } | TaskKind::Upload { .. } => {
                        let bytes = graph.program.bytes(task);
                        let is_upload = matches!(task.kind, TaskKind::Upload { .. });
                        let ms = LATENCY_MS + MS_PER_BYTE * bytes as f64;
                        costs.transfers.push(TransferCost { device, is_upload, bytes, ms });
                    }
                    TaskKind::Stitch => {}
                }
            }
        }
        costs
    }

    /// Returns the largest of the devices' busy times over their mean.
    fn imbalance(&self, graph: &FrameGraph) -> f64 {
        let mut busy = vec![0.0; self.spec.devices];
        self.costs(graph).stages.iter().for_each(|c| busy[c.device] += c.busy_ms);
        busy.iter().copied().fold(0.0, f64::max) * busy.len() as f64 / busy.iter().sum::<f64>()
    }

    /// Renders frames, learning from each; returns the assignments and the model.
    fn play(&self, policy: &mut dyn Policy, frames: usize) -> (Vec<Assignment>, CostModel) {
        let mut model = model(&self.spec);
        let mut assignments = Vec::new();
        for _ in 0..frames {
            let assignment = policy.assign(&model);
            model.learn(&self.costs(&graph(&self.spec, &assignment, None)));
            assignments.push(assignment);
        }
        (assignments, model)
    }
}

fn all_policies(height: u32, devices: usize) -> Vec<Box<dyn Policy>> {
    let rules = [RatioRule { group: None, view: None, ratios: (1..=devices).map(|i| i as f64).collect() }];
    vec![
        Box::new(Even::new(height, devices)),
        Box::new(Static::new(height, devices, &rules).unwrap()),
        Box::new(Measured::new(height, devices)),
    ]
}

fn seams() -> impl Strategy<Value = Seam> {
    let halos = HaloPlan::all(5).map(Seam::Halo);
    proptest::sample::select([Seam::None, Seam::Filter].into_iter().chain(halos).collect::<Vec<_>>())
}

prop_compose! {
    fn worlds()(
        devices in 1..=6usize,
        height in 20..=240u32,
        iterations in 0..=5u32,
        seam in seams(),
    )(
        left in proptest::collection::vec(0..40u32, height as usize),
        right in proptest::collection::vec(0..4u32, height as usize),
        speeds in proptest::collection::vec(0.25..4.0f64, devices),
        spec in Just(spec(height, devices, iterations, seam)),
    ) -> World {
        let rays = [left, right].map(|rows| rows.iter().map(|per_pixel| WIDTH * (1 + per_pixel)).collect());
        World { ms_per_ray: vec![2e-4; spec.extent.height as usize], spec, rays, idle_rays: 1.0 / 32.0, speeds }
    }
}

fn edges(assignment: &Assignment, group: Partition, view: Eye) -> &[u32] {
    assignment.stripes(group, view).inner_edges()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn every_policy_gives_sound_frames(world in worlds()) {
        let FrameSpec { devices, extent, .. } = world.spec;
        let twins = all_policies(extent.height, devices).into_iter().zip(all_policies(extent.height, devices));
        for (mut policy, mut twin) in twins {
            let (assignments, model) = world.play(policy.as_mut(), 5);
            prop_assert_eq!(&assignments, &world.play(twin.as_mut(), 5).0, "{} is not deterministic", policy.name());
            for (frame, assignment) in assignments.iter().enumerate() {
                for (group, view) in partitions().into_iter().flat_map(|g| Eye::BOTH.map(|v| (g, v))) {
                    let stripes = assignment.stripes(group, view);
                    prop_assert_eq!((stripes.devices(), stripes.height()), (devices, extent.height));
                    let rows: Vec<u32> = (0..devices).flat_map(|d| stripes.rows(d)).collect();
                    prop_assert!(rows.into_iter().eq(extent.rows()), "{}: rows of {group:?}", policy.name());
                    let before = edges(&assignments[frame.saturating_sub(1)], group, view);
                    for (old, new) in before.iter().zip(stripes.inner_edges()) {
                        prop_assert!(old.abs_diff(*new) <= step_rows(extent.height), "{}: {old} to {new}", policy.name());
                    }
                }
            }
            let graph = graph(&world.spec, &assignments[4], None);
            check_order(&graph);
            replay(&graph, None);
            let played = simulate(&graph, &model);
            prop_assert!(played.makespan_ms.is_finite(), "{}: {played:?}", policy.name());
            prop_assert_eq!(played, simulate(&graph, &model));
        }
    }
}

#[test]
fn measured_rows_even_out_scenes_and_devices() {
    const HEIGHT: u32 = 720;
    let halo = Seam::Halo(HaloPlan::RECOMPUTE);
    for speeds in [&[1.0, 1.0][..], &[1.0, 2.0], &[3.0, 1.0], &[1.0; 4], &[1.0, 2.0, 3.0, 2.0], &[1.0; 8]] {
        for iterations in [0, 5] {
            let world = World::sky_over_city(spec(HEIGHT, speeds.len(), iterations, halo), speeds);
            let (assignments, _) = world.play(&mut Measured::new(HEIGHT, speeds.len()), 9);
            let imbalance = world.imbalance(&graph(&world.spec, &assignments[8], None));
            assert!(imbalance <= 1.05, "{speeds:?}, {iterations} iterations: {imbalance}");
        }
    }
}

#[test]
fn stripes_of_measured_rows_converge() {
    let world = World::sky_over_city(spec(360, 4, 5, Seam::Halo(HaloPlan::RECOMPUTE)), &[1.0, 1.0, 2.0, 1.0]);
    let (assignments, _) = world.play(&mut Measured::new(360, 4), 30);
    assert!(assignments[20..].iter().all(|a| *a == assignments[20]));
}

#[test]
fn critical_path_spans_the_makespan_without_gaps() {
    let world = World::sky_over_city(spec(180, 3, 5, Seam::Halo(HaloPlan::EXCHANGE)), &[1.0, 2.0, 1.0]);
    let (assignments, model) = world.play(&mut Even::new(180, 3), 3);
    let played = simulate(&graph(&world.spec, &assignments[2], None), &model);
    let path = &played.critical_path;
    assert_eq!(path[0].begin_ms, LEAD_MS);
    assert!(path.windows(2).all(|pair| pair[0].end_ms == pair[1].begin_ms), "{path:?}");
    assert!((path[path.len() - 1].end_ms + TAIL_MS - played.makespan_ms).abs() < 1e-9);
    assert_eq!(played.limit, Limit::Imbalance);
}

#[test]
fn frame_without_device_0_ends_on_device_1() {
    let world = World::sky_over_city(spec(180, 3, 5, Seam::Halo(HaloPlan::RECOMPUTE)), &[1.0, 2.0, 1.0]);
    let (_, model) = world.play(&mut Even::new(180, 3), 3);
    let two = model.of_devices(&[1, 2]);
    let assignment = Assignment::uniform(Stripes::even(180, 2));
    let expected = simulate(&graph(&FrameSpec { devices: 2, ..world.spec.clone() }, &assignment, None), &two);
    let graph = graph(&world.spec, &assignment.renumbered(&[1, 2], 3), None);
    let played = simulate(&graph, &model);
    assert!((played.makespan_ms - expected.makespan_ms).abs() < 1e-9, "{played:?} instead of {expected:?}");
    assert_eq!(played.critical_path.last().map(|step| step.device), Some(1));
}

#[test]
fn transfers_between_ranks_take_network_latency() {
    let world = World::sky_over_city(spec(180, 2, 5, Seam::Halo(HaloPlan::EXCHANGE)), &[1.0, 1.0]);
    let (assignments, mut model) = world.play(&mut Even::new(180, 2), 3);
    let graph = graph(&world.spec, &assignments[2], None);
    let near = simulate(&graph, &model);
    let mut on = |ranks: [usize; 2], latency_ms: f64| {
        model.network = Network { ranks: ranks.to_vec(), latency_ms, ms_per_byte: 0.0 };
        simulate(&graph, &model)
    };
    assert_eq!(on([0, 0], 1e4), near);
    let far = on([0, 1], 1e4);
    // The filter of each eye has five iterations. Before all but one of them, rows come from the other device.
    assert!(far.makespan_ms > near.makespan_ms + 3e4, "{} after {}", far.makespan_ms, near.makespan_ms);
    assert_eq!(far.limit, Limit::Transfers);
    assert!(far.critical_path.windows(2).all(|pair| pair[0].end_ms == pair[1].begin_ms), "{:?}", far.critical_path);
}

#[test]
fn expensive_transfers_limit_a_frame() {
    let world = World::sky_over_city(spec(180, 2, 5, Seam::Halo(HaloPlan::EXCHANGE)), &[1.0, 1.0]);
    let mut policy = Measured::new(180, 2);
    let mut model = model(&world.spec);
    for _ in 0..8 {
        let mut costs = world.costs(&graph(&world.spec, &policy.assign(&model), None));
        costs.transfers.iter_mut().for_each(|t| t.ms *= 200.0);
        model.learn(&costs);
    }
    let played = simulate(&graph(&world.spec, &policy.assign(&model), None), &model);
    assert_eq!(played.limit, Limit::Transfers);
}

/// Checks that the model of a pair of devices predicts other devices in the same world.
#[test]
fn simulated_devices_take_as_long_as_real_ones() {
    let halo = Seam::Halo(HaloPlan::RECOMPUTE);
    let uniform = |spec| World { ms_per_ray: vec![2e-4; 360], ..World::sky_over_city(spec, &[1.0; 5]) };
    let (_, measured) = uniform(spec(360, 2, 5, halo)).play(&mut Measured::new(360, 2), 6);
    for speeds in [&[1.0][..], &[1.0, 1.0], &[1.0, 2.0], &[1.0, 1.0, 2.0, 0.5]] {
        let world = World { speeds: speeds.to_vec(), ..uniform(spec(360, speeds.len(), 5, halo)) };
        let (assignments, own) = world.play(&mut Measured::new(360, speeds.len()), 12);
        let graph = graph(&world.spec, &assignments[11], None);
        let expected = simulate(&graph, &own).makespan_ms;
        let predicted = simulate(&graph, &measured.on_devices(&graph.program, speeds)).makespan_ms;
        assert!((predicted / expected - 1.0).abs() < 0.01, "{speeds:?}: {predicted} for {expected}");
    }
}

#[test]
fn cost_model_predicts_unseen_stripes() {
    let speeds = [1.0, 2.0, 0.5];
    let world = World::sky_over_city(spec(360, 3, 5, Seam::None), &speeds);
    let world = World { ms_per_ray: vec![2e-4; 360], ..world };
    let (_, model) = world.play(&mut Measured::new(360, 3), 12);
    for pass in model.program().passes().iter().map(|p| &p.pass).filter(|p| p.stage.name() != "hole_fill") {
        for (device, rows) in (0..3).flat_map(|device| [0..90, 100..260, 300..360].map(|rows| (device, rows))) {
            let [expected, told] = [world.pass_ms(pass, device, &rows), model.pass_ms(pass, device, &rows)];
            assert!((told / expected - 1.0).abs() < 0.02, "{}, {rows:?}: {told} for {expected}", pass.stage.name());
        }
    }
}

#[test]
fn device_without_rows_has_the_cost_of_the_others() {
    let world = World::sky_over_city(spec(40, 2, 0, Seam::None), &[1.0, 1.0]);
    let mut model = model(&world.spec);
    assert!(!model.has_learned());
    let all_to_one = Assignment::uniform(Stripes::from_edges(40, &[40]));
    model.learn(&world.costs(&graph(&world.spec, &all_to_one, None)));
    assert!(model.has_learned());
    let passes = model.program().passes();
    let path_trace = &passes.iter().find(|p| p.pass.partition == PARTITION).expect("it is in every frame").pass;
    let ms = |device| model.pass_ms(path_trace, device, &(0..40));
    assert!(ms(0) > 0.0 && ms(0) == ms(1));
}

#[test]
fn ratio_rules_narrow_to_stage_and_view() {
    let rule: RatioRule = "path_trace.left=5,1,2".parse().unwrap();
    assert_eq!((rule.group, rule.view), (Some(PARTITION), Some(Eye::LEFT)));
    let a = Static::new(80, 3, &[rule]).unwrap().assign(&model(&spec(80, 3, 5, Seam::None)));
    assert_eq!(a.stripes(PARTITION, Eye::LEFT).inner_edges(), &[50, 60]);
    assert_eq!(a.stripes(PARTITION, Eye::RIGHT).inner_edges(), &[26, 53]);
    assert!("shade=1,2".parse::<RatioRule>().is_err());
    assert!("1,x".parse::<RatioRule>().is_err());
    assert!(Static::new(80, 2, &["1,2,3".parse().unwrap()]).is_err());
}

#[test]
fn remaining_devices_cover_all_rows_and_rebalance() {
    let of = |devices, speeds: &[f64]| World::sky_over_city(spec(160, devices, 2, Seam::None), speeds);
    for mut policy in all_policies(160, 4) {
        let mut world = of(4, &[1.0, 2.0, 1.0, 3.0]);
        let (_, mut model) = world.play(&mut *policy, 6);
        for (gone, left) in [(0, vec![2.0, 1.0, 3.0]), (2, vec![2.0, 1.0]), (1, vec![2.0])] {
            policy.remove_device(gone);
            let others: Vec<usize> = (0..left.len() + 1).filter(|d| *d != gone).collect();
            model = model.of_devices(&others).into_owned();
            world = of(left.len(), &left);
            let mut built = graph(&world.spec, &policy.assign(&model), None);
            for _ in 0..8 {
                model.learn(&world.costs(&built));
                let assignment = policy.assign(&model);
                let stripes = assignment.stripes(PARTITION, Eye::LEFT);
                assert_eq!((stripes.devices(), stripes.height()), (left.len(), 160), "{}", policy.name());
                built = graph(&world.spec, &assignment, None);
            }
            let learns = policy.name() == "measured";
            let imbalance = world.imbalance(&built);
            assert!(!learns || imbalance < 1.1, "{}: {imbalance} on {left:?}", policy.name());
        }
    }
}

#[test]
fn static_ratios_of_remaining_devices_stay() {
    let mut policy = Static::new(80, 3, &["5,1,2".parse().unwrap(), "atrous=0,1,0".parse().unwrap()]).unwrap();
    policy.remove_device(1);
    let assignment = policy.assign(&model(&spec(80, 2, 0, Seam::None)));
    assert_eq!(assignment.stripes(PARTITION, Eye::LEFT).inner_edges(), &[57]);
    assert_eq!(assignment.stripes(denoise::PARTITION, Eye::LEFT).inner_edges(), &[40]);
}

#[test]
fn halo_rows_are_received_where_cheaper() {
    let world = World::sky_over_city(spec(360, 4, 5, Seam::Halo(HaloPlan::RECOMPUTE)), &[1.0; 4]);
    let costs = world.costs(&graph(&world.spec, &Assignment::uniform(Stripes::even(360, 4)), None));
    let model_at = |factor: f64| {
        let mut costs = costs.clone();
        costs.transfers.iter_mut().for_each(|t| t.ms *= factor);
        costs.wait_ms = (0..4).map(|d| (d, GAP_MS * factor)).collect();
        let mut model = model(&world.spec);
        (0..2).for_each(|_| model.learn(&costs));
        model
    };
    let exchanges = |factor: f64| {
        let model = model_at(factor);
        let plan = choose_halo(&model, HaloPlan::RECOMPUTE);
        assert_eq!(choose_halo(&model, plan), plan, "it does not come to rest");
        (0..5).filter(|i| plan.receives_before(*i)).collect::<Vec<_>>()
    };
    assert_eq!(exchanges(1e-6), [0, 1, 2, 3, 4]);
    assert_eq!(exchanges(100.0), [0]);
    let between: Vec<usize> = [1e-6, 0.1, 1.0, 10.0, 100.0].map(|f| exchanges(f).len()).into();
    assert!(between.is_sorted_by(|a, b| a >= b) && between.iter().any(|n| (2..5).contains(n)), "{between:?}");
    assert_eq!(choose_halo(&model(&world.spec), HaloPlan::EXCHANGE), HaloPlan::EXCHANGE);
}
