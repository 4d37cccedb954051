//! Warns if a scene's unit is probably not the metre: both eyes then see the same picture.

use diptych::frame::settings::Settings;
use diptych::image::Extent;
use diptych::scene::rig::{Eye, Rig, View};
use diptych::scene::{Bounds, Instance, Mesh, Scene};
use glam::{BVec3, Vec3};

/// Disparity in pixels below which the two pictures count as equal, and the smallest image for which it is computed, so
/// that thumbnails of any scene do not warn.
const LEAST_PX: f64 = 0.5;
const SMALLEST: Extent = Extent::new(640, 360);
/// Maximum number of keys of the camera's path that are examined.
const MOST_KEYS: usize = 16;

/// Returns a warning if no surface is near enough to the eyes for a disparity of half a pixel.
pub fn warning(settings: &Settings, rig: &Rig, scene: &Scene) -> Option<String> {
    let size = if settings.size.height > SMALLEST.height { settings.size } else { SMALLEST };
    let focal_px = f64::from(size.height) / 2.0 / (rig.yfov_rad / 2.0).tan();
    let baseline = rig.baseline_units();
    // Surfaces up to this distance have enough disparity.
    let enough = focal_px * baseline / LEAST_PX;
    if baseline <= 0.0 || !enough.is_finite() {
        return None;
    }
    let boxes: Vec<Bounds> = scene.meshes.iter().map(bounds).collect();
    let step = rig.keys.len().div_ceil(MOST_KEYS);
    let aspect = f64::from(size.width) / f64::from(size.height);
    let nearest = rig.keys.iter().step_by(step).try_fold(f64::INFINITY, |nearest, key| {
        let seen = Seen::of(&rig.view(key.time_s, Eye::LEFT), aspect as f32);
        let distance = seen.nearest_surface(scene, &boxes, enough);
        (distance > enough).then_some(nearest.min(distance))
    });
    let nearest = nearest.filter(|distance| distance.is_finite())?;
    let pixels = match focal_px * baseline / nearest {
        few if few < 0.01 => "below 0.01".to_owned(),
        pixels => format!("of {pixels:.2}"),
    };
    let nearest = if nearest < 1e6 { format!("{nearest:.0}") } else { format!("{nearest:.1e}") };
    Some(format!(
        "both eyes see almost the same picture: the nearest surface is {nearest} scene units away and the eyes are \
         {baseline:.3} apart, a disparity {pixels} pixels at {size}; give the length of a unit with --set \
         metres_per_unit=M, such as 0.001 for millimetres, or a wider --set baseline=M"
    ))
}

fn bounds(mesh: &Mesh) -> Bounds {
    let ends = |of: fn(Vec3, Vec3) -> Vec3, from| mesh.positions.iter().copied().fold(from, of);
    Bounds { min: ends(Vec3::min, Vec3::INFINITY), max: ends(Vec3::max, Vec3::NEG_INFINITY) }
}

/// Part of a scene that an eye sees.
struct Seen {
    from: Vec3,
    /// Normals of the planes through the eye that bound its view, inwards, and of the plane in front of it.
    sides: [Vec3; 5],
}

impl Seen {
    fn of(view: &View, aspect: f32) -> Self {
        let View { origin, right, up, forward, tan_half_yfov, shift_x } = *view;
        let side = |axis: Vec3, tan: f32| forward * tan + axis;
        let (across, upwards) = (tan_half_yfov * aspect, tan_half_yfov);
        let sides = [
            side(right, across - shift_x),
            side(-right, across + shift_x),
            side(up, upwards),
            side(-up, upwards),
            forward,
        ];
        Self { from: origin, sides }
    }

    /// Returns the distance to the axis-aligned box around other points; infinity if the points are on the outer side of
    /// a plane that bounds the view.
    fn distance<const N: usize>(&self, points: [Vec3; N]) -> f32 {
        let points = points.map(|p| p - self.from);
        if self.sides.iter().any(|side| points.iter().all(|p| p.dot(*side) < 0.0)) {
            return f32::INFINITY;
        }
        let ends = points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[a, b], p| [a.min(*p), b.max(*p)]);
        ends[0].max(-ends[1]).max(Vec3::ZERO).length()
    }

    /// Returns the distance to the nearest box around a triangle in view; infinity without triangles. Any distance up to
    /// `enough` will do.
    fn nearest_surface(&self, scene: &Scene, boxes: &[Bounds], enough: f64) -> f64 {
        let distance = |i: &Instance| {
            let Bounds { min, max } = boxes[i.mesh];
            self.distance([0, 1, 2, 3, 4, 5, 6, 7].map(|corner: u32| {
                let is_far = |axis: u32| corner >> axis & 1 == 1;
                i.world_from_local.transform_point3(Vec3::select(BVec3::new(is_far(0), is_far(1), is_far(2)), max, min))
            }))
        };
        let instances = scene.instances.iter().filter(|i| !scene.meshes[i.mesh].triangles.is_empty());
        let mut order: Vec<(f32, &Instance)> = instances.map(|i| (distance(i), i)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut nearest = f32::INFINITY;
        for (least, instance) in order {
            let mesh = &scene.meshes[instance.mesh];
            for triangle in &mesh.triangles {
                if least >= nearest || f64::from(nearest) <= enough {
                    return nearest.into();
                }
                let vertex = |i: u32| instance.world_from_local.transform_point3(mesh.positions[i as usize]);
                nearest = nearest.min(self.distance(triangle.map(vertex)));
            }
        }
        nearest.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diptych::scene::Material;
    use diptych::scene::rig::RigKey;
    use glam::{Affine3A, DVec3};

    /// A square of this width, seen from as far away, and small ones behind it and behind the eyes.
    fn warned(width: f32, metres_per_unit: f64, settings: &Settings) -> Option<String> {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE.with_z(0.0)];
        let mesh = Mesh { positions, triangles: vec![[0, 1, 2], [2, 1, 3]], ..Mesh::default() };
        let place = |scale: f32, z: f32| Instance {
            mesh: 0,
            world_from_local: Affine3A::from_translation(Vec3::Z * z) * Affine3A::from_scale(Vec3::splat(scale)),
        };
        let (meshes, materials) = (vec![mesh], vec![Material::default()]);
        let behind = [place(0.1 * width, -2.0 * width), place(0.1 * width, 1.01 * width)];
        let instances = behind.into_iter().chain([place(width, 0.0)]).collect();
        let scene = Scene { meshes, materials, instances, ..Scene::empty("squares") };
        let at = |z: f32| DVec3::new(0.5 * f64::from(width), 0.5 * f64::from(width), f64::from(z * width));
        let keys = vec![RigKey { time_s: 0.0, position: at(1.0), target: at(0.0), up: DVec3::Y }];
        warning(settings, &Rig { metres_per_unit, ..Rig::of_keys(keys) }, &scene)
    }

    #[test]
    fn millimetres_are_told_from_metres() {
        let small = Settings { size: Extent::new(32, 18), ..Settings::default() };
        for settings in [&Settings::default(), &small] {
            assert_eq!([warned(0.9, 1.0, settings), warned(30.0, 1.0, settings)], [None, None]);
            let text = warned(900.0, 1.0, settings).unwrap();
            assert!(text.contains("900 scene units away") && text.contains("0.02 pixels at 640x360"), "{text}");
            assert_eq!(warned(900.0, 0.001, settings), None);
        }
        let large = Settings { size: Extent::new(1832, 1920), ..Settings::default() };
        assert_eq!([warned(100.0, 1.0, &large), warned(900.0, 1.0, &large)].map(|text| text.is_some()), [false, true]);
        assert!(warned(100.0, 1.0, &small).is_some());
    }

    #[test]
    fn eyes_at_one_point_are_no_mistake() {
        let keys = vec![RigKey { time_s: 0.0, position: DVec3::Z, target: DVec3::ZERO, up: DVec3::Y }];
        let rig = Rig { baseline_m: 0.0, ..Rig::of_keys(keys.clone()) };
        assert_eq!(warning(&Settings::default(), &rig, &Scene::empty("nothing")), None);
        assert_eq!(warning(&Settings::default(), &Rig::of_keys(keys), &Scene::empty("nothing")), None);
    }
}
