//! The denoisers, and the names that files and the command line have for them.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error};

/// A method that removes the noise of path tracing from a frame. Where a frame may have none, it is an [`Option`] of
/// this.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Denoiser {
    /// An à-trous filter on the frame alone.
    Atrous,
    /// An à-trous filter on what is accumulated over frames, guided by its variance.
    Svgf,
    /// What is accumulated over frames, fitted in blocks to features of surfaces.
    Bmfr,
    /// The same with noise on the features where `Bmfr` leaves out dependent ones, to compare it with.
    BmfrNoise,
}

impl Denoiser {
    /// No denoiser, and each denoiser.
    pub const CHOICES: [Option<Self>; 5] =
        [None, Some(Self::Atrous), Some(Self::Svgf), Some(Self::Bmfr), Some(Self::BmfrNoise)];
    /// The number of iterations unless another one is asked for.
    pub const DEFAULT_ITERATIONS: u32 = 5;
    /// The most iterations that can be asked for.
    pub const MAX_ITERATIONS: u32 = 10;

    /// Whether frames build on those before them.
    pub const fn keeps_history(self) -> bool {
        matches!(self, Self::Svgf | Self::Bmfr | Self::BmfrNoise)
    }

    /// The most iterations that a frame of this denoiser can have. A fit is one.
    pub const fn most_iterations(self) -> u32 {
        match self {
            Self::Atrous | Self::Svgf => Self::MAX_ITERATIONS,
            Self::Bmfr | Self::BmfrNoise => 1,
        }
    }

    /// The name of a choice in files and on the command line.
    pub const fn name_of(choice: Option<Self>) -> &'static str {
        match choice {
            None => "none",
            Some(Self::Atrous) => "atrous",
            Some(Self::Svgf) => "svgf",
            Some(Self::Bmfr) => "bmfr",
            Some(Self::BmfrNoise) => "bmfr_noise",
        }
    }

    /// The choice with this name.
    ///
    /// # Errors
    /// A text that names no choice.
    pub fn from_name(name: &str) -> Result<Option<Self>, String> {
        let choice = Self::CHOICES.into_iter().find(|choice| Self::name_of(*choice) == name);
        choice.ok_or_else(|| {
            format!("the denoiser {name:?} is unknown: it is {}", Self::CHOICES.map(Self::name_of).join(", "))
        })
    }

    /// Parses an option's value to a choice. The help lists all of them.
    pub fn value_parser() -> impl TypedValueParser<Value = Option<Self>> {
        let value = |choice| {
            let value = PossibleValue::new(Self::name_of(choice));
            match choice {
                None => value,
                Some(Self::Atrous) => value.help("On each frame alone"),
                Some(Self::Svgf) => value.help("Over frames, guided by variance"),
                Some(Self::Bmfr) => value.help("Over frames, fitted to features of surfaces in blocks"),
                Some(Self::BmfrNoise) => value.hide(true),
            }
        };
        PossibleValuesParser::new(Self::CHOICES.map(value)).try_map(|name| Self::from_name(&name))
    }
}

pub(super) fn serialize<S: Serializer>(choice: &Option<Denoiser>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(Denoiser::name_of(*choice))
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Denoiser>, D::Error> {
    Denoiser::from_name(&String::deserialize(deserializer)?).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_denoiser_has_one_name_everywhere() {
        for choice in Denoiser::CHOICES {
            let name = Denoiser::name_of(choice);
            assert_eq!(Denoiser::from_name(name).unwrap(), choice);
            assert!(choice.is_none_or(|denoiser| (1..=Denoiser::MAX_ITERATIONS).contains(&denoiser.most_iterations())));
            assert!(choice.is_none_or(|denoiser| serde_json::to_value(denoiser).unwrap() == name));
        }
    }
}
