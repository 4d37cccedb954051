//! Readback buffers, which are reused in later frames.

use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError, mpsc};

use super::{DeviceFailure, GpuDevice};

/// Free readback buffers of one device.
#[derive(Default)]
pub struct Pool {
    free: Arc<FreeBuffers>,
}

/// Mapped buffers that are no longer read.
type FreeBuffers = Mutex<Vec<wgpu::Buffer>>;

/// A submitted copy to the host.
pub struct ReadBack {
    buffer: wgpu::Buffer,
    size: u64,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
    pub submission: wgpu::SubmissionIndex,
}

/// A copy that is recorded but not submitted.
pub struct Recorded {
    buffer: wgpu::Buffer,
    size: u64,
}

/// Bytes in a mapped buffer, which returns to its pool on drop. The buffer stays mapped until the pool reuses it. So a
/// thread that drops it makes no call to the device, which belongs to another thread.
pub struct Mapped {
    /// `None` once dropped.
    view: Option<wgpu::BufferView>,
    buffer: wgpu::Buffer,
    free: Arc<FreeBuffers>,
}

impl Pool {
    /// Records a copy of `size` bytes of `source`, from `offset` on, to a free or new readback buffer.
    pub fn record(
        &self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        source: &wgpu::Buffer,
        offset: u64,
        size: u64,
    ) -> Recorded {
        let buffer = self.take(size).unwrap_or_else(|| {
            let size = size.next_power_of_two().min(gpu.device.limits().max_buffer_size);
            gpu.buffer("read back", size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST)
        });
        encoder.copy_buffer_to_buffer(source, offset, &buffer, 0, size);
        Recorded { buffer, size }
    }

    fn take(&self, size: u64) -> Option<wgpu::Buffer> {
        let fits = |b: &wgpu::Buffer| b.size() >= size && b.size() <= 4 * size.max(4096);
        let mut free = self.free.lock().unwrap_or_else(PoisonError::into_inner);
        let place = free.iter().position(fits)?;
        let buffer = free.swap_remove(place);
        buffer.unmap();
        Some(buffer)
    }

    /// Waits until the submission of a copy has completed; returns the copied bytes.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device or the mapping failed.
    pub fn finish(&self, gpu: &GpuDevice, back: ReadBack) -> Result<Mapped, DeviceFailure> {
        gpu.wait(Some(back.submission))?;
        back.mapped.recv_timeout(gpu.patience).map_err(|e| e.to_string())?.map_err(|e| e.to_string())?;
        let view = back.buffer.slice(..back.size).get_mapped_range().map_err(|e| e.to_string())?;
        Ok(Mapped { view: Some(view), buffer: back.buffer, free: Arc::clone(&self.free) })
    }
}

impl Deref for Mapped {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.view.as_deref().unwrap_or_default()
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        self.view = None;
        self.free.lock().unwrap_or_else(PoisonError::into_inner).push(self.buffer.clone());
    }
}

impl Recorded {
    /// Requests the mapping of the buffer. Call this once the copy is submitted, with its submission.
    pub fn submitted(self, submission: wgpu::SubmissionIndex) -> ReadBack {
        let (sender, mapped) = mpsc::channel();
        self.buffer.slice(..self.size).map_async(wgpu::MapMode::Read, move |result| {
            // The receiver is gone if the run has ended.
            let _ = sender.send(result);
        });
        ReadBack { buffer: self.buffer, size: self.size, mapped, submission }
    }
}
