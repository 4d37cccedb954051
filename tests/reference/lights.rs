//! Light that arrives at a surface directly, by explicit sampling.
//!
//! Every punctual light gets its own sample at every hit, and the emissive triangles together get one.
//! Which light is sampled here, and is then not counted when a bounce finds it:
//! - point and spot of radius 0, directional of angle 0: no bounce can find them;
//! - directional with a disc: uniform in its solid angle; it is not in the sky, for nobody to see;
//! - point and spot of radius > 0: uniform in the cone the sphere fills, radiance along it;
//! - emissive triangles, with [`Emitters::Area`](super::Emitters): a point uniform by area.
//!
//! The environment is never sampled here: bounces that escape find it.

use std::f64::consts::{PI, TAU};

use diptych::scene::{Light, LightKind, Scene};
use glam::DVec3;

use super::intersect::{Geometry, Ray, sphere_distances};
use super::sampling::{Rng, cone_direction, triangle_weights};
use super::surface::{Surface, Surfaces};

/// Light arriving from one sampled direction, divided by the sample's density.
struct Arrival {
    /// Unit vector from the surface towards the light.
    direction: DVec3,
    distance: f64,
    /// Radiance over density, or irradiance on a perpendicular surface for lights without extent.
    power: DVec3,
    /// What the shadow ray must not be blocked by: the light itself.
    triangle: Option<usize>,
    sphere: Option<usize>,
}

/// A point or spot light with an extent: a black sphere that emits outwards.
pub struct SphereLight {
    /// Index into `Scene::lights`.
    pub light: usize,
    pub centre: DVec3,
    pub radius: f64,
}

pub fn sphere_lights(scene: &Scene) -> Vec<SphereLight> {
    let sphere = |(light, l): (usize, &Light)| match l.kind {
        LightKind::Point { position, radius }
        | LightKind::Spot {
            position, radius, ..
        } => (radius > 0.0).then(|| SphereLight {
            light,
            centre: position.as_dvec3(),
            radius: radius.into(),
        }),
        LightKind::Directional { .. } => None,
    };
    scene.lights.iter().enumerate().filter_map(sphere).collect()
}

/// Radiance (sphere) that a light sends from its centre to a point in the unit `direction`.
pub fn sphere_radiance(light: &Light, radius: f64, direction: DVec3) -> DVec3 {
    light.strength.as_dvec3() * cone_factor(&light.kind, direction) / (PI * radius * radius)
}

/// glTF's spot falloff for light that leaves along the unit `direction`; 1 for other lights.
fn cone_factor(kind: &LightKind, direction: DVec3) -> f64 {
    let LightKind::Spot {
        direction: axis,
        cos_inner,
        cos_outer,
        ..
    } = *kind
    else {
        return 1.0;
    };
    let (cos_inner, cos_outer) = (f64::from(cos_inner), f64::from(cos_outer));
    let along = direction.dot(axis.as_dvec3());
    let t = ((along - cos_outer) / (cos_inner - cos_outer).max(0.001)).clamp(0.0, 1.0);
    t * t
}

/// Triangles that emit, to be picked with probability ∝ area × luminance of the emissive factor.
pub struct EmissiveTriangles {
    triangles: Vec<usize>,
    /// Running sums of area × luminance.
    sums: Vec<f64>,
}

fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

impl EmissiveTriangles {
    pub fn new(surfaces: &Surfaces, geometry: &Geometry) -> Self {
        let mut list = Self {
            triangles: Vec::new(),
            sums: Vec::new(),
        };
        let mut sum = 0.0;
        for (id, triangle) in geometry.triangles.iter().enumerate() {
            let [a, b, c] = triangle.vertices;
            let area = (b - a).cross(c - a).length() * 0.5;
            let weight = area * luminance(surfaces.material(triangle).emissive.as_dvec3());
            if weight > 0.0 {
                sum += weight;
                list.triangles.push(id);
                list.sums.push(sum);
            }
        }
        list
    }

    /// One point of all emissive area, as light arriving at `from`.
    fn arrival(
        &self,
        surfaces: &Surfaces,
        geometry: &Geometry,
        from: &Surface,
        rng: &mut Rng,
    ) -> Option<Arrival> {
        let total = *self.sums.last()?;
        let pick = rng.uniform() * total;
        let nth = self
            .sums
            .partition_point(|&sum| sum <= pick)
            .min(self.sums.len() - 1);
        let id = self.triangles[nth];
        let triangle = &geometry.triangles[id];
        let weights = triangle_weights(rng);
        if id == from.triangle {
            return None;
        }
        let [a, b, c] = triangle.vertices;
        let offset = a * weights[0] + b * weights[1] + c * weights[2] - from.position;
        let distance = offset.length();
        let direction = offset / distance;
        // Density by area: (area × luminance / total) / area.
        let density = luminance(surfaces.material(triangle).emissive.as_dvec3()) / total;
        let cosine = surfaces.front_normal(triangle).dot(direction).abs();
        let emitted =
            surfaces.emission(triangle, weights, -direction) * surfaces.coverage(triangle, weights);
        Some(Arrival {
            direction,
            distance,
            power: emitted * (cosine / (distance * distance * density)),
            triangle: Some(id),
            sphere: None,
        })
    }
}

/// All that can block or send light.
pub struct Lighting<'a> {
    pub surfaces: &'a Surfaces<'a>,
    pub geometry: &'a Geometry,
    pub spheres: &'a [SphereLight],
}

impl Lighting<'_> {
    /// Radiance reflected towards the viewer of `surface` from all explicitly sampled lights.
    pub fn direct(
        &self,
        surface: &Surface,
        emissive: Option<&EmissiveTriangles>,
        rng: &mut Rng,
    ) -> DVec3 {
        let scene = self.surfaces.scene;
        let mut reflected = DVec3::ZERO;
        for (index, light) in scene.lights.iter().enumerate() {
            if let Some(arrival) = self.light_arrival(index, light, surface.position, rng) {
                reflected += self.reflected(surface, &arrival);
            }
        }
        let arrival = emissive.and_then(|e| e.arrival(self.surfaces, self.geometry, surface, rng));
        if let Some(arrival) = arrival {
            reflected += self.reflected(surface, &arrival);
        }
        reflected
    }

    fn reflected(&self, surface: &Surface, arrival: &Arrival) -> DVec3 {
        let wi = arrival.direction;
        let cosine = surface.shading_normal.dot(wi);
        if cosine <= 0.0 || surface.geometric_normal.dot(wi) <= 0.0 || arrival.power == DVec3::ZERO
        {
            return DVec3::ZERO;
        }
        surface.albedo / PI * cosine * arrival.power * self.visibility(surface, arrival)
    }

    /// Fraction of the light that nothing between blocks. Spheres block whatever comes from inside them, too.
    fn visibility(&self, surface: &Surface, arrival: &Arrival) -> f64 {
        let ray = Ray {
            origin: surface.position,
            direction: arrival.direction,
        };
        let blocks = |(index, sphere): (usize, &SphereLight)| {
            arrival.sphere != Some(index)
                && first_beyond_start(sphere_distances(&ray, sphere.centre, sphere.radius))
                    .is_some_and(|t| t < arrival.distance)
        };
        if self.spheres.iter().enumerate().any(blocks) {
            return 0.0;
        }
        let without = [Some(surface.triangle), arrival.triangle];
        self.geometry
            .transmittance(&ray, arrival.distance, without, |id, weights| {
                self.surfaces
                    .coverage(&self.geometry.triangles[id], weights)
            })
    }

    fn light_arrival(
        &self,
        index: usize,
        light: &Light,
        from: DVec3,
        rng: &mut Rng,
    ) -> Option<Arrival> {
        let strength = light.strength.as_dvec3();
        match light.kind {
            LightKind::Directional {
                direction,
                angle_rad,
            } => {
                let axis = -direction.as_dvec3().normalize();
                let (sin, sin_half) =
                    (f64::from(angle_rad).sin(), f64::from(angle_rad / 2.0).sin());
                let one_minus_cos = 2.0 * sin_half * sin_half;
                let (direction, power) = if angle_rad > 0.0 {
                    let radiance = strength / (PI * sin * sin);
                    (
                        cone_direction(axis, one_minus_cos, rng),
                        radiance * TAU * one_minus_cos,
                    )
                } else {
                    (axis, strength)
                };
                let distance = f64::INFINITY;
                Some(Arrival {
                    direction,
                    distance,
                    power,
                    triangle: None,
                    sphere: None,
                })
            }
            LightKind::Point { position, radius }
            | LightKind::Spot {
                position, radius, ..
            } => {
                let offset = position.as_dvec3() - from;
                let distance = offset.length();
                let axis = offset / distance;
                if radius > 0.0 {
                    let index = self.spheres.iter().position(|s| s.light == index)?;
                    return self.sphere_arrival(index, light, from, axis, distance, rng);
                }
                let power = strength * cone_factor(&light.kind, -axis) / (distance * distance);
                Some(Arrival {
                    direction: axis,
                    distance,
                    power,
                    triangle: None,
                    sphere: None,
                })
            }
        }
    }

    /// `axis` and `distance` lead from the lit point to the sphere's centre.
    fn sphere_arrival(
        &self,
        index: usize,
        light: &Light,
        from: DVec3,
        axis: DVec3,
        distance: f64,
        rng: &mut Rng,
    ) -> Option<Arrival> {
        let sphere = &self.spheres[index];
        if distance <= sphere.radius {
            return None; // It emits outwards only.
        }
        let sin2 = (sphere.radius / distance).powi(2);
        let one_minus_cos = sin2 / (1.0 + (1.0 - sin2).sqrt());
        let direction = cone_direction(axis, one_minus_cos, rng);
        let ray = Ray {
            origin: from,
            direction,
        };
        // At the rim, rounding may miss the sphere: there it is as far as its silhouette.
        let rim = distance * (1.0 - sin2).sqrt();
        let enter = sphere_distances(&ray, sphere.centre, sphere.radius).map_or(rim, |t| t[0]);
        let power = sphere_radiance(light, sphere.radius, -axis) * TAU * one_minus_cos;
        Some(Arrival {
            direction,
            distance: enter,
            power,
            triangle: None,
            sphere: Some(index),
        })
    }
}

/// The first of two ordered distances that lies ahead.
pub fn first_beyond_start(distances: Option<[f64; 2]>) -> Option<f64> {
    distances.and_then(|both| both.into_iter().find(|&t| t > 0.0))
}
