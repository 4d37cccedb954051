//! Where the two eyes are: a path of keys for the point between them, and the view of each eye at a time.
//!
//! Both eyes share one orientation and one projection and sit half a baseline to each side along the rig's
//! right vector, so a surface point lies on the same image row in both.

use glam::{DMat3, DQuat, DVec3, Vec3};
use serde::{Deserialize, Serialize};

pub use super::eye::Eye;
use super::optics::Optics;
use super::{Bounds, Camera};
use crate::image::Extent;

/// Distance between human eyes that a rig has when nothing else is said.
pub const DEFAULT_BASELINE_M: f64 = 0.064;

/// Vertical field of view of a rig that is given keys and nothing else.
pub const DEFAULT_YFOV_DEG: f64 = 70.0;

/// Smallest sine of the angle between the view vector and up that still gives an orientation.
const MIN_SIN_VIEW_UP: f64 = 1e-6;

/// The point between the eyes at one time, scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

    /// Right, up and forward, orthonormal.
    pub(super) fn axes(&self) -> [DVec3; 3] {
        let forward = (self.target - self.position).normalize();
        let right = forward.cross(self.up.normalize()).normalize();
        [right, right.cross(forward), forward]
    }

    /// The rotation that takes x to right, y to up and −z to forward.
    pub(super) fn orientation(&self) -> DQuat {
        let [right, up, forward] = self.axes();
        DQuat::from_mat3(&DMat3::from_cols(right, up, -forward)).normalize()
    }

    /// The key at `position` that is turned so.
    pub(super) fn turned(time_s: f64, position: DVec3, orientation: DQuat) -> RigKey {
        RigKey { time_s, position, target: position + orientation * DVec3::NEG_Z, up: orientation * DVec3::Y }
    }

    fn lerp(&self, to: &RigKey, s: f64) -> RigKey {
        RigKey {
            time_s: self.time_s + (to.time_s - self.time_s) * s,
            position: self.position.lerp(to.position, s),
            target: self.target.lerp(to.target, s),
            up: self.up.lerp(to.up, s),
        }
    }

    fn slerp(&self, to: &RigKey, s: f64) -> RigKey {
        let time_s = self.time_s + (to.time_s - self.time_s) * s;
        RigKey::turned(time_s, self.position.lerp(to.position, s), self.orientation().slerp(to.orientation(), s))
    }
}

/// How a rig turns from one key to the next. Positions go in straight lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Turning {
    /// Targets and ups go in straight lines as well.
    #[default]
    Linear,
    /// The shortest way at a constant speed (Shoemake 1985, "Animating rotation with quaternion curves").
    Spherical,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// Vertical field of view of each eye, above 0 and below π.
    pub yfov_rad: f64,
    pub baseline_m: f64,
    pub metres_per_unit: f64,
    /// At least one; times strictly increase.
    pub keys: Vec<RigKey>,
    pub turning: Turning,
    /// What the eyes show, where that is not what is rendered: `yfov_rad` and the keys are those of the frame that the eyes
    /// share.
    pub optics: Option<Optics>,
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
    /// A rig with these keys, at least one, that has all else by default.
    pub fn of_keys(keys: Vec<RigKey>) -> Rig {
        Rig {
            yfov_rad: DEFAULT_YFOV_DEG.to_radians(),
            baseline_m: DEFAULT_BASELINE_M,
            metres_per_unit: 1.0,
            keys,
            turning: Turning::Linear,
            optics: None,
        }
    }

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

    /// The same rig, without optics where images of this size need none.
    pub fn plain_at(self, size: Extent) -> Rig {
        let optics = self.optics.filter(|optics| !optics.is_plain(size));
        Rig { optics, ..self }
    }

    /// Where the eye is, and its right, up and forward vectors.
    pub(super) fn pose(&self, time_s: f64, eye: Eye) -> (DVec3, [DVec3; 3]) {
        let key = self.key_at(time_s);
        let axes = key.axes();
        (key.position + axes[0] * (eye.side() * self.baseline_units() / 2.0), axes)
    }

    /// The point between the eyes at `time_s`.
    pub(super) fn key_at(&self, time_s: f64) -> RigKey {
        let next = self.keys.partition_point(|key| key.time_s <= time_s);
        match (next.checked_sub(1).map(|i| &self.keys[i]), self.keys.get(next)) {
            (Some(a), Some(b)) => {
                let s = (time_s - a.time_s) / (b.time_s - a.time_s);
                match self.turning {
                    Turning::Linear => a.lerp(b, s),
                    Turning::Spherical => a.slerp(b, s),
                }
            }
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
        Rig { yfov_rad, baseline_m: DEFAULT_BASELINE_M.min(distance / 30.0), ..Rig::of_keys(vec![key]) }
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
        Rig { yfov_rad: f64::from(camera.yfov_rad), ..Rig::of_keys(vec![key]) }
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
mod tests;
