//! Sampled directions follow the claimed density of each lobe (chi-square test over the sphere).

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{Finish, MATTE};
use crate::effort::is_thorough;
use crate::reference::bsdf::Bsdf;
use crate::reference::sampling::Rng;

const BANDS: usize = 24;
const SECTORS: usize = 32;
/// Points per bin, in θ and φ, at which the density is integrated. The density is discontinuous where facets would be
/// seen from below.
const FINE: [usize; 2] = [48, 24];
const DRAWN: usize = 100_000;

fn direction(z: f64, phi: f64) -> DVec3 {
    let across = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(across * phi.cos(), across * phi.sin(), z)
}

/// Integrates the density per bin. Bands are uniform in θ, because lobes at grazing angles are narrow in it.
fn expected_per_bin(bsdf: &Bsdf) -> Vec<f64> {
    let mut bins = vec![0.0; BANDS * SECTORS];
    let (rows, columns) = (BANDS * FINE[0], SECTORS * FINE[1]);
    for row in 0..rows {
        for column in 0..columns {
            // Rows are shifted from column to column, so that some but not all of them cross a discontinuity along a
            // row.
            let theta = PI * (row as f64 + (0.618_034 * column as f64).fract()) / rows as f64;
            let measure = theta.sin() * PI / rows as f64 * TAU / columns as f64;
            let phi = TAU * (column as f64 + 0.5) / columns as f64;
            bins[row / FINE[0] * SECTORS + column / FINE[1]] += bsdf.density(direction(theta.cos(), phi)) * measure;
        }
    }
    bins
}

/// Returns the number of standard deviations by which χ² exceeds its mean, over the bins and one more for failed
/// samples.
fn excess(bsdf: &Bsdf) -> f64 {
    let mut expected = expected_per_bin(bsdf);
    let mut rng = Rng::new(11, 7);
    let mut found = vec![0.0; expected.len()];
    let mut lost = 0.0;
    for _ in 0..DRAWN {
        match bsdf.sample(rng.uniforms()) {
            Some(s) if s.density.is_some() => {
                let d = s.direction;
                let band = (d.z.clamp(-1.0, 1.0).acos() / PI * BANDS as f64) as usize;
                let sector = ((d.y.atan2(d.x) / TAU).rem_euclid(1.0) * SECTORS as f64) as usize;
                found[band.min(BANDS - 1) * SECTORS + sector.min(SECTORS - 1)] += 1.0;
            }
            Some(_) => panic!("a delta among smooth lobes"),
            None => lost += 1.0,
        }
    }
    expected.push((1.0 - expected.iter().sum::<f64>()).max(0.0));
    found.push(lost);
    let (mut chi2, mut freedom) = (0.0, -1.0);
    let (mut rest_expected, mut rest_found) = (0.0, 0.0);
    for (e, f) in expected.iter().map(|e| e * DRAWN as f64).zip(&found) {
        if e < 10.0 {
            rest_expected += e;
            rest_found += f;
        } else {
            chi2 += (f - e).powi(2) / e;
            freedom += 1.0;
        }
    }
    if rest_expected >= 10.0 {
        chi2 += (rest_found - rest_expected).powi(2) / rest_expected;
        freedom += 1.0;
    } else {
        assert!(rest_found < 50.0, "{rest_found} drawn where {rest_expected} are expected");
    }
    (chi2 - freedom) / (2.0f64 * freedom).sqrt()
}

fn hold(name: &str, finish: Finish) {
    for (i, roughness) in [0.4, 0.7, 1.0].into_iter().enumerate() {
        for (k, mu) in [1.0, 0.5, 0.08].into_iter().enumerate() {
            if !is_thorough() && (i + k) % 3 != 1 {
                continue;
            }
            let finish = Finish { roughness, coat: finish.coat.map(|_| roughness), ..finish };
            let excess = excess(&finish.seen_at(mu));
            println!("{name}, roughness {roughness}, μ {mu}: χ² is {excess:.1} σ over its mean");
            assert!(excess < 5.0, "{name}, roughness {roughness}, μ {mu}: χ² is {excess:.1} σ too large");
        }
    }
}

const GLASS: Finish = Finish { specular: 1.0, transmission: 1.0, ..MATTE };

#[test]
fn opaque_lobes_have_their_densities() {
    hold("matte", MATTE);
    hold("dielectric", Finish { specular: 1.0, ..MATTE });
    hold("metal", Finish { metallic: 1.0, ..MATTE });
    hold("brushed metal", Finish { metallic: 1.0, brushed: 0.7, ..MATTE });
    hold("sheen", Finish { sheen: Some(0.5), ..MATTE });
    hold("leaf", Finish { through: 0.6, specular: 1.0, ..MATTE });
    hold("coated", Finish { coat: Some(1.0), ..MATTE });
}

#[test]
fn transmitting_lobes_have_their_densities() {
    hold("thin glass", GLASS);
    hold("brushed sheet", Finish { brushed: 0.5, ..GLASS });
    let (thick, prism) = (Finish { thick: true, ..GLASS }, Finish { thick: true, dispersion: 0.1, ..GLASS });
    hold("brushed glass", Finish { brushed: 0.5, ..thick });
    for (into, out_of, glass) in [("into glass", "out of glass", thick), ("into a prism", "out of a prism", prism)] {
        hold(into, glass);
        hold(out_of, Finish { on_back: true, ..glass });
    }
}
