//! `diptych play --set controller=NAME,NAME`: several controllers, played in turns.

use anyhow::Context;

use crate::report::comparison::{ControlRun, comparison_csv, comparison_svg, comparison_table, recovery_svg};
use crate::report::play::{PlaySummary, SETTLING_FRAMES};
use crate::report::samples::FrameSamples;
use diptych::exec::PerView;
use diptych::frame::Disturbance;
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::metrics::Pair;

use super::args::Args;
use super::prepared::Prepared;
use super::references::{Kept, References};
use super::session::Session;
use super::{Run, interrupt};
use crate::failure::Failure;
use crate::progress::Progress;
use crate::setup::{self, Tracing};
use crate::{metering, output};

/// Interval of the frames that are compared with references, and the maximum number of these frames.
const INTERVAL: usize = 8;
const COMPARED: usize = 24;
/// Default samples per pixel of a reference.
const SPP: u32 = 256;

/// Plays with each controller in turns. The ladder is determined before, so that all runs use the same one.
pub fn run(args: &Args) -> Result<(), Failure> {
    let mut prepared = Prepared::new(&args.loop_options(), Some(args.frames))?;
    prepared.fits_size = Some(args.fit);
    let out = prepared.render.out.clone();
    output::prepare(&out, "--out")?;
    interrupt::watch()?;
    let progress = Progress::text(prepared.render.quiet, prepared.render.json);
    let mut loaded = setup::load(&prepared.render)?;
    setup::tell_remarks(&loaded.scene);
    let gpus = setup::open_devices(&prepared.render, usize::from(args.options.virtual_devices))?;
    let gpus = metering::meter(&prepared.render, &mut loaded, gpus, &progress)?;
    let tracing = Tracing::start(&prepared.render)?;
    let session = Session::start(&mut prepared, &loaded, gpus, tracing, Progress::text(true, false))?;
    prepared.choice.ladder = Some(session.ladder().clone());
    drop(session.inner);
    // The first session has found a size that fits.
    prepared.fits_size = None;
    let mut runs: Vec<ControlRun> = Vec::new();
    let mut references: Vec<PerView<RgbImage>> = Vec::new();
    let kinds = prepared.render.settings.controller.clone();
    let count = prepared.render.settings.runs;
    for number in 0..count {
        for &kind in &kinds {
            prepared.render.run.settings.controller = vec![kind];
            prepared.render.run.out = out.join(format!("{}.{number}", kind.to_string().replace(':', "-")));
            let (play, frames, makespans) = play(args, &mut prepared, &loaded)?;
            interrupt::check()?;
            if references.is_empty() {
                progress.tell(&format!("rendering {} references", frames.len()));
                references = render_references(args, &prepared, &mut loaded, &frames)?;
            }
            let flip = mean_flip(&frames, &references, loaded.shot.exposure_ev)?;
            let run = ControlRun::new(kind, number, &play, flip, makespans);
            progress.tell(&format!(
                "run {} of {}, {kind}: {:.1} % of display periods missed, FLIP {flip:.4}",
                number + 1,
                count,
                100.0 * run.missed_fraction
            ));
            runs.push(run);
            comparison_csv(&runs).write(&out.join("comparison.csv"))?;
        }
    }
    let title = format!("Controllers: {} at {}", prepared.render.shot, prepared.render.settings.size);
    let figure = comparison_svg(title, &runs).context("cannot draw the plot")?;
    output::write_text(&out, "comparison.svg", &figure)?;
    if let Some(at) = prepared.render.settings.disturb.iter().map(Disturbance::first_frame).min() {
        let budget_ms = args.options.budget_ms.hi_ms();
        let title = format!("Recovery: {} at {}", prepared.render.shot, prepared.render.settings.size);
        let figure = recovery_svg(title, &runs, at, budget_ms).context("cannot draw the recovery")?;
        output::write_text(&out, "recovery.svg", &figure)?;
    }
    if args.options.run.json {
        say!("{}", serde_json::json!({ "event": "result", "out": out.display().to_string(), "runs": runs }));
    } else if !args.options.run.quiet {
        say!("{}", comparison_table(&runs).text().trim_end());
        say!("comparison.csv, comparison.svg, and a folder per run: {}", out.display());
    }
    Ok(())
}

/// A run's summary, the frames to compare, and the number and makespan of each frame.
type Played = (PlaySummary, Vec<Kept>, Vec<(u32, f64)>);

/// Plays the frames with one controller.
fn play(args: &Args, prepared: &mut Prepared, loaded: &LoadedScene) -> Result<Played, Failure> {
    output::prepare(&prepared.render.out, "--out")?;
    let tracing = Tracing::start(&prepared.render)?;
    let gpus = setup::open_devices(&prepared.render, usize::from(args.options.virtual_devices))?;
    let session = Session::start(prepared, loaded, gpus, tracing, Progress::text(true, false))?;
    let mut run = Run::new(args, &prepared.render, loaded, session)?;
    let judged = (args.frames as usize).saturating_sub(SETTLING_FRAMES);
    run.watched = Some((INTERVAL.max(judged.div_ceil(COMPARED)), Vec::new()));
    run.samples = Some(FrameSamples::default());
    let stopped = run.frames()?;
    let Run { session, record, pictures, watched, samples, .. } = run;
    let mut report = session.report(prepared, loaded, &record);
    report.pictures = pictures.names();
    report.write(&prepared.render.out.join("run.json"))?;
    record.finish()?;
    session.ladder().write(&prepared.render.out.join("ladder.toml")).map_err(anyhow::Error::from)?;
    let name = prepared.render.settings.controller[0];
    let reason = |reason| Failure::Run(anyhow::anyhow!("{name}: {reason}"));
    stopped.map_or(Ok(()), |why| Err(reason(why)))?;
    let play = report.play.context("no frame was judged")?;
    let samples = samples.unwrap_or_default();
    let makespans = samples.frames().iter().map(|frame| (frame.index, frame.makespan_ms)).collect();
    Ok((play, watched.map_or_else(Vec::new, |(_, frames)| frames), makespans))
}

fn render_references(
    args: &Args,
    prepared: &Prepared,
    loaded: &mut LoadedScene,
    frames: &[Kept],
) -> Result<Vec<PerView<RgbImage>>, Failure> {
    let path = loaded.shot.rig.clone();
    let mut renderer =
        References::new(args, &prepared.render, loaded, Some(prepared.render.settings.report_spp.unwrap_or(SPP)))?;
    let references = frames.iter().map(|frame| Ok(renderer.of(frame, loaded)?.0)).collect();
    loaded.shot.rig = path;
    references
}

/// Returns the mean FLIP of both eyes of all frames.
fn mean_flip(frames: &[Kept], references: &[PerView<RgbImage>], exposure_ev: f32) -> Result<f64, Failure> {
    let mut sum = 0.0;
    for (Kept { linear, .. }, reference) in frames.iter().zip(references) {
        for (reference, image) in reference.iter().zip(linear.iter()) {
            sum += Pair::new(reference, image, exposure_ev)?.errors().flip;
        }
    }
    Ok(sum / (2 * frames.len().min(references.len())).max(1) as f64)
}
