//! Surface properties at a hit: normals, the textured material, emission, coverage.

use diptych::scene::{AlphaMode, Material, Mesh, NormalMap, Scene, TextureRef, Volume};
use glam::{DAffine3, DMat3, DVec2, DVec3, DVec4, Vec2};

use super::bsdf::{Brushed, Bsdf, Coat, Interior};
use super::film;
use super::intersect::Triangle;
use super::layer::SMOOTH_ALPHA;
use super::sampling::tangents;
use super::sheen::{LEAST_ROUGHNESS, Sheen};
use super::texture::{self, Encoding};

/// Minimum cosine between a mapped normal and the viewer.
const LEAST_FACING: f64 = 0.001;

/// An instance's transforms in f64.
struct Placement {
    world_from_local: DAffine3,
    /// Inverse transpose up to a factor (the cofactors), which also exists for flattened instances.
    world_from_local_normal: DMat3,
    /// −1 if the determinant is negative: then the front is the clockwise side.
    winding: f64,
}

/// The scene's surfaces, in world space.
pub struct Surfaces<'a> {
    pub scene: &'a Scene,
    placements: Vec<Placement>,
}

/// A point of a surface, seen from a given side.
#[derive(Clone, Copy, Debug)]
pub struct Surface {
    pub triangle: usize,
    pub position: DVec3,
    /// Unit geometric normal on the side of the viewer.
    pub geometric_normal: DVec3,
    /// Radiance emitted towards the viewer.
    pub emission: DVec3,
    /// BSDF; none for unlit materials, which scatter nothing.
    pub bsdf: Option<Bsdf>,
    /// Volume that a thick transmitting surface encloses.
    pub volume: Option<Volume>,
    /// True if the viewer is on the back of the triangle.
    pub on_back: bool,
}

impl<'a> Surfaces<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        let placements = scene
            .instances
            .iter()
            .map(|instance| {
                let m = instance.world_from_local;
                let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis]
                    .map(|axis| glam::Vec3::from(axis).as_dvec3());
                let linear = DMat3::from_cols(x, y, z);
                let winding = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
                let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * winding;
                let translation = glam::Vec3::from(m.translation).as_dvec3();
                Placement {
                    world_from_local: DAffine3::from_mat3_translation(linear, translation),
                    world_from_local_normal: cofactors,
                    winding,
                }
            })
            .collect();
        Self { scene, placements }
    }

    /// Returns all instances' triangles in world space.
    pub fn triangles(&self) -> Vec<Triangle> {
        let of_instance = |(instance, placement): (usize, &Placement)| {
            let mesh = &self.scene.meshes[self.scene.instances[instance].mesh];
            let world: Vec<DVec3> =
                mesh.positions.iter().map(|p| placement.world_from_local.transform_point3(p.as_dvec3())).collect();
            let triangle = |(index, corners): (usize, &[u32; 3])| {
                let vertices = corners.map(|i| world[i as usize]);
                Triangle { vertices, instance, index }
            };
            mesh.triangles.iter().enumerate().map(triangle).collect::<Vec<_>>()
        };
        self.placements.iter().enumerate().flat_map(of_instance).collect()
    }

    pub fn material(&self, triangle: &Triangle) -> &'a Material {
        &self.scene.materials[self.mesh(triangle).material]
    }

    fn mesh(&self, triangle: &Triangle) -> &'a Mesh {
        &self.scene.meshes[self.scene.instances[triangle.instance].mesh]
    }

    fn corners(&self, triangle: &Triangle) -> [usize; 3] {
        self.mesh(triangle).triangles[triangle.index].map(|i| i as usize)
    }

    /// Returns the unit normal of the front side; undefined (NaN) for a degenerate triangle.
    pub fn front_normal(&self, triangle: &Triangle) -> DVec3 {
        let [a, b, c] = triangle.vertices;
        (b - a).cross(c - a).normalize() * self.placements[triangle.instance].winding
    }

    /// Returns the probability that the surface is there.
    pub fn coverage(&self, triangle: &Triangle, weights: [f64; 3]) -> f64 {
        let alpha = || self.base_color(triangle, weights).w;
        match self.material(triangle).alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { cutoff } if alpha() >= f64::from(cutoff) => 1.0,
            AlphaMode::Mask { .. } => 0.0,
            AlphaMode::Blend => alpha().clamp(0.0, 1.0),
        }
    }

    /// Returns the fraction of light from straight behind that passes an existing surface to a viewer.
    pub fn straight(&self, id: usize, triangle: &Triangle, weights: [f64; 3], to_viewer: DVec3) -> DVec3 {
        if self.material(triangle).transmission == 0.0 {
            return DVec3::ZERO;
        }
        self.seen(id, triangle, weights, to_viewer).bsdf.map_or(DVec3::ZERO, |bsdf| bsdf.straight())
    }

    /// Returns the surface at `weights` as seen from the unit direction `to_viewer`.
    pub fn seen(&self, id: usize, triangle: &Triangle, weights: [f64; 3], to_viewer: DVec3) -> Surface {
        let material = self.material(triangle);
        let front = self.front_normal(triangle);
        let on_back = front.dot(to_viewer) < 0.0;
        let geometric_normal = if on_back { -front } else { front };
        let lit = !material.unlit;
        Surface {
            triangle: id,
            position: interpolate(triangle.vertices, weights, DVec3::ZERO),
            geometric_normal,
            emission: self.emission(triangle, weights, to_viewer),
            bsdf: lit.then(|| self.bsdf(triangle, weights, to_viewer, geometric_normal)),
            volume: enclosed_volume(material).filter(|_| lit),
            on_back,
        }
    }

    /// Returns the radiance that the point at `weights` emits towards a viewer.
    pub fn emission(&self, triangle: &Triangle, weights: [f64; 3], to_viewer: DVec3) -> DVec3 {
        let material = self.material(triangle);
        if material.unlit {
            return self.base_color(triangle, weights).truncate();
        }
        let front = self.front_normal(triangle);
        if material.emissive == glam::Vec3::ZERO || !material.double_sided && front.dot(to_viewer) <= 0.0 {
            return DVec3::ZERO;
        }
        let texel = self.texel(triangle, weights, material.emissive_texture, Encoding::Srgb);
        let emitted = material.emissive.as_dvec3() * texel.truncate();
        if material.clearcoat.factor == 0.0 {
            return emitted;
        }
        let geometric_normal = if front.dot(to_viewer) < 0.0 { -front } else { front };
        emitted * (1.0 - self.bsdf(triangle, weights, to_viewer, geometric_normal).coat_reflectance())
    }

    fn bsdf(&self, triangle: &Triangle, weights: [f64; 3], to_viewer: DVec3, geometric_normal: DVec3) -> Bsdf {
        let material = self.material(triangle);
        let linear = |texture| self.texel(triangle, weights, texture, Encoding::Linear);
        let normal = |map| self.shading_normal(triangle, weights, to_viewer, geometric_normal, map);
        let metallic_roughness = linear(material.metallic_roughness_texture);
        let ior = f64::from(material.ior);
        let reflectance = if ior == 0.0 { 1.0 } else { ((ior - 1.0) / (ior + 1.0)).powi(2) };
        let tint = self.texel(triangle, weights, material.specular_color_texture, Encoding::Srgb).truncate();
        let f90 = f64::from(material.specular) * linear(material.specular_texture).w;
        let bare = (reflectance * material.specular_color.as_dvec3() * tint).min(DVec3::ONE);
        let normal_seen = normal(material.normal_map);
        let film = &material.iridescence;
        let covered = f64::from(film.factor) * linear(film.factor_texture).x;
        let under_film = |bare: DVec3| {
            if covered == 0.0 {
                return bare;
            }
            let [least, most] = film.thickness_nm.map(f64::from);
            let thickness = least + (most - least) * linear(film.thickness_texture).y;
            bare.lerp(film::f0(film, thickness, normal_seen.dot(to_viewer), bare), covered)
        };
        let f0 = under_film(bare) * f90;
        let base = self.base_color(triangle, weights).truncate();
        let index = if ior == 0.0 { 1.0 } else { ior };
        let across = (f64::from(material.roughness) * metallic_roughness.y).powi(2);
        let brushed = self.brushed(triangle, weights, normal_seen, across);
        Bsdf {
            to_viewer,
            normal: normal_seen,
            geometric_normal,
            base,
            metal_f0: under_film(base),
            metallic: f64::from(material.metallic) * metallic_roughness.z,
            alpha: brushed.map_or(across, |brushed| (brushed.alpha[0] * brushed.alpha[1]).sqrt()),
            brushed,
            f0,
            f90,
            transmission: f64::from(material.transmission) * linear(material.transmission_texture).x,
            interior: if enclosed_volume(material).is_some() { Interior::Thick { index } } else { Interior::Thin },
            dispersion: f64::from(material.dispersion) * (index - 1.0) / 40.0,
            on_back: self.front_normal(triangle).dot(to_viewer) < 0.0,
            coat: (material.clearcoat.factor > 0.0).then(|| Coat {
                strength: f64::from(material.clearcoat.factor) * linear(material.clearcoat.factor_texture).x,
                alpha: (f64::from(material.clearcoat.roughness) * linear(material.clearcoat.roughness_texture).y)
                    .powi(2),
                normal: normal(material.clearcoat.normal_map),
            }),
            through: f64::from(material.diffuse_transmission.factor)
                * linear(material.diffuse_transmission.factor_texture).w,
            through_color: material.diffuse_transmission.color.as_dvec3()
                * self.texel(triangle, weights, material.diffuse_transmission.color_texture, Encoding::Srgb).truncate(),
            sheen: material.sheen.is_there().then(|| Sheen {
                color: material.sheen.color.as_dvec3()
                    * self.texel(triangle, weights, material.sheen.color_texture, Encoding::Srgb).truncate(),
                roughness: (f64::from(material.sheen.roughness) * linear(material.sheen.roughness_texture).w)
                    .max(LEAST_ROUGHNESS),
            }),
        }
    }

    /// Returns the facets of a material with anisotropy; `None` without it or without tangents.
    fn brushed(&self, triangle: &Triangle, weights: [f64; 3], normal: DVec3, across: f64) -> Option<Brushed> {
        let anisotropy = self.material(triangle).anisotropy;
        let code = match anisotropy.texture {
            Some(_) => self.texel(triangle, weights, anisotropy.texture, Encoding::Linear),
            None => DVec4::new(1.0, 0.5, 1.0, 1.0),
        };
        let strength = f64::from(anisotropy.strength) * code.z;
        let (tangent, sign) = self.tangent(triangle, weights).filter(|_| strength > 0.0)?;
        let up = self.smooth_normal(triangle, weights).unwrap_or(self.front_normal(triangle));
        let t = (tangent - up * up.dot(tangent)).try_normalize()?;
        let local = DVec2::new(2.0 * code.x - 1.0, 2.0 * code.y - 1.0);
        let local = DVec2::from_angle(f64::from(anisotropy.rotation)).rotate(local);
        let direction = t * local.x + up.cross(t) * (sign * local.y);
        let along = (direction - normal * normal.dot(direction)).try_normalize()?;
        let across = across.max(SMOOTH_ALPHA);
        Some(Brushed { alpha: [across + (1.0 - across) * strength * strength, across], along })
    }

    /// Returns the unit shading normal on the viewer's side: interpolated (or geometric, if that faces away), or
    /// mapped.
    fn shading_normal(
        &self,
        triangle: &Triangle,
        weights: [f64; 3],
        to_viewer: DVec3,
        geometric_normal: DVec3,
        map: Option<NormalMap>,
    ) -> DVec3 {
        let front = self.front_normal(triangle);
        let side = if front.dot(to_viewer) < 0.0 { -1.0 } else { 1.0 };
        let smooth = self.smooth_normal(triangle, weights);
        let Some(map) = map else {
            let smooth = smooth.map(|n| n * side);
            return smooth.filter(|n| n.dot(to_viewer) > 0.0).unwrap_or(geometric_normal);
        };
        let normal = self.mapped_normal(triangle, weights, smooth.unwrap_or(front), map) * side;
        let facing = normal.dot(to_viewer);
        if facing < LEAST_FACING { (normal + to_viewer * (LEAST_FACING - facing)).normalize() } else { normal }
    }

    /// Returns the mapped normal on the front side, around the unit normal `up`.
    fn mapped_normal(&self, triangle: &Triangle, weights: [f64; 3], up: DVec3, map: NormalMap) -> DVec3 {
        let code = self.texel(triangle, weights, Some(map.texture), Encoding::Linear).truncate();
        let scale = f64::from(map.scale);
        let local = (code * 2.0 - 1.0) * DVec3::new(scale, scale, 1.0);
        let (along, sign) = self.tangent(triangle, weights).unwrap_or((DVec3::ZERO, 1.0));
        let along = (along - up * up.dot(along)).try_normalize().unwrap_or(tangents(up).0);
        let across = up.cross(along) * sign;
        (along * local.x + across * local.y + up * local.z).try_normalize().unwrap_or(up)
    }

    /// Returns the interpolated tangent in world space, and the sign of the bitangent, which flips in mirrored
    /// instances.
    fn tangent(&self, triangle: &Triangle, weights: [f64; 3]) -> Option<(DVec3, f64)> {
        let tangents = &self.mesh(triangle).tangents;
        if tangents.is_empty() {
            return None;
        }
        let placement = &self.placements[triangle.instance];
        let corners = self.corners(triangle).map(|i| {
            let tangent = tangents[i].as_dvec4();
            let world = placement.world_from_local.transform_vector3(tangent.truncate()).normalize_or_zero();
            world.extend(tangent.w)
        });
        let tangent = interpolate(corners, weights, DVec4::ZERO);
        Some((tangent.truncate(), tangent.w.signum() * placement.winding))
    }

    fn base_color(&self, triangle: &Triangle, weights: [f64; 3]) -> DVec4 {
        let material = self.material(triangle);
        let colors = &self.mesh(triangle).colors;
        let vertex = if colors.is_empty() {
            DVec4::ONE
        } else {
            let corners = self.corners(triangle).map(|i| colors[i].as_dvec4());
            interpolate(corners, weights, DVec4::ZERO)
        };
        let texel = self.texel(triangle, weights, material.base_color_texture, Encoding::Srgb);
        material.base_color.as_dvec4() * vertex * texel
    }

    /// Looks up a texture: white without one, and at (0, 0) if the mesh lacks its coordinate set.
    fn texel(&self, tri: &Triangle, weights: [f64; 3], texture: Option<TextureRef>, encoding: Encoding) -> DVec4 {
        let Some(reference) = texture else {
            return DVec4::ONE;
        };
        let uvs: &[Vec2] = &self.mesh(tri).uvs[reference.uv_set];
        let uv = if uvs.is_empty() {
            DVec2::ZERO
        } else {
            interpolate(self.corners(tri).map(|i| uvs[i].as_dvec2()), weights, DVec2::ZERO)
        };
        texture::look_up(self.scene, reference, uv, encoding)
    }

    /// Returns the smooth normal: transformed and normalised per vertex, then interpolated, as in vertex shaders. None
    /// for flat meshes and where normals cancel.
    fn smooth_normal(&self, triangle: &Triangle, weights: [f64; 3]) -> Option<DVec3> {
        let normals = &self.mesh(triangle).normals;
        if normals.is_empty() {
            return None;
        }
        let to_world = self.placements[triangle.instance].world_from_local_normal;
        let corners = self.corners(triangle).map(|i| (to_world * normals[i].as_dvec3()).normalize_or_zero());
        let world = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
        world.try_normalize()
    }
}

/// Returns the volume behind a thick surface. Without transmission it would be invisible, so the surface counts as
/// thin.
fn enclosed_volume(material: &Material) -> Option<Volume> {
    material.volume.filter(|_| material.transmission > 0.0 || material.diffuse_transmission.factor > 0.0)
}

fn interpolate<T>(corners: [T; 3], weights: [f64; 3], zero: T) -> T
where
    T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>,
{
    corners.iter().zip(weights).fold(zero, |sum, (&value, w)| sum + value * w)
}
