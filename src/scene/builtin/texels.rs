//! Small procedural textures. Colours are 8-bit sRGB values, like those of an image file.

use super::super::TexelImage;
use super::maths::{hash_unit, noise, sin_cos};
use crate::image::{Extent, Image};

fn paint(size: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> TexelImage {
    let extent = Extent::new(size, size);
    let pixels = (0..size * size).map(|i| texel(i % size, i / size)).collect();
    Image { extent, pixels }
}

fn opaque(color: [f32; 3]) -> [u8; 4] {
    let [r, g, b] = color.map(|c| (c.clamp(0.0, 255.0) + 0.5) as u8);
    [r, g, b, 255]
}

/// Returns a checkerboard of `squares` × `squares` squares in two greys.
pub fn checker(size: u32, squares: u32, light: u8, dark: u8) -> TexelImage {
    paint(size, |x, y| {
        let odd = (x * squares / size + y * squares / size) % 2 == 1;
        let grey = if odd { dark } else { light };
        [grey, grey, grey, 255]
    })
}

/// Returns two by two veined marble tiles, alternately pale and warm, with dark joints.
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
        let shade = 14.0 * (cloud - 0.5) - 16.0 * vein.max(0.0) + 5.0 * (hash_unit(x * 7919 + y) - 0.5);
        let base = if (tile_x + tile_y) % 2 == 0 { [206.0, 196.0, 180.0] } else { [178.0, 158.0, 138.0] };
        opaque(base.map(|c| c + shade))
    })
}

/// Returns the weighted sum of four octaves of periodic noise, in 0..1.
fn turbulence(x: u32, y: u32, size: u32, seed: u32) -> f32 {
    let (mut sum, mut weight) = (0.0, 0.5);
    for octave in 0..4 {
        let cells = 5 << octave;
        let to_cells = cells as f32 / size as f32;
        sum += weight * noise(x as f32 * to_cells, y as f32 * to_cells, cells, seed * 8 + octave);
        weight *= 0.5;
    }
    sum / 0.9375
}

/// Returns the ground of a forest: litter, moss and soil.
pub fn forest_floor(size: u32) -> TexelImage {
    paint(size, |x, y| {
        let cloud = turbulence(x, y, size, 40);
        let litter = hash_unit(x / 2 * 4099 + y / 2 * 31 + 17);
        let moss = ((cloud - 0.5) * 4.0).clamp(0.0, 1.0);
        let blend = |soil: f32, green: f32| soil + (green - soil) * moss + 34.0 * (litter - 0.5);
        opaque([blend(112.0, 92.0), blend(88.0, 106.0), blend(62.0, 54.0)])
    })
}

/// Returns a bough of small broad leaves, transparent elsewhere, with its stem at the middle of the bottom row.
pub fn leaf_spray(size: u32) -> TexelImage {
    let mut leaves = Vec::new();
    for twig in 0..9 {
        let side = [1.0, -1.0][twig % 2];
        let up = (twig / 2) as f32 / 4.0 + 0.1 * (twig % 2) as f32;
        let turn = if twig == 8 { 0.0 } else { side * (1.2 - 0.5 * up) };
        let (s, c) = sin_cos(turn);
        let reach = 0.4 - 0.16 * up;
        for k in 0..7 {
            let t = (k / 2) as f32 / 3.0 + 0.12;
            let splay = if k == 6 { 0.0 } else { [0.85, -0.85][k % 2] };
            let along = sin_cos(turn + splay + 0.3 * (hash_unit((twig * 8 + k) as u32) - 0.5));
            leaves.push(Leaf {
                foot: [0.5 + s * reach * t * 0.85, 0.08 + 0.62 * up + c * reach * t * 0.85],
                along: along.into(),
                length: 0.15,
                width: 0.036,
            });
        }
    }
    paint(size, |x, y| spray_texel(&leaves, size, x, y, [112.0, 140.0, 60.0]))
}

/// Returns a twig of thin needles, transparent elsewhere.
pub fn needle_spray(size: u32) -> TexelImage {
    let needles: Vec<_> = (0..44)
        .map(|i| {
            let up = (i / 2) as f32 / 22.0;
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let (s, c) = sin_cos(side * (0.95 - 0.45 * up));
            let length = 0.46 * (1.0 - 0.5 * up) + 0.04 * hash_unit(i);
            Leaf { foot: [0.5, 0.02 + 0.78 * up], along: [s, c], length, width: 0.016 }
        })
        .collect();
    paint(size, |x, y| spray_texel(&needles, size, x, y, [86.0, 122.0, 78.0]))
}

/// A leaf: a pointed oval that extends from `foot` in the unit direction `along`. Coordinates are in the unit square,
/// with y up.
struct Leaf {
    foot: [f32; 2],
    along: [f32; 2],
    length: f32,
    width: f32,
}

impl Leaf {
    /// Returns a point's position across the leaf, −1 to 1 from edge to edge; `None` outside the leaf.
    fn across(&self, x: f32, y: f32) -> Option<f32> {
        let (dx, dy) = (x - self.foot[0], y - self.foot[1]);
        let along = (dx * self.along[0] + dy * self.along[1]) / self.length;
        let across = dx * self.along[1] - dy * self.along[0];
        let half = self.width * 4.0 * along * (1.0 - along) * (1.25 - 0.5 * along);
        (along > 0.0 && along < 1.0 && across.abs() < half).then(|| across / half)
    }
}

fn spray_texel(leaves: &[Leaf], size: u32, x: u32, y: u32, color: [f32; 3]) -> [u8; 4] {
    let (u, v) = ((x as f32 + 0.5) / size as f32, 1.0 - (y as f32 + 0.5) / size as f32);
    let leaf = leaves.iter().enumerate().rev().find_map(|(i, l)| l.across(u, v).map(|a| (i, a)));
    let twig = (u - 0.5).abs() < 0.008 && v < 0.85;
    // Transparent texels keep a leaf's colour, so that filtering does not blend in another one.
    let (shade, alpha) = match leaf {
        Some((i, across)) => (1.0 + 0.25 * (hash_unit(i as u32) - 0.5) - 0.18 * (1.0 - across.abs()), 255),
        None => (0.75, if twig { 255 } else { 0 }),
    };
    let [r, g, b, _] = opaque(color.map(|c| c * shade));
    [r, g, b, alpha]
}
