//! The denoisers, and the names that files and the command line have for them.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

/// What takes the noise of path tracing out of a frame. Where a frame may have none, it is an [`Option`] of this.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Denoiser {
    /// An à-trous filter on the frame alone.
    Atrous,
    /// An à-trous filter on what is accumulated over frames, guided by its variance.
    Svgf,
}

/// The name where there is no denoiser.
const NONE: &str = "none";

impl Denoiser {
    /// No denoiser, and each of them.
    pub const CHOICES: [Option<Self>; 3] = [None, Some(Self::Atrous), Some(Self::Svgf)];
    /// Iterations unless another number is asked for.
    pub const DEFAULT_ITERATIONS: u32 = 5;
    /// The most iterations that can be asked for.
    pub const MAX_ITERATIONS: u32 = 10;

    /// Its name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Atrous => "atrous",
            Self::Svgf => "svgf",
        }
    }

    /// The name of a choice: `none` without a denoiser.
    pub fn name_of(choice: Option<Self>) -> &'static str {
        choice.map_or(NONE, Self::name)
    }

    /// The choice with this name.
    ///
    /// # Errors
    /// [`UnknownDenoiser`] for any other text.
    pub fn from_name(name: &str) -> Result<Option<Self>, UnknownDenoiser> {
        let choice = Self::CHOICES.into_iter().find(|choice| Self::name_of(*choice) == name);
        choice.ok_or_else(|| UnknownDenoiser(name.to_owned()))
    }

    /// Parses an option's value to a choice. The help lists all of them.
    pub fn value_parser() -> impl TypedValueParser<Value = Option<Self>> {
        let value = |choice: Option<Self>| {
            let value = PossibleValue::new(Self::name_of(choice));
            match choice {
                None => value,
                Some(Self::Atrous) => value.help("On each frame alone"),
                Some(Self::Svgf) => value.help("Over frames, guided by variance"),
            }
        };
        PossibleValuesParser::new(Self::CHOICES.map(value)).try_map(|name| Self::from_name(&name))
    }
}

impl std::fmt::Display for Denoiser {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(self.name())
    }
}

/// A name that no denoiser has.
#[derive(Debug, thiserror::Error)]
#[error("the denoiser {0:?} is unknown: there are none, atrous and svgf")]
pub struct UnknownDenoiser(String);

/// A choice of denoiser as serde writes and reads it: by its name, `none` without one.
pub mod or_none {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};

    use super::Denoiser;

    /// Writes the name of a choice.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(choice: &Option<Denoiser>, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(Denoiser::name_of(*choice))
    }

    /// Reads the name of a choice.
    ///
    /// # Errors
    /// Those of the deserializer, and one for a name that no denoiser has.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Denoiser>, D::Error> {
        Denoiser::from_name(&String::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_denoiser_has_one_name_everywhere() {
        for choice in Denoiser::CHOICES {
            assert_eq!(Denoiser::from_name(Denoiser::name_of(choice)).unwrap(), choice);
            let name = or_none::serialize(&choice, serde_json::value::Serializer).unwrap();
            assert_eq!(name, Denoiser::name_of(choice));
            assert_eq!(or_none::deserialize(name).unwrap(), choice);
            if let Some(denoiser) = choice {
                assert_eq!(serde_json::to_value(denoiser).unwrap(), denoiser.name());
            }
        }
        assert!(Denoiser::from_name("magic").unwrap_err().to_string().contains("magic"));
    }
}
