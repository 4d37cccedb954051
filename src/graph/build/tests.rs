#![expect(clippy::single_range_in_vec_init, reason = "rows that are transferred are lists of ranges")]

use std::collections::HashMap;

use super::*;
use crate::graph::{Grid, HaloPlan, Image, Kernel, Partition, Pass, Reach, Resource, Seam, Stage, Stripes, Use};
use crate::image::Extent;

const EXTENT: Extent = Extent { width: 16, height: 60 };
const WRITER: Partition = Partition("writer");
const READER: Partition = Partition("reader");
const IMAGE: Resource = Resource::image::<u32>("image");
const OUT: Resource = Resource::image::<u32>("out");

fn pass(name: &'static str, group: Partition, uses: impl IntoIterator<Item = Use>) -> Pass {
    Pass::new(Stage(name), Eye::LEFT, group, Kernel::new("test")).uses(uses)
}

/// Returns the transferred rows of each image, by the device that receives them.
fn transfers(passes: Vec<Pass>, assignment: &Assignment) -> HashMap<(&'static str, usize), Vec<Range<u32>>> {
    let program = Arc::new(Program::new(EXTENT, Seam::Halo(HaloPlan::EXCHANGE), passes).unwrap());
    let graph = FrameGraph::build(&program, assignment, None);
    let mut rows: HashMap<_, Vec<Range<u32>>> = HashMap::new();
    for task in graph.dag.node_weights() {
        if let TaskKind::Upload { image, .. } = task.kind {
            rows.entry((program.images()[image].resource.name, task.device)).or_default().push(task.rows.clone());
        }
    }
    rows
}

/// Divides the rows of two devices at row 20 where the image is written, and at row 30 where it is read.
fn moved() -> Assignment {
    let mut assignment = Assignment::uniform(Stripes::even(60, 2));
    assignment.set(WRITER, Eye::LEFT, Stripes::from_edges(60, &[20]));
    assignment
}

fn read(reach: Reach) -> Vec<Pass> {
    vec![
        pass("write", WRITER, [Use::write(IMAGE)]),
        pass("read", READER, [Use::read(IMAGE).reaching(reach), Use::write(OUT)]),
    ]
}

#[test]
fn rows_travel_as_far_as_a_pass_reads() {
    let of = |reach| {
        let rows = transfers(read(reach), &moved());
        [0, 1].map(|device| rows.get(&("image", device)).cloned().unwrap_or_default())
    };
    assert_eq!(of(Reach::Own), [vec![20..30], vec![]]);
    assert_eq!(of(Reach::Halo(4)), [vec![20..34], vec![]]);
    assert_eq!(of(Reach::Halo(12)), [vec![20..42], vec![18..20]]);
    assert_eq!(of(Reach::All), [vec![20..60], vec![0..20]]);
    // Blocks of 16 rows from row -4 on end at rows 12, 28, 44 and 60.
    assert_eq!(of(Reach::Blocks { size: 16, offset: 4 }), [vec![20..44], vec![]]);
    assert_eq!(of(Reach::Blocks { size: 32, offset: 0 }), [vec![20..32], vec![0..20]]);
    // The image is read upside down.
    assert_eq!(of(Reach::Rows(|rows| 60 - rows.end..60 - rows.start)), [vec![30..60], vec![0..20]].map(|r| r));
}

#[test]
fn scaled_grid_scales_transferred_rows() {
    let half = Grid::FrameOver(2);
    let small = IMAGE.on(half);
    let passes = vec![
        pass("write", WRITER, [Use::write(small)]).on(half),
        pass("read", READER, [Use::read(small).halo(1), Use::write(OUT)]),
    ];
    // Row 20 of the frame is row 10 of the small image, and row 30 is row 15.
    assert_eq!(transfers(passes, &moved()), HashMap::from([(("image", 0), vec![10..16])]));
    let sums = Resource::image::<[u32; 2]>("sums").on(Grid::FrameRows).output();
    assert_eq!((sums.row_bytes(EXTENT), sums.bytes(EXTENT)), (8, 480));
}

#[test]
fn pass_once_runs_on_every_device_with_rows() {
    let table = Resource::table::<u32>("table", Extent::new(8, 1));
    let passes = vec![
        Pass::once(Stage("make"), WRITER, Kernel::new("test"), [1, 1, 1]).uses([Use::write(table)]),
        pass("read", READER, [Use::read(table), Use::write(OUT)]),
    ];
    let program = Arc::new(Program::new(EXTENT, Seam::None, passes).unwrap());
    let graph = FrameGraph::build(&program, &Assignment::uniform(Stripes::from_edges(60, &[20, 20])), None);
    let ran: Vec<(usize, usize)> = graph
        .order()
        .iter()
        .filter_map(|&node| match graph.dag[node].kind {
            TaskKind::Dispatch { pass, .. } => Some((pass, graph.dag[node].device)),
            _ => None,
        })
        .collect();
    // The second of three devices has no rows, so it does not make the table.
    assert_eq!(ran, [(0, 0), (0, 2), (1, 0), (1, 2)]);
    assert_eq!(graph.dag.edge_count(), 2, "each reader follows its own device's pass");
}

#[test]
fn versions_of_an_image_take_turns_in_two_buffers() {
    let versions = [Image::from(IMAGE), Image::from(IMAGE).next(), Image::from(IMAGE).next().next()];
    let passes = vec![
        pass("first", WRITER, [Use::write(versions[0])]),
        pass("second", READER, [Use::read(versions[0]).halo(1), Use::write(versions[1])]),
        pass("third", READER, [Use::read(versions[1]).halo(1), Use::write(versions[2])]),
    ];
    let program = Program::new(EXTENT, Seam::None, passes).unwrap();
    assert_eq!(program.images().len(), 2);
    assert_eq!(program.passes()[2].images, [1, 0]);
}
