//! Polar projections that can be traced instead of the screen's pixels.

use std::fmt::{self, Display};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::within;

/// Projections whose pixels are arranged around the gaze.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum PolarSpace {
    /// Visual-polar: density follows visual acuity (Koskela et al. 2019).
    Visual,
    /// Log-polar: rings grow with their distance from the gaze (Andersson & Hansson 2020).
    Log(LogPolar),
}

/// Parameters of log-polar images (Andersson & Hansson 2020, "Performance Optimizations for Foveated Real-Time
/// Raytracing", section 3.3).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LogPolar {
    /// Downsampling factor per axis, σ: the number of rings times the number of directions is 1/σ² of the screen's
    /// number of pixels.
    pub sigma: f64,
    /// Exponent of the kernel function. Values above 1 move pixels away from the gaze; 1 has no effect.
    pub alpha: f64,
    /// Angle around the gaze, radians, within which every pixel of the screen is traced; 0 disables this. The assumed
    /// viewing distance is the screen's diagonal divided by tan 60° ([`Self::DIAGONAL_DEG`]).
    pub gaze: f64,
    /// Number of rings divided by the number of directions.
    pub aspect: f64,
    /// True to blur the image with increasing distance from the gaze.
    #[serde(default = "always")]
    pub blur: bool,
}

fn always() -> bool {
    true
}

impl LogPolar {
    /// Modes of Andersson & Hansson's table 5.1: name and parameters.
    pub const PRESETS: [(&str, Self); 4] = [
        ("fov", Self::new(0.75, 1.0, 0.0, 1.2)),
        ("kernel", Self::new(1.0, 3.0, 0.0, 0.7)),
        ("composite", Self::new(1.4, 1.0, 0.2, 0.33)),
        ("composite-kernel", Self::new(1.3, 2.0, 0.15, 0.35)),
    ];
    pub const COMPOSITE: Self = Self::PRESETS[2].1;
    /// Angle in degrees whose tangent is the screen's diagonal over the assumed viewing distance.
    pub const DIAGONAL_DEG: f64 = 60.0;

    const fn new(sigma: f64, alpha: f64, gaze: f64, aspect: f64) -> Self {
        Self { sigma, alpha, gaze, aspect, blur: true }
    }

    /// Checks whether all parameters are valid.
    ///
    /// # Errors
    /// A message that names the invalid parameter.
    pub fn check(&self) -> Result<(), String> {
        within("sigma", self.sigma, 0.25..=16.0)?;
        within("alpha", self.alpha, 0.25..=8.0)?;
        within("gaze", self.gaze, 0.0..=0.6)?;
        within("aspect", self.aspect, 0.05..=20.0)
    }
}

impl FromStr for LogPolar {
    type Err = String;

    /// Parses the name of a preset mode, or four numbers SIGMA,ALPHA,GAZE,ASPECT.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Some((_, preset)) = Self::PRESETS.iter().find(|(name, _)| *name == text) {
            return Ok(*preset);
        }
        let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        let Some(&[sigma, alpha, gaze, aspect]) = numbers.as_deref() else {
            let names = Self::PRESETS.map(|(name, _)| name).join(", ");
            return Err(format!("expected {names}, or four numbers"));
        };
        let read = Self::new(sigma, alpha, gaze, aspect);
        read.check().map(|()| read)
    }
}

impl Display for LogPolar {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { sigma, alpha, gaze, aspect, .. } = self;
        write!(f, "{sigma},{alpha},{gaze},{aspect}")
    }
}

impl PolarSpace {
    /// Returns the name on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Visual => "visual-polar",
            Self::Log(_) => "log-polar",
        }
    }

    /// Returns the name of the kernel that blurs images with increasing distance from the gaze; `None` without blur.
    pub(crate) fn blur(&self) -> Option<&'static str> {
        match self {
            Self::Visual => Some("visual_polar_blur"),
            Self::Log(map) => map.blur.then_some("log_polar_blur"),
        }
    }
}

impl Display for PolarSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Visual => f.write_str(self.name()),
            Self::Log(map) => write!(f, "{} {map}", self.name()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_and_numbers_are_read() {
        assert_eq!("composite".parse(), Ok(LogPolar::COMPOSITE));
        assert_eq!("1.4,1,0.2,0.33".parse(), Ok(LogPolar::COMPOSITE));
        assert_eq!(LogPolar::COMPOSITE.to_string(), "1.4,1,0.2,0.33");
        for text in ["", "1,2,3", "0,1,0,1", "1,1,0.7,1", "1,NaN,0,1", "1,1,-0.1,1", "composit", "1,1,0,inf"] {
            assert!(text.parse::<LogPolar>().is_err(), "{text}");
        }
    }

    #[test]
    fn files_have_the_numbers() {
        let space = PolarSpace::Log(LogPolar::COMPOSITE);
        let text = r#"{"log":{"sigma":1.4,"alpha":1.0,"gaze":0.2,"aspect":0.33,"blur":true}}"#;
        assert_eq!(serde_json::to_string(&space).unwrap(), text);
        assert_eq!(serde_json::from_str::<PolarSpace>(text).unwrap(), space);
        assert_eq!(serde_json::from_str::<PolarSpace>(&text.replace(r#","blur":true"#, "")).unwrap(), space);
        assert_eq!(serde_json::to_string(&PolarSpace::Visual).unwrap(), "\"visual\"");
    }
}
