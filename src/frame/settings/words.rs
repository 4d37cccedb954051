//! Settings whose values have names.

use super::value::{Value, Word};
use crate::device::{ShaderChecks, TraversalChoice};
use crate::frame::Sampler;
use crate::image::tone::ToneCurve;
use crate::passes::Aov;
use crate::projection::PolarSpace;
use crate::schedule::Balance;

/// Implements [`Value`] for types whose values have names.
macro_rules! words {
    ($($type:ty: $form:literal; $($word:literal $value:expr, $help:expr;)+)+) => {$(
        impl Value for $type {
            const FORM: &'static str = $form;

            fn words() -> Vec<Word> {
                vec![$(($word, $help)),+]
            }

            fn parse(text: &str) -> Result<Self, String> {
                match text {
                    $($word => Ok($value),)+
                    _ => Err(one_of(&Self::words())),
                }
            }

            fn text(&self) -> String {
                let all = [$(($word, $value)),+];
                all.iter().find(|(_, value)| value == self).map_or("", |(word, _)| *word).to_owned()
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

impl Value for Aov {
    const FORM: &'static str = "NAME";

    fn words() -> Vec<Word> {
        Self::ALL.iter().map(|aov| (aov.name(), Some(aov.help()))).collect()
    }

    fn parse(text: &str) -> Result<Self, String> {
        Self::ALL.iter().copied().find(|aov| aov.name() == text).ok_or_else(|| one_of(&Self::words()))
    }

    fn text(&self) -> String {
        self.name().to_owned()
    }
}

impl Value for Balance {
    const FORM: &'static str = "NAME";

    const LIST_FORM: &'static str = "NAME";

    fn words() -> Vec<Word> {
        Self::all().into_iter().map(|(_, name, help)| (name, Some(help))).collect()
    }

    fn parse(text: &str) -> Result<Self, String> {
        Self::from_name(text).ok_or_else(|| one_of(&Self::words()))
    }

    fn text(&self) -> String {
        self.name().to_owned()
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
    Sampler: "sobol|pcg";
        "sobol" Sampler::Sobol, Some("Owen-scrambled Sobol'");
        "pcg" Sampler::Pcg, Some("Independent random numbers (PCG)");
    SeamMode: "none|filter|halo";
        "none" Self::None, Some("Filter stripes separately");
        "filter" Self::Filter, Some("Filter stripes separately and smooth the seams");
        "halo" Self::Halo, Some("Filter across stripes: the same bytes as one device");
    HaloMode: "cost|recompute|exchange";
        "cost" Self::Cost, Some("Choose the cheaper of recompute and exchange for each iteration");
        "recompute" Self::Recompute, Some("Receive a wide margin once and filter it redundantly");
        "exchange" Self::Exchange, Some("Receive a narrow margin before every iteration");
    ToneCurve: "NAME";
        "reinhard" Self::Reinhard, Some("c / (1 + c) per channel (Reinhard et al. 2002, eq. 3)");
        "neutral" Self::Neutral, Some("Khronos PBR Neutral: base colours up to 0.8 stay as they are");
        "agx" Self::Agx, Some("AgX: filmic, and bright colours fade to white");
        "aces" Self::Aces, Some("ACES filmic: high contrast");
        "none" Self::None, Some("No curve; brighter colours are clipped");
    TraversalChoice: "auto|compute|hardware";
        "auto" Self::Auto, Some("Hardware if every device is a GPU with ray queries, else compute");
        "compute" Self::Compute, Some("Compute shaders");
        "hardware" Self::Hardware, Some("Hardware ray queries");
    ShaderChecks: "full|fast";
        "full" Self::Full, Some("All checks: bounds, loops, integer division");
        "fast" Self::Fast, Some("Bounds checks only");
}
