//! The text of settings' values, which flags, files and Python share.

use std::path::PathBuf;
use std::str::FromStr;

use glam::{DVec3, Vec3};
use serde_json::Value as Json;

use crate::control::ControllerKind;
use crate::device::{ShaderChecks, TraversalChoice};
use crate::frame::Sampler;
use crate::image::Extent;
use crate::image::tone::ToneCurve;
use crate::projection::{LogPolar, PolarSpace};
use crate::quality::Denoiser;
use crate::samples::Samples;
use crate::scene::budget::ByteSize;
use crate::scene::motion::play::Choice;
use crate::scene::shot::allowed::{ANY, Allowed, NOT_NEGATIVE, STOPS};
use crate::scene::shot::{Exposure, ShotEnvironment, Sky};
use crate::scene::viewpoint::Orbit;

/// A word that a setting may have, with its meaning. Help leaves out words without one.
pub type Word = (&'static str, Option<&'static str>);

/// A type of settings.
pub trait Value: Sized {
    /// The text of no value.
    const NONE: &'static str = "auto";

    /// Returns the form of the text, such as `N`.
    fn form() -> String;

    /// Returns all possible texts, unless they are numbers.
    fn words() -> Vec<Word> {
        Vec::new()
    }

    /// Reads a value from its text.
    fn parse(text: &str) -> Result<Self, String>;

    /// Returns the value's text, which [`Self::parse`] reads.
    fn text(&self) -> String;
}

/// Returns the text of a value in a file or a keyword: items of a list have commas between them, and truth is `on`.
///
/// # Errors
/// A message if the value is a table or nothing.
pub fn text_of(value: &Json) -> Result<String, String> {
    match value {
        Json::String(text) => Ok(text.clone()),
        Json::Bool(is_on) => Ok(is_on.text()),
        Json::Number(number) => Ok(number.to_string()),
        Json::Array(items) => Ok(items.iter().map(text_of).collect::<Result<Vec<_>, _>>()?.join(",")),
        Json::Object(_) | Json::Null => Err("give a text, a number, a truth value or a list of them".to_owned()),
    }
}

/// Returns a text as a number if it is one, and as a list if it has commas.
pub(super) fn json_of(text: &str) -> Json {
    if text.contains(',') {
        return text.split(',').map(json_of).collect();
    }
    let whole = text.parse::<i64>().ok().map(Json::from);
    whole.or_else(|| text.parse().ok().filter(|n: &f64| n.is_finite()).map(Json::from)).unwrap_or_else(|| text.into())
}

impl<T: Value> Value for Option<T> {
    fn form() -> String {
        T::form()
    }

    fn words() -> Vec<Word> {
        let words = T::words();
        if words.is_empty() { words } else { words.into_iter().chain([(T::NONE, None)]).collect() }
    }

    fn parse(text: &str) -> Result<Self, String> {
        if text == T::NONE { Ok(None) } else { T::parse(text).map(Some) }
    }

    fn text(&self) -> String {
        self.as_ref().map_or(T::NONE.to_owned(), T::text)
    }
}

/// Implements [`Value`] for types that have a text already.
macro_rules! texts {
    ($($type:ty: $form:literal, $else:literal;)+) => {$(
        impl Value for $type {
            fn form() -> String {
                $form.to_owned()
            }

            fn parse(text: &str) -> Result<Self, String> {
                text.trim().parse().map_err(|_| $else.to_owned())
            }

            fn text(&self) -> String {
                self.to_string()
            }
        }
    )+};
}

texts! {
    u32: "N", "not a whole number from 0 to 4294967295";
    f32: "V", "not a number";
    f64: "V", "not a number";
    String: "NAME", "not a text";
    ByteSize: "SIZE", "not a size, such as 4GiB";
    Extent: "WxH", "not a size, such as 640x360, of at least 1 and at most 16384 pixels a side";
}

fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

/// Returns three numbers of the allowed range.
fn triple(text: &str, allowed: &Allowed) -> Option<DVec3> {
    let numbers = numbers::<f64>(text).filter(|numbers| numbers.iter().all(|number| allowed.allows(*number)));
    numbers.and_then(|numbers| Some(DVec3::from(<[f64; 3]>::try_from(numbers).ok()?)))
}

impl Value for DVec3 {
    fn form() -> String {
        "X,Y,Z".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        triple(text, &ANY).ok_or_else(|| "not three numbers, such as 0,1.6,-2.5".to_owned())
    }

    fn text(&self) -> String {
        format!("{},{},{}", self.x, self.y, self.z)
    }
}

/// Points of the left and the right eye, as fractions of the image from the top left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyePoints(pub [[f64; 2]; 2]);

impl Value for EyePoints {
    fn form() -> String {
        "X,Y".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        let numbers = numbers::<f64>(text).filter(|all| all.iter().all(|n| (0.0..=1.0).contains(n)));
        match numbers.as_deref() {
            Some(&[x, y]) => Ok(Self([[x, y]; 2])),
            Some(&[lx, ly, rx, ry]) => Ok(Self([[lx, ly], [rx, ry]])),
            _ => Err("neither two nor four numbers from 0 to 1".to_owned()),
        }
    }

    fn text(&self) -> String {
        let [[lx, ly], [rx, ry]] = self.0;
        if [lx, ly] == [rx, ry] { format!("{lx},{ly}") } else { format!("{lx},{ly},{rx},{ry}") }
    }
}

impl<T: FromStr + ToString> Value for Vec<T> {
    fn form() -> String {
        "N,N,…".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        if text.is_empty() {
            return Ok(Self::new());
        }
        numbers(text).ok_or_else(|| "not a list of numbers".to_owned())
    }

    fn text(&self) -> String {
        self.iter().map(ToString::to_string).collect::<Vec<_>>().join(",")
    }
}

impl Value for ControllerKind {
    fn form() -> String {
        "NAME".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        text.parse()
    }

    fn text(&self) -> String {
        self.to_string()
    }
}

impl Value for Exposure {
    // Exposure by the shot is nothing that a user would give.
    const NONE: &'static str = "shot";

    fn form() -> String {
        "EV|auto".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let ev = text.trim().parse().ok().filter(|ev| STOPS.allows(*ev));
        ev.map(|ev| Self::Ev(ev as f32)).ok_or_else(|| format!("neither {}, nor auto", STOPS.what))
    }

    fn text(&self) -> String {
        match self {
            Self::Auto => "auto".to_owned(),
            Self::Ev(ev) => ev.to_string(),
        }
    }
}

impl Value for Orbit {
    fn form() -> String {
        "VIEW".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        if let Some((_, orbit)) = Self::NAMED.iter().find(|(name, _)| *name == text) {
            return Ok(*orbit);
        }
        let (azimuth_deg, elevation_deg, zoom) = match numbers(text).as_deref() {
            Some(&[azimuth, elevation]) => (azimuth, elevation, 1.0),
            Some(&[azimuth, elevation, zoom]) => (azimuth, elevation, zoom),
            _ => (f32::NAN, 0.0, 1.0),
        };
        let is_valid =
            azimuth_deg.is_finite() && (-90.0..=90.0).contains(&elevation_deg) && (0.01..=100.0).contains(&zoom);
        let what = "neither front, three-quarter or top, nor azimuth, elevation (-90 to 90) and zoom (0.01 to 100), such \
                    as 30,20,1";
        if is_valid { Ok(Self { azimuth_deg, elevation_deg, zoom }) } else { Err(what.to_owned()) }
    }

    fn text(&self) -> String {
        let named = Self::NAMED.iter().find(|(_, orbit)| orbit == self);
        let Self { azimuth_deg, elevation_deg, zoom } = self;
        named.map_or_else(|| format!("{azimuth_deg},{elevation_deg},{zoom}"), |(name, _)| (*name).to_owned())
    }
}

impl Value for ShotEnvironment {
    fn form() -> String {
        "NAME|FILE|R,G,B".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        let lower = text.to_ascii_lowercase();
        let sky = match triple(text, &NOT_NEGATIVE) {
            Some(radiance) => Some(Sky::Constant(radiance.as_vec3())),
            None if lower.ends_with(".hdr") || lower.ends_with(".exr") => Some(Sky::Image(text.to_owned())),
            None if lower == "white" => Some(Sky::Constant(Vec3::ONE)),
            None => Sky::built_in(&lower),
        };
        let what = "neither studio, white or sky, nor an .hdr or .exr file, nor three radiances ≥ 0, such as 1,1,1";
        sky.map(Into::into).ok_or_else(|| what.to_owned())
    }

    fn text(&self) -> String {
        match &self.sky {
            Sky::Constant(radiance) => radiance.as_dvec3().text(),
            Sky::Image(file) => file.clone(),
            Sky::Studio => "studio".to_owned(),
            Sky::Clear => "sky".to_owned(),
        }
    }
}

impl Value for Choice {
    fn form() -> String {
        "NAME".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        Ok(Self::of(text))
    }

    fn text(&self) -> String {
        Self::text(self).to_owned()
    }
}

impl Value for PathBuf {
    fn form() -> String {
        "DIR|off".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        Ok(text.into())
    }

    fn text(&self) -> String {
        self.display().to_string()
    }
}

impl Value for Samples {
    fn form() -> String {
        "N".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        text.parse()
    }

    fn text(&self) -> String {
        self.mean().to_string()
    }
}

impl Value for [u32; 3] {
    fn form() -> String {
        "M[,N,P]".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        match numbers(text).as_deref() {
            Some(&[all]) => Ok([all; 3]),
            Some(&[inner, middle, outer]) => Ok([inner, middle, outer]),
            _ => Err("neither one nor three whole numbers".to_owned()),
        }
    }

    fn text(&self) -> String {
        let [inner, middle, outer] = self;
        if inner == middle && middle == outer { inner.to_string() } else { format!("{inner},{middle},{outer}") }
    }
}

impl Value for LogPolar {
    fn form() -> String {
        "MODE".to_owned()
    }

    fn parse(text: &str) -> Result<Self, String> {
        text.parse()
    }

    fn text(&self) -> String {
        let preset = Self::PRESETS.iter().find(|(_, preset)| preset == self);
        preset.map_or_else(|| self.to_string(), |(name, _)| (*name).to_owned())
    }
}

impl Value for Denoiser {
    const NONE: &'static str = "none";

    fn form() -> String {
        "NAME".to_owned()
    }

    fn words() -> Vec<Word> {
        let all = Self::choices().into_iter().flatten();
        all.map(|denoiser| (Self::name_of(Some(denoiser)), denoiser.method().help())).collect()
    }

    fn parse(text: &str) -> Result<Self, String> {
        Self::from_name(text)?.ok_or_else(|| "no denoiser".to_owned())
    }

    fn text(&self) -> String {
        Self::name_of(Some(*self)).to_owned()
    }
}

/// Implements [`Value`] for types whose values have names.
macro_rules! words {
    ($($type:ty: $($word:literal $value:expr, $help:expr;)+)+) => {$(
        impl Value for $type {
            fn form() -> String {
                [$($word),+].join("|")
            }

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
    fn form() -> String {
        "MODE".to_owned()
    }

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

words! {
    bool:
        "on" true, None;
        "off" false, None;
    Sampler:
        "sobol" Sampler::Sobol, Some("Owen-scrambled Sobol'");
        "pcg" Sampler::Pcg, Some("Independent random numbers (PCG)");
    SeamMode:
        "none" Self::None, Some("Filter stripes separately");
        "filter" Self::Filter, Some("Filter stripes separately and smooth the seams");
        "halo" Self::Halo, Some("Filter across stripes: the same bytes as one device");
    HaloMode:
        "cost" Self::Cost, Some("Choose the cheaper of recompute and exchange for each iteration");
        "recompute" Self::Recompute, Some("Receive a wide margin once and filter it redundantly");
        "exchange" Self::Exchange, Some("Receive a narrow margin before every iteration");
    ToneCurve:
        "reinhard" Self::Reinhard, Some("c / (1 + c) per channel (Reinhard et al. 2002, eq. 3)");
        "neutral" Self::Neutral, Some("Khronos PBR Neutral: base colours up to 0.8 stay as they are");
        "agx" Self::Agx, Some("AgX: filmic, and bright colours fade to white");
        "aces" Self::Aces, Some("ACES filmic: high contrast");
        "none" Self::None, Some("No curve; brighter colours are clipped");
    TraversalChoice:
        "auto" Self::Auto, Some("Hardware if every device is a GPU with ray queries, else compute");
        "compute" Self::Compute, Some("Compute shaders");
        "hardware" Self::Hardware, Some("Hardware ray queries");
    ShaderChecks:
        "full" Self::Full, Some("All checks: bounds, loops, integer division");
        "fast" Self::Fast, Some("Bounds checks only");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environments_are_files_or_radiances() {
        let sky = |text| ShotEnvironment::parse(text).map(|e| e.sky);
        assert_eq!(sky("1, 0,2.5"), Ok(Sky::Constant(glam::vec3(1.0, 0.0, 2.5))));
        assert_eq!(sky("white"), Ok(Sky::Constant(Vec3::ONE)));
        assert_eq!((sky("studio"), sky("sky")), (Ok(Sky::Studio), Ok(Sky::Clear)));
        assert_eq!(sky("skies/Dusk.HDR"), Ok(Sky::Image("skies/Dusk.HDR".into())));
        for wrong in ["", "1", "1,2", "1,2,-3", "1,2,nan", "1,2,1e39", "sky.png"] {
            assert!(sky(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_orbit_is_a_name_or_two_angles_and_perhaps_a_zoom() {
        let expected = Orbit { azimuth_deg: -30.0, elevation_deg: 20.0, zoom: 1.0 };
        assert_eq!(Orbit::parse("-30,20"), Ok(expected));
        assert_eq!(Orbit::parse("-30, 20, 2"), Ok(Orbit { zoom: 2.0, ..expected }));
        assert_eq!(Orbit::parse("top"), Ok(Orbit::TOP));
        for wrong in ["", "1", "1,91", "1,2,0", "nan,0", "1,2,3,4", "bottom"] {
            assert!(Orbit::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn an_exposure_is_a_number_of_stops_or_auto() {
        assert_eq!((Exposure::parse("-1.5"), Exposure::parse("auto")), (Ok(Exposure::Ev(-1.5)), Ok(Exposure::Auto)));
        assert!(Exposure::parse("25").unwrap_err().contains("-24 to 24"));
    }

    #[test]
    fn points_are_three_finite_numbers() {
        assert_eq!(DVec3::parse("-1,0.5,2"), Ok(DVec3::new(-1.0, 0.5, 2.0)));
        for wrong in ["", "1,2", "1,2,3,4", "1,2,inf", "a,b,c"] {
            assert!(DVec3::parse(wrong).is_err(), "{wrong}");
        }
    }
}
