//! Conversion of times on other ranks' clocks to rank 0's clock, by round trips (Cristian, "Probabilistic Clock
//! Synchronization", 1989): the other rank reads its clock between the request and the response. Offset bounds measured
//! some time apart bound the relative rate of the clocks, so that the tight bounds of a short round trip remain useful
//! for longer.

use std::collections::VecDeque;
use std::ops::Range;

use crate::device::{ClockOffset, MOST_DRIFT};
use crate::exec::messages::{Answer, Reply};

/// The clock of one other rank.
#[derive(Default)]
pub struct RankClock {
    offset: ClockOffset,
    /// Earlier times on the other rank's clock, each with the bounds of the offset at that time; oldest first.
    marks: VecDeque<(f64, Range<f64>)>,
    /// Running mean of round trips of small packets, milliseconds.
    pub round_trip_ms: Option<f64>,
    /// Running mean of the time per byte of large packets, in milliseconds. The shortest round trip is subtracted from
    /// their times first.
    pub ms_per_byte: Option<f64>,
    /// Shortest round trip so far, milliseconds.
    pub shortest_ms: Option<f64>,
}

/// Weights of a new value in a running mean: the first if it is at most the mean, the second if it is greater. Greater
/// values count less, since other traffic on the link may have caused them.
const LEARNING_RATES: [f64; 2] = [0.3, 0.05];

/// Length in milliseconds of the intervals for each of which only the tightest offset bounds are kept.
const MARK_MS: f64 = 1e3;
/// Number of intervals for which offset bounds are kept.
const MARKS: usize = 16;
/// Maximum change in the relative rate of two clocks while bounds are kept. A crystal drifts by about 1 ppm per 1 to 2
/// K.
const WANDER: f64 = 2e-6;

fn learned(mean: Option<f64>, new: f64) -> Option<f64> {
    Some(mean.map_or(new, |mean| mean + (new - mean) * LEARNING_RATES[usize::from(new > mean)]))
}

impl RankClock {
    /// Adds a round trip. It began and ended at the times `here_ms` on this rank's clock; in between, the other rank's
    /// clock read `there_ms`.
    pub fn learn(&mut self, here_ms: Range<f64>, there_ms: f64) {
        let trip_ms = here_ms.end - here_ms.start;
        self.shortest_ms = Some(self.shortest_ms.map_or(trip_ms, |ms| ms.min(trip_ms)));
        self.offset.narrow(&(there_ms..there_ms), &here_ms);
        self.learn_rate();
    }

    /// Updates the mean round trip, or the mean time per byte if the request had a load of `bytes` bytes. Call this
    /// only for round trips that resemble a frame's packets: nothing else uses the link, and the receiver may have to
    /// wake up first.
    pub fn judge(&mut self, trip_ms: f64, bytes: usize) {
        if bytes == 0 {
            self.round_trip_ms = learned(self.round_trip_ms, trip_ms);
        } else if let Some(shortest_ms) = self.shortest_ms {
            self.ms_per_byte = learned(self.ms_per_byte, (trip_ms - shortest_ms).max(0.0) / bytes as f64);
        }
    }

    /// Derives bounds of the clocks' relative rate from the offset bounds now and at the earlier times in `marks`.
    fn learn_rate(&mut self) {
        let (at_ms, now) = self.offset.bounds();
        let mut rate = -MOST_DRIFT..MOST_DRIFT;
        for (then_ms, then) in &self.marks {
            let elapsed = (at_ms - then_ms).max(f64::MIN_POSITIVE);
            rate.start = rate.start.max((now.start - then.end) / elapsed - WANDER);
            rate.end = rate.end.min((now.end - then.start) / elapsed + WANDER);
        }
        if rate.start > rate.end {
            // One of the clocks has jumped.
            self.marks.clear();
            rate = -MOST_DRIFT..MOST_DRIFT;
        }
        self.offset.set_rate(rate);
        let width = |bounds: &Range<f64>| bounds.end - bounds.start;
        match self.marks.back_mut() {
            Some(last) if at_ms - last.0 < MARK_MS => {
                if width(&now) < width(&last.1) {
                    *last = (at_ms, now);
                }
            }
            _ => self.marks.push_back((at_ms, now)),
        }
        self.marks.drain(..self.marks.len().saturating_sub(MARKS));
    }

    /// Returns the time in milliseconds on this rank's clock at which the other rank's clock read 0, and the maximum
    /// error, in µs, of times between `from_ms` and `to_ms` on the other clock that are converted with it. The error is
    /// `None` before the first round trip.
    pub fn zero_between(&self, [from_ms, to_ms]: [f64; 2]) -> (f64, Option<f64>) {
        let [(then_ms, then_error_ms), (zero_ms, error_ms)] = [from_ms, to_ms].map(|ms| self.offset.at(ms));
        let most_ms = error_ms.max(then_error_ms + (then_ms - zero_ms).abs());
        (zero_ms, most_ms.is_finite().then_some(most_ms * 1e3))
    }

    /// Converts the times of a reply from the other rank's clock to milliseconds since `origin_ms`, a time on this
    /// rank's clock. Adds the maximum error of the conversion to the reply's clock residual.
    pub fn translate(&self, reply: &mut Reply, origin_ms: f64) {
        let Ok(Answer::Frame(frame)) = &mut reply.answer else { return };
        let (offset_ms, error_ms) = self.offset.at(frame.end_ms);
        let shift_ms = offset_ms - origin_ms;
        for time in &mut frame.times {
            time.begin_ms += shift_ms;
            time.end_ms += shift_ms;
        }
        frame.begin_ms += shift_ms;
        frame.end_ms += shift_ms;
        if error_ms.is_finite() {
            frame.clock_residual_us += error_ms * 1e3;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A clock that runs `ppm` too fast, with simulated round trips.
    struct Fake {
        ppm: f64,
        random: u32,
    }

    impl Fake {
        fn there_ms(&self, here_ms: f64) -> f64 {
            5e6 + here_ms * (1.0 + self.ppm * 1e-6)
        }

        /// Returns a random number from 0 to 1.
        fn random(&mut self) -> f64 {
            self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.random) / f64::from(u32::MAX)
        }

        /// Simulates a round trip of `trip_ms`, of which the request takes 10 to 90 %. Returns the error in µs of a
        /// time that is converted after it.
        fn trip(&mut self, clock: &mut RankClock, sent_ms: f64, trip_ms: f64) -> f64 {
            let read_ms = sent_ms + trip_ms * (0.1 + 0.8 * self.random());
            let there_ms = self.there_ms(read_ms);
            clock.learn(sent_ms..sent_ms + trip_ms, there_ms);
            (there_ms + clock.offset.value() - read_ms).abs() * 1e3
        }
    }

    /// Simulates an hour of round trips of 0.1 to 1.1 ms.
    #[test]
    fn drifting_clock_stays_within_its_residual() {
        let (mut fake, mut clock) = (Fake { ppm: 40.0, random: 1 }, RankClock::default());
        for i in 0..18_000u32 {
            let trip_ms = 0.1 + fake.random();
            let wrong_us = fake.trip(&mut clock, f64::from(i) * 200.0, trip_ms);
            let residual_us = clock.offset.error_ms() * 1e3;
            assert!(wrong_us <= residual_us + 1e-3, "{i}: {wrong_us} µs, said to be at most {residual_us}");
            assert!(residual_us < if i < 100 { 1200.0 } else { 250.0 }, "{i}: {residual_us}");
        }
    }

    /// Simulates a busy machine, where only one round trip in fifty is short. The clock's rate changes by 1 ppm a
    /// minute.
    #[test]
    fn rare_short_round_trips_keep_the_residual_small() {
        let (mut fake, mut clock) = (Fake { ppm: 0.0, random: 7 }, RankClock::default());
        let mut residuals_us = Vec::new();
        // The lead of the other clock is the integral of its changing rate, so that its times are continuous.
        let (mut lead_ms, mut ppm) = (0.0, -30.0);
        for i in 0..9_000u32 {
            ppm += 200.0 / 60e3;
            lead_ms += 200.0 * ppm * 1e-6;
            let sent_ms = f64::from(i) * 200.0;
            let (trip_ms, at) = (if i % 50 == 0 { 0.02 } else { 3.0 }, fake.random());
            let read_ms = sent_ms + trip_ms * at;
            let there_ms = 7e5 + read_ms + lead_ms;
            clock.learn(sent_ms..sent_ms + trip_ms, there_ms);
            let wrong_us = (there_ms + clock.offset.value() - read_ms).abs() * 1e3;
            let residual_us = clock.offset.error_ms() * 1e3;
            assert!(wrong_us <= residual_us + 1e-3, "{i}: {wrong_us} µs, said to be at most {residual_us}");
            residuals_us.push(residual_us);
        }
        let most_us = residuals_us[500..].iter().copied().fold(0.0, f64::max);
        assert!(most_us < 150.0, "{most_us}");
    }

    #[test]
    fn clock_jumps_are_followed_at_once() {
        let (mut fake, mut clock) = (Fake { ppm: 20.0, random: 3 }, RankClock::default());
        for i in 0..100 {
            fake.trip(&mut clock, f64::from(i) * 200.0, 0.05);
        }
        let jumped = |ms: f64| 5e6 + 3_000.0 + ms;
        for i in 100..110 {
            let sent_ms = f64::from(i) * 200.0;
            clock.learn(sent_ms..sent_ms + 0.05, jumped(sent_ms + 0.02));
            let wrong_us = (jumped(sent_ms) + clock.offset.value() - sent_ms).abs() * 1e3;
            assert!(wrong_us <= clock.offset.error_ms() * 1e3 + 1e-3 && wrong_us < 100.0, "{i}: {wrong_us}");
        }
    }
}
