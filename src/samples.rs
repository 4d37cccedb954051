//! Samples per pixel: how many a frame takes, where they are in their pixels, and the kernel runs that take them.

use std::fmt::{self, Display};
use std::ops::{Range, RangeInclusive};
use std::str::FromStr;

use serde::{Deserialize, Serialize, Serializer};

use crate::image::Extent;
use crate::projection::{OutOfRange, within};
use crate::wgsl::{Words, shared_constants, shared_structs};

/// A mean number of samples per pixel. Between two whole numbers, each tile of 8x4 pixels takes one of them.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(from = "Members")]
pub struct Samples {
    /// Samples of every pixel, at least 1.
    pub least: u32,
    /// Fraction of tiles, at least 0 and less than 1, that take one more sample.
    extra: f64,
}

impl Samples {
    pub const VALID: RangeInclusive<u32> = 1..=1 << 20;
    pub const ONE: Self = Self { least: 1, extra: 0.0 };

    /// Returns the samples whose mean is this number, which is at least 1.
    pub fn of_mean(mean: f64) -> Self {
        Self { least: mean as u32, extra: mean.fract() }
    }

    /// Returns the mean number of samples.
    pub fn mean(self) -> f64 {
        f64::from(self.least) + self.extra
    }

    /// Returns the fraction of tiles, at least 0 and less than 1, that take one sample more than the others.
    pub fn fraction(self) -> f64 {
        self.extra
    }

    /// Returns true if some tiles take one sample more than others.
    pub fn varies(self) -> bool {
        self.extra > 0.0
    }

    /// Returns the largest number of samples of a pixel.
    pub fn most(self) -> u32 {
        self.least + u32::from(self.varies())
    }

    /// Returns true if some pixels take one sample and others take two.
    pub fn is_between_one_and_two(self) -> bool {
        self.least == 1 && self.varies()
    }

    /// Returns the larger numbers of both.
    pub fn max(self, other: Self) -> Self {
        Self { least: self.least.max(other.least), extra: self.extra.max(other.extra) }
    }

    /// # Errors
    /// The number outside its range.
    pub fn check(self) -> Result<(), OutOfRange> {
        within("spp", self.least, Self::VALID)?;
        within("extra", self.extra, 0.0..=1.0f64.next_down())
    }

    /// Returns the constants of a frame that takes these samples from sequences that pixels share. `grid` is the size of
    /// the traced images.
    pub fn shared(self, grid: Extent, centres_one: bool) -> PixelSamples {
        let curve_shift = curve_shift(grid, self.most());
        PixelSamples { extra: self.extra as f32, curve_shift, ..PixelSamples::own(0..self.least, centres_one) }
    }
}

impl Default for Samples {
    fn default() -> Self {
        Self::ONE
    }
}

impl From<u32> for Samples {
    fn from(least: u32) -> Self {
        Self { least, extra: 0.0 }
    }
}

/// Parses a number such as `2` or `1.25`.
impl FromStr for Samples {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number: f64 = text.parse().map_err(|_| "not a number of samples, such as 2 or 1.25".to_owned())?;
        if !(1.0..f64::from(u32::MAX)).contains(&number) {
            return Err("there has to be at least 1 sample".to_owned());
        }
        Ok(Self::of_mean(number))
    }
}

/// Shows at most three decimals.
impl Display for Samples {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        ((self.mean() * 1e3).round() / 1e3).fmt(f)
    }
}

/// Serializes the mean, whole numbers as integers.
impl Serialize for Samples {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.varies() { serializer.serialize_f64(self.mean()) } else { serializer.serialize_u32(self.least) }
    }
}

/// Samples as two members of a record in ladders, journals and `run.json`.
#[derive(Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub(crate) struct Members {
    /// Samples per pixel, at least 1.
    pub spp: u32,
    /// Fraction of tiles of 8x4 pixels, at least 0 and less than 1, that take one more sample per pixel.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub extra: f64,
}

pub(crate) fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl From<Members> for Samples {
    fn from(Members { spp, extra }: Members) -> Self {
        Self { least: spp, extra }
    }
}

/// Serializes samples as [`Members`] of the record that contains them.
pub(crate) fn as_members<S: Serializer>(samples: &Samples, serializer: S) -> Result<S::Ok, S::Error> {
    Members { spp: samples.least, extra: samples.extra }.serialize(serializer)
}

shared_constants! {
    /// Value of [`PixelSamples::curve_shift`] with which each pixel has its own sequences.
    pub const NO_CURVE: u32 = 32;
}

shared_structs! {
    /// The samples that the pixels of a frame take.
    pub struct PixelSamples {
        /// Samples of every pixel.
        pub least: u32,
        /// Fraction of tiles, 0 to 1, whose pixels take one sample more.
        pub extra: f32,
        /// Number of the frame's first sample. Successive passes of an accumulation continue the sequences.
        pub first: u32,
        /// Number of low bits of the index into a shared sequence that hold the sample's number. The bits above hold
        /// the pixel's index on the Z-order curve.
        pub curve_shift: u32,
        /// 1 if all samples are jittered over their pixels, 0 if the only one of a pixel goes through `camera.centre`.
        pub is_jittered: u32,
        pub pad0: u32,
        pub pad1: u32,
        pub pad2: u32,
    }
}

impl PixelSamples {
    /// Returns the samples of a frame whose pixels all take the same range of samples, each from its own sequence. A
    /// pixel's only sample is at its centre if `centres_one`; several are always jittered.
    pub fn own(samples: Range<u32>, centres_one: bool) -> Self {
        let least = samples.end - samples.start;
        let is_jittered = (least > 1 || !centres_one).into();
        Self { least, first: samples.start, curve_shift: NO_CURVE, is_jittered, ..Self::default() }
    }

    /// Returns the largest number of samples of a pixel, at least 1.
    pub fn most(self) -> u32 {
        self.least.max(1).saturating_add(u32::from(self.extra > 0.0))
    }

    /// Returns the kernel runs of a frame. If some pixels take one sample at their centre and others several, a launch
    /// of samples has runs for both.
    pub fn runs(self, launches: &[Launch]) -> impl Iterator<Item = Run> {
        let (has_centres, of_all) = (self.is_jittered == 0, self.most());
        launches.iter().flat_map(move |launch| {
            let (centres, jittered, most, third) = match *launch {
                Launch::Once(args) => (Some(Run { args, samples: 1, jitter: !has_centres }), 0, 1, 0),
                Launch::Samples { most, third, only_jittered } => {
                    let centres = Run { args: Words([0, 1, third]), samples: 1, jitter: false };
                    let jittered = if has_centres && of_all == 1 { 0 } else { of_all };
                    (Some(centres).filter(|_| has_centres && !only_jittered), jittered, most, third)
                }
            };
            let batch = move |i: u32| {
                let (begin, end) = (i * most, (i * most + most).min(jittered));
                Run { args: Words([begin, end, third]), samples: end - begin, jitter: true }
            };
            centres.into_iter().chain((0..jittered.div_ceil(most)).map(batch))
        })
    }
}

/// Returns the [`PixelSamples::curve_shift`] for images of this size with `count` samples per pixel, or [`NO_CURVE`] if
/// the indices into the shared sequences would need more than 32 bits.
fn curve_shift(extent: Extent, count: u32) -> u32 {
    let bits_for = |count: u32| u32::BITS - count.saturating_sub(1).leading_zeros();
    let shift = bits_for(count);
    let numbers = 2 * bits_for(extent.width.max(extent.height)) + shift;
    if numbers > u32::BITS { NO_CURVE } else { shift }
}

/// Runs of a kernel over the rows of a pass, with the kernel's three arguments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Launch {
    Once(Words),
    /// One run per batch of at most `most` samples per pixel. The arguments are the index of the first sample, the
    /// index after the last sample, and `third`.
    Samples {
        most: u32,
        third: u32,
        /// True if the kernel does not run in frames whose only sample is at the pixel's centre.
        only_jittered: bool,
    },
}

/// One run of a kernel in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    pub args: Words,
    /// Samples per pixel that this run takes; 1 for [`Launch::Once`].
    pub samples: u32,
    /// True if the samples are jittered over their pixels.
    pub jitter: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_counts_round_trip() {
        for text in ["1", "1.25", "64", "2.5"] {
            let spp: Samples = text.parse().unwrap();
            assert!(spp.check().is_ok());
            assert_eq!([spp.to_string(), serde_json::to_string(&spp).unwrap()], [text, text]);
        }
        assert_eq!(Samples { least: 1, extra: 1.0 / 3.0 }.to_string(), "1.333");
        assert_eq!("3".parse::<Samples>().unwrap(), Samples::from(3));
        for text in ["0", "0.5", "-1", "nan", "inf", "1e300", "two", ""] {
            assert!(text.parse::<Samples>().is_err(), "{text}");
        }
    }

    #[test]
    fn samples_are_taken_in_batches() {
        let means = Launch::Samples { most: 4, third: 7, only_jittered: true };
        let always = Launch::Samples { most: 4, third: 0, only_jittered: false };
        let all = |mean: f64, centres_one| {
            let samples = Samples::of_mean(mean).shared(Extent::new(8, 8), centres_one);
            samples.runs(&[Launch::Once(Words([1, 2, 3])), means, always]).collect::<Vec<_>>()
        };
        let run = |jitter, args, samples| Run { args: Words(args), samples, jitter };
        let once = |jitter| run(jitter, [1, 2, 3], 1);
        assert_eq!(all(1.0, true), [once(false), run(false, [0, 1, 0], 1)]);
        assert_eq!(all(1.0, false), [once(true), run(true, [0, 1, 7], 1), run(true, [0, 1, 0], 1)]);
        let both = [once(false), run(true, [0, 2, 7], 2), run(false, [0, 1, 0], 1), run(true, [0, 2, 0], 2)];
        assert_eq!(all(1.5, true), both);
        let batches = |third| [run(true, [0, 4, third], 4), run(true, [4, 6, third], 2)];
        for counts in [all(6.0, true), all(5.5, true)] {
            assert_eq!(counts, [&[once(true)][..], &batches(7), &batches(0)].concat());
        }
    }
}
