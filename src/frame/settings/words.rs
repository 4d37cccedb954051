//! Settings whose values have names.

use super::value::{Value, Word};
use crate::device::{ShaderChecks, TraversalChoice};
use crate::frame::Sampler;
use crate::image::tone::ToneCurve;
use crate::passes::Aov;
use crate::projection::PolarSpace;
use crate::schedule::Balance;

/// Implements [`Value`] for types whose values have names, by a list of all values with their names and help texts.
macro_rules! words {
    ($($type:ty: $form:literal $(list $list:literal)?, $all:expr;)+) => {$(
        impl Value for $type {
            const FORM: &'static str = $form;

            $(const LIST_FORM: &'static str = $list;)?

            fn words() -> Vec<Word> {
                $all.into_iter().map(|(_, word, help)| (word, Some(help))).collect()
            }

            fn parse(text: &str) -> Result<Self, String> {
                let found = $all.into_iter().find(|(_, word, _)| *word == text);
                found.map(|(value, ..)| value).ok_or_else(|| one_of(&Self::words()))
            }

            fn text(&self) -> String {
                $all.into_iter().find(|(value, ..)| value == self).map_or("", |(_, word, _)| word).to_owned()
            }
        }
    )+};
}

/// Foveated rendering.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum FoveationMode {
    #[default]
    None,
    Layers,
    /// A polar projection; the setting `polar` may change its parameters.
    Polar(PolarSpace),
}

impl Value for FoveationMode {
    const FORM: &'static str = "MODE";

    fn words() -> Vec<Word> {
        let layers = "Three layers: fewer samples and more filtering away from the gaze";
        let polar = PolarSpace::ALL.iter().map(|space| (space.method().name(), Some(space.method().help())));
        [("none", Some("The same quality everywhere")), ("layers", Some(layers))].into_iter().chain(polar).collect()
    }

    fn parse(text: &str) -> Result<Self, String> {
        let polar = || PolarSpace::ALL.iter().find(|space| space.method().name() == text);
        match text {
            "none" => Ok(Self::None),
            "layers" => Ok(Self::Layers),
            _ => polar().map(|space| Self::Polar(*space)).ok_or_else(|| one_of(&Self::words())),
        }
    }

    fn text(&self) -> String {
        match self {
            Self::None => "none",
            Self::Layers => "layers",
            Self::Polar(space) => space.method().name(),
        }
        .to_owned()
    }
}

fn one_of(words: &[Word]) -> String {
    let words: Vec<&str> = words.iter().map(|word| word.0).collect();
    format!("not one of {}", words.join(", "))
}

/// Filtering across the stripes of devices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SeamMode {
    None,
    Filter,
    #[default]
    Halo,
}

/// Source of the rows that filters read around a stripe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HaloMode {
    #[default]
    Cost,
    Recompute,
    Exchange,
}

impl Value for bool {
    const FORM: &'static str = "on|off";

    fn words() -> Vec<Word> {
        vec![("on", None), ("off", None)]
    }

    /// Also reads the truth values of files and of Python.
    fn parse(text: &str) -> Result<Self, String> {
        match text {
            "on" | "true" => Ok(true),
            "off" | "false" => Ok(false),
            _ => Err(one_of(&Self::words())),
        }
    }

    fn text(&self) -> String {
        if *self { "on" } else { "off" }.to_owned()
    }
}

words! {
    Sampler: "sobol|pcg", [
        (Sampler::Sobol, "sobol", "Owen-scrambled Sobol'"),
        (Sampler::Pcg, "pcg", "Independent random numbers (PCG)"),
    ];
    SeamMode: "none|filter|halo", [
        (Self::None, "none", "Filter stripes separately"),
        (Self::Filter, "filter", "Filter stripes separately and smooth the seams"),
        (Self::Halo, "halo", "Filter across stripes: the same bytes as one device"),
    ];
    HaloMode: "cost|recompute|exchange", [
        (Self::Cost, "cost", "Choose the cheaper of recompute and exchange for each iteration"),
        (Self::Recompute, "recompute", "Receive a wide margin once and filter it redundantly"),
        (Self::Exchange, "exchange", "Receive a narrow margin before every iteration"),
    ];
    ToneCurve: "NAME", [
        (Self::Reinhard, "reinhard", "c / (1 + c) per channel (Reinhard et al. 2002, eq. 3)"),
        (Self::Neutral, "neutral", "Khronos PBR Neutral: base colours up to 0.8 stay as they are"),
        (Self::Agx, "agx", "AgX: filmic, and bright colours fade to white"),
        (Self::Aces, "aces", "ACES filmic: high contrast"),
        (Self::None, "none", "No curve; brighter colours are clipped"),
    ];
    TraversalChoice: "auto|compute|hardware", [
        (Self::Auto, "auto", "Hardware if every device is a GPU with ray queries, else compute"),
        (Self::Compute, "compute", "Compute shaders"),
        (Self::Hardware, "hardware", "Hardware ray queries"),
    ];
    ShaderChecks: "full|fast", [
        (Self::Full, "full", "All checks: bounds, loops, integer division"),
        (Self::Fast, "fast", "Bounds checks only"),
    ];
    Aov: "NAME", Self::ALL.iter().map(|aov| (*aov, aov.name(), aov.help()));
    Balance: "NAME" list "NAME", Self::all();
}
