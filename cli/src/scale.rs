//! `diptych scale`: the same frames at several device counts.

mod seen;

use std::collections::BTreeSet;
use std::time::Instant;

use anyhow::Context;

use crate::report::frames::FrameLine;
use crate::report::html::Section;
use crate::report::lanes::median_frame;
use crate::report::run::{FrameRow, RunReport, RunSettings, aov_ms};
use crate::report::scale::{ScaleRow, scale_csv, scale_sections, scale_svg, scale_table};
use crate::report::simulation::{self, enough_nodes, simulation_csv, simulation_svg, simulation_table};
use crate::report::{Csv, Table};
use diptych::device::DeviceInfo;
use diptych::exec::ranks::Devices;
use diptych::exec::{FrameReport, Renderer};
use diptych::loaded::LoadedScene;
use diptych::passes::FrameSpec;
use diptych::passes::tonemap::LINEAR;
use diptych::schedule::{Balance, CostModel, Network};
use diptych::trace::frames::record_devices;

use super::failure::Failure;
use super::faults::refuse_faults;
use super::options::{self, DEFAULT_FPS, RenderFlags, RenderOptions};
use super::page::{self, and_page};
use super::progress::Progress;
use super::setup::{self, Tracing};
use super::{interrupt, output, settings, simulate};
use seen::Seen;

#[derive(clap::Args, Debug)]
#[command(mut_arg("frames", |frames| frames.default_value("5").help("Timed frames per device count")))]
pub struct Args {
    /// Frames before the timed ones
    #[arg(long, default_value_t = 3, help_heading = options::SCENE)]
    warm_up: u32,
    #[command(flatten)]
    pub flags: RenderFlags,
    /// Virtual devices on each adapter; one device is always measured
    #[arg(long, value_delimiter = ',', default_value = "1,2", value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64), help_heading = options::DEVICES)]
    counts: Vec<u16>,
    #[command(flatten)]
    simulation: simulate::Args,
    /// Also write report.html
    #[arg(long, help_heading = options::OUTPUT)]
    report: bool,
}

impl Args {
    /// Makes all counts have the same default of threads per device, on all ranks.
    pub fn share_cores(&mut self) {
        self.flags.run.most_virtual_devices = self.counts.iter().copied().max().unwrap_or(1);
    }

    /// Returns the instant of a frame in seconds. `number` counts frames from the first warm-up frame.
    fn time_s(&self, number: u32) -> f64 {
        self.flags.run.settings.time
            + f64::from(number.saturating_sub(self.warm_up)) / self.flags.run.settings.fps.unwrap_or(DEFAULT_FPS)
    }
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let policies = of_policies(&args.flags)?;
    let options = &RenderOptions { run: args.flags.run.clone(), ..policies[0].clone() };
    args.simulation.check(options).map_err(Failure::Input)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let loaded = setup::load(options)?;
    let last_s = args.time_s(args.warm_up + options.frames - 1);
    if let Some(warning) = setup::beyond_path(&loaded.shot.rig, options.settings.time, last_s) {
        log!("warning: {warning}");
    }
    let one = of_one(&policies[0]);
    let mut gpus = setup::open_devices(&one, 1)?;
    let counts = counts(&args.counts, gpus.len());
    gpus.truncate(1);
    let steps =
        (1 + counts.len() * policies.len()) as u64 * u64::from(args.warm_up + options.frames + followers(options));
    let progress = Progress::new(steps, options.quiet, options.json);
    let measuring = Measuring { args, options, loaded: &loaded, progress: &progress, tracing: &tracing };
    let mut found = Results::default();
    let mut model = found.add(&measuring, measuring.run(&one, gpus, None)?)?;
    let measured = counts.into_iter().try_for_each(|count| {
        policies.iter().try_for_each(|options| {
            let gpus = setup::open_devices(options, count)?;
            let measured = measuring.run(options, gpus, found.rows.first())?;
            let oversubscribed = measured.row.oversubscribed;
            let costs = found.add(&measuring, measured)?;
            if !oversubscribed {
                model = costs;
            }
            Ok(())
        })
    });
    // A signal ends the measurement, and the results so far are written.
    if !matches!(measured, Err(Failure::Interrupted)) {
        measured?;
    }
    progress.finish();
    let figure = found.write_rows(options)?;
    tracing.finish()?;
    let mut files = "scale.csv, scale.svg, frames.csv and run.json";
    if args.simulation.is_wanted() && !interrupt::is_set() {
        files = "scale.csv, scale.svg, simulate.csv, frames.csv and run.json";
        for options in &policies {
            // The base comes first.
            let own = |r: &&ScaleRow| r.devices == r.base_devices || r.policy == options.settings.policy().name();
            let measured: Vec<_> = found.rows.iter().filter(own).map(|r| (r.devices, r.makespan_ms)).collect();
            found.simulated.extend(args.simulation.run(options, &model, &measured)?);
        }
        simulation_csv(&found.simulated).write(&options.out.join("simulate.csv"))?;
    }
    found.write_run(options, &loaded)?;
    if args.report {
        found.write_page(options, &loaded, figure)?;
    }
    let Results { rows, simulated, .. } = &found;
    if options.json {
        say!("{}", serde_json::json!({ "event": "result", "rows": rows, "simulated": simulated }));
    } else if !options.quiet {
        say!("{}", scale_table(rows).text().trim_end());
        let Network { latency_ms, ms_per_byte, .. } = model.1.network;
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
            for rows in simulated.chunk_by(|a, b| a.policy == b.policy) {
                enough_nodes(rows).iter().for_each(|said| say!("{said}"));
            }
        }
        say!("{}{files}: {}", and_page(args.report), options.out.display());
    }
    interrupt::check()
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

/// Returns the number of threads of each device, if it is known and the same for all.
fn common_threads(devices: &[DeviceInfo]) -> Option<usize> {
    let (first, others) = devices.split_first()?;
    first.threads.filter(|_| others.iter().all(|other| other.threads == first.threads))
}

/// Returns the number of untimed frames after the timed ones. They keep the devices loaded, since the last timed frames
/// would otherwise finish sooner.
fn followers(options: &RenderOptions) -> u32 {
    options.settings.frames_in_flight.saturating_sub(1)
}

/// Inputs that the measurements of all counts share.
struct Measuring<'a> {
    args: &'a Args,
    /// Options with all requested policies.
    options: &'a RenderOptions,
    loaded: &'a LoadedScene,
    progress: &'a Progress,
    tracing: &'a Tracing,
}

/// Results of one measurement: a number of devices with a policy.
struct Measured {
    row: ScaleRow,
    renderer: Renderer,
    warm_up_s: f64,
    frames: Vec<FrameReport>,
}

impl Measuring<'_> {
    /// Returns the index of the options' policy among the requested ones.
    fn place(&self, options: &RenderOptions) -> u32 {
        let policies = self.options.settings.balances();
        policies.iter().position(|policy| *policy == options.settings.policy()).unwrap_or_default() as u32
    }

    /// Measures frames on these devices. `base` is the row that the speed-up refers to; `None` for that row itself.
    fn run(&self, options: &RenderOptions, gpus: Devices, base: Option<&ScaleRow>) -> Result<Measured, Failure> {
        let Self { args, loaded, progress, tracing, .. } = self;
        let infos = gpus.infos();
        // Count the threads of the devices on this machine.
        let host = |info: &DeviceInfo| info.rank.as_ref().map(|rank| rank.host.clone());
        let here = infos.iter().filter(|info| host(info) == host(&infos[0]));
        let threads: usize = here.filter_map(|info| info.threads).sum();
        let warm_up = Instant::now();
        let mut renderer = setup::renderer(options, loaded, gpus, tracing.recorder.origin())?;
        let warm_up_s = warm_up.elapsed().as_secs_f64();
        record_devices(&tracing.recorder, renderer.devices());
        let devices = renderer.devices().len();
        let (mut frames, mut begun) = (Vec::new(), 0);
        let timed = args.warm_up..args.warm_up + options.frames;
        loop {
            while begun < timed.end + followers(options)
                && renderer.in_flight() < options.settings.frames_in_flight as usize
            {
                let time_s = args.time_s(begun);
                begun += 1;
                let is_last = begun == timed.end + followers(options);
                let reads = if args.report && is_last { &[LINEAR][..] } else { &[] };
                renderer.begin(&renderer.frame(&loaded.shot.rig, time_s, begun - 1), reads)?;
            }
            let Some(frame) = renderer.finish()? else { break };
            refuse_faults(&renderer)?;
            interrupt::check()?;
            let makespan_ms = frame.makespan_ms - aov_ms(&frame.tasks);
            let event = serde_json::json!({ "event": "frame", "devices": devices, "makespan_ms": makespan_ms });
            progress.step(format!("{devices} device(s) {makespan_ms:.1} ms"), &event);
            if timed.contains(&frame.index) {
                // Frame numbers in the trace are unique across counts and policies.
                let series = devices as u32 + 100 * self.place(options);
                let shown = FrameReport { index: frame.index + series * 1_000_000, ..frame.clone() };
                tracing.record(&options.quality(), None, &shown);
                frames.push(frame);
            }
        }
        let oversubscribed = threads > std::thread::available_parallelism().map_or(1, usize::from);
        let row = ScaleRow {
            policy: renderer.policy_name().to_owned(),
            threads_per_device: common_threads(&infos),
            ..ScaleRow::new(devices, &frames, oversubscribed, base)
        };
        Ok(Measured { row, renderer, warm_up_s, frames })
    }
}

/// Results of all counts.
#[derive(Default)]
struct Results {
    rows: Vec<ScaleRow>,
    /// Devices of each row.
    devices: Vec<Vec<DeviceInfo>>,
    warm_up_s: f64,
    /// Timed frames of all counts.
    frames: Vec<FrameRow>,
    policies: Vec<String>,
    simulated: Vec<simulation::SimulationRow>,
    seen: Seen,
}

impl Results {
    /// Adds the results for a number of devices, and returns the spec of their last frame and their cost model.
    fn add(&mut self, of: &Measuring<'_>, measured: Measured) -> Result<(FrameSpec, CostModel), Failure> {
        let Measuring { args, options, loaded, .. } = of;
        let Measured { row, mut renderer, warm_up_s, frames } = measured;
        let quality = options.quality();
        let row_of = |f: &FrameReport| {
            let row = FrameRow::new(f, &quality, &loaded.shot.rig, args.time_s(f.index));
            FrameRow { index: f.index - args.warm_up, ..row }
        };
        let spec = frames.last().map(|frame| frame.spec.clone()).context("no frame was timed")?;
        self.frames.extend(frames.iter().map(row_of));
        self.policies.extend(frames.iter().map(|_| row.policy.clone()));
        self.rows.push(row);
        self.devices.push(renderer.devices().to_vec());
        self.warm_up_s += warm_up_s;
        if args.report {
            let makespans_ms: Vec<f64> = frames.iter().map(|f| f.makespan_ms).collect();
            let shown = frames.into_iter().nth(median_frame(&makespans_ms));
            self.seen.add(renderer.read_linear()?, shown);
        }
        Ok((spec, renderer.costs().clone()))
    }

    /// Writes frames.csv and run.json with all timed frames and the devices of the largest count, which include those
    /// of smaller counts.
    fn write_run(&mut self, options: &RenderOptions, loaded: &LoadedScene) -> Result<(), Failure> {
        let settings = self.settings(options, loaded.exposure_ev());
        let devices = self.devices.last().map_or(&[][..], Vec::as_slice);
        let frames = std::mem::take(&mut self.frames);
        let mut report =
            RunReport::new(settings, devices, &loaded.scene, loaded.needs, options.settings.skip_unused, frames);
        report.warm_up_s = self.warm_up_s;
        let mut csv = FrameLine::csv_of(&report.frames);
        if options.settings.balances().len() > 1 {
            csv = csv.beside(Csv::new(&[("policy", |policy: &String| policy.clone())], &self.policies));
        }
        csv.write(&options.out.join("frames.csv"))?;
        Ok(report.write(&options.out.join("run.json"))?)
    }

    /// Writes scale.csv and scale.svg; returns the plot.
    fn write_rows(&self, options: &RenderOptions) -> Result<String, Failure> {
        scale_csv(&self.rows).write(&options.out.join("scale.csv"))?;
        let title = format!("Speed-up of {} at {}", options.shot, options.settings.size);
        let figure = scale_svg(title, &self.rows).context("cannot draw the plot")?;
        output::write_text(&options.out, "scale.svg", &figure)?;
        Ok(figure)
    }

    fn write_page(&self, options: &RenderOptions, loaded: &LoadedScene, figure: String) -> Result<(), Failure> {
        let title = format!("{} at {} over device counts", options.shot, options.settings.size);
        let mut sections: Vec<Section> = self.seen.pictures(loaded)?.into_iter().collect();
        sections.extend(scale_sections(&self.rows, figure));
        if !self.simulated.is_empty() {
            sections.push(self.simulation(options)?);
        }
        sections.push(self.seen.swimlanes(&self.rows)?);
        sections.extend(self.settings_and_devices(options, loaded.exposure_ev()));
        sections.push(page::scene(options, loaded));
        page::write(&options.out, &title, &sections)
    }

    /// Returns the options in force, with the threads of the devices if all have the same number.
    fn settings(&self, options: &RenderOptions, exposure_ev: f64) -> RunSettings {
        let mut settings = settings::in_force(options, exposure_ev, &[]);
        let devices: Vec<DeviceInfo> = self.devices.iter().flatten().cloned().collect();
        if let Some(threads) = common_threads(&devices) {
            settings.options.insert("threads_per_device".to_owned(), threads.into());
        }
        settings
    }

    fn settings_and_devices(&self, options: &RenderOptions, exposure_ev: f64) -> [Section; 2] {
        let mut table = Table::of_fields(&self.settings(options, exposure_ev));
        let frames = self.rows.first().map_or(0, |r| r.frames);
        table.rows.push(vec!["timed_frames".to_owned(), frames.to_string()]);
        let devices = Table::of_devices(self.devices.iter().map(Vec::as_slice));
        let section = |heading, table| Section { heading, table: Some(table), ..Section::default() };
        [section("Settings", table), section("Devices", devices)]
    }

    fn simulation(&self, options: &RenderOptions) -> Result<Section, Failure> {
        let title = format!("Simulated speed-up of {} at {}", options.shot, options.settings.size);
        let figure = simulation_svg(title, &self.simulated).context("cannot draw the plot of the simulation")?;
        let notes = "Frames simulated on a virtual clock, with the costs measured on the largest number of devices \
            that does not exceed the cores. Speed-up: relative to the measured frames of one device, as in the table \
            of measured counts; the ideal is the sum of speeds. Critical path: the chain of dependent tasks that determines the frame time.";
        Ok(Section {
            heading: "Simulation",
            notes: vec![notes.to_owned()],
            table: Some(simulation_table(&self.simulated)),
            figure: Some(figure),
        })
    }
}
