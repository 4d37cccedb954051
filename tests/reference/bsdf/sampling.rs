//! Samples a BSDF and returns its density.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::{Bsdf, Interior, LOBES, Lobe, Scattered};
use crate::reference::microfacet::{Frame, Ggx, reflect, refract};
use crate::reference::sampling::cosine_direction;

/// Minimum fraction of a Fresnel term for lobe selection: the facet's term may be far from the macro surface's.
const LEAST_SHARE: f64 = 0.1;
impl Bsdf {
    /// Returns the density by solid angle with which [`Self::sample`] draws `to_light` from lobes other than deltas.
    pub fn density(&self, to_light: DVec3) -> f64 {
        if let Some(colors) = self.colors() {
            return colors.iter().map(|color| color.density(to_light)).sum::<f64>() / 3.0;
        }
        let chances = self.chances();
        let of = |(lobe, chance): (Lobe, f64)| match chance {
            0.0 => 0.0,
            _ if self.is_delta(lobe) => 0.0,
            _ => chance * self.lobe_density(lobe, to_light),
        };
        LOBES.into_iter().zip(chances).map(of).sum()
    }

    /// Samples a direction of incoming light by three uniform numbers. None counts as black.
    pub fn sample(&self, [mut pick, u, v]: [f64; 3]) -> Option<Scattered> {
        if let Some(colors) = self.colors() {
            let color = ((3.0 * pick) as usize).min(2);
            let scattered = colors[color].sample([3.0 * pick - color as f64, u, v])?;
            let direction = scattered.direction;
            // A delta sends the other colours elsewhere.
            return Some(match scattered.density {
                None => Scattered { weight: DVec3::AXES[color] * (3.0 * scattered.weight[color]), ..scattered },
                Some(_) => {
                    let density = self.density(direction);
                    Scattered { direction, weight: self.scattered(direction) / density, density: Some(density) }
                }
            });
        }
        let chances = self.chances();
        let (lobe, chance) = LOBES.into_iter().zip(chances).find(|(_, chance)| {
            let found = pick < *chance;
            pick -= chance;
            found
        })?;
        let direction = self.direction(lobe, [u, v])?;
        if self.is_delta(lobe) {
            let through = lobe == Lobe::Transmission;
            let side = if through { -1.0 } else { 1.0 };
            let carries = side * self.geometric_normal.dot(direction) > 0.0;
            let weight = self.delta_weight(lobe) / chance;
            return carries.then_some(Scattered { direction, weight, density: None });
        }
        let density = self.density(direction);
        let weight = self.scattered(direction) / density;
        weight.is_finite().then_some(Scattered { direction, weight, density: Some(density) })
    }

    /// Returns the probability of each of [`LOBES`], roughly its fraction of the light; all 0 for a black surface.
    fn chances(&self) -> [f64; 6] {
        let cosine = self.normal.dot(self.to_viewer);
        let (coat, dielectric) = (self.coat_reflectance(), 1.0 - self.metallic);
        let least = |lobe| if self.is_delta(lobe) { 0.0 } else { LEAST_SHARE };
        let base = |lobe| self.base.max_element() * dielectric * self.under_reflection(cosine).max(least(lobe));
        let most_reflected = dielectric * self.f90 + self.metallic * self.metal_f0.max_element();
        let reflection = self.mixed_fresnel(cosine).max_element();
        let under = [
            base(Lobe::Diffuse) * (1.0 - self.transmission) * (1.0 - self.through),
            reflection.max(least(Lobe::Reflection) * most_reflected),
            base(Lobe::Transmission) * self.transmission,
        ];
        let [diffuse, reflection, transmission] = under.map(|share| share * (1.0 - coat));
        let sheen = self.sheen.map_or(0.0, |sheen| sheen.color.max_element() * sheen.albedo(cosine).max(LEAST_SHARE));
        let through = self.through_color.max_element() * dielectric * (1.0 - self.transmission) * self.through;
        let shares = [diffuse, reflection, transmission, coat, sheen * (1.0 - coat), through * (1.0 - coat)];
        let sum: f64 = shares.iter().sum();
        shares.map(|share| if sum > 0.0 { share / sum } else { 0.0 })
    }

    fn direction(&self, lobe: Lobe, u: [f64; 2]) -> Option<DVec3> {
        let (v, n) = (self.to_viewer, self.normal);
        if lobe == Lobe::Diffuse {
            return Some(cosine_direction(n, u));
        }
        if lobe == Lobe::Coat {
            let coat = self.coat?;
            return Some(reflect(v, self.facet(coat.facets(), u)));
        }
        if lobe == Lobe::Through {
            return Some(cosine_direction(-n, u));
        }
        if lobe == Lobe::Sheen {
            let cos = u[0];
            let (sin, cos_turn) = (TAU * u[1]).sin_cos();
            let across = (1.0 - cos * cos).sqrt();
            return Some(Frame::around(n).world(DVec3::new(across * cos_turn, across * sin, cos)));
        }
        if lobe == Lobe::Transmission && self.goes_straight() {
            return Some(-v);
        }
        let h = self.facet(self.facets(), u);
        let mirrored = reflect(v, h);
        match (lobe, self.interior) {
            (Lobe::Reflection, _) => Some(mirrored),
            (_, Interior::Thin) => Some(mirrored - n * (2.0 * n.dot(mirrored))),
            (_, Interior::Thick { .. }) => {
                let [here, beyond] = self.indices();
                refract(v, h, here / beyond)
            }
        }
    }

    /// Samples a facet that the viewer sees; the normal itself if the surface is smooth.
    pub(super) fn facet(&self, (frame, facets): (Frame, Ggx), u: [f64; 2]) -> DVec3 {
        if facets.is_smooth() {
            return frame.z;
        }
        frame.world(facets.sample(frame.local(self.to_viewer), u))
    }

    fn lobe_density(&self, lobe: Lobe, l: DVec3) -> f64 {
        let (v, n) = (self.to_viewer, self.normal);
        let of_facet = |(frame, facets): (Frame, Ggx), h: DVec3| facets.density(frame.local(v), frame.local(h));
        let of_mirrored = |facets: (Frame, Ggx), l: DVec3| {
            (v + l).try_normalize().map_or(0.0, |h| of_facet(facets, h) / (4.0 * v.dot(h)))
        };
        match (lobe, self.interior) {
            (Lobe::Diffuse, _) => n.dot(l).max(0.0) / PI,
            (Lobe::Through, _) => (-n.dot(l)).max(0.0) / PI,
            (Lobe::Sheen, _) => f64::from(n.dot(l) > 0.0) / TAU,
            (Lobe::Coat, _) => self.coat.map_or(0.0, |coat| of_mirrored(coat.facets(), l)),
            (Lobe::Reflection, _) => of_mirrored(self.facets(), l),
            (Lobe::Transmission, Interior::Thin) => of_mirrored(self.facets(), l - n * (2.0 * n.dot(l))),
            (Lobe::Transmission, Interior::Thick { .. }) => self.transmitting_facet(l).map_or(0.0, |h| {
                let [here, beyond] = self.indices();
                let (vh, lh) = (v.dot(h), -l.dot(h));
                of_facet(self.facets(), h) * beyond * beyond * lh / (here * vh - beyond * lh).powi(2)
            }),
        }
    }
}
