//! A mean number of samples per pixel.

use std::fmt::{self, Display};
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::projection::within;

/// A mean number of samples per pixel. Between two whole numbers, each tile of 8x4 pixels takes one of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spp {
    /// Samples of every pixel, at least 1.
    pub least: u32,
    /// Fraction of tiles, at least 0 and less than 1, that take one more sample.
    pub extra: f64,
}

impl Spp {
    /// Returns the mean number of samples.
    pub fn mean(self) -> f64 {
        f64::from(self.least) + self.extra
    }

    /// # Errors
    /// A message that names the number outside its range.
    pub fn check(self) -> Result<(), String> {
        within("spp", self.least, 1..=1 << 20)?;
        match (0.0..1.0).contains(&self.extra) {
            true => Ok(()),
            false => Err(format!("extra {} is not a fraction of at least 0 and less than 1", self.extra)),
        }
    }
}

impl From<u32> for Spp {
    fn from(least: u32) -> Self {
        Self { least, extra: 0.0 }
    }
}

/// Parses a number such as `2` or `1.25`.
impl FromStr for Spp {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number: f64 = text.parse().map_err(|_| "not a number of samples, such as 2 or 1.25".to_owned())?;
        if !(1.0..f64::from(u32::MAX)).contains(&number) {
            return Err("there has to be at least 1 sample".to_owned());
        }
        Ok(Self { least: number as u32, extra: number.fract() })
    }
}

/// Shows at most three decimals.
impl Display for Spp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        ((self.mean() * 1e3).round() / 1e3).fmt(f)
    }
}

/// Serializes whole numbers as integers.
impl Serialize for Spp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.extra > 0.0 { serializer.serialize_f64(self.mean()) } else { serializer.serialize_u32(self.least) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_samples_are_read_and_written_alike() {
        for text in ["1", "1.25", "64", "2.5"] {
            let spp: Spp = text.parse().unwrap();
            assert!(spp.check().is_ok());
            assert_eq!([spp.to_string(), serde_json::to_string(&spp).unwrap()], [text, text]);
        }
        assert_eq!(Spp { least: 1, extra: 1.0 / 3.0 }.to_string(), "1.333");
        assert_eq!("3".parse::<Spp>().unwrap(), Spp::from(3));
        for text in ["0", "0.5", "-1", "nan", "inf", "1e300", "two", ""] {
            assert!(text.parse::<Spp>().is_err(), "{text}");
        }
    }
}
