//! The denoisers that frames can have, and their names in files and on the command line.

use std::fmt;
use std::sync::{PoisonError, RwLock};

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

use super::method::{Denoise, MAX_ITERATIONS};
use super::{atrous, bmfr, svgf};

/// The library's denoisers. A new one needs a module with its passes and a line here.
const BUILT_IN: [&dyn Denoise; 4] = [&atrous::Atrous, &svgf::Svgf, &bmfr::Bmfr::DROPPING, &bmfr::Bmfr::NOISY];

/// The denoisers that the program has registered.
static REGISTERED: RwLock<Vec<&'static dyn Denoise>> = RwLock::new(Vec::new());

/// A method that removes path tracing noise from a frame. If a frame may have none, the type is an [`Option`] of this.
#[derive(Clone, Copy)]
pub struct Denoiser(&'static dyn Denoise);

impl Denoiser {
    /// An à-trous filter on the frame alone.
    pub const ATROUS: Self = Self(&atrous::Atrous);
    /// An à-trous filter on temporally accumulated illumination, guided by its variance.
    pub const SVGF: Self = Self(&svgf::Svgf);
    /// Blockwise regression (BMFR): fits radiance accumulated over frames to features of surfaces.
    pub const BMFR: Self = Self(&bmfr::Bmfr::DROPPING);
    /// BMFR with noise on the features where [`Self::BMFR`] drops dependent ones, for comparison.
    pub const BMFR_NOISE: Self = Self(&bmfr::Bmfr::NOISY);
    /// Default number of iterations.
    pub const DEFAULT_ITERATIONS: u32 = 5;
    /// Maximum number of iterations.
    pub const MAX_ITERATIONS: u32 = MAX_ITERATIONS;

    /// Adds a denoiser to those that [`Self::from_name`] finds. With several ranks, each must register the same.
    ///
    /// # Errors
    /// A message if the name is taken or is `none`.
    pub fn register(method: &'static dyn Denoise) -> Result<Self, String> {
        if Self::from_name(method.name()).is_ok() {
            return Err(format!("there is a denoiser {} already", method.name()));
        }
        REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(method);
        Ok(Self(method))
    }

    /// Returns all choices: no denoiser, then each denoiser.
    pub fn choices() -> Vec<Option<Self>> {
        let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
        let all = BUILT_IN.into_iter().chain(registered.iter().copied());
        std::iter::once(None).chain(all.map(|method| Some(Self(method)))).collect()
    }

    /// Returns the choice with this name.
    ///
    /// # Errors
    /// A message that lists all names.
    pub fn from_name(name: &str) -> Result<Option<Self>, String> {
        let choices = Self::choices();
        let choice = choices.iter().find(|choice| Self::name_of(**choice) == name).copied();
        choice.ok_or_else(|| {
            let names: Vec<&str> = choices.into_iter().map(Self::name_of).collect();
            format!("the denoiser {name:?} is unknown: it is {}", names.join(", "))
        })
    }

    /// Returns the name of a choice in files and on the command line.
    pub fn name_of(choice: Option<Self>) -> &'static str {
        choice.map_or("none", |denoiser| denoiser.0.name())
    }

    /// Returns true if frames build on a history of previous ones.
    pub fn keeps_history(self) -> bool {
        self.0.keeps_history()
    }

    /// Returns the maximum number of iterations of this denoiser.
    pub fn most_iterations(self) -> u32 {
        self.0.most_iterations()
    }

    /// Returns the implementation: its properties and passes.
    pub fn method(self) -> &'static dyn Denoise {
        self.0
    }
}

impl fmt::Debug for Denoiser {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.name())
    }
}

impl PartialEq for Denoiser {
    fn eq(&self, other: &Self) -> bool {
        self.0.name() == other.0.name()
    }
}

impl Eq for Denoiser {}

impl Serialize for Denoiser {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.name())
    }
}

impl<'de> Deserialize<'de> for Denoiser {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let choice = Self::from_name(&name).map_err(D::Error::custom)?;
        choice.ok_or_else(|| D::Error::custom("the name of a denoiser is expected, not none"))
    }
}

/// Serializes a choice by its name.
///
/// # Errors
/// Errors of the serializer.
pub fn serialize<S: Serializer>(choice: &Option<Denoiser>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(Denoiser::name_of(*choice))
}

/// Deserializes a choice from its name.
///
/// # Errors
/// Errors of the deserializer, and unknown names.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Denoiser>, D::Error> {
    Denoiser::from_name(&String::deserialize(deserializer)?).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_denoiser_has_one_name_everywhere() {
        for choice in Denoiser::choices() {
            let name = Denoiser::name_of(choice);
            assert_eq!(Denoiser::from_name(name).unwrap(), choice);
            assert!(choice.is_none_or(|denoiser| (1..=Denoiser::MAX_ITERATIONS).contains(&denoiser.most_iterations())));
            assert!(choice.is_none_or(|denoiser| serde_json::to_value(denoiser).unwrap() == name));
        }
    }

    #[test]
    fn no_two_denoisers_have_the_same_name() {
        struct Second;
        impl Denoise for Second {
            fn name(&self) -> &'static str {
                "svgf"
            }

            fn help(&self) -> Option<&'static str> {
                None
            }
        }
        assert!(Denoiser::register(&Second).unwrap_err().contains("svgf"));
        assert_eq!(Denoiser::choices().len(), 1 + BUILT_IN.len());
    }
}
