//! Contrast-aware multiscale banding index: how visible bands are in a picture, without a reference.
//!
//! Tandon, Afonso, Sole & Krasula 2021, "CAMBI: Contrast-aware Multiscale Banding Index", Picture Coding Symposium, as
//! libvmaf computes it with its default options (`cambi` at commit f85a8536), which differ from the paper's. At each of
//! five scales, the contrast of a pixel of level l in a smooth region is the maximum over k = 1 … 4 of
//! k p(l) max(p(l − k), p(l + k)) / (p(l) + max(…)), where p counts levels in a window around it.
//!
//! Departures from libvmaf: pictures may be smaller than 216 pixels, and sums are f64.

use super::Pair;
use crate::image::display::level;
use crate::image::{Extent, Image};

/// Largest k: levels of 10 bits, so that four are one level of 8 bits.
const STEPS: usize = 4;
/// For each k, the largest level of 10 bits whose distance to the level k above is visible: more than 1.9 % of the
/// luminance of BT.1886, with white of 300 cd/m² and black of 0.01 cd/m².
const VISIBLE: [usize; STEPS] = [178, 305, 432, 559];

impl Pair {
    /// Returns the banding index of the image as displayed: 0 without bands; from about 5, they annoy.
    pub fn cambi(&self) -> f64 {
        // Luma of BT.709 in the limited range, as in a video of the picture.
        let luma = |pixel: &[f64; 3]| {
            let [r, g, b] = pixel.map(|value| f64::from(level(value)) / 255.0);
            (16.0 + 219.0 * (0.2126 * r + 0.7152 * g + 0.0722 * b)).round() as u8
        };
        cambi(&Image { extent: self.extent, pixels: self.image.shown.iter().map(luma).collect() })
    }
}

/// Returns the banding index of a picture's luma in the limited range, 16 … 235.
fn cambi(luma: &Image<u8>) -> f64 {
    // 65 pixels at 3840x2160.
    let window = (65 * (luma.extent.width + luma.extent.height) / 6000) | 1;
    // The mean of four pixels suppresses dither, and their sum has 10 bits.
    let mut levels = Image::from_fn(luma.extent, |x, y| square(luma, x, y).map(u16::from).iter().sum());
    let mut mask = spatial_mask(&levels);
    let mut score = 0.0;
    for weight in [16.0, 8.0, 4.0, 2.0, 1.0] {
        levels = mode_filtered(&levels);
        let mut contrasts = contrasts(&levels, &mask, window / 2);
        contrasts.sort_unstable_by(|a, b| b.total_cmp(a));
        let pooled = &contrasts[..(contrasts.len() * 3 / 5).max(1)];
        score += weight * pooled.iter().sum::<f64>() / pooled.len() as f64;
        (levels, mask) = (halved(&levels), halved(&mask));
    }
    score / f64::from(window * window)
}

/// Returns a pixel, those on its right and below it, and the one on the right below. Beyond the border, pixels repeat.
fn square<T: Copy>(image: &Image<T>, x: u32, y: u32) -> [T; 4] {
    let (right, below) = ((x + 1).min(image.extent.width - 1), (y + 1).min(image.extent.height - 1));
    [(x, y), (right, y), (x, below), (right, below)].map(|(x, y)| *image.get(x, y))
}

/// Marks smooth regions, in which most pixels of 7x7 equal those on the right and below.
fn spatial_mask(levels: &Image<u16>) -> Image<bool> {
    let Extent { width, height } = levels.extent;
    let is_flat = Image::from_fn(levels.extent, |x, y| {
        let [own, right, below, _] = square(levels, x, y);
        own == right && own == below
    });
    let log_blocks = (width / 64 * (height / 64)).max(1).next_power_of_two().ilog2();
    let most = (49 + 3 * log_blocks - 33 - 1) as usize / 2;
    Image::from_fn(levels.extent, |x, y| {
        let rows = (y.saturating_sub(3)..(y + 4).min(height)).map(|y| is_flat.rows(y..y + 1));
        let square = rows.flat_map(|row| &row[x.saturating_sub(3) as usize..(x + 4).min(width) as usize]);
        square.filter(|is_flat| **is_flat).count() > most
    })
}

fn halved<T: Copy>(image: &Image<T>) -> Image<T> {
    let extent = Extent::new(image.extent.width.div_ceil(2), image.extent.height.div_ceil(2));
    Image::from_fn(extent, |x, y| *image.get(2 * x, 2 * y))
}

/// Replaces levels by the mode of three pixels, or their minimum, along rows and then columns inside the image.
fn mode_filtered(levels: &Image<u16>) -> Image<u16> {
    let Extent { width, height } = levels.extent;
    let mode = |mut three: [u16; 3]| {
        three.sort_unstable();
        if three[1] == three[2] { three[1] } else { three[0] }
    };
    let is_inside = |at: u32, end: u32| at > 0 && at + 1 < end;
    let along_rows = Image::from_fn(levels.extent, |x, y| {
        let at = |x| *levels.get(x, y);
        if is_inside(x, width) { mode([x - 1, x, x + 1].map(at)) } else { at(x) }
    });
    Image::from_fn(levels.extent, |x, y| {
        let at = |y| *along_rows.get(x, y);
        if is_inside(y, height) { mode([y - 1, y, y + 1].map(at)) } else { *levels.get(x, y) }
    })
}

/// Returns the contrast of each pixel; 0 outside the mask.
fn contrasts(levels: &Image<u16>, mask: &Image<bool>, radius: u32) -> Vec<f64> {
    let Extent { width, height } = levels.extent;
    let mut all = Vec::with_capacity(levels.pixels.len());
    for y in 0..height {
        // Counts of levels in the window, which slides along the row. No pixel has the outermost levels.
        let mut counts = [0u32; 1024 + 2 * STEPS];
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
        let masked = |x: u32| rows.clone().filter(move |&y| *mask.get(x, y)).map(move |y| *levels.get(x, y) as usize);
        (0..radius.min(width)).flat_map(masked).for_each(|l| counts[l + STEPS] += 1);
        for x in 0..width {
            (x + radius..width).take(1).flat_map(masked).for_each(|l| counts[l + STEPS] += 1);
            let l = usize::from(*levels.get(x, y));
            let contrast = |k: usize| {
                let own = f64::from(counts[l + STEPS]);
                let other = f64::from(counts[l + STEPS - k].max(counts[l + STEPS + k]));
                k as f64 * own * other / (own + other)
            };
            let visible = (1..=STEPS).filter(|k| *mask.get(x, y) && l <= VISIBLE[k - 1]);
            all.push(visible.map(contrast).fold(0.0, f64::max));
            x.checked_sub(radius).into_iter().flat_map(masked).for_each(|l| counts[l + STEPS] -= 1);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of libvmaf's `cambi.c` (commit f85a8536, default options, plain C) for the same luma. For the left
    /// pictures of `builtin:cornell` (640x360) and `builtin:atrium` (600x400) at one sample, libvmaf gives 2.741743494
    /// and 0.821743566, and this module 2.741743476 and 0.821743559.
    #[test]
    fn cambi_equals_libvmaf() {
        let mut state = 7u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24)
        };
        let mut picture = |width: u32, height: u32, luma: &dyn Fn(f64, f64, f64) -> f64| {
            let extent = Extent::new(width, height);
            let at = extent.rows().flat_map(|y| (0..width).map(move |x| (f64::from(x), f64::from(y))));
            let pixels: Vec<u8> = at.map(|(x, y)| luma(x, y, random()) as u8).collect();
            cambi(&Image { extent, pixels })
        };
        for (name, found, libvmaf) in [
            ("dithered ramp", picture(320, 240, &|x, _, random| 60.0 + x / 16.0 + random), 3.915_098_687),
            ("bands of 16", picture(320, 240, &|x, _, _| 60.0 + x / 16.0), 18.716_103_149),
            ("bands of 64", picture(1280, 720, &|x, _, _| 60.0 + (x / 64.0).floor()), 16.454_368_709),
            ("two levels", picture(320, 240, &|x, _, _| 60.0 + 2.0 * (x / 16.0).floor()), 0.029_053_134),
            ("bright bands", picture(320, 240, &|x, _, _| 200.0 + x / 16.0), 0.0),
            ("one seam", picture(320, 240, &|_, y, _| if y < 120.0 { 100.0 } else { 101.0 }), 2.455_328_798),
            ("discs", picture(333, 217, &|x, y, _| 120.0 - (x - 150.0).hypot(y - 100.0) / 14.0), 17.229_495_791),
        ] {
            assert!((found - libvmaf).abs() < 1e-5 * libvmaf.max(1.0), "{name}: {found}, libvmaf {libvmaf}");
        }
    }
}
