//! `diptych render`.

use diptych::report::run::{FrameRow, RunReport};
use diptych::trace::frames::record_devices;

use super::failure::Failure;
use super::options::RenderOptions;
use super::output::{self, FrameImages};
use super::progress::Progress;
use super::setup::{self, Tracing};

#[derive(clap::Args, Debug)]
pub struct Args {
    #[command(flatten)]
    options: RenderOptions,
    /// Virtual devices on each chosen adapter
    #[arg(long = "virtual", default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    virtual_devices: u16,
    /// Also write both eyes as a red-cyan anaglyph
    #[arg(long)]
    anaglyph: bool,
    /// Draw the stripes on stereo.png
    #[arg(long)]
    overlay: bool,
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let options = &args.options;
    output::prepare(&options.out)?;
    let tracing = Tracing::start(options)?;
    let progress = Progress::new(u64::from(options.frames), options.quiet, options.json);
    progress.phase("loading");
    let loaded = setup::load(options)?;
    for warning in &loaded.scene.warnings {
        eprintln!("warning: {warning}");
    }
    let gpus = setup::open_devices(options, usize::from(args.virtual_devices))?;
    progress.phase("warming up");
    let mut renderer = setup::renderer(options, &loaded, gpus, tracing.recorder.origin())?;
    record_devices(&tracing.recorder, renderer.devices());
    let mut rows = Vec::new();
    for i in 0..options.frames {
        let time_s = options.time + f64::from(i) / options.fps;
        let frame = renderer.render(&loaded.shot.rig, time_s, i)?;
        tracing.record(options, &frame);
        let mut images = FrameImages::read(&renderer, &options.aovs())?;
        if args.overlay {
            images.overlay(frame.stripe_edges());
        }
        images.write(&options.out, (options.frames > 1).then_some(i), args.anaglyph)?;
        let row = FrameRow::new(&frame, &setup::frame_settings(options), options.size);
        let event = serde_json::json!({ "event": "frame", "index": i, "makespan_ms": row.makespan_ms });
        progress.step(format!("{:.1} ms", row.makespan_ms), &event);
        rows.push(row);
    }
    progress.finish();
    let settings = setup::run_settings(options, renderer.policy_name());
    let report = RunReport::new(settings, renderer.devices(), &loaded.scene, loaded.needs, !options.no_skip, rows);
    report.write(&options.out.join("run.json"))?;
    tracing.finish()?;
    conclude(options, &report);
    Ok(())
}

/// Says where things are.
fn conclude(options: &RenderOptions, report: &RunReport) {
    let median = report.median_makespan_ms();
    let rays: u64 = report.frames.iter().map(|f| f.rays).sum();
    let total_s: f64 = report.frames.iter().map(|f| f.makespan_ms).sum::<f64>() * 1e-3;
    if options.json {
        let out = options.out.display().to_string();
        say!("{}", serde_json::json!({ "event": "result", "out": out, "median_makespan_ms": median }));
    } else if !options.quiet {
        say!(
            "{} frame(s) of {} on {} device(s): median makespan {median:.1} ms, {:.2} Mrays/s, holes {:.1} %",
            report.frames.len(),
            report.scene.name,
            report.devices.len(),
            rays as f64 / total_s * 1e-6,
            100.0 * report.frames.last().map_or(0.0, |f| f.hole_fraction),
        );
        say!("pictures and run.json: {}", options.out.display());
        if let Some(trace) = &options.trace {
            say!("trace: {} (open it in https://ui.perfetto.dev)", trace.display());
        }
    }
}
