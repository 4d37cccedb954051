//! Reflectance of a thin film on a surface (`KHR_materials_iridescence`): interference after Belcour & Barla, "A Practical
//! Extension to Microfacet Theory for the Modeling of Varying Iridescence" (2017).

use std::f64::consts::{PI, TAU};

use diptych::scene::Iridescence;
use glam::{DMat3, DVec3};

use super::layer::schlick_weight;

/// Returns the reflectance at normal incidence whose Schlick term at `cosine` equals the film's reflectance there.
/// `thickness` is in nanometres, and `base` is the reflectance of the bare surface at normal incidence.
pub fn f0(film: &Iridescence, thickness: f64, cosine: f64, base: DVec3) -> DVec3 {
    let weight = schlick_weight(cosine).min(0.9999);
    let invert = |reflectance: f64| ((reflectance.max(0.0) - weight) / (1.0 - weight)).clamp(0.0, 1.0);
    reflectance(f64::from(film.ior), thickness, cosine, base).map(invert)
}

fn reflectance(film_ior: f64, thickness: f64, cosine: f64, base: DVec3) -> DVec3 {
    let t = (thickness / 0.03).clamp(0.0, 1.0);
    let ior = 1.0 + (film_ior - 1.0) * t * t * (3.0 - 2.0 * t);
    let inner_cosine = (1.0 - (1.0 - cosine.powi(2)) / ior.powi(2)).max(0.0).sqrt();
    let schlick = |f0: f64, cosine: f64| f0 + (1.0 - f0) * schlick_weight(cosine);
    let at_boundary = |a: f64, b: f64| ((a - b) / (a + b)).powi(2);
    let outer = schlick(at_boundary(ior, 1.0), cosine);
    let base_ior = base.map(|f0| {
        let root = f0.clamp(0.0, 0.9999).sqrt();
        (1.0 + root) / (1.0 - root)
    });
    let inner = base_ior.map(|n| schlick(at_boundary(n, ior), inner_cosine));
    let shift = base_ior.map(|n| if n < ior { TAU } else { PI });
    let both = (outer * inner).clamp(DVec3::splat(1e-5), DVec3::splat(0.9999));
    let passed = (1.0 - outer).powi(2) * inner / (1.0 - both);
    let mut sum = outer + passed;
    for order in 1..=2 {
        let m = f64::from(order);
        let strength = (passed - (1.0 - outer)) * both.map(|r| r.sqrt().powi(order));
        sum += strength * 2.0 * interference(m * 2.0 * ior * thickness * inner_cosine, m * shift);
    }
    sum
}

/// Returns the linear RGB sensitivity to a difference of paths in nanometres and a phase shift per channel.
fn interference(path: f64, shift: DVec3) -> DVec3 {
    let phase = TAU * path * 1e-9;
    let gaussian = |height: f64, centre: f64, variance: f64, shift: f64| {
        height * (TAU * variance).sqrt() * (centre * phase + shift).cos() * (-variance * phase * phase).exp()
    };
    let x = gaussian(5.4856e-13, 1.6810e6, 4.3278e9, shift.x) + gaussian(9.7470e-14, 2.2399e6, 4.5282e9, shift.x);
    let y = gaussian(4.4201e-13, 1.7953e6, 9.3046e9, shift.y);
    let z = gaussian(5.2481e-13, 2.2084e6, 6.6121e9, shift.z);
    // From CIE XYZ to linear sRGB (IEC 61966-2-1).
    let rgb_from_xyz = DMat3::from_cols(
        DVec3::new(3.240_454_2, -0.969_266_0, 0.055_643_4),
        DVec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
        DVec3::new(-0.498_531_4, 0.041_556_0, 1.057_225_2),
    );
    rgb_from_xyz * DVec3::new(x, y, z) / 1.0685e-7
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_film_leaves_f0_unchanged() {
        let base = DVec3::new(0.04, 0.3, 0.9);
        // Near grazing, the two orders of interference do not suffice.
        for cosine in [1.0, 0.8] {
            let bare = f0(&Iridescence { ior: 1.5, ..Iridescence::default() }, 0.0, cosine, base);
            assert!((bare - base).abs().max_element() < 0.02, "{bare}");
        }
    }
}
