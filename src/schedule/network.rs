//! What rows take from one machine to another.

/// Links between the ranks that devices are of, all alike. Without ranks there are none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Network {
    /// The rank of each device.
    pub ranks: Vec<usize>,
    /// One way.
    pub latency_ms: f64,
    pub ms_per_byte: f64,
}

/// When the links of ranks are in use during a frame: sorted, disjoint times of each rank's way out and of its way in.
#[derive(Clone, Debug, Default)]
pub struct Traffic {
    lines: Vec<[Vec<(f64, f64)>; 2]>,
}

impl Network {
    /// When rows that have been sent at this time are at the thread that waits for them. Rows between machines keep the
    /// sender's way out and the receiver's way in to themselves for as long as their bytes take, and go when both are free.
    pub fn arrival_ms(&self, traffic: &mut Traffic, from: usize, to: usize, bytes: u64, sent_ms: f64) -> f64 {
        let (Some(&from), Some(&to)) = (self.ranks.get(from), self.ranks.get(to)) else { return sent_ms };
        if from == to {
            return sent_ms;
        }
        let ms = self.ms_per_byte * bytes as f64;
        traffic.pass(from, to, sent_ms, ms) + ms + self.latency_ms
    }

    /// Of these devices alone, renumbered in this order.
    pub fn of_devices(&self, devices: &[usize]) -> Self {
        let ranks = devices.iter().filter_map(|&device| self.ranks.get(device).copied()).collect();
        Self { ranks, ..self.clone() }
    }
}

impl Traffic {
    /// Takes the first time from `ready_ms` on in which both links are free for so long; returns when it begins.
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
    fn rows_that_share_a_link_go_one_after_the_other() {
        // Two devices on each of three ranks; 10 ms for 1000 bytes.
        let network = Network { ranks: vec![0, 0, 1, 1, 2, 2], latency_ms: 1.0, ms_per_byte: 0.01 };
        let mut traffic = Traffic::default();
        let mut arrival = |from, to, sent_ms| network.arrival_ms(&mut traffic, from, to, 1000, sent_ms);
        assert_eq!(arrival(0, 1, 5.0), 5.0);
        assert_eq!(arrival(0, 2, 0.0), 11.0);
        // The way out of rank 0 is in use, whichever device sends.
        assert_eq!(arrival(1, 4, 2.0), 21.0);
        // The way in of rank 2 is until 20 ms; that of rank 0 is not.
        assert_eq!(arrival(3, 5, 12.0), 31.0);
        assert_eq!(arrival(4, 0, 3.0), 14.0);
        // What comes up late in the order of tasks finds a gap, if that is long enough.
        assert_eq!(arrival(0, 3, 40.0), 51.0);
        assert_eq!(arrival(0, 3, 22.0), 33.0);
        assert_eq!(arrival(0, 3, 33.0), 61.0);
    }
}
