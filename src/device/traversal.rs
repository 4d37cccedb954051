//! Selects ray traversal in compute shaders or by hardware ray queries.

use super::GpuDevice;

/// Ray traversal of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum Traversal {
    /// Compute shaders that traverse the BVHs of [`crate::accel`].
    #[default]
    Compute,
    /// Hardware ray queries on the driver's acceleration structures.
    Hardware,
}

impl Traversal {
    pub const ALL: [Self; 2] = [Self::Compute, Self::Hardware];

    pub fn name(self) -> &'static str {
        match self {
            Self::Compute => "compute",
            Self::Hardware => "hardware",
        }
    }

    /// Returns the features to open devices with.
    pub(crate) fn features(self) -> wgpu::Features {
        let always = GpuDevice::REQUIRED_FEATURES | wgpu::Features::TIMESTAMP_QUERY;
        match self {
            Self::Compute => always,
            Self::Hardware => always | wgpu::Features::EXPERIMENTAL_RAY_QUERY,
        }
    }

    pub(super) fn experiments(self) -> wgpu::ExperimentalFeatures {
        match self {
            Self::Compute => wgpu::ExperimentalFeatures::disabled(),
            // SAFETY: validation of ray queries is the part that is still in progress in wgpu. Our queries stay within
            // Vulkan's rules: each is initialised with finite numbers, proceeds until it is done and no further, and is
            // read after that.
            Self::Hardware => unsafe { wgpu::ExperimentalFeatures::enabled() },
        }
    }
}

/// Choice of [`Traversal`] for opening devices. All devices of a run share one, since the two do not give the same
/// bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum TraversalChoice {
    /// Hardware if every device is a GPU with ray queries, else compute
    #[default]
    Auto,
    /// Compute shaders
    Compute,
    /// Hardware ray queries
    Hardware,
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::device::AdapterReport;

    pub fn adapter(kind: &str, ray_queries: bool) -> AdapterReport {
        AdapterReport {
            index: 7,
            name: "Fast One".to_owned(),
            driver: "driver 1.0".to_owned(),
            backend: "Vulkan".to_owned(),
            kind: kind.to_owned(),
            max_storage_mib: 128,
            max_storage_buffers: 32,
            timestamps: true,
            ray_queries,
            missing: Vec::new(),
            hint: "",
            advice: None,
            info: wgpu::AdapterInfo::new(wgpu::DeviceType::DiscreteGpu, wgpu::Backend::Vulkan),
            quirks: Default::default(),
        }
    }

    #[test]
    fn auto_traversal_needs_ray_queries_on_all_gpus() {
        let [able, unable] = [true, false].map(|has| adapter("discrete GPU", has));
        let [software, old_software] = [true, false].map(|has| adapter("software", has));
        for (adapters, chosen) in [
            (vec![&able], Traversal::Hardware),
            (vec![&able, &able], Traversal::Hardware),
            (vec![&able, &unable], Traversal::Compute),
            (vec![&unable], Traversal::Compute),
            (vec![&software], Traversal::Compute),
            (vec![&able, &software], Traversal::Compute),
            (vec![&old_software], Traversal::Compute),
        ] {
            assert_eq!(TraversalChoice::Auto.on(&adapters).unwrap(), chosen, "{adapters:?}");
            assert_eq!(TraversalChoice::Compute.on(&adapters).unwrap(), Traversal::Compute);
        }
    }

    #[test]
    fn rejects_hardware_traversal_without_ray_queries() {
        let [able, unable] = [true, false].map(|has| adapter("discrete GPU", has));
        let software = adapter("software", true);
        assert_eq!(TraversalChoice::Hardware.on(&[&able, &software]).unwrap(), Traversal::Hardware);
        let refused = TraversalChoice::Hardware.on(&[&able, &unable]).unwrap_err().to_string();
        for part in ["adapter 7", "Fast One", "driver 1.0", "no ray queries", "compute traversal", "another adapter"] {
            assert!(refused.contains(part), "{refused}");
        }
    }
}
