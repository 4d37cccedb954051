//! The origin of the positions in the tables.

use glam::DVec3;

use super::limits::{AccelError, MAX_REACH};
use crate::scene::{Bounds, Scene};

/// Returns the point that positions are relative to. Fails if the scene reaches too far from it.
pub fn checked_origin(scene: &Scene) -> Result<DVec3, AccelError> {
    let bounds = scene.bounds();
    let origin = origin_for(bounds);
    if scene.triangle_count() > 0 {
        check_reach((bounds.min.as_dvec3() - origin).abs().max((bounds.max.as_dvec3() - origin).abs()))?;
    }
    Ok(origin)
}

pub fn check_reach(reach: DVec3) -> Result<(), AccelError> {
    let is_within = reach.cmple(DVec3::splat(MAX_REACH)).all();
    if is_within { Ok(()) } else { Err(AccelError::TooLarge(reach.max_element())) }
}

/// Returns the point nearest to the scene's centre on a lattice whose cells are larger than the scene. Subtracting it
/// from an f32 position in the scene is exact. It is (0, 0, 0) for scenes near (0, 0, 0).
fn origin_for(bounds: Bounds) -> DVec3 {
    let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let size = (max - min).max_element();
    if !(size.is_finite() && size > 0.0) {
        return DVec3::ZERO;
    }
    let cell = 4.0 * size.log2().ceil().exp2();
    ((min + max) / 2.0 / cell).round() * cell
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn distant_scenes_get_a_local_origin() {
        let bounds = |at: f32| Bounds { min: Vec3::splat(at - 1.0), max: Vec3::splat(at + 2.0) };
        assert_eq!(origin_for(bounds(0.0)), DVec3::ZERO);
        assert_eq!(origin_for(bounds(-5.0)), DVec3::ZERO);
        assert_eq!(origin_for(bounds(1e5)), DVec3::splat(1e5));
        assert_eq!(origin_for(Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY }), DVec3::ZERO);
    }
}
