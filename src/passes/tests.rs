use super::*;
use crate::graph::{Assignment, FrameGraph, HaloPlan, Stage, Stripes, Task};
use crate::projection::LogPolar;

/// A frame of 64x180 with à-trous, reprojection and an auxiliary image.
pub fn spec(devices: usize, seam: Seam) -> FrameSpec {
    let frame = FrameSpec::new(Extent::new(64, 180), devices);
    FrameSpec { filter: Some(Denoiser::ATROUS), seam, aovs: vec![Aov::Albedo], ..frame }
}

/// Returns the chain of polar images for a screen of this size.
fn polar(screen: Extent) -> ImageChain {
    ImageChain { polar: Some(PolarSpace::Visual), ..ImageChain::direct(screen) }
}

/// Returns the chain of images that are resampled from a shared projection.
fn resampled(projection: Extent, displayed: Extent, is_late: bool) -> ImageChain {
    ImageChain { display: Display::Resampled { projection, is_late }, ..ImageChain::direct(displayed) }
}

/// Frames that together have every pass.
pub fn all_specs() -> Vec<FrameSpec> {
    let mut specs = Vec::new();
    for filter in Denoiser::choices() {
        for views in [Views::Reprojected, Views::Traced] {
            for (sparse, seam) in [(false, Seam::Halo(HaloPlan::EXCHANGE)), (true, Seam::Filter), (true, Seam::None)] {
                for history_rows in [None, Some(4)] {
                    let cache = seam != Seam::None;
                    let aovs = vec![Aov::Albedo, Aov::History];
                    let frame = FrameSpec { filter, views, sparse, history_rows, cache, aovs, ..spec(2, seam) };
                    let (screen, displayed) = (Extent::new(96, 270), Extent::new(48, 135));
                    let chains = [
                        frame.chain,
                        polar(screen),
                        resampled(frame.extent, displayed, false),
                        resampled(frame.extent, displayed, true),
                        ImageChain { polar: Some(PolarSpace::Visual), ..resampled(screen, displayed, false) },
                        ImageChain { polar: Some(PolarSpace::Visual), ..resampled(screen, displayed, true) },
                    ];
                    specs.extend(chains.map(|chain| FrameSpec { chain, ..frame.clone() }));
                }
            }
        }
    }
    specs.push(FrameSpec { view_count: 4, ..spec(2, Seam::Halo(HaloPlan::EXCHANGE)) });
    for moving in [None, Some(Moving::default())] {
        let frame =
            FrameSpec { imported: true, views: Views::Traced, moving, ..spec(2, Seam::Halo(HaloPlan::EXCHANGE)) };
        specs.push(FrameSpec { filter: Some(Denoiser::SVGF), history_rows: Some(4), ..frame });
    }
    specs
}

/// Returns the distinct stages, in the order of their first pass.
fn stages(spec: &FrameSpec) -> Vec<&'static str> {
    let mut stages = Vec::new();
    for linked in Declarations::default().program(spec).passes() {
        let stage = linked.pass.stage.name();
        if !stages.contains(&stage) {
            stages.push(stage);
        }
    }
    stages
}

#[test]
fn unneeded_passes_are_omitted_with_a_reason() {
    let full = spec(2, Seam::Filter);
    assert!(stages(&full).contains(&"seam_filter"));
    assert!(!stages(&FrameSpec { devices: 1, ..full.clone() }).contains(&"seam_filter"));
    let traced = FrameSpec { views: Views::Traced, iterations: 0, aovs: Vec::new(), ..full.clone() };
    assert_eq!(stages(&traced), ["gbuffer", "path_trace", "tonemap", "tally"]);
    let sparse = FrameSpec { sparse: true, ..traced.clone() };
    assert_eq!(stages(&sparse), ["gbuffer", "select", "path_trace", "tonemap", "tally"]);
    let empty = FrameSpec { has_surfaces: false, aovs: Vec::new(), ..full };
    assert_eq!(stages(&empty), ["gbuffer", "tonemap", "tally"]);
    let why = declare(&empty).left_out;
    assert!(why.contains(&(path_trace::STAGE, Eye::LEFT, "the scene has no surfaces")), "{why:?}");
}

/// Checks that the right eye takes over filtered light only where it is reprojected and the filter leaves it alone.
#[test]
fn filtered_light_is_reused_if_the_frame_allows_it() {
    let frame = FrameSpec::new(Extent::new(64, 180), 2);
    let takes_over = |spec: &FrameSpec| stages(spec).contains(&"reproject_filtered");
    assert!(takes_over(&frame));
    assert!(!takes_over(&FrameSpec { filter_once: false, ..frame.clone() }));
    assert!(!takes_over(&FrameSpec { views: Views::Traced, ..frame.clone() }));
    assert!(!takes_over(&FrameSpec { filter: Some(Denoiser::ATROUS), ..frame.clone() }));
    assert!(!takes_over(&FrameSpec { iterations: 0, ..frame }));
}

/// Checks that history lengths take one pass per view, of the right kernel, and only if they are requested.
#[test]
fn history_lengths_take_one_pass_if_requested() {
    let kernels = |spec: &FrameSpec| -> Vec<&str> {
        let passes = declare(spec).passes;
        let counted: Vec<_> = passes.iter().filter(|pass| pass.stage == auxiliary::STAGES[0]).collect();
        let plain = FrameSpec { aovs: Vec::new(), ..spec.clone() };
        assert_eq!(passes.len(), declare(&plain).passes.len() + counted.len());
        counted.iter().map(|pass| pass.kernel.name).collect()
    };
    let frame = FrameSpec { aovs: vec![Aov::History], ..FrameSpec::new(Extent::new(64, 180), 2) };
    assert_eq!(kernels(&frame), ["history_length", "reproject_history_length"]);
    assert_eq!(kernels(&FrameSpec { filter_once: false, ..frame.clone() }), ["history_length"; 2]);
    assert_eq!(kernels(&FrameSpec { filter: Some(Denoiser::BMFR), ..frame.clone() }), ["history_length"; 2]);
    assert_eq!(kernels(&FrameSpec { filter: Some(Denoiser::ATROUS), ..frame.clone() }), ["aov"; 2]);
    assert_eq!(kernels(&FrameSpec { aovs: Vec::new(), ..frame }), [""; 0]);
}

/// Checks that dynamic scenes have motion passes, and static scenes have none.
#[test]
fn motion_passes_exist_only_in_dynamic_scenes() {
    let all = |frame: &FrameSpec| -> Vec<&str> { declare(frame).passes.iter().map(|pass| pass.stage.name()).collect() };
    let passes = |frame: &FrameSpec| -> Vec<&str> {
        let of_motion = ["skin", "refit", "motion", "gradient", "gradient_smooth"];
        all(frame).into_iter().filter(|stage| of_motion.contains(stage)).collect()
    };
    let still = FrameSpec { filter: Some(Denoiser::SVGF), ..spec(2, Seam::Filter) };
    assert_eq!(passes(&still), [""; 0]);
    let why = declare(&still).left_out;
    for stage in ["skin", "refit", "motion"] {
        assert!(why.contains(&(Stage(stage), Eye::LEFT, "nothing in the scene moves")), "{why:?}");
    }
    let rigid = FrameSpec { moving: Some(Moving::default()), ..still.clone() };
    assert_eq!(passes(&rigid), ["motion", "motion", "gradient", "gradient_smooth"]);
    let deforming = Moving { triangles: 1, nodes: 1, levels: vec![1], ..Moving::default() };
    let deforming = FrameSpec { moving: Some(deforming), ..still };
    assert_eq!(passes(&deforming), ["skin", "refit", "motion", "motion", "gradient", "gradient_smooth"]);
    assert_eq!(all(&deforming)[..3], ["skin", "refit", "gbuffer"]);
    let unfiltered = FrameSpec { filter: Some(Denoiser::ATROUS), ..deforming };
    assert_eq!(passes(&unfiltered), ["skin", "refit"]);
}

/// Checks that devices rebuild their acceleration structures for any dynamic geometry, and that no pass refits trees.
#[test]
fn hardware_traversal_builds_structures_without_refit() {
    let declared = |moving| {
        let frame = declare(&FrameSpec { moving: Some(moving), ..spec(2, Seam::Filter) });
        let once = frame.passes.into_iter().filter(|pass| pass.scope == Scope::Device);
        once.map(|pass| (pass.stage.name(), pass.builds_from.map(|vertices| vertices.name))).collect::<Vec<_>>()
    };
    let lights = Moving { hardware: true, ..Moving::default() };
    let rigid = Moving { bodies: true, ..lights.clone() };
    let deforming = Moving { triangles: 1, vertices: 3, nodes: 1, levels: vec![1], ..rigid.clone() };
    assert_eq!(declared(lights), []);
    assert_eq!(declared(Moving { hardware: false, ..rigid.clone() }), []);
    assert_eq!(declared(rigid), [("skin", Some("skinned"))]);
    assert_eq!(declared(Moving { hardware: false, ..deforming.clone() }), [("skin", None), ("refit", None)]);
    assert_eq!(declared(deforming), [("skin", Some("skinned"))]);
}

#[test]
fn partition_names_are_stable() {
    let names: Vec<&str> = partitions().iter().map(|g| g.0).collect();
    assert_eq!(
        names,
        ["gbuffer", "path_trace", "reproject", "tonemap", "to_screen", "to_eye", "to_later_eye", "denoise"]
    );
}

/// Checks that display resampling comes last, and that the filtered image is not an output.
#[test]
fn display_resampling_comes_last() {
    let shown = Extent::new(72, 80);
    let frame = FrameSpec { iterations: 0, aovs: Vec::new(), ..spec(2, Seam::Filter) };
    let rectified = FrameSpec { chain: resampled(frame.extent, shown, false), ..frame };
    assert!(stages(&rectified).ends_with(&["tonemap", "to_eye", "tally"]), "{:?}", stages(&rectified));
    let program = Declarations::default().program(&rectified);
    let extent = |name| {
        let image = program.images().iter().find(|image| image.resource.name == name).unwrap();
        image.resource.extent(rectified.extent)
    };
    assert_eq!([extent("linear"), extent("display"), extent("rectified")], [shown, shown, rectified.extent]);
}

/// Checks that late reprojection of both eyes comes last, whatever else a frame does: the pose is sampled right before
/// it.
#[test]
fn late_reprojection_comes_last() {
    let frame = spec(2, Seam::Filter);
    let late = FrameSpec { chain: resampled(frame.extent, Extent::new(72, 80), true), cache: true, ..frame };
    let passes = declare(&late).passes;
    let (first, last) = passes.split_at(passes.len() - 4);
    let names: Vec<_> = last.iter().map(|pass| (pass.stage.name(), pass.view)).collect();
    let of = |view| [("to_later_eye", view), ("aov_to_later_eye", view)];
    assert_eq!(names, [of(Eye::LEFT), of(Eye::RIGHT)].concat());
    assert!(
        first.iter().all(|pass| pass.partition != LATE_PARTITION)
            && last.iter().all(|pass| pass.partition == LATE_PARTITION)
    );
}

/// Checks that only the primary runs late reprojection if its rows are gathered there.
#[test]
fn gathered_partition_runs_on_the_primary_alone() {
    let frame = spec(3, Seam::Filter);
    let late = FrameSpec { chain: resampled(frame.extent, Extent::new(72, 80), true), ..frame };
    let even = Assignment::uniform(Stripes::even(180, 2)).renumbered(&[1, 2], 3);
    let mut gathered = even.clone();
    gathered.gather(LATE_PARTITION);
    let program = Declarations::default().program(&late);
    let devices = |assignment: &Assignment| {
        let graph = FrameGraph::build(&program, assignment, None);
        let is_late = |task: &&Task| graph.pass(task).is_some_and(|linked| linked.pass.partition == LATE_PARTITION);
        let mut devices: Vec<_> = graph.dag.node_weights().filter(is_late).map(|task| task.device).collect();
        devices.sort_unstable();
        devices.dedup();
        devices
    };
    assert_eq!([devices(&even), devices(&gathered)], [vec![1, 2], vec![1]]);
}

#[test]
fn polar_images_are_mapped_to_the_screen() {
    let screen = Extent::new(96, 270);
    let chain = polar(screen);
    let polar = FrameSpec { chain, iterations: 0, aovs: Vec::new(), ..spec(2, Seam::Filter) };
    assert!(stages(&polar).ends_with(&["tonemap", "polar_blur", "to_screen", "tally"]), "{:?}", stages(&polar));
    let unblurred = Some(PolarSpace::Log(LogPolar { blur: false, ..LogPolar::COMPOSITE }));
    let sharp = FrameSpec { chain: ImageChain { polar: unblurred, ..chain }, ..polar.clone() };
    assert!(stages(&sharp).ends_with(&["tonemap", "to_screen", "tally"]), "{:?}", stages(&sharp));
    let program = Declarations::default().program(&polar);
    let outputs: Vec<_> = program.outputs().map(|number| program.images()[number].resource).collect();
    let extents = |name| outputs.iter().find(|image| image.name == name).map(|image| image.extent(program.extent));
    assert_eq!([extents("linear"), extents("display"), extents("polar")], [Some(screen), Some(screen), None]);
    // The screen may be the shared (rectified) projection.
    let chain = ImageChain { polar: chain.polar, ..resampled(screen, Extent::new(48, 135), false) };
    let shown = FrameSpec { chain, aovs: vec![Aov::Albedo], ..polar };
    let last = ["tonemap", "polar_blur", "to_screen", "to_eye", "tally", "aov", "aov_to_screen", "aov_to_eye"];
    assert!(stages(&shown).ends_with(&last), "{:?}", stages(&shown));
    let program = Declarations::default().program(&shown);
    let images = program.images().iter().map(|image| (image.resource.name, image.resource.extent(program.extent)));
    let extents: Vec<_> = images.filter(|(name, _)| name.starts_with("rectified")).collect();
    let rectified = ["rectified", "rectified_display", "rectified_aov"].map(|name| (name, screen));
    assert_eq!(extents, rectified);
}

/// Checks margins: the fit reads whole blocks, which reach 31 rows beyond a stripe, and TAA needs one more fitted row.
#[test]
fn fit_reads_whole_blocks_beyond_a_stripe() {
    let halo = Seam::Halo(HaloPlan::RECOMPUTE);
    let frame = FrameSpec { filter: Some(Denoiser::BMFR), history_rows: Some(3), aovs: Vec::new(), ..spec(2, halo) };
    let program = Declarations::default().program(&frame);
    let of = |stage| program.passes().iter().find(|linked| linked.pass.stage == Stage(stage)).unwrap();
    assert_eq!((of("fit").pass.halo_rows(), of("fit").margin_rows), (31, 1));
    assert_eq!((of("accumulate_fitted").margin_rows, of("resolve").margin_rows), (1, 0));
    let filter = ["accumulate", "fit", "accumulate_fitted", "compose", "resolve", "tally"];
    assert!(stages(&frame).ends_with(&filter), "{:?}", stages(&frame));
    let apart = FrameSpec { seam: Seam::None, ..frame };
    let program = Declarations::default().program(&apart);
    assert!(program.passes().iter().all(|linked| linked.pass.halo_rows() == 0));
}

/// Checks that tracing and filter are partitioned separately, since all devices finish tracing before a filter reads
/// its neighbours' rows.
#[test]
fn tracing_and_filter_have_separate_partitions() {
    let sets = |spec: &FrameSpec| {
        let names = |set: &Vec<Partition>| set.iter().map(|g| g.0).collect::<Vec<_>>();
        Declarations::default().program(spec).partition_sets().iter().map(names).collect::<Vec<_>>()
    };
    let halo = Seam::Halo(HaloPlan::RECOMPUTE);
    let cut = [vec!["gbuffer", "path_trace", "reproject"], vec!["denoise", "tonemap"]];
    for filter in [Denoiser::ATROUS, Denoiser::SVGF, Denoiser::BMFR] {
        assert_eq!(sets(&FrameSpec { filter: Some(filter), ..spec(2, halo) }), cut);
    }
    let cached = FrameSpec { filter: Some(Denoiser::SVGF), cache: true, ..spec(2, halo) };
    assert_eq!(sets(&cached), cut);
    let one = [vec!["gbuffer", "path_trace", "reproject", "tonemap"]];
    assert_eq!(sets(&FrameSpec { filter: None, ..spec(2, halo) }), one);
}
