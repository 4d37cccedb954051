//! Where on the camera's path a frame is.

use diptych::scene::rig::Rig;

/// The camera goes along its path and back again, for as long as frames are asked for.
pub struct CameraPath {
    begin_s: f64,
    /// 0: the camera stands still.
    length_s: f64,
    /// By which the camera has jumped.
    shift_s: f64,
}

impl CameraPath {
    pub fn new(rig: &Rig) -> Self {
        let begin_s = rig.keys.first().map_or(0.0, |key| key.time_s);
        let end_s = rig.keys.last().map_or(0.0, |key| key.time_s);
        Self { begin_s, length_s: end_s - begin_s, shift_s: 0.0 }
    }

    /// When on the path the camera is, this long after its begin.
    pub fn time_s(&self, elapsed_s: f64) -> f64 {
        if self.length_s <= 0.0 {
            return elapsed_s;
        }
        let along_s = (elapsed_s - self.begin_s + self.shift_s).rem_euclid(2.0 * self.length_s);
        self.begin_s + if along_s > self.length_s { 2.0 * self.length_s - along_s } else { along_s }
    }

    /// Half a path away, in the same direction.
    pub fn cut(&mut self, elapsed_s: f64) {
        if self.length_s > 0.0 {
            let within_s = (elapsed_s - self.begin_s + self.shift_s).rem_euclid(self.length_s);
            let half_s = 0.5 * self.length_s;
            self.shift_s += if within_s < half_s { half_s } else { -half_s };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_turns_back_at_the_ends_of_its_path_and_jumps_half_of_it() {
        let mut path = CameraPath { begin_s: 1.0, length_s: 4.0, shift_s: 0.0 };
        assert_eq!([1.0, 3.0, 5.0, 6.0, 9.0, 11.0].map(|s| path.time_s(s)), [1.0, 3.0, 5.0, 4.0, 1.0, 3.0]);
        for at_s in [1.5, 4.5, 5.5, 8.5, 30.0] {
            let before_s = path.time_s(at_s);
            path.cut(at_s);
            assert_eq!((path.time_s(at_s) - before_s).abs(), 2.0, "{at_s}");
        }
    }
}
