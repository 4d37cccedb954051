//! How long devices may take, and telling which of them stands still.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crate::device::WAIT_SLICES;

/// Before there is a frame to go by: far slower than any device that is worth its place, and half a minute more.
const UNKNOWN_SAMPLE: Duration = Duration::from_micros(20);
const UNKNOWN_BASE: Duration = Duration::from_secs(30);
/// Later: this many times what the slowest frame took for each sample, and this at least.
const TOLERANCE: f64 = 16.0;
const FLOOR: Duration = Duration::from_secs(10);

/// Limit of the time that a device takes for its part of a frame.
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// Asked for; else it follows from what frames took.
    pub fixed: Option<Duration>,
    /// Of the slowest frame.
    ms_per_sample: Option<f64>,
}

impl Limits {
    /// For a frame of so many samples, both eyes.
    pub fn limit(&self, samples: u64) -> Duration {
        self.fixed.unwrap_or_else(|| match self.ms_per_sample {
            None => UNKNOWN_BASE + UNKNOWN_SAMPLE.mul_f64(samples as f64),
            Some(ms) => FLOOR.max(Duration::from_secs_f64(TOLERANCE * ms * samples as f64 * 1e-3)),
        })
    }

    /// A frame's makespan.
    pub fn learn(&mut self, samples: u64, makespan_ms: f64) {
        let ms = makespan_ms.max(0.0) / samples.max(1) as f64;
        self.ms_per_sample = Some(self.ms_per_sample.map_or(ms, |slowest| slowest.max(ms)));
    }
}

/// Signs of life of a worker.
#[derive(Debug, Default)]
pub struct Heartbeat {
    beats: AtomicU64,
    /// Its silence is another's.
    depends: AtomicBool,
}

impl Heartbeat {
    pub fn beat(&self) {
        self.beats.fetch_add(1, Ordering::Relaxed);
    }

    /// A wait for other workers.
    pub fn depending<T>(&self, wait: impl FnOnce() -> T) -> T {
        self.depends.store(true, Ordering::Relaxed);
        let found = wait();
        self.depends.store(false, Ordering::Relaxed);
        self.beat();
        found
    }
}

/// Slices of a limit in which a worker shows no sign of life before it counts as hung. One that waits for its device
/// gives up two before by itself, and can then say why.
const SILENT_SLICES: u32 = WAIT_SLICES + 2;

/// Watches over workers while their answers are awaited. Time is counted in slices, so that a stop of the whole process
/// counts as one.
pub struct Watchdog {
    slice: Duration,
    slice_begin: Instant,
    /// Per worker: beats seen last, and for how many slices.
    seen: Vec<(u64, u32)>,
}

impl Watchdog {
    pub fn new(limit: Duration, heartbeats: &[&Heartbeat]) -> Self {
        let seen = heartbeats.iter().map(|p| (p.beats.load(Ordering::Relaxed), 0)).collect();
        Self { slice: limit / WAIT_SLICES, slice_begin: Instant::now(), seen }
    }

    /// How long to wait for an answer before the next look.
    pub fn slice(&self) -> Duration {
        self.slice
    }

    /// The workers, by their place in `heartbeats`, that have been silent for too long on their own account.
    pub fn silent(&mut self, heartbeats: &[&Heartbeat]) -> Vec<usize> {
        if self.slice_begin.elapsed() < self.slice {
            return Vec::new();
        }
        self.slice_begin = Instant::now();
        let mut silent = Vec::new();
        for (i, (heartbeat, (beats, slices))) in heartbeats.iter().zip(&mut self.seen).enumerate() {
            let now = heartbeat.beats.load(Ordering::Relaxed);
            *slices = if now != *beats || heartbeat.depends.load(Ordering::Relaxed) { 0 } else { *slices + 1 };
            *beats = now;
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
    fn only_who_stands_still_on_his_own_account_is_hung() {
        let heartbeats = [Heartbeat::default(), Heartbeat::default(), Heartbeat::default()];
        let all: Vec<&Heartbeat> = heartbeats.iter().collect();
        let mut watchdog = Watchdog::new(Duration::from_millis(8), &all);
        heartbeats[1].depends.store(true, Ordering::Relaxed);
        let mut found = Vec::new();
        for _ in 0..SILENT_SLICES {
            assert_eq!(found, [0; 0]);
            heartbeats[2].beat();
            std::thread::sleep(watchdog.slice());
            found = watchdog.silent(&all);
        }
        assert_eq!(found, [0]);
    }
}
