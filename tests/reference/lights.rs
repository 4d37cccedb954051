//! Direct light at a surface, by explicit sampling.
//!
//! Every light gets its own sample at every hit; the emissive triangles together get one, and so does the environment
//! image. Lights that bounces can hit, too, are weighted by the balance heuristic (Veach 1997):
//! - emissive triangles: a point uniform by area;
//! - point and spot lights of radius > 0: uniform in the cone that the sphere fills, with the radiance along it;
//! - the environment image: by its texels. A constant environment is left to bounces.
//!
//! Bounces cannot hit the others: point and spot lights of radius 0, and directional lights. A sun's disc is sampled
//! uniformly in its solid angle. It is invisible in the sky, even in mirrors.

use std::f64::consts::{PI, TAU};

use diptych::scene::{Light, LightKind, Scene};
use glam::DVec3;

use super::bsdf::Bsdf;
use super::environment::{self, EnvironmentLight};
use super::intersect::{Geometry, Ray, Triangle, sphere_distances};
use super::medium::Medium;
use super::sampling::{Rng, cone_direction, triangle_weights};
use super::surface::{Surface, Surfaces};

/// Light arriving from one sampled direction, divided by the sample's density.
struct Arrival {
    /// Unit vector from the surface towards the light.
    direction: DVec3,
    distance: f64,
    /// Radiance over density, or irradiance on a perpendicular surface for lights without extent.
    power: DVec3,
    /// Density of the sample by solid angle, if bounces can hit this light, too.
    density: Option<f64>,
    /// Triangle that must not block the shadow ray: the light itself.
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
        LightKind::Point { position, radius } | LightKind::Spot { position, radius, .. } => {
            (radius > 0.0).then(|| SphereLight { light, centre: position.as_dvec3(), radius: radius.into() })
        }
        LightKind::Directional { .. } => None,
    };
    scene.lights.iter().enumerate().filter_map(sphere).collect()
}

/// Returns the radiance of a spherical light, as sent from its centre in the unit `direction`.
pub fn sphere_radiance(light: &Light, radius: f64, direction: DVec3) -> DVec3 {
    light.strength.as_dvec3() * cone_factor(&light.kind, direction) / (PI * radius * radius)
}

/// Returns glTF's spot falloff for light that leaves in the unit `direction`; 1 for other lights.
fn cone_factor(kind: &LightKind, direction: DVec3) -> f64 {
    let LightKind::Spot { direction: axis, cos_inner, cos_outer, .. } = *kind else {
        return 1.0;
    };
    let (cos_inner, cos_outer) = (f64::from(cos_inner), f64::from(cos_outer));
    let along = direction.dot(axis.as_dvec3());
    let t = ((along - cos_outer) / (cos_inner - cos_outer).max(0.001)).clamp(0.0, 1.0);
    t * t
}

/// Emissive triangles, picked with probability ∝ area × luminance of the emissive factor.
pub struct EmissiveTriangles {
    triangles: Vec<usize>,
    /// Cumulative area × luminance.
    sums: Vec<f64>,
}

/// Returns the luminance of the factor; 0 for unlit materials, which are never picked.
fn picked_by(surfaces: &Surfaces, triangle: &Triangle) -> f64 {
    let material = surfaces.material(triangle);
    if material.unlit { 0.0 } else { luminance(material.emissive.as_dvec3()) }
}

fn luminance(c: DVec3) -> f64 {
    c.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

impl EmissiveTriangles {
    pub fn new(surfaces: &Surfaces, geometry: &Geometry) -> Self {
        let mut list = Self { triangles: Vec::new(), sums: Vec::new() };
        let mut sum = 0.0;
        for (id, triangle) in geometry.triangles.iter().enumerate() {
            let [a, b, c] = triangle.vertices;
            let area = (b - a).cross(c - a).length() * 0.5;
            let weight = area * picked_by(surfaces, triangle);
            if weight > 0.0 {
                sum += weight;
                list.triangles.push(id);
                list.sums.push(sum);
            }
        }
        list
    }

    /// Samples one point of all emissive area, as light arriving at `from`.
    fn arrival(&self, surfaces: &Surfaces, geometry: &Geometry, from: &Surface, rng: &mut Rng) -> Option<Arrival> {
        let total = *self.sums.last()?;
        let pick = rng.uniform() * total;
        let nth = self.sums.partition_point(|&sum| sum <= pick).min(self.sums.len() - 1);
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
        let density = self.density(surfaces, triangle, direction, distance)?;
        let emitted = surfaces.emission(triangle, weights, -direction) * surfaces.coverage(triangle, weights);
        Some(Arrival {
            direction,
            distance,
            power: emitted / density,
            density: Some(density),
            triangle: Some(id),
            sphere: None,
        })
    }

    /// Returns the density by solid angle of a point of `triangle` at that unit direction and distance; none edge-on.
    pub fn density(&self, surfaces: &Surfaces, triangle: &Triangle, direction: DVec3, distance: f64) -> Option<f64> {
        // Density by area: (area × luminance / total) / area.
        let by_area = picked_by(surfaces, triangle) / self.sums.last()?;
        let cosine = surfaces.front_normal(triangle).dot(direction).abs();
        (cosine > 0.0).then(|| by_area * distance * distance / cosine)
    }
}

/// Everything that can block or emit light.
pub struct Lighting<'a> {
    pub surfaces: &'a Surfaces<'a>,
    pub geometry: &'a Geometry,
    pub spheres: &'a [SphereLight],
    pub emissive: &'a EmissiveTriangles,
    pub sky: Option<&'a EnvironmentLight>,
    /// True if lights that bounces can hit, too, are sampled explicitly.
    pub samples_extended: bool,
}

/// A lit point: its surface, its scattering, and the medium of its viewer's ray.
pub struct Receiver<'a> {
    pub surface: &'a Surface,
    pub bsdf: &'a Bsdf,
    pub medium: &'a Medium,
}

impl Lighting<'_> {
    /// Returns the radiance from all explicitly sampled lights that `receiver` scatters to its viewer.
    pub fn direct(&self, receiver: &Receiver, rng: &mut Rng) -> DVec3 {
        let scene = self.surfaces.scene;
        let position = receiver.surface.position;
        let mut scattered = DVec3::ZERO;
        for (index, light) in scene.lights.iter().enumerate() {
            if let Some(arrival) = self.light_arrival(index, light, position, rng) {
                scattered += self.scattered(receiver, &arrival);
            }
        }
        if self.samples_extended {
            let emissive = self.emissive.arrival(self.surfaces, self.geometry, receiver.surface, rng);
            let sky = self.sky.map(|sky| sky_arrival(self.surfaces.scene, sky, rng));
            for arrival in [emissive, sky].into_iter().flatten() {
                scattered += self.scattered(receiver, &arrival);
            }
        }
        scattered
    }

    fn scattered(&self, receiver: &Receiver, arrival: &Arrival) -> DVec3 {
        let scattered = receiver.bsdf.scattered(arrival.direction) * arrival.power;
        if scattered == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let weight = arrival.density.map_or(1.0, |d| d / (d + receiver.bsdf.density(arrival.direction)));
        let medium = receiver.medium.beyond(receiver.surface, arrival.direction);
        let left = medium.transmittance(arrival.distance) * self.visibility(receiver.surface, arrival);
        scattered * weight * left
    }

    /// Returns the density by solid angle of sampling a spherical light from `from`; none from inside.
    pub fn sphere_density(&self, index: usize, from: DVec3) -> Option<f64> {
        let sphere = &self.spheres[index];
        let sin2 = (sphere.radius / (sphere.centre - from).length()).powi(2);
        (sin2 < 1.0).then(|| 1.0 / (TAU * one_minus_cos(sin2)))
    }

    /// Returns the unblocked fraction of the light. Spheres also block light from inside them. Thin, smooth surfaces
    /// pass the light of sources that bounces cannot hit, as far as their transmission allows.
    fn visibility(&self, surface: &Surface, arrival: &Arrival) -> DVec3 {
        let ray = Ray { origin: surface.position, direction: arrival.direction };
        let blocks = |(index, sphere): (usize, &SphereLight)| {
            arrival.sphere != Some(index)
                && first_beyond_start(sphere_distances(&ray, sphere.centre, sphere.radius))
                    .is_some_and(|t| t < arrival.distance)
        };
        if self.spheres.iter().enumerate().any(blocks) {
            return DVec3::ZERO;
        }
        let without = [Some(surface.triangle), arrival.triangle];
        self.geometry.transmittance(&ray, arrival.distance, without, |id, weights| {
            let triangle = &self.geometry.triangles[id];
            let coverage = self.surfaces.coverage(triangle, weights);
            let straight = match arrival.density {
                None => self.surfaces.straight(id, triangle, weights, -ray.direction),
                Some(_) => DVec3::ZERO,
            };
            DVec3::splat(1.0 - coverage) + straight * coverage
        })
    }

    fn light_arrival(&self, index: usize, light: &Light, from: DVec3, rng: &mut Rng) -> Option<Arrival> {
        let strength = light.strength.as_dvec3();
        match light.kind {
            LightKind::Directional { direction, angle_rad } => {
                let axis = -direction.as_dvec3().normalize();
                let (sin, sin_half) = (f64::from(angle_rad).sin(), f64::from(angle_rad / 2.0).sin());
                let one_minus_cos = 2.0 * sin_half * sin_half;
                let (direction, power) = if angle_rad > 0.0 {
                    let radiance = strength / (PI * sin * sin);
                    (cone_direction(axis, one_minus_cos, rng), radiance * TAU * one_minus_cos)
                } else {
                    (axis, strength)
                };
                let distance = f64::INFINITY;
                Some(Arrival { direction, distance, power, density: None, triangle: None, sphere: None })
            }
            LightKind::Point { position, radius } | LightKind::Spot { position, radius, .. } => {
                let offset = position.as_dvec3() - from;
                let distance = offset.length();
                let axis = offset / distance;
                if radius > 0.0 {
                    if !self.samples_extended {
                        return None;
                    }
                    let index = self.spheres.iter().position(|s| s.light == index)?;
                    return self.sphere_arrival(index, light, from, axis, distance, rng);
                }
                let power = strength * cone_factor(&light.kind, -axis) / (distance * distance);
                Some(Arrival { direction: axis, distance, power, density: None, triangle: None, sphere: None })
            }
        }
    }

    /// Samples a spherical light; `axis` and `distance` lead from the lit point to its centre.
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
            return None; // It emits only outwards.
        }
        let sin2 = (sphere.radius / distance).powi(2);
        let one_minus_cos = one_minus_cos(sin2);
        let direction = cone_direction(axis, one_minus_cos, rng);
        let ray = Ray { origin: from, direction };
        // Near the rim, rounding may miss the sphere; the distance there is that of its silhouette.
        let rim = distance * (1.0 - sin2).sqrt();
        let enter = sphere_distances(&ray, sphere.centre, sphere.radius).map_or(rim, |t| t[0]);
        let solid_angle = TAU * one_minus_cos;
        let power = sphere_radiance(light, sphere.radius, -axis) * solid_angle;
        let density = Some(1.0 / solid_angle);
        Some(Arrival { direction, distance: enter, power, density, triangle: None, sphere: Some(index) })
    }
}

/// Returns 1 − cos from sin², which keeps precision for narrow cones.
fn one_minus_cos(sin2: f64) -> f64 {
    sin2 / (1.0 + (1.0 - sin2).sqrt())
}

fn sky_arrival(scene: &Scene, sky: &EnvironmentLight, rng: &mut Rng) -> Arrival {
    let (direction, density) = sky.sample(rng);
    let power = environment::radiance(&scene.environment, direction) / density;
    Arrival { direction, distance: f64::INFINITY, power, density: Some(density), triangle: None, sphere: None }
}

/// Returns the first of two ordered distances that lies ahead.
pub fn first_beyond_start(distances: Option<[f64; 2]>) -> Option<f64> {
    distances.and_then(|both| both.into_iter().find(|&t| t > 0.0))
}
