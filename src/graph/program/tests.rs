use super::*;
use crate::graph::{Dispatch, Grid, HaloPlan, Kernel, Stage, Use};

const EXTENT: Extent = Extent { width: 16, height: 64 };
const PARTITION: Partition = Partition("a");
const OTHER: Partition = Partition("b");
const A: Resource = Resource::image::<u32>("a");
const B: Resource = Resource::image::<u32>("b");
const LIST: Resource = Resource::list("list");
const TABLE: Resource = Resource::table::<u32>("table", Extent { width: 8, height: 1 });
const HALO: Seam = Seam::Halo(HaloPlan::RECOMPUTE);

fn pass(group: Partition, uses: impl IntoIterator<Item = Use>) -> Pass {
    Pass::new(Stage("test"), Eye::LEFT, group, Kernel::new("test")).uses(uses)
}

fn error(passes: Vec<Pass>) -> ProgramError {
    Program::new(EXTENT, HALO, passes).expect_err("the passes contradict one another")
}

#[test]
fn rejects_contradictory_passes() {
    let [stage, a] = ["test", "a"];
    assert_eq!(error(vec![pass(PARTITION, [Use::read(A)])]), ProgramError::Unwritten { stage, image: a });
    assert!(Program::new(EXTENT, HALO, vec![pass(PARTITION, [Use::read(A).if_written()])]).is_ok());

    let versions = [Image::from(A), Image::from(A).next(), Image::from(A).next().next()];
    let passes: Vec<Pass> = versions.map(|v| pass(PARTITION, [Use::write(v)])).into();
    let stale = passes.into_iter().chain([pass(PARTITION, [Use::read(A)])]).collect();
    assert_eq!(error(stale), ProgramError::Overwritten { stage, image: a, read: 0, held: 2 });

    assert_eq!(
        error(vec![pass(PARTITION, [Use::read(A).before(Some(1))])]),
        ProgramError::NeverKept { stage, image: a }
    );

    let list = || pass(PARTITION, [Use::write_then_read(LIST)]);
    let elsewhere = ProgramError::Elsewhere { stage, image: "list" };
    assert_eq!(error(vec![list(), pass(OTHER, [Use::read(LIST)])]), elsewhere);
    assert_eq!(error(vec![list(), pass(PARTITION, [Use::read(LIST).halo(1)])]), elsewhere);
    assert!(Program::new(EXTENT, HALO, vec![list(), pass(PARTITION, [Use::read(LIST)])]).is_ok());

    assert_eq!(error(vec![pass(PARTITION, [Use::write(TABLE)])]), ProgramError::Scope { stage, image: "table" });
    let once = Pass::once(Stage("test"), PARTITION, Kernel::new("test"), [1; 3]);
    assert_eq!(error(vec![once.clone().uses([Use::write(A)])]), ProgramError::Scope { stage, image: a });
    assert!(Program::new(EXTENT, HALO, vec![once.uses([Use::write(TABLE)])]).is_ok());

    let constants = Resource::constants("constants", "Constants", 16);
    let input = ProgramError::Input { stage, image: "constants" };
    assert_eq!(error(vec![pass(PARTITION, [Use::write(constants)])]), input);

    let chain = |chain| pass(PARTITION, [Use::read(A).halo(2), Use::write(B)]).chain(chain);
    let half = chain(Chain::Planned).on(Grid::FrameOver(2));
    let grids = vec![pass(PARTITION, [Use::write(A)]), half, chain(Chain::Margin)];
    assert_eq!(error(grids), ProgramError::Grid { stage });
}

/// Each device computes a margin around its rows that covers the halos of later passes, up to the next pass that
/// receives rows from neighbours.
#[test]
fn margins_cover_the_halos_of_later_passes() {
    let link = |halo: u32, from: Image| pass(PARTITION, [Use::read(from).halo(halo), Use::write(from.next())]);
    let light = Image::from(A);
    let passes = || {
        let chain = [(4, Chain::Planned), (2, Chain::Planned), (1, Chain::Planned), (3, Chain::Margin)];
        let links = chain.into_iter().scan(light, |from, (halo, chain)| {
            let linked = link(halo, *from).chain(chain);
            *from = from.next();
            Some(linked)
        });
        std::iter::once(pass(PARTITION, [Use::write(light)])).chain(links).collect::<Vec<_>>()
    };
    let margins = |seam| {
        let program = Program::new(EXTENT, seam, passes()).unwrap();
        assert_eq!(program.links(), 3);
        program.passes().iter().map(|p| p.margin_rows).collect::<Vec<_>>()
    };
    assert_eq!(margins(HALO), [0, 6, 4, 3, 0]);
    assert_eq!(margins(Seam::Halo(HaloPlan::EXCHANGE)), [0, 0, 0, 3, 0]);
    let second = HaloPlan::all(3).find(|p| p.receives_before(1) && !p.receives_before(2)).unwrap();
    assert_eq!(margins(Seam::Halo(second)), [0, 0, 4, 3, 0]);
}

#[test]
fn outputs_and_history_follow_from_bindings() {
    let out = Resource::image::<u32>("out").output();
    let passes = vec![
        pass(PARTITION, [Use::write(A)]),
        pass(OTHER, [Use::read(A), Use::read(A).before(Some(2)), Use::write(out)]),
    ];
    let program = Program::new(EXTENT, HALO, passes).unwrap();
    let names = |numbers: Vec<usize>| numbers.into_iter().map(|n| program.images()[n].name()).collect::<Vec<_>>();
    assert_eq!(names(program.outputs().collect()), ["out"]);
    assert_eq!(names((0..program.images().len()).collect()), ["a", "last_a", "out"]);
    assert_eq!(program.writer(&A, Eye::LEFT), Some(PARTITION));
    assert_eq!(program.writer(&A, Eye::RIGHT), None);
    assert_eq!(pass(PARTITION, []).dispatch, Dispatch::PIXELS);
}
