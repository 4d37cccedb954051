//! Checks that ranks match in what affects the bytes of images: version, shaders, kind of adapter and traversal.

use std::hash::{DefaultHasher, Hasher};

use serde::{Deserialize, Serialize};

use crate::device::{DeviceInfo, SceneAccess, Tables, Traversal};
use crate::exec::wire;
use crate::stages::all_shader_text;

/// Host name and program of a rank, which it sends to rank 0 before it opens devices.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    pub host: String,
    version: String,
    /// Hash of the texts of all shaders.
    shaders: u64,
}

impl Identity {
    pub fn here(host: String) -> Self {
        let mut hasher = DefaultHasher::new();
        for traversal in Traversal::ALL {
            for tables in [Tables::Buffer, Tables::Texture] {
                hasher.write(all_shader_text(SceneAccess { tables, traversal }).as_bytes());
            }
        }
        Self { host, version: env!("CARGO_PKG_VERSION").to_owned(), shaders: hasher.finish() }
    }

    /// Checks that another rank runs the same program.
    ///
    /// # Errors
    /// A message that says how the program of `other` differs.
    pub fn check(&self, other: &Self) -> Result<(), String> {
        if other.version != self.version {
            return Err(format!("it runs diptych {}, but rank 0 runs {}", other.version, self.version));
        }
        if other.shaders != self.shaders {
            return Err("its shaders are not those of rank 0: start the same program on all ranks".to_owned());
        }
        Ok(())
    }
}

/// Description of another rank's device, which that rank sends to rank 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceCard {
    #[serde(with = "wire::as_text")]
    pub info: DeviceInfo,
    /// Maximum predicted time of a submission, see [`crate::device::Quirks::max_dispatch_ms`].
    pub max_dispatch_ms: Option<f64>,
}

/// Difference between a device of another rank and rank 0's first device.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DeviceMismatch {
    /// Different adapters or drivers. Both fields have the form `name, driver`.
    #[error("its adapter is {its}, but rank 0 has {first}: different adapters do not give the same bytes")]
    Adapter { its: String, first: String },
    #[error(
        "its ray traversal is {}, but rank 0 uses {}: choose the same for all ranks", its.name(), first.name()
    )]
    Traversal { its: Traversal, first: Traversal },
}

/// Checks that another rank's devices have the adapter, driver and ray traversal of `first`, rank 0's first device.
///
/// # Errors
/// [`DeviceMismatch`] of the first device that differs.
pub fn check_devices(first: &DeviceInfo, others: &[DeviceCard]) -> Result<(), DeviceMismatch> {
    for DeviceCard { info, .. } in others {
        if (&info.name, &info.driver) != (&first.name, &first.driver) {
            let [its, first] = [info, first].map(|info| format!("{}, {}", info.name, info.driver));
            return Err(DeviceMismatch::Adapter { its, first });
        }
        if info.traversal != first.traversal {
            return Err(DeviceMismatch::Traversal { its: info.traversal, first: first.traversal });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_ranks_of_other_versions_or_shaders() {
        let here = Identity::here("a".to_owned());
        assert_eq!(here.check(&Identity { host: "b".to_owned(), ..here.clone() }), Ok(()));
        let older = Identity { version: "0.0.9".to_owned(), ..here.clone() };
        assert!(here.check(&older).unwrap_err().contains("diptych 0.0.9"));
        let other = Identity { shaders: here.shaders ^ 1, ..here.clone() };
        assert!(here.check(&other).unwrap_err().contains("shaders"));
    }

    #[test]
    fn kinds_of_adapters_and_traversals_are_not_mixed() {
        let info = |name: &str, traversal| DeviceInfo {
            index: 0,
            adapter: 0,
            name: name.to_owned(),
            driver: "driver 1".to_owned(),
            kind: "software".to_owned(),
            threads: None,
            traversal,
            max_storage_bytes: 0,
            clock_residual_us: 0.0,
            rank: None,
        };
        let card = |name, traversal| DeviceCard { info: info(name, traversal), max_dispatch_ms: None };
        let first = info("one", Traversal::Compute);
        assert_eq!(check_devices(&first, &[card("one", Traversal::Compute)]), Ok(()));
        let mismatch = check_devices(&first, &[card("two", Traversal::Compute)]).unwrap_err();
        assert!(mismatch.to_string().contains("two, driver 1"));
        let other = [card("one", Traversal::Compute), card("one", Traversal::Hardware)];
        let mismatch = DeviceMismatch::Traversal { its: Traversal::Hardware, first: Traversal::Compute };
        assert_eq!(check_devices(&first, &other), Err(mismatch));
    }
}
