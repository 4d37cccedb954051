//! `diptych bench`: run time against error over a grid of settings.

mod peres;
mod seams;
mod timed;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context;
use clap::ValueEnum;

use diptych::accumulation::Noise;
use diptych::device::DeviceInfo;
use diptych::exec::{FrameReport, Stereo};
use diptych::image::{RgbImage, exr};
use diptych::metrics;
use diptych::report::Table;
use diptych::report::bench::{Row, Slope, csv, mark_front, slopes, svg, table};
use diptych::report::html::Section;
use diptych::trace::frames::record_devices;

use super::failure::Failure;
use super::faults::refuse_faults;
use super::interrupt;
use super::options::{Denoiser, RenderOptions, RunOptions, Switch};
use super::output;
use super::progress::Progress;
use super::reference::{PASS_SPP, PassOptions, Plan, seconds};
use super::setup::{self, Loaded, Tracing};

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    #[command(flatten)]
    options: RunOptions,
    /// Virtual devices on each chosen adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    virtual_devices: u16,
    /// Samples per pixel to measure
    #[arg(long, value_delimiter = ',', default_value = "1,2,4,8,16,32,64", value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    spp: Vec<u32>,
    /// Denoisers to measure [default: all]
    #[arg(long, value_delimiter = ',', value_name = "LIST")]
    denoiser: Vec<Denoiser>,
    /// Frames of each setting that are timed and compared
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Frames before those: drivers compile, stripes settle
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=1000))]
    warm_up: u32,
    /// A folder whose left.exr and right.exr are right, from whatever renderer [default: render them]
    #[arg(long, value_name = "DIR", conflicts_with_all = ["reference_spp", "reference_time_limit", "reference_dir"])]
    reference: Option<PathBuf>,
    /// Samples per pixel of the reference
    #[arg(long, default_value_t = 1024, value_name = "N", value_parser = clap::value_parser!(u32).range(2 * i64::from(PASS_SPP)..))]
    reference_spp: u32,
    /// Seconds after which it must do with fewer; a later run goes on with it
    #[arg(long, default_value = "600", value_name = "S", value_parser = seconds)]
    reference_time_limit: Duration,
    /// Where references are kept for later runs [default: reference in --out]
    #[arg(long, value_name = "DIR")]
    reference_dir: Option<PathBuf>,
    #[command(flatten)]
    seams: seams::SeamOptions,
    #[command(flatten)]
    preset: peres::PresetOptions,
}

/// The seed of references, so that they share no random number with what is held against them.
const REFERENCE_SEED: u32 = 0x5eed_0001;

/// More than the frames of a setting can be.
const FRAMES_MAX: u32 = 10_000;

/// What is right, as far as that is known.
struct Reference {
    images: Stereo<RgbImage>,
    /// Of a reference of our own.
    noise: Option<Stereo<Noise>>,
    /// In words.
    origin: String,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    if args.seams.is_wanted() {
        return seams::run(args);
    }
    if args.preset.is_wanted() {
        return peres::run(args);
    }
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let loaded = setup::load(options)?;
    for warning in &loaded.scene.warnings {
        eprintln!("warning: {warning}");
    }
    let reference = match &args.reference {
        Some(folder) => given(folder, options)?,
        None => own(args, &loaded, &tracing)?,
    };
    interrupt::check()?;
    let say_origin = serde_json::json!({ "event": "reference", "origin": reference.origin, "noise": reference.noise });
    if options.json {
        say!("{say_origin}");
    } else if !options.quiet {
        say!("reference: {}", reference.origin);
        if let Some(noise) = &reference.noise {
            say!("its own noise, below which no error is real: {noise}");
        }
    }
    let denoisers = if args.denoiser.is_empty() { Denoiser::value_variants() } else { &args.denoiser };
    let steps = (denoisers.len() * args.spp.len()) as u64 * u64::from(args.warm_up + args.repeats);
    let progress = Progress::new(steps, options.quiet, options.json);
    let grid = Grid { args, loaded: &loaded, reference: &reference.images, progress: &progress, tracing: &tracing };
    let (mut rows, mut devices) = (Vec::new(), Vec::new());
    for &denoiser in denoisers {
        for &spp in &args.spp {
            let (row, used) = grid.measure(rows.len() as u32, denoiser, spp)?;
            rows.push(row);
            devices = used;
        }
    }
    progress.finish();
    mark_front(&mut rows);
    let slopes = slopes(&rows, reference.noise.as_ref());
    write_results(args, &rows, &slopes, &reference, &devices)?;
    tracing.finish()?;
    if options.json {
        let result = serde_json::json!({ "event": "result", "rows": rows, "slopes": slopes });
        say!("{result}");
    } else if !options.quiet {
        say!("{}", table(&rows, reference.noise.as_ref()).text().trim_end());
        slopes.iter().for_each(|slope| say!("{slope}"));
        say!("bench.html, bench.csv and bench.svg: {}", options.out.display());
    }
    Ok(())
}

fn given(folder: &Path, options: &RunOptions) -> Result<Reference, Failure> {
    let read = |name: &str| -> Result<RgbImage, Failure> {
        let path = folder.join(name);
        let image = exr::read_rgb(&path).map_err(|e| Failure::Input(e.into()))?;
        if image.extent != options.size {
            let what = format!("{} is {}, not {}: ask for its --size", path.display(), image.extent, options.size);
            return Err(Failure::Input(anyhow::anyhow!(what)));
        }
        Ok(image)
    };
    let images = Stereo { left: read("left.exr")?, right: read("right.exr")? };
    let origin = format!("{}; its noise is unknown, and errors below it mean nothing", folder.display());
    Ok(Reference { images, noise: None, origin })
}

/// The reference that is kept for this shot and these settings, made or gone on with where it has too few samples.
fn own(args: &Args, loaded: &Loaded, tracing: &Tracing) -> Result<Reference, Failure> {
    let options = &args.options;
    let seed = if options.seed == REFERENCE_SEED { !REFERENCE_SEED } else { REFERENCE_SEED };
    let run = RunOptions { seed, clamp: None, sampler: Default::default(), ..options.clone() };
    let passes = PassOptions { time_limit: Some(args.reference_time_limit), passes_out: None, pass_spp: PASS_SPP };
    let mut plan = Plan::new(&single(run, Denoiser::None, args.reference_spp), passes)?;
    let kept = args.reference_dir.clone().unwrap_or_else(|| options.out.join("reference"));
    let folder = plan.keep_below(&kept, loaded);
    plan.prepare(loaded, "--reference-dir")?;
    let begun = plan.begun(loaded, 0)?;
    let (accumulation, how) = if begun.samples() >= plan.spp() {
        let how = format!("{} samples per pixel, kept from an earlier run", begun.samples());
        (begun, how)
    } else {
        let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
        let mut renderer = setup::renderer(&plan.options, loaded, gpus, tracing.recorder.origin())?;
        let done = plan.accumulate(&mut renderer, loaded, 0, begun, tracing)?;
        (done.accumulation, done.row.to_string())
    };
    let images = accumulation.mean();
    exr::write_rgb(&folder.join("left.exr"), &images.left)?;
    exr::write_rgb(&folder.join("right.exr"), &images.right)?;
    Ok(Reference { images, noise: accumulation.noise(), origin: format!("{how}, in {}", folder.display()) })
}

/// One frame of a setting.
fn single(run: RunOptions, denoiser: Denoiser, spp: u32) -> RenderOptions {
    RenderOptions { run, spp, denoiser, frames: 1, fps: 1.0, frames_in_flight: 1, aov: Vec::new() }
}

/// What all settings have in common.
struct Grid<'a> {
    args: &'a Args,
    loaded: &'a Loaded,
    reference: &'a Stereo<RgbImage>,
    progress: &'a Progress,
    tracing: &'a Tracing,
}

impl Grid<'_> {
    /// Times and errors of a setting, the `number`th, and the devices it ran on.
    fn measure(&self, number: u32, denoiser: Denoiser, spp: u32) -> Result<(Row, Vec<DeviceInfo>), Failure> {
        let Self { args, loaded, reference, progress, tracing } = self;
        let options = single(args.options.clone(), denoiser, spp);
        let name = setup::name(&denoiser);
        let gpus = setup::open_devices(&options, usize::from(args.virtual_devices))?;
        let mut renderer = setup::renderer(&options, loaded, gpus, tracing.recorder.origin())?;
        record_devices(&tracing.recorder, renderer.devices());
        let mut times_ms = Vec::new();
        let mut found = Stereo { left: Vec::new(), right: Vec::new() };
        for i in 0..args.warm_up + args.repeats {
            let frame = renderer.render(&loaded.shot.rig, options.time, i)?;
            refuse_faults(&renderer)?;
            interrupt::check()?;
            let makespan_ms = frame.makespan_ms;
            let event = serde_json::json!({
                "event": "frame", "denoiser": name, "spp": spp, "makespan_ms": makespan_ms,
            });
            progress.step(format!("{name}, {spp} spp, {makespan_ms:.1} ms"), &event);
            if i >= args.warm_up {
                // Each setting's frames get numbers of their own in the trace.
                tracing.record(&options, &FrameReport { index: number * FRAMES_MAX + i, ..frame });
                times_ms.push(makespan_ms);
                let image = renderer.read_linear()?;
                found.left.push(metrics::compare(&reference.left, &image.left)?);
                found.right.push(metrics::compare(&reference.right, &image.right)?);
            }
        }
        let row = Row::new(name, options.iterations(), spp, times_ms, &found);
        Ok((row, renderer.devices().to_vec()))
    }
}

fn write_results(
    args: &Args,
    rows: &[Row],
    slopes: &[Slope],
    reference: &Reference,
    devices: &[DeviceInfo],
) -> Result<(), Failure> {
    let options = &args.options;
    let reproject = if options.reproject == Switch::On { "on" } else { "off" };
    let shared = vec![
        ("size", options.size.to_string()),
        ("bounces", options.bounces.to_string()),
        ("sampler", setup::name(&options.sampler)),
        ("reproject", reproject.to_owned()),
        ("virtual_devices", args.virtual_devices.to_string()),
    ];
    output::write_text(&options.out, "bench.csv", &csv(&shared, rows))?;
    let noise = reference.noise.as_ref();
    let title = format!("Time against error, {} at {}", options.shot, options.size);
    let figure = svg(title.clone(), rows, noise).context("cannot draw the plot")?;
    output::write_text(&options.out, "bench.svg", &figure)?;
    let mut notes = vec![format!("Reference: {}.", reference.origin)];
    notes.extend(noise.map(|noise| format!("Its own noise, below which no error is real: {noise}.")));
    let settings = shared.into_iter().map(|(name, value)| vec![name.to_owned(), value]);
    let settings = Some(Table { headers: vec!["setting", "value"], rows: settings.collect() });
    let errors = "Means over frames, by eye. Front: no other setting is both faster and better by relMSE.".to_owned();
    let falls = slopes.iter().map(ToString::to_string);
    let sections = [
        Section { heading: "Settings", notes, table: settings, figure: None },
        Section { heading: "Devices", table: Some(Table::of_devices([devices])), ..Section::default() },
        Section {
            heading: "Time against error",
            notes: [errors].into_iter().chain(falls).collect(),
            table: Some(table(rows, noise)),
            figure: Some(figure),
        },
    ];
    output::write_page(&options.out, "bench.html", &title, &sections)
}
