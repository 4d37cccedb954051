//! Camera motion along the shot's path.

use diptych::scene::rig::Rig;

/// A camera that moves along its path and back, endlessly. Animations continue meanwhile: scene time never runs
/// backwards.
pub struct CameraPath {
    rig: Rig,
    /// Offset in time on the path by which the camera has jumped, seconds.
    shift_s: f64,
}

impl CameraPath {
    pub fn new(rig: &Rig) -> Self {
        Self { rig: rig.clone(), shift_s: 0.0 }
    }

    /// Returns a static rig with the camera's pose after this time, which is in seconds.
    pub fn rig(&self, elapsed_s: f64) -> Rig {
        self.rig.at(self.along_s(elapsed_s))
    }

    /// Returns the start and the duration of the path, seconds. A duration of 0 means a static camera.
    fn begin_and_length_s(&self) -> [f64; 2] {
        let [begin_s, end_s] = [self.rig.keys.first(), self.rig.keys.last()].map(|key| key.map_or(0.0, |k| k.time_s));
        [begin_s, end_s - begin_s]
    }

    /// Returns the time on the path after this elapsed time, seconds.
    fn along_s(&self, elapsed_s: f64) -> f64 {
        let [begin_s, length_s] = self.begin_and_length_s();
        if length_s <= 0.0 {
            return begin_s;
        }
        let along_s = (elapsed_s - begin_s + self.shift_s).rem_euclid(2.0 * length_s);
        begin_s + if along_s > length_s { 2.0 * length_s - along_s } else { along_s }
    }

    /// Moves the camera by half of its path, in the same direction of travel.
    pub fn cut(&mut self, elapsed_s: f64) {
        let [begin_s, length_s] = self.begin_and_length_s();
        if length_s > 0.0 {
            let within_s = (elapsed_s - begin_s + self.shift_s).rem_euclid(length_s);
            let half_s = 0.5 * length_s;
            self.shift_s += if within_s < half_s { half_s } else { -half_s };
        }
    }
}

#[cfg(test)]
mod tests {
    use diptych::scene::rig::{Eye, RigKey};
    use glam::DVec3;

    use super::*;

    #[test]
    fn camera_reverses_at_path_ends_and_cuts_by_half() {
        // The camera's x coordinate is the time on the path.
        let at = |time_s: f64| DVec3::new(time_s, 0.0, 0.0);
        let key = |time_s| RigKey { time_s, position: at(time_s), target: at(time_s) - DVec3::Z, up: DVec3::Y };
        let keys = vec![key(1.0), key(5.0)];
        let rig = Rig { yfov_rad: 1.0, baseline_m: 0.0, ..Rig::of_keys(keys) };
        let mut path = CameraPath::new(&rig);
        let along = |path: &CameraPath, s: f64| path.rig(s).view(0.0, Eye::LEFT).origin.x;
        assert_eq!([1.0, 3.0, 5.0, 6.0, 9.0, 11.0].map(|s| along(&path, s)), [1.0, 3.0, 5.0, 4.0, 1.0, 3.0]);
        for at_s in [1.5, 4.5, 5.5, 8.5, 30.0] {
            let before = along(&path, at_s);
            path.cut(at_s);
            assert_eq!((along(&path, at_s) - before).abs(), 2.0, "{at_s}");
        }
    }
}
