//! Description of a device for other ranks.

use serde::{Deserialize, Serialize};

use crate::device::DeviceInfo;
use crate::exec::wire;

/// Description of another rank's device, which that rank sends to rank 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceCard {
    #[serde(with = "wire::as_text")]
    pub info: DeviceInfo,
    /// Maximum predicted time of a submission, see [`crate::device::Quirks::max_dispatch_ms`].
    pub max_dispatch_ms: Option<f64>,
}
