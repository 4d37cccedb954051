//! Tests of lists of commands.

mod text;

use std::fs;
use std::ops::Range;
use std::path::Path;

use super::list::Ended;
use super::*;
use crate::graph::{Assignment, FrameGraph, HaloPlan, Seam, Stripes, Task, TaskKind};
use crate::image::Extent;
use crate::passes::graph_tests::graph;
use crate::passes::tonemap::LINEAR;
use crate::passes::{Aov, Declarations, Display, FrameSpec, ImageChain, Moving, Views};
use crate::projection::PolarSpace;
use crate::quality::Denoiser;
use crate::samples::Samples;
use crate::scene::rig::Eye;
use crate::schedule::{Position, Split, Splits, rows_in};
use text::text_of;

const TICKET: u64 = 7;
const EXTENT: Extent = Extent::new(48, 40);

/// Returns rows of some image that a task moves.
pub fn rows(task: usize) -> Rows {
    let bound = crate::graph::Bound { resource: LINEAR, buffer: 0, is_before: false };
    Rows { task, image: EyeImage { bound, eye: Eye::LEFT }, rows: 0..1 }
}

fn dispatch(pass: usize) -> Command {
    Command::Dispatch { pass, launches: Vec::new(), begins: None, ends: None }
}

/// Returns the commands in a word each, with the number of a pass or of a transfer.
fn words(commands: &Commands) -> Vec<String> {
    let word = |command: &Command| match command {
        Command::Begin => "begin".to_owned(),
        Command::Clear(_) => "clear".to_owned(),
        Command::Dispatch { pass, .. } => format!("dispatch {pass}"),
        Command::Build { pass, .. } => format!("build {pass}"),
        Command::Save { .. } => "save".to_owned(),
        Command::Restore { .. } => "restore".to_owned(),
        Command::CopyOut { transfer, .. } => format!("out {transfer}"),
        Command::CopyIn { transfer, .. } => format!("in {transfer}"),
        Command::Stamps => "stamps".to_owned(),
        Command::Ask => "ask".to_owned(),
        Command::Close => "close".to_owned(),
        Command::Submit(copies) => {
            copies.iter().fold("submit".to_owned(), |word, copy| format!("{word} {}", copy.transfer))
        }
        Command::Probe { task, .. } => format!("probe {task}"),
        Command::Inject(kind) => kind.name().to_owned(),
    };
    commands.list.iter().map(word).collect()
}

/// Rows of a run, and its arguments.
type RunOfRows = (Range<u32>, [u32; 3]);

/// Returns the rows and the arguments of the runs that end a pass of this name early after `at`, in a frame of 16
/// samples, and the least number of samples.
fn ended(stage: &str, at: Position) -> (Vec<RunOfRows>, u32) {
    let spec = FrameSpec { views: Views::Reprojected, ..FrameSpec::new(EXTENT, 1) };
    let graph = graph(&spec, &Assignment::uniform(Stripes::even(EXTENT.height, 1)), None);
    let is_it = |task: &&Task| graph.pass(task).is_some_and(|pass| pass.pass.stage.name() == stage);
    let work = Work::of(&graph, graph.parts_of(0).0.iter().rfind(is_it).unwrap()).unwrap();
    let samples = Samples::from(16).shared(EXTENT, true);
    let (splits, repeats, injected) = (&Splits::default(), 1, None);
    let share = Share { ticket: TICKET, device: 0, samples, splits, repeats, injected, asks: false };
    let Ended { commands, least } = work.end_early(at, &share, None);
    let launches = commands.into_iter().find_map(|command| match command {
        Command::Dispatch { launches, .. } => Some(launches),
        _ => None,
    });
    let constants = launches.unwrap().into_iter().map(|launched| launched.constants);
    (constants.map(|c| (c.row_begin..c.row_end, c.args.0)).collect(), least)
}

#[test]
fn ended_pass_has_a_sample_of_each_pixel() {
    let at = |run, row| Position { run, row };
    let first = vec![(16..40, [0, 1, 0]), (0..16, [4, 4, 0])];
    assert_eq!(ended("path_trace", at(0, 16)), (first, 1));
    assert_eq!(ended("path_trace", at(0, 0)), (vec![(0..40, [0, 1, 0])], 1));
    let third = vec![(0..16, [12, 12, 0]), (16..40, [8, 8, 0])];
    assert_eq!(ended("path_trace", at(2, 16)), (third, 8));
    // The right eye's G-buffer runs once, and then over the samples.
    assert_eq!(ended("gbuffer", at(0, 16)).0, [(16..40, [0, 0, 0]), (0..40, [0, 1, 0])]);
    assert_eq!(ended("gbuffer", at(1, 16)).0, [(16..40, [0, 1, 0]), (0..16, [16, 16, 0])]);
}

#[test]
fn copies_leave_together_and_uploads_wait_for_submit() {
    let mut builder = Builder::new(TICKET);
    builder.record(dispatch(0));
    builder.copy_out(4, 1, rows(1));
    builder.copy_out(5, 1, rows(2));
    builder.record(dispatch(3));
    builder.copy_in(6, rows(4));
    builder.copy_out(8, 1, rows(5));
    let first = ["begin", "dispatch 0", "out 4", "out 5", "close", "submit 4 5", "dispatch 3", "close", "submit"];
    assert_eq!(words(&builder.end_own()), [&first[..], &["out 8", "close", "in 6", "submit 8"]].concat());
}

/// Covers rows that late reprojection reads, which must arrive before the pose is sampled.
#[test]
fn pose_is_sampled_after_all_other_submissions() {
    let mut builder = Builder::new(TICKET);
    builder.record(dispatch(0));
    builder.copy_in(6, rows(1));
    builder.ask();
    builder.record(dispatch(2));
    builder.record(dispatch(3));
    let first = ["begin", "dispatch 0", "close", "submit", "dispatch 2", "dispatch 3", "close", "in 6", "ask"];
    assert_eq!(words(&builder.end_own()), [&first[..], &["submit"]].concat());
}

#[test]
fn fault_is_injected_behind_a_submission() {
    let mut builder = Builder::new(TICKET);
    builder.record(dispatch(0));
    builder.inject(InjectedKind::Loss);
    builder.record(dispatch(1));
    let expected = ["begin", "dispatch 0", "close", "submit", "loss", "dispatch 1", "close", "submit"];
    assert_eq!(words(&builder.end_own()), expected);
    let mut idle = Builder::new(TICKET);
    idle.inject(InjectedKind::Loss);
    assert_eq!(words(&idle.end_own()), ["begin", "loss"]);
}

#[test]
fn trailing_uploads_are_submitted() {
    let ends = |stitch: &[Command], dispatches: bool| {
        let mut builder = Builder::new(TICKET);
        if dispatches {
            builder.record(dispatch(0));
        }
        let mut commands = builder.end_own();
        commands.list.extend_from_slice(stitch);
        commands.end();
        words(&commands).split_off(commands.own)
    };
    let stitch = [Command::CopyIn { transfer: 3, rows: rows(1) }];
    assert_eq!(ends(&stitch, true), ["in 3", "submit"]);
    assert!(ends(&[], true).is_empty());
    assert_eq!(ends(&[], false), ["submit"]);
}

/// A frame, and the other inputs of its commands.
struct Kind {
    name: &'static str,
    spec: FrameSpec,
    history: bool,
    samples: Samples,
    repeats: u32,
    injected: Option<InjectedKind>,
    asks: bool,
    splits: bool,
    probes: bool,
}

/// Returns all kinds of frames.
fn kinds() -> Vec<Kind> {
    let halo = |plan| Seam::Halo(plan);
    let spec = FrameSpec { iterations: 2, seam: halo(HaloPlan::RECOMPUTE), ..FrameSpec::new(EXTENT, 2) };
    let chain = |chain: ImageChain| FrameSpec { chain, ..spec.clone() };
    let direct = ImageChain::direct(EXTENT);
    let late = ImageChain { display: Display::Resampled { projection: EXTENT, is_late: true }, ..direct };
    let moving = Moving { triangles: 9, vertices: 12, morphs: 1, pose: 4, nodes: 5, levels: vec![1, 2], ..moving() };
    let of = |name: &'static str, spec: &FrameSpec| Kind {
        name,
        spec: spec.clone(),
        history: false,
        samples: Samples::ONE,
        repeats: 1,
        injected: None,
        asks: false,
        splits: false,
        probes: false,
    };
    let plain = |filter| FrameSpec { filter, ..spec.clone() };
    vec![
        of("svgf", &spec),
        Kind { history: true, ..of("history", &FrameSpec { history_rows: Some(4), ..spec.clone() }) },
        Kind { history: true, ..of("cache", &FrameSpec { history_rows: Some(4), cache: true, ..spec.clone() }) },
        of("exchange", &FrameSpec { seam: halo(HaloPlan::EXCHANGE), ..spec.clone() }),
        of("atrous", &plain(Some(Denoiser::ATROUS))),
        of("bmfr", &plain(Some(Denoiser::BMFR))),
        of("none", &plain(None)),
        of("traced", &FrameSpec { views: Views::Traced, ..plain(None) }),
        of("sparse", &FrameSpec { sparse: true, ..spec.clone() }),
        of("seam_filter", &FrameSpec { seam: Seam::Filter, ..spec.clone() }),
        of("aovs", &FrameSpec { aovs: vec![Aov::Albedo, Aov::Motion], ..plain(None) }),
        of("history_length", &FrameSpec { aovs: vec![Aov::History], ..spec.clone() }),
        of("polar", &chain(ImageChain { polar: Some(PolarSpace::Visual), ..direct })),
        Kind { asks: true, ..of("late", &chain(late)) },
        of("moving", &FrameSpec { moving: Some(moving.clone()), ..plain(None) }),
        Kind { repeats: 2, ..of("slow", &FrameSpec { moving: Some(moving), ..plain(None) }) },
        Kind { samples: Samples::of_mean(5.5), splits: true, ..of("cut", &spec) },
        Kind { asks: true, splits: true, ..of("late_cut", &chain(late)) },
        Kind { repeats: 2, splits: true, ..of("slow_cut", &plain(None)) },
        Kind { probes: true, samples: Samples::of_mean(5.5), ..of("probed", &spec) },
        Kind { asks: true, probes: true, ..of("late_probed", &chain(late)) },
        Kind { injected: Some(InjectedKind::Hang), ..of("injected", &plain(None)) },
    ]
}

fn moving() -> Moving {
    Moving { bodies: true, hardware: true, ..Moving::default() }
}

impl Kind {
    /// Returns the graph on this many devices, and the commands of each.
    fn lists(&self, devices: usize) -> (FrameGraph, Vec<Commands>) {
        let program = Declarations::default().program(&FrameSpec { devices, ..self.spec.clone() });
        let assignment = Assignment::uniform(Stripes::even(EXTENT.height, devices));
        let before = Assignment::uniform(Stripes::from_edges(EXTENT.height, &vec![12; devices - 1]));
        let graph = FrameGraph::build(&program, &assignment, self.history.then_some(&before));
        let commands = |device| {
            let dispatches = graph.tasks_of(device).iter().enumerate().filter(|(_, task)| graph.pass(task).is_some());
            let at = |task: usize, rows: &Range<u32>| {
                [
                    Split { task, at: Position::start(rows) },
                    Split { task, at: Position { run: 0, row: rows.start.midpoint(rows.end) } },
                ]
            };
            let all = dispatches.step_by(if self.asks { 1 } else { 5 }).flat_map(|(task, of)| at(task, &of.rows));
            let ends = all.filter(|_| self.splits).collect();
            let is_probed = |task: &usize| graph.tasks_of(device)[*task].rows.len() > 4 && self.probes;
            let probes = (0..graph.parts_of(device).0.len()).step_by(2).filter(is_probed).collect();
            let share = Share {
                ticket: TICKET,
                device,
                samples: self.samples.shared(EXTENT, true),
                splits: &Splits { ends, probes, bound_ms: 9.0 },
                repeats: self.repeats,
                injected: self.injected,
                asks: self.asks && device == 0,
            };
            Commands::new(&graph, &share)
        };
        let lists = (0..devices).map(commands).collect();
        (graph, lists)
    }
}

/// Set this variable to record the commands anew.
const WRITES: &str = "DIPTYCH_WRITE_COMMANDS";

/// The commands of the first of two devices are recorded as text, all others as their number and hash.
#[test]
fn commands_equal_the_recorded_ones() {
    for kind in kinds() {
        let mut text = String::new();
        for devices in 1..=4 {
            let (graph, lists) = kind.lists(devices);
            for (device, commands) in lists.iter().enumerate() {
                let (own, all) = (text_of(commands, &graph.program), format!("{:?}", commands.list));
                let hash = all.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
                    (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
                });
                text += &format!("device {device} of {devices}: {} commands, {hash:016x}\n", commands.list.len());
                if (devices, device) == (2, 0) {
                    text += &own;
                }
            }
        }
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("src/plan/recorded/{}.txt", kind.name));
        if std::env::var_os(WRITES).is_some() {
            fs::write(&path, &text).unwrap();
        }
        let recorded = fs::read_to_string(&path).unwrap_or_default();
        let first = text.lines().zip(recorded.lines()).position(|(new, old)| new != old);
        assert!(text == recorded, "{}: the first other line is {first:?}: see {WRITES}", path.display());
    }
}

/// Every task is executed once. Rows arrive before the submission of work that reads them, and leave once the work that
/// writes them is recorded.
#[test]
fn command_list_executes_each_task_once() {
    for (kind, devices) in kinds().iter().flat_map(|kind| [1, 2, 4].map(|devices| (kind, devices))) {
        let (graph, lists) = kind.lists(devices);
        for (device, commands) in lists.iter().enumerate() {
            let (mut open, mut closed, mut copies, mut asked) = (0, false, Vec::new(), 0);
            let mut done = vec![0_u32; graph.tasks_of(device).len()];
            for command in &commands.list {
                match command {
                    Command::Close => closed = true,
                    Command::Submit(sent) => {
                        assert_eq!(std::mem::take(&mut open) > 0, std::mem::take(&mut closed), "{}", kind.name);
                        let sent: Vec<u32> = sent.iter().map(|copy| copy.transfer).collect();
                        assert_eq!(sent, std::mem::take(&mut copies), "{}", kind.name);
                    }
                    Command::CopyOut { transfer, rows } => {
                        (open, done[rows.task]) = (open + 1, done[rows.task] + 1);
                        copies.push(*transfer);
                    }
                    Command::CopyIn { rows, .. } => {
                        assert!(open == 0 || closed, "{}: the host would record after it has waited", kind.name);
                        done[rows.task] += 1;
                    }
                    Command::Ask => asked += 1,
                    Command::Begin | Command::Inject(_) => assert_eq!(open, 0),
                    Command::Probe { task, .. } => {
                        assert_eq!((open, graph.tasks_of(device)[*task].device), (0, device), "{}", kind.name);
                    }
                    _ => {
                        assert!(!closed, "{}", kind.name);
                        open += 1;
                    }
                }
            }
            assert_eq!((open, asked), (0, u32::from(kind.asks && device == 0)), "{}", kind.name);
            commands.timed.iter().for_each(|timed| done[timed.task] += 1);
            assert_order(kind.name, &graph, device, commands);
            for (task, done) in graph.tasks_of(device).iter().zip(done) {
                assert_eq!(done, u32::from(task.kind != TaskKind::Stitch), "{}: {task:?}", kind.name);
            }
        }
    }
}

/// Asserts that commands follow the dependencies between the tasks of their device.
fn assert_order(name: &str, graph: &FrameGraph, device: usize, commands: &Commands) {
    let tasks = graph.tasks_of(device);
    // For each task, the index of its first and of its last command.
    let mut places = vec![None; tasks.len()];
    for (at, command) in commands.list.iter().enumerate() {
        let task = match command {
            Command::CopyOut { rows, .. } | Command::CopyIn { rows, .. } => rows.task,
            Command::Probe { task, .. } => *task,
            Command::Dispatch { begins: Some(stamp), .. } | Command::Dispatch { ends: Some(stamp), .. } => {
                commands.timed[*stamp as usize / 2].task
            }
            Command::Build { ends: Some(stamp), .. } => commands.timed[*stamp as usize / 2].task,
            _ => continue,
        };
        places[task] = Some((places[task].map_or(at, |(first, _)| first), at));
    }
    let submission = |at: usize| {
        let is_submission = |command: &Command| matches!(command, Command::Submit(_) | Command::Probe { .. });
        at + commands.list[at..].iter().position(is_submission).expect("everything is submitted")
    };
    let place = |node| {
        let task = tasks.iter().position(|task| *task == graph.dag[node]);
        task.and_then(|task| Some((task, places[task]?)))
    };
    for (from, to) in graph.dag.edge_indices().filter_map(|edge| graph.dag.edge_endpoints(edge)) {
        let (Some((task, (_, end))), Some((_, (begin, _)))) = (place(from), place(to)) else { continue };
        match tasks[task].kind {
            // The device writes rows at the start of a submission.
            TaskKind::Upload { .. } => assert!(submission(end) <= submission(begin), "{name}: {from:?} {to:?}"),
            _ => assert!(end < begin, "{name}: {from:?} {to:?}"),
        }
    }
}

#[test]
fn parts_cover_all_rows_of_all_runs_once() {
    let at = |run, row| Position { run, row };
    let ends = [at(0, 5), at(0, 8), at(2, 6), at(2, 9), at(3, 5), Position::END];
    let mut seen = vec![Vec::new(); 5];
    for pair in ends.windows(2) {
        (0..5).for_each(|run| seen[run as usize].extend(rows_in(&(pair[0]..pair[1]), &(5..9), run)));
    }
    assert_eq!(seen, vec![vec![5, 6, 7, 8]; 5]);
}
