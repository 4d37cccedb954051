//! Errors of scenes and shots.

use std::fmt;
use std::path::Path;

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

/// A [`SceneError`] without the file's name.
#[derive(Debug)]
pub enum Fault {
    Invalid(String),
    /// A request that is not allowed or exceeds the budget. `place` is its location in the file, followed by `: `, or
    /// is empty.
    Refused {
        place: String,
        refusal: Refusal,
    },
    Read {
        path: String,
        source: std::io::Error,
    },
    Extensions {
        extensions: Vec<String>,
        hint: String,
    },
}

impl Fault {
    /// Converts to a [`SceneError`]. `path` is the faulty file, or the one that made the request; a read error names
    /// the file that could not be read.
    pub fn in_file(self, path: impl AsRef<Path>) -> SceneError {
        let file = path.as_ref().display().to_string();
        match self {
            Fault::Invalid(what) => SceneError::Invalid { path: file, what },
            Fault::Refused { place, refusal } => SceneError::Refused { path: file, place, refusal },
            Fault::Read { path, source } => SceneError::Read { path, source },
            Fault::Extensions { extensions, hint } => SceneError::Extensions { path: file, extensions, hint },
        }
    }
}

impl From<Exceeded> for Fault {
    fn from(error: Exceeded) -> Self {
        Refusal::from(error).into()
    }
}

impl From<Refusal> for Fault {
    fn from(refusal: Refusal) -> Self {
        Fault::Refused { place: String::new(), refusal }
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
