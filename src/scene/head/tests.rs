use std::f64::consts::FRAC_1_SQRT_2;

use super::*;
use crate::scene::rig::Eye;

const FILE: &str = r#"{"diptych_motion": 1}
{"time_s": 1, "position_m": [0, 0, 0], "orientation": [0, 0, 0, 1], "gaze": [0.25, 0.5]}

{"time_s": 3, "position_m": [0.2, 0, -0.1], "orientation": [0, 0.70711, 0, 0.70711]}
"#;

/// Returns a rig that looks down at 45 degrees, towards +x.
fn shot() -> Rig {
    let position = DVec3::new(10.0, 20.0, 30.0);
    let key = RigKey { time_s: 0.0, position, target: position + DVec3::new(1.0, -1.0, 0.0), up: DVec3::Y * 2.0 };
    Rig { metres_per_unit: 0.01, ..Rig::of_keys(vec![key]) }
}

#[test]
fn head_space_is_level_and_in_metres() {
    let rig = HeadMotion::parse(FILE.as_bytes()).unwrap().rig(&shot()).unwrap();
    let close = |a: glam::Vec3, b: [f64; 3]| assert!((a.as_dvec3() - DVec3::from(b)).length() < 1e-4, "{a}");
    let [first, last] = [1.0, 3.0].map(|t| Rig { baseline_m: 0.0, ..rig.clone() }.view(t, Eye::LEFT));
    close(first.forward, [1.0, 0.0, 0.0]);
    close(first.origin, [10.0, 20.0, 30.0]);
    // The head is 20 cm to the right and 10 cm ahead, turned left by a quarter.
    close(last.origin, [20.0, 20.0, 50.0]);
    close(last.forward, [0.0, 0.0, -1.0]);
    close(last.up, [0.0, 1.0, 0.0]);
}

#[test]
fn head_turns_at_constant_speed_between_samples() {
    let rig = HeadMotion::parse(FILE.as_bytes()).unwrap().rig(&shot()).unwrap();
    let forward = |time_s| rig.view(time_s, Eye::RIGHT).forward;
    for (time_s, degrees) in [(0.0, 0.0), (1.0, 0.0), (1.5, 22.5), (2.0, 45.0), (2.9, 85.5), (3.0, 90.0), (8.0, 90.0)] {
        let turned = forward(time_s).angle_between(glam::Vec3::X).to_degrees();
        assert!((turned - degrees).abs() < 0.05, "{turned} at {time_s}");
        assert_eq!(rig.at(time_s).view(0.0, Eye::RIGHT), rig.view(time_s, Eye::RIGHT));
    }
}

#[test]
fn recorded_motion_is_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.jsonl");
    let (motion, shot) = (HeadMotion::parse(FILE.as_bytes()).unwrap(), shot());
    let rig = motion.rig(&shot).unwrap();
    let part = folder.path().join("motion.jsonl.part");
    std::fs::write(&part, "of a run that was killed").unwrap();
    let (mut recording, kept) = Recording::create(Space::of(&shot), &path).unwrap();
    assert_eq!(kept, Some(folder.path().join("motion.unfinished.jsonl")));
    assert_eq!(std::fs::read_to_string(kept.unwrap()).unwrap(), "of a run that was killed");
    for (i, at_s) in [0.9, 1.3, 2.2, 3.0].into_iter().enumerate() {
        recording.add(0.1 * i as f64, &rig, at_s, Some([[0.1, 0.9], [0.1, 0.1 * i as f64]])).unwrap();
        // Each sample is written at once, and the final name does not exist yet.
        assert_eq!((std::fs::read_to_string(&part).unwrap().matches('\n').count(), path.exists()), (i + 2, false));
    }
    // A sample at the same time is skipped.
    recording.add(0.3, &rig, 1.0, None).unwrap();
    recording.finish().unwrap();
    assert!(!part.exists());
    let read = HeadMotion::read(&path, &Budget::unlimited()).unwrap();
    assert_eq!(read.gaze().unwrap().map(|gaze| gaze.at(0.2)), [[0.1, 0.9], [0.1, 0.2]]);
    let again = read.rig(&shot).unwrap();
    for (i, at_s) in [0.9, 1.3, 2.2, 3.0].into_iter().enumerate() {
        let [a, b] = [rig.view(at_s, Eye::LEFT), again.view(0.1 * i as f64, Eye::LEFT)];
        for (a, b) in [(a.origin, b.origin), (a.right, b.right), (a.up, b.up), (a.forward, b.forward)] {
            assert!((a - b).length() < 1e-5, "{a} {b}");
        }
    }
}

#[test]
fn rejects_invalid_head_motion_by_line() {
    let sample = |from: &str, to: &str| {
        let text = FILE.replacen(from, to, 1);
        assert_ne!(text, FILE, "{from}");
        HeadMotion::parse(text.as_bytes()).unwrap_err()
    };
    for (from, to, part) in [
        ("_motion\": 1", "_motion\": 2", "line 1: it is of version 2"),
        ("{\"diptych_motion\": 1}", "{}", "line 1: missing field `diptych_motion`, column 2"),
        ("\"time_s\": 3", "\"time_s\": 1", "line 4: time_s 1 is not after the 1 of"),
        ("\"time_s\": 3", "\"time_s\": 1e999", "line 4: number out of range"),
        ("\"time_s\": 3", "\"time_s\": null", "line 4: "),
        ("0.2, 0, -0.1", "0.2, 0", "line 4: invalid length 2"),
        ("0.2, 0, -0.1", "0.2, NaN, 0", "line 4: "),
        ("0, 0, 0, 1", "0, 0, 0, 2", "line 2: orientation [0.0, 0.0, 0.0, 2.0] has the length 2.000"),
        ("0, 0, 0, 1", "0, 0, 0, 0", "line 2: orientation"),
        ("0.25, 0.5", "0.25, 1.5", "line 2: gaze must be two or four numbers from 0 to 1"),
        ("0.25, 0.5", "0.25, 0.5, 0.5", "line 2: gaze"),
        ("gaze", "gazes", "line 2: unknown field `gazes`"),
    ] {
        let error = sample(from, to);
        assert!(error.starts_with(part), "{error}");
    }
    assert!(HeadMotion::parse(b"\n \n").unwrap_err().contains("empty"));
    assert!(HeadMotion::parse(b"{\"diptych_motion\": 1}").unwrap_err().contains("no sample"));
    for far in ["1e38, 0, 0", "1e20, 0, 0"] {
        let text = FILE.replace("0.2, 0, -0.1", far);
        assert!(HeadMotion::parse(text.as_bytes()).unwrap().rig(&shot()).unwrap_err().contains("at 3 s"), "{far}");
    }
}

#[test]
fn recorded_orientations_are_of_unit_length() {
    let [x, y, z, w] = Space::of(&shot()).sample(0.0, &shot().key_at(0.0), None).orientation;
    assert!((x.hypot(y).hypot(z).hypot(w) - 1.0).abs() < 1e-12);
    // The rig is pitched down by an eighth of a turn.
    assert!((2.0 * x.abs().asin() - (FRAC_1_SQRT_2).asin()).abs() < 1e-9 && y.abs() + z.abs() < 1e-9, "{x} {y} {z}");
}

/// Returns eyes with a wider field of view outwards, canted apart by 6 degrees and `apart_m` apart.
fn eyes(apart_m: f64) -> HeadEyes {
    use crate::scene::optics::{Fov, HeadEye};
    let eye = |side: f64| {
        let (inner, outer) = (0.7, 0.9);
        let fov = if side < 0.0 { [-outer, inner] } else { [-inner, outer] };
        let fov = Fov { left: fov[0], right: fov[1], up: 0.8, down: -0.8 };
        let orientation = DQuat::from_rotation_y(-0.05 * side).into();
        HeadEye { position_m: [0.5 * side * apart_m, 0.0, -0.03], orientation, fov }
    };
    HeadEyes { left: eye(-1.0), right: eye(1.0) }
}

#[test]
fn live_head_pose_equals_recorded_pose() {
    let (shot, eyes) = (shot(), eyes(0.064));
    let pose = HeadPose { position_m: DVec3::new(0.2, -0.1, 0.4), orientation: DQuat::from_rotation_y(0.7) };
    let sample =
        Sample { time_s: 0.0, position_m: pose.position_m.into(), orientation: pose.orientation.into(), gaze: None };
    let motion = HeadMotion { samples: vec![sample], eyes: Some(eyes) };
    let space = Space::of(&shot).with_eyes(eyes).unwrap();
    assert_eq!(space, motion.space(&shot).unwrap());
    let rig = space.rig_at(pose, &shot);
    assert_eq!(rig, motion.rig(&shot).unwrap());
    let again = space.sample(0.0, &rig.keys[0], None);
    assert!((DVec3::from(again.position_m) - pose.position_m).length() < 1e-9, "{again:?}");
    assert!(DQuat::from_array(again.orientation).dot(pose.orientation).abs() > 1.0 - 1e-9);
}

#[test]
fn wider_eyes_keep_their_shared_projection() {
    let shot = shot();
    let space = Space::of(&shot).with_eyes(eyes(0.06)).unwrap();
    let wider = space.with_eyes(eyes(0.07)).unwrap();
    let [before, after] = [space, wider].map(|space| space.rig_at(HeadPose::default(), &shot));
    assert!((before.baseline_m - 0.06).abs() < 1e-9 && (after.baseline_m - 0.07).abs() < 1e-9);
    assert_eq!(before.optics.unwrap().tan_half, after.optics.unwrap().tan_half);
}

#[test]
fn poses_in_a_head_follow_the_head() {
    let head = HeadPose { position_m: DVec3::X, orientation: DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2) };
    let own = HeadPose { position_m: DVec3::NEG_Z, orientation: DQuat::from_rotation_x(0.1) };
    let there = head.then(own);
    assert!((there.position_m - DVec3::ZERO).length() < 1e-12, "{there:?}");
    let turned = there.orientation * DVec3::NEG_Z;
    assert!((turned - head.orientation * (own.orientation * DVec3::NEG_Z)).length() < 1e-12);
}
