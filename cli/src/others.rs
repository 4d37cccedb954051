//! Fraction of the cores that other programs take. Frames take longer while they do.

use std::collections::VecDeque;

use super::console;
use super::core_time::CoreTime;

/// Fraction from which a run warns.
pub const NOTICEABLE: f64 = 0.05;
/// Time before the end of a frame for which the fraction is told. It is no more exact than 5 %.
const RECENT_S: f64 = 0.2;

/// Measures what other programs take before a run and during its frames.
pub struct Others {
    begin: Option<CoreTime>,
    is_told: bool,
}

impl Others {
    /// Begins with the preparations of a run.
    pub fn begin() -> Self {
        Self { begin: console::core_time(), is_told: false }
    }

    /// Begins with the frames of the run. Returns a warning if other programs are busy.
    pub fn begin_frames(&mut self) -> Option<String> {
        let now = console::core_time();
        let share = now.zip(self.begin).and_then(|(now, begin)| now.share_since(begin));
        let share = share.filter(|share| *share >= NOTICEABLE);
        *self = Self { begin: now, is_told: share.is_some() };
        share.map(|share| format!("other programs take {:.0} % of the cores: frames take longer", share * 100.0))
    }

    /// Ends the run. Returns the fraction that other programs took during the frames, and a warning if that was more
    /// than could be expected.
    pub fn end(self) -> (Option<f64>, Option<String>) {
        let share = self.begin.and_then(|begin| console::core_time()?.share_since(begin));
        let told = share.filter(|share| *share >= NOTICEABLE && !self.is_told);
        let text = |share: f64| format!("other programs took {:.0} % of the cores: frames took longer", share * 100.0);
        (share, told.map(text))
    }
}

/// Measures what other programs take around each frame of a sequence.
#[derive(Default)]
pub struct RecentOthers(VecDeque<CoreTime>);

impl RecentOthers {
    /// Returns the fraction that other programs took shortly before now. Call this once per frame.
    pub fn share(&mut self) -> Option<f64> {
        self.share_at(console::core_time()?)
    }

    fn share_at(&mut self, now: CoreTime) -> Option<f64> {
        self.0.push_back(now);
        // Keep one time that is long enough ago.
        while self.0.get(1).is_some_and(|next| now.all_s - next.all_s >= RECENT_S) {
            self.0.pop_front();
        }
        now.share_over(RECENT_S, *self.0.front()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recent_share_forgets_earlier_load() {
        let mut recent = RecentOthers::default();
        // Frames of 0.125 s; half of the cores are busy during the first four.
        let mut share = |frame: u32| {
            let all_s = f64::from(frame) * 0.125;
            recent.share_at(CoreTime { others_s: 0.5 * all_s.min(0.5), all_s })
        };
        let found: Vec<_> = (0..8).map(&mut share).collect();
        let expected = [None, None, Some(0.5), Some(0.5), Some(0.5), Some(0.25), Some(0.0), Some(0.0)];
        assert_eq!(found, expected);
        assert!(recent.0.len() <= 3, "{}", recent.0.len());
    }
}
