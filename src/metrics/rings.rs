//! Error by eccentricity, in rings around the gaze that span equal viewing angles (Andersson & Hansson 2020,
//! "Performance Optimizations for Foveated Real-Time Raytracing", section 3.6).
//!
//! The paper divides the range up to a `max_view_angle` that is chosen to cover the screen. Here that is the angle to
//! the farthest corner, so that every pixel is in a ring.

use serde::Serialize;

use super::{Pair, error, ssim};

/// Viewing conditions of an image: a pinhole with square pixels and the optical axis at the image's centre.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Viewing {
    /// Gaze point: x from the left and y from the top, as fractions of width and height, 0 … 1.
    pub gaze: [f64; 2],
    /// Vertical field of view, above 0 and below 180 degrees.
    pub yfov_deg: f64,
}

/// Errors of the pixels whose centres are from `inner_deg` up to `outer_deg` away from the gaze. They are `None` for a
/// ring without pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ring {
    pub inner_deg: f64,
    pub outer_deg: f64,
    pub pixels: usize,
    pub rmse: Option<f64>,
    pub relmse: Option<f64>,
    /// PSNR in dB; infinite if the images are equal.
    pub psnr: Option<f64>,
    /// Mean SSIM over the ring's pixels whose window lies inside the image; `None` without such pixels.
    pub ssim: Option<f64>,
    /// Mean over the ring of the whole image's FLIP map.
    pub flip: Option<f64>,
}

impl Pair {
    /// Returns the errors in `count` rings, from the gaze outwards. A `count` of 0 gives one ring.
    pub fn rings(&self, viewing: &Viewing, count: usize) -> Vec<Ring> {
        let count = count.max(1);
        let angles: Vec<f64> = self.eccentricities(viewing).collect();
        let farthest = self.farthest(viewing);
        let mut members = vec![Vec::new(); count];
        for (i, angle) in angles.into_iter().enumerate() {
            members[((angle / farthest * count as f64) as usize).min(count - 1)].push(i);
        }
        let bound_deg = |k: usize| (farthest * k as f64 / count as f64).to_degrees();
        let ssim = self.ssim();
        members.iter().enumerate().map(|(k, pixels)| self.ring(bound_deg(k), bound_deg(k + 1), pixels, &ssim)).collect()
    }

    /// Returns the angle in radians between the gaze and each pixel's centre, row-major.
    pub(super) fn eccentricities(&self, viewing: &Viewing) -> impl Iterator<Item = f64> {
        let (width, angle) = (self.extent.width as usize, self.angle_from_gaze(viewing));
        (0..self.extent.area()).map(move |i| angle((i % width) as f64 + 0.5, (i / width) as f64 + 0.5))
    }

    /// Returns the angle in radians between the gaze and the corner farthest from it.
    fn farthest(&self, viewing: &Viewing) -> f64 {
        let (width, height) = (f64::from(self.extent.width), f64::from(self.extent.height));
        let corners = [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)];
        let angle = self.angle_from_gaze(viewing);
        corners.into_iter().map(|(x, y)| angle(x, y)).fold(0.0, f64::max)
    }

    /// Returns a function that maps a point (x, y), in pixels from the top left corner, to its angle from the gaze in
    /// radians.
    fn angle_from_gaze(&self, viewing: &Viewing) -> impl Fn(f64, f64) -> f64 + use<> {
        let (width, height) = (f64::from(self.extent.width), f64::from(self.extent.height));
        let tan_half_yfov = (viewing.yfov_deg.to_radians() / 2.0).tan();
        // Coordinates are x to the right and y down, in units of the distance to the image plane.
        let ray = move |x: f64, y: f64| [x - width / 2.0, y - height / 2.0].map(|c| c * 2.0 * tan_half_yfov / height);
        let gaze = ray(viewing.gaze[0] * width, viewing.gaze[1] * height);
        move |x, y| angle(gaze, ray(x, y))
    }

    /// Returns the SSIM of each pixel, row-major; `None` where the SSIM window extends beyond the image.
    fn ssim(&self) -> Vec<Option<f64>> {
        let map = ssim::ssim_map(self.extent, &self.reference.shown, &self.image.shown);
        let width = self.extent.width as usize;
        let columns = width.saturating_sub(2 * ssim::MARGIN);
        let of = |i: usize| {
            let [x, y] = [i % width, i / width].map(|at| at.checked_sub(ssim::MARGIN));
            x.zip(y).filter(|(x, _)| *x < columns).and_then(|(x, y)| map.get(y * columns + x).copied())
        };
        (0..self.extent.area()).map(of).collect()
    }

    fn ring(&self, inner_deg: f64, outer_deg: f64, pixels: &[usize], ssim: &[Option<f64>]) -> Ring {
        let (r, a) = (&self.reference, &self.image);
        let [r, a, shown_r, shown_a] = [&r.radiance, &a.radiance, &r.shown, &a.shown]
            .map(|values| pixels.iter().map(|&i| values[i]).collect::<Vec<_>>());
        let if_any = |error: f64| (!pixels.is_empty()).then_some(error);
        let ssim: Vec<f64> = pixels.iter().filter_map(|&i| ssim[i]).collect();
        Ring {
            inner_deg,
            outer_deg,
            pixels: pixels.len(),
            rmse: if_any(error::rmse(&r, &a)),
            relmse: if_any(error::relmse(&r, &a)),
            psnr: if_any(error::psnr(&shown_r, &shown_a)),
            ssim: (!ssim.is_empty()).then(|| error::mean(ssim.iter().copied())),
            flip: if_any(error::mean(pixels.iter().map(|&i| self.flip[i]))),
        }
    }
}

/// Returns the angle in radians between rays through two points of the image plane at distance 1. Uses the cross
/// product, which is accurate for small angles.
fn angle([px, py]: [f64; 2], [qx, qy]: [f64; 2]) -> f64 {
    let cross = [py - qy, qx - px, px * qy - py * qx];
    let sine = cross.iter().map(|c| c * c).sum::<f64>().sqrt();
    sine.atan2(px * qx + py * qy + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::{Extent, RgbImage};

    fn pair_of(extent: Extent, image: impl Fn(u32, u32) -> f32) -> Pair {
        let reference = RgbImage::filled(extent, [1.0; 3]);
        Pair::new(&reference, &RgbImage::from_fn(extent, |x, y| [image(x, y); 3]), 0.0).unwrap()
    }

    /// Compares with closed forms for a square image with a field of view of 90 degrees. From the centre, the edges are
    /// 45 degrees away and the corners atan √2. From a corner, the opposite corner is acos(-1/3) away.
    #[test]
    fn rings_reach_the_farthest_corner_in_equal_steps() {
        let pair = pair_of(Extent::new(40, 40), |_, _| 1.5);
        for (gaze, farthest) in [([0.5; 2], 2f64.sqrt().atan()), ([0.0; 2], (-1f64 / 3.0).acos())] {
            let rings = pair.rings(&Viewing { gaze, yfov_deg: 90.0 }, 20);
            assert_eq!(rings.len(), 20);
            assert_eq!(rings.iter().map(|r| r.pixels).sum::<usize>(), 1600);
            for (k, ring) in rings.iter().enumerate() {
                assert!((ring.inner_deg - farthest.to_degrees() * k as f64 / 20.0).abs() < 1e-9);
                assert!((ring.outer_deg - ring.inner_deg - farthest.to_degrees() / 20.0).abs() < 1e-9);
                assert!(ring.pixels == 0 || (ring.rmse.unwrap() - 0.5).abs() < 1e-12);
            }
        }
    }

    /// Closed form: a ring from angle α to β around the axis covers π (tan²β − tan²α) of the image plane.
    #[test]
    fn ring_pixels_match_its_area() {
        let extent = Extent::new(600, 600);
        let rings = pair_of(extent, |_, _| 1.0).rings(&Viewing { gaze: [0.5; 2], yfov_deg: 60.0 }, 20);
        let plane_per_pixel = (2.0 * 30f64.to_radians().tan() / 600.0).powi(2);
        for ring in rings.iter().take_while(|r| r.outer_deg < 30.0) {
            let [inner, outer] = [ring.inner_deg, ring.outer_deg].map(|d| d.to_radians().tan());
            let area = std::f64::consts::PI * (outer * outer - inner * inner) / plane_per_pixel;
            assert!((ring.pixels as f64 / area - 1.0).abs() < 0.02, "{ring:?}, {area} expected");
        }
        assert!(rings.iter().all(|r| r.psnr.is_none_or(f64::is_infinite) && r.flip.is_none_or(|f| f == 0.0)));
    }

    #[test]
    fn error_lies_in_the_ring_of_its_pixel() {
        let pair = pair_of(Extent::new(64, 36), |x, y| if (x, y) == (16, 9) { 3.0 } else { 1.0 });
        let rings = pair.rings(&Viewing { gaze: [16.5 / 64.0, 9.5 / 36.0], yfov_deg: 70.0 }, 20);
        assert!(rings[0].rmse.unwrap() > 0.0 && rings[0].flip > rings[10].flip);
        assert!(rings[1..].iter().all(|r| r.rmse.is_none_or(|e| e == 0.0)));
    }

    /// The rings partition the windows, and a ring at the image's border has none.
    #[test]
    fn rings_divide_the_ssim_of_the_image() {
        let pair = pair_of(Extent::new(48, 30), |x, y| 0.5 + 0.3 * ((x * 7 + y * 13) % 5) as f32);
        let viewing = Viewing { gaze: [0.5; 2], yfov_deg: 60.0 };
        let windows = pair.ssim();
        let found = windows.iter().flatten().count();
        assert_eq!(found, (48 - 10) * (30 - 10));
        assert!(windows[5 * 48 + 5].is_some() && windows[5 * 48 + 42].is_some() && windows[5 * 48 + 43].is_none());
        assert!(windows[24 * 48 + 5].is_some() && windows[25 * 48 + 5].is_none() && windows[4 * 48 + 5].is_none());
        let whole = pair.errors().ssim.unwrap();
        assert!((windows.iter().flatten().sum::<f64>() / found as f64 - whole).abs() < 1e-12);
        assert!((pair.rings(&viewing, 1)[0].ssim.unwrap() - whole).abs() < 1e-12);
        let rings = pair.rings(&viewing, 20);
        assert!(rings[0].ssim.unwrap() < 1.0 && rings[19].ssim.is_none() && rings[19].flip.is_some());
    }

    #[test]
    fn rings_without_pixels_have_no_errors() {
        let rings = pair_of(Extent::new(1, 1), |_, _| 2.0).rings(&Viewing { gaze: [0.5; 2], yfov_deg: 70.0 }, 3);
        assert_eq!(rings.iter().map(|r| r.pixels).collect::<Vec<_>>(), [1, 0, 0]);
        assert!((rings[0].relmse.unwrap() - 1.0 / 1.01).abs() < 1e-12);
        assert_eq!((rings[1].rmse, rings[1].relmse, rings[1].psnr, rings[1].flip), (None, None, None, None));
        assert!(rings.iter().all(|r| r.ssim.is_none()));
    }
}
