//! What drivers do beside what their API says, as far as the renderer goes by it.

use wgpu::{AdapterInfo, DeviceType};

/// What shaders read the scene's tables from. The images are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Tables {
    #[default]
    Buffer,
    /// On lavapipe the faster way.
    Texture,
}

impl Tables {
    /// The end of the names of the shaders' files that read and change them.
    pub fn name(self) -> &'static str {
        match self {
            Self::Buffer => "buffer",
            Self::Texture => "texture",
        }
    }
}

/// Of one adapter. All is off on what nothing is known of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quirks {
    /// The number of worker threads comes from the environment when a device is made.
    pub threads_by_environment: bool,
    /// The queue takes no second submission while the first one runs, but holds its caller up.
    pub submit_blocks: bool,
    /// The system resets the device when a submission takes seconds. So long may one be predicted to take unless another
    /// bound is set, which leaves room for predictions that are wrong.
    pub max_dispatch_ms: Option<f64>,
    pub tables: Tables,
}

/// A tenth of what Windows allows.
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
