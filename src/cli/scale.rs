//! `diptych scale`: the same frames at several device counts.

use std::io::Write;

use anyhow::Context;
use serde::Serialize;

use diptych::exec::{FrameReport, TimedTask};
use diptych::image::file::atomic_write;
use diptych::report::{Axis, Chart, Series, line_chart_svg, median_of, text_table};
use diptych::schedule::CostModel;
use diptych::trace::frames::record_devices;

use super::failure::Failure;
use super::faults::refuse_faults;
use super::interrupt;
use super::options::RenderOptions;
use super::output;
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
}

/// Timed frames when `--frames` does not ask for more.
const REPEATS: u32 = 5;

/// One row of `scale.csv`.
#[derive(Clone, Debug, Serialize)]
struct Row {
    devices: usize,
    makespan_ms: f64,
    makespan_ms_min: f64,
    makespan_ms_max: f64,
    speedup: f64,
    efficiency: f64,
    /// Busy time of the busiest device over the mean.
    imbalance: f64,
    /// Host time in transfers over the makespan times the devices.
    transfer_share: f64,
    /// More worker threads than cores.
    oversubscribed: bool,
    /// Share of the makespan in which a device's queue ran no stage, mean over devices.
    idle_share: f64,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let options = &args.options;
    options.check().map_err(Failure::Input)?;
    args.simulation.check()?;
    output::prepare(&options.out, "--out")?;
    interrupt::watch()?;
    let tracing = Tracing::start(options)?;
    let loaded = setup::load(options)?;
    let timed = options.frames.max(REPEATS);
    let steps = args.counts.len() as u64 * u64::from(timed + args.warm_up);
    let progress = Progress::new(steps, options.quiet, options.json);
    let mut rows: Vec<Row> = Vec::new();
    let mut model: Option<CostModel> = None;
    for &count in &args.counts {
        let base = rows.first().map(|r: &Row| (r.devices, r.makespan_ms));
        let (row, costs) = measure(args, &loaded, usize::from(count), timed, base, &progress, &tracing)?;
        if !row.oversubscribed && model.as_ref().is_none_or(|m| m.spec().devices < row.devices) || model.is_none() {
            model = Some(costs);
        }
        rows.push(row);
    }
    progress.finish();
    write_results(args, &rows)?;
    tracing.finish()?;
    let simulated = match model.filter(|_| args.simulation.is_wanted()) {
        Some(model) => {
            let measured: Vec<_> = rows.iter().map(|r| (r.devices, r.makespan_ms)).collect();
            args.simulation.run(options, &model, &measured)?
        }
        None => Vec::new(),
    };
    if options.json {
        say!("{}", serde_json::json!({ "event": "result", "rows": rows, "simulated": simulated }));
    } else if !options.quiet {
        print_table(&rows);
        say!("scale.csv and scale.svg: {}", options.out.display());
        if args.simulation.is_wanted() {
            simulate::print_table(&simulated);
            say!("simulate.csv: {}", options.out.display());
        }
    }
    Ok(())
}

fn measure(
    args: &Args,
    loaded: &Loaded,
    count: usize,
    timed: u32,
    base: Option<(usize, f64)>,
    progress: &Progress,
    tracing: &Tracing,
) -> Result<(Row, CostModel), Failure> {
    let options = &args.options;
    let gpus = setup::open_devices(options, count)?;
    let threads: usize = gpus.iter().filter_map(|g| g.info.threads).sum();
    let mut renderer = setup::renderer(options, loaded, gpus, tracing.recorder.origin())?;
    record_devices(&tracing.recorder, renderer.devices());
    let devices = renderer.devices().len();
    let mut frames = Vec::new();
    for i in 0..args.warm_up + timed {
        // A sequence moves along the path; a single frame is repeated.
        let step = if options.frames > 1 { f64::from(i.saturating_sub(args.warm_up)) / options.fps } else { 0.0 };
        let frame = renderer.render(&loaded.shot.rig, options.time + step, i)?;
        refuse_faults(&renderer)?;
        interrupt::check()?;
        let event = serde_json::json!({ "event": "frame", "devices": devices, "makespan_ms": frame.makespan_ms });
        progress.step(format!("{devices} device(s) {:.1} ms", frame.makespan_ms), &event);
        if i >= args.warm_up {
            // Each count's frames get numbers of their own in the trace.
            let shown = FrameReport { index: frame.index + count as u32 * 1_000_000, ..frame.clone() };
            tracing.record(options, &shown);
            frames.push(frame);
        }
    }
    let median = |f: &dyn Fn(&FrameReport) -> f64| median_of(frames.iter().map(f).collect());
    let makespan_ms = median(&|f| f.makespan_ms);
    let (base_devices, base_ms) = base.unwrap_or((devices, makespan_ms));
    let speedup = base_ms / makespan_ms;
    let row = Row {
        devices,
        makespan_ms,
        makespan_ms_min: frames.iter().map(|f| f.makespan_ms).fold(f64::INFINITY, f64::min),
        makespan_ms_max: frames.iter().map(|f| f.makespan_ms).fold(0.0, f64::max),
        speedup,
        efficiency: speedup * base_devices as f64 / devices as f64,
        imbalance: median(&|f| {
            let busy = busy_ms(f, devices);
            busy.iter().copied().fold(0.0, f64::max) * devices as f64 / busy.iter().sum::<f64>().max(1e-9)
        }),
        transfer_share: median(&|f| transfer_ms(f) / (f.makespan_ms * devices as f64)),
        oversubscribed: threads > std::thread::available_parallelism().map_or(1, usize::from),
        idle_share: median(&|f| 1.0 - busy_ms(f, devices).iter().sum::<f64>() / (f.makespan_ms * devices as f64)),
    };
    Ok((row, renderer.costs().clone()))
}

fn busy_ms(frame: &FrameReport, devices: usize) -> Vec<f64> {
    let mut busy = vec![0.0; devices];
    for task in frame.tasks.iter().filter(|t| matches!(t.kind, TimedTask::Gpu(_))) {
        busy[task.device] += task.end_ms - task.begin_ms;
    }
    busy
}

fn transfer_ms(frame: &FrameReport) -> f64 {
    let transfers = frame.tasks.iter().filter(|t| !matches!(t.kind, TimedTask::Gpu(_)));
    transfers.map(|t| t.end_ms - t.begin_ms).fold(0.0, |sum, ms| sum + ms)
}

fn write_results(args: &Args, rows: &[Row]) -> Result<(), Failure> {
    let out = &args.options.out;
    atomic_write(&out.join("scale.csv"), |file| {
        writeln!(
            file,
            "devices,makespan_ms,makespan_ms_min,makespan_ms_max,speedup,efficiency,imbalance,transfer_share,oversubscribed,idle_share"
        )?;
        for r in rows {
            writeln!(
                file,
                "{},{:.4},{:.4},{:.4},{:.4},{:.4},{:.4},{:.5},{},{:.5}",
                r.devices,
                r.makespan_ms,
                r.makespan_ms_min,
                r.makespan_ms_max,
                r.speedup,
                r.efficiency,
                r.imbalance,
                r.transfer_share,
                r.oversubscribed,
                r.idle_share
            )?;
        }
        Ok(())
    })?;
    let points = |f: &dyn Fn(&Row) -> f64| rows.iter().map(|r| (r.devices as f64, f(r))).collect();
    let first = rows.first().map_or(1.0, |r| r.devices as f64);
    let chart = Chart {
        title: format!("Speed-up of {} at {}", args.options.shot, args.options.size),
        x: Axis { label: "devices".into(), log: false },
        y: Axis { label: "speed-up".into(), log: false },
    };
    let series = [
        Series { name: "ideal".into(), points: points(&|r| r.devices as f64 / first), band: None, guide: true },
        Series { name: "measured".into(), points: points(&|r| r.speedup), band: None, guide: false },
    ];
    let svg = line_chart_svg(&chart, &series).context("cannot draw the plot")?;
    atomic_write(&out.join("scale.svg"), |file| file.write_all(svg.as_bytes()))?;
    Ok(())
}

fn print_table(rows: &[Row]) {
    let cells: Vec<Vec<String>> = rows
        .iter()
        .map(|r| {
            vec![
                r.devices.to_string(),
                format!("{:.1}", r.makespan_ms),
                format!("{:.1}..{:.1}", r.makespan_ms_min, r.makespan_ms_max),
                format!("{:.2}", r.speedup),
                format!("{:.2}", r.efficiency),
                format!("{:.3}", r.imbalance),
                format!("{:.4}", r.transfer_share),
                format!("{:.4}", r.idle_share),
                if r.oversubscribed { "oversubscribed".into() } else { String::new() },
            ]
        })
        .collect();
    let headers =
        ["devices", "makespan ms", "min..max", "speed-up", "efficiency", "imbalance", "transfers", "idle", "note"];
    say!("{}", text_table(&headers, &cells).trim_end());
}
