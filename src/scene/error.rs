//! Errors of scenes and shots.

use std::fmt;

use super::budget::Exceeded;
use crate::image::ImageError;

/// Errors of scenes and shots. Each variant names the thing to check.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    #[error("cannot read '{path}'")]
    Read { path: String, source: std::io::Error },
    #[error("'{path}' is not valid: {what}")]
    Invalid { path: String, what: String },
    /// Access that an untrusted file requested and that was denied. `place` is the location of the request in that
    /// file, followed by `: `, or is empty.
    #[error("'{path}' is refused: {place}{refusal}")]
    Refused { path: String, place: String, refusal: Refusal },
    /// An override of the shot's settings that does not fit the scene.
    #[error("{setting} is not valid: {what}")]
    Setting { setting: Setting, what: String },
    #[error("'{path}' requires {}, which diptych cannot read{hint}", extensions.join(", "))]
    Extensions { path: String, extensions: Vec<String>, hint: String },
    #[error("there is no built-in scene '{name}': choose one of {known}")]
    UnknownBuiltin { name: String, known: String },
    #[error(transparent)]
    Image(#[from] ImageError),
}

impl SceneError {
    /// Returns [`Self::Refused`] for a request that has no particular location in the file.
    pub(super) fn refused(path: &str, refusal: impl Into<Refusal>) -> Self {
        Self::Refused { path: path.to_owned(), place: String::new(), refusal: refusal.into() }
    }
}

/// Reasons to deny access that an untrusted file asks for.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Path that is not below the folder of the file that refers to it.
    #[error("it names '{0}', which is not below its own folder: allow files outside the folder if you trust it")]
    Outside(String),
    #[error(transparent)]
    Memory(#[from] Exceeded),
}

/// Setting of [`Overrides`](super::complete::Overrides) that an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Setting {
    Baseline,
    /// Camera with this index in the scene file.
    Camera(usize),
    /// View from the position to the target.
    View,
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Baseline => f.write_str("the baseline"),
            Self::Camera(number) => write!(f, "camera {number}"),
            Self::View => f.write_str("the view"),
        }
    }
}
