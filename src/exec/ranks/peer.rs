//! What rank 0 knows of another rank, by calls: round trips that follow one another.

use std::time::Duration;

use super::clock::RankClock;

/// How often rank 0 calls another; more often at the start, of which so many calls count.
const CALLS: Duration = Duration::from_millis(200);
const FIRST_CALLS: (u32, Duration) = (50, Duration::from_millis(20));
/// Round trips of a call, for so long at most. Meanwhile neither end rests: clocks are the better aligned the shorter the
/// shortest of them is.
const TRIPS: u32 = 8;
pub const TRIPS_TIME: Duration = Duration::from_micros(400);
/// One call of so many has a load instead, that takes about so long: as much as large rows, and no more than frames can
/// wait for.
const LOADED: u32 = 24;
const LOAD_MS: f64 = 4.0;
const LOAD_BYTES: [usize; 2] = [1 << 16, 1 << 20];
/// The first, before there are frames, grow by so much until one takes so much longer than a small one that what threads wait for
/// cores matters little, which alone counts.
const FIRST_LOADED: u32 = 4;
const GROWTH: usize = 4;
const GROWTHS: u32 = 3;
const FIRST_LOAD_MS: f64 = 20.0;

/// Another rank. Times are milliseconds of the clock here.
#[derive(Default)]
pub struct Peer {
    pub clock: RankClock,
    /// For how long nothing has come from it.
    pub silent: Duration,
    calls: u32,
    called_ms: f64,
    /// Whether the first round trip of the newest call is still under way.
    awaits: bool,
    /// Those of it that are to come.
    trips: u32,
    /// Bytes of the next one.
    load: usize,
    /// Whether rows were on the link during the call.
    is_crowded: bool,
}

/// A round trip that is to begin.
pub struct Trip {
    pub bytes: usize,
    /// Whether another is to follow as soon as it is answered.
    pub followed: bool,
}

impl Peer {
    /// How long after a call the next one is due.
    pub fn pause(&self) -> Duration {
        if self.calls < FIRST_CALLS.0 { FIRST_CALLS.1 } else { CALLS }
    }

    /// Begins a call, unless the one before is not answered yet; `is_crowded`: rows are on their way out.
    pub fn call(&mut self, now_ms: f64, is_crowded: bool) -> Option<Trip> {
        if self.awaits {
            return None;
        }
        self.calls += 1;
        let [least, most] = LOAD_BYTES;
        let load = || self.clock.ms_per_byte.map_or(least, |ms| (LOAD_MS / ms) as usize).clamp(least, most);
        (self.trips, self.load) = if self.calls == FIRST_LOADED {
            (1 + GROWTHS, least)
        } else if self.calls.is_multiple_of(LOADED) {
            (1, load())
        } else {
            (TRIPS, 0)
        };
        (self.called_ms, self.awaits, self.is_crowded) = (now_ms, true, is_crowded);
        Some(self.trip())
    }

    fn trip(&mut self) -> Trip {
        self.trips -= 1;
        Trip { bytes: self.load, followed: self.trips > 0 && self.load == 0 }
    }

    /// Takes in a round trip with so many bytes, which read `there_ms` of the other clock; `rows_came`: some have come
    /// meanwhile. Returns what is to follow at once.
    pub fn learn(&mut self, [sent_ms, now_ms]: [f64; 2], there_ms: f64, bytes: usize, rows_came: bool) -> Option<Trip> {
        self.clock.learn(sent_ms..now_ms, there_ms);
        let is_first = std::mem::take(&mut self.awaits);
        self.is_crowded |= rows_came;
        let trip_ms = now_ms - sent_ms;
        let is_short = if bytes > 0 {
            trip_ms < FIRST_LOAD_MS + self.clock.shortest_ms.unwrap_or(0.0)
        } else {
            now_ms - self.called_ms < TRIPS_TIME.as_secs_f64() * 1e3
        };
        let goes_on = self.trips > 0 && is_short;
        // Rows do not find both ends awake, as later round trips do.
        if !self.is_crowded && if bytes > 0 { !goes_on } else { is_first } {
            self.clock.judge(trip_ms, bytes);
        }
        self.load *= GROWTH;
        goes_on.then(|| self.trip())
    }

    /// Milliseconds that a packet takes one way, and each byte of it beyond that; 0: unknown.
    pub fn link(&self) -> (f64, f64) {
        let RankClock { round_trip_ms, ms_per_byte, .. } = self.clock;
        (0.5 * round_trip_ms.unwrap_or(0.0), ms_per_byte.unwrap_or(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A link of so many ms one way and bytes a ms, whose ends sometimes wait for cores for up to 3 ms.
    struct Fake {
        latency_ms: f64,
        bytes_per_ms: f64,
        wait_ms: f64,
        random: u32,
    }

    impl Fake {
        fn wait_ms(&mut self) -> f64 {
            self.random = self.random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.random) / f64::from(u32::MAX) * self.wait_ms
        }

        /// Calls for so long; returns the link as it is then known.
        fn calls(&mut self, until_ms: f64) -> (f64, f64) {
            let (mut peer, mut now_ms) = (Peer::default(), 0.0);
            while now_ms < until_ms {
                let begin_ms = now_ms;
                let mut next = peer.call(now_ms, false);
                while let Some(Trip { bytes, .. }) = next {
                    let sent_ms = now_ms;
                    now_ms += 2.0 * self.latency_ms + bytes as f64 / self.bytes_per_ms + self.wait_ms();
                    next = peer.learn([sent_ms, now_ms], sent_ms, bytes, false);
                }
                now_ms = now_ms.max(begin_ms + peer.pause().as_secs_f64() * 1e3);
            }
            peer.link()
        }
    }

    #[test]
    fn links_are_known_by_the_time_that_frames_begin() {
        for mbps in [10.0, 50.0, 100.0, 1e3, 1e4] {
            for latency_ms in [0.02, 0.5, 30.0] {
                let bytes_per_ms = mbps * 125.0;
                let (found_ms, ms_per_byte) = Fake { latency_ms, bytes_per_ms, wait_ms: 0.0, random: 1 }.calls(1000.0);
                assert!((found_ms / latency_ms - 1.0).abs() < 1e-6, "{mbps} Mbit/s: {found_ms}, not {latency_ms} ms");
                assert!((ms_per_byte * bytes_per_ms - 1.0).abs() < 1e-6, "{mbps} Mbit/s: {ms_per_byte}");
                let (_, ms_per_byte) = Fake { latency_ms, bytes_per_ms, wait_ms: 3.0, random: 1 }.calls(1000.0);
                let off = 1.0 - 1.0 / (ms_per_byte * bytes_per_ms);
                assert!(off.abs() < 0.16 || mbps > 1e3, "{mbps} Mbit/s, {latency_ms} ms: {off}");
            }
        }
    }

    #[test]
    fn what_waits_behind_rows_says_nothing_of_the_link() {
        let mut peer = Peer::default();
        let trip = |peer: &mut Peer, begin_ms: f64, ms: f64, leaves: bool, came: bool| {
            assert!(peer.call(begin_ms, leaves).is_some());
            assert!(peer.call(begin_ms, leaves).is_none(), "it is called while it is called");
            peer.learn([begin_ms, begin_ms + ms], begin_ms, 0, came);
            peer.link().0
        };
        assert_eq!(trip(&mut peer, 0.0, 4.0, false, false), 2.0);
        assert_eq!(trip(&mut peer, 20.0, 40.0, true, false), 2.0);
        assert_eq!(trip(&mut peer, 80.0, 40.0, false, true), 2.0);
        assert!(peer.clock.zero_between([0.0, 100.0]).1.is_some());
    }
}
