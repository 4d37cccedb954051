//! Pixels in memory: extents, row ranges and images. Row 0 is the top row; pixel (0, 0) is the top left one.

pub mod display;
mod error;
pub mod exr;
pub mod file;
pub mod key;
pub mod sheet;
pub mod stereo;
pub mod tone;

pub use error::{ImageError, check_same_size};

use std::fmt;
use std::ops::{Range, RangeInclusive};
use std::str::FromStr;

/// Size of one eye's image in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct Extent {
    pub width: u32,
    pub height: u32,
}

impl Extent {
    /// Valid widths and heights of rendered images.
    pub const SIDES: RangeInclusive<u32> = 1..=16384;

    pub const fn new(width: u32, height: u32) -> Self {
        Self { width, height }
    }

    /// Returns the number of pixels.
    pub const fn area(self) -> usize {
        self.width as usize * self.height as usize
    }

    pub fn rows(self) -> Range<u32> {
        0..self.height
    }
}

impl fmt::Display for Extent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

impl FromStr for Extent {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parsed = text.split_once(['x', 'X']).and_then(|(w, h)| Some(Self::new(w.parse().ok()?, h.parse().ok()?)));
        match parsed {
            Some(e) if Self::SIDES.contains(&e.width) && Self::SIDES.contains(&e.height) => Ok(e),
            _ => Err(format!("'{text}' is not a size: give WIDTHxHEIGHT, each 1 to 16384, e.g. 640x360")),
        }
    }
}

/// A row-major image with a `T` per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Image<T> {
    pub extent: Extent,
    pub pixels: Vec<T>,
}

impl<T: Clone> Image<T> {
    pub fn filled(extent: Extent, value: T) -> Self {
        Self { extent, pixels: vec![value; extent.area()] }
    }
}

impl<T> Image<T> {
    /// Makes an image of the values that `pixel` returns for column and row.
    pub fn from_fn(extent: Extent, pixel: impl Fn(u32, u32) -> T) -> Self {
        let places = extent.rows().flat_map(|y| (0..extent.width).map(move |x| (x, y)));
        Self { extent, pixels: places.map(|(x, y)| pixel(x, y)).collect() }
    }

    /// Returns the pixels of `rows`, top to bottom.
    pub fn rows(&self, rows: Range<u32>) -> &[T] {
        let w = self.extent.width as usize;
        &self.pixels[rows.start as usize * w..rows.end as usize * w]
    }

    pub fn get(&self, x: u32, y: u32) -> &T {
        &self.pixels[y as usize * self.extent.width as usize + x as usize]
    }
}

/// A linear, scene-referred RGB image in f32.
pub type RgbImage = Image<[f32; 3]>;
