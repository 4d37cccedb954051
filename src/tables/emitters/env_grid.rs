//! The grid for importance sampling of an environment image. Cells hold luminance times the sine of the polar angle at
//! their centres, and are interpolated bilinearly like the image. With one cell per texel, the density therefore
//! follows the luminance on the sphere, however small a sun is.

use crate::image::RgbImage;
use crate::layout::EnvCell;
use crate::tables::alias;
use crate::tables::color::luminance;

/// Maximum number of cells: 2^23 of 16 bytes are 128 MiB. Texels of larger images share cells.
pub(super) const MOST_CELLS: usize = 1 << 23;

pub(super) struct EnvGrid {
    pub width: u32,
    pub height: u32,
    /// Alias table over `width` × (`height` + 1) patches between the centres of cells. Patch (x, y) lies between the
    /// centres of cells (x, y − 1) and (x + 1, y), where columns wrap and rows are clamped. Its entry also holds the
    /// density at the centre of cell (x, y).
    pub cells: Vec<EnvCell>,
}

/// Builds the grid of an image; `None` for an image without light.
pub(super) fn build(image: &RgbImage) -> Option<EnvGrid> {
    build_within(image, MOST_CELLS)
}

fn build_within(image: &RgbImage, most_cells: usize) -> Option<EnvGrid> {
    let (w, h) = (image.extent.width as usize, image.extent.height as usize);
    let share = (1..).find(|k| w.div_ceil(*k) * h.div_ceil(*k) <= most_cells)?;
    let (gw, gh) = (w.div_ceil(share), h.div_ceil(share));
    let columns = overlaps(w, gw);
    let mut values = vec![0.0f64; gw * gh];
    for (y, rows) in overlaps(h, gh).iter().enumerate() {
        for (x, columns) in columns.iter().enumerate() {
            let l = luminance(image.pixels[y * w + x].into()).max(0.0);
            for (row, part_y) in rows {
                for (column, part_x) in columns {
                    values[row * gw + column] += l * part_x * part_y;
                }
            }
        }
    }
    for (y, row) in values.chunks_mut(gw).enumerate() {
        let sin_theta = (std::f64::consts::PI * (y as f64 + 0.5) / gh as f64).sin();
        row.iter_mut().for_each(|v| *v *= sin_theta);
    }
    // All patches have the same size, except in the first and the last row, where half of each lies beyond a pole.
    let at = |x: usize, y: usize| values[y.min(gh - 1) * gw + x % gw];
    let patch = |x: usize, y: usize| {
        let size = if y == 0 || y == gh { 0.125 } else { 0.25 };
        let above = y.saturating_sub(1);
        size * (at(x, above) + at(x + 1, above) + at(x, y) + at(x + 1, y))
    };
    let weights: Vec<f64> = (0..gw * (gh + 1)).map(|i| patch(i % gw, i / gw)).collect();
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let density = (gw * gh) as f64 / total;
    let cell = |(i, e): (usize, &alias::Entry)| {
        let density = (at(i % gw, i / gw) * density) as f32;
        EnvCell { keep: e.keep, alias_index: e.alias, density, ..EnvCell::default() }
    };
    let cells = alias::table(&weights).iter().enumerate().map(cell).collect();
    Some(EnvGrid { width: gw as u32, height: gh as u32, cells })
}

/// Returns, for each of `fine` texels, the one or two of `coarse` cells that it overlaps, and the fraction of each cell
/// that it fills. Every overlap counts, so that the density is positive wherever there is light.
fn overlaps(fine: usize, coarse: usize) -> Vec<Vec<(usize, f64)>> {
    let cells = |i: usize| {
        // In units of 1 / (fine · coarse).
        let (begin, end) = (i * coarse, (i + 1) * coarse);
        (begin / fine..end.div_ceil(fine))
            .map(move |c| {
                let inside = end.min((c + 1) * fine) - begin.max(c * fine);
                (c, inside as f64 / fine as f64)
            })
            .collect()
    };
    (0..fine).map(cells).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;

    #[test]
    fn texels_fill_all_cells_that_they_overlap_evenly() {
        for (fine, coarse) in [(7, 7), (8, 4), (7, 3), (10, 9), (5, 1)] {
            let mut filled = vec![0.0; coarse];
            for (i, cells) in overlaps(fine, coarse).iter().enumerate() {
                let sum: f64 = cells.iter().map(|c| c.1).sum();
                // A texel's overlaps add up to its width in cells.
                assert!((sum - coarse as f64 / fine as f64).abs() < 1e-12, "{fine} on {coarse}, texel {i}: {cells:?}");
                cells.iter().for_each(|&(c, part)| filled[c] += part);
            }
            assert!(filled.iter().all(|f| (f - 1.0f64).abs() < 1e-12), "{fine} on {coarse}: {filled:?}");
        }
    }

    #[test]
    fn texel_in_a_shared_cell_keeps_its_light() {
        let mut image = RgbImage::filled(Extent::new(64, 32), [0.0; 3]);
        image.pixels[10 * 64 + 20] = [5.0; 3];
        let grid = build_within(&image, 500).unwrap();
        assert!(grid.width * grid.height <= 500);
        let [x, y] = [20 * grid.width / 64, 10 * grid.height / 32];
        assert!(grid.cells[(y * grid.width + x) as usize].density > 0.0);
        let mean = grid.cells[..(grid.width * grid.height) as usize].iter().map(|c| f64::from(c.density)).sum::<f64>()
            / f64::from(grid.width * grid.height);
        assert!((mean - 1.0).abs() < 1e-5, "{mean}");
    }

    #[test]
    fn image_without_light_has_no_grid() {
        assert!(build(&RgbImage::filled(Extent::new(4, 2), [0.0; 3])).is_none());
    }
}
