//! `diptych scale`: the same frames at several device counts.

mod args;
mod quiet;
mod results;
mod seen;
mod turns;

use std::collections::BTreeSet;
use std::time::Instant;

use crate::report::scale::chart::Law;
use crate::report::scale::{ScaleRow, scale_table};
use crate::report::simulation::{deviations, enough_nodes, simulation_csv, simulation_table};
use diptych::image::Extent;
use diptych::schedule::{Balance, Network};

use super::failure::Failure;
use super::options::{RenderFlags, RenderOptions};
use super::others::Others;
use super::page::and_page;
use super::progress::Progress;
use super::setup::{self, Tracing};
use super::{interrupt, output};
pub use args::Args;
use quiet::Quiet;
use results::Results;
use turns::{Measuring, all_frames, shares};

pub fn run(args: &Args) -> Result<(), Failure> {
    let policies = of_policies(&args.flags)?;
    let options = &RenderOptions { run: args.flags.run.clone(), ..policies[0].clone() };
    args.simulation.check(options).map_err(Failure::Input)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let mut others = Others::begin();
    let tracing = Tracing::start(options)?;
    let loaded = setup::load_rig(options)?;
    setup::tell_remarks(&loaded.scene);
    let begin = Instant::now();
    let most = args.counts.iter().copied().max().map_or(1, usize::from);
    let gpus = setup::open_devices(&policies[0], most)?;
    let adapters = gpus.len() / most;
    let one = (of_one(&policies[0]), 1, 1);
    let several = counts(&args.counts, adapters)
        .into_iter()
        .flat_map(|count| policies.iter().map(move |options| (options.clone(), count, count * adapters)));
    let subjects: Vec<_> = std::iter::once(one).chain(several).collect();
    let frames = all_frames(args, options);
    let progress = Progress::new(subjects.len() as u64 * u64::from(frames), options.quiet, options.json);
    let measuring = Measuring { args, options, loaded: &loaded, progress: &progress, tracing: &tracing };
    if let Some(warning) = setup::beyond_path(&loaded.shot.rig, options.settings.time, args.time_s(frames - 1)) {
        progress.warn(&warning);
    }
    let start = |(options, each, devices): (RenderOptions, usize, usize)| {
        interrupt::check()?;
        progress.part(0.0, "starting");
        let shared = gpus.shared(|index| index % most < each && (devices > 1 || index == 0));
        let options = if args.weak { with_pixels(options, devices as f64) } else { options };
        let mut own = shared.map_or_else(|| setup::open_devices(&options, each), Ok)?;
        own.truncate(devices);
        measuring.subject(options, own)
    };
    let mut subjects = subjects.into_iter().map(start).collect::<Result<Vec<_>, _>>()?;
    measuring.warm_up(&mut subjects)?;
    let mut found = Results::new(begin.elapsed().as_secs_f64());
    others.begin_frames().iter().for_each(|warning| progress.warn(warning));
    let times = measuring.measure(&mut subjects)?;
    found.others_share = others.end().0;
    let writing = interrupt::writing();
    progress.finish();
    let quiet = Quiet::of(&shares(&times));
    quiet.warning.iter().for_each(|warning| log!("warning: {warning}"));
    subjects.into_iter().try_for_each(|subject| found.add(&measuring, subject, &quiet))?;
    found.rows.iter().filter_map(ScaleRow::warning).for_each(|warning| log!("warning: {warning}"));
    let figure = found.write_rows(options)?;
    tracing.finish()?;
    drop(writing);
    let mut files = "scale.csv, scale.svg, frames.csv and run.json";
    if args.simulation.is_wanted() && !interrupt::is_set() {
        files = "scale.csv, scale.svg, simulate.csv, frames.csv and run.json";
        for options in &policies {
            found.simulated.extend(args.simulation.run(options, &found.learned, &found.rows)?);
        }
        simulation_csv(&found.simulated).write(&options.out.join("simulate.csv"))?;
        deviations(&found.simulated).1.iter().for_each(|warning| log!("warning: {warning}"));
    }
    let _writing = interrupt::writing();
    found.write_run(options, &loaded)?;
    if args.report {
        found.write_page(options, &loaded, figure)?;
    }
    conclude(args, options, &found, files);
    interrupt::check()
}

/// Prints the results, and the output folder.
fn conclude(args: &Args, options: &RenderOptions, found: &Results, files: &str) {
    let Results { rows, simulated, learned, .. } = found;
    if options.json {
        let laws = Law::of_rows(rows);
        say!("{}", serde_json::json!({ "event": "result", "rows": rows, "simulated": simulated, "laws": laws }));
    } else if !options.quiet {
        say!("{}", scale_table(rows).text().trim_end());
        Law::of_rows(rows).iter().for_each(|law| say!("{law}"));
        let costs = learned.last().and_then(|learned| learned.costs.last());
        let network = costs.map(|costs| costs.network.clone()).unwrap_or_default();
        let Network { latency_ms, ms_per_byte, .. } = network;
        if latency_ms > 0.0 {
            let speed = match 8e-3 / ms_per_byte {
                mbps if mbps < 1e3 => format!(", {mbps:.0} Mbit/s"),
                mbps if mbps.is_finite() => format!(", {:.1} Gbit/s", mbps * 1e-3),
                _ => String::new(),
            };
            say!("from rank to rank: {:.0} µs{speed}", latency_ms * 1e3);
        }
        if !simulated.is_empty() {
            say!("{}", simulation_table(simulated).text().trim_end());
            deviations(simulated).0.iter().for_each(|said| say!("{said}"));
            for rows in simulated.chunk_by(|a, b| a.policy == b.policy) {
                enough_nodes(rows).iter().for_each(|said| say!("{said}"));
            }
        }
        say!("{}{files}: {}", and_page(args.report), options.out.display());
    }
}

/// Returns a copy of the options for each requested policy, with only that policy.
fn of_policies(flags: &RenderFlags) -> Result<Vec<RenderOptions>, Failure> {
    let policies = flags.run.settings.balances();
    let with = |policy: &Balance| {
        let mut one = flags.clone();
        one.run.settings.balance = vec![*policy];
        if *policy != Balance::Static && policies.contains(&Balance::Static) {
            one.run.settings.unset("ratios").map_err(|error| Failure::Input(error.into()))?;
        }
        one.options().map_err(Failure::Input)
    };
    policies.iter().map(with).collect()
}

/// Returns options for `times` as many pixels of the same picture.
fn with_pixels(mut options: RenderOptions, times: f64) -> RenderOptions {
    let size = &mut options.run.settings.size;
    let grown = |pixels: u32| (f64::from(pixels) * times.sqrt()).round() as u32;
    *size = Extent::new(grown(size.width), grown(size.height));
    options
}

/// Returns the requested counts, ascending and without duplicates. Omits the count that gives a single device in total:
/// one device is always measured, before all counts.
fn counts(asked: &[u16], adapters: usize) -> Vec<usize> {
    let counts: BTreeSet<usize> = asked.iter().copied().map(usize::from).collect();
    counts.into_iter().filter(|count| count * adapters > 1).collect()
}

/// Returns the options for one device: per-device values are those of the first device, and ratios do not apply.
fn of_one(options: &RenderOptions) -> RenderOptions {
    let mut one = options.clone();
    let settings = &mut one.run.settings;
    settings.threads_per_device.truncate(1);
    settings.slowdown.truncate(1);
    settings.disturb.retain(|d| d.injection().is_some_and(|i| i.device == 0));
    if settings.policy() == Balance::Static {
        settings.balance = vec![Balance::Even];
        settings.ratios.clear();
    }
    one
}
