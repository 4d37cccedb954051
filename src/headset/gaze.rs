//! Filters the gaze reported by eye trackers and bridges gaps due to blinks or lost tracking.

use glam::{DMat3, DQuat, DVec2, DVec3};

use crate::scene::optics::{Fov, HeadEye};

/// Time for which the last gaze is held while the tracker reports none: most blinks are over by then.
const HOLD_S: f64 = 0.4;
/// Time constants of the return to straight ahead once [`HOLD_S`] has passed, and of catching up with the reported gaze
/// after a gap.
const RETURN_S: f64 = 0.25;
const CATCH_UP_S: f64 = 0.03;
/// Distance from the reported gaze below which the filter has caught up with it, as a difference of tangents.
const NEAR: f64 = 0.01;
/// Maximum eccentricity of a valid gaze, as a tangent. A reported gaze beyond it counts as lost.
const WIDEST: f64 = 4.0;

/// Filter of the gaze direction relative to the head, given by its tangents to the right and up. The filtered gaze
/// moves smoothly across gaps in tracking, but follows jumps of the reported gaze (saccades) at once.
#[derive(Clone, Copy, Debug, Default)]
pub struct GazeFilter {
    gaze: DVec2,
    /// Time in seconds at which the tracker stopped reporting a gaze; `None` while it reports one.
    lost_s: Option<f64>,
    last_s: Option<f64>,
    /// True while the gaze still catches up with the reported one.
    catches_up: bool,
}

impl GazeFilter {
    /// Advances to the time `at_s` and returns the filtered gaze. `told` is the gaze direction that the tracker
    /// reports, in the axes of the head, if any.
    pub fn next(&mut self, told: Option<DVec3>, at_s: f64) -> DVec2 {
        let passed_s = (at_s - self.last_s.replace(at_s).unwrap_or(at_s)).max(0.0);
        let towards = |gaze: DVec2, to: DVec2, constant_s: f64| gaze.lerp(to, 1.0 - (-passed_s / constant_s).exp());
        match told.and_then(tangents) {
            Some(told) => {
                self.catches_up |= self.lost_s.take().is_some();
                self.gaze = if self.catches_up { towards(self.gaze, told, CATCH_UP_S) } else { told };
                self.catches_up &= self.gaze.distance(told) > NEAR;
            }
            None => {
                let lost_s = *self.lost_s.get_or_insert(at_s);
                if at_s - lost_s > HOLD_S {
                    self.gaze = towards(self.gaze, DVec2::ZERO, RETURN_S);
                }
            }
        }
        self.gaze
    }
}

/// Returns a direction's tangents to the right and up; `None` if it points backwards or if its eccentricity exceeds
/// [`WIDEST`].
fn tangents(direction: DVec3) -> Option<DVec2> {
    let tangents = direction.truncate() / -direction.z;
    (direction.z < 0.0 && tangents.is_finite() && tangents.length() <= WIDEST).then_some(tangents)
}

/// Projects a gaze at infinity into an eye's image: fractions from the top left, clamped to the image.
pub fn in_image(gaze: DVec2, eye: &HeadEye) -> [f64; 2] {
    let turned = DMat3::from_quat(DQuat::from_array(eye.orientation)).transpose();
    let own = turned * gaze.extend(-1.0);
    let Fov { left, right, up, down } = eye.fov;
    let [left, right, up, down] = [left, right, up, down].map(f64::tan);
    let tangents = own.truncate() / (-own.z).max(1e-6);
    [(tangents.x - left) / (right - left), (up - tangents.y) / (up - down)].map(|share| share.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_S: f64 = 1.0 / 90.0;

    fn direction(x: f64, y: f64) -> Option<DVec3> {
        Some(DVec3::new(x, y, -1.0).normalize())
    }

    #[test]
    fn reported_gaze_is_not_smoothed() {
        let mut filter = GazeFilter::default();
        for (i, x) in [0.0, 0.4, -0.4, 0.1].into_iter().enumerate() {
            let gaze = filter.next(direction(x, 0.2), i as f64 * STEP_S);
            assert!((gaze - DVec2::new(x, 0.2)).length() < 1e-12, "{gaze}");
        }
    }

    /// Filters a gaze that is reported, then lost for a while, then reported elsewhere.
    fn gap(lost_s: f64) -> Vec<(f64, DVec2)> {
        let mut filter = GazeFilter::default();
        let told = |at_s: f64| match at_s {
            at_s if at_s < 0.5 => direction(0.5, 0.0),
            at_s if at_s < 0.5 + lost_s => None,
            _ => direction(-0.5, 0.3),
        };
        let count = ((1.5 + lost_s) / STEP_S) as usize;
        (0..count).map(|i| i as f64 * STEP_S).map(|at_s| (at_s, filter.next(told(at_s), at_s))).collect()
    }

    #[test]
    fn blink_keeps_the_last_gaze() {
        let gazes = gap(0.3);
        let during = gazes.iter().filter(|(at_s, _)| (0.5..0.8).contains(at_s));
        assert!(during.clone().count() > 20);
        assert!(during.into_iter().all(|(_, gaze)| (*gaze - DVec2::new(0.5, 0.0)).length() < 1e-12));
    }

    #[test]
    fn lost_gaze_returns_smoothly_to_straight_ahead() {
        let gazes = gap(3.0);
        let at = |at_s: f64| gazes.iter().find(|(t, _)| *t >= at_s).unwrap().1;
        assert!(at(3.4).length() < 0.01, "{}", at(3.4));
        assert!((gazes.last().unwrap().1 - DVec2::new(-0.5, 0.3)).length() < 1e-12);
        for pair in gazes.windows(2).skip(1) {
            let step = pair[0].1.distance(pair[1].1);
            assert!(step < 0.25, "{step} at {} s", pair[1].0);
        }
        let first = gazes.iter().position(|(t, _)| *t >= 3.5).unwrap();
        assert!(gazes[first].1.length() < 0.25, "it has not jumped there");
    }

    #[test]
    fn invalid_gaze_directions_count_as_lost() {
        let mut filter = GazeFilter::default();
        filter.next(direction(0.3, 0.0), 0.0);
        for told in [DVec3::Z, DVec3::X, DVec3::ZERO, DVec3::NAN, DVec3::new(100.0, 0.0, -1.0)] {
            assert_eq!(filter.next(Some(told), STEP_S), DVec2::new(0.3, 0.0), "{told}");
        }
    }

    #[test]
    fn gaze_projects_into_the_image_of_each_eye() {
        let fov = Fov { left: -0.9, right: 0.7, up: 0.6, down: -0.8 };
        let straight = HeadEye { position_m: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0], fov };
        let [x, y] = in_image(DVec2::ZERO, &straight);
        let (left, right, up, down) = ((-0.9f64).tan(), 0.7f64.tan(), 0.6f64.tan(), (-0.8f64).tan());
        assert!((x + left / (right - left)).abs() < 1e-12 && (y - up / (up - down)).abs() < 1e-12);
        let corner = in_image(DVec2::new(left, up), &straight);
        assert!(corner.iter().all(|v| v.abs() < 1e-12), "{corner:?}");
        // An eye turned to the left sees the direction straight ahead further to the right.
        let canted = HeadEye { orientation: DQuat::from_rotation_y(0.1).to_array(), ..straight };
        assert!(in_image(DVec2::ZERO, &canted)[0] > x);
        assert_eq!(in_image(DVec2::new(50.0, 0.0), &straight)[0], 1.0);
    }
}
