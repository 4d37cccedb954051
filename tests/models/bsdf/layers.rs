//! Microfacets, and the table of their layer's albedo.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use crate::reference::layer;
use crate::reference::microfacet::{Ggx, reflect};

/// Returns ∫ f(h) dω over the hemisphere. The substitution tan θ = α t / (1 − t) spreads the peak of facets with that
/// α.
fn over_facets(alpha: f64, f: impl Fn(DVec3) -> f64) -> f64 {
    const N: usize = 256;
    let mut sum = 0.0;
    for i in 0..N {
        let t = (i as f64 + 0.5) / N as f64;
        let tangent = alpha * t / (1.0 - t);
        let cosine = 1.0 / (1.0 + tangent * tangent).sqrt();
        let sine = tangent * cosine;
        // dω = sin θ dθ dφ, dθ = cos² θ dtan.
        let measure = sine * cosine * cosine * alpha / (1.0 - t).powi(2) / N as f64;
        for k in 0..N {
            let phi = TAU * (k as f64 + 0.5) / N as f64;
            sum += f(DVec3::new(sine * phi.cos(), sine * phi.sin(), cosine)) * measure * TAU / N as f64;
        }
    }
    sum
}

fn at_cosine(mu: f64) -> DVec3 {
    DVec3::new((1.0 - mu * mu).sqrt(), 0.0, mu)
}

const ALPHAS: [f64; 6] = [1e-4, 1e-3, 0.01, 0.09, 0.36, 1.0];

#[test]
fn facets_cover_the_surface_once() {
    for alpha in ALPHAS {
        let facets = Ggx::even(alpha);
        let covered = over_facets(alpha, |h| facets.distribution(h) * h.z);
        assert!((covered - 1.0).abs() < 1e-4, "α {alpha}: {covered}");
    }
}

/// Checks equation 11 of Walter et al. 2007 in Smith's form: the facets visible from a direction have its projected
/// area.
#[test]
fn visible_facets_cover_the_projected_area() {
    for alpha in ALPHAS {
        let facets = Ggx::even(alpha);
        for mu in [1.0, 0.7, 0.2, 0.05] {
            let v = at_cosine(mu);
            let seen = over_facets(alpha, |h| facets.masking(v) * v.dot(h).max(0.0) * facets.distribution(h));
            let density = over_facets(alpha, |h| facets.density(v, h));
            // At grazing angles on smooth surfaces, only facets beyond 90° − 3° are visible.
            let allowed = if mu < 0.1 { 5e-3 } else { 1e-3 };
            assert!((seen / mu - 1.0).abs() < allowed, "α {alpha}, μ {mu}: {seen}");
            assert!((density - 1.0).abs() < allowed, "α {alpha}, μ {mu}: {density}");
        }
    }
}

/// Compares interpolation with integration between the table's nodes, and integration with an integral over directions.
#[test]
fn layer_table_is_exact_to_one_ten_thousandth() {
    let mut worst = (0.0, 0.0, 0.0);
    for i in 0..40 {
        let alpha = (0.0101 + 0.9898 * f64::from(i) / 39.0).powi(2);
        for k in 0..40 {
            let mu = (f64::from(k) + 0.37) / 40.0;
            let expected = layer::integrate(Ggx::even(alpha), mu);
            let found = DVec2::new(layer::albedo(alpha, 1.0, 0.0, mu), layer::albedo(alpha, 0.0, 1.0, mu));
            let error = (found - expected).abs().max_element();
            if error > worst.0 {
                worst = (error, alpha, mu);
            }
        }
    }
    println!("largest error of the layer's table: {:.1e} at α {:.4}, μ {:.3}", worst.0, worst.1, worst.2);
    assert!(worst.0 < 1e-4, "{worst:?}");

    for alpha in [0.09, 0.36, 1.0] {
        let facets = Ggx::even(alpha);
        for mu in [1.0, 0.6, 0.3] {
            let v = at_cosine(mu);
            let reflected = |h: DVec3, part: fn(f64) -> f64| {
                let l = reflect(v, h);
                if l.z <= 0.0 || v.dot(h) <= 0.0 {
                    return 0.0;
                }
                let w = part(layer::schlick_weight(v.dot(h)));
                w * facets.distribution(h) * facets.visibility(v, l) * l.z * 4.0 * v.dot(h)
            };
            let expected =
                [over_facets(alpha, |h| reflected(h, |w| 1.0 - w)), over_facets(alpha, |h| reflected(h, |w| w))];
            let found = [layer::albedo(alpha, 1.0, 0.0, mu), layer::albedo(alpha, 0.0, 1.0, mu)];
            for (e, f) in expected.iter().zip(found) {
                assert!((e - f).abs() < 3e-4, "α {alpha}, μ {mu}: {found:?} is not {expected:?}");
            }
        }
    }
}

#[test]
fn mean_layer_albedo_is_the_mean_over_directions() {
    for alpha in [0.0, 1e-4, 0.01, 0.25, 1.0] {
        let n = 2000;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n);
        let expected: f64 = (0..n).map(|i| 2.0 * at(i) * layer::albedo(alpha, 0.04, 1.0, at(i)) / f64::from(n)).sum();
        let found = layer::mean_albedo(alpha, 0.04, 1.0);
        assert!((found - expected).abs() < 1e-4, "α {alpha}: {found} is not {expected}");
    }
    // A smooth surface has f0 + (f90 − f0) / 21.
    assert!((layer::mean_albedo(0.0, 0.04, 1.0) - (0.04 + 0.96 / 21.0)).abs() < 1e-12);
}
