//! Learned time of downloads or uploads of a device.

use crate::schedule::learned::Line;

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Transfer {
    pub line: Line,
    latency_ms: f64,
    ms_per_byte: f64,
}

impl Transfer {
    pub fn of(line: Line) -> Self {
        let (latency_ms, ms_per_byte) = line.fit();
        Self { line, latency_ms, ms_per_byte }
    }

    pub fn ms(&self, bytes: u64) -> f64 {
        self.latency_ms + self.ms_per_byte * bytes as f64
    }
}
