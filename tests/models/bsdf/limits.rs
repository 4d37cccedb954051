//! Reciprocity, closed forms of smooth surfaces, and convergence of rough surfaces to them.

use glam::DVec3;

use super::{Finish, MATTE};
use crate::reference::bsdf::Bsdf;
use crate::reference::layer::schlick_weight;
use crate::reference::sampling::Rng;

const DIELECTRIC: Finish = Finish { specular: 1.0, ..MATTE };
const GLASS: Finish = Finish { transmission: 1.0, ..DIELECTRIC };

fn random_direction(rng: &mut Rng, side: f64) -> DVec3 {
    let z = side * (0.05 + 0.95 * rng.uniform());
    let phi = std::f64::consts::TAU * rng.uniform();
    let across = (1.0 - z * z).sqrt();
    DVec3::new(across * phi.cos(), across * phi.sin(), z)
}

/// Returns the value without its cosine.
fn value(bsdf: &Bsdf, l: DVec3) -> f64 {
    bsdf.scattered(l).x / bsdf.normal.dot(l).abs()
}

#[test]
fn reflection_and_thin_transmission_are_reciprocal() {
    let mut rng = Rng::new(3, 3);
    let finishes = [
        MATTE,
        DIELECTRIC,
        Finish { metallic: 0.4, ..DIELECTRIC },
        Finish { metallic: 1.0, ..MATTE },
        Finish { metallic: 0.5, brushed: 0.6, ..DIELECTRIC },
        Finish { transmission: 0.6, ..DIELECTRIC },
        Finish { sheen: Some(0.4), ..DIELECTRIC },
        Finish { through: 0.7, ..DIELECTRIC },
    ];
    for finish in finishes {
        for roughness in [0.0, 0.2, 0.5, 1.0] {
            let finish = Finish { roughness, ..finish };
            for side in [1.0, -1.0] {
                for _ in 0..200 {
                    let (v, l) = (random_direction(&mut rng, 1.0), random_direction(&mut rng, side));
                    let (there, back) = (value(&finish.seen_from(v), l), value(&finish.seen_from(l), v));
                    assert!((there - back).abs() <= 1e-9 * there.max(1e-3), "{finish:?} {v} {l}: {there} {back}");
                }
            }
        }
    }
}

/// Checks reciprocity of values over the squared index on the viewer's side, by which radiance scales (Veach 1997,
/// section 5.2).
#[test]
fn refraction_is_reciprocal_over_the_squared_index() {
    let mut rng = Rng::new(4, 4);
    let mut lit = 0;
    for roughness in [0.2, 0.5, 1.0] {
        for ior in [1.2, 1.5, 2.5] {
            let outside = Finish { roughness, ior, thick: true, ..GLASS };
            let inside = Finish { on_back: true, ..outside };
            for _ in 0..400 {
                let (v, l) = (random_direction(&mut rng, 1.0), random_direction(&mut rng, -1.0));
                let there = value(&outside.seen_from(v), l);
                let back = value(&inside.seen_from(l), v) / (ior * ior);
                assert!((there - back).abs() <= 1e-9 * there.max(1e-3), "{roughness} {ior} {v} {l}: {there} {back}");
                lit += usize::from(there > 1e-6);
            }
        }
    }
    assert!(lit > 500, "only {lit} pairs carry light");
}

fn fresnel(f0: f64, cosine: f64) -> f64 {
    f0 + (1.0 - f0) * schlick_weight(cosine)
}

/// Returns direction and weight of the two delta lobes of a smooth surface.
fn deltas(finish: Finish, mu: f64) -> [Option<(DVec3, f64)>; 2] {
    let bsdf = finish.seen_at(mu);
    let n = 100_000;
    let mut sums = [(DVec3::ZERO, 0.0, 0); 2];
    for i in 0..n {
        let u = (f64::from(i) + 0.5) / f64::from(n);
        if let Some(s) = bsdf.sample([u, 0.3, 0.7]) {
            assert!(s.density.is_none(), "a smooth surface scatters");
            let sum = &mut sums[usize::from(s.direction.z < 0.0)];
            *sum = (s.direction, sum.1 + s.weight.x / f64::from(n), sum.2 + 1);
        }
    }
    sums.map(|(direction, weight, count)| (count > 0).then_some((direction, weight)))
}

#[test]
fn smooth_surfaces_follow_schlick_and_snell() {
    let smooth = |finish| Finish { roughness: 0.0, ..finish };
    for mu in [1.0, 0.8, 0.5, 0.2] {
        let v = MATTE.seen_at(mu).to_viewer;
        let mirrored = DVec3::new(-v.x, -v.y, v.z);
        let check = |what: &str, found: Option<(DVec3, f64)>, direction: DVec3, weight: f64| {
            let (d, w) = found.unwrap_or_else(|| panic!("{what}, μ {mu}: nothing"));
            assert!((d - direction).length() < 1e-9, "{what}, μ {mu}: {d} is not {direction}");
            assert!((w - weight).abs() < 1e-3 * weight + 1e-9, "{what}, μ {mu}: {w} is not {weight}");
        };
        let [up, down] = deltas(smooth(Finish { metallic: 1.0, ..MATTE }), mu);
        check("metal", up, mirrored, 1.0);
        assert!(down.is_none());
        let outside = fresnel(0.04, mu);
        let [up, down] = deltas(smooth(GLASS), mu);
        check("thin", up, mirrored, outside);
        check("thin", down, -v, 1.0 - outside);
        let thick = smooth(Finish { thick: true, ..GLASS });
        let [up, down] = deltas(thick, mu);
        let refracted = DVec3::new(-v.x / 1.5, -v.y / 1.5, 0.0);
        let refracted = refracted - DVec3::Z * (1.0 - refracted.length_squared()).sqrt();
        check("into", up, mirrored, outside);
        check("into", down, refracted, (1.0 - outside) / 2.25);
        let [up, down] = deltas(Finish { on_back: true, ..thick }, mu);
        let sin2 = 2.25 * (1.0 - mu * mu);
        if sin2 >= 1.0 {
            check("total", up, mirrored, 1.0);
            assert!(down.is_none());
        } else {
            let inside = fresnel(0.04, (1.0 - sin2).sqrt());
            check("out of", up, mirrored, inside);
            check("out of", down, DVec3::new(-1.5 * v.x, -1.5 * v.y, -(1.0 - sin2).sqrt()), (1.0 - inside) * 2.25);
        }
        let [up, down] = deltas(Finish { ior: 0.0, ..thick }, mu);
        check("ior 0", up, mirrored, 1.0);
        assert!(down.is_none_or(|d| d.1 == 0.0));
        let [_, down] = deltas(Finish { ior: 1.0, roughness: 0.6, specular: 0.0, ..thick }, mu);
        check("ior 1, no specular", down, -v, 1.0);
    }
}

#[test]
fn rough_surfaces_converge_to_smooth_ones() {
    for finish in [
        DIELECTRIC,
        Finish { metallic: 1.0, ..MATTE },
        GLASS,
        Finish { thick: true, ..GLASS },
        Finish { thick: true, on_back: true, ..GLASS },
        Finish { coat: Some(0.0), ..MATTE },
    ] {
        for mu in [1.0, 0.8, 0.3] {
            // α lies just below and above the bound.
            let [smooth, rough] = [0.009_99, 0.010_01].map(|roughness| {
                Finish { roughness, coat: finish.coat.map(|_| roughness), ..finish }.albedo(mu, 16_384)
            });
            assert!((smooth - rough).abs() < 2e-3, "{finish:?}, μ {mu}: {smooth} {rough}");
        }
    }
}
