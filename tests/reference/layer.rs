//! Albedo of the dielectric's surface, by Schlick's Fresnel term: directional, and averaged over directions.
//!
//! With F(c) = f0 (1 − w) + f90 w, w = (1 − c)⁵, the directional albedo of the surface is linear in f0 and f90:
//! E(μ) = f0 a(μ) + f90 b(μ). Both are tabulated over √α and ∛μ and interpolated by cubics; the quadrature is over
//! visible normals.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::LazyLock;

use glam::{DVec2, DVec3};

use super::microfacet::{Ggx, reflect};

/// α below which facets are a mirror.
pub const SMOOTH_ALPHA: f64 = 1e-4;

const SIDE: usize = 112;
/// Steps in radius and azimuth. Only half of the azimuths are needed, because the other half mirrors it.
const QUADRATURE: [usize; 2] = [256, 24];

/// Returns (1 − c)⁵ of Schlick (1994).
pub fn schlick_weight(cosine: f64) -> f64 {
    (1.0 - cosine).clamp(0.0, 1.0).powi(5)
}

/// Values of a and b at one roughness.
struct Row {
    at: Vec<DVec2>,
    mean: DVec2,
}

static TABLE: LazyLock<Vec<Row>> = LazyLock::new(|| {
    let row = |i: usize| Ggx::even(alpha_of(i));
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let every_nth = |from: usize| (from..SIDE).step_by(threads).map(|i| (i, tabulate(row(i)))).collect::<Vec<_>>();
    let mut rows: Vec<_> = std::thread::scope(|scope| {
        let parts: Vec<_> = (0..threads).map(|from| scope.spawn(move || every_nth(from))).collect();
        parts.into_iter().flat_map(|part| part.join().expect("no panic in arithmetic")).collect()
    });
    rows.sort_by_key(|(i, _)| *i);
    rows.into_iter().map(|(_, row)| row).collect()
});

fn alpha_of(i: usize) -> f64 {
    let low = SMOOTH_ALPHA.sqrt();
    (low + (1.0 - low) * i as f64 / (SIDE - 1) as f64).powi(2)
}

fn tabulate(facets: Ggx) -> Row {
    let mu = |j: usize| (j as f64 / (SIDE - 1) as f64).powi(3);
    let at: Vec<_> = (0..SIDE).map(|j| integrate(facets, mu(j).max(1e-9))).collect();
    let mut row = Row { at, mean: DVec2::ZERO };
    let steps = 4 * SIDE;
    for k in 0..steps {
        // ∫ 2 μ E dμ with μ = x³.
        let x = (k as f64 + 0.5) / steps as f64;
        row.mean += cubic(|j| row.at[j], x * (SIDE - 1) as f64) * (6.0 * x.powi(5) / steps as f64);
    }
    row
}

/// Integrates a and b by the midpoint rule over the disc for sampling visible normals.
pub fn integrate(facets: Ggx, mu: f64) -> DVec2 {
    let v = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
    let mut sum = DVec2::ZERO;
    for i in 0..QUADRATURE[0] {
        // The radius is a sine. Steps are finer towards the rim, where facets turn fastest.
        let from_rim = 1.0 - (i as f64 + 0.5) / QUADRATURE[0] as f64;
        let (cos, sin) = (FRAC_PI_2 * from_rim * from_rim).sin_cos();
        for k in 0..QUADRATURE[1] {
            let turn = 0.5 * (k as f64 + 0.5) / QUADRATURE[1] as f64 - 0.25;
            let h = facets.sample(v, [sin * sin, turn]);
            let l = reflect(v, h);
            if l.z > 0.0 {
                let w = schlick_weight(v.dot(h));
                // G2 / G1: the visible fraction of the facets that v sees.
                let lit = facets.visibility(v, l) * 4.0 * v.z * l.z / facets.masking(v);
                sum += DVec2::new(1.0 - w, w) * (lit * 2.0 * sin * cos * PI * from_rim);
            }
        }
    }
    sum / (QUADRATURE[0] * QUADRATURE[1]) as f64
}

/// Interpolates by Catmull–Rom through the four entries around `place`; parabolas extend the ends.
fn cubic(at: impl Fn(usize) -> DVec2, place: f64) -> DVec2 {
    let first = (place.floor().max(0.0) as usize).min(SIDE - 2);
    let t = place - first as f64;
    let [b, c] = [at(first), at(first + 1)];
    let (below, above) = ((first > 0).then(|| at(first - 1)), (first + 2 < SIDE).then(|| at(first + 2)));
    let a = below.unwrap_or_else(|| 3.0 * (b - c) + at(first + 2));
    let d = above.unwrap_or_else(|| 3.0 * (c - b) + a);
    let (slope_b, slope_c) = ((c - a) / 2.0, (d - b) / 2.0);
    let (t2, t3) = (t * t, t * t * t);
    b * (2.0 * t3 - 3.0 * t2 + 1.0) + slope_b * (t3 - 2.0 * t2 + t) + c * (3.0 * t2 - 2.0 * t3) + slope_c * (t3 - t2)
}

fn alpha_place(alpha: f64) -> f64 {
    let low = SMOOTH_ALPHA.sqrt();
    (alpha.sqrt() - low) / (1.0 - low) * (SIDE - 1) as f64
}

/// Returns E(μ) of the surface: the fraction of light that it reflects, for light from a direction at that cosine.
pub fn albedo(alpha: f64, f0: f64, f90: f64, mu: f64) -> f64 {
    let parts = if alpha < SMOOTH_ALPHA {
        let w = schlick_weight(mu);
        DVec2::new(1.0 - w, w)
    } else {
        let place = mu.clamp(0.0, 1.0).cbrt() * (SIDE - 1) as f64;
        cubic(|i| cubic(|j| TABLE[i].at[j], place), alpha_place(alpha))
    };
    parts.dot(DVec2::new(f0, f90))
}

/// Returns 2 ∫ E(μ) μ dμ.
pub fn mean_albedo(alpha: f64, f0: f64, f90: f64) -> f64 {
    // ∫ 2 μ (1 − μ)⁵ dμ = 1/21.
    let smooth = DVec2::new(20.0 / 21.0, 1.0 / 21.0);
    let parts = if alpha < SMOOTH_ALPHA { smooth } else { cubic(|i| TABLE[i].mean, alpha_place(alpha)) };
    parts.dot(DVec2::new(f0, f90))
}
