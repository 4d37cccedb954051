//! Converts device timestamps to the host's clock.
//!
//! wgpu has no calibrated timestamps. The host times of submission and of observed completion bracket the device
//! timestamps of that work. At startup, submissions that only write a timestamp give tight brackets. Later every frame
//! narrows them again, because the clocks drift.

mod counter;
mod offset;

use std::ops::Range;
use std::time::{Duration, Instant};

use super::staging::Pool;
use super::{DeviceFailure, GpuDevice};
use counter::Counter;
pub use offset::{MOST_DRIFT, Offset};

const TRIES: usize = 24;

#[derive(Clone, Debug)]
pub struct GpuClock {
    ms_per_tick: f64,
    counter: Counter,
    offset: Offset,
    /// Latest timestamp so far, milliseconds since the origin.
    latest_ms: f64,
    /// Largest error bound of the offset so far, in microseconds.
    pub residual_us: f64,
}

impl GpuClock {
    /// Creates the clock of a device, whose offset is unknown until [`Self::calibrate`].
    pub fn of(gpu: &GpuDevice) -> Self {
        Self::new(f64::from(gpu.queue.get_timestamp_period()) * 1e-6)
    }

    /// Measures the offset of the device's clock from `origin`.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device fails.
    pub fn calibrate(&mut self, gpu: &GpuDevice, origin: Instant) -> Result<(), DeviceFailure> {
        let probe = Probe::new(gpu);
        for _ in 0..TRIES {
            let (tick, begin, lasted) = probe.read(gpu)?;
            let begin_ms = begin.duration_since(origin).as_secs_f64() * 1e3;
            self.host_ms(&[tick], &(begin_ms..begin_ms + lasted.as_secs_f64() * 1e3));
        }
        self.offset.centre();
        self.residual_us = self.offset.error_ms() * 1e3;
        Ok(())
    }

    fn new(ms_per_tick: f64) -> Self {
        let (counter, offset) = (Counter::default(), Offset::default());
        Self { ms_per_tick, counter, offset, latest_ms: f64::NEG_INFINITY, residual_us: 0.0 }
    }

    /// Converts timestamps to milliseconds since the calibration's origin. `bracket_ms` holds the host times at which
    /// the work was submitted and at which it was seen to have ended. No returned time precedes a time of an earlier
    /// call, even if the offset shrinks.
    pub fn host_ms(&mut self, ticks: &[u64], bracket_ms: &Range<f64>) -> Vec<f64> {
        let mut times: Vec<f64> = self.counter.elapsed(ticks).iter().map(|tick| tick * self.ms_per_tick).collect();
        let first = times.iter().copied().fold(f64::INFINITY, f64::min);
        let last = times.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        self.offset.narrow(&(first..last), bracket_ms);
        self.residual_us = self.residual_us.max(self.offset.error_ms() * 1e3);
        times.iter_mut().for_each(|ms| *ms = (*ms + self.offset.value()).max(self.latest_ms));
        self.latest_ms = times.iter().copied().fold(self.latest_ms, f64::max);
        times
    }
}

struct Probe {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    pool: Pool,
}

impl Probe {
    fn new(gpu: &GpuDevice) -> Self {
        Self {
            queries: gpu.timestamps("clock", 2),
            resolved: gpu.buffer("clock", 16, wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            pool: Pool::default(),
        }
    }

    /// Submits work that only writes a timestamp. Returns the timestamp, the host time of submission, and the time
    /// until the host saw the completion.
    fn read(&self, gpu: &GpuDevice) -> Result<(u64, Instant, Duration), DeviceFailure> {
        let mut stamp = gpu.device.create_command_encoder(&Default::default());
        stamp.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("clock"),
            timestamp_writes: Some(wgpu::ComputePassTimestampWrites {
                query_set: &self.queries,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            }),
        });
        let commands = stamp.finish();
        let begin = Instant::now();
        let index = gpu.queue.submit([commands]);
        gpu.wait(Some(index))?;
        let lasted = begin.elapsed();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        let copy = self.pool.record(gpu, &mut encoder, &self.resolved, 8, 8);
        let back = copy.submitted(gpu.queue.submit([encoder.finish()]));
        let tick = bytemuck::pod_read_unaligned(&self.pool.finish(gpu, back)?);
        Ok((tick, begin, lasted))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 36-bit counter with 10 ns per tick that runs 40 ppm too fast and wraps around after 11 minutes.
    #[test]
    fn device_times_follow_the_host_and_never_decrease() {
        let mut clock = GpuClock::new(1e-5);
        let tick = |host_ms: f64| ((host_ms * 1e5 * (1.0 + 40e-6)) as u64 + 123_456_789) % (1 << 36);
        let mut before_ms = f64::NEG_INFINITY;
        for frame in 0..100_000 {
            let begin_ms = f64::from(frame) * 10.0;
            // Several frames are in flight: the device runs one after the other.
            let taken_ms = [begin_ms, begin_ms + 4.0, begin_ms + 4.0, begin_ms + 10.0];
            let bracket_ms = begin_ms - 0.1 - f64::from(frame % 7)..begin_ms + 10.1 + f64::from(frame % 5);
            let times_ms = clock.host_ms(&taken_ms.map(tick), &bracket_ms);
            for (taken_ms, ms) in taken_ms.into_iter().zip(&times_ms) {
                assert!((ms - taken_ms).abs() < 0.3, "frame {frame}: {ms} instead of {taken_ms}");
            }
            assert!(times_ms.is_sorted() && times_ms[0] >= before_ms, "frame {frame}: {times_ms:?} after {before_ms}");
            before_ms = times_ms[3];
        }
        assert!(clock.residual_us < 500.0 * 7.0, "{}", clock.residual_us);
    }
}
