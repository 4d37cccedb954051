//! Texts of settings that replace parts of a shot.

use glam::{DVec3, Vec3};

use super::value::{Value, numbers};
use crate::scene::motion::play::Choice;
use crate::scene::shot::allowed::{ANY, Allowed, NOT_NEGATIVE, STOPS};
use crate::scene::shot::{Exposure, ShotEnvironment, Sky};
use crate::scene::viewpoint::Orbit;

/// Returns three numbers of the allowed range.
fn triple(text: &str, allowed: &Allowed) -> Option<DVec3> {
    let numbers = numbers::<f64>(text).filter(|numbers| numbers.iter().all(|number| allowed.allows(*number)));
    numbers.and_then(|numbers| Some(DVec3::from(<[f64; 3]>::try_from(numbers).ok()?)))
}

impl Value for DVec3 {
    const FORM: &'static str = "X,Y,Z";

    const IS_NUMBER: bool = true;

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
    const FORM: &'static str = "X,Y";

    const IS_NUMBER: bool = true;

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

impl Value for Exposure {
    // Exposure by the shot is nothing that a user would give.
    const NONE: &'static str = "shot";

    const FORM: &'static str = "EV|auto";

    const IS_NUMBER: bool = true;

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
    const FORM: &'static str = "VIEW";

    const IS_NUMBER: bool = true;

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
    const FORM: &'static str = "NAME|FILE|R,G,B";

    const IS_NUMBER: bool = true;

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
            Sky::Constant(Vec3 { x, y, z }) => format!("{x},{y},{z}"),
            Sky::Image(file) => file.clone(),
            Sky::Studio => "studio".to_owned(),
            Sky::Clear => "sky".to_owned(),
        }
    }
}

impl Value for Choice {
    const FORM: &'static str = "NAME";

    fn parse(text: &str) -> Result<Self, String> {
        Ok(Self::of(text))
    }

    fn text(&self) -> String {
        Self::text(self).to_owned()
    }
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
    fn orbit_is_a_name_or_angles_with_optional_zoom() {
        let expected = Orbit { azimuth_deg: -30.0, elevation_deg: 20.0, zoom: 1.0 };
        assert_eq!(Orbit::parse("-30,20"), Ok(expected));
        assert_eq!(Orbit::parse("-30, 20, 2"), Ok(Orbit { zoom: 2.0, ..expected }));
        assert_eq!(Orbit::parse("top"), Ok(Orbit::TOP));
        for wrong in ["", "1", "1,91", "1,2,0", "nan,0", "1,2,3,4", "bottom"] {
            assert!(Orbit::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn exposure_is_a_number_of_stops_or_auto() {
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
