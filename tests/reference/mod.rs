//! An independent path tracer for tests: a z-test compares the renderer with it.
//!
//! It shares only the [`Scene`], the pixel and the light transport model below with the renderer. It is as simple as an
//! unbiased estimator can be: plain Rust, f64, one thread per core, no Russian roulette. The model:
//!
//! - **Camera**: a pinhole, box filter over the pixel.
//! - **Depth**: light that reaches the camera after k scatterings, at transmitting surfaces too, counts iff
//!   k <= `bounces` + 1. `bounces` = 0 is the first hit's emission and its direct light.
//! - **Surfaces**: see [`bsdf`] and [`surface`]. Reflected light counts only above both the shading and the geometric
//!   normal, transmitted light only below both.
//! - **Emission**: from the front (of both sides if double-sided); front is the counter-clockwise side, the
//!   clockwise one where an instance mirrors. Unlit surfaces show their colour to both sides.
//! - **Alpha**: a mask is there or not, a blended surface is there with probability alpha.
//! - **Volumes**: see [`medium`].
//! - **Shadows**: light of a directional light, or of a point or spot without a radius, passes thin, smooth
//!   transmitting surfaces straight on, which is no scattering. To all other shadow rays transmitting surfaces are
//!   opaque.
//! - **Lights**: see [`lights`]. Spherical lights are seen by the camera and by bounces; they are black, paths end
//!   there.

#![allow(dead_code)] // Each test binary uses a part.

pub mod asserts;
pub mod bsdf;
pub mod environment;
pub mod film;
pub mod intersect;
pub mod layer;
pub mod lights;
pub mod medium;
pub mod microfacet;
pub mod sampling;
pub mod sheen;
pub mod scenes;
pub mod surface;
pub mod tangents;
pub mod texture;
pub mod ztest;

use std::ops::Range;
use std::sync::Mutex;

use diptych::image::Extent;
use diptych::scene::Scene;
use glam::{DVec3, Vec3};

use environment::EnvironmentLight;
use intersect::{Geometry, Ray, sphere_distances};
use lights::{EmissiveTriangles, Lighting, Receiver, SphereLight, first_beyond_start};
use medium::Medium;
use sampling::{Rng, uniform_of_candidate};
use surface::{Surface, Surfaces};
use ztest::{Estimate, Moments};

/// Camera. `right`, `up` and `forward` are orthonormal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    pub origin: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    pub tan_half_yfov: f32,
}

impl Pinhole {
    pub fn looking_at(origin: Vec3, target: Vec3, up: Vec3, yfov_deg: f32) -> Self {
        let forward = (target - origin).normalize();
        let right = forward.cross(up).normalize();
        let tan_half_yfov = (yfov_deg.to_radians() / 2.0).tan();
        Self { origin, right, up: right.cross(forward), forward, tan_half_yfov }
    }

    /// Returns the ray through the image point (`x`, `y`), in pixels from the top left corner.
    fn ray(&self, x: f64, y: f64, extent: Extent) -> Ray {
        let (width, height) = (f64::from(extent.width), f64::from(extent.height));
        let tan = f64::from(self.tan_half_yfov);
        let along_right = (2.0 * x / width - 1.0) * tan * width / height;
        let along_up = (1.0 - 2.0 * y / height) * tan;
        let direction = self.forward.as_dvec3() + self.right.as_dvec3() * along_right + self.up.as_dvec3() * along_up;
        Ray { origin: self.origin.as_dvec3(), direction: direction.normalize() }
    }
}

/// Estimator for light sources with extent. The camera's ray sees them in any case, and all estimators have the same
/// mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Emitters {
    /// Explicit samples and bounces, weighted by multiple importance sampling.
    #[default]
    Sampled,
    /// Bounce rays that hit the light.
    BounceHits,
}

/// Samples of each light at the first surface of a path.
const FIRST_LIGHT_SAMPLES: u32 = 2;

enum Found {
    Nothing,
    /// Index into `Reference::spheres`.
    Sphere(usize),
    Surface(Box<Surface>),
}

/// Object hit by a ray, with its distance.
struct Hit {
    found: Found,
    distance: f64,
}

/// A ray from the camera or from a surface, with the throughput of its path.
struct Segment {
    ray: Ray,
    /// Triangle on which it starts.
    left: Option<usize>,
    /// Density by solid angle of its direction; none for the camera and for deltas, which explicit samples never match.
    density: Option<f64>,
    medium: Medium,
    throughput: DVec3,
}

pub struct Reference<'a> {
    surfaces: Surfaces<'a>,
    geometry: Geometry,
    spheres: Vec<SphereLight>,
    emissive: EmissiveTriangles,
    sky: Option<EnvironmentLight>,
    emitters: Emitters,
}

impl<'a> Reference<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        let surfaces = Surfaces::new(scene);
        let geometry = Geometry::new(surfaces.triangles());
        let emissive = EmissiveTriangles::new(&surfaces, &geometry);
        let spheres = lights::sphere_lights(scene);
        let sky = EnvironmentLight::new(&scene.environment);
        Self { surfaces, geometry, spheres, emissive, sky, emitters: Emitters::default() }
    }

    pub fn with_emitters(self, emitters: Emitters) -> Self {
        Self { emitters, ..self }
    }

    /// Returns the mean radiance per pixel over `spp` >= 2 paths, and the variance of that mean. The result depends on
    /// `seed`, but not on the number of threads.
    pub fn render(&self, camera: &Pinhole, extent: Extent, spp: u32, bounces: u32, seed: u64) -> Estimate {
        assert!(spp >= 2, "a variance needs two samples or more");
        let width = extent.width as usize;
        let mut pixels = vec![Moments::default(); extent.area()];
        let rows = Mutex::new(pixels.chunks_mut(width.max(1)).enumerate());
        let work = || {
            loop {
                // A separate binding releases the lock before the row is traced.
                let next = rows.lock().unwrap().next();
                let Some((y, row)) = next else { break };
                for (x, moments) in row.iter_mut().enumerate() {
                    let mut rng = Rng::new(seed, (y * width + x) as u64);
                    for _ in 0..spp {
                        let (jx, jy) = (rng.uniform(), rng.uniform());
                        let ray = camera.ray(x as f64 + jx, y as f64 + jy, extent);
                        moments.add(self.radiance(ray, bounces, &mut rng).to_array());
                    }
                }
            }
        };
        on_all_cores(work);
        Estimate::from_moments(extent, &pixels)
    }

    /// Returns independent renders of `spp` paths per pixel, one for each of the `seeds`. The paths of a render are
    /// points of a lattice, so that errors cancel within a pixel and between pixels. Powers of two are best, for pixels
    /// as well.
    pub fn renders(
        &self,
        camera: &Pinhole,
        extent: Extent,
        spp: u32,
        bounces: u32,
        seeds: Range<u64>,
    ) -> Vec<Vec<[f64; 3]>> {
        let pixel = |seed: u64, (x, y): (u32, u32)| {
            let path = |index: u32| {
                let mut rng = Rng::of_lattice(seed, u64::from((y * extent.width + x) * spp + index));
                let [jx, jy] = rng.uniforms();
                self.radiance(camera.ray(f64::from(x) + jx, f64::from(y) + jy, extent), bounces, &mut rng)
            };
            ((0..spp).map(path).sum::<DVec3>() / f64::from(spp)).to_array()
        };
        let render = |seed: u64| {
            let pixels = (0..extent.height).flat_map(|y| (0..extent.width).map(move |x| (x, y)));
            pixels.map(|at| pixel(seed, at)).collect::<Vec<_>>()
        };
        let mut renders = vec![Vec::new(); seeds.clone().count()];
        let rest = Mutex::new(seeds.zip(&mut renders));
        let work = || {
            loop {
                let next = rest.lock().unwrap().next();
                let Some((seed, place)) = next else { break };
                *place = render(seed);
            }
        };
        on_all_cores(work);
        renders
    }

    /// Returns the mean radiance that arrives at `origin` from `direction`, as an image of one pixel.
    pub fn probe(&self, origin: Vec3, direction: Vec3, spp: u32, bounces: u32, seed: u64) -> Estimate {
        let mut rng = Rng::new(seed, 0);
        let mut moments = Moments::default();
        let direction = direction.as_dvec3().normalize();
        for _ in 0..spp {
            let ray = Ray { origin: origin.as_dvec3(), direction };
            moments.add(self.radiance(ray, bounces, &mut rng).to_array());
        }
        Estimate::from_moments(Extent::new(1, 1), &[moments])
    }

    /// Traces one path: an unbiased sample of the radiance that arrives along `ray`.
    fn radiance(&self, ray: Ray, bounces: u32, rng: &mut Rng) -> DVec3 {
        let lighting = self.lighting();
        let most_reflections = u64::from(bounces) + 1;
        let (throughput, medium) = (DVec3::ONE, Medium::default());
        let mut segment = Segment { ray, left: None, density: None, medium, throughput };
        let mut radiance = DVec3::ZERO;
        for reflections in 0..=most_reflections {
            let hit = self.closest(&segment.ray, segment.left, rng);
            let Found::Surface(surface) = &hit.found else {
                return radiance + self.background(&segment, &hit, &lighting);
            };
            segment.medium = segment.medium.known_at(surface);
            segment.throughput *= segment.medium.transmittance(hit.distance);
            let weight = segment.density.map_or(1.0, |density| {
                let triangle = &self.geometry.triangles[surface.triangle];
                let sampled = self.emissive.density(&self.surfaces, triangle, segment.ray.direction, hit.distance);
                density / (density + sampled.unwrap_or(0.0))
            });
            radiance += segment.throughput * surface.emission * weight;
            let Some(bsdf) = surface.bsdf.as_ref().filter(|_| reflections < most_reflections) else {
                break;
            };
            let receiver = Receiver { surface, bsdf, medium: &segment.medium };
            // Direct light at the first surface causes most of the noise, and additional samples there are cheap.
            let samples = if reflections == 0 { FIRST_LIGHT_SAMPLES } else { 1 };
            let direct: DVec3 = (0..samples).map(|_| lighting.direct(&receiver, rng)).sum();
            radiance += segment.throughput * direct / f64::from(samples);
            let Some(scattered) = bsdf.sample(rng.uniforms()) else {
                break;
            };
            segment = Segment {
                ray: Ray { origin: surface.position, direction: scattered.direction },
                left: Some(surface.triangle),
                density: scattered.density.filter(|_| lighting.samples_extended),
                medium: segment.medium.beyond(surface, scattered.direction),
                throughput: segment.throughput * scattered.weight,
            };
        }
        radiance
    }

    fn lighting(&self) -> Lighting<'_> {
        Lighting {
            surfaces: &self.surfaces,
            geometry: &self.geometry,
            spheres: &self.spheres,
            emissive: &self.emissive,
            sky: self.sky.as_ref(),
            samples_extended: self.emitters == Emitters::Sampled,
        }
    }

    /// Returns the light at the path's end: of a spherical light or the environment.
    fn background(&self, segment: &Segment, hit: &Hit, lighting: &Lighting) -> DVec3 {
        let (light, sampled) = match hit.found {
            Found::Sphere(index) => {
                (self.sphere_seen(index, &segment.ray), lighting.sphere_density(index, segment.ray.origin))
            }
            _ => {
                let direction = segment.ray.direction;
                let sky = environment::radiance(&self.surfaces.scene.environment, direction);
                (sky, self.sky.as_ref().map(|sky| sky.density(direction)))
            }
        };
        let weight = segment.density.map_or(1.0, |density| density / (density + sampled.unwrap_or(0.0)));
        segment.throughput * segment.medium.transmittance(hit.distance) * light * weight
    }

    /// Returns the first hit of a ray that leaves the triangle `left`.
    fn closest(&self, ray: &Ray, left: Option<usize>, rng: &mut Rng) -> Hit {
        let nearest_sphere = self
            .spheres
            .iter()
            .enumerate()
            .filter_map(|(i, s)| Some((i, first_beyond_start(sphere_distances(ray, s.centre, s.radius))?)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let t_max = nearest_sphere.map_or(f64::INFINITY, |(_, t)| t);
        let key = rng.bits();
        let is_there = |id: usize, weights| {
            let coverage = self.surfaces.coverage(&self.geometry.triangles[id], weights);
            coverage >= 1.0 || uniform_of_candidate(key, id) < coverage
        };
        match self.geometry.closest(ray, t_max, left, is_there) {
            Some(hit) => {
                let triangle = &self.geometry.triangles[hit.triangle];
                let surface = self.surfaces.seen(hit.triangle, triangle, hit.weights, -ray.direction);
                Hit { found: Found::Surface(Box::new(surface)), distance: hit.t }
            }
            None => {
                let found = nearest_sphere.map_or(Found::Nothing, |(index, _)| Found::Sphere(index));
                Hit { found, distance: t_max }
            }
        }
    }

    /// Returns the radiance of a spherical light as seen along a ray: none from inside. The cone of a spot depends on
    /// the direction from its centre to the ray's start, for the whole sphere.
    fn sphere_seen(&self, index: usize, ray: &Ray) -> DVec3 {
        let sphere = &self.spheres[index];
        let from_centre = ray.origin - sphere.centre;
        if from_centre.length() <= sphere.radius {
            return DVec3::ZERO;
        }
        let light = &self.surfaces.scene.lights[sphere.light];
        lights::sphere_radiance(light, sphere.radius, from_centre.normalize())
    }
}

fn on_all_cores(work: impl Fn() + Copy + Send) {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(work);
        }
    });
}
