//! The loop: passes until there are enough samples or the time is up.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::{Accumulation, Checkpoint, CheckpointError};
use crate::exec::{ExecError, FrameReport, Renderer};
use crate::scene::rig::Rig;

/// Between two writes of a checkpoint: what a run that is killed loses at most, beside a pass.
const SAVE_INTERVAL: Duration = Duration::from_secs(2);

#[derive(Debug, thiserror::Error)]
pub enum AccumulateError {
    #[error(transparent)]
    Exec(#[from] ExecError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
}

/// What to accumulate, and how far.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    pub rig: &'a Rig,
    pub time_s: f64,
    /// Keys the random numbers of all passes.
    pub frame: u32,
    /// Samples of a pass: a power of two, so that Sobol' sequences are even over each, above 1 and at most what the
    /// renderer was made for.
    pub pass_spp: u32,
    /// Samples wanted in all.
    pub spp: u32,
    /// No pass is begun that would probably end later; one always is.
    pub time_limit: Option<Duration>,
    pub checkpoint: Option<&'a Checkpoint>,
    /// No other pass is begun once this is set.
    pub stop: &'a AtomicBool,
}

/// A pass, done.
pub struct Pass<'a> {
    /// With this pass in it.
    pub accumulation: &'a Accumulation,
    pub report: FrameReport,
    /// Since the first pass of this run began, and probably until the last one ends.
    pub elapsed_s: f64,
    pub left_s: f64,
    /// Whether a checkpoint was just written.
    pub saved: bool,
}

/// What came of it.
pub struct Done {
    pub accumulation: Accumulation,
    /// Of this run.
    pub passes: u32,
    pub elapsed_s: f64,
    /// Whether samples are missing because the time was up.
    pub out_of_time: bool,
}

/// Adds passes to `accumulation` until it has the job's samples or the time is up. The samples of a pass depend on its
/// number alone, so the result does not depend on where earlier runs stopped, nor on devices. A last pass that is cut
/// short by the number of samples is in the result but in no checkpoint: whoever goes on takes it whole.
///
/// # Errors
/// [`AccumulateError`]; the checkpoint then holds what was there before.
pub fn accumulate(
    renderer: &mut Renderer,
    job: &Job<'_>,
    mut accumulation: Accumulation,
    mut on_pass: impl FnMut(Pass<'_>),
) -> Result<Done, AccumulateError> {
    let begin = Instant::now();
    let limit_s = job.time_limit.map_or(f64::INFINITY, |l| l.as_secs_f64());
    let (mut saved, mut passes) = (begin, 0);
    let (mut out_of_time, mut is_stopped) = (false, false);
    while accumulation.samples() < job.spp && !out_of_time && !is_stopped {
        let pass_begin = Instant::now();
        let first = accumulation.samples();
        let count = job.pass_spp.min(job.spp - first);
        let report = renderer.render_samples(&renderer.frame(job.rig, job.time_s, job.frame), first..first + count)?;
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
        let pass_s = elapsed_s / f64::from(passes);
        let left_s = (f64::from(missing) / f64::from(job.pass_spp) * pass_s).min((limit_s - elapsed_s).max(0.0));
        let left_s = if out_of_time { 0.0 } else { left_s };
        on_pass(Pass { accumulation: &accumulation, report, elapsed_s, left_s, saved: save.is_some() });
    }
    Ok(Done { accumulation, passes, elapsed_s: begin.elapsed().as_secs_f64(), out_of_time })
}
