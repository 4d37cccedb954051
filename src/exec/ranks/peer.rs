//! State of the link to another rank. Rank 0 measures its links with calls: series of pings, each with a response.

use std::time::Duration;

use super::clock::RankClock;

/// Interval between two calls to the same rank.
const CALLS: Duration = Duration::from_millis(200);
/// Number of first calls to a rank, and the shorter interval between them.
const FIRST_CALLS: (u32, Duration) = (50, Duration::from_millis(20));
/// Maximum number of round trips of a call.
const TRIPS: u32 = 8;
/// Time after the begin of a call until which it may send further pings. In this time both ranks poll without sleeping,
/// since a shorter round trip gives tighter bounds of the clock offset.
pub const TRIPS_TIME: Duration = Duration::from_micros(400);
/// Interval of bandwidth probes: each call whose number is a multiple of this one sends a single ping with a payload,
/// the load, instead of a series of empty pings.
const LOADED: u32 = 24;
/// Intended transfer time of a load, in milliseconds: as long as a large transfer of rows, but too short to delay
/// frames.
const LOAD_MS: f64 = 4.0;
/// Minimum and maximum size of a load, in bytes.
const LOAD_BYTES: [usize; 2] = [1 << 16, 1 << 20];
/// Startup bandwidth probe: the call with this number, before there are frames, sends pings with loads. The load grows
/// by the factor `GROWTH`, at most `GROWTHS` times, until a round trip takes `FIRST_LOAD_MS` longer than the shortest
/// one, so that scheduling noise is negligible. Only the last round trip counts.
const FIRST_LOADED: u32 = 4;
const GROWTH: usize = 4;
const GROWTHS: u32 = 3;
const FIRST_LOAD_MS: f64 = 20.0;

/// Another rank. Times are in milliseconds of the local clock.
#[derive(Default)]
pub struct Peer {
    pub clock: RankClock,
    /// Time since its last packet.
    pub silent: Duration,
    calls: u32,
    called_ms: f64,
    /// True while the first round trip of the newest call is in progress.
    awaits: bool,
    /// Number of round trips of the newest call that have not begun.
    trips: u32,
    /// Load of the next round trip, in bytes.
    load: usize,
    /// True if rows were transferred over the link during the newest call.
    is_crowded: bool,
}

/// A ping to send to the other rank, which starts a round trip.
pub struct Ping {
    pub bytes: usize,
    /// True if another one follows as soon as this one is answered.
    pub followed: bool,
}

impl Peer {
    /// Returns the time from a call to the next one.
    pub fn pause(&self) -> Duration {
        if self.calls < FIRST_CALLS.0 { FIRST_CALLS.1 } else { CALLS }
    }

    /// Begins a call and returns its first ping. Returns `None` while the first ping of the previous call has no
    /// response. `is_crowded` is true while rows are being sent.
    pub fn call(&mut self, now_ms: f64, is_crowded: bool) -> Option<Ping> {
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

    fn trip(&mut self) -> Ping {
        self.trips -= 1;
        Ping { bytes: self.load, followed: self.trips > 0 && self.load == 0 }
    }

    /// Records a round trip from `sent_ms` to `now_ms` with a load of `bytes` bytes, during which the other rank's
    /// clock read `there_ms`. `rows_came` is true if rows arrived meanwhile. Returns the next ping of the call, to be
    /// sent at once, if there is one.
    pub fn learn(&mut self, [sent_ms, now_ms]: [f64; 2], there_ms: f64, bytes: usize, rows_came: bool) -> Option<Ping> {
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
        // Only the first of several empty pings counts: during later ones, both ranks poll without sleeping, but
        // packets of rows may have to wake the receiver. Of pings with loads, only the last counts.
        if !self.is_crowded && if bytes > 0 { !goes_on } else { is_first } {
            self.clock.judge(trip_ms, bytes);
        }
        self.load *= GROWTH;
        goes_on.then(|| self.trip())
    }

    /// Returns the one-way latency of a packet in milliseconds, and the milliseconds per byte; 0 if unknown.
    pub fn link(&self) -> (f64, f64) {
        let RankClock { round_trip_ms, ms_per_byte, .. } = self.clock;
        (0.5 * round_trip_ms.unwrap_or(0.0), ms_per_byte.unwrap_or(0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A simulated link with this latency and bandwidth. Each round trip waits for cores for up to `wait_ms`.
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

        /// Simulates calls until `until_ms`; returns the measured latency and time per byte.
        fn calls(&mut self, until_ms: f64) -> (f64, f64) {
            let (mut peer, mut now_ms) = (Peer::default(), 0.0);
            while now_ms < until_ms {
                let begin_ms = now_ms;
                let mut next = peer.call(now_ms, false);
                while let Some(Ping { bytes, .. }) = next {
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
    fn link_speed_is_known_before_frames_begin() {
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
    fn calls_delayed_by_rows_do_not_change_latency() {
        let mut peer = Peer::default();
        let trip = |peer: &mut Peer, begin_ms: f64, ms: f64, leaves: bool, came: bool| {
            assert!(peer.call(begin_ms, leaves).is_some());
            assert!(peer.call(begin_ms, leaves).is_none(), "a call began before the previous one was answered");
            peer.learn([begin_ms, begin_ms + ms], begin_ms, 0, came);
            peer.link().0
        };
        assert_eq!(trip(&mut peer, 0.0, 4.0, false, false), 2.0);
        assert_eq!(trip(&mut peer, 20.0, 40.0, true, false), 2.0);
        assert_eq!(trip(&mut peer, 80.0, 40.0, false, true), 2.0);
        assert!(peer.clock.zero_between([0.0, 100.0]).1.is_some());
    }
}
