//! Draws a colour key (legend) or a caption below an image.

use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use super::display::DisplayImage;
use super::{Extent, Image};

const FONT: (FontWeight, RasterHeight) = (FontWeight::Regular, RasterHeight::Size16);
const LINE: u32 = 22;
const SWATCH: u32 = 12;
const GAP: u32 = 6;
const BACKGROUND: [u8; 3] = [40; 3];
const FOREGROUND: [u8; 3] = [230; 3];

/// A colour and its label, in ASCII.
pub type Entry = ([u8; 3], String);

/// Returns the image with lines of colour swatches and labels below it, widened if a label needs that.
pub fn with_key(picture: &DisplayImage, entries: &[Entry]) -> DisplayImage {
    let widest = entries.iter().map(entry_width).max().unwrap_or(0);
    let width = picture.extent.width.max(widest);
    let (mut places, mut at) = (Vec::new(), [0, 0]);
    for entry in entries {
        if at[0] + entry_width(entry) > width {
            at = [0, at[1] + 1];
        }
        places.push(at);
        at[0] += entry_width(entry);
    }
    let lines = places.last().map_or(0, |at| at[1] + 1);
    let mut out = DisplayImage::filled(Extent::new(width, picture.extent.height + lines * LINE), BACKGROUND);
    for y in picture.extent.rows() {
        let begin = (y * width) as usize;
        out.pixels[begin..begin + picture.extent.width as usize].copy_from_slice(picture.rows(y..y + 1));
    }
    for ([x, line], (colour, text)) in places.into_iter().zip(entries) {
        draw(&mut out, x + GAP, picture.extent.height + line * LINE, *colour, text);
    }
    out
}

fn glyph_width() -> u32 {
    get_raster_width(FONT.0, FONT.1) as u32
}

fn entry_width((_, text): &Entry) -> u32 {
    GAP + SWATCH + GAP + text.chars().count() as u32 * glyph_width() + GAP
}

/// Draws a framed colour swatch and, to its right, its label, on a line of text whose top left corner is (`x`, `y`).
fn draw(out: &mut Image<[u8; 3]>, x: u32, y: u32, colour: [u8; 3], text: &str) {
    let width = out.extent.width;
    let mut set = |x: u32, y: u32, value| out.pixels[(y * width + x) as usize] = value;
    let top = y + (LINE - SWATCH) / 2;
    for (dx, dy) in (0..SWATCH).flat_map(|dy| (0..SWATCH).map(move |dx| (dx, dy))) {
        let is_frame = [dx, dy].iter().any(|d| *d == 0 || *d == SWATCH - 1);
        set(x + dx, top + dy, if is_frame { FOREGROUND } else { colour });
    }
    write(out, x + SWATCH + GAP, y, text);
}

/// Returns the image with lines of text below it. Text that is too wide is cut.
pub fn with_caption(picture: &DisplayImage, lines: &[String]) -> DisplayImage {
    let Extent { width, height } = picture.extent;
    let mut out = DisplayImage::filled(Extent::new(width, height + lines.len() as u32 * LINE), BACKGROUND);
    out.pixels[..picture.pixels.len()].copy_from_slice(&picture.pixels);
    let most = (width.saturating_sub(2 * GAP) / glyph_width()) as usize;
    for (line, text) in (0..).zip(lines) {
        // The font has no other characters.
        let text: String = text.chars().take(most).map(|c| if c.is_ascii_graphic() { c } else { ' ' }).collect();
        write(&mut out, GAP, height + line * LINE, &text);
    }
    out
}

/// Writes text on a line whose top left corner is (`left`, `y`).
fn write(out: &mut Image<[u8; 3]>, left: u32, y: u32, text: &str) {
    let width = out.extent.width;
    let top = y + (LINE - FONT.1.val() as u32) / 2;
    let mut set = |x: u32, y: u32, value| out.pixels[(y * width + x) as usize] = value;
    for (i, raster) in text.chars().map(|c| get_raster(c, FONT.0, FONT.1)).enumerate() {
        for (dy, row) in raster.iter().flat_map(|raster| raster.rows()).enumerate() {
            for (dx, &ink) in row.iter().enumerate() {
                let mix = |c: usize| {
                    (u32::from(BACKGROUND[c]) * (255 - u32::from(ink)) + u32::from(FOREGROUND[c]) * u32::from(ink))
                        / 255
                };
                set(left + i as u32 * glyph_width() + dx as u32, top + dy as u32, [0, 1, 2].map(|c| mix(c) as u8));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(count: usize) -> Vec<Entry> {
        (0..count).map(|i| ([200, i as u8, 0], format!("{i} reason"))).collect()
    }

    #[test]
    fn key_keeps_the_picture_and_shows_each_colour() {
        let extent = Extent::new(220, 10);
        let picture = DisplayImage { extent, pixels: (0..2200).map(|i| [i as u8, 1, 2]).collect() };
        let keyed = with_key(&picture, &entries(5));
        assert_eq!(keyed.extent, Extent::new(220, 10 + 3 * LINE), "two of these have room on a line");
        for y in extent.rows() {
            assert_eq!(keyed.rows(y..y + 1), picture.rows(y..y + 1));
        }
        for i in 0..5 {
            assert!(keyed.pixels.iter().filter(|p| **p == [200, i, 0]).count() == 100, "a square within its frame");
        }
        // Letters have soft edges.
        assert!(keyed.rows(10..keyed.extent.height).iter().any(|p| p[0] > 80 && p[0] < 180 && p[0] == p[1]));
    }

    #[test]
    fn caption_is_below_the_picture_and_as_wide() {
        let picture = DisplayImage::filled(Extent::new(60, 3), [255, 0, 255]);
        let captioned = with_caption(&picture, &["short".into(), "\u{e4} name that is far too long".into()]);
        assert_eq!(captioned.extent, Extent::new(60, 3 + 2 * LINE));
        assert_eq!(captioned.pixels[..180], picture.pixels);
        let ink = |rows: std::ops::Range<u32>| captioned.rows(rows).iter().filter(|p| p[0] > 150).count();
        assert!(ink(3..3 + LINE) > 10 && ink(3 + LINE..3 + 2 * LINE) > 10);
    }

    #[test]
    fn narrow_picture_widens_to_its_longest_text() {
        let picture = DisplayImage::filled(Extent::new(4, 3), [255, 0, 255]);
        let keyed = with_key(&picture, &entries(2));
        assert_eq!(keyed.extent, Extent::new(entry_width(&entries(1)[0]), 3 + 2 * LINE));
        assert_eq!(keyed.pixels.iter().filter(|p| **p == [255, 0, 255]).count(), 12);
        assert_eq!(with_key(&picture, &[]), picture);
    }
}
