//! Sheen of cloth: the distribution and the shadowing of Estevez & Kulla ("Production Friendly Microfacet Sheen BRDF",
//! 2017), as `KHR_materials_sheen` has them, and its albedo. Where the lobe would reflect more light than arrives, it is
//! scaled down, for the viewer and for the light.

use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

use glam::DVec3;

/// Lower bound of the perceptual roughness, as in the renderer: below it, nearly no direction is lit.
pub const LEAST_ROUGHNESS: f64 = 0.07;

/// Intervals of the table in roughness, and in the cube root of the cosine.
const SIDE: usize = 64;
/// Steps in the light's polar angle and in half of its azimuth.
const STEPS: [usize; 2] = [192, 64];

#[derive(Clone, Copy, Debug)]
pub struct Sheen {
    pub color: DVec3,
    /// Perceptual roughness, at least [`LEAST_ROUGHNESS`].
    pub roughness: f64,
}

impl Sheen {
    /// Returns the value of a white sheen for a light at cosine `nl`, with the cosine `nh` of the half vector.
    pub fn value(&self, nv: f64, nl: f64, nh: f64) -> f64 {
        self.unscaled(nv, nl, nh) / [nv, nl].map(|mu| self.unscaled_albedo(mu).max(1.0)).iter().product::<f64>()
    }

    fn unscaled(&self, nv: f64, nl: f64, nh: f64) -> f64 {
        let alpha = self.roughness * self.roughness;
        let distribution = (2.0 + 1.0 / alpha) * (1.0 - nh * nh).max(0.0).powf(0.5 / alpha) / TAU;
        distribution / (4.0 * nv * nl * (1.0 + lambda(nv, alpha) + lambda(nl, alpha)))
    }

    /// Returns a bound of the directional albedo of a white sheen at that cosine. It is the albedo itself where the lobe
    /// is not scaled.
    pub fn albedo(&self, mu: f64) -> f64 {
        self.unscaled_albedo(mu).min(1.0)
    }

    fn unscaled_albedo(&self, mu: f64) -> f64 {
        let x = mu.clamp(0.0, 1.0).cbrt() * SIDE as f64;
        let y = (self.roughness - LEAST_ROUGHNESS) / (1.0 - LEAST_ROUGHNESS) * SIDE as f64;
        let (i, j) = ((x as usize).min(SIDE - 1), (y as usize).min(SIDE - 1));
        let (fx, fy) = (x - i as f64, y - j as f64);
        let row = |j: usize| TABLE[j][i] * (1.0 - fx) + TABLE[j][i + 1] * fx;
        row(j) * (1.0 - fy) + row(j + 1) * fy
    }
}

fn lambda(mu: f64, alpha: f64) -> f64 {
    let [rough, smooth] =
        [[21.5473, 3.82987, 0.19823, -1.97760, -4.32054], [25.3245, 3.32435, 0.16801, -1.27393, -4.85967]];
    let weight = (1.0 - alpha) * (1.0 - alpha);
    let [a, b, c, d, e]: [f64; 5] = std::array::from_fn(|i| rough[i] * (1.0 - weight) + smooth[i] * weight);
    let fit = |x: f64| a / (1.0 + b * x.powf(c)) + d * x + e;
    if mu < 0.5 { fit(mu).exp() } else { (2.0 * fit(0.5) - fit(1.0 - mu)).exp() }
}

static TABLE: LazyLock<Vec<Vec<f64>>> = LazyLock::new(|| {
    let at = |i: usize| i as f64 / SIDE as f64;
    let row = |j: usize| -> Vec<f64> {
        let sheen = Sheen { color: DVec3::ONE, roughness: LEAST_ROUGHNESS + (1.0 - LEAST_ROUGHNESS) * at(j) };
        (0..=SIDE).map(|i| integrate(&sheen, at(i).powi(3).max(1e-3))).collect()
    };
    (0..=SIDE).map(row).collect()
});

/// Integrates the unscaled value times cosine over the hemisphere. Steps in the cosine are finer towards the horizon.
fn integrate(sheen: &Sheen, mu: f64) -> f64 {
    let v = DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu);
    let mut sum = 0.0;
    for i in 0..STEPS[0] {
        let x = (i as f64 + 0.5) / STEPS[0] as f64;
        let (cos, across) = (x.powi(3), (1.0 - x.powi(6)).sqrt());
        for k in 0..STEPS[1] {
            let phi = PI * (k as f64 + 0.5) / STEPS[1] as f64;
            let l = DVec3::new(across * phi.cos(), across * phi.sin(), cos);
            sum += sheen.unscaled(mu, cos, (v + l).normalize().z) * cos * 3.0 * x * x;
        }
    }
    sum * TAU / (STEPS[0] * STEPS[1]) as f64
}
