//! Time limits of devices, and detection of those that hang.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::device::WAIT_SLICES;
use crate::stages::shader_folder;

/// Time limit before the first frame: `UNKNOWN_BASE` plus this time per sample, which exceeds that of any useful device
/// by far.
const UNKNOWN_SAMPLE: Duration = Duration::from_micros(20);
const UNKNOWN_BASE: Duration = Duration::from_secs(30);
/// Limit of batch runs: this many times the slowest frame's time per sample, and at least this duration.
const TOLERANCE: f64 = 16.0;
const FLOOR: Duration = Duration::from_secs(10);
/// Limit of interactive runs: this many times the frame budget or the slowest recent frame, and at least this duration.
/// A worker counts as hung after at most [`SILENT_SLICES`] + 1 slices of its limit: 0.83 s with the minimum limit. The
/// other devices have the rest of a second to render the frame again.
const INTERACTIVE_TOLERANCE: f64 = 6.0;
const INTERACTIVE_FLOOR: Duration = Duration::from_millis(600);
/// Upper bound of limits that follow a budget, in seconds.
const DAY_S: f64 = 86_400.0;
/// Factor by which the time of the slowest recent frame decays with each later frame. It halves in seven frames.
const FADING: f64 = 0.9;

/// Derives the time that a device may take for its part of a frame.
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// Fixed limit of the user; `None` derives the limit from the times of frames.
    pub fixed: Option<Duration>,
    /// Frame budget of an interactive run in milliseconds; `None` in batch runs. The control loop keeps expected frame
    /// times below the budget at any quality, so the limit does not depend on the number of samples.
    pub budget_ms: Option<f64>,
    /// Time per sample of the slowest frame.
    ms_per_sample: Option<f64>,
    /// Time of the slowest recent frame. It decays with each later frame, see [`FADING`].
    recent_ms: f64,
}

impl Limits {
    /// Returns the limit for a frame that has `samples` samples in the images of both eyes. If shaders are read from a
    /// folder, each frame may have to compile them.
    pub fn limit(&self, samples: u64) -> Duration {
        let compiles = if shader_folder().is_some() { UNKNOWN_BASE } else { Duration::ZERO };
        self.fixed.unwrap_or_else(|| compiles.max(self.derived(samples)))
    }

    /// Returns the limit that follows from the times of frames.
    fn derived(&self, samples: u64) -> Duration {
        match (self.ms_per_sample, self.budget_ms) {
            (None, _) => UNKNOWN_BASE + UNKNOWN_SAMPLE.mul_f64(samples as f64),
            (Some(ms), None) => FLOOR.max(Duration::from_secs_f64(TOLERANCE * ms * samples as f64 * 1e-3)),
            (Some(_), Some(budget_ms)) => {
                let limit_s = INTERACTIVE_TOLERANCE * self.recent_ms.max(budget_ms) * 1e-3;
                INTERACTIVE_FLOOR.max(Duration::from_secs_f64(limit_s.min(DAY_S)))
            }
        }
    }

    /// Learns from a frame's makespan.
    pub fn learn(&mut self, samples: u64, makespan_ms: f64) {
        let makespan_ms = makespan_ms.max(0.0);
        let ms = makespan_ms / samples.max(1) as f64;
        self.ms_per_sample = Some(self.ms_per_sample.map_or(ms, |slowest| slowest.max(ms)));
        self.recent_ms = makespan_ms.max(FADING * self.recent_ms);
    }
}

/// Signs of life of a worker.
#[derive(Debug, Default)]
pub struct Heartbeat {
    beats: AtomicU64,
    /// True while the worker waits for other workers. If one of these hangs, this worker is silent, too, but not hung.
    depends: AtomicBool,
}

/// Snapshot of a worker's signs of life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct LifeSign {
    pub beats: u64,
    /// True while the worker waits for other workers.
    pub depends: bool,
}

impl Heartbeat {
    pub fn beat(&self) {
        self.beats.fetch_add(1, Ordering::Relaxed);
    }

    /// Mirrors the signs of life of a worker on another rank.
    pub fn show(&self, sign: LifeSign) {
        self.beats.store(sign.beats, Ordering::Relaxed);
        self.depends.store(sign.depends, Ordering::Relaxed);
    }

    /// Runs `wait`, which waits for other workers. Sets `depends` meanwhile.
    pub fn depending<T>(&self, wait: impl FnOnce() -> T) -> T {
        self.depends.store(true, Ordering::Relaxed);
        let found = wait();
        self.depends.store(false, Ordering::Relaxed);
        self.beat();
        found
    }

    pub fn sign(&self) -> LifeSign {
        LifeSign { beats: self.beats.load(Ordering::Relaxed), depends: self.depends.load(Ordering::Relaxed) }
    }
}

/// Number of slices without a sign of life after which a worker counts as hung. A worker that waits for a hung device
/// gives up two slices earlier, so that it can still report the reason itself.
const SILENT_SLICES: u32 = WAIT_SLICES + 2;

/// Watches workers while the renderer waits for their answers. Time is counted in slices, so that a suspension of the
/// whole process counts as one.
pub struct Watchdog {
    slice: Duration,
    slice_begin: Instant,
    /// Last number of beats of each worker, and the number of slices for which it has not changed.
    seen: Vec<(u64, u32)>,
}

impl Watchdog {
    /// Starts to watch workers with these signs of life.
    pub fn new(limit: Duration, signs: &[LifeSign]) -> Self {
        let seen = signs.iter().map(|sign| (sign.beats, 0)).collect();
        Self { slice: limit / WAIT_SLICES, slice_begin: Instant::now(), seen }
    }

    /// Returns the time until the next check.
    pub fn until_look(&self) -> Duration {
        self.slice.saturating_sub(self.slice_begin.elapsed())
    }

    /// Returns the workers, by index in `signs`, that have been silent for too long without waiting for others.
    pub fn silent(&mut self, signs: &[LifeSign]) -> Vec<usize> {
        if self.slice_begin.elapsed() < self.slice {
            return Vec::new();
        }
        self.slice_begin = Instant::now();
        let mut silent = Vec::new();
        for (i, (sign, (beats, slices))) in signs.iter().zip(&mut self.seen).enumerate() {
            *slices = if sign.beats != *beats || sign.depends { 0 } else { *slices + 1 };
            *beats = sign.beats;
            if *slices >= SILENT_SLICES {
                silent.push(i);
            }
        }
        silent
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_follow_the_slowest_frame() {
        let mut limits = Limits::default();
        assert_eq!(limits.limit(1_000_000), Duration::from_secs(50));
        limits.learn(1000, 100.0);
        limits.learn(1000, 50.0);
        assert_eq!(limits.limit(1000), FLOOR);
        assert_eq!(limits.limit(1_000_000), Duration::from_secs(1600));
        limits.fixed = Some(Duration::from_millis(5));
        assert_eq!(limits.limit(1_000_000), Duration::from_millis(5));
    }

    #[test]
    fn interactive_limits_follow_budget_and_recent_frames() {
        let mut limits = Limits::default();
        limits.learn(1000, 20.0);
        limits.budget_ms = Some(20.0);
        assert_eq!(limits.limit(1000), INTERACTIVE_FLOOR);
        // Quality changes the number of samples, but not the expected time.
        assert_eq!(limits.limit(64_000), INTERACTIVE_FLOOR);
        // A hang costs less than a second, including the repeated frame.
        assert!(INTERACTIVE_FLOOR / WAIT_SLICES * (SILENT_SLICES + 1) < Duration::from_millis(850));
        // A device that slows down to half its speed stays far from the limit, at any frame time.
        for ms in [20.0, 100.0, 500.0, 3000.0] {
            limits.learn(1000, ms);
            assert!(limits.limit(1000) >= Duration::from_secs_f64(2.5 * 2.0 * ms * 1e-3), "{ms}");
        }
        assert_eq!(limits.limit(1000), Duration::from_secs(18));
        (0..60).for_each(|_| limits.learn(1000, 20.0));
        assert_eq!(limits.limit(1000), INTERACTIVE_FLOOR);
        // Budgets may be of any length.
        for (budget_ms, limit_s) in [(1e300, 86_400), (2000.0, 12)] {
            limits.budget_ms = Some(budget_ms);
            assert_eq!(limits.limit(1000), Duration::from_secs(limit_s));
        }
        // A batch run remembers the slowest frame.
        limits.budget_ms = None;
        assert_eq!(limits.limit(1000), Duration::from_secs(48));
    }

    #[test]
    fn only_independent_silent_devices_are_hung() {
        let mut signs = [LifeSign::default(), LifeSign { depends: true, ..Default::default() }, LifeSign::default()];
        let mut watchdog = Watchdog::new(Duration::from_millis(8), &signs);
        let mut found = Vec::new();
        for _ in 0..SILENT_SLICES {
            assert_eq!(found, [0; 0]);
            signs[2].beats += 1;
            std::thread::sleep(watchdog.until_look());
            found = watchdog.silent(&signs);
        }
        assert_eq!(found, [0]);
    }

    #[test]
    fn heartbeat_reports_beats_and_dependence() {
        let heartbeat = Heartbeat::default();
        heartbeat.beat();
        assert_eq!(heartbeat.sign(), LifeSign { beats: 1, depends: false });
        assert_eq!(heartbeat.depending(|| heartbeat.sign()), LifeSign { beats: 1, depends: true });
        assert_eq!(heartbeat.sign(), LifeSign { beats: 2, depends: false });
    }
}
