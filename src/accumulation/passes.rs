//! Accumulation loop: renders passes until there are enough samples or time is up.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::{Accumulation, Checkpoint, CheckpointError};
use crate::exec::{ExecError, FrameReport, Renderer};
use crate::scene::rig::Rig;

/// Interval between checkpoints: a killed run loses at most this much time and one pass.
const SAVE_INTERVAL: Duration = Duration::from_secs(2);

#[derive(Debug, thiserror::Error)]
pub enum AccumulateError {
    #[error(transparent)]
    Exec(#[from] ExecError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
}

/// View, samples and limits of an accumulation.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    pub rig: &'a Rig,
    pub time_s: f64,
    /// Frame number, which seeds the random numbers of all passes.
    pub frame: u32,
    /// Samples per pixel and pass: above 1, at most the renderer's limit, and a power of two, so that each pass takes a
    /// well-distributed part of the Sobol' sequence.
    pub pass_spp: u32,
    /// Total number of samples per pixel.
    pub spp: u32,
    /// Time limit. No pass starts that would probably exceed it, except the first.
    pub time_limit: Option<Duration>,
    pub checkpoint: Option<&'a Checkpoint>,
    /// Stop flag. No further pass starts once it is set. If the renderer has the same flag, see
    /// [`Builder::stop`](crate::exec::Builder::stop), a pass that takes long is abandoned.
    pub stop: &'a AtomicBool,
    /// Called repeatedly during a pass, with its number of samples and the fraction of its work that is done.
    pub progress: &'a dyn Fn(u32, f64),
}

/// A completed pass.
pub struct Pass<'a> {
    /// Accumulation including this pass.
    pub accumulation: &'a Accumulation,
    pub report: FrameReport,
    /// Time since the run's first pass started, and estimated time until the last one ends.
    pub elapsed_s: f64,
    pub left_s: f64,
    /// True if a checkpoint was just written.
    pub saved: bool,
}

/// Result of [`accumulate`].
pub struct Done {
    pub accumulation: Accumulation,
    /// Number of passes in this run.
    pub passes: u32,
    pub elapsed_s: f64,
    /// True if samples are missing because time was up.
    pub out_of_time: bool,
}

/// Adds passes to `accumulation` until it has the job's samples or time is up. A pass's samples depend only on its
/// number, so the result depends neither on devices nor on where earlier runs stopped. A last pass that is cut short by
/// the number of samples is in the result but in no checkpoint: a resumed run repeats it in full.
///
/// # Errors
/// [`AccumulateError`]; the checkpoint keeps its last saved state.
pub fn accumulate(
    renderer: &mut Renderer,
    job: &Job<'_>,
    mut accumulation: Accumulation,
    mut on_pass: impl FnMut(Pass<'_>),
) -> Result<Done, AccumulateError> {
    let begin = Instant::now();
    let limit_s = job.time_limit.map_or(f64::INFINITY, |l| l.as_secs_f64());
    let (mut saved, mut unsaved, mut passes) = (begin, false, 0);
    let (mut out_of_time, mut is_stopped) = (false, false);
    while accumulation.samples() < job.spp && !out_of_time && !is_stopped {
        let pass_begin = Instant::now();
        let first = accumulation.samples();
        let count = job.pass_spp.min(job.spp - first);
        let params = renderer.frame(job.rig, job.time_s, job.frame);
        let progress = |fraction| (job.progress)(count, fraction);
        let report = match renderer.render_samples_watched(&params, first..first + count, progress) {
            Err(ExecError::Stopped) => break,
            report => report?,
        };
        let dropped = report.tallies.iter().map(|t| t.nonfinite).sum();
        accumulation.add(first / job.pass_spp, &renderer.read_linear()?, count, dropped);
        passes += 1;
        let elapsed_s = begin.elapsed().as_secs_f64();
        let missing = job.spp - accumulation.samples();
        out_of_time = missing > 0 && elapsed_s + pass_begin.elapsed().as_secs_f64() > limit_s;
        is_stopped = job.stop.load(Ordering::Relaxed);
        let is_last = missing < job.pass_spp || out_of_time || is_stopped;
        let save = job.checkpoint.filter(|_| count == job.pass_spp && (is_last || saved.elapsed() >= SAVE_INTERVAL));
        if let Some(checkpoint) = save {
            checkpoint.save(&accumulation)?;
            saved = Instant::now();
        }
        unsaved = save.is_none() && count == job.pass_spp;
        let pass_s = elapsed_s / f64::from(passes);
        let left_s = (f64::from(missing) / f64::from(job.pass_spp) * pass_s).min((limit_s - elapsed_s).max(0.0));
        let left_s = if out_of_time { 0.0 } else { left_s };
        on_pass(Pass { accumulation: &accumulation, report, elapsed_s, left_s, saved: save.is_some() });
    }
    if let Some(checkpoint) = job.checkpoint.filter(|_| unsaved) {
        checkpoint.save(&accumulation)?;
    }
    Ok(Done { accumulation, passes, elapsed_s: begin.elapsed().as_secs_f64(), out_of_time })
}
