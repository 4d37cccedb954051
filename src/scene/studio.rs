//! Light for scenes that bring none: a photo studio, and an outdoor sky.
//!
//! Both are environment images whose centre is the direction in which the camera looks. The studio has soft boxes on a
//! grey gradient with a horizon. An object stands on a Lambertian ground whose albedo gives it, wherever nothing blocks
//! the light, the radiance of the image's lower half. It therefore shows shadows but no rim.

use glam::{Affine3A, Vec3, Vec4, vec3};

use super::rig::Rig;
use super::{Bounds, Instance, Material, Mesh, Scene};
use crate::image::{Extent, Image, RgbImage};

const EXTENT: Extent = Extent { width: 1024, height: 512 };

/// Radiance of the studio's background at and below the horizon, and at the zenith.
const HORIZON: f32 = 0.2;
const ZENITH: f32 = 0.09;

/// Half the side of the square ground, in radii of the object's bounds: so far that a picture of an object from above
/// does not show its border.
const GROUND_RADII: f32 = 1000.0;

/// Side of the middle square of the ground, as a fraction of its side. Points on small triangles are more precise.
const MIDDLE: f32 = 0.01;

/// Width of the unlit rim of the ground, as a fraction of half its side. The rim has the background's radiance without
/// noise. A denoiser that loses light in pixels which surface and background share would draw the border of a lit
/// ground as dashes.
const RIM: f32 = 0.1;

/// Distance between the object's lowest point and the ground, in the same unit. It keeps faces in the plane of the
/// lowest point from coinciding with the ground.
const GAP_RADII: f32 = 2e-4;

/// Number of triangles of the ground.
pub const GROUND_TRIANGLES: usize = 18;

/// Name of the ground's material.
const GROUND: &str = "studio ground";

/// A rectangular light at infinity. Angles are in degrees. The azimuth is measured from behind the camera to its left.
struct SoftBox {
    azimuth: f32,
    elevation: f32,
    half_width: f32,
    half_height: f32,
    radiance: f32,
}

/// Key light, fill light, one light from above, and two rim lights, which are above the field of view of most cameras.
const BOXES: [SoftBox; 5] = [
    SoftBox { azimuth: 42.0, elevation: 46.0, half_width: 20.0, half_height: 20.0, radiance: 7.0 },
    SoftBox { azimuth: -62.0, elevation: 26.0, half_width: 26.0, half_height: 24.0, radiance: 0.8 },
    SoftBox { azimuth: 180.0, elevation: 80.0, half_width: 34.0, half_height: 20.0, radiance: 0.7 },
    SoftBox { azimuth: 138.0, elevation: 42.0, half_width: 8.0, half_height: 22.0, radiance: 3.6 },
    SoftBox { azimuth: -138.0, elevation: 42.0, half_width: 8.0, half_height: 22.0, radiance: 3.6 },
];

impl SoftBox {
    /// Returns the box's radiance in a direction. It falls off smoothly towards the edges.
    fn towards(&self, direction: Vec3) -> f32 {
        let (right, up, centre) = self.axes();
        let depth = direction.dot(centre);
        if depth <= 0.0 {
            return 0.0;
        }
        let part = |axis: Vec3, half_deg: f32| {
            let place = (direction.dot(axis) / depth / half_deg.to_radians().tan()).abs();
            smoothstep((1.0 - place) / 0.2)
        };
        self.radiance * part(right, self.half_width) * part(up, self.half_height)
    }

    fn axes(&self) -> (Vec3, Vec3, Vec3) {
        let (sin, cos) = self.azimuth.to_radians().sin_cos();
        let (height, reach) = self.elevation.to_radians().sin_cos();
        let centre = vec3(-sin * reach, height, cos * reach);
        let right = vec3(cos, 0.0, sin);
        (right, centre.cross(right), centre)
    }
}

fn smoothstep(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// Returns the latitude-longitude image of the studio, for a camera that looks along −z.
pub fn studio() -> RgbImage {
    latlong(|direction| {
        let light: f32 = BOXES.iter().map(|soft_box| soft_box.towards(direction)).sum();
        Vec3::splat(if direction.y < 0.0 { HORIZON } else { light + backdrop(direction.y) })
    })
}

fn backdrop(height: f32) -> f32 {
    HORIZON + (ZENITH - HORIZON) * smoothstep(height / 0.9)
}

/// Returns the latitude-longitude image of a clear sky, with a sun in the place of the studio's key light, for a camera
/// that looks along −z.
pub fn sky() -> RgbImage {
    const SUN_RADIUS_DEG: f32 = 2.0;
    const SUN: Vec3 = vec3(640.0, 580.0, 480.0);
    let sun = BOXES[0].axes().2;
    latlong(|direction| {
        if direction.y < 0.0 {
            return vec3(0.22, 0.21, 0.2);
        }
        let haze = (1.0 - direction.y).powi(4);
        let air = vec3(0.2, 0.36, 0.75).lerp(vec3(0.75, 0.82, 0.9), haze);
        let is_sun = direction.dot(sun) > SUN_RADIUS_DEG.to_radians().cos();
        air + if is_sun { SUN } else { Vec3::ZERO }
    })
}

fn latlong(radiance: impl Fn(Vec3) -> Vec3) -> RgbImage {
    Image::from_fn(EXTENT, |x, y| {
        let [x, y] = [x, y].map(|side| side as f32 + 0.5);
        let azimuth = (x / EXTENT.width as f32 - 0.5) * std::f32::consts::TAU;
        let (sin_theta, cos_theta) = polar_angle(y).sin_cos();
        radiance(vec3(sin_theta * azimuth.sin(), cos_theta, -sin_theta * azimuth.cos())).to_array()
    })
}

/// Returns the angle from the zenith at row `y`, in pixels from the top of the image.
fn polar_angle(y: f32) -> f32 {
    y / EXTENT.height as f32 * std::f32::consts::PI
}

/// Returns the rotation that turns the centre of the image to the direction in which the camera looks first.
pub fn rotation_deg(rig: &Rig) -> f32 {
    let key = rig.keys[0];
    let [_, up, forward] = key.axes();
    // Looking straight down, the top of the picture is ahead.
    let ahead = forward + up * 1e-3 * -forward.y.signum();
    -ahead.x.atan2(-ahead.z).to_degrees() as f32
}

/// Returns the albedo of a horizontal plane that has the radiance of the studio's lower half.
fn ground_albedo(studio: &RgbImage) -> f32 {
    let width = EXTENT.width as usize;
    let rows = studio.pixels.chunks(width).take(EXTENT.height as usize / 2);
    // The integral over the upper hemisphere of radiance × cosine. Over a row, the cosine's integral is exact.
    let irradiance: f64 = (0u16..)
        .zip(rows)
        .map(|(row, pixels)| {
            let [from, to] = [row, row + 1].map(|y| f64::from(polar_angle(f32::from(y))).sin().powi(2));
            let sum: f64 = pixels.iter().map(|pixel| f64::from(pixel[1])).sum();
            sum / width as f64 * std::f64::consts::PI * (to - from)
        })
        .sum();
    let below = studio.pixels.last().map_or(0.0, |pixel| f64::from(pixel[1]));
    if irradiance > 0.0 { (below * std::f64::consts::PI / irradiance) as f32 } else { 0.0 }
}

/// True if the scene has the ground of a studio.
pub fn has_ground(scene: &Scene) -> bool {
    scene.materials.iter().any(|material| material.name == GROUND)
}

/// Returns the bounds of the triangles of a static scene, without the ground of a studio.
pub fn bounds_of_object(scene: &Scene) -> Bounds {
    let mut bounds = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
    for instance in &scene.instances {
        let mesh = &scene.meshes[instance.mesh];
        if scene.materials[mesh.material].name == GROUND {
            continue;
        }
        for &corner in mesh.triangles.as_flattened() {
            let p = instance.world_from_local.transform_point3(mesh.positions[corner as usize]);
            bounds = Bounds { min: bounds.min.min(p), max: bounds.max.max(p) };
        }
    }
    bounds
}

/// Adds the ground below an object that the rig's first view shows from outside and from above the ground. `bounds`
/// are those of the object at the time of this view.
pub fn add_ground(scene: &mut Scene, bounds: &Bounds, rig: &Rig, studio: &RgbImage) {
    let Bounds { min, max } = *bounds;
    let radius = (max - min).length() / 2.0;
    let eye = rig.keys[0].position;
    let is_within = eye.cmpge(min.as_dvec3()).all() && eye.cmple(max.as_dvec3()).all();
    let height = min.y - GAP_RADII * radius;
    let is_above = eye.y > f64::from(height + 1e-2 * radius);
    let half = GROUND_RADII * radius;
    let centre = (min + max) / 2.0;
    if !(radius > 0.0 && (centre.abs() + half).is_finite()) || is_within || !is_above {
        return;
    }
    let albedo = ground_albedo(studio);
    let radiance = studio.pixels.last().map_or(HORIZON, |pixel| pixel[1]);
    let corner = |x: f32, z: f32| vec3(centre.x + x * half, height, centre.z + z * half);
    let square = |side: f32| [corner(-side, -side), corner(-side, side), corner(side, side), corner(side, -side)];
    let positions = [square(MIDDLE), square(1.0 - RIM), square(1.0)].concat();
    // The ring between a square and the next one.
    let ring = |square: u32| {
        let sides = (0..4).map(move |i| [i, (i + 1) % 4].map(|corner| 4 * square + corner));
        sides.flat_map(|[a, b]| [[a, a + 4, b + 4], [a, b + 4, b]])
    };
    let lit = [[0, 1, 2], [0, 2, 3]].into_iter().chain(ring(0)).collect();
    for (value, unlit, triangles) in [(albedo, false, lit), (radiance, true, ring(1).collect::<Vec<_>>())] {
        let base_color = Vec4::new(value, value, value, 1.0);
        let (mesh, material) = (scene.meshes.len(), scene.materials.len());
        scene.materials.push(Material { name: GROUND.to_owned(), base_color, unlit, ..Material::default() });
        // Denoisers do not filter across the change of normals, which means nothing to unlit surfaces.
        let inwards = |p: &Vec3| ((centre - *p).with_y(0.0).normalize() + Vec3::Y * 0.3).normalize();
        let normals = if unlit { positions.iter().map(inwards).collect() } else { Vec::new() };
        scene.meshes.push(Mesh { positions: positions.clone(), normals, triangles, material, ..Mesh::default() });
        scene.instances.push(Instance { mesh, world_from_local: Affine3A::IDENTITY });
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::rig::RigKey;
    use super::*;

    fn looking(position: DVec3, target: DVec3) -> Rig {
        Rig::of_keys(vec![RigKey { time_s: 0.0, position, target, up: DVec3::Y }])
    }

    fn direction(image: &RgbImage, index: usize) -> Vec3 {
        let [x, y] = [index as u32 % image.extent.width, index as u32 / image.extent.width].map(|i| i as f32 + 0.5);
        let azimuth = (x / image.extent.width as f32 - 0.5) * std::f32::consts::TAU;
        let (sin, cos) = polar_angle(y).sin_cos();
        vec3(sin * azimuth.sin(), cos, -sin * azimuth.cos())
    }

    #[test]
    fn main_light_comes_from_upper_left_behind_the_camera() {
        for image in [studio(), sky()] {
            let brightest = (0..image.pixels.len()).max_by(|a, b| image.pixels[*a][1].total_cmp(&image.pixels[*b][1]));
            let from = direction(&image, brightest.unwrap());
            assert!(from.x < -0.3 && from.y > 0.3 && from.z > 0.1, "{from}");
        }
    }

    #[test]
    fn background_is_even_below_and_at_the_horizon() {
        let image = studio();
        let [width, height] = [image.extent.width as usize, image.extent.height as usize];
        assert!(image.pixels[width * height / 2..].iter().all(|pixel| *pixel == [HORIZON; 3]));
        let above = &image.pixels[width * (height / 2 - 1)..width * height / 2];
        assert!(above.iter().all(|pixel| (pixel[1] / HORIZON - 1.0).abs() < 0.01), "{above:?}");
    }

    /// Integrates with other weights than the code: the solid angle of each pixel times the cosine at its centre.
    #[test]
    fn lit_ground_is_as_bright_as_the_background() {
        let image = studio();
        let pixel_area = std::f64::consts::TAU / f64::from(image.extent.width) * std::f64::consts::PI
            / f64::from(image.extent.height);
        let irradiance: f64 = (0..image.pixels.len())
            .map(|i| {
                let up = f64::from(direction(&image, i).y).max(0.0);
                f64::from(image.pixels[i][0]) * up * (1.0 - up * up).sqrt() * pixel_area
            })
            .sum();
        let radiance = f64::from(ground_albedo(&image)) * irradiance / std::f64::consts::PI;
        assert!((radiance / f64::from(HORIZON) - 1.0).abs() < 1e-3, "{radiance}");
    }

    #[test]
    fn studio_image_turns_with_the_camera() {
        for (ahead, expected_deg) in [(DVec3::NEG_Z, 0.0), (DVec3::X, -90.0), (DVec3::NEG_X, 90.0)] {
            let turned = rotation_deg(&looking(DVec3::Y, DVec3::Y + ahead));
            assert!((turned - expected_deg).abs() < 1e-3, "{ahead}: {turned}");
        }
        let mut down = looking(DVec3::Y, DVec3::ZERO);
        down.keys[0].up = DVec3::X;
        assert!((rotation_deg(&down) + 90.0).abs() < 1e-3, "the top of the picture is ahead");
    }

    fn cube() -> Scene {
        let positions = vec![Vec3::ZERO, Vec3::ONE, Vec3::X, Vec3::splat(-9.0)];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let instance = Instance { mesh: 0, world_from_local: Affine3A::from_translation(Vec3::Y * 5.0) };
        Scene {
            meshes: vec![mesh],
            instances: vec![instance],
            materials: vec![Material::default()],
            ..Scene::empty("cube")
        }
    }

    #[test]
    fn ground_is_added_only_for_viewers_above_it() {
        let scene = cube();
        let bounds = bounds_of_object(&scene);
        assert_eq!((bounds.min.y, bounds.max.y), (5.0, 6.0), "vertices without a triangle do not count");
        let grounded = |eye: DVec3| {
            let mut scene = scene.clone();
            add_ground(&mut scene, &bounds, &looking(eye, eye + DVec3::NEG_Z), &studio());
            assert_eq!(bounds_of_object(&scene), bounds);
            scene
        };
        let lit = grounded(DVec3::new(0.5, 6.0, 4.0));
        let corners = &lit.meshes[lit.instances[2].mesh].positions;
        assert!(corners.iter().all(|p| p.y < 5.0 && p.y > 4.999), "{corners:?}");
        assert!(corners.iter().any(|p| p.x < -20.0 && p.z > 20.0));
        assert_eq!(lit.triangle_count(), 1 + GROUND_TRIANGLES);
        for eye in [DVec3::new(0.5, 5.5, 0.5), DVec3::new(0.5, 4.0, 4.0)] {
            assert_eq!(grounded(eye).triangle_count(), 1, "{eye}");
        }
    }
}
