//! Frame pacing.

use std::time::{Duration, Instant};

/// Timer that starts frames at a steady rate. A late frame delays all later ones.
pub struct Pace {
    period: Duration,
    due: Instant,
}

/// Lateness up to which a frame does not delay others, because sleeping overshoots.
const SLACK: Duration = Duration::from_millis(1);

impl Pace {
    pub fn new(fps: f64) -> Self {
        // A `Duration` overflows at very low rates; a period of more than a day is long enough.
        let period = Duration::from_secs_f64((1.0 / fps).min(1e5));
        Self { period, due: Instant::now() }
    }

    /// Waits until the next frame is due; returns how late it is, ms.
    pub fn wait(&mut self) -> f64 {
        std::thread::sleep(self.due.saturating_duration_since(Instant::now()));
        let now = Instant::now();
        let late = now - self.due;
        self.due = self.due.max(now - late.min(SLACK)) + self.period;
        late.as_secs_f64() * 1e3
    }

    /// Makes the next frame due now.
    pub fn restart(&mut self) {
        self.due = Instant::now();
    }
}
