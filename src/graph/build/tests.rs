use super::*;
use crate::graph::{HaloPlan, Seam, Stripes, Views};
use crate::image::Extent;
use crate::quality::Denoiser;

fn spec(devices: usize, seam: Seam) -> FrameSpec {
    let extent = Extent::new(64, 180);
    FrameSpec {
        extent,
        devices,
        views: Views::Reprojected,
        sparse: false,
        filter: Some(Denoiser::Atrous),
        iterations: 5,
        history_rows: None,
        seam,
        aovs: 1,
        has_surfaces: true,
    }
}

/// Different stripes at every stage and view.
fn ragged(devices: usize) -> Assignment {
    let mut a = Assignment::uniform(Stripes::even(180, devices));
    for (i, stage) in Stage::RATIO_GROUPS.into_iter().enumerate() {
        for (j, view) in Eye::ALL.into_iter().enumerate() {
            let weights: Vec<f64> = (0..devices).map(|d| 1.0 + ((d * 3 + i * 5 + j * 2) % 4) as f64).collect();
            a.set(stage, view, Stripes::from_weights(180, &weights).unwrap());
        }
    }
    a
}

/// The same frame with a history, and who had which rows in the frame before.
fn with_history(spec: FrameSpec, rows: u32) -> (FrameSpec, Assignment) {
    let mut before = ragged(spec.devices);
    before.set(Stage::Atrous, Eye::Left, Stripes::even(180, spec.devices));
    (FrameSpec { filter: Some(Denoiser::Svgf), history_rows: Some(rows), ..spec }, before)
}

/// Replays a graph in key order and checks that every read finds the newest version of its rows on its device.
pub fn replay(spec: &FrameSpec, graph: &FrameGraph, before: Option<&Assignment>) {
    let passes = passes(spec);
    let mut tasks: Vec<&Task> = graph.dag.node_weights().collect();
    tasks.sort_by_key(|t| t.key);
    // Version number of each row on each device, and the newest there is.
    let mut held: HashMap<(Resource, Eye, usize, u32), u32> = HashMap::new();
    let mut in_flight: HashMap<u32, Vec<(u32, u32)>> = HashMap::new();
    let mut newest: HashMap<(Resource, Eye), u32> = HashMap::new();
    for (&(resource, stage), view) in spec.kept().iter().flat_map(|k| Eye::ALL.map(|view| (k, view))) {
        let (Some(before), Some(last)) = (before, resource.next_frames()) else { continue };
        newest.insert((last, view), 1);
        for (device, rows) in before.stripes(stage, view).iter() {
            held.extend(rows.map(|row| ((last, view, device, row), 1)));
        }
    }
    for task in tasks {
        match &task.kind {
            TaskKind::Dispatch { .. } => {
                let pass = &passes[task.key.pass as usize];
                let own = pass_rows(task, pass, spec);
                for read in &pass.reads {
                    // A pass that writes in place may find that another device's rows have moved on already.
                    let in_place = pass.writes.contains(&read.resource) && read.view == pass.view;
                    let expect = newest.get(&(read.resource, read.view)).copied().unwrap_or(0);
                    for row in widen(&own, read.halo_rows, spec) {
                        let has = held.get(&(read.resource, read.view, task.device, row)).copied().unwrap_or(0);
                        assert!(has == expect || (in_place && has > 0), "{task:?} lacks row {row} of {read:?}");
                    }
                }
                for &w in &pass.writes {
                    newest.insert((w, task.view), task.key.pass + 1);
                    for row in task.rows.clone() {
                        held.insert((w, task.view, task.device, row), task.key.pass + 1);
                    }
                }
            }
            TaskKind::Download { resource, transfer, .. } => {
                let rows = task.rows.clone().map(|r| (r, held[&(*resource, task.view, task.device, r)])).collect();
                in_flight.insert(*transfer, rows);
            }
            TaskKind::Upload { resource, transfer } => {
                for (row, version) in in_flight.remove(transfer).expect("downloaded before it is uploaded") {
                    held.insert((*resource, task.view, task.device, row), version);
                }
            }
            TaskKind::Stitch => {
                for view in Eye::ALL {
                    for row in spec.extent.rows() {
                        let has = held.get(&(Resource::Linear, view, 0, row));
                        assert_eq!(has, newest.get(&(Resource::Linear, view)), "row {row} of the {view} eye");
                    }
                }
            }
        }
    }
    assert!(in_flight.is_empty());
}

fn pass_rows(task: &Task, pass: &Pass, spec: &FrameSpec) -> Range<u32> {
    // A margin cut off by the frame's border leaves a few rows too many: all of the image's edge is asked for, as it is
    // by a task whose own rows end there.
    let m = pass.margin_rows;
    let start = if task.rows.start == 0 { 0 } else { task.rows.start + m };
    let end = if task.rows.end == spec.extent.height { task.rows.end } else { task.rows.end - m };
    start..end
}

#[test]
fn every_read_finds_its_rows_on_its_device() {
    let halos = HaloPlan::all(6).chain([HaloPlan::EXCHANGE]).map(Seam::Halo);
    let seams: Vec<Seam> = [Seam::None, Seam::Filter].into_iter().chain(halos).collect();
    for devices in 1..=5 {
        for (i, &seam) in seams.iter().enumerate() {
            for assignment in [Assignment::uniform(Stripes::even(180, devices)), ragged(devices)] {
                let spec = FrameSpec { sparse: i % 2 == 1, ..spec(devices, seam) };
                replay(&spec, &FrameGraph::build(&spec, &assignment, None), None);
                let (spec, before) = with_history(spec, 12);
                replay(&spec, &FrameGraph::build(&spec, &assignment, Some(&before)), Some(&before));
            }
        }
    }
}

/// Checks that no edge leads back in the order that all devices keep to.
pub fn check_order(graph: &FrameGraph) {
    assert!(!petgraph::algo::is_cyclic_directed(&graph.dag));
    for edge in graph.dag.edge_indices() {
        let (a, b) = graph.dag.edge_endpoints(edge).unwrap();
        assert!(graph.dag[a].key < graph.dag[b].key, "{:?} -> {:?}", graph.dag[a], graph.dag[b]);
    }
}

#[test]
fn every_edge_follows_the_common_order() {
    for plan in HaloPlan::all(6) {
        let spec = spec(4, Seam::Halo(plan));
        check_order(&FrameGraph::build(&spec, &ragged(4), None));
        let (spec, before) = with_history(spec, 12);
        check_order(&FrameGraph::build(&spec, &ragged(4), Some(&before)));
    }
}

#[test]
fn equal_stripes_reproject_without_any_transfer() {
    let spec = spec(3, Seam::None);
    let graph = FrameGraph::build(&spec, &Assignment::uniform(Stripes::even(180, 3)), None);
    let final_pass = passes(&spec).len() as u32;
    for task in graph.dag.node_weights() {
        if let TaskKind::Upload { .. } = task.kind {
            assert_eq!(task.key.pass, final_pass, "only finished rows travel: {task:?}");
        }
    }
}

/// Still stripes exchange what motion can reach of what the frame before left, and nothing else of it.
#[test]
fn history_crosses_by_as_many_rows_as_it_may_have_moved() {
    let stripes = Assignment::uniform(Stripes::even(180, 2));
    let spec =
        FrameSpec { filter: Some(Denoiser::Svgf), history_rows: Some(8), ..spec(2, Seam::Halo(HaloPlan::RECOMPUTE)) };
    let graph = FrameGraph::build(&spec, &stripes, Some(&stripes));
    let mut rows: HashMap<Resource, u32> = HashMap::new();
    for task in graph.dag.node_weights() {
        if let TaskKind::Download { resource, .. } = task.kind {
            *rows.entry(resource).or_default() += task.rows.len() as u32;
        }
    }
    for last in [Resource::LastGuide, Resource::LastMoments, Resource::LastHistory, Resource::LastResolved] {
        assert_eq!(rows.get(&last), Some(&(2 * 2 * 8)), "{last:?}");
    }
    let new = FrameGraph::build(&FrameSpec { history_rows: None, ..spec }, &stripes, None);
    let is_last = |t: &&Task| matches!(t.kind, TaskKind::Download { resource, .. } if rows.contains_key(&resource) && resource == Resource::LastGuide);
    assert_eq!(new.dag.node_weights().filter(is_last).count(), 0);
}

#[test]
fn what_a_frame_does_not_need_is_pruned() {
    let stages = |spec: &FrameSpec| {
        let mut s: Vec<Stage> = passes(spec).iter().map(|p| p.stage).collect();
        s.sort();
        s.dedup();
        s
    };
    let full = spec(2, Seam::Filter);
    assert!(stages(&full).contains(&Stage::SeamFilter));
    let one = FrameSpec { devices: 1, ..full.clone() };
    assert!(!stages(&one).contains(&Stage::SeamFilter));
    let traced = FrameSpec { views: Views::Traced, iterations: 0, aovs: 0, ..full.clone() };
    assert_eq!(stages(&traced), [Stage::Gbuffer, Stage::PathTrace, Stage::Tonemap, Stage::Tally]);
    let sparse = FrameSpec { sparse: true, ..traced.clone() };
    assert_eq!(stages(&sparse), [Stage::Gbuffer, Stage::Select, Stage::PathTrace, Stage::Tonemap, Stage::Tally]);
    let empty = FrameSpec { has_surfaces: false, aovs: 0, ..full };
    assert_eq!(stages(&empty), [Stage::Gbuffer, Stage::Tonemap, Stage::Tally]);
}
