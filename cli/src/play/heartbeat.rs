//! Notices when the process does not run: it was stopped, or the machine was suspended or overloaded.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

const BEAT: Duration = Duration::from_millis(8);
/// Delay of a beat from which it counts as a pause. Schedulers wake a thread that hardly runs within a few milliseconds.
const PAUSE: Duration = Duration::from_millis(10);
/// Number of pauses that are kept. Frames ask for the latest only.
const KEPT: usize = 64;

/// Begin and end of the latest pauses.
type Pauses = Mutex<VecDeque<[Instant; 2]>>;

/// Thread that sleeps for a few milliseconds at a time and notes when it woke much later. It ends with this handle.
pub struct Heartbeat(Arc<Pauses>);

impl Heartbeat {
    pub fn start() -> Self {
        let pauses: Arc<Pauses> = Arc::default();
        let noted = Arc::downgrade(&pauses);
        // Without the thread, no pause is noticed.
        let _ = thread::Builder::new().name("heartbeat".to_owned()).spawn(move || {
            loop {
                let due = Instant::now() + BEAT;
                thread::sleep(BEAT);
                let now = Instant::now();
                let Some(pauses) = noted.upgrade() else { break };
                if now.saturating_duration_since(due) > PAUSE {
                    let mut pauses = pauses.lock().unwrap_or_else(PoisonError::into_inner);
                    pauses.push_back([due, now]);
                    let surplus = pauses.len().saturating_sub(KEPT);
                    pauses.drain(..surplus);
                }
            }
        });
        Self(pauses)
    }

    /// Returns the time in milliseconds between two instants in which the process was paused.
    pub fn paused_ms(&self, from: Instant, to: Instant) -> f64 {
        let pauses = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let shared = |[begin, end]: &[Instant; 2]| to.min(*end).saturating_duration_since(from.max(*begin));
        pauses.iter().map(shared).sum::<Duration>().as_secs_f64() * 1e3
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_count_only_within_the_asked_time() {
        let heartbeat = Heartbeat(Arc::default());
        let begin = Instant::now();
        let at = |ms: u64| begin + Duration::from_millis(ms);
        heartbeat.0.lock().unwrap().extend([[at(10), at(30)], [at(50), at(60)]]);
        for (from, to, ms) in [(0, 5, 0.0), (0, 20, 10.0), (15, 25, 10.0), (0, 100, 30.0), (55, 58, 3.0), (70, 90, 0.0)]
        {
            assert!((heartbeat.paused_ms(at(from), at(to)) - ms).abs() < 1e-9, "{from} to {to}");
        }
    }
}
