//! Where the two eyes are: a path of keys for the point between them, and the view of each eye at a time.
//!
//! Both eyes share one orientation and one projection and sit half a baseline to each side along the rig's
//! right vector, so a surface point lies on the same image row in both.

use std::fmt;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::{Bounds, Camera};
use crate::image::Extent;

/// Distance between human eyes that a rig has when nothing else is said.
pub const DEFAULT_BASELINE_M: f64 = 0.064;

/// Vertical field of view of a rig that is given keys and nothing else.
pub const DEFAULT_YFOV_DEG: f64 = 70.0;

/// Smallest sine of the angle between the view vector and up that still gives an orientation.
const MIN_SIN_VIEW_UP: f64 = 1e-6;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub enum Eye {
    Left,
    Right,
}

impl Eye {
    pub const ALL: [Eye; 2] = [Eye::Left, Eye::Right];

    /// Side along the rig's right vector.
    fn side(self) -> f64 {
        match self {
            Eye::Left => -1.0,
            Eye::Right => 1.0,
        }
    }
}

impl fmt::Display for Eye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Eye::Left => "left",
            Eye::Right => "right",
        })
    }
}

/// The point between the eyes at one time, scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigKey {
    pub time_s: f64,
    pub position: DVec3,
    pub target: DVec3,
    /// Any length but zero; not parallel to the view vector.
    pub up: DVec3,
}

impl RigKey {
    /// Length of cross(view vector, up) over the product of their lengths; 0 if either has no length.
    fn sin_view_up(&self) -> f64 {
        let view = self.target - self.position;
        view.try_normalize().zip(self.up.try_normalize()).map_or(0.0, |(view, up)| view.cross(up).length())
    }

    /// Whether it gives no orientation: eyes and target are one point, or up is along the view.
    pub fn is_degenerate(&self) -> bool {
        let sin = self.sin_view_up();
        sin.is_nan() || sin < MIN_SIN_VIEW_UP
    }

    fn lerp(&self, to: &RigKey, s: f64) -> RigKey {
        RigKey {
            time_s: self.time_s + (to.time_s - self.time_s) * s,
            position: self.position.lerp(to.position, s),
            target: self.target.lerp(to.target, s),
            up: self.up.lerp(to.up, s),
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Vertical field of view of each eye, above 0 and below π.
    pub yfov_rad: f64,
    pub baseline_m: f64,
    pub metres_per_unit: f64,
    /// At least one; times strictly increase.
    pub keys: Vec<RigKey>,
}

/// One eye's pinhole. `right`, `up`, `forward` are orthonormal, `up = cross(right, forward)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub origin: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    pub tan_half_yfov: f32,
}

impl View {
    /// Unit direction through the point (`x`, `y`) of the image plane, in pixels from its top left corner:
    /// the centre of pixel (i, j) is (i + 0.5, j + 0.5).
    pub fn ray_direction(&self, x: f64, y: f64, extent: Extent) -> DVec3 {
        let half_height = f64::from(extent.height) / 2.0;
        let per_pixel = f64::from(self.tan_half_yfov) / half_height;
        let right = self.right.as_dvec3() * ((x - f64::from(extent.width) / 2.0) * per_pixel);
        let up = self.up.as_dvec3() * ((half_height - y) * per_pixel);
        (self.forward.as_dvec3() + right + up).normalize()
    }
}

impl Rig {
    /// The eye's view at `time_s`: keys are interpolated linearly, and held before the first and after the last.
    pub fn view(&self, time_s: f64, eye: Eye) -> View {
        let (origin, [right, up, forward]) = self.pose(time_s, eye);
        View {
            origin: origin.as_vec3(),
            right: right.as_vec3(),
            up: up.as_vec3(),
            forward: forward.as_vec3(),
            tan_half_yfov: (self.yfov_rad / 2.0).tan() as f32,
        }
    }

    /// The rig that stands where this one is at `time_s`.
    pub fn at(&self, time_s: f64) -> Rig {
        Rig { keys: vec![self.key_at(time_s)], ..*self }
    }

    /// Where the eye is, and its right, up and forward vectors.
    pub(super) fn pose(&self, time_s: f64, eye: Eye) -> (DVec3, [DVec3; 3]) {
        let key = self.key_at(time_s);
        let forward = (key.target - key.position).normalize();
        let right = forward.cross(key.up.normalize()).normalize();
        (key.position + right * (eye.side() * self.baseline_units() / 2.0), [right, right.cross(forward), forward])
    }

    fn key_at(&self, time_s: f64) -> RigKey {
        let next = self.keys.partition_point(|key| key.time_s <= time_s);
        match (next.checked_sub(1).map(|i| &self.keys[i]), self.keys.get(next)) {
            (Some(a), Some(b)) => a.lerp(b, (time_s - a.time_s) / (b.time_s - a.time_s)),
            (Some(key), None) | (None, Some(key)) => *key,
            (None, None) => unreachable!("a rig has at least one key"),
        }
    }

    /// A rig that sees all of `bounds` from +z, at metre scale. The baseline is at most a thirtieth of the
    /// distance, so that scenes smaller than a metre can still be fused by a viewer.
    pub fn framing(bounds: Bounds, yfov_rad: f64) -> Rig {
        const MARGIN: f64 = 1.1;
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let is_usable = min.is_finite() && max.is_finite() && min.cmple(max).all();
        let (centre, radius) = match is_usable {
            true => ((min + max) / 2.0, (max - min).length() / 2.0),
            false => (DVec3::ZERO, 1.0),
        };
        // A single point still needs a distance that survives rounding to f32.
        let radius = radius.max(centre.length() * 1e-4).max(1e-6);
        let distance = MARGIN * radius / (yfov_rad / 2.0).sin();
        // Of a scene as large as numbers go not all can be seen.
        let position = (centre + DVec3::Z * distance).min(DVec3::splat(f64::from(f32::MAX)));
        let key = RigKey { time_s: 0.0, position, target: position - DVec3::Z * distance, up: DVec3::Y };
        Rig { yfov_rad, baseline_m: DEFAULT_BASELINE_M.min(distance / 30.0), metres_per_unit: 1.0, keys: vec![key] }
    }

    /// The same rig with `origin` for (0, 0, 0).
    pub fn relative_to(&self, origin: DVec3) -> Rig {
        let near = |key: &RigKey| RigKey { position: key.position - origin, target: key.target - origin, ..*key };
        Rig { keys: self.keys.iter().map(near).collect(), ..*self }
    }

    /// The rig whose midpoint is `camera`, at metre scale. A camera scaled to nothing looks along −z.
    pub fn from_camera(camera: Camera) -> Rig {
        let world_from_view = camera.world_from_view;
        let position = world_from_view.translation.as_dvec3();
        let forward = -world_from_view.matrix3.z_axis.as_dvec3().normalize_or(DVec3::Z);
        let up = world_from_view.matrix3.y_axis.as_dvec3().normalize_or(DVec3::Y);
        // Far enough off to be another point, wherever the camera is.
        let ahead = forward * (position.abs().max_element() * 0.5f64.powi(20)).max(1.0);
        let mut key = RigKey { time_s: 0.0, position, target: position + ahead, up };
        if key.is_degenerate() {
            key.up = forward.any_orthonormal_vector();
        }
        Rig {
            yfov_rad: f64::from(camera.yfov_rad),
            baseline_m: DEFAULT_BASELINE_M,
            metres_per_unit: 1.0,
            keys: vec![key],
        }
    }
}

/// First time at which the view vector has no length or is parallel to up, if there is one. Keys can be
/// fine and the path between them not, e.g. when the position moves through the target.
pub fn degenerate_time(keys: &[RigKey]) -> Option<f64> {
    if let Some(key) = keys.iter().find(|key| key.is_degenerate()) {
        return Some(key.time_s);
    }
    keys.windows(2).find_map(|pair| {
        let mut shares = degenerate_candidates(&pair[0], &pair[1]);
        shares.sort_by(f64::total_cmp);
        let keys = shares.into_iter().map(|s| pair[0].lerp(&pair[1], s));
        keys.into_iter().find(RigKey::is_degenerate).map(|key| key.time_s)
    })
}

/// Shares of the way from `a` to `b` where cross(view vector, up) can vanish. Each of its components is a
/// quadratic in the share; its roots, and its vertex for roots lost to rounding.
fn degenerate_candidates(a: &RigKey, b: &RigKey) -> Vec<f64> {
    let (view, up) = (a.target - a.position, a.up);
    let (view_step, up_step) = (b.target - b.position - view, b.up - up);
    let constant = view.cross(up);
    let linear = view.cross(up_step) + view_step.cross(up);
    let square = view_step.cross(up_step);
    let mut shares = Vec::new();
    for axis in 0..3 {
        let (c, b, a) = (constant[axis], linear[axis], square[axis]);
        shares.extend([-c / b, -b / (2.0 * a)]);
        let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
        let q = -0.5 * (b + root.copysign(b));
        shares.extend([q / a, c / q]);
    }
    shares.retain(|s| (0.0..=1.0).contains(s));
    shares
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Affine3A, Quat};

    fn key(time_s: f64, position: [f64; 3], target: [f64; 3]) -> RigKey {
        RigKey { time_s, position: position.into(), target: target.into(), up: DVec3::Y }
    }

    fn rig(keys: Vec<RigKey>) -> Rig {
        Rig { yfov_rad: 70f64.to_radians(), baseline_m: 0.064, metres_per_unit: 0.01, keys }
    }

    fn path() -> Rig {
        rig(vec![key(0.0, [0.0, 1.6, 2.5], [0.0, 1.2, -3.0]), key(2.0, [0.6, 1.6, 1.2], [-1.0, 1.1, -3.0])])
    }

    #[test]
    fn eyes_share_orientation_bitwise_and_sit_a_baseline_apart() {
        let rig = path();
        for i in 0..40 {
            let time_s = f64::from(i) * 0.07 - 0.3;
            let [left, right] = Eye::ALL.map(|eye| rig.view(time_s, eye));
            assert_eq!(left.right.to_array().map(f32::to_bits), right.right.to_array().map(f32::to_bits));
            assert_eq!(left.up.to_array().map(f32::to_bits), right.up.to_array().map(f32::to_bits));
            assert_eq!(left.forward.to_array().map(f32::to_bits), right.forward.to_array().map(f32::to_bits));
            assert_eq!(left.tan_half_yfov.to_bits(), right.tan_half_yfov.to_bits());
            let apart = right.origin - left.origin;
            assert!((apart.dot(left.right) - 6.4).abs() < 1e-5);
            assert!((apart.length() - 6.4).abs() < 1e-5);
        }
    }

    #[test]
    fn axes_are_orthonormal_and_right_handed_as_documented() {
        let view = path().view(0.9, Eye::Left);
        for axis in [view.right, view.up, view.forward] {
            assert!((axis.length() - 1.0).abs() < 1e-6);
        }
        assert!(view.right.dot(view.forward).abs() < 1e-6);
        assert!((view.right.cross(view.forward) - view.up).length() < 1e-6);
        assert!(view.up.y > 0.9);
    }

    #[test]
    fn path_is_linear_between_keys_and_held_outside() {
        let mut rig = path();
        rig.baseline_m = 0.0;
        let origin = |time_s| rig.view(time_s, Eye::Right).origin;
        assert_eq!(origin(-5.0), origin(0.0));
        assert_eq!(origin(0.0), Vec3::new(0.0, 1.6, 2.5));
        assert_eq!(origin(2.0), Vec3::new(0.6, 1.6, 1.2));
        assert_eq!(origin(99.0), origin(2.0));
        assert!((origin(0.5) - Vec3::new(0.15, 1.6, 2.175)).length() < 1e-6);
        assert_eq!(rig.view(1.0, Eye::Left), rig.view(1.0, Eye::Right));
        assert_eq!(rig.at(0.7).view(5.0, Eye::Left), rig.view(0.7, Eye::Left));
    }

    #[test]
    fn pixel_zero_is_top_left_and_pixels_are_square() {
        let view = rig(vec![key(0.0, [0.0; 3], [0.0, 0.0, -1.0])]).view(0.0, Eye::Left);
        let extent = Extent::new(40, 20);
        let tan = f64::from(view.tan_half_yfov);
        let close = |a: DVec3, b: [f64; 3]| assert!((a - DVec3::from(b).normalize()).length() < 1e-7, "{a}");
        close(view.ray_direction(20.0, 10.0, extent), [0.0, 0.0, -1.0]);
        close(view.ray_direction(0.0, 0.0, extent), [-2.0 * tan, tan, -1.0]);
        close(view.ray_direction(20.0, 0.0, extent), [0.0, tan, -1.0]);
        close(view.ray_direction(30.0, 20.0, extent), [tan, -tan, -1.0]);
    }

    #[test]
    fn a_world_point_lies_on_the_same_row_in_both_eyes() {
        let rig = path();
        let point = DVec3::new(0.3, 0.9, -2.0);
        let row = |eye| {
            let view = rig.view(0.7, eye);
            let d = point - view.origin.as_dvec3();
            d.dot(view.up.as_dvec3()) / d.dot(view.forward.as_dvec3())
        };
        assert!((row(Eye::Left) - row(Eye::Right)).abs() < 1e-6);
    }

    #[test]
    fn paths_through_the_target_or_through_up_are_found() {
        assert_eq!(degenerate_time(&path().keys), None);
        let through = rig(vec![key(0.0, [0.0, 0.0, 2.0], [0.0; 3]), key(4.0, [0.0, 0.0, -2.0], [0.0; 3])]);
        assert!((degenerate_time(&through.keys).unwrap() - 2.0).abs() < 1e-9);
        let over = rig(vec![key(1.0, [0.0, 0.0, 0.0], [-1.0, 5.0, 0.0]), key(3.0, [0.0; 3], [3.0, 5.0, 0.0])]);
        assert!((degenerate_time(&over.keys).unwrap() - 1.5).abs() < 1e-9);
        let mut turned = path();
        turned.keys[1].up = -DVec3::Y;
        assert!((degenerate_time(&turned.keys).unwrap() - 1.0).abs() < 1e-9);
        assert_eq!(degenerate_time(&[key(7.0, [1.0; 3], [1.0; 3])]), Some(7.0));
    }

    #[test]
    fn framing_sees_every_corner_at_any_scale() {
        let unit = Bounds { min: Vec3::new(-1.0, 0.0, -2.0), max: Vec3::new(3.0, 1.0, 2.0) };
        for scale in [1e-3, 1.0, 1e4] {
            let bounds = Bounds { min: unit.min * scale, max: unit.max * scale };
            let rig = Rig::framing(bounds, 1.0);
            assert!(rig.baseline_m <= 0.064);
            for eye in Eye::ALL {
                let view = rig.view(0.0, eye);
                for corner in 0..8 {
                    let pick = |axis: usize| {
                        if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] }
                    };
                    let d = Vec3::new(pick(0), pick(1), pick(2)) - view.origin;
                    let depth = d.dot(view.forward);
                    assert!(depth > 0.0);
                    assert!(d.dot(view.up).abs() < depth * view.tan_half_yfov);
                    assert!(d.dot(view.right).abs() < depth * view.tan_half_yfov);
                }
            }
        }
    }

    #[test]
    fn framing_of_nothing_of_a_point_or_of_all_there_is_is_finite() {
        let empty = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
        let point = Bounds { min: Vec3::splat(5e6), max: Vec3::splat(5e6) };
        let all = Bounds { min: Vec3::splat(-1e38), max: Vec3::splat(f32::MAX) };
        let end = Bounds { min: Vec3::MAX, max: Vec3::MAX };
        for bounds in [empty, point, all, end] {
            let view = Rig::framing(bounds, 1.0).view(0.0, Eye::Left);
            assert!(view.origin.is_finite() && view.right.is_finite());
            assert_eq!(view.forward, Vec3::NEG_Z);
        }
    }

    #[test]
    fn a_camera_becomes_the_rig_between_the_eyes() {
        let world_from_view = Affine3A::from_scale_rotation_translation(
            Vec3::splat(3.0),
            Quat::from_rotation_y(-std::f32::consts::FRAC_PI_2),
            Vec3::new(1.0, 2.0, 3.0),
        );
        let rig = Rig::from_camera(Camera { world_from_view, yfov_rad: 0.8 });
        let view = rig.view(0.0, Eye::Right);
        assert!((view.forward - Vec3::X).length() < 1e-6);
        assert!((view.right - Vec3::Z).length() < 1e-6);
        assert!((view.origin - Vec3::new(1.0, 2.0, 3.032)).length() < 1e-6);
        assert!((view.tan_half_yfov - 0.4f32.tan()).abs() < 1e-6);

        let flat = Camera { world_from_view: Affine3A::from_scale(Vec3::ZERO), yfov_rad: 0.8 };
        assert_eq!(Rig::from_camera(flat).view(0.0, Eye::Left).forward, Vec3::NEG_Z);
    }

    #[test]
    fn eyes_are_written_in_lower_case() {
        assert_eq!(serde_json::to_string(&Eye::Left).unwrap(), "\"left\"");
        assert_eq!(Eye::Right.to_string(), "right");
    }
}
