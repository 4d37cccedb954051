//! Locomotion: thumbsticks and buttons move the session's reference space within the shot's space.

use glam::{DQuat, DVec2, DVec3};

use crate::scene::head::HeadPose;

/// Deflection below which a thumbstick counts as released.
const DEAD_ZONE: f64 = 0.15;

/// Transform from the session's LOCAL reference space to the shot's space. In both, y is up, so the transform rotates
/// only about y.
#[derive(Clone, Copy, Debug, Default)]
pub struct Locomotion {
    origin: HeadPose,
}

impl Locomotion {
    /// Converts a head pose from the session's LOCAL reference space to the shot's space.
    pub fn placed(&self, head: HeadPose) -> HeadPose {
        self.origin.then(head)
    }

    /// Moves the viewer horizontally for `passed_s` seconds. `stick` is the deflection to the right and ahead, relative
    /// to the head's heading. Full deflection moves at `speed_m_per_s`.
    pub fn go(&mut self, head: HeadPose, stick: [f64; 2], speed_m_per_s: f64, passed_s: f64) {
        let stick = DVec2::from(stick).clamp_length_max(1.0);
        let beyond = (stick.length() - DEAD_ZONE) / (1.0 - DEAD_ZONE);
        if beyond.is_nan() || beyond <= 0.0 {
            return;
        }
        let along = stick.normalize() * beyond * speed_m_per_s * passed_s;
        let level = DQuat::from_rotation_y(heading(self.placed(head).orientation));
        self.origin.position_m += level * DVec3::new(along.x, 0.0, -along.y);
    }

    /// Moves the head to the origin of the shot's space and turns it to the shot's initial heading.
    pub fn recentre(&mut self, head: HeadPose) {
        let orientation = DQuat::from_rotation_y(-heading(head.orientation));
        self.origin = HeadPose { position_m: -(orientation * head.position_m), orientation };
    }
}

/// Returns the head's yaw in radians, positive to the left. It is the yaw of the viewing direction. If that is nearly
/// vertical, it is derived from the direction of the top of the head.
fn heading(orientation: DQuat) -> f64 {
    let (ahead, top) = (orientation * DVec3::NEG_Z, orientation * DVec3::Y);
    let level = |v: DVec3| DVec2::new(v.x, v.z);
    let [ahead, top] = [level(ahead), level(top) * -ahead.y.signum()];
    let towards = if ahead.length() > 0.1 { ahead } else { top };
    (-towards.x).atan2(-towards.y)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;

    fn head(position: [f64; 3], yaw: f64, pitch: f64) -> HeadPose {
        let orientation = DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch);
        HeadPose { position_m: position.into(), orientation }
    }

    #[test]
    fn heading_follows_the_view_at_any_pitch() {
        for yaw in [-3.0, -1.0, 0.0, 0.5, FRAC_PI_2, 3.0] {
            for pitch in [-FRAC_PI_2, -1.2, 0.0, 0.8, 1.5, FRAC_PI_2] {
                let found = heading(head([0.0; 3], yaw, pitch).orientation);
                let off = (found - yaw + PI).rem_euclid(2.0 * PI) - PI;
                assert!(off.abs() < 1e-9, "{yaw} {pitch}: {found}");
            }
        }
    }

    #[test]
    fn locomotion_follows_the_view_and_stays_level() {
        let mut locomotion = Locomotion::default();
        let looks_left_and_down = head([0.0, 1.6, 0.0], FRAC_PI_2, -0.7);
        locomotion.go(looks_left_and_down, [0.0, 1.0], 2.0, 0.5);
        let at = locomotion.placed(looks_left_and_down).position_m;
        assert!((at - DVec3::new(-1.0, 1.6, 0.0)).length() < 1e-9, "{at}");
        locomotion.go(looks_left_and_down, [1.0, 0.0], 2.0, 0.5);
        let at = locomotion.placed(looks_left_and_down).position_m;
        assert!((at - DVec3::new(-1.0, 1.6, -1.0)).length() < 1e-9, "{at}");
        let before = at;
        for nothing in [[0.0, 0.0], [0.1, -0.1], [f64::NAN, 0.0]] {
            locomotion.go(looks_left_and_down, nothing, 2.0, 0.5);
        }
        assert_eq!(locomotion.placed(looks_left_and_down).position_m, before);
        locomotion.go(looks_left_and_down, [1.0, 1.0], 1.0, 1.0);
        let went = locomotion.placed(looks_left_and_down).position_m - before;
        assert!((went.length() - 1.0).abs() < 1e-9, "diagonals are no faster: {went}");
    }

    #[test]
    fn recentring_keeps_the_tilt_of_the_head() {
        let mut locomotion = Locomotion::default();
        locomotion.go(head([0.0; 3], 0.3, 0.0), [0.2, 0.9], 3.0, 1.0);
        let tilted = head([1.0, 0.2, -2.0], 1.1, 0.4);
        locomotion.recentre(tilted);
        let HeadPose { position_m, orientation } = locomotion.placed(tilted);
        assert!(position_m.length() < 1e-9, "{position_m}");
        assert!(orientation.abs_diff_eq(DQuat::from_rotation_x(0.4), 1e-9), "{orientation}");
        locomotion.go(tilted, [0.0, 1.0], 1.0, 1.0);
        assert!((locomotion.placed(tilted).position_m - DVec3::NEG_Z).length() < 1e-9);
    }
}
