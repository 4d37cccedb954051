//! `diptych bench`: run time against error over a grid of settings, and the quality ladder derived from it.

mod andersson;
mod bmfr;
mod findings;
mod grid;
mod journal;
mod judge;
mod koskela;
mod late;
mod leria;
mod over_shots;
mod page;
mod peres;
mod preset;
mod reference;
mod seams;
mod timed;
mod turns;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::Context;

use crate::accumulation::hash_of;
use crate::control::{Ladder, Measure, Origin};
use crate::device::{DeviceInfo, SceneAccess};
use crate::loaded::LoadedScene;
use crate::quality::{Denoiser, LogPolar, Quality};
use crate::report::Table;
use crate::report::bench::{
    ERROR, ERROR_NOTE, Row, Shared, csv, exposure_note, frames, ladder_svg, mark_front, regret_table, regrets, slopes,
    svg, table,
};
use crate::report::peers::Peers;
use crate::report::run::{FrameRow, RunReport};
use crate::stages::all_shader_text;

use super::failure::Failure;
use super::foveation::{FoveationMode, FoveationOptions};
use super::interrupt;
use super::options::{self, DenoiserChoice, RunOptions, Switch, render_scale};
use super::output;
use super::page::and_page;
use super::reference::{PASS_SPP, seconds};
use super::settings;
use super::setup::{self, Tracing};
use grid::Grid;
use journal::Journal;
use page::Page;
use reference::Reference;

#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    #[command(flatten)]
    pub options: RunOptions,
    /// Virtual devices on each adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    virtual_devices: u16,
    /// Samples per pixel to measure [default: 1,2,4,8,16]
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=1 << 20), help_heading = options::QUALITY)]
    spp: Vec<u32>,
    /// Maximum bounces to measure [default: 2,6]
    ///
    /// The reference has the most of them.
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(0..=1024), help_heading = options::QUALITY)]
    bounces: Vec<u32>,
    /// Denoisers to measure [default: none,atrous,svgf]
    #[arg(long, value_delimiter = ',', value_name = "LIST", value_parser = options::denoiser_parser(), help_heading = options::QUALITY)]
    denoiser: Vec<DenoiserChoice>,
    /// Iterations of denoisers to measure [default: 3,5]
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = clap::value_parser!(u32).range(1..=i64::from(Denoiser::MAX_ITERATIONS)), help_heading = options::QUALITY)]
    iterations: Vec<u32>,
    /// Foveation modes to measure [default: none]
    #[arg(long, value_delimiter = ',', value_name = "LIST", conflicts_with_all = ["seams", "preset"], help_heading = options::QUALITY)]
    foveation: Vec<FoveationMode>,
    /// Log-polar mode or SIGMA,ALPHA,GAZE,ASPECT [default: composite mode]
    #[arg(long, value_name = "MODE", conflicts_with_all = ["seams", "preset"], help_heading = options::QUALITY)]
    polar: Option<LogPolar>,
    /// Render scales to measure [default: 1,0.7,0.5]
    ///
    /// Those below 1 are measured with the fewest samples.
    #[arg(
        long = "render-scale",
        alias = "scale",
        value_delimiter = ',',
        value_name = "F,F,…",
        value_parser = render_scale,
        conflicts_with_all = ["seams", "preset"], help_heading = options::QUALITY)]
    scale: Vec<f64>,
    /// Also measure the rungs of this ladder and print their regret
    ///
    /// Regret is the error above the best setting that takes no longer, within 3 %.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["seams", "preset"], help_heading = options::QUALITY)]
    ladder: Option<PathBuf>,
    /// Measure a small grid against a coarse reference
    #[arg(long, help_heading = options::QUALITY)]
    quick: bool,
    /// Measure everything again instead of resuming
    #[arg(long, help_heading = options::OUTPUT)]
    fresh: bool,
    /// Timed and compared frames per setting, at least two in the grid
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000), help_heading = options::SCENE)]
    repeats: u32,
    /// Frames before the timed ones
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=1000), help_heading = options::SCENE)]
    warm_up: u32,
    /// Folder of left.exr and right.exr to compare with [default: render them]
    #[arg(
        long = "reference-images",
        alias = "reference",
        value_name = "DIR",
        conflicts_with_all = ["reference_spp", "reference_time_limit", "reference_dir"], help_heading = options::QUALITY)]
    reference: Option<PathBuf>,
    /// Samples per pixel of the reference [default: 1024, with --quick 256]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2 * i64::from(PASS_SPP)..), help_heading = options::QUALITY)]
    reference_spp: Option<u32>,
    /// Seconds for the reference; a later run resumes it
    #[arg(long, default_value = "600", value_name = "S", value_parser = seconds, help_heading = options::QUALITY)]
    reference_time_limit: Duration,
    /// Folder of references for later runs [default: reference in --out]
    #[arg(long = "reference-cache", alias = "reference-dir", value_name = "DIR", help_heading = options::OUTPUT)]
    reference_dir: Option<PathBuf>,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    report: bool,
    /// With --report: other renderers' times and FLIP, as in docs/peers
    #[arg(long, value_name = "FILE", requires = "report", conflicts_with_all = ["seams", "preset"], help_heading = options::OUTPUT)]
    peers: Option<PathBuf>,
    #[command(flatten)]
    seams: seams::SeamOptions,
    #[command(flatten)]
    preset: preset::PresetOptions,
}

impl Args {
    /// Reads the qualities of the rungs of `--ladder`; none without the option.
    fn judged(&self) -> Result<Vec<Quality>, Failure> {
        let Some(path) = &self.ladder else { return Ok(Vec::new()) };
        let ladder = Ladder::read(path).context("cannot use --ladder").map_err(Failure::Input)?;
        let qualities: Vec<Quality> = ladder.rungs().iter().map(|r| r.quality).collect();
        if let Some((i, other)) = qualities.iter().enumerate().find(|(_, quality)| !grid::is_of_options(quality)) {
            let what = format!("--ladder {}: no options stand for rung {}, {other}", path.display(), i + 1);
            return Err(Failure::Input(anyhow::anyhow!(what)));
        }
        Ok(qualities)
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let iterations = args.iterations.first().map(|n| [*n; 3]);
    let foveated = FoveationOptions { iterations, ..FoveationOptions::default() };
    foveated
        .check(args.denoisers().into_iter().max_by_key(|d| d.map(Denoiser::most_iterations)).flatten())
        .map_err(Failure::Input)?;
    if args.seams.is_wanted() {
        return seams::run(args);
    }
    if let Some(result) = preset::run(args) {
        return result;
    }
    let options = &args.options;
    let judged = args.judged()?;
    options.check().map_err(Failure::Input)?;
    let peers = args.peers.as_deref().map(Peers::read).transpose().map_err(|e| Failure::Input(e.into()))?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let loaded = setup::load(options)?;
    for warning in &loaded.scene.warnings {
        eprintln!("warning: {warning}");
    }
    let exposure_ev = loaded.exposure_ev();
    let peers = peers.map_or(Ok(Vec::new()), |peers| peers.at(exposure_ev)).map_err(|e| Failure::Input(e.into()))?;
    let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
    let devices: Vec<DeviceInfo> = gpus.infos();
    let journal = Journal::open(&options.out, subject(args, &loaded, &devices)?, args.fresh)?;
    let reference = reference::find(args, &loaded, &tracing, &journal)?;
    interrupt::check()?;
    say_reference(options, exposure_ev, &reference);
    let grid = Grid::new(args, &loaded, &reference, &tracing, gpus);
    let mut rows = grid.measure(journal, &judged)?;
    let warm_up_s = grid.warm_up_s();
    let regrets = regrets(&judged, &rows);
    mark_front(&mut rows);
    let slopes = slopes(&rows, reference.noise.as_ref());
    let ladders = ladders(options, exposure_ev, &rows, &devices)?;
    let ladder = &ladders[0];
    let (figure, shared) = write_results(args, exposure_ev, &rows, &ladders, &reference)?;
    if args.report {
        let (loaded, reference, devices, peers) = (&loaded, &reference, &devices[..], &peers[..]);
        let (rows, slopes, regrets) = (&rows[..], &slopes[..], &regrets[..]);
        Page { args, loaded, reference, devices, peers, rows, slopes, regrets, ladder }.write(&grid, figure, shared)?;
    }
    frames(&rows).write(&options.out.join("frames.csv"))?;
    let settings = settings::of_command_line(exposure_ev, args.measured());
    let mut report =
        RunReport::new(settings, &devices, &loaded.scene, loaded.needs, !options.no_skip, Vec::<FrameRow>::new());
    report.warm_up_s = warm_up_s;
    report.write(&options.out.join("run.json"))?;
    tracing.finish()?;
    if options.json {
        let result = serde_json::json!({
            "event": "result", "exposure_ev": exposure_ev, "ladder_error": ERROR, "rows": rows, "slopes": slopes,
            "regrets": regrets,
        });
        say!("{result}");
    } else if !options.quiet {
        say!("{}", table(&rows, reference.noise.as_ref()).text().trim_end());
        slopes.iter().for_each(|slope| say!("{slope}"));
        if !regrets.is_empty() {
            say!("the rungs of --ladder against the best that takes no longer:");
            say!("{}", regret_table(&regrets).text().trim_end());
        }
        say!("{ERROR_NOTE}");
        say!("{}", ladders_note(&ladders));
        let page = and_page(args.report);
        say!("{page}bench.csv, bench.svg, ladder.toml, ladder.svg, frames.csv and run.json: {}", options.out.display());
    }
    Ok(())
}

/// Returns a hash of everything that a setting's time and errors depend on, except the reference and the setting
/// itself.
fn subject(args: &Args, loaded: &LoadedScene, devices: &[DeviceInfo]) -> Result<String, Failure> {
    let quiet = RunOptions { out: PathBuf::new(), trace: None, quiet: true, json: false, ..args.options.clone() };
    let plan = reference::plan(args)?;
    let seen = plan.fingerprint(loaded, 0).key();
    let shaders = all_shader_text(SceneAccess { traversal: plan.traversal(), ..Default::default() });
    let Args { virtual_devices, repeats, warm_up, .. } = args;
    let devices = Table::of_devices([devices]).rows;
    let shown = format!("{} EV", loaded.shot.exposure_ev);
    let all = format!("{quiet:?} {virtual_devices} {repeats} {warm_up} {seen} {shown} {devices:?} {ERROR} {shaders}");
    Ok(hash_of(&all))
}

fn say_reference(options: &RunOptions, exposure_ev: f64, reference: &Reference) {
    let Reference { origin, noise, .. } = reference;
    if options.json {
        say!(
            "{}",
            serde_json::json!({ "event": "reference", "origin": origin, "noise": noise, "exposure_ev": exposure_ev })
        );
    } else if !options.quiet {
        say!("reference: {origin}");
        if let Some(noise) = noise {
            say!("its own noise, below which no error is real: {noise}");
        }
        say!("{}", exposure_note(exposure_ev));
    }
}

/// Writes bench.csv, the plots and the ladders. Returns the plot of time against error and the settings that all rows
/// share.
fn write_results(
    args: &Args,
    exposure_ev: f64,
    rows: &[Row],
    ladders: &[Ladder],
    reference: &Reference,
) -> Result<(String, Shared), Failure> {
    let options = &args.options;
    let reproject = if options.reproject == Switch::On { "on" } else { "off" };
    let shared = vec![
        ("size", options.size.to_string()),
        ("exposure_ev", exposure_ev.to_string()),
        ("sampler", setup::name(&options.sampler)),
        ("reproject", reproject.to_owned()),
        ("virtual_devices", args.virtual_devices.to_string()),
    ];
    csv(&shared, rows).write(&options.out.join("bench.csv"))?;
    let title = format!("Time against error, {} at {}", options.shot, options.size);
    let figure = svg(title, rows, reference.noise.as_ref()).context("cannot draw the plot")?;
    output::write_text(&options.out, "bench.svg", &figure)?;
    let best = &ladders[0];
    best.write(&options.out.join("ladder.toml")).context("cannot keep the ladder")?;
    for ladder in ladders.iter().filter(|_| ladders.len() > 1) {
        let name = format!("ladder.{}.toml", Denoiser::name_of(ladder.rungs()[0].quality.denoiser));
        ladder.write(&options.out.join(name)).context("cannot keep the ladder")?;
    }
    let climb = ladder_svg(format!("Quality ladder, {} at {}", options.shot, options.size), rows, &[], best)
        .context("cannot draw the ladder")?;
    output::write_text(&options.out, "ladder.svg", &climb)?;
    Ok((figure, shared))
}

/// Returns the Pareto front of each denoiser as a ladder, the best first.
fn ladders(
    options: &RunOptions,
    exposure_ev: f64,
    rows: &[Row],
    devices: &[DeviceInfo],
) -> Result<Vec<Ladder>, Failure> {
    let name = |d: &DeviceInfo| {
        let threads = d.threads.map_or(String::new(), |threads| format!(", {threads} threads"));
        format!("{}, {}{threads}", d.name, d.driver)
    };
    let origin = Origin {
        shot: options.shot.clone(),
        size: options.size.to_string(),
        exposure_ev,
        measure: Measure::FlipFlicker,
        devices: devices.iter().map(name).collect(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    let rungs: Vec<_> = rows.iter().map(Row::rung).collect();
    Ok(Ladder::by_denoiser(&origin, &rungs).context("no setting can be a rung of a ladder")?)
}

/// Names the denoiser of ladder.toml and the files of the other denoisers' ladders.
fn ladders_note(ladders: &[Ladder]) -> String {
    let of = |ladder: &Ladder| {
        let (denoiser, rungs) = (ladder.rungs()[0].quality.denoiser, ladder.rungs().len());
        (Denoiser::name_of(denoiser), format!("{rungs} rung{}", if rungs == 1 { "" } else { "s" }))
    };
    let (best, rungs) = of(&ladders[0]);
    if ladders.len() == 1 {
        return format!("ladder.toml: {best}, {rungs}");
    }
    let others: Vec<String> = ladders[1..]
        .iter()
        .map(|ladder| {
            let (denoiser, rungs) = of(ladder);
            format!("ladder.{denoiser}.toml: {rungs}")
        })
        .collect();
    format!("ladder.toml: {best}, {rungs}, the denoiser with the best front; also {}", others.join(", "))
}
