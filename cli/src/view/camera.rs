//! Camera of the window: on the shot's path, or moved off it by keys and mouse.

use diptych::scene::rig::{Rig, RigKey};
use glam::{DQuat, DVec3};

use super::shared::Input;
use crate::play::CameraPath;

/// Rate of turning by keys, radians per second.
const TURN_RAD_PER_S: f64 = 1.2;
/// Speed factor of the Shift key.
const FAST: f64 = 4.0;
/// Minimum sine of the angle between the view vector and straight up or down.
const LEAST_SIN_UP: f64 = 0.05;

pub struct Camera {
    path: CameraPath,
    /// Time on the path in seconds; stops while the camera is off the path.
    on_path_s: f64,
    /// Scene time in seconds, which advances wherever the camera is.
    time_s: f64,
    /// Pose off the path; `None` while the camera follows the path.
    pose: Option<Pose>,
    /// Speed of movement, scene units per second.
    speed_per_s: f64,
}

/// Pose of the point between the eyes.
#[derive(Clone, Copy, Debug)]
struct Pose {
    position: DVec3,
    /// View direction, of unit length.
    forward: DVec3,
    /// Up direction, of unit length; constant.
    up: DVec3,
}

impl Camera {
    /// Creates a camera that follows the path of `rig` from `begin_s` on.
    pub fn new(rig: &Rig, begin_s: f64, speed_per_s: f64) -> Self {
        Self { path: CameraPath::new(rig), on_path_s: begin_s, time_s: begin_s, pose: None, speed_per_s }
    }

    pub fn follows_path(&self) -> bool {
        self.pose.is_none()
    }

    /// Advances by `passed_s`; returns the rig and the scene's time.
    pub fn step(&mut self, input: &Input, passed_s: f64) -> (Rig, f64) {
        if input.toggles_path {
            self.pose = if self.pose.is_none() { Some(self.pose_on_path()) } else { None };
        }
        if input.asks_to_move() && self.pose.is_none() {
            self.pose = Some(self.pose_on_path());
        }
        self.time_s += passed_s;
        let Some(pose) = &mut self.pose else {
            self.on_path_s += passed_s;
            return (self.path.rig(self.on_path_s), self.time_s);
        };
        pose.step(input, passed_s, self.speed_per_s);
        let key = RigKey { time_s: 0.0, position: pose.position, target: pose.position + pose.forward, up: pose.up };
        (Rig { keys: vec![key], ..self.path.rig(self.on_path_s) }, self.time_s)
    }

    fn pose_on_path(&self) -> Pose {
        let RigKey { position, target, up, .. } = self.path.rig(self.on_path_s).keys[0];
        Pose { position, forward: (target - position).normalize(), up: up.normalize() }
    }
}

impl Input {
    fn asks_to_move(&self) -> bool {
        self.moves != [0.0; 3] || self.turns != [0.0; 2] || self.dragged_rad != [0.0; 2]
    }
}

impl Pose {
    fn step(&mut self, input: &Input, passed_s: f64, speed_per_s: f64) {
        let [yaw, pitch] = [0, 1].map(|i| input.dragged_rad[i] + input.turns[i] * TURN_RAD_PER_S * passed_s);
        let right = self.right();
        let turned = DQuat::from_axis_angle(self.up, -yaw) * DQuat::from_axis_angle(right, pitch) * self.forward;
        // Beyond the pole, the right vector would flip.
        let is_upright = turned.cross(self.up).dot(DQuat::from_axis_angle(self.up, -yaw) * right) > LEAST_SIN_UP;
        self.forward = if is_upright {
            turned.normalize()
        } else {
            (DQuat::from_axis_angle(self.up, -yaw) * self.forward).normalize()
        };
        let [x, y, z] = input.moves;
        let step = self.right() * x + self.up * y + self.forward * z;
        let speed = speed_per_s * if input.is_fast { FAST } else { 1.0 };
        self.position += step.clamp_length_max(1.0) * speed * passed_s;
    }

    fn right(&self) -> DVec3 {
        self.forward.cross(self.up).normalize()
    }
}

#[cfg(test)]
mod tests {
    use diptych::scene::rig::{Eye, degenerate_time};

    use super::*;

    fn camera() -> Camera {
        let key = |time_s, x| RigKey {
            time_s,
            position: DVec3::new(x, 1.0, 4.0),
            target: DVec3::new(x, 1.0, 0.0),
            up: DVec3::Y * 3.0,
        };
        let rig = Rig { yfov_rad: 1.2, ..Rig::of_keys(vec![key(0.0, 0.0), key(10.0, 2.0)]) };
        Camera::new(&rig, 0.0, 2.0)
    }

    fn middle(rig: &Rig, time_s: f64) -> DVec3 {
        let [left, right] = Eye::BOTH.map(|eye| rig.view(time_s, eye).origin.as_dvec3());
        (left + right) / 2.0
    }

    #[test]
    fn camera_leaves_and_rejoins_its_path() {
        let (mut camera, idle) = (camera(), Input::default());
        camera.step(&idle, 5.0);
        let (rig, time_s) = camera.step(&idle, 0.0);
        assert!(camera.follows_path() && (middle(&rig, time_s) - DVec3::new(1.0, 1.0, 4.0)).length() < 1e-6);
        let ahead = Input { moves: [0.0, 0.0, 1.0], ..idle.clone() };
        let (rig, time_s) = camera.step(&ahead, 0.5);
        assert!(!camera.follows_path() && (middle(&rig, time_s) - DVec3::new(1.0, 1.0, 3.0)).length() < 1e-6);
        assert_eq!((degenerate_time(&rig.keys), time_s), (None, 5.5), "what moves goes on");
        let (rig, time_s) = camera.step(&Input { toggles_path: true, ..idle }, 0.0);
        assert!(camera.follows_path() && (middle(&rig, time_s) - DVec3::new(1.0, 1.0, 4.0)).length() < 1e-6);
    }

    #[test]
    fn camera_turns_by_the_drag_without_tipping_over() {
        let mut camera = camera();
        let turn = |dragged_rad| Input { dragged_rad, ..Input::default() };
        let (rig, _) = camera.step(&turn([0.5, 0.25]), 0.0);
        let forward = rig.view(0.0, Eye::LEFT).forward;
        assert!((forward.x - 0.25f32.cos() * 0.5f32.sin()).abs() < 1e-6 && (forward.y - 0.25f32.sin()).abs() < 1e-6);
        for step in [0.3, -0.3, 0.01, -5.0, 3.0] {
            for _ in 0..100 {
                let (rig, _) = camera.step(&turn([0.01, step]), 0.01);
                assert_eq!(degenerate_time(&rig.keys), None);
                assert!(rig.view(0.0, Eye::LEFT).up.y > 0.0);
            }
        }
    }

    #[test]
    fn diagonals_are_no_faster_and_shift_is() {
        let mut camera = camera();
        let run = |moves, is_fast| Input { moves, is_fast, ..Input::default() };
        let at = |camera: &mut Camera, input: &Input| {
            let (rig, time_s) = camera.step(input, 0.5);
            middle(&rig, time_s)
        };
        let begin = at(&mut camera, &run([0.0, 0.0, 1.0], false));
        let one = at(&mut camera, &run([1.0, 1.0, 1.0], false));
        assert!(((one - begin).length() - 1.0).abs() < 1e-6);
        assert!(((at(&mut camera, &run([-1.0, 0.0, 0.0], true)) - one).length() - 4.0).abs() < 1e-6);
    }
}
