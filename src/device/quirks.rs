//! Driver behaviour beyond the API's specification that the renderer adapts to.

use wgpu::{AdapterInfo, DeviceType};

/// Resource from which shaders read the scene's tables. Both give the same images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tables {
    #[default]
    Buffer,
    /// The faster choice on lavapipe.
    Texture,
}

impl Tables {
    /// Returns the suffix in the names of the shader files that access these tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Buffer => "buffer",
            Self::Texture => "texture",
        }
    }
}

/// Quirks of one adapter. The default, for drivers without known quirks, has all of them off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quirks {
    /// The driver reads its number of worker threads from the environment when a device is created.
    pub threads_by_environment: bool,
    /// Submitting blocks while an earlier submission runs.
    pub submit_blocks: bool,
    /// Maximum predicted time of a submission, unless another bound is set. The GPU watchdog (TDR on Windows) resets
    /// devices after seconds; the bound leaves room for wrong predictions.
    pub max_dispatch_ms: Option<f64>,
    pub tables: Tables,
}

/// Value of [`Quirks::max_dispatch_ms`] on GPUs: a tenth of the TDR delay on Windows.
const MAX_DISPATCH_MS: f64 = 200.0;

impl Quirks {
    pub fn of(info: &AdapterInfo) -> Self {
        let is_software = info.device_type == DeviceType::Cpu;
        let is_lavapipe = is_software && info.driver == "llvmpipe";
        Self {
            threads_by_environment: is_lavapipe,
            submit_blocks: is_lavapipe,
            max_dispatch_ms: (!is_software).then_some(MAX_DISPATCH_MS),
            tables: if is_lavapipe { Tables::Texture } else { Tables::Buffer },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wgpu::Backend;

    fn quirks(kind: DeviceType, backend: Backend, driver: &str) -> Quirks {
        Quirks::of(&AdapterInfo { driver: driver.to_owned(), ..AdapterInfo::new(kind, backend) })
    }

    #[test]
    fn work_arounds_for_lavapipe_are_off_elsewhere() {
        let lavapipe = quirks(DeviceType::Cpu, Backend::Vulkan, "llvmpipe");
        let (threads_by_environment, submit_blocks, tables) = (true, true, Tables::Texture);
        assert_eq!(lavapipe, Quirks { threads_by_environment, submit_blocks, max_dispatch_ms: None, tables });
        for driver in ["SwiftShader driver", "10.0.22621.2506", ""] {
            assert_eq!(quirks(DeviceType::Cpu, Backend::Dx12, driver), Quirks::default());
        }
        let gpu = Quirks { max_dispatch_ms: Some(MAX_DISPATCH_MS), ..Quirks::default() };
        for kind in [DeviceType::DiscreteGpu, DeviceType::IntegratedGpu, DeviceType::VirtualGpu, DeviceType::Other] {
            assert_eq!(quirks(kind, Backend::Vulkan, "radv"), gpu);
            assert_eq!(quirks(kind, Backend::Metal, "llvmpipe"), gpu);
        }
    }
}
