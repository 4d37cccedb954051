use super::*;

fn eye(x: f64, cant_deg: f64, fov: Fov) -> HeadEye {
    let orientation = DQuat::from_rotation_y(-cant_deg.to_radians()).into();
    HeadEye { position_m: [x, 0.01, -0.02], orientation, fov }
}

/// Returns eyes that see further down than up and outwards than inwards, and are turned outwards by 5 degrees.
fn canted() -> HeadEyes {
    let left = Fov { left: -0.9, right: 0.7, up: 0.75, down: -0.85 };
    let right = Fov { left: -left.right, right: -left.left, ..left };
    HeadEyes { left: eye(-0.032, -5.0, left), right: eye(0.032, 5.0, right) }
}

const SIZE: Extent = Extent { width: 80, height: 90 };

/// Returns the direction through a point of an eye's image, in the head's axes.
fn in_head(eye: &HeadEye, [x, y]: [f64; 2]) -> DVec3 {
    let Fov { left, right, up, down } = eye.fov;
    let across = left.tan() + (right.tan() - left.tan()) * x / 80.0;
    let upward = up.tan() + (down.tan() - up.tan()) * y / 90.0;
    eye.orientation() * DVec3::new(across, upward, -1.0)
}

#[test]
fn symmetric_eyes_keep_their_projection() {
    let fov = Fov { left: -0.8, right: 0.8, up: 0.6, down: -0.6 };
    let eyes = HeadEyes { left: eye(-0.03, 0.0, fov), right: eye(0.03, 0.0, fov) };
    let Rectified { optics, position_m, orientation, baseline_m } = eyes.rectified().unwrap();
    assert!((position_m - DVec3::new(0.0, 0.01, -0.02)).length() < 1e-12 && (baseline_m - 0.06).abs() < 1e-12);
    assert!(orientation.angle_between(DQuat::IDENTITY) < 1e-6);
    let tan = optics.tan_half;
    assert!((tan[0] - 0.8f64.tan()).abs() < 1e-9 && (tan[1] - 0.6f64.tan()).abs() < 1e-9, "{tan:?}");
    // Chooses a size with square pixels.
    let size = Extent::new(200, (200.0 * tan[1] / tan[0]) as u32);
    let grid = optics.grid(size, 1.0).unwrap();
    assert!(grid.width.abs_diff(204) <= 2 && grid.height.abs_diff(size.height + 4) <= 2, "{grid:?}");
    let h = optics.homography(Eye::LEFT, size, grid);
    let at = h * DVec3::new(100.0, f64::from(size.height) / 2.0, 1.0);
    let middle = DVec2::new(f64::from(grid.width), f64::from(grid.height)) / 2.0;
    assert!((DVec2::new(at.x, at.y) / at.z - middle).length() < 1e-6);
}

#[test]
fn shared_projection_covers_eyes_at_full_resolution() {
    let eyes = canted();
    let Rectified { optics, orientation, .. } = eyes.rectified().unwrap();
    // The vertical and the horizontal field of view are symmetric.
    let grid = optics.grid(SIZE, 1.0).unwrap();
    let mut reached = [f64::INFINITY; 4];
    for side in Eye::BOTH {
        let own = eyes.of(side);
        let h = optics.homography(side, SIZE, grid);
        let seen = |[x, y]: [f64; 2]| {
            let p = h * DVec3::new(x, y, 1.0);
            DVec2::new(p.x, p.y) / p.z
        };
        for (x, y) in [(0.0, 0.0), (80.0, 0.0), (0.0, 90.0), (80.0, 90.0), (33.0, 71.0)] {
            let at = seen([x, y]);
            let ray = orientation.conjugate() * in_head(own, [x, y]);
            let [tan_x, tan_y] = optics.rendered_tan_half(grid);
            let expected = DVec2::new(
                (0.5 + 0.5 * ray.x / -ray.z / tan_x) * f64::from(grid.width),
                (0.5 - 0.5 * ray.y / -ray.z / tan_y) * f64::from(grid.height),
            );
            assert!((at - expected).length() < 1e-6, "{side} {x} {y}: {at} {expected}");
            let room = [at.x, at.y, f64::from(grid.width) - at.x, f64::from(grid.height) - at.y];
            reached = std::array::from_fn(|i| reached[i].min(room[i]));
        }
        // On its axis, a pixel of the eye covers at least one of the frame in every direction.
        let Fov { left, right, up, down } = optics.lenses[side.index()].tan;
        let ahead = [80.0 * left / (left - right), 90.0 * up / (up - down)];
        for turn in 0..8 {
            let (sin, cos) = (f64::from(turn) * 0.4).sin_cos();
            let step = (seen([ahead[0] + 1e-3 * cos, ahead[1] + 1e-3 * sin]) - seen(ahead)).length() / 1e-3;
            assert!((0.999..1.35).contains(&step), "{side}: {step}");
        }
    }
    assert!(reached.iter().all(|room| (1.99..3.0).contains(room)), "{reached:?}");
    assert!(optics.grid(SIZE, 1.5).unwrap().area() as f64 / grid.area() as f64 > 2.0);
}

#[test]
fn rejects_invalid_eyes() {
    let faulty = |change: fn(&mut HeadEyes)| {
        let mut eyes = canted();
        change(&mut eyes);
        eyes.rectified().unwrap_err()
    };
    for (what, error) in [
        ("the left eye: its numbers", faulty(|e| e.left.fov.up = f64::NAN)),
        ("the right eye: fov must have left below right", faulty(|e| e.right.fov.right = -1.0)),
        ("the right eye: fov must have", faulty(|e| e.right.fov.right = 1.5)),
        ("the left eye: orientation", faulty(|e| e.left.orientation = [0.0; 4])),
        ("the right eye must be", faulty(|e| std::mem::swap(&mut e.left, &mut e.right))),
        ("the right eye must be", faulty(|e| e.right.position_m[1] = 1.0)),
        ("the eyes see more than", faulty(|e| e.right.orientation = DQuat::from_rotation_y(-0.8).into())),
        ("the eyes see more than", faulty(|e| e.right.orientation = DQuat::from_rotation_x(2.0).into())),
    ] {
        assert!(error.starts_with(what), "{what}: {error}");
    }
    let mut one = canted();
    one.right.position_m = one.left.position_m;
    let Rectified { baseline_m, .. } = one.rectified().unwrap();
    assert_eq!(baseline_m, 0.0);
    // Puts a narrow eye beside a wide one.
    one.left.fov = Fov { left: -0.01, right: 0.01, up: 0.01, down: -0.01 };
    assert!(one.rectified().unwrap().optics.grid(SIZE, 1.0).unwrap_err().contains("times the pixels"));
}

#[test]
fn only_equal_eyes_with_square_pixels_skip_resampling() {
    let fov = Fov { left: -0.8, right: 0.8, up: 0.6, down: -0.6 };
    let plain = |left: HeadEye, right: HeadEye, size: Extent| {
        HeadEyes { left, right }.rectified().unwrap().optics.is_plain(size)
    };
    let [left, right] = [eye(-0.03, 0.0, fov), eye(0.03, 0.0, fov)];
    let height = |width: u32| (f64::from(width) * 0.6f64.tan() / 0.8f64.tan()).round() as u32;
    // For these widths the height is nearly an integer.
    for width in [200, 400, 1600] {
        let nearest = Extent::new(width, height(width));
        let off = f64::from(width) * 0.6f64.tan() / 0.8f64.tan() - f64::from(nearest.height);
        assert_eq!(plain(left, right, nearest), off.abs() < 0.1 * f64::from(nearest.height) / f64::from(width));
        assert!(!plain(left, right, Extent::new(width, nearest.height + 1)), "{width}");
    }
    let square = Fov { up: 0.8, down: -0.8, ..fov };
    let [left, right] = [eye(-0.03, 0.0, square), eye(0.03, 0.0, square)];
    let size = Extent::new(64, 64);
    assert!(plain(left, right, size));
    assert!(!plain(eye(-0.03, 1.0, square), right, size), "canted");
    assert!(!plain(left, HeadEye { fov: Fov { right: 0.75, ..square }, ..right }, size), "one sees less");
    assert!(!plain(left, HeadEye { position_m: [0.03, 0.02, -0.02], ..right }, size), "one is above the other");
}
