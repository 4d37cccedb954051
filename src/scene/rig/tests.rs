use super::*;
use glam::{Affine3A, Quat};

fn key(time_s: f64, position: [f64; 3], target: [f64; 3]) -> RigKey {
    RigKey { time_s, position: position.into(), target: target.into(), up: DVec3::Y }
}

fn rig(keys: Vec<RigKey>) -> Rig {
    Rig { yfov_rad: 70f64.to_radians(), baseline_m: 0.064, metres_per_unit: 0.01, ..Rig::of_keys(keys) }
}

fn path() -> Rig {
    rig(vec![key(0.0, [0.0, 1.6, 2.5], [0.0, 1.2, -3.0]), key(2.0, [0.6, 1.6, 1.2], [-1.0, 1.1, -3.0])])
}

#[test]
fn eyes_share_orientation_and_differ_by_the_baseline() {
    let rig = path();
    for i in 0..40 {
        let time_s = f64::from(i) * 0.07 - 0.3;
        let [left, right] = Eye::BOTH.map(|eye| rig.view(time_s, eye));
        assert_eq!(left.right.to_array().map(f32::to_bits), right.right.to_array().map(f32::to_bits));
        assert_eq!(left.up.to_array().map(f32::to_bits), right.up.to_array().map(f32::to_bits));
        assert_eq!(left.forward.to_array().map(f32::to_bits), right.forward.to_array().map(f32::to_bits));
        assert_eq!(left.tan_half_yfov.to_bits(), right.tan_half_yfov.to_bits());
        let apart = right.origin - left.origin;
        assert!((apart.dot(left.right) - 6.4).abs() < 1e-5);
        assert!((apart.length() - 6.4).abs() < 1e-5);
    }
}

#[test]
fn axes_are_orthonormal_and_right_handed() {
    let view = path().view(0.9, Eye::LEFT);
    for axis in [view.right, view.up, view.forward] {
        assert!((axis.length() - 1.0).abs() < 1e-6);
    }
    assert!(view.right.dot(view.forward).abs() < 1e-6);
    assert!((view.right.cross(view.forward) - view.up).length() < 1e-6);
    assert!(view.up.y > 0.9);
}

#[test]
fn path_is_linear_between_keys_and_held_outside() {
    let mut rig = path();
    rig.baseline_m = 0.0;
    let origin = |time_s| rig.view(time_s, Eye::RIGHT).origin;
    assert_eq!(origin(-5.0), origin(0.0));
    assert_eq!(origin(0.0), Vec3::new(0.0, 1.6, 2.5));
    assert_eq!(origin(2.0), Vec3::new(0.6, 1.6, 1.2));
    assert_eq!(origin(99.0), origin(2.0));
    assert!((origin(0.5) - Vec3::new(0.15, 1.6, 2.175)).length() < 1e-6);
    assert_eq!(rig.view(1.0, Eye::LEFT), rig.view(1.0, Eye::RIGHT));
    assert_eq!(rig.at(0.7).view(5.0, Eye::LEFT), rig.view(0.7, Eye::LEFT));
}

#[test]
fn pixel_zero_is_top_left_and_pixels_are_square() {
    let view = rig(vec![key(0.0, [0.0; 3], [0.0, 0.0, -1.0])]).view(0.0, Eye::LEFT);
    let extent = Extent::new(40, 20);
    let tan = f64::from(view.tan_half_yfov);
    let close = |a: DVec3, b: [f64; 3]| assert!((a - DVec3::from(b).normalize()).length() < 1e-7, "{a}");
    close(view.ray_direction(20.0, 10.0, extent), [0.0, 0.0, -1.0]);
    close(view.ray_direction(0.0, 0.0, extent), [-2.0 * tan, tan, -1.0]);
    close(view.ray_direction(20.0, 0.0, extent), [0.0, tan, -1.0]);
    close(view.ray_direction(30.0, 20.0, extent), [tan, -tan, -1.0]);
}

#[test]
fn world_points_lie_on_the_same_row_in_both_eyes() {
    let rig = path();
    let point = DVec3::new(0.3, 0.9, -2.0);
    let row = |eye| {
        let view = rig.view(0.7, eye);
        let d = point - view.origin.as_dvec3();
        d.dot(view.up.as_dvec3()) / d.dot(view.forward.as_dvec3())
    };
    assert!((row(Eye::LEFT) - row(Eye::RIGHT)).abs() < 1e-6);
}

#[test]
fn degenerate_camera_paths_are_detected() {
    assert_eq!(degenerate_time(&path().keys), None);
    let through = rig(vec![key(0.0, [0.0, 0.0, 2.0], [0.0; 3]), key(4.0, [0.0, 0.0, -2.0], [0.0; 3])]);
    assert!((degenerate_time(&through.keys).unwrap() - 2.0).abs() < 1e-9);
    let over = rig(vec![key(1.0, [0.0, 0.0, 0.0], [-1.0, 5.0, 0.0]), key(3.0, [0.0; 3], [3.0, 5.0, 0.0])]);
    assert!((degenerate_time(&over.keys).unwrap() - 1.5).abs() < 1e-9);
    let mut turned = path();
    turned.keys[1].up = -DVec3::Y;
    assert!((degenerate_time(&turned.keys).unwrap() - 1.0).abs() < 1e-9);
    assert_eq!(degenerate_time(&[key(7.0, [1.0; 3], [1.0; 3])]), Some(7.0));
}

#[test]
fn framing_sees_every_corner_at_any_scale() {
    let unit = Bounds { min: Vec3::new(-1.0, 0.0, -2.0), max: Vec3::new(3.0, 1.0, 2.0) };
    for scale in [1e-3, 1.0, 1e4] {
        let bounds = Bounds { min: unit.min * scale, max: unit.max * scale };
        let view = Rig { baseline_m: 0.0, ..Rig::framing(bounds, 1.0) }.view(0.0, Eye::LEFT);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { bounds.min[axis] } else { bounds.max[axis] };
            let d = Vec3::new(pick(0), pick(1), pick(2)) - view.origin;
            let depth = d.dot(view.forward);
            assert!(depth > 0.0);
            assert!(d.dot(view.up).abs() < depth * view.tan_half_yfov);
            assert!(d.dot(view.right).abs() < depth * view.tan_half_yfov);
        }
    }
}

#[test]
fn framing_of_degenerate_bounds_is_finite() {
    let empty = Bounds { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };
    let point = Bounds { min: Vec3::splat(5e6), max: Vec3::splat(5e6) };
    let all = Bounds { min: Vec3::splat(-1e38), max: Vec3::splat(f32::MAX) };
    let end = Bounds { min: Vec3::MAX, max: Vec3::MAX };
    for bounds in [empty, point, all, end] {
        let view = Rig::framing(bounds, 1.0).view(0.0, Eye::LEFT);
        assert!(view.origin.is_finite() && view.right.is_finite());
        assert_eq!(view.forward, Vec3::NEG_Z);
    }
}

#[test]
fn camera_becomes_the_rig_between_the_eyes() {
    let world_from_view = Affine3A::from_scale_rotation_translation(
        Vec3::splat(3.0),
        Quat::from_rotation_y(-std::f32::consts::FRAC_PI_2),
        Vec3::new(1.0, 2.0, 3.0),
    );
    let rig = Rig::from_camera(Camera { world_from_view, yfov_rad: 0.8 });
    let view = rig.view(0.0, Eye::RIGHT);
    assert!((view.forward - Vec3::X).length() < 1e-6);
    assert!((view.right - Vec3::Z).length() < 1e-6);
    assert!((view.origin - Vec3::new(1.0, 2.0, 3.032)).length() < 1e-6);
    assert!((view.tan_half_yfov - 0.4f32.tan()).abs() < 1e-6);

    let flat = Camera { world_from_view: Affine3A::from_scale(Vec3::ZERO), yfov_rad: 0.8 };
    assert_eq!(Rig::from_camera(flat).view(0.0, Eye::LEFT).forward, Vec3::NEG_Z);
}

#[test]
fn eyes_are_written_in_lower_case() {
    assert_eq!(serde_json::to_string(&Eye::LEFT).unwrap(), "\"left\"");
    assert_eq!(Eye::RIGHT.to_string(), "right");
}
