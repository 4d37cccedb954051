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

impl Network {
    /// So many bytes, from the thread that has them to the thread that waits for them.
    pub fn ms(&self, from: usize, to: usize, bytes: u64) -> f64 {
        let is_apart = self.ranks.get(from) != self.ranks.get(to);
        if is_apart { self.latency_ms + self.ms_per_byte * bytes as f64 } else { 0.0 }
    }

    /// Of these devices alone, renumbered in this order.
    pub fn of_devices(&self, devices: &[usize]) -> Self {
        let ranks = devices.iter().filter_map(|&device| self.ranks.get(device).copied()).collect();
        Self { ranks, ..self.clone() }
    }
}
