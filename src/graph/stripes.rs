//! A partition of an image's rows into one contiguous stripe per device, top to bottom.

use std::ops::Range;

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Stripes {
    /// `edges[i]..edges[i + 1]` are device i's rows.
    edges: Vec<u32>,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StripesError {
    #[error("{given} ratios for {devices} devices: give one per device")]
    Count { given: usize, devices: usize },
    #[error("ratio {0} is not usable: ratios are finite, not negative, and not all zero")]
    Value(f64),
}

impl Stripes {
    /// Divides rows in proportion to `weights`. Edges are rounded to the nearest row.
    pub fn from_weights(height: u32, weights: &[f64]) -> Result<Self, StripesError> {
        if let Some(&bad) = weights.iter().find(|w| !w.is_finite() || **w < 0.0) {
            return Err(StripesError::Value(bad));
        }
        let total: f64 = weights.iter().sum();
        if total <= 0.0 {
            return Err(StripesError::Value(total));
        }
        let mut sum = 0.0;
        let mut edges = vec![0];
        for w in weights {
            sum += w;
            edges.push((sum / total * f64::from(height)).round() as u32);
        }
        Ok(Self { edges })
    }

    pub fn even(height: u32, devices: usize) -> Self {
        let edges = (0..=devices as u64).map(|i| (u64::from(height) * i / devices as u64) as u32).collect();
        Self { edges }
    }

    /// Makes stripes from inner edges, each clamped to lie between the edge above and `height`.
    pub fn from_edges(height: u32, inner: &[u32]) -> Self {
        let mut edges = vec![0];
        for &e in inner {
            let above = edges[edges.len() - 1];
            edges.push(e.clamp(above, height));
        }
        edges.push(height);
        Self { edges }
    }

    /// See [`super::Assignment::renumbered`].
    pub(super) fn renumbered(&self, devices: &[usize], count: usize) -> Self {
        // The stripes of devices with smaller numbers lie above those of device d.
        let edge = |d: usize| self.edges[devices.iter().filter(|&&other| other < d).count()];
        Self { edges: (0..=count).map(edge).collect() }
    }

    pub fn devices(&self) -> usize {
        self.edges.len() - 1
    }

    pub fn height(&self) -> u32 {
        self.edges[self.edges.len() - 1]
    }

    /// Returns the rows of a device, which may be an empty range.
    pub fn rows(&self, device: usize) -> Range<u32> {
        self.edges[device]..self.edges[device + 1]
    }

    pub fn inner_edges(&self) -> &[u32] {
        &self.edges[1..self.edges.len() - 1]
    }

    pub fn iter(&self) -> impl Iterator<Item = (usize, Range<u32>)> + '_ {
        (0..self.devices()).map(|d| (d, self.rows(d))).filter(|(_, r)| !r.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stripes_cover_every_row_once() {
        for weights in [&[1.0][..], &[5.0, 1.0, 2.0], &[0.0, 1.0], &[1e-9, 1.0, 1e9]] {
            let s = Stripes::from_weights(181, weights).unwrap();
            let rows: Vec<u32> = (0..s.devices()).flat_map(|d| s.rows(d)).collect();
            assert_eq!(rows, (0..181).collect::<Vec<_>>(), "{weights:?}");
        }
    }

    #[test]
    fn rejects_unusable_ratios() {
        assert!(Stripes::from_weights(10, &[0.0, 0.0]).is_err());
        assert!(Stripes::from_weights(10, &[1.0, -1.0]).is_err());
        assert!(Stripes::from_weights(10, &[f64::NAN]).is_err());
    }

    #[test]
    fn dropped_devices_have_no_rows() {
        let s = Stripes::from_edges(10, &[4]).renumbered(&[1, 3], 5);
        let rows: Vec<_> = (0..5).map(|d| s.rows(d)).collect();
        assert_eq!(rows, [0..0, 0..4, 4..4, 4..10, 10..10]);
        assert_eq!(s.iter().collect::<Vec<_>>(), [(1, 0..4), (3, 4..10)]);
    }

    #[test]
    fn edges_out_of_order_are_bounded() {
        let s = Stripes::from_edges(10, &[7, 3, 99]);
        assert_eq!(s.inner_edges(), &[7, 7, 10]);
    }
}
