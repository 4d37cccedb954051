//! Description of a device for other ranks.

use serde::{Deserialize, Serialize};

use crate::device::DeviceInfo;

/// Description of another rank's device, which that rank sends to rank 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceCard {
    /// Encoded as JSON text, since serialisation omits absent fields, which the packets' binary format does not allow.
    #[serde(with = "as_text")]
    pub info: DeviceInfo,
    /// Maximum predicted time of a submission, see [`crate::device::Quirks::max_dispatch_ms`].
    pub max_dispatch_ms: Option<f64>,
}

mod as_text {
    use serde::de::Error as _;
    use serde::ser::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer, de::DeserializeOwned};

    pub fn serialize<T: Serialize, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
        serde_json::to_string(value).map_err(S::Error::custom)?.serialize(serializer)
    }

    pub fn deserialize<'de, T: DeserializeOwned, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
        serde_json::from_str(&String::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}
