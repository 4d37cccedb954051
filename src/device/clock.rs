//! Device time on the host's clock.
//!
//! wgpu has no calibrated timestamps. A submission that only takes a timestamp is bracketed by two readings of the host
//! clock; the tightest of several brackets gives the offset, and half its width bounds the error.

use std::time::{Duration, Instant};

use super::{DeviceFailure, GpuDevice};

const TRIES: usize = 24;

#[derive(Clone, Copy, Debug)]
pub struct GpuClock {
    ms_per_tick: f64,
    /// Host milliseconds since `origin` at tick 0.
    offset_ms: f64,
    /// Half the tightest bracket.
    pub residual_us: f64,
}

impl GpuClock {
    /// Measures a device against `origin`.
    pub fn calibrate(gpu: &GpuDevice, origin: Instant) -> Result<Self, DeviceFailure> {
        let probe = Probe::new(&gpu.device);
        let ms_per_tick = f64::from(gpu.queue.get_timestamp_period()) * 1e-6;
        let mut best = Self { ms_per_tick, offset_ms: 0.0, residual_us: f64::INFINITY };
        for _ in 0..TRIES {
            let (tick, begin, lasted) = probe.read(gpu)?;
            let residual_us = lasted.as_secs_f64() * 0.5e6;
            if residual_us < best.residual_us {
                let middle_ms = (begin.duration_since(origin) + lasted / 2).as_secs_f64() * 1e3;
                let offset_ms = middle_ms - tick as f64 * ms_per_tick;
                best = Self { ms_per_tick, offset_ms, residual_us };
            }
        }
        Ok(best)
    }

    /// Milliseconds since the calibration's origin.
    pub fn host_ms(&self, tick: u64) -> f64 {
        tick as f64 * self.ms_per_tick + self.offset_ms
    }
}

struct Probe {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
}

impl Probe {
    fn new(device: &wgpu::Device) -> Self {
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("clock"),
                size: 16,
                usage,
                mapped_at_creation: false,
            })
        };
        Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("clock"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
        }
    }

    /// A tick, and when the submission that took it began and how long it lasted.
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
        let mut copy = gpu.device.create_command_encoder(&Default::default());
        copy.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        copy.copy_buffer_to_buffer(&self.resolved, 0, &self.readable, 0, 16);
        gpu.queue.submit([copy.finish()]);
        self.readable.slice(..).map_async(wgpu::MapMode::Read, |_| ());
        gpu.wait(None)?;
        let tick = {
            let bytes = self.readable.slice(..).get_mapped_range().map_err(|e| e.to_string())?;
            u64::from_le_bytes(bytes[8..16].try_into().map_err(|_| "a timestamp has 8 bytes".to_owned())?)
        };
        self.readable.unmap();
        Ok((tick, begin, lasted))
    }
}
