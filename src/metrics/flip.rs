//! FLIP (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström, Fairchild 2020, "FLIP: A Difference Evaluator for
//! Alternating Images", Proc. ACM Comput. Graph. Interact. Tech. 3(2), 15): the difference that a viewer notices when
//! flipping between two images on a screen, 0 (none) … 1 per pixel. All constants are from that paper.
//!
//! Values are sRGB-encoded display values, 0 … 1. Filters repeat the border pixels outside the image.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use super::convolve::{across, down};
use crate::image::Extent;
use crate::image::display::{linear_from_srgb, srgb_from_linear};

/// Angular resolution of the paper's viewer, 0.7 m away from a screen that is 0.7 m and 3840 pixels wide.
pub const PIXELS_PER_DEGREE: f64 = 3840.0 * PI / 180.0;

/// Exponents of the colour difference and of the feature difference.
const COLOUR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
/// Colour differences up to this fraction of the largest one map to the fraction [`SHARE_BELOW_KNEE`] of the range.
const KNEE: f64 = 0.4;
const SHARE_BELOW_KNEE: f64 = 0.95;
/// Width of the detected edges and points in degrees.
const FEATURE_WIDTH_DEG: f64 = 0.082;

/// Gaussians of the contrast sensitivity functions: pairs of amplitude a and width b, b in degrees².
const ACHROMATIC: &[(f64, f64)] = &[(1.0, 0.0047)];
const RED_GREEN: &[(f64, f64)] = &[(1.0, 0.0053)];
const BLUE_YELLOW: &[(f64, f64)] = &[(34.1, 0.04), (13.5, 0.025)];
/// Largest b of these Gaussians, degrees². The radius of all filters is three standard deviations of that Gaussian.
const WIDEST: f64 = 0.04;

type Plane = Vec<f64>;

/// Returns the FLIP of each pixel, row-major. The images must have at least one pixel.
pub fn flip_map(extent: Extent, r: &[[f64; 3]], a: &[[f64; 3]]) -> Vec<f64> {
    let [r, a] = [r, a].map(|shown| Seen::new(extent, shown));
    let scale = Redistribution::new();
    let colours = r.colours.iter().zip(&a.colours).map(|(r, a)| scale.apply(hyab(r, a)));
    let features = r.features.iter().zip(&a.features).map(|(r, a)| feature_difference(r, a));
    colours.zip(features).map(|(colour, feature)| colour.powf(1.0 - feature)).collect()
}

/// An image after spatial filtering, as the eye perceives it.
struct Seen {
    /// L*, and Hunt-adjusted a* and b*, after contrast sensitivity filtering.
    colours: Vec<[f64; 3]>,
    /// Magnitudes of edges and of points.
    features: Vec<[f64; 2]>,
}

impl Seen {
    fn new(extent: Extent, shown: &[[f64; 3]]) -> Self {
        let width = extent.width as usize;
        let opponent = opponent_planes(shown);
        let features = features(width, &opponent[0]);
        Self { colours: filtered(width, opponent).map(hunt_lab).collect(), features }
    }
}

/// Returns display values after FLIP's contrast sensitivity filters, at [`PIXELS_PER_DEGREE`]: the image without the
/// detail that the eye does not resolve.
pub fn perceived(extent: Extent, shown: &[[f64; 3]]) -> Vec<[f64; 3]> {
    filtered(extent.width as usize, opponent_planes(shown)).map(|linear| linear.map(srgb_from_linear)).collect()
}

/// Returns luminance, red-green and blue-yellow of display values.
fn opponent_planes(shown: &[[f64; 3]]) -> [Plane; 3] {
    let opponent: Vec<[f64; 3]> = shown.iter().map(|p| opponent_from_linear(p.map(linear_from_srgb))).collect();
    [0, 1, 2].map(|c| opponent.iter().map(|p| p[c]).collect())
}

/// Returns linear colours, 0 … 1, after contrast sensitivity filtering.
fn filtered(width: usize, [luminance, red_green, blue_yellow]: [Plane; 3]) -> impl Iterator<Item = [f64; 3]> {
    let blurred =
        [(luminance, ACHROMATIC), (red_green, RED_GREEN), (blue_yellow, BLUE_YELLOW)].map(|(p, g)| blur(width, &p, g));
    (0..blurred[0].len()).map(move |i| {
        let linear = linear_from_opponent([0, 1, 2].map(|c| blurred[c][i]));
        linear.map(|c| c.clamp(0.0, 1.0))
    })
}

/// Linear sRGB to XYZ relative to white, so that rows sum to 1. Exact for the primaries of sRGB (IEC 61966-2-1) and D65
/// at (0.31271, 0.32902).
const XYZ_FROM_LINEAR: [[f64; 3]; 3] = {
    let x = [10_135_552.0, 8_788_810.0, 4_435_075.0];
    let y = [2_613_072.0, 8_788_810.0, 887_015.0];
    let z = [1_425_312.0, 8_788_810.0, 70_074_185.0];
    [over_sum(x), over_sum(y), over_sum(z)]
};

const fn over_sum(row: [f64; 3]) -> [f64; 3] {
    let sum = row[0] + row[1] + row[2];
    [row[0] / sum, row[1] / sum, row[2] / sum]
}

fn xyz_from_linear(linear: [f64; 3]) -> [f64; 3] {
    XYZ_FROM_LINEAR.map(|row| row[0] * linear[0] + row[1] * linear[1] + row[2] * linear[2])
}

/// Returns luminance, red-green and blue-yellow opponent channels: Y, X − Y and Y − Z, relative to white.
///
/// The paper filters in YCxCz. Its channels are affine functions of these, and filters whose weights sum to 1 commute
/// with affine functions.
fn opponent_from_linear(linear: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = xyz_from_linear(linear);
    [y, x - y, y - z]
}

fn linear_from_opponent([luminance, red_green, blue_yellow]: [f64; 3]) -> [f64; 3] {
    let xyz = [luminance + red_green, luminance, luminance - blue_yellow];
    LINEAR_FROM_XYZ.map(|row| row[0] * xyz[0] + row[1] * xyz[1] + row[2] * xyz[2])
}

const LINEAR_FROM_XYZ: [[f64; 3]; 3] = inverse(XYZ_FROM_LINEAR);

/// Inverts a matrix by its cofactors.
const fn inverse(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let mut cofactors = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        let (row, column) = (i / 3, i % 3);
        let (r1, r2, c1, c2) = ((row + 1) % 3, (row + 2) % 3, (column + 1) % 3, (column + 2) % 3);
        cofactors[column][row] = m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1];
        i += 1;
    }
    let determinant = m[0][0] * cofactors[0][0] + m[0][1] * cofactors[1][0] + m[0][2] * cofactors[2][0];
    let mut i = 0;
    while i < 9 {
        cofactors[i / 3][i % 3] /= determinant;
        i += 1;
    }
    cofactors
}

/// Returns CIELAB (CIE 15:2004) with a* and b* times L*/100, since bright colours differ more than dark ones (Hunt).
fn hunt_lab(linear: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let curve = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = xyz_from_linear(linear).map(curve);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// Returns the HyAB distance (Abasi, Amani Tehran, Fairchild 2020): city block between lightness and chroma, Euclidean
/// within chroma.
fn hyab(p: &[f64; 3], q: &[f64; 3]) -> f64 {
    (p[0] - q[0]).abs() + (p[1] - q[1]).hypot(p[2] - q[2])
}

/// Maps HyAB distances to 0 … 1.
struct Redistribution {
    /// Distance between green and blue, the colours furthest apart, to the power of [`COLOUR_EXPONENT`].
    largest: f64,
}

impl Redistribution {
    fn new() -> Self {
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(hunt_lab);
        Self { largest: hyab(&green, &blue).powf(COLOUR_EXPONENT) }
    }

    fn apply(&self, distance: f64) -> f64 {
        let (distance, knee) = (distance.powf(COLOUR_EXPONENT), KNEE * self.largest);
        if distance < knee {
            distance * SHARE_BELOW_KNEE / knee
        } else {
            SHARE_BELOW_KNEE + (distance - knee) / (self.largest - knee) * (1.0 - SHARE_BELOW_KNEE)
        }
    }
}

/// Filters a channel by its contrast sensitivity: a sum of Gaussians, normalised to a total weight of 1.
fn blur(width: usize, plane: &[f64], gaussians: &[(f64, f64)]) -> Plane {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let bell = |b: f64| -> Vec<f64> {
        (-radius..=radius).map(|i| (-(PI * f64::from(i) / PIXELS_PER_DEGREE).powi(2) / b).exp()).collect()
    };
    let mut blurred = vec![0.0; plane.len()];
    let mut weight_sum = 0.0;
    for &(a, b) in gaussians {
        let (kernel, amplitude) = (bell(b), a * (PI / b).sqrt());
        weight_sum += amplitude * kernel.iter().sum::<f64>().powi(2);
        for (sum, v) in blurred.iter_mut().zip(down(width, &across(width, plane, &kernel), &kernel)) {
            *sum += amplitude * v;
        }
    }
    blurred.iter_mut().for_each(|v| *v /= weight_sum);
    blurred
}

/// Returns the magnitudes of the first (edges) and second (points) derivatives of luminance.
fn features(width: usize, luminance: &[f64]) -> Vec<[f64; 2]> {
    let sigma = 0.5 * FEATURE_WIDTH_DEG * PIXELS_PER_DEGREE;
    let radius = (3.0 * sigma).ceil() as i32;
    let kernel = |derivative: fn(f64) -> f64| -> Vec<f64> {
        let at = |i: i32| f64::from(i) / sigma;
        (-radius..=radius).map(|i| derivative(at(i)) * (-at(i).powi(2) / 2.0).exp()).collect()
    };
    let (bell, edge, point) = (kernel(|_| 1.0), kernel(|x| -x), kernel(|x| x * x - 1.0));
    let [bell, edge, point] = [bell, edge, point].map(sides_sum_to_one);
    let smooth = across(width, luminance, &bell);
    let along_x = |kernel: &[f64]| down(width, &across(width, luminance, kernel), &bell);
    let [edge_x, point_x] = [&edge, &point].map(|k| along_x(k));
    let [edge_y, point_y] = [&edge, &point].map(|k| down(width, &smooth, k));
    (0..luminance.len()).map(|i| [edge_x[i].hypot(edge_y[i]), point_x[i].hypot(point_y[i])]).collect()
}

/// Scales positive weights to a sum of 1 and negative ones to −1.
fn sides_sum_to_one(mut kernel: Vec<f64>) -> Vec<f64> {
    let positive: f64 = kernel.iter().filter(|&&w| w > 0.0).sum();
    let negative: f64 = kernel.iter().filter(|&&w| w < 0.0).sum();
    kernel.iter_mut().for_each(|w| *w /= if *w > 0.0 { positive } else { -negative });
    kernel
}

/// Returns the larger of the differences in edges and in points, 0 … 1.
fn feature_difference(r: &[f64; 2], a: &[f64; 2]) -> f64 {
    let larger = (r[0] - a[0]).abs().max((r[1] - a[1]).abs());
    (FRAC_1_SQRT_2 * larger).powf(FEATURE_EXPONENT).min(1.0)
}
