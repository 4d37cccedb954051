//! Transfer times between machines.

/// Network between the ranks that drive the devices. All links have the same latency and bandwidth. If `ranks` is
/// empty, transfers take no time on the network.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Network {
    /// The rank of each device.
    pub ranks: Vec<usize>,
    /// One-way latency.
    pub latency_ms: f64,
    pub ms_per_byte: f64,
}

/// Busy intervals (begin, end) of the ranks' links during a frame in milliseconds, sorted and disjoint: outgoing and
/// incoming, for each rank.
#[derive(Clone, Debug, Default)]
pub struct Traffic {
    lines: Vec<[Vec<(f64, f64)>; 2]>,
}

impl Network {
    /// Returns the time at which rows that were sent at `sent_ms` reach the thread that waits for them. A transfer
    /// between machines occupies the sender's outgoing and the receiver's incoming link exclusively, and starts when
    /// both are free.
    pub fn arrival_ms(&self, traffic: &mut Traffic, from: usize, to: usize, bytes: u64, sent_ms: f64) -> f64 {
        let (Some(&from), Some(&to)) = (self.ranks.get(from), self.ranks.get(to)) else { return sent_ms };
        if from == to {
            return sent_ms;
        }
        let ms = self.ms_per_byte * bytes as f64;
        traffic.pass(from, to, sent_ms, ms) + ms + self.latency_ms
    }

    /// Returns the network of a subset of the devices, which are renumbered from 0 in this order.
    pub fn of_devices(&self, devices: &[usize]) -> Self {
        let ranks = devices.iter().filter_map(|&device| self.ranks.get(device).copied()).collect();
        Self { ranks, ..self.clone() }
    }
}

impl Traffic {
    /// Reserves the first interval of `ms` from `ready_ms` on in which both links are free. Returns its start.
    fn pass(&mut self, from: usize, to: usize, ready_ms: f64, ms: f64) -> f64 {
        if ms <= 0.0 {
            return ready_ms;
        }
        self.lines.resize(self.lines.len().max(from.max(to) + 1), Default::default());
        let mut begin_ms = ready_ms;
        while let Some(free_ms) = [&self.lines[from][0], &self.lines[to][1]].into_iter().find_map(|line| {
            let next = line.get(line.partition_point(|(_, end_ms)| *end_ms <= begin_ms))?;
            (next.0 < begin_ms + ms).then_some(next.1)
        }) {
            begin_ms = free_ms;
        }
        for (rank, way) in [(from, 0), (to, 1)] {
            let line = &mut self.lines[rank][way];
            line.insert(line.partition_point(|(other_ms, _)| *other_ms < begin_ms), (begin_ms, begin_ms + ms));
        }
        begin_ms
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transfers_on_a_shared_link_are_serialized() {
        // Two devices on each of three ranks; 10 ms for 1000 bytes.
        let network = Network { ranks: vec![0, 0, 1, 1, 2, 2], latency_ms: 1.0, ms_per_byte: 0.01 };
        let mut traffic = Traffic::default();
        let mut arrival = |from, to, sent_ms| network.arrival_ms(&mut traffic, from, to, 1000, sent_ms);
        assert_eq!(arrival(0, 1, 5.0), 5.0);
        assert_eq!(arrival(0, 2, 0.0), 11.0);
        // The outgoing link of rank 0 is busy, whichever device sends.
        assert_eq!(arrival(1, 4, 2.0), 21.0);
        // The incoming link of rank 2 is busy until 20 ms; that of rank 0 is free.
        assert_eq!(arrival(3, 5, 12.0), 31.0);
        assert_eq!(arrival(4, 0, 3.0), 14.0);
        // Transfers that come later in the order of tasks fill earlier gaps, if these are long enough.
        assert_eq!(arrival(0, 3, 40.0), 51.0);
        assert_eq!(arrival(0, 3, 22.0), 33.0);
        assert_eq!(arrival(0, 3, 33.0), 61.0);
    }
}
