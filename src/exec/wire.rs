//! Serialization of types from other modules.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::graph::{Assignment, Partition, Stripes};
use crate::passes::partitions;
use crate::scene::rig::Eye;

/// Serializes types whose memory layout is shared with shaders, as raw bytes.
pub mod pod {
    use bytemuck::Pod;
    use serde::de::Error as _;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<T: Pod, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytemuck::bytes_of(value))
    }

    pub fn deserialize<'de, T: Pod, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
        let bytes = Vec::deserialize(deserializer)?;
        bytemuck::try_pod_read_unaligned(&bytes).map_err(D::Error::custom)
    }
}

/// Serializes lists of such types.
pub mod pods {
    use bytemuck::Pod;
    use serde::{Deserialize, Deserializer, Serializer};

    pub fn serialize<T: Pod, S: Serializer>(values: &[T], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytemuck::cast_slice(values))
    }

    pub fn deserialize<'de, T: Pod, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
        let bytes = Vec::deserialize(deserializer)?;
        if !bytes.len().is_multiple_of(size_of::<T>()) {
            return Err(serde::de::Error::custom("a part of a value"));
        }
        Ok(bytemuck::pod_collect_to_vec::<u8, T>(&bytes))
    }
}

/// Serializes types that omit absent fields, which the binary format of packets does not allow: as JSON text.
pub mod as_text {
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

/// Serialized form of an [`Assignment`]. `common` holds the inner edges of the stripes that most partitions share.
/// `own` holds the inner edges for partitions with stripes of their own, each with partition name and view.
#[derive(Serialize, Deserialize)]
struct AssignmentFields {
    primary: usize,
    height: u32,
    common: Vec<u32>,
    own: Vec<(String, Option<Eye>, Vec<u32>)>,
}

impl From<&Assignment> for AssignmentFields {
    fn from(assignment: &Assignment) -> Self {
        let edges = |stripes: &Stripes| stripes.inner_edges().to_vec();
        let own = |((group, eye), stripes): &((Partition, _), _)| (group.0.to_owned(), *eye, edges(stripes));
        Self {
            primary: assignment.primary(),
            height: assignment.height(),
            common: edges(assignment.common()),
            own: assignment.own().iter().map(own).collect(),
        }
    }
}

impl AssignmentFields {
    /// Converts the fields to an [`Assignment`]. Returns `None` if they contradict one another, or name a partition
    /// that does not exist.
    fn assignment(&self) -> Option<Assignment> {
        let known = partitions();
        let stripes = |edges: &[u32]| {
            let is_whole = edges.len() == self.common.len();
            is_whole.then(|| Stripes::from_edges(self.height, edges))
        };
        let mut assignment = Assignment::uniform(stripes(&self.common)?).with_primary(self.primary)?;
        for (name, eye, edges) in &self.own {
            let group = known.iter().find(|group| group.0 == name)?;
            assignment.set(*group, *eye, stripes(edges)?);
        }
        Some(assignment)
    }
}

/// Functions for `#[serde(with)]`.
pub mod assignment {
    use super::*;

    pub fn serialize<S: Serializer>(assignment: &Assignment, serializer: S) -> Result<S::Ok, S::Error> {
        AssignmentFields::from(assignment).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Assignment, D::Error> {
        let fields = AssignmentFields::deserialize(deserializer)?;
        fields.assignment().ok_or_else(|| D::Error::custom("invalid assignment of rows to devices"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejects_contradictory_assignments() {
        let fields = |primary, name: &str, eye, edges: Vec<u32>| {
            let own = vec![(name.to_owned(), eye, edges)];
            AssignmentFields { primary, height: 9, common: vec![4, 5], own }.assignment()
        };
        let right = Some(Eye::RIGHT);
        assert_eq!(fields(1, "path_trace", right, vec![0, 5]).map(|a| a.primary()), Some(1));
        assert_eq!(fields(3, "path_trace", right, vec![0, 5]), None);
        assert_eq!(fields(1, "path_trace", None, vec![0, 5, 6]), None);
        assert_eq!(fields(1, "no such group", None, vec![0, 5]), None);
    }
}
