//! `diptych bench --preset leria`: compares two ways to distribute frames over the same devices, called arrangements.
//! One distributes every stage, the other only path tracing. They take turns to render the frames of a path.

use anyhow::{Context, anyhow};

use crate::exec::FrameReport;
use crate::loaded::LoadedScene;
use crate::passes::{gbuffer, partitions, path_trace};
use crate::quality::{Denoiser, Quality};
use crate::report::csv::Column;
use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::lanes::{LaneFrame, median_frame};
use crate::report::leria::{
    ARRANGEMENTS, FrameTimes, MAKESPAN_NOTE, Run, STAGE_NOTE, leria_csv, makespan_table, rows, stage_table,
};
use crate::report::pictures::Group;
use crate::report::run::{FrameRow, RunReport};
use crate::report::{Csv, Table};
use crate::scene::rig::Eye;
use crate::schedule::{CostModel, RatioRule};

use super::args::Args;
use super::findings::{Findings, section};
use super::preset::refuse;
use super::turns::Turns;
use crate::cli::balance::Balance;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::output::{self, same_bits};
use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::settings;
use crate::cli::setup::{self, Tracing};
use crate::cli::simulate::predict;

const REFUSES: &[&str] = &[
    "shots",
    "size_factor",
    "instants",
    "repeats",
    "quick",
    "fresh",
    "reference_spp",
    "reference_time_limit",
    "reference_dir",
];

/// Frame rate along the camera path, Hz.
const FPS: f64 = 72.0;

/// Returns the options of the proposed arrangement: even stripes by default, as in the paper.
fn proposed(args: &Args) -> RenderOptions {
    let mut run: RunOptions = args.options.clone();
    if run.balance.is_empty() && run.ratios.is_empty() {
        run.balance = vec![Balance::Even];
    }
    let denoiser = Some(Denoiser::SVGF);
    let iterations = [Denoiser::DEFAULT_ITERATIONS; 3];
    let quality = Quality { spp: 1, bounces: 6, denoiser, iterations, fovea: None, polar: None, scale: 1.0 };
    RenderOptions { frames: args.warm_up + args.preset.frames, fps: FPS, ..RenderOptions::single(run, &quality) }
}

/// Returns the options of the baseline: only path tracing and its G-buffer are distributed over the devices, by
/// --ratios or evenly. The primary runs everything else.
fn baseline(proposed: &RenderOptions, devices: usize) -> RenderOptions {
    let mut options = proposed.clone();
    let run = &mut options.run;
    run.balance = vec![Balance::Static];
    let on_primary: Vec<f64> = (0..devices).map(|device| if device == 0 { 1.0 } else { 0.0 }).collect();
    for group in partitions() {
        for view in Eye::ALL {
            let is_traced = view == Eye::Left || !run.reprojects();
            if !(is_traced && [gbuffer::PARTITION, path_trace::PARTITION].contains(&group)) {
                let ratios = on_primary.clone();
                run.ratios.push(RatioRule { group: Some(group), view: Some(view), ratios });
            }
        }
    }
    options
}

pub fn run(args: &Args) -> Result<(), Failure> {
    refuse("--preset leria", REFUSES.iter().copied())?;
    let options = proposed(args);
    options.check().map_err(Failure::Input)?;
    let simulated = args.preset.simulated();
    if let Some(rule) = options.ratios.first().filter(|rule| simulated.iter().any(|n| *n != rule.ratios.len())) {
        let count = rule.ratios.len();
        return Err(Failure::Input(anyhow!("--simulate: --ratios is for {count} devices: give --simulate {count}")));
    }
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(&options)?;
    let open = || setup::open_devices(&options, usize::from(args.virtual_devices));
    let gpus = open()?;
    let devices = gpus.len();
    if devices < 2 {
        return Err(Failure::Input(anyhow!(
            "--preset leria distributes rows over at least two devices: try --virtual 2"
        )));
    }
    let loaded = setup::load(&options)?;
    for warning in &loaded.scene.warnings {
        eprintln!("warning: {warning}");
    }
    let last_s = options.time + f64::from(args.preset.frames - 1) / FPS;
    if let Some(warning) = setup::beyond_path(&loaded.shot.rig, options.time, last_s) {
        eprintln!("warning: {warning}");
    }
    let steps = 2 * u64::from(options.frames);
    let progress = Progress::new(steps, options.quiet, options.json);
    let mut turns = Turns::new(&loaded, &progress, &tracing, 0);
    let [base, shared] = ARRANGEMENTS.map(str::to_owned);
    turns.add(base, baseline(&options, devices), gpus)?;
    turns.add(shared, options.clone(), open()?)?;
    let found = Study { args, options: &options, loaded: &loaded, turns }.measure()?;
    progress.finish();
    found.write()?;
    tracing.finish()
}

struct Study<'a> {
    args: &'a Args,
    options: &'a RenderOptions,
    loaded: &'a LoadedScene,
    turns: Turns<'a>,
}

/// Results of the study.
struct Results<'a> {
    study: Study<'a>,
    /// The measured run, followed by the simulated ones.
    runs: Vec<Run>,
    /// Reports of the measured frames, by arrangement.
    frames: [Vec<FrameReport>; 2],
    rows: [Vec<FrameRow>; 2],
}

impl<'a> Study<'a> {
    fn measure(mut self) -> Result<Results<'a>, Failure> {
        let (mut frames, mut rows) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        for i in 0..self.options.frames {
            let number = i.checked_sub(self.args.warm_up);
            let time_s = self.options.time + f64::from(number.unwrap_or(0)) / FPS;
            let reports = self.turns.render(time_s, i)?;
            let Some(number) = number else { continue };
            for (which, report) in reports.into_iter().enumerate() {
                rows[which].push(self.turns.keep(which, time_s, &report, number));
                frames[which].push(report);
            }
        }
        let times = |frames: &Vec<FrameReport>| frames.iter().map(FrameTimes::measured).collect();
        let mut runs = vec![self.run("measured", frames[0][0].devices.len(), frames.each_ref().map(times))];
        let model = self.turns.renderers[1].costs().clone();
        for devices in self.args.preset.simulated() {
            let model = model.on_devices(&vec![1.0; devices]);
            let baseline = self.simulated(&baseline(self.options, devices), &model)?;
            let proposed = self.simulated(self.options, &model)?;
            runs.push(self.run("simulated", devices, [vec![baseline], vec![proposed]]));
        }
        Ok(Results { study: self, runs, frames, rows })
    }

    fn run(&self, source: &'static str, devices: usize, frames: [Vec<FrameTimes>; 2]) -> Run {
        Run { source, shot: self.options.shot.clone(), devices, frames }
    }

    fn simulated(&self, options: &RenderOptions, model: &CostModel) -> Result<FrameTimes, Failure> {
        let (graph, prediction) = predict(options, model)?;
        Ok(FrameTimes::simulated(&graph, model, &prediction))
    }
}

impl Results<'_> {
    fn write(mut self) -> Result<(), Failure> {
        let more = if self.study.args.report { self.page()? } else { Vec::new() };
        let Self { study: Study { args, options, loaded, turns }, runs, rows: frames, .. } = self;
        let rows = rows(&runs);
        let mut makespans = section("Makespan", vec![MAKESPAN_NOTE.to_owned()], makespan_table(&rows));
        makespans.figure = Some(runs[0].svg().context("cannot draw the frames")?);
        let stages = section("Stages", vec![STAGE_NOTE.to_owned()], stage_table(&runs));
        let names = ARRANGEMENTS.into_iter().zip(&frames).flat_map(|(name, of)| vec![name; of.len()]);
        let arrangement: [Column<&str>; 1] = [("arrangement", |name| (*name).to_owned())];
        let names = Csv::new(&arrangement, &names.collect::<Vec<_>>());
        let frames = frames.concat();
        let lines = names.beside(FrameLine::csv_of(&frames));
        let (settings, skips) = (settings::in_force(options, loaded.exposure_ev(), &[]), !options.no_skip);
        let devices = turns.renderers[1].devices();
        let mut run = RunReport::new(settings, devices, &loaded.scene, loaded.needs, skips, frames);
        (run.warm_up_s, run.warm_up_frames) = (turns.warm_up_s, args.warm_up);
        Findings {
            title: format!("Distributed stages, after Leria et al.: {} at {}", options.shot, options.size),
            rows: &rows,
            files: vec![("leria.csv", leria_csv(&rows)), ("frames.csv", lines)],
            run: Some(run),
            tables: vec![makespans, stages],
            more,
        }
        .write(args)
    }

    fn page(&mut self) -> Result<Vec<Section>, Failure> {
        let Study { options, loaded, turns, .. } = &mut self.study;
        let picture = turns.renderers[1].read_linear()?;
        let is_same = same_bits(&turns.renderers[0].read_linear()?, &picture);
        let note = format!(
            "The last frame. Its bytes are {} in both arrangements.",
            if is_same { "the same" } else { "not the same" }
        );
        let pictures =
            page::pictures(note, &[Group::of_frame("last frame".to_owned(), &picture, loaded.shot.exposure_ev)])?;
        let frame = |(name, frames): (&str, &'_ Vec<FrameReport>)| {
            let makespans_ms: Vec<f64> = frames.iter().map(|f| f.makespan_ms).collect();
            (name.to_owned(), median_frame(&makespans_ms))
        };
        let shown: Vec<_> = ARRANGEMENTS.into_iter().zip(&self.frames).map(frame).collect();
        let lanes = shown.into_iter().zip(&self.frames).map(|((name, i), frames)| LaneFrame::new(name, &frames[i]));
        let lanes: Vec<LaneFrame> = lanes.collect();
        let lanes = page::swimlanes("A frame of median makespan for each arrangement.".to_owned(), &lanes, 1)?;
        let settings = Table::of_fields(&settings::in_force(options, loaded.exposure_ev(), &[]));
        let devices = Table::of_devices([turns.renderers[1].devices()]);
        let [settings, devices] = [section("Settings", Vec::new(), settings), section("Devices", Vec::new(), devices)];
        Ok(vec![pictures, lanes, settings, devices, page::scene(options, loaded)])
    }
}
