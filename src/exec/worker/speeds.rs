//! Kernels' times per path, which a device measures on the first rows of a pass. They tell how much work one submission
//! may hold before the cost model has learned anything.

use std::collections::HashMap;

use crate::schedule::{Divisible, Position, UNKNOWN_PATH_MS};

/// A submission may trace this many times as many paths as the largest that was timed.
const GROWTH: f64 = 8.0;

/// Assumed time of paths over that of the slowest recent rows: rows of sky may come first. Together with a bound of a
/// tenth of the watchdog's time, paths may be 40 times as slow as the slowest rows so far before a device is reset.
const MARGIN: f64 = 4.0;

/// Name of a kernel, and index of its pass: kernels of auxiliary images do other work in each of their passes. Both eyes
/// share a speed, so that a list of few pixels does not make the right eye's paths look fast.
pub type Key = (&'static str, u32);

/// The speeds of a device's kernels.
#[derive(Debug, Default)]
pub struct Speeds(HashMap<Key, Speed>);

#[derive(Clone, Copy, Debug, Default)]
struct Speed {
    /// Time per path of the slowest submission, which counts half as much with each later one.
    path_ms: f64,
    /// Number of paths of the largest submission.
    paths: f64,
}

impl Speeds {
    /// Returns the furthest position such that the work from `from` to there may be one submission. It is always beyond
    /// `from`.
    pub fn reach(&self, key: Key, work: &Divisible<'_>, from: Position, bound_ms: f64) -> Position {
        let most = self.0.get(&key).map_or(bound_ms / UNKNOWN_PATH_MS, |speed| {
            (GROWTH * speed.paths).min(bound_ms / (MARGIN * speed.path_ms))
        });
        let (to, _) = work.reach(from, most, |run, rows| work.paths_of(run, rows));
        if to > from { to } else { work.next(from) }
    }

    /// Returns true if no submission of as many paths has been timed yet.
    pub fn is_new(&self, key: Key, paths: f64) -> bool {
        self.0.get(&key).is_none_or(|speed| speed.paths < paths)
    }

    /// Returns the expected time of paths in milliseconds; 0 before any were timed.
    pub fn expected_ms(&self, key: Key, paths: f64) -> f64 {
        self.0.get(&key).map_or(0.0, |speed| speed.path_ms * paths)
    }

    pub fn learn(&mut self, key: Key, paths: f64, ms: f64) {
        let speed = self.0.entry(key).or_default();
        // Waiting for a device takes time as well, so a time of 0 is none.
        let path_ms = if ms > 0.0 { ms / paths } else { UNKNOWN_PATH_MS };
        *speed = Speed { path_ms: path_ms.max(0.5 * speed.path_ms), paths: speed.paths.max(paths) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: Key = ("kernel", 0);

    /// One run of a kernel on rows of 1,000 pixels each, eight of which are computed together.
    fn work(rows: &std::ops::Range<u32>, runs: usize) -> Divisible<'_> {
        Divisible { rows, width: 1000, step: Some(8), samples: vec![1; runs] }
    }

    /// Returns the number of rows of each submission on a device with this time per path.
    fn submissions(speeds: &mut Speeds, rows: u32, path_ms: impl Fn(f64) -> f64, bound_ms: f64) -> Vec<f64> {
        let rows = 0..rows;
        let work = work(&rows, 1);
        let (mut at, mut all) = (Position::start(&rows), Vec::new());
        while at < Position::END {
            let to = speeds.reach(KEY, &work, at, bound_ms);
            let paths = work.paths(&(at..to));
            speeds.learn(KEY, paths, paths * path_ms(paths));
            all.push(paths / 1000.0);
            at = to;
        }
        all
    }

    #[test]
    fn submissions_grow_eightfold_on_a_fast_device() {
        let mut speeds = Speeds::default();
        assert_eq!(submissions(&mut speeds, 3600, |_| 1e-6, 200.0), [96.0, 768.0, 2736.0]);
        assert_eq!(submissions(&mut speeds, 3600, |_| 1e-6, 200.0), [3600.0]);
    }

    #[test]
    fn submissions_of_a_slow_device_stay_below_the_bound() {
        let mut speeds = Speeds::default();
        for path_ms in [1e-4, 2e-3, 1e-2] {
            for rows in submissions(&mut speeds, 3600, |_| path_ms, 200.0).into_iter().skip(1) {
                assert!(rows <= 8.0 || rows * 1000.0 * path_ms <= 200.0 / MARGIN + 1e-9, "{path_ms}: {rows}");
            }
        }
    }

    #[test]
    fn slow_submissions_count_for_a_while() {
        let mut speeds = Speeds::default();
        let rows = 0..1000;
        let start = Position::start(&rows);
        speeds.learn(KEY, 1e6, 1e3);
        assert_eq!(speeds.reach(KEY, &work(&rows, 2), start, 200.0), Position { run: 0, row: 48 });
        speeds.learn(KEY, 1e6, 1.0);
        assert_eq!(speeds.reach(KEY, &work(&rows, 2), start, 200.0), Position { run: 0, row: 96 });
        let other = ("kernel", 1);
        speeds.learn(other, 1e7, 1e-3);
        assert_eq!(speeds.reach(other, &work(&rows, 2), start, 200.0), Position::END);
    }
}
