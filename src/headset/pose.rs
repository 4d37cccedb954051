//! Converts poses and fields of view between OpenXR and [`crate::scene`]. Both have x to the right, y up and −z ahead.

use glam::{DQuat, DVec3};
use openxr::{Fovf, Posef, Quaternionf, Vector3f, View};

use crate::scene::head::HeadPose;
use crate::scene::optics::{Fov, HeadEye, HeadEyes};
use crate::scene::rig::Eye;

/// Tolerance below which eyes count as equal: metres, radians, and components of unit quaternions.
const SLACK: f64 = 1e-4;

/// Largest plausible coordinate of a position.
const FURTHEST_M: f64 = 1e5;

/// Converts a pose and normalises its orientation. Returns `None` if the orientation is invalid or a coordinate of the
/// position exceeds [`FURTHEST_M`].
pub fn head_pose(pose: &Posef) -> Option<HeadPose> {
    let Posef { orientation: Quaternionf { x, y, z, w }, position } = *pose;
    let orientation = DQuat::from_array([x, y, z, w].map(f64::from));
    let position_m = DVec3::from_array([position.x, position.y, position.z].map(f64::from));
    let is_near = position_m.abs().cmplt(DVec3::splat(FURTHEST_M)).all();
    let is_pose = is_near && orientation.length() > 0.5 && orientation.is_finite();
    is_pose.then(|| HeadPose { position_m, orientation: orientation.normalize() })
}

pub fn posef(HeadPose { position_m, orientation }: HeadPose) -> Posef {
    let [x, y, z, w] = orientation.to_array().map(|v| v as f32);
    let position = position_m.as_vec3();
    Posef {
        orientation: Quaternionf { x, y, z, w },
        position: Vector3f { x: position.x, y: position.y, z: position.z },
    }
}

pub fn fovf(Fov { left, right, up, down }: Fov) -> Fovf {
    let [angle_left, angle_right, angle_up, angle_down] = [left, right, up, down].map(|angle| angle as f32);
    Fovf { angle_left, angle_right, angle_up, angle_down }
}

/// Converts two views, located in the head's space, to the poses and fields of view of the eyes. Returns `None` if a
/// pose is invalid.
pub fn head_eyes([left, right]: [&View; 2]) -> Option<HeadEyes> {
    let eye = |view: &View| {
        let HeadPose { position_m, orientation } = head_pose(&view.pose)?;
        let Fovf { angle_left, angle_right, angle_up, angle_down } = view.fov;
        let [left, right, up, down] = [angle_left, angle_right, angle_up, angle_down].map(f64::from);
        let fov = Fov { left, right, up, down };
        Some(HeadEye { position_m: position_m.into(), orientation: orientation.into(), fov })
    };
    Some(HeadEyes { left: eye(left)?, right: eye(right)? })
}

/// Returns the pose and the field of view of an eye, given the pose of the head.
pub fn eye_view(head: HeadPose, eyes: &HeadEyes, eye: Eye) -> (Posef, Fovf) {
    let HeadEye { position_m, orientation, fov } = *[&eyes.left, &eyes.right][eye.index()];
    let own = HeadPose { position_m: position_m.into(), orientation: DQuat::from_array(orientation) };
    (posef(head.then(own)), fovf(fov))
}

/// Returns true if no component of the eyes differs by more than [`SLACK`].
pub fn are_alike(a: &HeadEyes, b: &HeadEyes) -> bool {
    let numbers = |eyes: &HeadEyes| {
        [eyes.left, eyes.right].map(|HeadEye { position_m: [x, y, z], orientation: [a, b, c, d], fov }| {
            [x, y, z, a, b, c, d, fov.left, fov.right, fov.up, fov.down]
        })
    };
    let [a, b] = [a, b].map(numbers);
    a.as_flattened().iter().zip(b.as_flattened()).all(|(a, b)| (a - b).abs() <= SLACK)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(x: f32, turned: f32, fov: [f32; 4]) -> View {
        let [angle_left, angle_right, angle_up, angle_down] = fov;
        let (sin, cos) = (turned / 2.0).sin_cos();
        View {
            pose: Posef {
                orientation: Quaternionf { x: 0.0, y: sin, z: 0.0, w: cos },
                position: Vector3f { x, y: 0.01, z: -0.02 },
            },
            fov: Fovf { angle_left, angle_right, angle_up, angle_down },
        }
    }

    fn canted() -> [View; 2] {
        [view(-0.032, 0.09, [-0.9, 0.7, 0.8, -0.85]), view(0.031, -0.09, [-0.7, 0.9, 0.8, -0.85])]
    }

    #[test]
    fn eye_views_round_trip_through_head_eyes() {
        let views = canted();
        let eyes = head_eyes([&views[0], &views[1]]).unwrap();
        assert!(eyes.rectified().is_ok());
        for (eye, view) in Eye::BOTH.into_iter().zip(&views) {
            let (pose, fov) = eye_view(HeadPose::default(), &eyes, eye);
            let numbers = |p: &Posef| {
                let (Quaternionf { x, y, z, w }, at) = (p.orientation, p.position);
                [x, y, z, w, at.x, at.y, at.z]
            };
            let pairs = numbers(&pose).into_iter().zip(numbers(&view.pose));
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6) && fov == view.fov, "{pose:?}");
        }
    }

    /// Turns the head by 90 degrees to the left, so that its right eye is at smaller z than its left eye.
    #[test]
    fn eyes_are_where_the_head_takes_them() {
        let views = [view(-0.03, 0.0, [-0.8, 0.8, 0.8, -0.8]), view(0.03, 0.0, [-0.8, 0.8, 0.8, -0.8])];
        let eyes = head_eyes([&views[0], &views[1]]).unwrap();
        let orientation = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
        let head = HeadPose { position_m: DVec3::new(1.0, 2.0, 3.0), orientation };
        let [left, right] = Eye::BOTH.map(|eye| eye_view(head, &eyes, eye).0.position);
        assert!((left.z - right.z - 0.06).abs() < 1e-6 && (left.x - right.x).abs() < 1e-6, "{left:?} {right:?}");
        assert!((left.y - 2.01).abs() < 1e-6 && (left.x - (1.0 - 0.02)).abs() < 1e-6, "{left:?}");
    }

    #[test]
    fn rejects_invalid_poses() {
        let nowhere = Posef::default();
        assert_eq!(head_pose(&Posef { orientation: Quaternionf::default(), ..nowhere }), None);
        let mut views = canted();
        views[1].pose.orientation = Quaternionf { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
        assert_eq!(head_eyes([&views[0], &views[1]]), None);
        for x in [f32::NAN, f32::INFINITY, -1e30] {
            let far = Posef { position: Vector3f { x, y: 0.0, z: 0.0 }, ..Posef::IDENTITY };
            assert_eq!(head_pose(&far), None, "{x}");
        }
    }

    #[test]
    fn eyes_within_rounding_count_as_equal() {
        let views = canted();
        let eyes = head_eyes([&views[0], &views[1]]).unwrap();
        let mut moved = eyes;
        moved.right.position_m[0] += SLACK / 2.0;
        assert!(are_alike(&eyes, &moved));
        moved.right.position_m[0] += SLACK;
        assert!(!are_alike(&eyes, &moved));
    }
}
