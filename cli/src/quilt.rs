//! Quilts: the views of a row as tiles of one picture, as light-field displays read them.

use std::fmt;
use std::str::FromStr;

use diptych::image::Extent;
use diptych::image::display::DisplayImage;
use diptych::scene::rig::Eye;

/// Columns and rows of a quilt, each at least 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quilt {
    columns: u32,
    rows: u32,
}

impl FromStr for Quilt {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once('x').and_then(|(c, r)| Some((c.parse().ok()?, r.parse().ok()?)));
        let most = Eye::MOST_VIEWS as u32;
        match numbers {
            Some((columns @ 1.., rows @ 1..)) if u64::from(columns) * u64::from(rows) <= u64::from(most) => {
                Ok(Self { columns, rows })
            }
            _ => Err(format!("give columns and rows of at most {most} views in all, such as 8x6")),
        }
    }
}

impl fmt::Display for Quilt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

impl Quilt {
    /// Returns the number of its views.
    pub fn views(self) -> u32 {
        self.columns * self.rows
    }

    /// Returns the stem of its file's name, from which players of Looking Glass displays read the number of columns and
    /// rows and the aspect ratio of views of this extent.
    pub fn stem(self, extent: Extent) -> String {
        let aspect = f64::from(extent.width) / f64::from(extent.height);
        let digits = format!("{aspect:.4}");
        let digits = digits.trim_end_matches('0').trim_end_matches('.');
        format!("quilt_qs{self}a{digits}")
    }

    /// Puts views of the same extent, the leftmost first, in rows from the bottom left to the top right. There must be
    /// [`Self::views`] of them.
    pub fn picture(self, views: &[&DisplayImage]) -> DisplayImage {
        let Extent { width, height } = views[0].extent;
        let extent = Extent::new(self.columns * width, self.rows * height);
        let rows_of_tiles = views.chunks(self.columns as usize).rev();
        let pixels =
            rows_of_tiles.flat_map(|tiles| (0..height).flat_map(|y| tiles.iter().flat_map(move |t| t.rows(y..y + 1))));
        DisplayImage { extent, pixels: pixels.copied().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_go_from_the_bottom_left_to_the_top_right() {
        let extent = Extent::new(1, 2);
        let views: Vec<DisplayImage> =
            (0..6).map(|n| DisplayImage { extent, pixels: vec![[n; 3], [n + 10; 3]] }).collect();
        let quilt: Quilt = "3x2".parse().unwrap();
        let picture = quilt.picture(&views.iter().collect::<Vec<_>>());
        let reds: Vec<u8> = picture.pixels.iter().map(|p| p[0]).collect();
        assert_eq!(picture.extent, Extent::new(3, 4));
        assert_eq!(reds, [3, 4, 5, 13, 14, 15, 0, 1, 2, 10, 11, 12]);
    }

    #[test]
    fn names_hold_the_arrangement() {
        let quilt: Quilt = "8x6".parse().unwrap();
        assert_eq!(quilt.stem(Extent::new(420, 560)), "quilt_qs8x6a0.75");
        assert_eq!(quilt.stem(Extent::new(320, 180)), "quilt_qs8x6a1.7778");
        assert_eq!(quilt.stem(Extent::new(100, 100)), "quilt_qs8x6a1");
        for text in ["", "8", "8x", "0x6", "11x10", "8x6x1", "4294967295x4294967295"] {
            assert!(text.parse::<Quilt>().is_err(), "{text}");
        }
    }
}
