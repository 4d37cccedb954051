//! Tests of the frame graphs of the renderer's own passes.

use std::collections::HashMap;

use super::denoise::PARTITION;
use super::tests::spec;
use super::*;
use crate::graph::{Assignment, FrameGraph, HaloPlan, Stripes, Task, TaskKind};

/// Builds the graph of a frame with the renderer's own passes.
pub fn graph(spec: &FrameSpec, assignment: &Assignment, before: Option<&Assignment>) -> FrameGraph {
    FrameGraph::build(&Declarations::default().program(spec), assignment, before)
}

/// Returns an assignment with different stripes for every group and view.
fn ragged(devices: usize) -> Assignment {
    let mut a = Assignment::uniform(Stripes::even(180, devices));
    for (i, group) in partitions().into_iter().enumerate() {
        for (j, view) in Eye::BOTH.into_iter().enumerate() {
            let weights: Vec<f64> = (0..devices).map(|d| 1.0 + ((d * 3 + i * 5 + j * 2) % 4) as f64).collect();
            a.set(group, view, Stripes::from_weights(180, &weights).unwrap());
        }
    }
    a
}

/// Returns the same frame with a history, and the assignment of the previous frame.
fn with_history(spec: FrameSpec, rows: u32) -> (FrameSpec, Assignment) {
    let mut before = ragged(spec.devices);
    before.set(PARTITION, Eye::LEFT, Stripes::even(180, spec.devices));
    (FrameSpec { filter: Some(Denoiser::SVGF), history_rows: Some(rows), ..spec }, before)
}

/// Replays a graph in key order and checks that every read finds the newest version of its rows on its device.
pub fn replay(graph: &FrameGraph, before: Option<&Assignment>) {
    let program = &graph.program;
    // The version of each row on each device, and the newest version of each image.
    let mut held: HashMap<(usize, Eye, usize, u32), u32> = HashMap::new();
    let mut in_flight: HashMap<u32, Vec<(u32, u32)>> = HashMap::new();
    let mut newest: HashMap<(usize, Eye), u32> = HashMap::new();
    let all = |image: usize| program.images()[image].resource.extent(program.extent).rows();
    let is_table = |image: usize| program.images()[image].resource.scope == Scope::Device;
    let last = program.images().iter().enumerate().filter(|(_, bound)| bound.is_before);
    for ((image, bound), view) in last.flat_map(|last| Eye::BOTH.map(|view| (last, view))) {
        let (Some(before), Some(group)) = (before, program.writer(&bound.resource, view)) else { continue };
        newest.insert((image, view), 1);
        if bound.resource.scope == Scope::Device {
            let working = before.works().into_iter().enumerate().filter(|(_, works)| *works);
            held.extend(working.flat_map(|(device, _)| all(image).map(move |row| ((image, view, device, row), 1))));
            continue;
        }
        for (device, rows) in before.stripes(group, view).iter() {
            held.extend(rows.map(|row| ((image, view, device, row), 1)));
        }
    }
    for &node in graph.order() {
        let task = &graph.dag[node];
        match &task.kind {
            TaskKind::Dispatch { pass, .. } => {
                let linked = &program.passes()[*pass];
                let uses = || linked.pass.uses.iter().zip(&linked.images);
                for (used, &image) in uses().filter(|(u, _)| u.is_read()) {
                    let view = linked.pass.eye_of(used);
                    // If a pass writes in place, another device may already have advanced the newest version.
                    let in_place = used.access.writes();
                    let expect = newest.get(&(image, view)).copied().unwrap_or(0);
                    let height = all(image).end;
                    for row in if is_table(image) { all(image) } else { used.reach.rows(&task.rows, height) } {
                        let has = held.get(&(image, view, task.device, row)).copied().unwrap_or(0);
                        assert!(has == expect || (in_place && has > 0), "{task:?} lacks row {row} of {used:?}");
                    }
                }
                for (_, &image) in uses().filter(|(u, _)| u.access.writes()) {
                    newest.insert((image, task.view), task.key.pass + 2);
                    let rows = if is_table(image) { all(image) } else { task.rows.clone() };
                    held.extend(rows.map(|row| ((image, task.view, task.device, row), task.key.pass + 2)));
                }
            }
            TaskKind::Download { image, transfer, .. } => {
                let rows = task.rows.clone().map(|r| (r, held[&(*image, task.view, task.device, r)])).collect();
                in_flight.insert(*transfer, rows);
            }
            TaskKind::Upload { image, transfer } => {
                for (row, version) in in_flight.remove(transfer).expect("downloaded before it is uploaded") {
                    held.insert((*image, task.view, task.device, row), version);
                }
            }
            TaskKind::Stitch => {
                for (image, view) in program.outputs().flat_map(|image| Eye::BOTH.map(|view| (image, view))) {
                    for row in program.extent.rows() {
                        let has = held.get(&(image, view, graph.primary, row));
                        assert_eq!(has, newest.get(&(image, view)), "row {row} of the {view} eye");
                    }
                }
            }
        }
    }
    assert!(in_flight.is_empty());
}

#[test]
fn every_read_finds_its_rows_on_its_device() {
    let halos = HaloPlan::all(6).chain([HaloPlan::EXCHANGE]).map(Seam::Halo);
    let seams: Vec<Seam> = [Seam::None, Seam::Filter].into_iter().chain(halos).collect();
    for devices in 1..=5 {
        for (i, &seam) in seams.iter().enumerate() {
            for assignment in [Assignment::uniform(Stripes::even(180, devices)), ragged(devices)] {
                let spec = FrameSpec { sparse: i % 2 == 1, cache: i % 3 == 1, ..spec(devices, seam) };
                replay(&graph(&spec, &assignment, None), None);
                let (spec, before) = with_history(spec, 12);
                replay(&graph(&spec, &assignment, Some(&before)), Some(&before));
            }
        }
    }
}

#[test]
fn device_without_rows_receives_the_cache_once() {
    for cache in [false, true] {
        let frame = FrameSpec { cache, ..spec(3, Seam::None) };
        let (frame, _) = with_history(frame, 4);
        let before = Assignment::uniform(Stripes::from_edges(180, &[90, 90]));
        let graph = graph(&frame, &Assignment::uniform(Stripes::even(180, 3)), Some(&before));
        replay(&graph, Some(&before));
        let is_table = |task: &&Task| match task.kind {
            TaskKind::Upload { image, .. } => graph.program.images()[image].name() == "last_cache",
            _ => false,
        };
        let uploads: Vec<&Task> = graph.dag.node_weights().filter(is_table).collect();
        let sent: Vec<_> = uploads.iter().map(|task| (task.device, graph.program.bytes(task))).collect();
        // 64x180 pixels have 16,384 slots of 48 bytes.
        assert_eq!(sent, if cache { vec![(1, 16_384 * 48)] } else { Vec::new() });
    }
}

/// Checks that every edge follows the task order that all devices share.
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
        check_order(&graph(&spec, &ragged(4), None));
        let (spec, before) = with_history(spec, 12);
        check_order(&graph(&spec, &ragged(4), Some(&before)));
    }
}

#[test]
fn equal_stripes_reproject_without_any_transfer() {
    let spec = spec(3, Seam::None);
    let built = graph(&spec, &Assignment::uniform(Stripes::even(180, 3)), None);
    let final_pass = built.program.passes().len() as u32;
    for task in built.dag.node_weights() {
        if let TaskKind::Upload { .. } = task.kind {
            assert_eq!(task.key.pass, final_pass, "only finished rows travel: {task:?}");
        }
    }
}

/// Checks that devices with fixed stripes only exchange the history rows that motion can reach.
#[test]
fn history_transfers_only_reachable_rows() {
    let stripes = Assignment::uniform(Stripes::even(180, 2));
    let spec =
        FrameSpec { filter: Some(Denoiser::SVGF), history_rows: Some(8), ..spec(2, Seam::Halo(HaloPlan::RECOMPUTE)) };
    let built = graph(&spec, &stripes, Some(&stripes));
    let mut rows: HashMap<_, u32> = HashMap::new();
    for task in built.dag.node_weights() {
        if let TaskKind::Download { image, .. } = task.kind {
            *rows.entry(built.program.images()[image].name()).or_default() += task.rows.len() as u32;
        }
    }
    for last in ["last_guide", "last_moments", "last_history", "last_resolved"] {
        assert_eq!(rows.get(last), Some(&(2 * 2 * 8)), "{last}");
    }
    let new = graph(&FrameSpec { history_rows: None, ..spec }, &stripes, None);
    let is_last =
        |t: &&Task| matches!(t.kind, TaskKind::Download { image, .. } if new.program.images()[image].is_before);
    assert_eq!(new.dag.node_weights().filter(is_last).count(), 0);
}
