//! Evaluates the BSDF at a surface point: the sum of the material model's lobes. The module [`sampling`] samples it.
//!
//! The lobes are diffuse, the surface's reflection (dielectric and metal share it), transmission, clearcoat, sheen, and diffuse
//! transmission. Below [`SMOOTH_ALPHA`] reflection, transmission and clearcoat are deltas: [`Bsdf::scattered`] and [`Bsdf::density`] omit them, and only
//! [`Bsdf::sample`] finds them. Values include the cosine.

mod sampling;

use std::f64::consts::PI;

use glam::DVec3;

use super::layer::{self, SMOOTH_ALPHA, schlick_weight};
use super::microfacet::{Frame, Ggx};
use super::sheen::Sheen;

/// Medium behind the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Interior {
    /// The same medium as in front.
    Thin,
    /// A medium of that index of refraction; with an index of 1 light goes straight on.
    Thick { index: f64 },
}

#[derive(Clone, Copy, Debug)]
pub struct Coat {
    pub strength: f64,
    pub alpha: f64,
    /// Unit normal on the viewer's side.
    pub normal: DVec3,
}

impl Coat {
    fn facets(&self) -> (Frame, Ggx) {
        (Frame::around(self.normal), Ggx::even(self.alpha))
    }
}

/// Facets that are wider along a direction than across.
#[derive(Clone, Copy, Debug)]
pub struct Brushed {
    /// Widths along and across.
    pub alpha: [f64; 2],
    /// Unit tangent.
    pub along: DVec3,
}

/// A point's material with all textures looked up, seen from `to_viewer`. Both normals are on the viewer's side.
#[derive(Clone, Copy, Debug)]
pub struct Bsdf {
    pub to_viewer: DVec3,
    pub normal: DVec3,
    pub geometric_normal: DVec3,
    pub base: DVec3,
    /// The metal's reflectance at normal incidence: the base colour, unless a film is on it.
    pub metal_f0: DVec3,
    pub metallic: f64,
    /// Width of the facets; the geometric mean of both widths if they are brushed.
    pub alpha: f64,
    pub brushed: Option<Brushed>,
    /// The dielectric's reflectance at normal and at grazing incidence.
    pub f0: DVec3,
    pub f90: f64,
    pub transmission: f64,
    /// Fraction of the diffuse light that leaves on the other side, and its colour.
    pub through: f64,
    pub through_color: DVec3,
    pub interior: Interior,
    /// Difference of the index of refraction of red or blue light to that of green light.
    pub dispersion: f64,
    /// True if the viewer is on the back of the triangle.
    pub on_back: bool,
    pub coat: Option<Coat>,
    pub sheen: Option<Sheen>,
}

#[derive(Clone, Copy, Debug)]
pub struct Scattered {
    pub direction: DVec3,
    /// Value over density.
    pub weight: DVec3,
    /// Density by solid angle; none for a delta.
    pub density: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lobe {
    Diffuse,
    Reflection,
    Transmission,
    Coat,
    Sheen,
    Through,
}

const LOBES: [Lobe; 6] = [Lobe::Diffuse, Lobe::Reflection, Lobe::Transmission, Lobe::Coat, Lobe::Sheen, Lobe::Through];

/// Lower bound of 1 − Eavg.
const LEAST_ABSORBED: f64 = 1e-6;

impl Bsdf {
    /// Returns value times cosine for light from `to_light`, without deltas.
    pub fn scattered(&self, to_light: DVec3) -> DVec3 {
        if let Some(colors) = self.colors() {
            return DVec3::from_array([0, 1, 2].map(|c| colors[c].scattered(to_light)[c]));
        }
        let through_coat = 1.0 - self.coat_reflectance();
        let under_sheen = self.under_sheen(self.normal.dot(to_light)) * through_coat;
        if self.geometric_normal.dot(to_light) > 0.0 {
            self.reflected(to_light) * under_sheen
                + self.sheen_reflected(to_light) * through_coat
                + DVec3::splat(self.coat_reflected(to_light))
        } else {
            self.transmitted(to_light) * under_sheen
        }
    }

    /// Returns the BSDFs of red, green and blue light, if they differ.
    fn colors(&self) -> Option<[Self; 3]> {
        match self.interior {
            Interior::Thick { index } if self.dispersion > 0.0 => Some([-1.0, 0.0, 1.0].map(|side| {
                let interior = Interior::Thick { index: index + side * self.dispersion };
                Self { interior, dispersion: 0.0, ..*self }
            })),
            _ => None,
        }
    }

    /// Returns the fraction of light at that cosine which the sheen leaves to the material under it.
    fn under_sheen(&self, cos_light: f64) -> f64 {
        self.sheen.map_or(1.0, |sheen| {
            let most = sheen.albedo(self.normal.dot(self.to_viewer)).max(sheen.albedo(cos_light.abs()));
            1.0 - sheen.color.max_element() * most
        })
    }

    fn sheen_reflected(&self, l: DVec3) -> DVec3 {
        let (v, n) = (self.to_viewer, self.normal);
        let cos_light = n.dot(l);
        match (self.sheen, (v + l).try_normalize()) {
            (Some(sheen), Some(h)) if cos_light > 0.0 => {
                sheen.color * sheen.value(n.dot(v), cos_light, n.dot(h)) * cos_light
            }
            _ => DVec3::ZERO,
        }
    }

    /// Returns the fraction of light from straight behind that a smooth sheet transmits to the viewer
    /// (KHR_materials_transmission: base colour times 1 − Fresnel for the dielectric part). It is black if light is
    /// refracted, scattered or blocked.
    pub fn straight(&self) -> DVec3 {
        if self.interior != Interior::Thin || !self.is_delta(Lobe::Transmission) {
            return DVec3::ZERO;
        }
        self.delta_weight(Lobe::Transmission)
    }

    /// Returns the fraction of light that the coat withholds from the material under it, emission included.
    pub fn coat_reflectance(&self) -> f64 {
        self.coat.map_or(0.0, |coat| {
            let cosine = coat.normal.dot(self.to_viewer).abs();
            coat.strength * (0.04 + 0.96 * schlick_weight(cosine))
        })
    }

    /// Returns the indices of refraction on the viewer's side and beyond the surface.
    fn indices(&self) -> [f64; 2] {
        match self.interior {
            Interior::Thin => [1.0, 1.0],
            Interior::Thick { index } if self.on_back => [index, 1.0],
            Interior::Thick { index } => [1.0, index],
        }
    }

    /// Returns true if transmitted light keeps its direction whatever the roughness.
    fn goes_straight(&self) -> bool {
        matches!(self.interior, Interior::Thick { index } if index == 1.0)
    }

    fn is_delta(&self, lobe: Lobe) -> bool {
        match lobe {
            Lobe::Diffuse | Lobe::Sheen | Lobe::Through => false,
            Lobe::Reflection => self.alpha < SMOOTH_ALPHA,
            Lobe::Transmission => self.alpha < SMOOTH_ALPHA || self.goes_straight(),
            Lobe::Coat => self.coat.is_some_and(|coat| coat.alpha < SMOOTH_ALPHA),
        }
    }

    /// Returns the Fresnel term of the dielectric over the base for a facet that the viewer sees at that cosine. It is
    /// that from outside on both sides.
    fn covered_fresnel(&self, cosine: f64) -> DVec3 {
        self.f0.lerp(DVec3::splat(self.f90), schlick_weight(cosine))
    }

    /// Returns the Fresnel term of the fraction of the dielectric that transmits.
    fn clear_fresnel(&self, cosine: f64) -> DVec3 {
        let [here, beyond] = self.indices();
        if here <= beyond {
            return self.covered_fresnel(cosine);
        }
        let sin2 = (here / beyond).powi(2) * (1.0 - cosine * cosine);
        if sin2 >= 1.0 { DVec3::splat(self.f90) } else { self.covered_fresnel((1.0 - sin2).sqrt()) }
    }

    /// Returns the Fresnel term of dielectric and metal, mixed by transmission and metalness.
    fn mixed_fresnel(&self, cosine: f64) -> DVec3 {
        let metal = self.metal_f0.lerp(DVec3::ONE, schlick_weight(cosine));
        self.covered_fresnel(cosine).lerp(self.clear_fresnel(cosine), self.transmission).lerp(metal, self.metallic)
    }

    /// Returns the fraction of light that the reflection leaves to transmission.
    fn under_reflection(&self, cosine: f64) -> f64 {
        1.0 - self.clear_fresnel(cosine).max_element()
    }

    /// Returns the mean of that fraction over all facets that the viewer sees: rough facets reflect even if light is
    /// not refracted.
    fn mean_under_reflection(&self) -> f64 {
        const STRATA: usize = 12;
        let middle = |i: usize| (i as f64 + 0.5) / STRATA as f64;
        let passed = |i: usize| {
            let h = self.facet(self.facets(), [middle(i % STRATA), middle(i / STRATA)]);
            self.under_reflection(self.to_viewer.dot(h))
        };
        (0..STRATA * STRATA).map(passed).sum::<f64>() / (STRATA * STRATA) as f64
    }

    /// Returns the diffuse lobe's fraction W.
    fn diffuse_share(&self, cos_facet: f64, cos_light: f64) -> f64 {
        (1.0 - self.covered_fresnel(cos_facet).max_element()).min(self.conserved_share(cos_light))
    }

    /// Returns the fraction of Kelemen & Szirmay-Kalos, which loses what the layers on both ways reflect.
    fn conserved_share(&self, cos_light: f64) -> f64 {
        let (f0, cos_viewer) = (self.f0.max_element(), self.normal.dot(self.to_viewer));
        let let_in = |mu: f64| 1.0 - layer::albedo(self.alpha, f0, self.f90, mu);
        let absorbed = (1.0 - layer::mean_albedo(self.alpha, f0, self.f90)).max(LEAST_ABSORBED);
        let_in(cos_viewer) * let_in(cos_light) / absorbed
    }

    fn reflected(&self, l: DVec3) -> DVec3 {
        let (v, n) = (self.to_viewer, self.normal);
        let cos_light = n.dot(l);
        let Some(h) = (v + l).try_normalize().filter(|_| cos_light > 0.0) else {
            return DVec3::ZERO;
        };
        let facet = v.dot(h);
        let mut value = DVec3::ZERO;
        let opaque = (1.0 - self.metallic) * (1.0 - self.transmission) * (1.0 - self.through);
        if opaque > 0.0 {
            value += self.base * (opaque * self.diffuse_share(facet, cos_light) / PI);
        }
        if !self.is_delta(Lobe::Reflection) {
            value += self.mixed_fresnel(facet) * self.facets_value(self.facets(), h, l);
        }
        value * cos_light
    }

    /// Returns the facets of reflection and transmission, and their frame.
    fn facets(&self) -> (Frame, Ggx) {
        match self.brushed {
            Some(brushed) => (Frame::along(brushed.along, self.normal), Ggx::uneven(brushed.alpha)),
            None => (Frame::around(self.normal), Ggx::even(self.alpha)),
        }
    }

    /// Returns D V2 of facets.
    fn facets_value(&self, (frame, facets): (Frame, Ggx), h: DVec3, l: DVec3) -> f64 {
        facets.distribution(frame.local(h)) * facets.visibility(frame.local(self.to_viewer), frame.local(l))
    }

    fn coat_reflected(&self, l: DVec3) -> f64 {
        let Some(coat) = self.coat.filter(|_| !self.is_delta(Lobe::Coat)) else {
            return 0.0;
        };
        let cosine = coat.normal.dot(l);
        match (self.to_viewer + l).try_normalize() {
            Some(h) if cosine > 0.0 => self.coat_reflectance() * self.facets_value(coat.facets(), h, l) * cosine,
            _ => 0.0,
        }
    }

    fn transmitted(&self, l: DVec3) -> DVec3 {
        let (v, n) = (self.to_viewer, self.normal);
        let cos_light = -n.dot(l);
        let share = (1.0 - self.metallic) * self.transmission;
        if cos_light <= 0.0 || self.geometric_normal.dot(l) >= 0.0 {
            return DVec3::ZERO;
        }
        let diffuse = (1.0 - self.metallic) * (1.0 - self.transmission) * self.through;
        let diffuse = if diffuse > 0.0 { diffuse * self.conserved_share(cos_light) * cos_light / PI } else { 0.0 };
        let diffuse = self.through_color * diffuse;
        if share == 0.0 || self.is_delta(Lobe::Transmission) {
            return diffuse;
        }
        let Some(h) = self.transmitting_facet(l) else {
            return diffuse;
        };
        let value = self.under_reflection(v.dot(h)) * self.facets_value(self.facets(), h, l);
        let spread = match self.interior {
            Interior::Thin => 1.0,
            // Walter et al. 2007, equation 21, for radiance seen from v; V2 is G2 / (4 cos cos).
            Interior::Thick { .. } => {
                let [here, beyond] = self.indices();
                let (vh, lh) = (v.dot(h), -l.dot(h));
                4.0 * vh * lh * here * here / (here * vh - beyond * lh).powi(2)
            }
        };
        self.base * (share * value * spread * cos_light) + diffuse
    }

    /// Returns the facet on the viewer's side that transmits light from `l`, on the other side, to the viewer.
    fn transmitting_facet(&self, l: DVec3) -> Option<DVec3> {
        let (v, n) = (self.to_viewer, self.normal);
        match self.interior {
            Interior::Thin => (v + l - n * (2.0 * n.dot(l))).try_normalize(),
            Interior::Thick { .. } => {
                let [here, beyond] = self.indices();
                let h = (v * here + l * beyond).try_normalize()?;
                let h = if n.dot(h) < 0.0 { -h } else { h };
                (v.dot(h) > 0.0 && l.dot(h) < 0.0).then_some(h)
            }
        }
    }

    /// Returns the value of a delta lobe, divided by its cosine.
    fn delta_weight(&self, lobe: Lobe) -> DVec3 {
        let cosine = self.normal.dot(self.to_viewer);
        let through_coat = 1.0 - self.coat_reflectance();
        match lobe {
            Lobe::Coat => DVec3::splat(self.coat_reflectance()),
            Lobe::Reflection => self.mixed_fresnel(cosine) * (through_coat * self.under_sheen(cosine)),
            Lobe::Transmission => {
                let [here, beyond] = self.indices();
                let passed = if self.alpha < SMOOTH_ALPHA {
                    self.under_reflection(cosine)
                } else {
                    self.mean_under_reflection()
                };
                let bends = self.interior != Interior::Thin && !self.goes_straight();
                let sin2 = (here / beyond).powi(2) * (1.0 - cosine * cosine);
                let away = if bends { (1.0 - sin2).max(0.0).sqrt() } else { cosine };
                let share = (1.0 - self.metallic) * self.transmission * passed * self.under_sheen(away);
                self.base * (share * (here / beyond).powi(2) * through_coat)
            }
            Lobe::Diffuse | Lobe::Sheen | Lobe::Through => unreachable!("the wide lobes are no deltas"),
        }
    }
}
