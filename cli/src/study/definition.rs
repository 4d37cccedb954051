//! What a study is.

use super::arrangement::Arrangement;
use super::columns::{Column, FOVEA, RINGS};

/// A study: arrangements of settings that render the same frames in turns.
pub struct Study {
    pub name: &'static str,
    pub title: &'static str,
    /// Heading and caption of each printed table.
    pub tables: &'static [[&'static str; 2]],
    /// Source of the published numbers.
    pub source: &'static str,
    /// Conditions of the publication that differ here, and what a repeat needs.
    pub unlike: &'static [[&'static str; 2]],
    /// Shots, and the scenes of the publication in place of which they are measured.
    pub shots: &'static [[&'static str; 2]],
    /// Published sizes of an eye's image.
    pub sizes: &'static [Size],
    /// Default row of views; `None` for two eyes.
    pub views: Option<ViewRow>,
    pub cameras: &'static [Camera],
    /// Published number of frames along the path, or of instants on it.
    pub frames: u32,
    /// True if the gaze is in the middle of the screen instead of where the shot has it.
    pub gazes_ahead: bool,
    pub arrangements: &'static [Arrangement],
    pub columns: &'static [Column],
}

/// Motion of the camera before and in the compared frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Camera {
    /// The camera moves along its path during the warm-up, and rests in the compared frames.
    Approaching,
    /// The camera rests all the time.
    Still,
    /// The camera moves along its path to several instants, and the frame at each instant is compared.
    Moving,
    /// The camera rests at several instants of its path in turn.
    Stepping,
    /// The camera follows its path, and every frame is timed. There is no reference.
    Following,
}

impl Camera {
    pub fn name(self) -> &'static str {
        match self {
            Self::Approaching => "approaching",
            Self::Still => "still",
            Self::Moving => "moving",
            Self::Stepping => "stepping",
            Self::Following => "following",
        }
    }
}

impl Study {
    fn has_any(&self, measures: &[&str]) -> bool {
        self.columns.iter().any(|column| measures.contains(&column.name))
    }

    /// Returns true if errors near the gaze are also measured while the gaze moves.
    pub fn moves_gaze(&self) -> bool {
        self.has_any(&FOVEA)
    }

    /// Returns true if errors are measured by rings around the gaze.
    pub fn has_rings(&self) -> bool {
        self.has_any(&RINGS)
    }
}

/// A row of views.
pub struct ViewRow {
    pub count: u32,
    pub baseline_m: f64,
}

/// A published size of an eye's image, in pixels.
pub struct Size {
    pub name: &'static str,
    pub width: u32,
    pub height: u32,
    /// Outer radii of the inner and the middle foveal layer, if the study has layers.
    pub layer_radii_px: Option<[f64; 2]>,
}
