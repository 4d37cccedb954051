//! A second path tracer, for tests only: the renderer under test is held against it by z-test.
//!
//! It shares nothing with the renderer but the [`Scene`], the pixel and the model of light below, and it is as
//! simple as an unbiased estimator can be: plain Rust, f64, one thread per core, no multiple importance
//! sampling, no Russian roulette. What it computes:
//!
//! - **Camera**: a pinhole, box filter over the pixel.
//! - **Depth**: light that reaches the camera over k reflections counts iff k <= `bounces` + 1. `bounces` = 0
//!   is the first hit's emission and its direct light.
//! - **Surfaces**: Lambertian, both sides reflect; albedo is base colour × vertex colour × texture. Light counts
//!   only above both the shading and the geometric normal; a shading normal that faces away from the viewer is
//!   replaced by the geometric one. Bounces are drawn by cosine around the shading normal, and end where they
//!   would leave below the geometric surface.
//! - **Emission**: from the front (of both sides if double-sided); front is the counter-clockwise side, the
//!   clockwise one where an instance mirrors.
//! - **Alpha**: a mask is there or not, a blended surface is there with probability alpha.
//! - **Lights**: see [`lights`]. Spherical lights are seen by the camera; they are black, paths end there.
//!
//! Which estimator finds which light, so that each is counted once: the environment by rays that escape;
//! punctual and spherical lights by explicit samples, and by the camera's ray; emissive triangles by the camera's
//! ray and by either explicit samples or bounce rays ([`Emitters`]).

#![allow(dead_code)] // Each test binary uses a part.

pub mod intersect;
pub mod lights;
pub mod sampling;
pub mod scenes;
pub mod surface;
pub mod texture;
pub mod ztest;

use std::sync::Mutex;

use diptych::image::Extent;
use diptych::scene::Scene;
use glam::{DVec3, Vec3};

use intersect::{Geometry, Ray, sphere_distances};
use lights::{EmissiveTriangles, Lighting, SphereLight, first_beyond_start};
use sampling::{Rng, cosine_direction, uniform_of_candidate};
use surface::{Surface, Surfaces};
use ztest::{Estimate, Moments};

/// Where the image is seen from. `right`, `up` and `forward` are orthonormal.
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
        Self {
            origin,
            right,
            up: right.cross(forward),
            forward,
            tan_half_yfov,
        }
    }

    /// Ray through the image point (`x`, `y`), pixels from the top left corner.
    fn ray(&self, x: f64, y: f64, extent: Extent) -> Ray {
        let (width, height) = (f64::from(extent.width), f64::from(extent.height));
        let tan = f64::from(self.tan_half_yfov);
        let along_right = (2.0 * x / width - 1.0) * tan * width / height;
        let along_up = (1.0 - 2.0 * y / height) * tan;
        let direction = self.forward.as_dvec3()
            + self.right.as_dvec3() * along_right
            + self.up.as_dvec3() * along_up;
        Ray {
            origin: self.origin.as_dvec3(),
            direction: direction.normalize(),
        }
    }
}

/// How light from emissive triangles is found (beside the camera's ray, which always sees them). The mean is
/// the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Emitters {
    /// One point of all emissive area at each hit, with probability ∝ area × luminance of the factor.
    #[default]
    Area,
    /// Bounce rays run into them.
    BounceHits,
}

enum Hit {
    Nothing,
    /// Index into `Reference::spheres`.
    Sphere(usize),
    Surface(Surface),
}

pub struct Reference<'a> {
    surfaces: Surfaces<'a>,
    geometry: Geometry,
    spheres: Vec<SphereLight>,
    emissive: EmissiveTriangles,
    emitters: Emitters,
}

impl<'a> Reference<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        let surfaces = Surfaces::new(scene);
        let geometry = Geometry::new(surfaces.triangles());
        let emissive = EmissiveTriangles::new(&surfaces, &geometry);
        let spheres = lights::sphere_lights(scene);
        Self {
            surfaces,
            geometry,
            spheres,
            emissive,
            emitters: Emitters::default(),
        }
    }

    pub fn with_emitters(self, emitters: Emitters) -> Self {
        Self { emitters, ..self }
    }

    /// Mean radiance per pixel over `spp` >= 2 paths, and the variance of that mean. The same for the same
    /// `seed`, whatever the number of threads.
    pub fn render(
        &self,
        camera: &Pinhole,
        extent: Extent,
        spp: u32,
        bounces: u32,
        seed: u64,
    ) -> Estimate {
        assert!(spp >= 2, "a variance needs two samples or more");
        let width = extent.width as usize;
        let mut pixels = vec![Moments::default(); extent.area()];
        let rows = Mutex::new(pixels.chunks_mut(width.max(1)).enumerate());
        let work = || {
            loop {
                // A binding of its own, so that the lock is gone before the row is traced.
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
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(work);
            }
        });
        Estimate::from_moments(extent, &pixels)
    }

    /// Mean radiance that arrives at `origin` from the way `direction` points, as an image of one pixel.
    pub fn probe(
        &self,
        origin: Vec3,
        direction: Vec3,
        spp: u32,
        bounces: u32,
        seed: u64,
    ) -> Estimate {
        let mut rng = Rng::new(seed, 0);
        let mut moments = Moments::default();
        let direction = direction.as_dvec3().normalize();
        for _ in 0..spp {
            let ray = Ray {
                origin: origin.as_dvec3(),
                direction,
            };
            moments.add(self.radiance(ray, bounces, &mut rng).to_array());
        }
        Estimate::from_moments(Extent::new(1, 1), &[moments])
    }

    /// One path: an unbiased sample of the radiance that arrives along `ray`.
    fn radiance(&self, mut ray: Ray, bounces: u32, rng: &mut Rng) -> DVec3 {
        let lighting = Lighting {
            surfaces: &self.surfaces,
            geometry: &self.geometry,
            spheres: &self.spheres,
        };
        let sampled = (self.emitters == Emitters::Area).then_some(&self.emissive);
        let most_reflections = u64::from(bounces) + 1;
        let mut radiance = DVec3::ZERO;
        let mut throughput = DVec3::ONE;
        let mut left = None;
        for reflections in 0..=most_reflections {
            let surface = match self.closest(&ray, left, rng) {
                Hit::Nothing => {
                    let sky = &self.surfaces.scene.environment;
                    return radiance + throughput * texture::environment(sky, ray.direction);
                }
                Hit::Sphere(index) if reflections == 0 => return self.sphere_seen(index, &ray),
                Hit::Sphere(_) => return radiance,
                Hit::Surface(surface) => surface,
            };
            if reflections == 0 || sampled.is_none() {
                radiance += throughput * surface.emission;
            }
            if reflections == most_reflections {
                break;
            }
            radiance += throughput * lighting.direct(&surface, sampled, rng);
            let direction = cosine_direction(surface.shading_normal, rng);
            if surface.geometric_normal.dot(direction) <= 0.0 {
                break;
            }
            // (albedo / π) cos θ over the density cos θ / π.
            throughput *= surface.albedo;
            ray = Ray {
                origin: surface.position,
                direction,
            };
            left = Some(surface.triangle);
        }
        radiance
    }

    /// What a ray that leaves the triangle `left` meets first.
    fn closest(&self, ray: &Ray, left: Option<usize>, rng: &mut Rng) -> Hit {
        let nearest_sphere = self
            .spheres
            .iter()
            .enumerate()
            .filter_map(|(i, s)| {
                Some((
                    i,
                    first_beyond_start(sphere_distances(ray, s.centre, s.radius))?,
                ))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let t_max = nearest_sphere.map_or(f64::INFINITY, |(_, t)| t);
        let key = rng.bits();
        let is_there = |id: usize, weights| {
            let coverage = self
                .surfaces
                .coverage(&self.geometry.triangles[id], weights);
            coverage >= 1.0 || uniform_of_candidate(key, id) < coverage
        };
        match self.geometry.closest(ray, t_max, left, is_there) {
            Some(hit) => {
                let triangle = &self.geometry.triangles[hit.triangle];
                let to_viewer = -ray.direction;
                Hit::Surface(
                    self.surfaces
                        .seen(hit.triangle, triangle, hit.weights, to_viewer),
                )
            }
            None => nearest_sphere.map_or(Hit::Nothing, |(index, _)| Hit::Sphere(index)),
        }
    }

    /// Radiance of a spherical light as the camera sees it: nothing from inside, and a spot's cone is that of
    /// the way from the centre to the camera, for the whole sphere.
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
