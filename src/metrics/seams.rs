//! Visibility of stripe seams: the ratio of the error near stripe edges to the error elsewhere.

use serde::Serialize;

use super::{Pair, error};

/// Number of rows on either side of an edge that count as near it.
pub const NEAR_ROWS: u32 = 4;

/// RMSE of linear radiance near stripe edges and elsewhere; `None` if undefined.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeamError {
    /// RMSE within [`NEAR_ROWS`] of an edge; `None` without an edge in the image.
    pub near_rmse: Option<f64>,
    /// RMSE of the other rows; `None` if all rows are near an edge.
    pub elsewhere_rmse: Option<f64>,
    /// Ratio of near to elsewhere: 1 if seams are invisible. `None` if the error elsewhere is 0.
    pub ratio: Option<f64>,
}

impl Pair {
    /// Measures the error near stripe edges. `edges` holds, for each edge, the row just below it.
    pub fn seam_error(&self, edges: &[u32]) -> SeamError {
        let is_near = |y: u32| edges.iter().any(|&edge| y < edge.saturating_add(NEAR_ROWS) && edge <= y + NEAR_ROWS);
        let rmse_of_rows = |wanted: bool| {
            let width = self.extent.width as usize;
            let [r, a] = [&self.reference, &self.image].map(|side| -> Vec<[f64; 3]> {
                let rows = side.radiance.chunks_exact(width).zip(self.extent.rows());
                rows.filter(|&(_, y)| is_near(y) == wanted).flat_map(|(row, _)| row).copied().collect()
            });
            (!r.is_empty()).then(|| error::rmse(&r, &a))
        };
        let [near_rmse, elsewhere_rmse] = [true, false].map(rmse_of_rows);
        let ratio = near_rmse.zip(elsewhere_rmse).and_then(|(n, e)| (e > 0.0).then_some(n / e));
        SeamError { near_rmse, elsewhere_rmse, ratio }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Extent, RgbImage};

    /// Returns a pair of 20 rows with an error of 0.3 in rows 6 … 13 and 0.1 elsewhere.
    fn pair() -> Pair {
        let reference = RgbImage::filled(Extent::new(3, 20), [1.0; 3]);
        let mut image = reference.clone();
        for (y, row) in image.pixels.chunks_exact_mut(3).enumerate() {
            row.fill([if (6..14).contains(&y) { 1.3 } else { 1.1 }; 3]);
        }
        Pair::new(&reference, &image, 0.0).unwrap()
    }

    /// Closed form: both regions are flat.
    #[test]
    fn near_is_four_rows_on_either_side_of_an_edge() {
        let seam = pair().seam_error(&[10]);
        assert!((seam.near_rmse.unwrap() - 0.3).abs() < 1e-6);
        assert!((seam.elsewhere_rmse.unwrap() - 0.1).abs() < 1e-6);
        assert!((seam.ratio.unwrap() - 3.0).abs() < 1e-5);
        for moved in [9, 11] {
            assert!(pair().seam_error(&[moved]).elsewhere_rmse.unwrap() > 0.11);
        }
    }

    #[test]
    fn seam_errors_without_rows_or_error_are_none() {
        let all_near = pair().seam_error(&[4, 10, 12, 16]);
        assert_eq!((all_near.elsewhere_rmse, all_near.ratio), (None, None));
        assert_eq!(pair().seam_error(&[]).near_rmse, None);
        assert_eq!(pair().seam_error(&[u32::MAX]).near_rmse, None);
        let right = RgbImage::filled(Extent::new(1, 30), [1.0; 3]);
        let seam = Pair::new(&right, &right, 0.0).unwrap().seam_error(&[15]);
        assert_eq!((seam.near_rmse, seam.ratio), (Some(0.0), None));
    }
}
