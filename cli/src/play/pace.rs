//! Frame pacing, and the refreshes of a simulated display.

use std::time::{Duration, Instant};

use diptych::trace::deadline::Deadline;

/// Starts frames at the refreshes of a simulated display, which refreshes once per period. A frame is due at the next
/// refresh, and shown at the first one at which it is complete; there the next frame starts.
pub struct Pace {
    period: Duration,
    /// The refresh at which the current frame is due.
    due: Instant,
    /// Time at which the current frame started.
    started: Instant,
    /// The number of periods that the last frame missed.
    missed: u32,
}

impl Pace {
    pub fn new(fps: f64) -> Self {
        // A `Duration` overflows at very low rates; a period of more than a day is long enough.
        let period = Duration::from_secs_f64((1.0 / fps).min(1e5)).max(Duration::from_nanos(1));
        Self::from(Instant::now(), period)
    }

    fn from(now: Instant, period: Duration) -> Self {
        Self { period, due: now + period, started: now, missed: 0 }
    }

    /// Waits until the next frame starts. Returns its delay in ms: the difference to one period after the start of the
    /// frame before it.
    pub fn wait(&mut self) -> f64 {
        let start = self.start();
        std::thread::sleep(start.saturating_duration_since(Instant::now()));
        self.started = Instant::now();
        let overslept = self.started - start;
        (overslept + self.period.saturating_mul(self.missed)).as_secs_f64() * 1e3
    }

    /// Returns the refresh at which the current frame starts.
    fn start(&self) -> Instant {
        self.due - self.period
    }

    /// Returns the times of the frame, which is now complete, in milliseconds since `origin`, and the number of periods
    /// that it missed. Call this once for each frame.
    pub fn complete(&mut self, origin: Instant) -> Deadline {
        self.complete_at(Instant::now(), origin)
    }

    fn complete_at(&mut self, now: Instant, origin: Instant) -> Deadline {
        let overrun = now.saturating_duration_since(self.due).as_nanos();
        self.missed = u32::try_from(overrun.div_ceil(self.period.as_nanos())).unwrap_or(u32::MAX - 1);
        let since_ms = |at: Instant| at.saturating_duration_since(origin).as_secs_f64() * 1e3;
        let deadline = Deadline {
            refresh_ms: since_ms(self.start()),
            started_ms: since_ms(self.started),
            complete_ms: since_ms(now),
            due_ms: since_ms(self.due),
            missed_periods: self.missed,
        };
        self.due += self.period.saturating_mul(self.missed + 1);
        deadline
    }

    /// Starts the next frame now.
    pub fn restart(&mut self) {
        *self = Self::from(Instant::now(), self.period);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the periods that frames miss which are complete at these times, in periods since the first frame was due
    /// to start.
    fn missed<const N: usize>(complete: [f64; N]) -> [u32; N] {
        let (begin, period) = (Instant::now(), Duration::from_millis(10));
        let mut pace = Pace::from(begin, period);
        complete.map(|periods| pace.complete_at(begin + period.mul_f64(periods), begin).missed_periods)
    }

    #[test]
    fn frame_misses_refreshes_until_it_is_complete() {
        assert_eq!(missed([0.5, 1.0, 3.0, 3.5]), [0; 4]);
        assert_eq!(missed([1.1]), [1]);
        assert_eq!(missed([3.5, 4.9, 5.5, 6.0]), [3, 0, 0, 0]);
        assert_eq!(missed([2.0, 4.0, 6.0, 8.0]), [1; 4]);
    }

    /// Frames start at refreshes of the display, whatever their times and the delays of their starts are.
    #[test]
    fn frames_keep_the_phase_of_the_display() {
        let (begin, period) = (Instant::now(), Duration::from_millis(10));
        let mut pace = Pace::from(begin, period);
        // A sequence of even distribution in 0..1.
        let random = |number: u32| (f64::from(number) * 0.618_033_988_75).fract();
        let (mut missed, mut late) = (0, 0);
        for frame in 0..1000 {
            let since_begin = pace.start() - begin;
            assert_eq!(since_begin, period * (frame + missed));
            let delay = period.mul_f64(random(3 * frame) * 0.02);
            let usual = 0.9 * random(frame);
            let duration = period.mul_f64(if frame % 20 == 0 { 1.1 + usual } else { usual });
            late += u32::from(duration + delay > period);
            let complete = pace.start() + delay + duration;
            missed += pace.complete_at(complete, begin).missed_periods;
            assert!(pace.start() >= complete && pace.start() - complete <= period);
        }
        assert!(late == 50 && missed >= late, "{late} late frames missed {missed} periods");
    }

    #[test]
    fn missed_periods_and_frames_add_up_to_all_periods() {
        for frame_periods in [0.3, 1.0, 1.2, 2.7, 40.1] {
            let frames = 200;
            let complete: [f64; 200] = std::array::from_fn(|i| (i + 1) as f64 * f64::max(frame_periods, 1.0));
            let periods = f64::from(missed(complete).iter().sum::<u32>() + frames);
            assert!((periods - complete[199]).abs() < 1.0, "{frame_periods}: {periods} instead of {}", complete[199]);
        }
    }

    #[test]
    fn extreme_refresh_rates_do_not_overflow() {
        let mut pace = Pace::new(1e300);
        let now = Instant::now();
        assert!(pace.complete_at(now + Duration::from_secs(60), now).missed_periods > 0);
        assert_eq!(Pace::new(1e-300).complete(now).missed_periods, 0);
    }
}
