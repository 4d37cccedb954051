//! The G-buffer at pixel centres is exact to f32 rounding: it agrees with rays traced in f64.

use std::cell::Cell;

use crate::common::{Stage, Subject, is_thorough};
use crate::pictures::seen_apart;
use crate::reference::Pinhole;
use crate::reference::intersect::{Geometry, Ray};
use crate::reference::layer;
use crate::reference::scenes::{materials, matte};
use crate::reference::surface::{Surface, Surfaces};
use diptych::image::Extent;
use diptych::passes::Aov;
use diptych::scene::Scene;
use diptych::scene::rig::{Eye, View};
use glam::DVec3;

const EXTENT: Extent = Extent::new(96, 64);

/// Half a unit in the last place of 1.
const ROUNDING: f64 = 5.960_464_477_539_063e-8;

/// Model of a scene in f64.
struct Exact<'a> {
    surfaces: Surfaces<'a>,
    geometry: Geometry,
}

/// Hit of a ray.
struct Seen {
    t: f64,
    surface: Surface,
    /// Shading normal and base colour.
    normal: DVec3,
    base: DVec3,
}

impl<'a> Exact<'a> {
    fn new(subject: &'a Subject) -> Self {
        let surfaces = Surfaces::new(&subject.scene);
        let geometry = Geometry::new(surfaces.triangles());
        Self { surfaces, geometry }
    }

    /// Returns longest edge over height, by which a triangle amplifies the rounding of its barycentrics.
    fn needle(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.geometry.triangles[triangle].vertices;
        let longest = [b - a, c - b, a - c].map(|e| e.length_squared()).into_iter().fold(0.0, f64::max);
        longest / (b - a).cross(c - a).length()
    }

    /// Traces a ray; the outer value is none if a surface on the way exists only by chance.
    fn look(&self, ray: &Ray) -> Option<Option<Seen>> {
        let by_chance = Cell::new(false);
        let is_there = |id: usize, weights| {
            let coverage = self.surfaces.coverage(&self.geometry.triangles[id], weights);
            by_chance.set(by_chance.get() || (coverage > 0.0 && coverage < 1.0));
            coverage > 0.0
        };
        let hit = self.geometry.closest(ray, f64::INFINITY, None, is_there);
        if by_chance.get() {
            return None;
        }
        Some(hit.map(|hit| {
            let triangle = &self.geometry.triangles[hit.triangle];
            let surface = self.surfaces.seen(hit.triangle, triangle, hit.weights, -ray.direction);
            let bsdf = surface.bsdf.expect("nothing here is unlit");
            Seen { t: hit.t, surface, normal: bsdf.normal, base: bsdf.base }
        }))
    }

    /// Returns the hit behind the pixel's centre; the outer value is none if that is on an edge of a triangle or a
    /// texel.
    fn behind(&self, view: &View, x: u32, y: u32) -> Option<Option<Seen>> {
        let ray = |dx: f64, dy: f64| Ray {
            origin: view.origin.as_dvec3(),
            direction: view.ray_direction(f64::from(x) + 0.5 + dx, f64::from(y) + 0.5 + dy, EXTENT),
        };
        let centre = self.look(&ray(0.0, 0.0))?;
        for (dx, dy) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            let beside = self.look(&ray(dx * 0.01, dy * 0.01))?;
            match (&centre, beside) {
                (None, None) => {}
                (Some(a), Some(b)) => {
                    let is_smooth = a.base.distance(b.base) < 0.02 && a.normal.dot(b.normal) > 0.9;
                    if a.surface.triangle != b.surface.triangle || !is_smooth {
                        return None;
                    }
                }
                _ => return None,
            }
        }
        Some(centre)
    }
}

/// Largest errors over a view, in units of the f32 tolerance.
#[derive(Debug, Default)]
struct Errors {
    compared: usize,
    sky: usize,
    position: f64,
    depth: f64,
    normal: f64,
    albedo: f64,
}

fn hold_against_rays(subject: &Subject) -> Errors {
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.buffers.aovs = vec![Aov::Position, Aov::Depth, Aov::Normal, Aov::Albedo];
    let mut stage = Stage::alone(subject, &settings);
    stage.frame(0);
    let aovs: Vec<_> = (0..4).map(|i| stage.aov(i)).collect();
    let exact = Exact::new(subject);
    let mut errors = Errors::default();
    for eye in Eye::BOTH {
        let view = subject.rig.view(0.0, eye);
        let planes = |i: usize| aovs[i].of(eye);
        for pixel in 0..EXTENT.area() {
            let (x, y) = (pixel as u32 % EXTENT.width, pixel as u32 / EXTENT.width);
            let Some(seen) = exact.behind(&view, x, y) else { continue };
            let vector = |i: usize| DVec3::from_array(std::array::from_fn(|c| f64::from(planes(i)[c][pixel])));
            let (position, normal, albedo) = (vector(0), vector(2), vector(3));
            let depth = f64::from(planes(1)[0][pixel]);
            let Some(Seen { t, surface, normal: shading_normal, base }) = seen else {
                assert_eq!((depth, albedo), (0.0, DVec3::ZERO), "{}: the sky at ({x}, {y})", subject.name);
                errors.sky += 1;
                continue;
            };
            // Grazing angles amplify an error of the ray; positions are as coarse as coordinates.
            let cosine = surface.geometric_normal.dot((view.origin.as_dvec3() - surface.position) / t).abs();
            let coordinates = view.origin.as_dvec3().length() + surface.position.length();
            let unit = ROUNDING * (t + coordinates) / cosine.max(1e-3);
            let needle = exact.needle(surface.triangle);
            let place = || format!("{}, {eye} eye, ({x}, {y})", subject.name);
            let mut keep = |of: fn(&mut Errors) -> &mut f64, error: f64| {
                assert!(error.is_finite(), "{}", place());
                let worst = of(&mut errors);
                *worst = worst.max(error);
            };
            keep(|e| &mut e.position, position.distance(surface.position) / (unit * needle));
            keep(|e| &mut e.depth, (depth - t).abs() / unit);
            keep(|e| &mut e.normal, normal.distance(shading_normal) / needle);
            keep(|e| &mut e.albedo, (albedo - base).abs().max_element());
            errors.compared += 1;
        }
    }
    println!("{}: {errors:?}", subject.name);
    errors
}

/// Checks matte surfaces: the albedo of others is more than their base colour.
#[track_caller]
fn assert_exact(subject: &Subject) {
    let errors = assert_exact_geometry(subject);
    assert!(errors.albedo < 1e-4, "{}: albedos: {errors:?}", subject.name);
}

#[track_caller]
fn assert_exact_geometry(subject: &Subject) -> Errors {
    let errors = hold_against_rays(subject);
    let name = &subject.name;
    assert!(errors.compared + errors.sky > EXTENT.area(), "{name}: too few pixels are away from edges: {errors:?}");
    assert!(errors.position < 8.0, "{name}: positions: {errors:?}");
    assert!(errors.depth < 8.0, "{name}: depths: {errors:?}");
    assert!(errors.normal < 1e-4, "{name}: normals: {errors:?}");
    errors
}

#[test]
fn gbuffer_of_small_scenes_is_exact() {
    matte::all().into_iter().for_each(|row| assert_exact(&unlit(row)));
}

/// Error of the renderer's albedo table, which is coarser than the reference's and interpolated linearly: up to 1.5 %
/// at grazing angles.
const TABLE: f64 = 0.02;

#[test]
fn base_diffuse_and_specular_colours_are_exact() {
    let quick = ["metals", "clearcoats", "material_textures"];
    let is_asked = |name: &str| if is_thorough() { name != "unlit" } else { quick.contains(&name) };
    for row in materials::ALL.into_iter().filter(|row| is_asked(row.0)) {
        let (name, subject) = (row.0, unlit(materials::build(row)));
        let mut settings = subject.settings(EXTENT.width, EXTENT.height);
        settings.buffers.aovs = vec![Aov::BaseColor, Aov::DiffuseAlbedo, Aov::SpecularAlbedo];
        let mut stage = Stage::alone(&subject, &settings);
        stage.frame(0);
        let planes: Vec<_> = (0..3).map(|i| stage.aov(i).into_left()).collect();
        let exact = Exact::new(&subject);
        let view = subject.rig.view(0.0, Eye::LEFT);
        let value_at =
            |i: usize, pixel: usize| DVec3::from_array(std::array::from_fn(|c| f64::from(planes[i][c][pixel])));
        let mut compared = 0;
        for pixel in 0..EXTENT.area() {
            let (x, y) = (pixel as u32 % EXTENT.width, pixel as u32 / EXTENT.width);
            let Some(seen) = exact.behind(&view, x, y) else { continue };
            let value = |i: usize| value_at(i, pixel);
            let Some(bsdf) = seen.and_then(|seen| seen.surface.bsdf) else {
                assert!((0..3).all(|i| value(i) == DVec3::ZERO), "{name}: the sky at ({x}, {y})");
                continue;
            };
            let diffuse = (1.0 - bsdf.metallic) * (1.0 - bsdf.transmission) * bsdf.base;
            let f0 = bsdf.f0.lerp(bsdf.base, bsdf.metallic);
            let f90 = bsdf.f90 + (1.0 - bsdf.f90) * bsdf.metallic;
            let mu = bsdf.normal.dot(bsdf.to_viewer);
            let facets = f0.map(|f0| layer::albedo(bsdf.alpha, f0, f90, mu));
            let specular = facets.lerp(DVec3::ONE, bsdf.coat_reflectance());
            let off = |i: usize, expected: DVec3| (value(i) - expected).abs().max_element();
            let place = format!("{name} at ({x}, {y})");
            assert!(off(0, bsdf.base) < 1e-4, "{place}: base colour {} and {}", value(0), bsdf.base);
            assert!(off(1, diffuse) < 1e-4, "{place}: diffuse {} and {diffuse}", value(1));
            assert!(off(2, specular) < TABLE, "{place}: specular {} and {specular}", value(2));
            compared += 1;
        }
        assert!(compared > EXTENT.area() / 4, "{name}: {compared} pixels compared");
    }
}

#[test]
fn mapped_normals_are_exact() {
    assert_exact_geometry(&unlit(materials::named("normal_maps")));
}

/// Returns the scene without spherical lights, which have no triangles, so that the reference's intersection cannot find
/// them.
fn unlit((scene, camera): (Scene, Pinhole)) -> Subject {
    seen_apart((Scene { lights: Vec::new(), ..scene }, camera))
}

#[test]
fn gbuffer_of_the_cornell_box_is_exact() {
    assert_exact(&Subject::load("builtin:cornell"));
}

#[test]
fn gbuffer_of_many_triangles_is_exact() {
    let Subject { mut scene, rig, name, .. } = Subject::load("builtin:atrium");
    for material in &mut scene.materials {
        (material.specular, material.metallic) = (0.0, 0.0);
    }
    assert_exact(&Subject::new(&name, scene, rig));
}
