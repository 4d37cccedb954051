//! Counts missed frames by the runtime's predicted display times.

use openxr::Time;

/// Predicted display times of the first and the last frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pacing {
    first: Option<Time>,
    last: Option<Time>,
}

impl Pacing {
    /// Records the predicted display time of the next frame. Returns the number of display periods without a frame
    /// since the previous frame.
    pub fn missed(&mut self, display: Time, period_ns: i64) -> u32 {
        self.first.get_or_insert(display);
        let before = self.last.replace(display);
        let Some(before) = before.filter(|_| period_ns > 0) else { return 0 };
        let passed_ns = display.as_nanos().saturating_sub(before.as_nanos()).saturating_add(period_ns / 2);
        (passed_ns / period_ns - 1).clamp(0, u32::MAX.into()) as u32
    }

    /// Forgets the previous frame, so that a pause, for example while the headset is not worn, does not count as missed
    /// frames.
    pub fn pause(&mut self) {
        self.last = None;
    }

    /// Returns the time from the predicted display time of the first frame to `display`, in seconds.
    pub fn since_first_s(&self, display: Time) -> f64 {
        let first = self.first.unwrap_or(display);
        display.as_nanos().saturating_sub(first.as_nanos()) as f64 / 1e9
    }
}

/// Returns the display time of a frame that is ready at `ready`: its predicted time `display`, or for a late frame the
/// next refresh.
pub fn shown_at(display: Time, period_ns: i64, ready: Time) -> Time {
    let late_ns = ready.as_nanos().saturating_sub(display.as_nanos());
    if late_ns <= 0 || period_ns <= 0 {
        return display;
    }
    let periods = (late_ns - 1) / period_ns + 1;
    Time::from_nanos(display.as_nanos().saturating_add(periods.saturating_mul(period_ns)))
}

/// Returns the time between two instants, ms.
pub fn between_ms(from: Time, to: Time) -> f64 {
    to.as_nanos().saturating_sub(from.as_nanos()) as f64 / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_frame_counts_missed_periods() {
        const PERIOD: i64 = 11_111_111;
        let mut pacing = Pacing::default();
        let begin = 5_000_000_000;
        let mut missed =
            |periods: f64| pacing.missed(Time::from_nanos(begin + (periods * PERIOD as f64) as i64), PERIOD);
        let counts = [0.0, 1.0, 2.02, 2.98, 5.0, 5.0, 4.9, 6.0, 106.0].map(&mut missed);
        assert_eq!(counts, [0, 0, 0, 0, 1, 0, 0, 0, 99]);
        pacing.pause();
        assert_eq!(pacing.missed(Time::from_nanos(begin + 1000 * PERIOD), PERIOD), 0, "nobody saw what was missed");
        let [at, none] = [2 * PERIOD, 0].map(|ns| pacing.since_first_s(Time::from_nanos(begin + ns)));
        assert!((at - 2.0 * PERIOD as f64 / 1e9).abs() < 1e-12 && none == 0.0);
    }

    #[test]
    fn late_frame_appears_at_the_next_refresh() {
        let at = |ready| shown_at(Time::from_nanos(1000), 10, Time::from_nanos(ready)).as_nanos();
        assert_eq!([0, 999, 1000, 1001, 1010, 1011, 1995].map(at), [1000, 1000, 1000, 1010, 1010, 1020, 2000]);
        assert_eq!(shown_at(Time::from_nanos(5), 0, Time::from_nanos(50)), Time::from_nanos(5));
        let never = Time::from_nanos(i64::MAX);
        assert_eq!(shown_at(Time::from_nanos(0), 1, never), never);
    }

    #[test]
    fn runtime_without_a_period_misses_nothing() {
        let mut pacing = Pacing::default();
        for at in [1, 1_000_000_000, i64::MAX] {
            assert_eq!(pacing.missed(Time::from_nanos(at), 0), 0);
        }
    }
}
