//! Other ranks' clocks on rank 0's, by round trips (Cristian, "Probabilistic Clock Synchronization", 1989): what another
//! rank read of its clock was between the question and the answer.

use std::ops::Range;

use crate::device::ClockOffset;
use crate::exec::messages::{Answer, Reply};

/// The clock of one other rank.
#[derive(Default)]
pub struct RankClock {
    offset: ClockOffset,
    /// Of round trips of small packets, a running mean, milliseconds.
    pub round_trip_ms: Option<f64>,
    /// Of those of large ones beyond that, per byte.
    pub ms_per_byte: Option<f64>,
}

/// Share of a new round trip in the means.
const LEARNING_RATE: f64 = 0.2;

fn learned(mean: Option<f64>, new: f64) -> Option<f64> {
    Some(mean.map_or(new, |mean| mean + (new - mean) * LEARNING_RATE))
}

impl RankClock {
    /// Takes in a round trip that began and ended at these times here, and in which the other clock was `there_ms`. So
    /// many bytes went there.
    pub fn learn(&mut self, here_ms: Range<f64>, there_ms: f64, bytes: usize) {
        let trip_ms = here_ms.end - here_ms.start;
        match self.round_trip_ms {
            Some(small_ms) if bytes > 0 => {
                self.ms_per_byte = learned(self.ms_per_byte, (trip_ms - small_ms).max(0.0) / bytes as f64);
            }
            mean => self.round_trip_ms = learned(mean, trip_ms),
        }
        self.offset.narrow(&(there_ms..there_ms), &here_ms);
    }

    /// How wrong times are at most; none before a round trip.
    pub fn residual_us(&self) -> Option<f64> {
        self.round_trip_ms.map(|_| self.offset.error_ms() * 1e3)
    }

    /// Puts the times of a reply, which are milliseconds since the other rank's zero, on a clock whose zero was at
    /// `origin_ms` here.
    pub fn translate(&self, reply: &mut Reply, origin_ms: f64) {
        let Ok(Answer::Frame(frame)) = &mut reply.answer else { return };
        let shift_ms = self.offset.value() - origin_ms;
        for time in &mut frame.times {
            time.begin_ms += shift_ms;
            time.end_ms += shift_ms;
        }
        frame.begin_ms += shift_ms;
        frame.end_ms += shift_ms;
        frame.clock_residual_us += self.residual_us().unwrap_or(0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An hour of round trips of 0.1 to 1.1 ms, of which the way back takes a tenth to nine tenths, with a clock that runs
    /// 40 ppm too fast.
    #[test]
    fn a_clock_that_drifts_is_followed_within_its_residual() {
        let mut clock = RankClock::default();
        let there = |here_ms: f64| 5e6 + here_ms * (1.0 + 40e-6);
        for i in 0..18_000u32 {
            let sent_ms = f64::from(i) * 200.0;
            let trip_ms = 0.1 + f64::from(i.wrapping_mul(2_654_435_761) >> 16) / 65_536.0;
            let way = 0.1 + 0.8 * f64::from(i.wrapping_mul(40_503) & 0xffff) / 65_536.0;
            let read_ms = sent_ms + trip_ms * way;
            clock.learn(sent_ms..sent_ms + trip_ms, there(read_ms), 0);
            let wrong_us = (there(read_ms) + clock.offset.value() - read_ms).abs() * 1e3;
            let residual_us = clock.residual_us().unwrap();
            assert!(wrong_us <= residual_us + 1e-3, "{i}: {wrong_us} µs, said to be at most {residual_us}");
            assert!(residual_us < 1200.0, "{i}: {residual_us}");
        }
    }
}
