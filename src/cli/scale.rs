//! `diptych scale`: the same frames at several device counts.

use anyhow::Context;

use diptych::device::DeviceInfo;
use diptych::exec::{FrameReport, Renderer, Stereo};
use diptych::graph::PhysicalImage;
use diptych::image::RgbImage;
use diptych::report::Table;
use diptych::report::html::Section;
use diptych::report::lanes::{LaneFrame, median_frame};
use diptych::report::pictures::Group;
use diptych::report::scale::{Row, scale_csv, scale_sections, scale_svg, scale_table};
use diptych::report::simulation::{self, simulation_csv, simulation_svg, simulation_table};
use diptych::schedule::CostModel;
use diptych::trace::frames::record_devices;

use super::failure::Failure;
use super::faults::refuse_faults;
use super::interrupt;
use super::options::RenderOptions;
use super::output::{self, same_bits};
use super::page::{self, and_page};
use super::progress::Progress;
use super::setup::{self, Loaded, Tracing};
use super::simulate;

#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    options: RenderOptions,
    /// Device counts: virtual devices on each chosen adapter
    #[arg(long, value_delimiter = ',', default_value = "1,2", value_name = "N,N,…", value_parser = clap::value_parser!(u16).range(1..=64))]
    counts: Vec<u16>,
    /// Frames before those that are timed: drivers compile, stripes settle
    #[arg(long, default_value_t = 3)]
    warm_up: u32,
    #[command(flatten)]
    simulation: simulate::Args,
    /// Also write report.html: the picture, speed-up, what limits it, and swimlanes of a frame of each count
    #[arg(long)]
    report: bool,
}

/// Timed frames when `--frames` does not ask for more.
const REPEATS: u32 = 5;

pub fn run(args: &Args) -> Result<(), Failure> {
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    args.simulation.check(options)?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let loaded = setup::load(options)?;
    let timed = options.frames.max(REPEATS);
    let steps = args.counts.len() as u64 * u64::from(args.warm_up + timed + followers(options));
    let progress = Progress::new(steps, options.quiet, options.json);
    let mut found = Found::default();
    let mut model: Option<CostModel> = None;
    for &count in &args.counts {
        let first = found.rows.first();
        let (row, mut renderer, frame) = measure(args, &loaded, usize::from(count), timed, first, &progress, &tracing)?;
        if !row.oversubscribed && model.as_ref().is_none_or(|m| m.spec().devices < row.devices) || model.is_none() {
            model = Some(renderer.costs().clone());
        }
        found.rows.push(row);
        found.devices.push(renderer.devices().to_vec());
        found.policy = renderer.policy_name();
        if args.report {
            found.seen.add(renderer.read_linear()?, frame);
        }
    }
    progress.finish();
    let figure = found.write_rows(options)?;
    tracing.finish()?;
    let mut files = "scale.csv and scale.svg";
    if let Some(model) = model.filter(|_| args.simulation.is_wanted()) {
        files = "scale.csv, scale.svg and simulate.csv";
        let measured: Vec<_> = found.rows.iter().map(|r| (r.devices, r.makespan_ms)).collect();
        found.simulated = args.simulation.run(options, &model, &measured)?;
        output::write_text(&options.out, "simulate.csv", &simulation_csv(&found.simulated))?;
    }
    if args.report {
        found.write_page(args, &loaded, figure)?;
    }
    let Found { rows, simulated, .. } = &found;
    if options.json {
        say!("{}", serde_json::json!({ "event": "result", "rows": rows, "simulated": simulated }));
    } else if !options.quiet {
        say!("{}", scale_table(rows).text().trim_end());
        if !simulated.is_empty() {
            say!("{}", simulation_table(simulated).text().trim_end());
        }
        say!("{}{files}: {}", and_page(args.report), options.out.display());
    }
    Ok(())
}

/// Frames behind those that are timed, so that these share the devices to the last: without others behind them, frames
/// end sooner.
fn followers(options: &RenderOptions) -> u32 {
    u32::from(options.frames_in_flight).saturating_sub(1)
}

/// A row, its renderer, and a frame of median makespan.
fn measure(
    args: &Args,
    loaded: &Loaded,
    count: usize,
    timed: u32,
    first: Option<&Row>,
    progress: &Progress,
    tracing: &Tracing,
) -> Result<(Row, Renderer, Option<FrameReport>), Failure> {
    let options = &args.options;
    let gpus = setup::open_devices(options, count)?;
    let threads: usize = gpus.iter().filter_map(|g| g.info.threads).sum();
    let mut renderer = setup::renderer(options, loaded, gpus, tracing.recorder.origin())?;
    record_devices(&tracing.recorder, renderer.devices());
    let devices = renderer.devices().len();
    let (mut frames, mut begun) = (Vec::new(), 0);
    let timed = args.warm_up..args.warm_up + timed;
    loop {
        while begun < timed.end + followers(options) && renderer.in_flight() < usize::from(options.frames_in_flight) {
            // A sequence moves along the path; a single frame is repeated.
            let number = if options.frames > 1 { begun.saturating_sub(args.warm_up) } else { 0 };
            let time_s = options.time + f64::from(number) / options.fps;
            begun += 1;
            let is_last = begun == timed.end + followers(options);
            let reads = if args.report && is_last { &[PhysicalImage::Linear][..] } else { &[] };
            renderer.begin(&loaded.shot.rig, time_s, begun - 1, reads)?;
        }
        let Some(frame) = renderer.finish()? else { break };
        refuse_faults(&renderer)?;
        interrupt::check()?;
        let event = serde_json::json!({ "event": "frame", "devices": devices, "makespan_ms": frame.makespan_ms });
        progress.step(format!("{devices} device(s) {:.1} ms", frame.makespan_ms), &event);
        if timed.contains(&frame.index) {
            // Each count's frames get numbers of their own in the trace.
            let shown = FrameReport { index: frame.index + count as u32 * 1_000_000, ..frame.clone() };
            tracing.record(options, &shown);
            frames.push(frame);
        }
    }
    let oversubscribed = threads > std::thread::available_parallelism().map_or(1, usize::from);
    let row = Row::new(devices, &frames, oversubscribed, first);
    let makespans_ms: Vec<f64> = frames.iter().map(|f| f.makespan_ms).collect();
    Ok((row, renderer, frames.into_iter().nth(median_frame(&makespans_ms))))
}

/// What there is to tell.
#[derive(Default)]
struct Found {
    rows: Vec<Row>,
    /// Of each row.
    devices: Vec<Vec<DeviceInfo>>,
    policy: &'static str,
    simulated: Vec<simulation::Row>,
    seen: Seen,
}

/// What there is to see.
#[derive(Default)]
struct Seen {
    /// The last frame of the first count.
    picture: Option<Stereo<RgbImage>>,
    /// Whether the last frame of each further count has the same bytes.
    same_bytes: Vec<bool>,
    /// One of median makespan of each count.
    frames: Vec<FrameReport>,
}

impl Seen {
    fn add(&mut self, picture: Stereo<RgbImage>, frame: Option<FrameReport>) {
        self.frames.extend(frame);
        match &self.picture {
            None => self.picture = Some(picture),
            Some(first) => self.same_bytes.push(same_bits(first, &picture)),
        }
    }

    fn pictures(&self, loaded: &Loaded) -> Result<Option<Section>, Failure> {
        let Some(picture) = &self.picture else { return Ok(None) };
        let bytes = match &self.same_bytes[..] {
            [] => "Only one count was measured.",
            same if same.iter().all(|same| *same) => "All counts gave the same bytes.",
            _ => "Not all counts gave the same bytes.",
        };
        let note = format!("The last frame of the first count. {bytes}");
        let frame = Group::of_frame("last frame".into(), picture, loaded.shot.exposure_ev);
        page::pictures(note, &[frame]).map(Some)
    }

    fn swimlanes(&self, rows: &[Row]) -> Result<Section, Failure> {
        let name = |row: &Row| format!("{} device(s)", row.devices);
        let frames = rows.iter().zip(&self.frames);
        let frames: Vec<LaneFrame> = frames.map(|(row, frame)| LaneFrame::new(name(row), frame)).collect();
        let note = "Of each count a frame of median makespan.";
        page::swimlanes(note.to_owned(), &frames, frames.len().saturating_sub(1))
    }
}

impl Found {
    /// Table and plot; returns the latter.
    fn write_rows(&self, options: &RenderOptions) -> Result<String, Failure> {
        output::write_text(&options.out, "scale.csv", &scale_csv(&self.rows))?;
        let title = format!("Speed-up of {} at {}", options.shot, options.size);
        let figure = scale_svg(title, &self.rows).context("cannot draw the plot")?;
        output::write_text(&options.out, "scale.svg", &figure)?;
        Ok(figure)
    }

    fn write_page(&self, args: &Args, loaded: &Loaded, figure: String) -> Result<(), Failure> {
        let options = &args.options;
        let title = format!("{} at {} over device counts", options.shot, options.size);
        let mut sections: Vec<Section> = self.seen.pictures(loaded)?.into_iter().collect();
        sections.extend(scale_sections(&self.rows, figure));
        if !self.simulated.is_empty() {
            sections.push(self.simulation(options)?);
        }
        sections.push(self.seen.swimlanes(&self.rows)?);
        sections.extend(self.settings(args, loaded.exposure_ev()));
        sections.push(page::scene(options, loaded));
        page::write(&options.out, &title, &sections)
    }

    fn settings(&self, args: &Args, exposure_ev: f64) -> [Section; 2] {
        let options = &args.options;
        let mut table = Table::of_fields(&setup::run_settings(options, exposure_ev, self.policy));
        table.rows.extend(Table::of_fields(&setup::frame_settings(options)).rows);
        let frames = self.rows.first().map_or(0, |r| r.frames);
        let numbers = [("warm_up_frames", args.warm_up.to_string()), ("timed_frames", frames.to_string())];
        table.rows.extend(numbers.map(|(name, value)| vec![name.to_owned(), value]));
        let devices = Table::of_devices(self.devices.iter().map(Vec::as_slice));
        let section = |heading, table| Section { heading, table: Some(table), ..Section::default() };
        [section("Settings", table), section("Devices", devices)]
    }

    fn simulation(&self, options: &RenderOptions) -> Result<Section, Failure> {
        let title = format!("Simulated speed-up of {} at {}", options.shot, options.size);
        let figure = simulation_svg(title, &self.simulated).context("cannot draw the plot of the simulation")?;
        let notes = "Frames on a virtual clock, with the costs measured on the most devices that fit the cores. Speed-up: \
            over one simulated device of speed 1; the ideal is the sum of speeds. Critical path: the chain of tasks that \
            makes the frame as long as it is.";
        Ok(Section {
            heading: "Simulation",
            notes: vec![notes.to_owned()],
            table: Some(simulation_table(&self.simulated)),
            figure: Some(figure),
        })
    }
}
