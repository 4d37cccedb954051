//! Measures every frame while the camera follows its path, and predicts frames on other numbers of devices. There is no
//! reference.

use anyhow::Context;

use super::args::Args;
use super::arrangement::distributed;
use super::axes::FPS;
use super::findings::section;
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::options::RenderOptions;
use crate::cli::output::same_bits;
use crate::cli::page;
use crate::cli::registry::registered;
use crate::cli::settings;
use crate::cli::setup;
use crate::cli::simulate::predict;
use crate::exec::FrameReport;
use crate::loaded::LoadedScene;
use crate::passes::FrameSpec;
use crate::report::experiment::{Camera, Experiment, Found, FrameTimes, OtherMeasures};
use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::lanes::{LaneFrame, median_frame};
use crate::report::pictures::Group;
use crate::report::run::{FrameRow, RunReport, RunSettings};
use crate::report::{Axis, Chart, Series, Table, line_chart_svg};

/// Results along a path.
pub struct Followed {
    /// Results of each arrangement, in the order of [`Experiment::all`].
    pub found: Vec<Found>,
    /// Number of devices and predictions of each arrangement for them.
    pub simulated: Vec<(usize, Vec<Found>)>,
    pub run: RunReport,
    /// Plot of the makespans along the path.
    pub figure: String,
    /// Sections of the page.
    pub more: Vec<Section>,
}

/// Checks that the devices and the options of the command line suit the experiment.
pub fn check(args: &Args, experiment: &Experiment, devices: usize) -> Result<(), anyhow::Error> {
    if let Some(rule) = args.options.ratios.first().filter(|_| experiment.cameras() == [Camera::Following]) {
        let count = rule.ratios.len();
        let is_other = args.of_study().simulate.iter().any(|simulated| *simulated != count);
        anyhow::ensure!(!is_other, "--simulate: --ratios is for {count} devices: give --simulate {count}");
    }
    let is_distributed = experiment.all.iter().any(|arrangement| arrangement.distribute.is_some());
    anyhow::ensure!(
        devices > 1 || !is_distributed,
        "the experiment distributes rows over at least two devices: try --virtual 2"
    );
    Ok(())
}

/// Renders the frames of the path with all arrangements. `prepared` has their options, and `others` each arrangement's
/// measures that do not depend on frames.
pub fn measure(
    args: &Args,
    experiment: &Experiment,
    loaded: &LoadedScene,
    turns: &mut Turns,
    prepared: &[RenderOptions],
    others: Vec<OtherMeasures>,
) -> Result<Followed, Failure> {
    let (options, frames) = (&args.options, args.of_study().frames);
    let last_s = options.settings.time + f64::from(frames - 1) / FPS;
    let beyond = setup::beyond_path(&loaded.shot.rig, options.settings.time, last_s);
    loaded.scene.warnings.iter().cloned().chain(beyond).for_each(|warning| log!("warning: {warning}"));
    let mut found: Vec<Found> = others.into_iter().map(|others| Found { others, ..Found::default() }).collect();
    let mut reports: Vec<Vec<FrameReport>> = found.iter().map(|_| Vec::new()).collect();
    let mut rows: Vec<Vec<FrameRow>> = found.iter().map(|_| Vec::new()).collect();
    for i in 0..args.warm_up + frames {
        let number = i.checked_sub(args.warm_up);
        let time_s = options.settings.time + f64::from(number.unwrap_or(0)) / FPS;
        let rendered = turns.render(time_s, i)?;
        let Some(number) = number else { continue };
        for (which, report) in rendered.into_iter().enumerate() {
            let row = turns.keep(which, time_s, &report, number);
            found[which].times.push(FrameTimes::measured(&report));
            found[which].lines.push(FrameLine::from(&row));
            rows[which].push(row);
            reports[which].push(report);
        }
    }
    let model = turns.renderers.last().context("there is no arrangement")?.costs().clone();
    let spec = reports.last().and_then(|reports| reports.last()).context("there is no frame")?.spec.clone();
    let mut simulated = Vec::new();
    for devices in args.of_study().simulate {
        let program = registered().passes.program(&FrameSpec { devices, ..spec.clone() });
        let model = model.on_devices(&program, &vec![1.0; devices]);
        let mut of_count = Vec::new();
        for (arrangement, own) in experiment.all.iter().zip(prepared) {
            let own = distributed(arrangement, own.clone(), devices);
            let (graph, prediction) = predict(&own, &model)?;
            let times = vec![FrameTimes::simulated(&graph, &model, &prediction)];
            of_count.push(Found { times, ..Found::default() });
        }
        simulated.push((devices, of_count));
    }
    let names: Vec<&str> = experiment.all.iter().map(|arrangement| &arrangement.name[..]).collect();
    let more = if args.report { sections(args, loaded, turns, &names, &reports)? } else { Vec::new() };
    let (shown, devices) = (settings_of(turns, loaded), turns.renderers[0].devices());
    let mut run =
        RunReport::new(shown, devices, &loaded.scene, loaded.needs, options.settings.skip_unused, rows.concat());
    (run.warm_up_s, run.warm_up_frames) = (turns.warm_up_s, args.warm_up);
    let figure = makespans_svg(format!("{} on {} devices", options.shot, devices.len()), &names, &found)?;
    Ok(Followed { found, simulated, run, figure, more })
}

/// Returns the settings of the last arrangement.
fn settings_of(turns: &Turns, loaded: &LoadedScene) -> RunSettings {
    let (_, options) = &turns.settings[turns.settings.len() - 1];
    settings::in_force(options, loaded.exposure_ev(), &[])
}

/// Plots the frames' makespans along the path.
fn makespans_svg(title: String, names: &[&str], found: &[Found]) -> Result<String, Failure> {
    let axis = |label: &str| Axis { label: label.to_owned(), log: false };
    let line = |(name, found): (&&str, &Found)| {
        let points = (0u32..).zip(&found.times).map(|(i, frame)| (f64::from(i), frame.makespan_ms)).collect();
        Series { name: (*name).to_owned(), points, ..Series::default() }
    };
    let series: Vec<Series> = names.iter().zip(found).map(line).collect();
    let chart = Chart { title, x: axis("frame"), y: axis("makespan, ms") };
    Ok(line_chart_svg(&chart, &series).context("cannot draw the frames")?)
}

/// Returns the sections of the page: pictures, swimlanes, settings and scene.
fn sections(
    args: &Args,
    loaded: &LoadedScene,
    turns: &mut Turns,
    names: &[&str],
    reports: &[Vec<FrameReport>],
) -> Result<Vec<Section>, Failure> {
    let pictures = turns.renderers.iter_mut().map(|renderer| renderer.read_linear()).collect::<Result<Vec<_>, _>>()?;
    let [first, .., picture] = &pictures[..] else { return Ok(Vec::new()) };
    let is_same = pictures.iter().all(|picture| same_bits(first, picture));
    let note = format!(
        "The last frame. Its bytes are {} in {} arrangements.",
        if is_same { "the same" } else { "not the same" },
        if names.len() == 2 { "both" } else { "all" }
    );
    let group = Group::of_frame("last frame".to_owned(), picture, loaded.shot.exposure_ev);
    let lane = |(name, frames): (&&str, &'_ Vec<FrameReport>)| {
        let makespans_ms: Vec<f64> = frames.iter().map(|frame| frame.makespan_ms).collect();
        ((*name).to_owned(), median_frame(&makespans_ms))
    };
    let shown: Vec<_> = names.iter().zip(reports).map(lane).collect();
    let lanes = shown.into_iter().zip(reports).map(|((name, i), frames)| LaneFrame::new(name, &frames[i]));
    let lanes: Vec<LaneFrame> = lanes.collect();
    Ok(vec![
        page::pictures(note, &[group])?,
        page::swimlanes("A frame of median makespan for each arrangement.".to_owned(), &lanes, names.len() - 1)?,
        section("Settings", Vec::new(), Table::of_fields(&settings_of(turns, loaded))),
        page::scene(&args.options, loaded),
    ])
}
