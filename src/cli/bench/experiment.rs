//! `diptych bench --experiment` and the presets that are files: arrangements of options that take turns. The camera
//! moves along its path and rests, and each arrangement is compared with the reference.

use std::path::Path;

use anyhow::{Context, anyhow};

use crate::device::DeviceInfo;
use crate::quality::Quality;
use crate::report::experiment::{Beside, Experiment, FOVEA, Row};
use crate::report::frames::FrameLine;
use crate::report::pictures::Group;
use crate::report::{Csv, Table};

use super::args::Args;
use super::arrangement;
use super::findings::{Findings, section};
use super::judge::Judge;
use super::moving_gaze::with_moving_gaze;
use super::over_shots::over_shots;
use super::reference::own;
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::RenderOptions;
use crate::cli::page;
use crate::cli::progress::Progress;
use crate::cli::settings::Given;
use crate::cli::setup::{self, Tracing};

/// Options that no experiment of a file accepts.
pub const REFUSES: &[&str] = &["size_factor", "instants", "frames", "simulate", "fresh"];

/// Runs the experiment in a file.
pub fn run_file(args: &Args, path: &Path) -> Result<(), Failure> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read '{}'", path.display()));
    run_text(args, &text.map_err(Failure::Input)?, &path.display().to_string())
}

/// Runs an experiment from its text, the contents of the file `origin`.
pub fn run_text(args: &Args, text: &str, origin: &str) -> Result<(), Failure> {
    let experiment = Experiment::parse(text).map_err(|reason| Failure::Input(anyhow!("{origin}: {reason}")))?;
    let all = arrangement::of(&experiment, &args.options).with_context(|| format!("{origin}: wrong options"));
    let all = all.map_err(Failure::Input)?;
    // Tables keep the names until the process ends.
    let experiment: &'static Experiment = Box::leak(Box::new(experiment));
    let is_typed = |id| Given::here().and_then(|given| given.typed(id)).is_some();
    let mut args = args.clone();
    args.warm_up = experiment.frames.warm_up.filter(|_| !is_typed("warm_up")).unwrap_or(args.warm_up);
    args.repeats = experiment.frames.repeats.filter(|_| !is_typed("repeats")).unwrap_or(args.repeats);
    run(&args, experiment, &all)
}

fn run(args: &Args, experiment: &'static Experiment, all: &[RenderOptions]) -> Result<(), Failure> {
    let mut found = Found::new(experiment);
    let parts = if experiment.has_any(&FOVEA) { 2 } else { 1 };
    let frames = parts * u64::from(args.frames_of(&slowest(args, all))) * all.len() as u64;
    over_shots(args, frames, |args, progress, tracing| found.measure(args, progress, tracing))?;
    found.write(args)
}

/// Returns the quality with the most warm-up frames, of which all arrangements render as many.
fn slowest(args: &Args, all: &[RenderOptions]) -> Quality {
    let qualities = all.iter().map(RenderOptions::quality);
    qualities.max_by_key(|quality| args.warm_up_of(quality)).unwrap_or(arrangement::QUALITY)
}

struct Found {
    experiment: &'static Experiment,
    rows: Vec<Row>,
    /// Timed frames, each with its shot and arrangement.
    frames: Vec<([String; 2], FrameLine)>,
    devices: Vec<DeviceInfo>,
    /// A note on each reference.
    notes: Vec<String>,
    /// Pictures of the last frame of each row, for the page.
    pictures: Vec<Group>,
}

impl Found {
    fn new(experiment: &'static Experiment) -> Self {
        let (rows, frames, devices, notes, pictures) = Default::default();
        Self { experiment, rows, frames, devices, notes, pictures }
    }

    /// Measures all arrangements on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let (options, experiment) = (&args.options, self.experiment);
        let loaded = setup::load(options)?;
        let reference = own(args, &loaded, tracing, None)?;
        interrupt::check()?;
        self.notes.push(reference.note(&options.shot, options.size));
        let arranged = arrangement::of(experiment, options).map_err(Failure::Input)?;
        let of_all = slowest(args, &arranged);
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        let mut beside = Vec::new();
        for (arrangement, mut own) in experiment.all.iter().zip(arranged) {
            beside.push(match arrangement.as_visual_polar {
                true => arrangement::sample_as_visual_polar(&mut own, &loaded),
                false => Beside::new(),
            });
            let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
            turns.add(format!("{} of {}", arrangement.name, options.shot), own, gpus)?;
        }
        let mut judges: Vec<Judge> = beside.iter().map(|_| Judge::new(&loaded, &reference, options.time)).collect();
        let (warm_up, all) = (args.warm_up_of(&of_all), args.frames_of(&of_all));
        for i in 0..all {
            let time_s = args.time_s(&of_all, i);
            let frames = turns.render(time_s, i)?;
            let Some(number) = i.checked_sub(warm_up) else { continue };
            for (which, frame) in frames.iter().enumerate() {
                let row = turns.keep(which, time_s, frame, number);
                let image = turns.renderers[which].read_linear()?;
                judges[which].add(frame, &row, &image)?;
                for (name, paths) in ["paths_left", "paths_right"].into_iter().zip(turns.paths(which, time_s, frame)) {
                    *beside[which].entry(name).or_default() += paths / f64::from(all - warm_up);
                }
                if args.report && i + 1 == all {
                    let name = format!("{} of {}", experiment.all[which].name, options.shot);
                    self.pictures.push(page::against(name, &image, &reference.images, &loaded)?);
                }
            }
        }
        if experiment.has_any(&FOVEA) {
            let foveae = with_moving_gaze(options, &loaded, &reference, &mut turns, [warm_up, all])?;
            for (beside, fovea) in beside.iter_mut().zip(foveae) {
                beside.extend(FOVEA.into_iter().zip(fovea).filter_map(|(name, value)| Some((name, value?))));
            }
        }
        let measured: Vec<_> = judges.into_iter().map(Judge::conclude).zip(beside).collect();
        for (arrangement, (measured, _)) in experiment.all.iter().zip(&measured) {
            let of = [options.shot.clone(), arrangement.name.clone()];
            self.frames.extend(measured.frames.iter().map(|line| (of.clone(), line.clone())));
        }
        self.rows.extend(experiment.measured(&options.shot, &measured));
        self.devices = turns.renderers[0].devices().to_vec();
        Ok(())
    }

    fn write(mut self, args: &Args) -> Result<(), Failure> {
        let experiment = self.experiment;
        self.rows.extend(experiment.cited());
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns = vec!["shot".to_owned(), experiment.arrangements.clone()];
        let frames = Csv { columns, lines: of.into_iter().map(Vec::from).collect() }.beside(FrameLine::csv(&lines));
        let mut more = vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))];
        if args.report {
            let note = "The last frame of each arrangement and its FLIP against the reference.";
            more.insert(0, page::pictures(note.to_owned(), &self.pictures)?);
        }
        let file = format!("{}.csv", experiment.name);
        let notes = experiment.notes().into_iter().chain(self.notes).collect();
        Findings {
            title: format!("{}, at {}", experiment.title, args.options.size),
            rows: &self.rows.iter().map(|row| experiment.json(row)).collect::<Vec<_>>(),
            files: vec![(&file, experiment.csv(&self.rows)), ("frames.csv", frames)],
            run: None,
            tables: vec![section(&experiment.heading, notes, experiment.table(&self.rows))],
            more,
        }
        .write(args)
    }
}
