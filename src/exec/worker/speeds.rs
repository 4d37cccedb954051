//! Kernels' times per path, which a device measures on the first rows of a pass. They tell how much work one submission
//! may hold before the cost model has learned anything.

use std::collections::HashMap;

use crate::schedule::{Divisible, Position, UNKNOWN_PATH_MS};

/// A submission may trace this many times as many paths as the largest that was timed.
const GROWTH: f64 = 8.0;

/// Assumed time of paths over the greatest that was measured: rows of sky may come first. Together with a bound of a
/// tenth of the watchdog's time, paths may be 40 times as slow as the slowest rows so far before a device is reset.
const MARGIN: f64 = 4.0;

/// The speeds of a device's kernels, by name.
#[derive(Debug, Default)]
pub struct Speeds(HashMap<&'static str, Speed>);

#[derive(Clone, Copy, Debug, Default)]
struct Speed {
    /// Greatest time per path of any submission.
    path_ms: f64,
    /// Number of paths of the largest submission.
    paths: f64,
}

impl Speeds {
    /// Returns the furthest position such that the work from `from` to there may be one submission. It is always beyond
    /// `from`.
    pub fn reach(&self, kernel: &str, work: &Divisible<'_>, from: Position, bound_ms: f64) -> Position {
        let most = self.0.get(kernel).map_or(bound_ms / UNKNOWN_PATH_MS, |speed| {
            (GROWTH * speed.paths).min(bound_ms / (MARGIN * speed.path_ms))
        });
        let (to, _) = work.reach(from, most, |run, rows| work.paths_of(run, rows));
        if to > from { to } else { work.next(from) }
    }

    /// Returns true if no submission of as many paths has been timed yet.
    pub fn is_new(&self, kernel: &str, paths: f64) -> bool {
        self.0.get(kernel).is_none_or(|speed| speed.paths < paths)
    }

    pub fn learn(&mut self, kernel: &'static str, paths: f64, ms: f64) {
        let speed = self.0.entry(kernel).or_default();
        // Waiting for a device takes time as well, so a time of 0 is none.
        let path_ms = if ms > 0.0 { ms / paths } else { UNKNOWN_PATH_MS };
        *speed = Speed { path_ms: speed.path_ms.max(path_ms), paths: speed.paths.max(paths) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            let to = speeds.reach("kernel", &work, at, bound_ms);
            let paths = work.paths(&(at..to));
            speeds.learn("kernel", paths, paths * path_ms(paths));
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
    fn greatest_time_per_path_counts() {
        let mut speeds = Speeds::default();
        speeds.learn("kernel", 1e6, 1e3);
        speeds.learn("kernel", 1e6, 1.0);
        let rows = 0..1000;
        let to = speeds.reach("kernel", &work(&rows, 2), Position::start(&rows), 200.0);
        assert_eq!(to, Position { run: 0, row: 48 });
        speeds.learn("other", 1e7, 1e-3);
        assert_eq!(speeds.reach("other", &work(&rows, 2), to, 200.0), Position::END);
    }
}
