//! Small images made in code. Colours are sRGB bytes, as a file would hold them.

use super::super::TexelImage;
use super::maths::{hash_unit, noise};
use crate::image::{Extent, Image};

fn paint(size: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> TexelImage {
    let extent = Extent::new(size, size);
    let pixels = (0..size * size)
        .map(|i| texel(i % size, i / size))
        .collect();
    Image { extent, pixels }
}

fn opaque(color: [f32; 3]) -> [u8; 4] {
    let [r, g, b] = color.map(|c| (c.clamp(0.0, 255.0) + 0.5) as u8);
    [r, g, b, 255]
}

/// A board of `squares` × `squares` in two greys.
pub fn checker(size: u32, squares: u32, light: u8, dark: u8) -> TexelImage {
    paint(size, |x, y| {
        let odd = (x * squares / size + y * squares / size) % 2 == 1;
        let grey = if odd { dark } else { light };
        [grey, grey, grey, 255]
    })
}

/// Two by two veined marble tiles, pale and warm in turn, with dark joints between them.
pub fn marble_tiles(size: u32) -> TexelImage {
    let half = size / 2;
    paint(size, |x, y| {
        let (tile_x, tile_y) = (x / half, y / half);
        let (in_x, in_y) = (x % half, y % half);
        if in_x.min(in_y) < 1 || in_x.max(in_y) > half - 2 {
            return opaque([112.0, 104.0, 94.0]);
        }
        let seed = tile_x + 2 * tile_y;
        let cloud = turbulence(x, y, size, seed);
        let vein = 1.0 - (cloud * 2.0 - 1.0).abs() * 5.0;
        let shade =
            14.0 * (cloud - 0.5) - 16.0 * vein.max(0.0) + 5.0 * (hash_unit(x * 7919 + y) - 0.5);
        let base = if (tile_x + tile_y) % 2 == 0 {
            [214.0, 206.0, 192.0]
        } else {
            [168.0, 136.0, 112.0]
        };
        opaque(base.map(|c| c + shade))
    })
}

/// Four octaves of noise, in 0..1, that repeats over the image.
fn turbulence(x: u32, y: u32, size: u32, seed: u32) -> f32 {
    let (mut sum, mut weight) = (0.0, 0.5);
    for octave in 0..4 {
        let cells = 5 << octave;
        let to_cells = cells as f32 / size as f32;
        sum += weight
            * noise(
                x as f32 * to_cells,
                y as f32 * to_cells,
                cells,
                seed * 8 + octave,
            );
        weight *= 0.5;
    }
    sum / 0.9375
}
