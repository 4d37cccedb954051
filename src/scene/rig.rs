//! The rig: a path of keys for the middle of its views, and each view at a time.
//!
//! All views share one orientation and, but for a shift to the side, one projection. Neighbours are a baseline apart along
//! the rig's right vector, so a surface point lies on the same image row in all. Two views are the eyes.

use glam::{DMat3, DQuat, DVec3, Vec3};
use serde::{Deserialize, Serialize};

pub use super::eye::Eye;
use super::optics::Optics;
use super::{Bounds, Camera};
use crate::image::Extent;

/// Default baseline: the distance between human eyes.
pub const DEFAULT_BASELINE_M: f64 = 0.064;

/// Default vertical field of view.
pub const DEFAULT_YFOV_DEG: f64 = 70.0;

/// Smallest sine of the angle between the view vector and up that still defines an orientation.
const MIN_SIN_VIEW_UP: f64 = 1e-6;

/// Pose of the middle of the views at one time, in scene units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RigKey {
    pub time_s: f64,
    pub position: DVec3,
    pub target: DVec3,
    /// Up vector of any nonzero length, not parallel to the view vector.
    pub up: DVec3,
}

impl RigKey {
    /// Returns the length of cross(view vector, up) over the product of their lengths, or 0 if either is zero.
    fn sin_view_up(&self) -> f64 {
        let view = self.target - self.position;
        view.try_normalize().zip(self.up.try_normalize()).map_or(0.0, |(view, up)| view.cross(up).length())
    }

    /// Returns true if the key defines no orientation: position and target coincide, or up is parallel to the view.
    pub fn is_degenerate(&self) -> bool {
        let sin = self.sin_view_up();
        sin.is_nan() || sin < MIN_SIN_VIEW_UP
    }

    /// Returns right, up and forward, orthonormal.
    pub(super) fn axes(&self) -> [DVec3; 3] {
        let forward = (self.target - self.position).normalize();
        let right = forward.cross(self.up.normalize()).normalize();
        [right, right.cross(forward), forward]
    }

    /// Returns the rotation that maps x to right, y to up and −z to forward.
    pub(super) fn orientation(&self) -> DQuat {
        let [right, up, forward] = self.axes();
        DQuat::from_mat3(&DMat3::from_cols(right, up, -forward)).normalize()
    }

    /// Returns the key with this position and orientation.
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

/// Interpolation of a rig's rotation between keys. Positions are interpolated linearly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Turning {
    /// Linear interpolation of target and up.
    #[default]
    Linear,
    /// Spherical linear interpolation at constant speed (Shoemake 1985, "Animating rotation with quaternion curves").
    Spherical,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rig {
    /// Vertical field of view of each eye, above 0 and below π.
    pub yfov_rad: f64,
    /// Number of views, at most [`Eye::MOST_VIEWS`].
    pub views: usize,
    /// Distance of neighbouring views.
    pub baseline_m: f64,
    /// Distance in front of the rig at which the images of all views show the same points; `None` if it is infinite.
    pub convergence_m: Option<f64>,
    pub metres_per_unit: f64,
    /// Keys, at least one, at strictly increasing times.
    pub keys: Vec<RigKey>,
    pub turning: Turning,
    /// Projections of the eyes if they differ from that of the rendered frame. `yfov_rad` and the keys then describe
    /// the rendered frame, which both eyes share.
    pub optics: Option<Optics>,
}

/// Pinhole camera of one view. `right`, `up` and `forward` are orthonormal, `up = cross(right, forward)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    pub origin: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    pub tan_half_yfov: f32,
    /// Tangent of the angle by which the middle of the image is to the right of `forward`.
    pub shift_x: f32,
}

impl View {
    /// Returns the unit direction through the point (`x`, `y`) of the image plane, in pixels from its top left corner.
    /// The centre of pixel (i, j) is (i + 0.5, j + 0.5).
    pub fn ray_direction(&self, x: f64, y: f64, extent: Extent) -> DVec3 {
        let half_height = f64::from(extent.height) / 2.0;
        let per_pixel = f64::from(self.tan_half_yfov) / half_height;
        let across = (x - f64::from(extent.width) / 2.0) * per_pixel + f64::from(self.shift_x);
        let right = self.right.as_dvec3() * across;
        let up = self.up.as_dvec3() * ((half_height - y) * per_pixel);
        (self.forward.as_dvec3() + right + up).normalize()
    }
}

impl Rig {
    /// Returns a rig with these keys, at least one, and defaults for everything else.
    pub fn of_keys(keys: Vec<RigKey>) -> Rig {
        Rig {
            yfov_rad: DEFAULT_YFOV_DEG.to_radians(),
            views: 2,
            baseline_m: DEFAULT_BASELINE_M,
            convergence_m: None,
            metres_per_unit: 1.0,
            keys,
            turning: Turning::Linear,
            optics: None,
        }
    }

    /// Returns the eye's view at `time_s`. Keys are interpolated and clamped at both ends.
    pub fn view(&self, time_s: f64, eye: Eye) -> View {
        let (origin, [right, up, forward]) = self.pose(time_s, eye);
        View {
            origin: origin.as_vec3(),
            right: right.as_vec3(),
            up: up.as_vec3(),
            forward: forward.as_vec3(),
            tan_half_yfov: (self.yfov_rad / 2.0).tan() as f32,
            shift_x: self.shift_x(eye) as f32,
        }
    }

    /// Returns the views, from left to right.
    pub fn eyes(&self) -> impl DoubleEndedIterator<Item = Eye> + ExactSizeIterator + Clone {
        Eye::of_rig(self.views)
    }

    /// Returns [`View::shift_x`] of a view.
    pub(super) fn shift_x(&self, eye: Eye) -> f64 {
        self.convergence_m.map_or(0.0, |distance_m| -eye.offset() * self.baseline_m / distance_m)
    }

    /// Returns a static rig with the pose at `time_s`.
    pub fn at(&self, time_s: f64) -> Rig {
        Rig { keys: vec![self.key_at(time_s)], ..*self }
    }

    /// Drops the optics if images of this size do not need them.
    pub fn plain_at(self, size: Extent) -> Rig {
        let optics = self.optics.filter(|optics| !optics.is_plain(size));
        Rig { optics, ..self }
    }

    /// Returns the eye's position in scene units, and its right, up and forward vectors.
    pub(super) fn pose(&self, time_s: f64, eye: Eye) -> (DVec3, [DVec3; 3]) {
        let key = self.key_at(time_s);
        let axes = key.axes();
        (key.position + axes[0] * (eye.offset() * self.baseline_units()), axes)
    }

    /// Returns the pose of the point between the eyes at `time_s`.
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

    /// Returns a rig that looks along −z and sees all of `bounds` from the point between the eyes, with one metre per
    /// scene unit.
    pub fn framing(bounds: Bounds, yfov_rad: f64) -> Rig {
        const MARGIN: f64 = 1.1;
        let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let is_usable = min.is_finite() && max.is_finite() && min.cmple(max).all();
        let (centre, radius) = match is_usable {
            true => ((min + max) / 2.0, (max - min).length() / 2.0),
            false => (DVec3::ZERO, 1.0),
        };
        // Even a single point needs a distance that survives rounding to f32.
        let radius = radius.max(centre.length() * 1e-4).max(1e-6);
        let distance = MARGIN * radius / (yfov_rad / 2.0).sin();
        // Clamps to f32's range. Parts of a scene that fills the range are then out of view.
        let position = (centre + DVec3::Z * distance).min(DVec3::splat(f64::from(f32::MAX)));
        let key = RigKey { time_s: 0.0, position, target: position - DVec3::Z * distance, up: DVec3::Y };
        Rig { yfov_rad, ..Rig::of_keys(vec![key]) }
    }

    /// Returns the rig in coordinates relative to `origin`, in scene units.
    pub fn relative_to(&self, origin: DVec3) -> Rig {
        let near = |key: &RigKey| RigKey { position: key.position - origin, target: key.target - origin, ..*key };
        Rig { keys: self.keys.iter().map(near).collect(), ..*self }
    }

    /// Returns a rig with the midpoint of its eyes at `camera` and one metre per scene unit. A camera whose transform
    /// has zero scale looks along −z.
    pub fn from_camera(camera: Camera) -> Rig {
        let world_from_view = camera.world_from_view;
        let position = world_from_view.translation.as_dvec3();
        let forward = -world_from_view.matrix3.z_axis.as_dvec3().normalize_or(DVec3::Z);
        let up = world_from_view.matrix3.y_axis.as_dvec3().normalize_or(DVec3::Y);
        // Keeps the target distinct from the position, wherever the camera is.
        let ahead = forward * (position.abs().max_element() * 0.5f64.powi(20)).max(1.0);
        let mut key = RigKey { time_s: 0.0, position, target: position + ahead, up };
        if key.is_degenerate() {
            key.up = forward.any_orthonormal_vector();
        }
        Rig { yfov_rad: f64::from(camera.yfov_rad), ..Rig::of_keys(vec![key]) }
    }
}

/// Returns the first time at which the view vector is zero or parallel to up, if any. This can happen between valid
/// keys, for example if the position passes through the target.
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

/// Returns the fractions of the way from `a` to `b` at which cross(view vector, up) can vanish. Each component is a
/// quadratic in the fraction. Returns its roots, and its vertex in case rounding has lost the roots.
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
