//! `diptych bench --experiment`: arrangements of options that take turns, as described by a file.

use std::path::Path;

use anyhow::{Context, anyhow, bail};
use clap::{Args as _, Command, FromArgMatches as _};
use toml::Value;

use crate::device::DeviceInfo;
use crate::quality::Quality;
use crate::report::Table;
use crate::report::csv::{Column, Csv};
use crate::report::experiment::{Arrangement, Experiment, ExperimentRow};
use crate::report::frames::FrameLine;

use super::args::Args;
use super::findings::{Findings, section};
use super::judge::Judge;
use super::over_shots::over_shots;
use super::reference::own;
use super::turns::Turns;
use crate::cli::failure::Failure;
use crate::cli::interrupt;
use crate::cli::options::{RenderOptions, RunOptions};
use crate::cli::progress::Progress;
use crate::cli::setup::{self, Tracing};

pub const REFUSES: &[&str] = &["size_factor", "instants", "frames", "simulate", "fresh"];

/// Options of an arrangement: those that determine the quality of frames.
const OPTIONS: [&str; 7] = ["spp", "bounces", "render-scale", "denoiser", "foveation", "polar", "iterations"];

/// Runs the experiment of a file.
pub fn run_file(args: &Args, path: &Path) -> Result<(), Failure> {
    let name = path.display();
    let read = || {
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read the experiment {name}"))?;
        Experiment::parse(&text).map_err(|e| anyhow!("{name} is not a valid experiment: {e}"))
    };
    let experiment = read().map_err(Failure::Input)?;
    run(args, &experiment, "experiment.csv").map_err(|failure| match failure {
        Failure::Input(e) => Failure::Input(e.context(format!("experiment {name}"))),
        other => other,
    })
}

/// Runs an experiment, and writes its table to the file `csv`.
pub fn run(args: &Args, experiment: &Experiment, csv: &'static str) -> Result<(), Failure> {
    let arranged = experiment.arrangements.iter().map(|a| options(a, &args.options));
    let arranged = arranged.collect::<Result<Vec<_>, _>>().map_err(Failure::Input)?;
    // All take as many warm-up frames as the arrangement that needs most.
    let qualities = arranged.iter().map(RenderOptions::quality);
    let longest = qualities.max_by_key(|quality| args.warm_up_of(quality)).unwrap_or_default();
    // The reference has the bounces of the arrangement that has most.
    let bounces = arranged.iter().map(|options| options.bounces).max().into_iter().collect();
    let args = &Args { bounces, ..args.clone() };
    let frames = u64::from(args.frames_of(&longest)) * arranged.len() as u64;
    let mut found =
        Results { experiment, longest, rows: Vec::new(), frames: Vec::new(), devices: Vec::new(), notes: Vec::new() };
    over_shots(args, frames, |args, progress, tracing| found.measure(args, progress, tracing))?;
    found.write(args, csv)
}

/// Returns the options of an arrangement on the shot of `run`.
fn options(Arrangement { name, options }: &Arrangement, run: &RunOptions) -> Result<RenderOptions, anyhow::Error> {
    let mut typed = vec!["arrangement".to_owned(), run.shot.clone(), "--out".to_owned(), ".".to_owned()];
    for (key, value) in options {
        let key = key.replace('_', "-");
        if !OPTIONS.contains(&key.as_str()) {
            bail!("arrangement {name:?}: the option {key:?} is none of {}", OPTIONS.join(", "));
        }
        typed.extend([
            format!("--{key}"),
            text(value).with_context(|| format!("arrangement {name:?}, option {key:?}"))?,
        ]);
    }
    let parse = || {
        let matches = RenderOptions::augment_args(Command::new("arrangement")).try_get_matches_from(&typed)?;
        RenderOptions::from_arg_matches(&matches)
    };
    // clap's message has hints for command lines after its first line.
    let parsed =
        parse().map_err(|e| anyhow!("arrangement {name:?}: {}", e.to_string().lines().next().unwrap_or_default()));
    let options = RenderOptions { run: run.clone(), ..parsed? };
    options.foveated.check(options.denoiser).with_context(|| format!("arrangement {name:?}"))?;
    Ok(options)
}

/// Returns a value as it is typed on the command line.
fn text(value: &Value) -> Result<String, anyhow::Error> {
    Ok(match value {
        Value::String(text) => text.clone(),
        Value::Integer(number) => number.to_string(),
        Value::Float(number) => number.to_string(),
        Value::Array(values) => values.iter().map(text).collect::<Result<Vec<_>, _>>()?.join(","),
        _ => bail!("{value} is neither text, a number nor a list"),
    })
}

struct Results<'a> {
    experiment: &'a Experiment,
    /// The quality with the longest warm-up.
    longest: Quality,
    rows: Vec<ExperimentRow>,
    /// Timed frames, each with its shot and arrangement.
    frames: Vec<([String; 2], FrameLine)>,
    devices: Vec<DeviceInfo>,
    /// A note on each reference.
    notes: Vec<String>,
}

impl Results<'_> {
    /// Measures all arrangements on the shot of `args`.
    fn measure(&mut self, args: &Args, progress: &Progress, tracing: &Tracing) -> Result<(), Failure> {
        let run = &args.options;
        let loaded = setup::load(run)?;
        let reference = own(args, &loaded, tracing, None)?;
        interrupt::check()?;
        self.notes.push(reference.note(&run.shot, run.size));
        let arrangements = &self.experiment.arrangements;
        let mut turns = Turns::new(&loaded, progress, tracing, self.rows.len());
        for arrangement in arrangements {
            let gpus = setup::open_devices(run, usize::from(args.virtual_devices))?;
            let options = options(arrangement, run).map_err(Failure::Input)?;
            turns.add(format!("{} of {}", arrangement.name, run.shot), options, gpus)?;
        }
        let mut judges: Vec<_> = arrangements.iter().map(|_| Judge::new(&loaded, &reference, run.time)).collect();
        for i in 0..args.frames_of(&self.longest) {
            let time_s = args.time_s(&self.longest, i);
            let frames = turns.render(time_s, i)?;
            let Some(number) = i.checked_sub(args.warm_up_of(&self.longest)) else { continue };
            for (which, frame) in frames.iter().enumerate() {
                let row = turns.keep(which, time_s, frame, number);
                judges[which].add(frame, &row, &turns.renderers[which].read_linear()?)?;
            }
        }
        for (arrangement, judge) in arrangements.iter().zip(judges) {
            let measured = judge.conclude();
            let of = [run.shot.clone(), arrangement.name.clone()];
            self.frames.extend(measured.frames.iter().map(|line| (of.clone(), line.clone())));
            self.rows.push(self.experiment.measured(&run.shot, &arrangement.name, &measured));
        }
        self.devices = turns.renderers[0].devices().to_vec();
        Ok(())
    }

    fn write(mut self, args: &Args, csv: &'static str) -> Result<(), Failure> {
        let experiment = self.experiment;
        for column in experiment.empty_columns(&self.rows) {
            eprintln!("warning: no arrangement has any stage of the column {column}");
        }
        self.rows.extend(experiment.cited());
        let (of, lines): (Vec<_>, Vec<_>) = self.frames.into_iter().unzip();
        let columns: [Column<[String; 2]>; 2] = [("shot", |[shot, _]| shot.clone()), ("", |[_, name]| name.clone())];
        let mut named = Csv::new(&columns, &of);
        named.columns[1].clone_from(&experiment.key);
        let notes = [experiment.caption.clone()].into_iter().chain(self.notes).collect();
        Findings {
            title: format!("{}, at {}", experiment.title, args.options.size),
            rows: &experiment.json(&self.rows),
            files: vec![(csv, experiment.csv(&self.rows)), ("frames.csv", named.beside(FrameLine::csv(&lines)))],
            run: None,
            tables: vec![section("Arrangements", notes, experiment.table(&self.rows))],
            more: vec![section("Devices", Vec::new(), Table::of_devices([&self.devices[..]]))],
        }
        .write(args)
    }
}
