//! Prints the passes of a frame as tables, and its tasks for Graphviz.

use std::collections::BTreeMap;

use petgraph::dot::{Config, Dot};

use super::Table;
use diptych::graph::{Access, Format, FrameGraph, Grid, Linked, Program, Reach, Stage, Task, TaskKind, Use};
use diptych::image::Extent;
use diptych::scene::rig::Eye;

/// Returns a table with a line per pass, in order: its view, grid, partition and bindings. `±N` after an image means
/// that the pass reads N rows above and below the rows of its stripe, with its margin included in N.
pub fn passes_table(program: &Program) -> Table {
    let row = |(number, linked): (usize, &Linked)| {
        let pass = &linked.pass;
        let extent = pass.grid.extent(program.extent);
        // Images of one texel stand in for those that the frame does not need.
        let is_dummy = |used: &Use| used.image.resource.grid == Grid::Fixed(Extent::new(1, 1));
        let has_content = |used: &Use| matches!(used.image.resource.format, Format::Uniform { .. }) || !is_dummy(used);
        let uses = || pass.uses.iter().zip(&linked.images).filter(|(used, _)| has_content(used));
        let of = |is_listed: fn(&Use) -> bool| {
            let names = uses().filter(|(u, _)| is_listed(u)).map(|(u, &image)| name(program, linked, u, image));
            names.collect::<Vec<_>>().join(", ")
        };
        vec![
            number.to_string(),
            name_of(linked),
            pass.view.to_string(),
            extent.to_string(),
            pass.partition.0.to_owned(),
            if linked.margin_rows > 0 { linked.margin_rows.to_string() } else { String::new() },
            of(|u| matches!(u.access, Access::Read | Access::Update | Access::Add)),
            of(|u| u.access.writes()),
        ]
    };
    let headers = vec!["#", "pass", "eye", "grid", "stripes of", "margin", "reads", "writes"];
    Table { headers, rows: program.passes().iter().enumerate().map(row).collect() }
}

fn name_of(linked: &Linked) -> String {
    let is_repeated = linked.pass.index > 0;
    let index = if is_repeated { format!(" {}", linked.pass.index) } else { String::new() };
    format!("{}{index}", linked.pass.stage.name())
}

/// Formats the name of an image that a pass binds. Adds the image's eye if the pass renders the other one, and the rows
/// that the pass reads outside its stripe.
fn name(program: &Program, linked: &Linked, used: &Use, image: usize) -> String {
    let other = match used.eye {
        Some(eye) if eye != linked.pass.view => format!("{eye} "),
        _ => String::new(),
    };
    let rows = match used.reach {
        _ if !used.is_read() => String::new(),
        Reach::Own | Reach::Halo(_) => match used.reach.halo_rows() + linked.margin_rows {
            0 => String::new(),
            rows => format!(" ±{rows}"),
        },
        Reach::Blocks { size, .. } => format!(" blocks of {size}"),
        Reach::All => " all".to_owned(),
        Reach::Rows(_) => " other rows".to_owned(),
    };
    format!("{other}{}{rows}", program.images()[image].name())
}

/// Returns a table of the stages that a frame leaves out, with eyes and reasons.
pub fn left_out_table(left_out: &[(Stage, Eye, &'static str)]) -> Table {
    let mut rows: Vec<(Stage, &str, Vec<Eye>)> = Vec::new();
    for &(stage, eye, why) in left_out {
        match rows.iter_mut().find(|(s, w, _)| (*s, *w) == (stage, why)) {
            Some((_, _, eyes)) => eyes.push(eye),
            None => rows.push((stage, why, vec![eye])),
        }
    }
    let names = |eyes: &[Eye]| match eyes {
        [eye] => eye.to_string(),
        [first, _] if first.views() == 2 => "both".to_owned(),
        eyes => format!("{} views", eyes.len()),
    };
    let row = |(stage, why, eyes): (Stage, &str, Vec<Eye>)| vec![stage.name().to_owned(), names(&eyes), why.to_owned()];
    Table { headers: vec!["left out", "eye", "why"], rows: rows.into_iter().map(row).collect() }
}

/// Returns a table of the transfers between devices in a frame, by image.
pub fn transfers_table(graph: &FrameGraph) -> Table {
    let mut sums: BTreeMap<usize, (u64, u64, u64)> = BTreeMap::new();
    for task in graph.dag.node_weights() {
        if let TaskKind::Download { image, .. } = task.kind {
            let (count, rows, bytes) = sums.entry(image).or_default();
            (*count, *rows) = (*count + 1, *rows + u64::from(task.rows.end - task.rows.start));
            *bytes += graph.program.bytes(task);
        }
    }
    let row = |(image, (count, rows, bytes)): (usize, (u64, u64, u64))| {
        let name = graph.program.images()[image].name().into_owned();
        vec![name, count.to_string(), rows.to_string(), bytes.to_string()]
    };
    Table { headers: vec!["image", "transfers", "rows", "bytes"], rows: sums.into_iter().map(row).collect() }
}

/// Returns the task graph as text for Graphviz, with a colour per device and the image's name on each edge.
pub fn dot(graph: &FrameGraph) -> String {
    let label = |task: &Task| {
        let rows = format!("{}..{}", task.rows.start, task.rows.end);
        let image = |image: usize| graph.program.images()[image].name();
        match &task.kind {
            TaskKind::Dispatch { pass, .. } => {
                format!("{} {}\\nrows {rows}", name_of(&graph.program.passes()[*pass]), task.view)
            }
            TaskKind::Download { image: i, to, .. } => {
                format!("download {} {}\\nrows {rows} for device {to}", image(*i), task.view)
            }
            TaskKind::Upload { image: i, .. } => format!("upload {} {}\\nrows {rows}", image(*i), task.view),
            TaskKind::Stitch => "whole images".to_owned(),
        }
    };
    let nodes = |_: &_, (_, task): (_, &Task)| {
        let hue = task.device as f64 / graph.devices().max(1) as f64;
        let shape = if graph.pass(task).is_some() { "box" } else { "ellipse" };
        let device = task.device;
        format!("label=\"{}\\ndevice {device}\" shape={shape} style=filled fillcolor=\"{hue:.3} 0.25 1\"", label(task))
    };
    let edges = |_: &_, edge: petgraph::graph::EdgeReference<'_, usize>| {
        format!("label=\"{}\"", graph.program.images()[*edge.weight()].name())
    };
    let config = [Config::NodeNoLabel, Config::EdgeNoLabel];
    format!("{:?}", Dot::with_attr_getters(&graph.dag, &config, &edges, &nodes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::graph::{Assignment, HaloPlan, Seam, Stripes};
    use diptych::image::Extent;
    use diptych::passes::{Declarations, FrameSpec, declare};
    use diptych::quality::Denoiser;

    #[test]
    fn tables_and_graph_describe_a_frame() {
        let seam = Seam::Halo(HaloPlan::EXCHANGE);
        let frame = FrameSpec::new(Extent::new(64, 180), 2);
        let spec = FrameSpec { filter: Some(Denoiser::SVGF), iterations: 2, history_rows: Some(4), seam, ..frame };
        let stripes = Assignment::uniform(Stripes::even(180, 2));
        let graph = FrameGraph::build(&Declarations::default().program(&spec), &stripes, Some(&stripes));
        let passes = passes_table(&graph.program).rows;
        let variance = passes.iter().find(|row| row[1] == "variance").unwrap();
        assert_eq!(variance[6..], ["guide ±3, filtered ±3, unfinished", "filtered"]);
        let tally = passes.iter().find(|row| row[1] == "tally").unwrap();
        assert_eq!(tally[6..], ["tally", "row_tally"]);
        let reproject = passes.iter().find(|row| row[1] == "reproject").unwrap();
        assert!(reproject[6].starts_with("left hit, left guide, left radiance, hit"), "{reproject:?}");
        let left_out = left_out_table(&declare(&spec).left_out).rows;
        assert!(left_out.iter().any(|row| row[..2] == ["seam_filter", "both"]), "{left_out:?}");
        let transfers = transfers_table(&graph).rows;
        let guide = transfers.iter().find(|row| row[0] == "last_guide").unwrap();
        assert_eq!(guide[1..3], ["4", "16"]);
        let dot = dot(&graph);
        assert_eq!(dot.matches(" -> ").count(), graph.dag.edge_count());
        assert_eq!(dot.matches("shape=").count(), graph.dag.node_count());
    }
}
