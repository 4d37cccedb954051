//! Polar projections, whose images are traced and filtered instead of the screen's and mapped to the screen at the end.
//! Rows are rings around the gaze, columns are directions from it.
//!
//! [`PolarSpace`] is the registry. A new projection needs an include in `shaders/shared`, a file in this folder that
//! implements [`Project`], and its lines in this file.

pub mod acuity;
mod log_polar;
mod method;
mod polar;
mod view;
mod visual_polar;

use std::fmt::{self, Display};

use serde::{Deserialize, Serialize};

use visual_polar::VisualPolar;

pub use log_polar::{LogPolar, LogPolarMap};
pub(crate) use method::within;
pub use method::{OutOfRange, PolarPoint, Project};
pub use view::{View, structs};

/// Projections whose pixels are arranged around the gaze. Files contain the names of the variants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum PolarSpace {
    /// Visual-polar: density follows visual acuity (Koskela et al. 2019).
    Visual,
    /// Log-polar: rings grow with their distance from the gaze (Andersson & Hansson 2020).
    Log(LogPolar),
}

impl PolarSpace {
    /// All projections, with their default parameters.
    pub const ALL: &[Self] = &[Self::Visual, Self::Log(LogPolar::COMPOSITE)];

    /// Returns the implementation.
    pub fn method(&self) -> &dyn Project {
        match self {
            Self::Visual => &VisualPolar,
            Self::Log(map) => map,
        }
    }
}

impl Display for PolarSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.method().label())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polar_space_json_is_stable() {
        let space = PolarSpace::Log(LogPolar::COMPOSITE);
        let text = r#"{"log":{"sigma":1.4,"alpha":1.0,"gaze":0.2,"aspect":0.33,"blur":true}}"#;
        assert_eq!(serde_json::to_string(&space).unwrap(), text);
        assert_eq!(serde_json::from_str::<PolarSpace>(text).unwrap(), space);
        assert_eq!(serde_json::from_str::<PolarSpace>(&text.replace(r#","blur":true"#, "")).unwrap(), space);
        assert_eq!(serde_json::to_string(&PolarSpace::Visual).unwrap(), "\"visual\"");
    }

    #[test]
    fn projections_have_distinct_names_and_includes() {
        let all = || PolarSpace::ALL.iter().map(PolarSpace::method);
        for mut names in
            [all().map(|space| space.name()).collect::<Vec<_>>(), all().map(|space| space.include()).collect()]
        {
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), PolarSpace::ALL.len(), "{names:?}");
        }
    }
}
