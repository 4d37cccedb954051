//! How types of other modules stand in messages.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::graph::{Assignment, HaloPlan, Seam, Stage, Stripes};
use crate::scene::rig::Eye;
use crate::stages::Place;

/// [`Place`], field by field.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Place")]
pub struct PlaceFields {
    slot: usize,
    turn: usize,
}

/// Types that shaders share, byte by byte: text has no infinities.
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

/// [`Seam`]; of a halo plan, the passes before which rows are received, of the first 32.
#[derive(Serialize, Deserialize)]
pub enum SeamFields {
    None,
    Filter,
    Halo(u32),
}

impl SeamFields {
    pub fn serialize<S: Serializer>(seam: &Seam, serializer: S) -> Result<S::Ok, S::Error> {
        match seam {
            Seam::None => Self::None,
            Seam::Filter => Self::Filter,
            Seam::Halo(plan) => Self::Halo(receives(*plan)),
        }
        .serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Seam, D::Error> {
        Ok(match <Self as Deserialize>::deserialize(deserializer)? {
            Self::None => Seam::None,
            Self::Filter => Seam::Filter,
            Self::Halo(passes) => {
                let count = (u32::BITS - passes.leading_zeros()) as usize;
                let mut plans = [HaloPlan::EXCHANGE].into_iter().chain(HaloPlan::all(count.min(MOST_PASSES)));
                let plan = plans.find(|plan| receives(*plan) == passes);
                Seam::Halo(plan.ok_or_else(|| D::Error::custom("no such halo plan"))?)
            }
        })
    }
}

/// Passes of the longest filter whose plans are searched. The planner tries all plans of a frame too, so filters are
/// far shorter.
const MOST_PASSES: usize = 17;

fn receives(plan: HaloPlan) -> u32 {
    (0..32).filter(|pass| plan.receives_before(*pass)).map(|pass| 1 << pass).sum()
}

/// [`Assignment`]: the primary, the height, and the inner edges of each group of stages and eye.
#[derive(Serialize, Deserialize)]
struct AssignmentFields {
    primary: usize,
    height: u32,
    edges: Vec<Vec<u32>>,
}

fn groups() -> impl Iterator<Item = (Stage, Eye)> {
    Stage::RATIO_GROUPS.into_iter().flat_map(|stage| Eye::ALL.map(|eye| (stage, eye)))
}

impl From<&Assignment> for AssignmentFields {
    fn from(assignment: &Assignment) -> Self {
        let stripes = |(stage, eye)| assignment.stripes(stage, eye);
        Self {
            primary: assignment.primary(),
            height: groups().map(stripes).map(Stripes::height).max().unwrap_or(0),
            edges: groups().map(stripes).map(|s| s.inner_edges().to_vec()).collect(),
        }
    }
}

impl AssignmentFields {
    /// None: the fields contradict one another.
    fn assignment(&self) -> Option<Assignment> {
        let devices = self.edges.first()?.len() + 1;
        let are_even = self.edges.len() == groups().count() && self.edges.iter().all(|e| e.len() + 1 == devices);
        if self.primary >= devices || !are_even {
            return None;
        }
        // Devices before the primary have been taken out and have no rows.
        let stripes = |edges: &Vec<u32>| Stripes::from_edges(self.height, &edges[self.primary..]);
        let mut assignment = Assignment::uniform(stripes(&self.edges[0]));
        for ((stage, eye), edges) in groups().zip(&self.edges) {
            assignment.set(stage, eye, stripes(edges));
        }
        let left: Vec<usize> = (self.primary..devices).collect();
        Some(assignment.renumbered(&left, devices))
    }
}

/// For `#[serde(with)]`.
pub mod assignment {
    use super::*;

    pub fn serialize<S: Serializer>(assignment: &Assignment, serializer: S) -> Result<S::Ok, S::Error> {
        AssignmentFields::from(assignment).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Assignment, D::Error> {
        let fields = AssignmentFields::deserialize(deserializer)?;
        fields.assignment().ok_or_else(|| D::Error::custom("no such assignment"))
    }
}

/// The same for what was before a frame.
pub mod history {
    use super::*;

    pub fn serialize<S: Serializer>(history: &Option<(Assignment, u32)>, serializer: S) -> Result<S::Ok, S::Error> {
        history.as_ref().map(|(before, rows)| (AssignmentFields::from(before), *rows)).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<(Assignment, u32)>, D::Error> {
        let Some((fields, rows)) = Option::<(AssignmentFields, u32)>::deserialize(deserializer)? else {
            return Ok(None);
        };
        let before = fields.assignment().ok_or_else(|| D::Error::custom("no such assignment"))?;
        Ok(Some((before, rows)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradictions_are_refused() {
        let fields = |primary, devices: usize, edges: Vec<u32>| {
            let edges = vec![edges; groups().count() - 1].into_iter().chain([vec![4; devices - 1]]).collect();
            AssignmentFields { primary, height: 9, edges }.assignment()
        };
        assert_eq!(fields(1, 3, vec![0, 5]).map(|a| a.primary()), Some(1));
        assert_eq!(fields(3, 3, vec![0, 5]), None);
        assert_eq!(fields(1, 3, vec![0, 5, 6]), None);
        assert_eq!(AssignmentFields { primary: 0, height: 9, edges: vec![vec![4]] }.assignment(), None);
        for text in ["{\"Halo\":0}", "{\"Halo\":4294967294}", "\"Wall\""] {
            assert!(SeamFields::deserialize(&mut serde_json::Deserializer::from_str(text)).is_err(), "{text}");
        }
    }
}
