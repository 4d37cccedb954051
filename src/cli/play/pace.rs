//! When frames are due.

use std::time::{Duration, Instant};

/// Frames at a steady rate. One that is late moves all that follow.
pub struct Pace {
    period: Duration,
    due: Instant,
}

/// Lateness that sleeping may cause; it is made up for.
const SLACK: Duration = Duration::from_millis(1);

impl Pace {
    pub fn new(fps: f64) -> Self {
        // More than a day is as good as for ever.
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

    /// The next frame is due now.
    pub fn restart(&mut self) {
        self.due = Instant::now();
    }
}
