//! Instants on the camera's path at which a study compares frames.

use diptych::scene::rig::RigKey;

/// Returns `count` evenly spaced instants along the path, from after its start to its end, so that the camera has moved
/// before each. Empty if the camera is static.
pub fn on_path(keys: &[RigKey], count: u32) -> Vec<f64> {
    let [first, .., last] = keys else { return Vec::new() };
    let length_s = last.time_s - first.time_s;
    (1..=count).map(|i| first.time_s + length_s * f64::from(i) / f64::from(count)).collect()
}

/// Returns `count` evenly spaced instants along the path, both ends included; only `time_s` for a count of 1 or a
/// static camera.
pub fn from_end_to_end(keys: &[RigKey], time_s: f64, count: u32) -> Vec<f64> {
    let [first, .., last] = keys else { return vec![time_s] };
    if count == 1 {
        return vec![time_s];
    }
    let length_s = last.time_s - first.time_s;
    (0..count).map(|i| first.time_s + length_s * f64::from(i) / f64::from(count - 1)).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn instants_exclude_the_start_of_the_path() {
        let key = |time_s| RigKey { time_s, position: DVec3::ZERO, target: DVec3::X, up: DVec3::Y };
        assert_eq!(on_path(&[1.0, 1.5, 4.0].map(key), 3), [2.0, 3.0, 4.0]);
        assert!(on_path(&[key(1.0)], 3).is_empty());
    }

    #[test]
    fn instants_are_even_from_end_to_end() {
        let key = |time_s| RigKey { time_s, position: DVec3::ZERO, target: DVec3::X, up: DVec3::Y };
        let moving = [1.0, 1.5, 4.0].map(key);
        assert_eq!(from_end_to_end(&moving, 0.5, 4), [1.0, 2.0, 3.0, 4.0]);
        assert_eq!((from_end_to_end(&moving, 0.5, 1), from_end_to_end(&[key(1.0)], 0.5, 4)), (vec![0.5], vec![0.5]));
    }
}
