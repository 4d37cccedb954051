use std::f64::consts::FRAC_1_SQRT_2;

use super::*;
use crate::scene::rig::Eye;

const FILE: &str = r#"{"diptych_motion": 1}
{"time_s": 1, "position_m": [0, 0, 0], "orientation": [0, 0, 0, 1], "gaze": [0.25, 0.5]}

{"time_s": 3, "position_m": [0.2, 0, -0.1], "orientation": [0, 0.70711, 0, 0.70711]}
"#;

/// Looks down at 45 degrees, towards +x.
fn shot() -> Rig {
    let position = DVec3::new(10.0, 20.0, 30.0);
    let key = RigKey { time_s: 0.0, position, target: position + DVec3::new(1.0, -1.0, 0.0), up: DVec3::Y * 2.0 };
    Rig { metres_per_unit: 0.01, ..Rig::of_keys(vec![key]) }
}

#[test]
fn the_space_is_level_and_in_metres() {
    let rig = HeadMotion::parse(FILE.as_bytes()).unwrap().rig(&shot()).unwrap();
    let close = |a: glam::Vec3, b: [f64; 3]| assert!((a.as_dvec3() - DVec3::from(b)).length() < 1e-4, "{a}");
    let [first, last] = [1.0, 3.0].map(|t| Rig { baseline_m: 0.0, ..rig.clone() }.view(t, Eye::Left));
    close(first.forward, [1.0, 0.0, 0.0]);
    close(first.origin, [10.0, 20.0, 30.0]);
    // 20 cm to the right and 10 ahead, turned to the left by a quarter.
    close(last.origin, [20.0, 20.0, 50.0]);
    close(last.forward, [0.0, 0.0, -1.0]);
    close(last.up, [0.0, 1.0, 0.0]);
}

#[test]
fn heads_turn_at_a_constant_speed_between_samples_and_rest_beyond() {
    let rig = HeadMotion::parse(FILE.as_bytes()).unwrap().rig(&shot()).unwrap();
    let forward = |time_s| rig.view(time_s, Eye::Right).forward;
    for (time_s, degrees) in [(0.0, 0.0), (1.0, 0.0), (1.5, 22.5), (2.0, 45.0), (2.9, 85.5), (3.0, 90.0), (8.0, 90.0)] {
        let turned = forward(time_s).angle_between(glam::Vec3::X).to_degrees();
        assert!((turned - degrees).abs() < 0.05, "{turned} at {time_s}");
        assert_eq!(rig.at(time_s).view(0.0, Eye::Right), rig.view(time_s, Eye::Right));
    }
}

#[test]
fn what_is_recorded_is_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("motion.jsonl");
    let (motion, shot) = (HeadMotion::parse(FILE.as_bytes()).unwrap(), shot());
    let rig = motion.rig(&shot).unwrap();
    let mut recording = Recording::new(Space::of(&shot));
    for (i, at_s) in [0.9, 1.3, 2.2, 3.0].into_iter().enumerate() {
        recording.add(0.1 * i as f64, &rig, at_s, Some([0.1, 0.9]));
    }
    // The clock stood still.
    recording.add(0.3, &rig, 1.0, None);
    recording.write(&path).unwrap();
    let read = HeadMotion::read(&path, &Budget::unlimited()).unwrap();
    assert_eq!(read.gaze().unwrap().at(0.2), [0.1, 0.9]);
    let again = read.rig(&shot).unwrap();
    for (i, at_s) in [0.9, 1.3, 2.2, 3.0].into_iter().enumerate() {
        let [a, b] = [rig.view(at_s, Eye::Left), again.view(0.1 * i as f64, Eye::Left)];
        for (a, b) in [(a.origin, b.origin), (a.right, b.right), (a.up, b.up), (a.forward, b.forward)] {
            assert!((a - b).length() < 1e-5, "{a} {b}");
        }
    }
}

#[test]
fn what_is_wrong_is_named_with_its_line() {
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
        ("0.25, 0.5", "0.25, 1.5", "line 2: gaze"),
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
    let mut recording = Recording::new(Space::of(&shot()));
    recording.add(0.0, &shot(), 0.0, None);
    let [x, y, z, w] = recording.samples[0].orientation;
    assert!((x.hypot(y).hypot(z).hypot(w) - 1.0).abs() < 1e-12);
    // Down by an eighth of a turn.
    assert!((2.0 * x.abs().asin() - (FRAC_1_SQRT_2).asin()).abs() < 1e-9 && y.abs() + z.abs() < 1e-9, "{x} {y} {z}");
}
