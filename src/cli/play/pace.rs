//! Frame pacing, and the refreshes of a simulated display.

use std::time::{Duration, Instant};

/// Timer that starts frames at a steady rate. A late frame delays all later ones.
pub struct Pace {
    period: Duration,
    due: Instant,
    /// Refresh of the display at which the next frame is due.
    refresh: Instant,
}

/// Lateness up to which a frame does not delay others, because sleeping overshoots.
const SLACK: Duration = Duration::from_millis(1);

impl Pace {
    pub fn new(fps: f64) -> Self {
        // A `Duration` overflows at very low rates; a period of more than a day is long enough.
        let period = Duration::from_secs_f64((1.0 / fps).min(1e5)).max(Duration::from_nanos(1));
        Self::from(Instant::now(), period)
    }

    fn from(now: Instant, period: Duration) -> Self {
        Self { period, due: now, refresh: now + period }
    }

    /// Waits until the next frame is due; returns how late it is, ms.
    pub fn wait(&mut self) -> f64 {
        std::thread::sleep(self.due.saturating_duration_since(Instant::now()));
        let now = Instant::now();
        let late = now - self.due;
        self.due = self.due.max(now - late.min(SLACK)) + self.period;
        late.as_secs_f64() * 1e3
    }

    /// Returns the number of display periods that the frame, which is now complete, has missed. Call this once for each
    /// frame.
    pub fn complete(&mut self) -> u32 {
        self.complete_at(Instant::now())
    }

    /// The display refreshes once per period. A frame is due one period after its start is due, and shown at the first
    /// refresh at which it is complete; the next frame is due one period later.
    fn complete_at(&mut self, now: Instant) -> u32 {
        let overrun = now.saturating_duration_since(self.refresh).as_nanos();
        let missed = u32::try_from(overrun.div_ceil(self.period.as_nanos())).unwrap_or(u32::MAX - 1);
        self.refresh += self.period.saturating_mul(missed + 1);
        missed
    }

    /// Makes the next frame due now.
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
        complete.map(|periods| pace.complete_at(begin + period.mul_f64(periods)))
    }

    #[test]
    fn a_frame_misses_the_refreshes_at_which_it_is_not_complete() {
        assert_eq!(missed([0.5, 1.0, 3.0, 3.5]), [0; 4]);
        assert_eq!(missed([1.1]), [1]);
        assert_eq!(missed([3.5, 4.9, 5.5, 6.0]), [3, 0, 0, 0]);
        // Frames that follow one another without a pause: every second period shows none.
        assert_eq!(missed([2.0, 4.0, 6.0, 8.0]), [1; 4]);
        assert_eq!(missed([1.5, 3.0, 4.5, 6.0, 7.5]), [1, 0, 1, 0, 1]);
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
    fn rates_beyond_all_displays_overflow_nothing() {
        let mut pace = Pace::new(1e300);
        assert!(pace.complete_at(Instant::now() + Duration::from_secs(60)) > 0);
        assert_eq!(Pace::new(1e-300).complete(), 0);
    }
}
