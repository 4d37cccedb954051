//! What a ray finds on a triangle: normals, Lambertian albedo, emission, coverage.

use diptych::scene::{AlphaMode, Material, Mesh, Scene, TextureRef};
use glam::{DAffine3, DMat3, DVec2, DVec3, DVec4, Vec2};

use super::intersect::Triangle;
use super::texture;

/// An instance's transforms in f64.
struct Placement {
    world_from_local: DAffine3,
    /// Inverse transpose up to a factor (the cofactors), so that it also exists for flattened instances.
    world_from_local_normal: DMat3,
    /// −1 where the determinant is negative: there the front is the clockwise side.
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
    /// Unit normal that the cosine of the reflection refers to; on the side of the viewer.
    pub shading_normal: DVec3,
    pub albedo: DVec3,
    /// Radiance towards the viewer.
    pub emission: DVec3,
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

    /// All instances' triangles in world space.
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

    /// Unit normal of the front side, not defined (NaN) for a triangle without area.
    pub fn front_normal(&self, triangle: &Triangle) -> DVec3 {
        let [a, b, c] = triangle.vertices;
        (b - a).cross(c - a).normalize() * self.placements[triangle.instance].winding
    }

    /// Probability that the surface is there.
    pub fn coverage(&self, triangle: &Triangle, weights: [f64; 3]) -> f64 {
        let alpha = || self.base_color(triangle, weights).w;
        match self.material(triangle).alpha_mode {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask { cutoff } if alpha() >= f64::from(cutoff) => 1.0,
            AlphaMode::Mask { .. } => 0.0,
            AlphaMode::Blend => alpha().clamp(0.0, 1.0),
        }
    }

    /// The surface at `weights` as a viewer in the (unit) direction `to_viewer` sees it.
    pub fn seen(&self, id: usize, triangle: &Triangle, weights: [f64; 3], to_viewer: DVec3) -> Surface {
        let front = self.front_normal(triangle);
        let side = if front.dot(to_viewer) < 0.0 { -1.0 } else { 1.0 };
        let geometric_normal = front * side;
        let smooth = self.smooth_normal(triangle, weights).map(|n| n * side);
        Surface {
            triangle: id,
            position: interpolate(triangle.vertices, weights, DVec3::ZERO),
            geometric_normal,
            shading_normal: smooth.filter(|n| n.dot(to_viewer) > 0.0).unwrap_or(geometric_normal),
            albedo: self.base_color(triangle, weights).truncate(),
            emission: self.emission(triangle, weights, to_viewer),
        }
    }

    /// Radiance that the point at `weights` emits towards a viewer.
    pub fn emission(&self, triangle: &Triangle, weights: [f64; 3], to_viewer: DVec3) -> DVec3 {
        let material = self.material(triangle);
        if !material.double_sided && self.front_normal(triangle).dot(to_viewer) <= 0.0 {
            return DVec3::ZERO;
        }
        let texel = self.texel(triangle, weights, material.emissive_texture);
        material.emissive.as_dvec3() * texel.truncate()
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
        let texel = self.texel(triangle, weights, material.base_color_texture);
        material.base_color.as_dvec4() * vertex * texel
    }

    /// White without a texture; a mesh without the texture's coordinate set is looked up at (0, 0).
    fn texel(&self, tri: &Triangle, weights: [f64; 3], texture: Option<TextureRef>) -> DVec4 {
        let Some(reference) = texture else {
            return DVec4::ONE;
        };
        let uvs: &[Vec2] = &self.mesh(tri).uvs[reference.uv_set];
        let uv = if uvs.is_empty() {
            DVec2::ZERO
        } else {
            interpolate(self.corners(tri).map(|i| uvs[i].as_dvec2()), weights, DVec2::ZERO)
        };
        texture::color(self.scene, reference, uv)
    }

    /// Transformed and normalised per vertex, then interpolated, as vertex shaders do; none for flat meshes and where normals cancel.
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

fn interpolate<T>(corners: [T; 3], weights: [f64; 3], zero: T) -> T
where
    T: Copy + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>,
{
    corners.iter().zip(weights).fold(zero, |sum, (&value, w)| sum + value * w)
}
