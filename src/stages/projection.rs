//! Projections of traced images, and the shader includes that implement them.

use crate::quality::PolarSpace;

/// The projection of traced images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum TracedProjection {
    #[default]
    Perspective,
    VisualPolar,
    LogPolar,
}

impl TracedProjection {
    pub const ALL: [Self; 3] = [Self::Perspective, Self::VisualPolar, Self::LogPolar];

    /// Returns the names, without `.inc.wgsl`, of the files that replace the include `projection`. The last name is
    /// different for each projection.
    pub(super) fn includes(self) -> &'static [&'static str] {
        match self {
            Self::Perspective => &["grid_perspective"],
            Self::VisualPolar => &["grid_polar", "grid_visual_polar"],
            Self::LogPolar => &["grid_polar", "grid_log_polar"],
        }
    }
}

impl From<Option<PolarSpace>> for TracedProjection {
    fn from(polar: Option<PolarSpace>) -> Self {
        match polar {
            None => Self::Perspective,
            Some(PolarSpace::Visual) => Self::VisualPolar,
            Some(PolarSpace::Log(_)) => Self::LogPolar,
        }
    }
}
