//! Host-readable buffers, kept for the next frame.

use std::sync::mpsc;

use crate::device::{DeviceFailure, GpuDevice};

/// Free read-back buffers of one device.
#[derive(Default)]
pub struct Pool {
    free: Vec<wgpu::Buffer>,
}

/// Rows on their way to the host.
pub struct ReadBack {
    buffer: wgpu::Buffer,
    size: u64,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    submission: wgpu::SubmissionIndex,
}

/// A copy that is recorded but not submitted.
pub struct Recorded {
    buffer: wgpu::Buffer,
    size: u64,
}

impl Pool {
    /// Records a copy of part of `source`.
    pub fn record(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::Buffer,
        offset: u64,
        size: u64,
    ) -> Recorded {
        let fits = |b: &wgpu::Buffer| b.size() >= size && b.size() <= 4 * size.max(4096);
        let buffer = match self.free.iter().position(fits) {
            Some(i) => self.free.swap_remove(i),
            None => gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("read back"),
                size: size.next_power_of_two(),
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
        };
        encoder.copy_buffer_to_buffer(source, offset, &buffer, 0, size);
        Recorded { buffer, size }
    }

    /// Bytes of a copy whose submission is done.
    pub fn finish(&mut self, gpu: &GpuDevice, back: ReadBack) -> Result<Vec<u8>, DeviceFailure> {
        gpu.wait(Some(back.submission))?;
        back.mapped.recv_timeout(gpu.patience).map_err(|e| e.to_string())?.map_err(|e| e.to_string())?;
        let bytes = back.buffer.slice(..back.size).get_mapped_range().map_err(|e| e.to_string())?.to_vec();
        back.buffer.unmap();
        self.free.push(back.buffer);
        Ok(bytes)
    }
}

impl ReadBack {
    pub fn submission(&self) -> wgpu::SubmissionIndex {
        self.submission.clone()
    }
}

impl Recorded {
    /// Asks for the mapping once the copy's submission is on its way.
    pub fn submitted(self, submission: wgpu::SubmissionIndex) -> ReadBack {
        let (sender, mapped) = mpsc::channel();
        self.buffer.slice(..self.size).map_async(wgpu::MapMode::Read, move |result| {
            // Nobody listens any more if the run has ended.
            let _ = sender.send(result);
        });
        ReadBack { buffer: self.buffer, size: self.size, mapped, submission }
    }
}
