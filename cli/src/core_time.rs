//! Time that other programs took of the cores, as the system counts it.

use std::fs;

use super::node;

/// Shortest time over which the fraction is known, since systems count the time of programs in ticks of 10 ms, seconds.
const SHORTEST_S: f64 = 0.5;
/// Duration of a tick in the files of Linux, seconds.
const TICK_S: f64 = 0.01;

/// Time since the start of the system, as means over the cores that this process may use.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CoreTime {
    /// Time in which other programs ran, or other machines on the same host, seconds.
    pub others_s: f64,
    pub all_s: f64,
}

impl CoreTime {
    /// Reads the time from Linux; `None` on other systems, and if other ranks run on this machine.
    pub(super) fn read() -> Option<Self> {
        let is_shared =
            node::others().is_some_and(|node| (1..node.ranks()).any(|rank| node.host(rank) == node.host(0)));
        let [all, own, status] =
            ["/proc/stat", "/proc/self/stat", "/proc/self/status"].map(|path| fs::read_to_string(path).ok());
        if is_shared { None } else { Self::parse(&all?, &own?, &status?) }
    }

    /// Subtracts the time of a process and of its children that ended, in a file like `/proc/self/stat`, from that of
    /// all programs on the cores that the process may use. These are in files like `/proc/stat` and
    /// `/proc/self/status`.
    fn parse(all: &str, own: &str, status: &str) -> Option<Self> {
        let allowed = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"))?.trim();
        let is_allowed = |core: u32| {
            allowed.split(',').any(|range| {
                let (first, last) = range.split_once('-').unwrap_or((range, range));
                matches!((first.parse::<u32>(), last.parse::<u32>()), (Ok(a), Ok(b)) if (a..=b).contains(&core))
            })
        };
        let (mut cores, mut busy, mut all_ticks) = (0, 0.0, 0.0);
        for line in all.lines() {
            let mut words = line.split_whitespace();
            let core = words.next().and_then(|name| name.strip_prefix("cpu")?.parse().ok());
            if core.is_some_and(is_allowed) {
                let ticks: Vec<f64> = words.filter_map(|ticks| ticks.parse().ok()).collect();
                let [user, nice, system, idle, iowait, irq, softirq, steal, ..] = ticks[..] else { return None };
                let of_core = user + nice + system + irq + softirq + steal;
                (cores, busy, all_ticks) = (cores + 1, busy + of_core, all_ticks + of_core + idle + iowait);
            }
        }
        // The name of a program, in parentheses, may contain spaces. Its times are eleven fields behind its state.
        let (_, own) = own.rsplit_once(')')?;
        let own: Vec<f64> = own.split_whitespace().skip(11).filter_map(|ticks| ticks.parse().ok()).collect();
        let own: f64 = own.get(..4)?.iter().sum();
        let [others_s, all_s] = [busy - own, all_ticks].map(|ticks| ticks * TICK_S / f64::from(cores));
        (cores > 0).then_some(Self { others_s, all_s })
    }

    /// Returns the fraction of the cores that other programs took since an earlier time; `None` if that was too short
    /// ago.
    pub fn share_since(self, before: Self) -> Option<f64> {
        self.share_over(SHORTEST_S, before)
    }

    pub(super) fn share_over(self, least_s: f64, before: Self) -> Option<f64> {
        let all_s = self.all_s - before.all_s;
        (all_s >= least_s).then(|| ((self.others_s - before.others_s) / all_s).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATUS: &str = "Name:\ta\nCpus_allowed_list:\t0,2-3\nThreads:\t4\n";
    const OWN: &str = "77 (a (b) c) S 1 77 77 0 -1 4194304 9 9 0 0 250 50 60 40 20 0 4 0 9 9 9";

    #[test]
    fn own_time_is_not_that_of_others() {
        let stat = |user: u32, idle: u32| {
            let core = format!("{user} 5 20 {idle} 10 5 0 20 0 0");
            format!("cpu  9 9 9 9 9 9 9 9 0 0\ncpu0 {core}\ncpu1 99 0 0 0 0 0 0 0 0 0\ncpu2 {core}\nintr 7\n")
        };
        let read = |user, idle, own: &str| CoreTime::parse(&stat(user, idle), own, STATUS).unwrap();
        let before = read(500, 1500, OWN);
        assert_eq!(before, CoreTime { others_s: 3.5, all_s: 20.6 });
        // 100 of 200 ticks were busy.
        assert!((read(550, 1550, OWN).share_since(before).unwrap() - 0.5).abs() < 1e-9);
        // The process ran for 80 of these ticks itself.
        let share = read(550, 1550, &OWN.replace("250", "330")).share_since(before);
        assert!((share.unwrap() - 0.1).abs() < 1e-9, "{share:?}");
    }

    #[test]
    fn odd_files_tell_nothing() {
        let stat = "cpu  1 2 3 4 5 6 7 8 0 0\ncpu0 1 2 3 4 5 6 7 8 0 0\n";
        assert!(CoreTime::parse(stat, OWN, STATUS).is_some());
        for (all, own, status) in [
            ("", OWN, STATUS),
            ("cpu0 1 2", OWN, STATUS),
            (stat, "", STATUS),
            (stat, "77 (a) S 1", STATUS),
            (stat, "7 (a) S x y z", STATUS),
            (stat, OWN, ""),
            (stat, OWN, "Cpus_allowed_list:\t7\n"),
            (stat, OWN, "Cpus_allowed_list:\ta-b,\n"),
        ] {
            assert_eq!(CoreTime::parse(all, own, status), None, "{all} {own} {status}");
        }
        let now = CoreTime { others_s: 2.0, all_s: 9.0 };
        assert_eq!(now.share_since(CoreTime { others_s: 2.0, all_s: 8.9 }), None);
        // Ticks round, so the time of others may seem to go back.
        assert_eq!(now.share_since(CoreTime { others_s: 2.1, all_s: 8.0 }), Some(0.0));
    }
}
