//! `diptych bench`: run time against error over a grid of settings, and the quality ladder derived from it.

mod args;
pub mod axes;
mod grid;
mod journal;
pub mod judge;
mod page;
pub mod reference;

use anyhow::{Context, ensure};

use crate::report::Table;
use crate::report::bench::{
    ERROR, ERROR_NOTE, KIND_NOTE, SettingRow, Shared, csv, exposure_note, frames, kind_table, ladder_svg, mark_front,
    no_worse, regret_table, regrets, rungs, slopes, svg, table, undecided_note,
};
use crate::report::peers::Peers;
use crate::report::run::{FrameRow, RunReport};
use diptych::accumulation::hash_of;
use diptych::control::{Ladder, Measure, Origin};
use diptych::device::{DeviceInfo, SceneAccess};
use diptych::frame::settings::Value;
use diptych::loaded::LoadedScene;
use diptych::quality::{Denoiser, SettingError};
use diptych::stages::all_shader_text;

use super::failure::Failure;
use super::options::RunOptions;
use super::others::Others;
use super::page::and_page;
use super::setup::{self, Tracing};
use super::{interrupt, kinds, output, settings};
pub use args::Args;
use grid::Grid;
use journal::Journal;
use page::Page;
use reference::{Reference, Wanted};

/// Checks constraints that clap cannot express.
fn check(args: &Args) -> Result<(), anyhow::Error> {
    let settings = &args.options.settings;
    let most = args.denoisers().into_iter().map(|d| d.map_or(0, Denoiser::most_iterations)).max().unwrap_or(0);
    for n in &args.iterations {
        ensure!(*n <= most, "--iterations {n}: no denoiser of --denoiser takes more than {most}");
    }
    let is_timed = args.reference.is_some() && settings.is_given("time_limit");
    ensure!(!is_timed, SettingError::Conflict("--reference-images", "time_limit"));
    ensure!(settings.peers.is_none() || args.report, "peers has no effect without --report");
    args.options.check()
}

pub fn run(args: &Args) -> Result<(), Failure> {
    check(args).map_err(Failure::Input)?;
    let options = &args.options;
    let judged = args.judged()?;
    args.check_effects(args.settings().into_iter().chain(judged.iter().copied()))?;
    let peers = options.settings.peers.as_deref().map(Peers::read).transpose().map_err(Failure::Input)?;
    let given = args.reference.as_deref().map(|folder| reference::given(folder, options)).transpose()?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let mut others = Others::begin();
    let tracing = Tracing::start(options)?;
    let loaded = setup::load(options)?;
    setup::tell_remarks(&loaded.scene);
    let exposure_ev = loaded.exposure_ev();
    let peers = peers.map_or(Ok(Vec::new()), |peers| peers.at(exposure_ev)).map_err(Failure::Input)?;
    let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
    let devices: Vec<DeviceInfo> = gpus.infos();
    let journal = Journal::open(&options.out, subject(args, &loaded, &devices)?, options.settings.fresh)?;
    let own = || reference::own(&Wanted::of_grid(args)?, &loaded, &tracing, Some(&journal));
    let mut reference = given.map_or_else(own, Ok)?;
    interrupt::check()?;
    let (seen, gpus) = kinds::of_shot(options, &loaded, &reference.images, options.settings.by_kind, gpus, &tracing)?;
    (reference.kinds, reference.in_right) = (seen.kinds, Some(seen.in_right));
    say_reference(options, exposure_ev, &reference);
    let grid = Grid::new(args, &loaded, &reference, &tracing, gpus);
    others.begin_frames().iter().for_each(|warning| log!("warning: {warning}"));
    let mut rows = grid.measure(journal, &judged)?;
    let (others_share, warning) = others.end();
    warning.iter().for_each(|warning| log!("warning: {warning}"));
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
    let settings = settings::of_command_line(exposure_ev, &options.settings, args.measured());
    let mut report = RunReport::new(
        settings,
        &devices,
        &loaded.scene,
        loaded.needs,
        options.settings.skip_unused,
        Vec::<FrameRow>::new(),
    );
    (report.warm_up_s, report.others_share) = (warm_up_s, others_share);
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
        undecided_note(&rows).iter().for_each(|note| say!("{note}"));
        slopes.iter().for_each(|slope| say!("{slope}"));
        if let Some(kinds) = &reference.kinds {
            say!("by kind of pixel:\n{}\n{KIND_NOTE}", kind_table(&rows, kinds).text().trim_end());
        }
        if !regrets.is_empty() {
            say!("regret of the rungs of --ladder, against the best setting that takes no longer:");
            say!("{}", regret_table(&regrets).text().trim_end());
        }
        say!("{ERROR_NOTE}");
        say!("{}", ladders_note(&ladders, &rows));
        let page = and_page(args.report);
        say!("{page}bench.csv, bench.svg, ladder.toml, ladder.svg, frames.csv and run.json: {}", options.out.display());
    }
    Ok(())
}

/// Returns a hash of everything that a setting's time and errors depend on, except the reference and the setting
/// itself.
fn subject(args: &Args, loaded: &LoadedScene, devices: &[DeviceInfo]) -> Result<String, Failure> {
    let Args { virtual_devices, repeats, warm_up, options, .. } = args;
    let mut settings = options.settings.json();
    settings.retain(|key, _| !["fresh", "peers", "time_limit"].contains(&key.as_str()));
    let (shot, settings) = (&options.shot, serde_json::Value::from(settings));
    let plan = Wanted::of_grid(args)?.plan()?;
    let seen = plan.fingerprint(loaded, 0).key();
    let shaders = all_shader_text(SceneAccess { traversal: plan.traversal, ..Default::default() });
    let devices = Table::of_devices([devices]).rows;
    let shown = format!("{} EV", loaded.shot.exposure_ev);
    let all = format!(
        "{shot} {settings} {virtual_devices} {repeats} {warm_up} rivalry {seen} {shown} {devices:?} {ERROR} {shaders}"
    );
    Ok(hash_of(all.as_bytes()))
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
            say!("noise of the reference, below which errors are not significant: {noise}");
        }
        say!("{}", exposure_note(exposure_ev));
    }
}

/// Writes bench.csv, the plots and the ladders. Returns the plot of time against error and the settings that all rows
/// share.
fn write_results(
    args: &Args,
    exposure_ev: f64,
    rows: &[SettingRow],
    ladders: &[Ladder],
    reference: &Reference,
) -> Result<(String, Shared), Failure> {
    let options = &args.options;
    let shared = vec![
        ("size", options.settings.size.to_string()),
        ("exposure_ev", exposure_ev.to_string()),
        ("sampler", options.settings.sampler.text()),
        ("reproject", options.settings.reproject.text()),
        ("virtual_devices", args.virtual_devices.to_string()),
    ];
    csv(&shared, rows).write(&options.out.join("bench.csv"))?;
    if args.latex {
        output::write_text(&options.out, "bench.tex", &table(rows, reference.noise.as_ref()).latex())?;
    }
    let title = format!("Time against error, {} at {}", options.shot, options.settings.size);
    let figure = svg(title, rows, &args.metric, reference.noise.as_ref()).context("cannot draw the plot")?;
    output::write_text(&options.out, "bench.svg", &figure)?;
    let best = &ladders[0];
    best.write(&options.out.join("ladder.toml")).context("cannot write the ladder")?;
    for ladder in ladders.iter().filter(|_| ladders.len() > 1) {
        let name = format!("ladder.{}.toml", Denoiser::name_of(ladder.rungs()[0].quality.denoiser()));
        ladder.write(&options.out.join(name)).context("cannot write the ladder")?;
    }
    let climb = ladder_svg(format!("Quality ladder, {} at {}", options.shot, options.settings.size), rows, &[], best)
        .context("cannot draw the ladder")?;
    output::write_text(&options.out, "ladder.svg", &climb)?;
    Ok((figure, shared))
}

/// Returns the front of each denoiser that the intervals show as a ladder, best denoiser first.
fn ladders(
    options: &RunOptions,
    exposure_ev: f64,
    rows: &[SettingRow],
    devices: &[DeviceInfo],
) -> Result<Vec<Ladder>, Failure> {
    let name = |d: &DeviceInfo| {
        let threads = d.threads.map_or(String::new(), |threads| format!(", {threads} threads"));
        format!("{}, {}{threads}", d.name, d.driver)
    };
    let origin = Origin {
        shot: options.shot.clone(),
        size: options.settings.size.to_string(),
        exposure_ev,
        measure: Measure::FlipFlicker,
        devices: devices.iter().map(name).collect(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
    };
    Ok(Ladder::by_denoiser(&origin, &rungs(rows)).context("cannot build a ladder from the measured settings")?)
}

/// Returns a line of output with the denoiser of ladder.toml and the files of the other denoisers' ladders.
fn ladders_note(ladders: &[Ladder], rows: &[SettingRow]) -> String {
    let of = |ladder: &Ladder| {
        let (denoiser, rungs) = (ladder.rungs()[0].quality.denoiser(), ladder.rungs().len());
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
    let place = match &no_worse(rows, ladders[0].rungs()[0].quality.denoiser())[..] {
        [] => "the denoiser with the best front".to_owned(),
        others => format!("whose front the 95 % intervals do not show to be better than that of {}", others.join(", ")),
    };
    format!("ladder.toml: {best}, {rungs}, {place}; also {}", others.join(", "))
}
