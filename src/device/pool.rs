//! Devices that commands of one process use one after another. They keep their compiled pipelines.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::GpuDevice;

/// Devices that nothing uses at present. A device that is opened with a pool returns to it when it is dropped, unless
/// it has failed.
#[derive(Clone, Debug, Default)]
pub struct DevicePool(Arc<Mutex<Vec<GpuDevice>>>);

impl DevicePool {
    fn idle(&self) -> MutexGuard<'_, Vec<GpuDevice>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the device with the most pipelines among those that serve, so that few devices compile the common ones.
    pub(super) fn take(&self, serves: impl Fn(&GpuDevice) -> bool) -> Option<GpuDevice> {
        let gpu = {
            let mut idle = self.idle();
            let serving = idle.iter().enumerate().filter(|(_, gpu)| serves(gpu));
            let (place, _) = serving.max_by_key(|(_, gpu)| gpu.pipelines.len())?;
            idle.swap_remove(place)
        };
        // Its last user may have lost it.
        gpu.wait(None).ok().map(|()| gpu)
    }
}

impl Drop for GpuDevice {
    fn drop(&mut self) {
        if let Some(pool) = self.pool.take()
            && self.failure().is_none()
        {
            pool.idle().push(self.shared());
        }
    }
}
