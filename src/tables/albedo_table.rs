//! Directional albedo of GGX reflection and of sheen, tabulated for `reflectance.inc.wgsl`.
//!
//! With Schlick's Fresnel term, a microfacet surface's directional albedo is f0 · a + f90 · b, where a and b depend
//! only on the viewer's cosine and on roughness. The albedo of a white sheen, e, does as well.

use std::f64::consts::PI;
use std::sync::LazyLock;

use crate::layout::{ALBEDO_GRID, LEAST_SHEEN_ROUGHNESS, SMOOTH};

const GRID: usize = ALBEDO_GRID as usize;
/// Number of strata per dimension. Each node of the table is integrated with `STRATA`² samples.
const STRATA: usize = 16;

/// Number of steps in each of two dimensions over which the albedo of sheen is integrated.
const SHEEN_STEPS: usize = 48;

/// Returns the table of (a, b, e). It has one row per perceptual roughness, with one node per cosine, or for e per square
/// root of the cosine, since e rises steeply near grazing angles; all go from 0 to 1. After these rows follow their means
/// over directions, one per roughness.
pub fn table() -> &'static [[f32; 3]] {
    static TABLE: LazyLock<Vec<[f32; 3]>> = LazyLock::new(made);
    &TABLE
}

fn made() -> Vec<[f32; 3]> {
    let node = |i: usize| i as f64 / (GRID - 1) as f64;
    let entry = |cosine: f64, roughness: f64| {
        let [a, b] = albedo(cosine, roughness.powi(2));
        [a, b, sheen_albedo(cosine.powi(2), roughness)]
    };
    let rows: Vec<Vec<[f64; 3]>> =
        (0..GRID).map(|row| (0..GRID).map(|column| entry(node(column), node(row))).collect()).collect();
    let means = rows.iter().map(|row| mean(row));
    rows.iter().flatten().copied().chain(means).map(|ab| ab.map(|x| x as f32)).collect()
}

/// Returns the mean of a row over directions: 2 ∫ e(μ) μ dμ, where e interpolates the nodes linearly, as the shader
/// does.
fn mean(row: &[[f64; 3]]) -> [f64; 3] {
    let h = 1.0 / (GRID - 1) as f64;
    let mut sum = [0.0; 3];
    for (i, pair) in row.windows(2).enumerate() {
        let (x0, x1) = (i as f64 * h, (i + 1) as f64 * h);
        for (k, sum) in sum.iter_mut().enumerate() {
            *sum += h * (pair[0][k] * (2.0 * x0 + x1) + pair[1][k] * (x0 + 2.0 * x1)) / 3.0;
        }
    }
    sum
}

/// Returns (a, b) for the viewer's cosine and the GGX parameter `alpha`. Integrates over visible normals (Heitz 2018),
/// each weighted by G2 / G1.
fn albedo(cosine: f64, alpha: f64) -> [f64; 2] {
    if alpha < f64::from(SMOOTH) {
        let weight = (1.0 - cosine).powi(5);
        return [1.0 - weight, weight];
    }
    let nv = cosine.max(1e-4);
    let v = [(1.0 - nv * nv).sqrt(), nv];
    let a2 = alpha * alpha;
    let mut sum = [0.0; 2];
    for i in 0..STRATA * STRATA {
        let u = [(i % STRATA) as f64 + 0.5, (i / STRATA) as f64 + 0.5].map(|x| x / STRATA as f64);
        let [hx, hz] = visible_normal(v, alpha, u);
        let vh = (v[0] * hx + v[1] * hz).clamp(0.0, 1.0);
        let nl = 2.0 * vh * hz - nv;
        if nl > 0.0 {
            let lambda = |n: f64| (a2 + n * n * (1.0 - a2)).sqrt();
            let shadowing = nl * (nv + lambda(nv)) / (nl * lambda(nv) + nv * lambda(nl));
            let weight = (1.0 - vh).powi(5);
            sum[0] += shadowing * (1.0 - weight);
            sum[1] += shadowing * weight;
        }
    }
    sum.map(|s| s / (STRATA * STRATA) as f64)
}

/// Returns the albedo of a white sheen for the viewer's cosine and perceptual roughness: the integral of
/// `sheen_scattering` in `bsdf.inc.wgsl` times the light's cosine, before it is scaled. The light's polar angle has finer steps
/// towards the horizon, where the lobe is narrow.
fn sheen_albedo(cosine: f64, roughness: f64) -> f64 {
    let alpha = roughness.max(f64::from(LEAST_SHEEN_ROUGHNESS)).powi(2);
    let nv = cosine.max(1e-3);
    let sin_v = (1.0 - nv * nv).sqrt();
    let mut sum = 0.0;
    for i in 0..SHEEN_STEPS * SHEEN_STEPS {
        let [x, y] = [i % SHEEN_STEPS, i / SHEEN_STEPS].map(|k| (k as f64 + 0.5) / SHEEN_STEPS as f64);
        let (nl, phi) = (x * x, PI * y);
        let sin_l = (1.0 - nl * nl).sqrt();
        let [hx, hy, hz] = [sin_v + sin_l * phi.cos(), sin_l * phi.sin(), nv + nl];
        let sin2 = (hx * hx + hy * hy) / (hx * hx + hy * hy + hz * hz);
        let density = (2.0 + 1.0 / alpha) * sin2.powf(0.5 / alpha) / (2.0 * PI);
        let visibility = 1.0 / ((1.0 + fuzz(nv, alpha) + fuzz(nl, alpha)) * 4.0 * nv * nl);
        // dω = dnl dφ, dnl = 2 x dx, and φ covers half of its range.
        sum += density * visibility * nl * 2.0 * x * 2.0 * PI;
    }
    sum / (SHEEN_STEPS * SHEEN_STEPS) as f64
}

/// Returns Λ of the sheen's shadowing at a cosine (Estevez & Kulla, "Production Friendly Microfacet Sheen BRDF", 2017).
fn fuzz(cosine: f64, alpha: f64) -> f64 {
    let t = (1.0 - alpha).powi(2);
    let mix = |rough: f64, smooth: f64| rough + (smooth - rough) * t;
    let l = |x: f64| {
        let (a, b, c) = (mix(21.5473, 25.3245), mix(3.82987, 3.32435), mix(0.19823, 0.16801));
        a / (1.0 + b * x.powf(c)) + mix(-1.97760, -1.27393) * x + mix(-4.32054, -4.85967)
    };
    if cosine < 0.5 { l(cosine).exp() } else { (2.0 * l(0.5) - l(1.0 - cosine)).exp() }
}

/// Samples a visible normal (Dupuy & Benyoub 2023). `v` and the result are vectors of two components: one in the
/// surface plane, towards the viewer, and one along the surface normal. `u` holds two random numbers.
fn visible_normal(v: [f64; 2], alpha: f64, u: [f64; 2]) -> [f64; 2] {
    let (x, z) = (v[0] * alpha, v[1]);
    let length = x.hypot(z);
    let (x, z) = (x / length, z / length);
    let phi = 2.0 * PI * u[0];
    let lift = (1.0 - u[1]) * (1.0 + z) - z;
    let sin = (1.0 - lift * lift).max(0.0).sqrt();
    let h = [(sin * phi.cos() + x) * alpha, sin * phi.sin() * alpha, lift + z];
    let length = (h[0] * h[0] + h[1] * h[1] + h[2] * h[2]).sqrt();
    [h[0] / length, h[2] / length]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layer_albedo_never_exceeds_one() {
        for [a, b, e] in table() {
            // The shader scales sheen down where it exceeds 1.
            assert!(*a >= 0.0 && *b >= 0.0 && a + b <= 1.0 + 1e-6 && (0.0..3.0).contains(e), "{a} {b} {e}");
        }
    }

    #[test]
    fn smooth_layer_has_the_albedo_of_schlick() {
        let table = table();
        assert_eq!(table[GRID - 1][..2], [1.0, 0.0]);
        assert_eq!(table[0][..2], [0.0, 1.0]);
        // ∫ 2 μ (1 − μ)^5 dμ = 1 / 21. Linear interpolation of this convex function adds a little.
        let excess = table[GRID * GRID][1] - 1.0 / 21.0;
        assert!((0.0..2e-3).contains(&excess), "{excess}");
    }

    #[test]
    fn rough_white_metal_matches_single_scattering() {
        // Height-correlated GGX at alpha 1 reflects 0.40916 ± 0.00006 of uniform light: plain Monte Carlo over eight
        // million pairs of cosine-distributed directions, without a table or visible normals.
        let mean = table()[GRID * GRID + GRID - 1];
        assert!((mean[0] + mean[1] - 0.40916).abs() < 5e-4, "{mean:?}");
    }
}
