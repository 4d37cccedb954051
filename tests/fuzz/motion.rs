//! Files of head motion. Each error is one line, and a valid file moves eyes that can render.

use std::cell::Cell;

use diptych::image::Extent;
use diptych::scene::head::HeadMotion;
use diptych::scene::rig::{Eye, Rig, RigKey};
use glam::DVec3;
use proptest::prelude::*;
use proptest::sample::select;
use serde_json::{Value, json};

use crate::bytes::{self, Damage};
use crate::{ALLOWED_BYTES, hold};

const HEADER: &str = r#"{"diptych_motion": 1}"#;

/// Numbers that are often out of range.
const NUMBERS: [f64; 16] =
    [0.0, -0.0, 1.0, -1.0, 0.7, -0.7, 1.39, -1.39, 1.6, 5e-324, 1e-20, 1e20, 3.4e38, -1e300, f64::MAX, f64::MIN];

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![20 => -1.5..1.5, 1 => select(&NUMBERS[..])]
}

fn numbers<const N: usize>() -> impl Strategy<Value = [f64; N]> {
    prop::collection::vec(number(), N).prop_map(|all| std::array::from_fn(|i| all[i]))
}

/// Generates orientations, mostly of length 1.
fn orientation() -> impl Strategy<Value = [f64; 4]> {
    let unit = |q: [f64; 4]| {
        let length = q.map(|v| v * v).iter().sum::<f64>().sqrt();
        q.map(|v| v / length)
    };
    prop_oneof![10 => Just([0.0, 0.0, 0.0, 1.0]), 20 => numbers().prop_map(unit), 1 => numbers()]
}

/// Generates an eye, mostly at this side of the head and looking roughly ahead.
fn eye(side: f64) -> impl Strategy<Value = Value> {
    let place = prop_oneof![8 => Just([0.03 * side, 0.0, 0.0]), 1 => numbers()];
    let ahead = (-0.2..0.2f64).prop_map(|turn| [0.0, turn.sin(), 0.0, turn.cos()]);
    let turned = prop_oneof![8 => ahead, 1 => orientation()];
    let fov = prop_oneof![4 => Just([-0.8, 0.7, 0.8, -0.9]), 1 => numbers()];
    (place, turned, fov).prop_map(|(at, turned, [left, right, up, down])| {
        json!({"position_m": at, "orientation": turned, "fov": {"left": left, "right": right, "up": up, "down": down}})
    })
}

fn header() -> impl Strategy<Value = Value> {
    let eyes = (eye(-1.0), eye(1.0)).prop_map(|(left, right)| json!({"left": left, "right": right}));
    prop_oneof![
        1 => Just(json!({"diptych_motion": 1})),
        3 => eyes.prop_map(|eyes| json!({"diptych_motion": 1, "about": "any\nhead", "eyes": eyes})),
    ]
}

/// Generates a gaze for both eyes together, for each eye, or none.
fn gaze() -> impl Strategy<Value = Value> {
    let place = || (0.0..1.0, 0.0..1.0);
    prop_oneof![
        10 => place().prop_map(|(x, y)| json!([x, y])),
        10 => (place(), place()).prop_map(|((x, y), (z, w))| json!([x, y, z, w])),
        1 => numbers::<2>().prop_map(|numbers| json!(numbers)),
        1 => numbers::<4>().prop_map(|numbers| json!(numbers)),
    ]
}

fn sample() -> impl Strategy<Value = Value> {
    (number(), numbers::<3>(), orientation(), prop::option::of(gaze())).prop_map(|(time_s, at, turned, gaze)| {
        let mut sample = json!({"time_s": time_s, "position_m": at, "orientation": turned});
        if let Some(gaze) = gaze {
            sample["gaze"] = gaze;
        }
        sample
    })
}

/// Generates a well-formed file with its samples in order.
fn file() -> impl Strategy<Value = Vec<u8>> {
    (header(), prop::collection::vec(sample(), 0..6)).prop_map(|(header, mut samples)| {
        samples.sort_by(|a, b| a["time_s"].as_f64().partial_cmp(&b["time_s"].as_f64()).expect("times are numbers"));
        let lines = std::iter::once(header).chain(samples).map(|line| format!("{line}\n"));
        lines.collect::<String>().into_bytes()
    })
}

fn damaged() -> impl Strategy<Value = (Vec<u8>, Vec<Damage>)> {
    let other = prop::collection::vec(any::<u8>(), 0..200).prop_map(|rest| [HEADER.as_bytes(), b"\n", &rest].concat());
    let text = "[\\[\\]{}\":,.0-9eE+n\\\\ -]{0,80}".prop_map(|line| format!("{HEADER}\n{line}\n").into_bytes());
    let none = || Just(Vec::new());
    prop_oneof![
        1 => (prop::collection::vec(any::<u8>(), 0..200), none()),
        1 => (other, none()),
        1 => (text, none()),
        4 => (file(), none()),
        4 => (file(), bytes::several()),
    ]
}

fn shot() -> Rig {
    let position = DVec3::new(1.0, 2.0, 3.0);
    Rig::of_keys(vec![RigKey { time_s: 0.0, position, target: position + DVec3::new(1.0, -1.0, 0.0), up: DVec3::Y }])
}

#[test]
fn damaged_head_motion_is_finite_or_rejected() {
    let [cases, read] = [0, 1].map(|_| Cell::new(0u32));
    hold(10_000, ALLOWED_BYTES, damaged(), |(mut bytes, damages)| {
        cases.set(cases.get() + 1);
        bytes::apply(&mut bytes, &damages);
        let lines = bytes.iter().filter(|byte| **byte == b'\n').count() + 1;
        let motion = match HeadMotion::parse(&bytes) {
            Ok(motion) => motion,
            Err(what) => {
                let number = what.strip_prefix("line ").and_then(|rest| rest.split_once(':')?.0.parse::<usize>().ok());
                let is_whole = what.starts_with("it is empty") || what == "it has no sample";
                assert!(number.is_some_and(|number| (1..=lines).contains(&number)) || is_whole, "{what}");
                assert!(!what.contains(char::is_control), "{what:?}");
                return;
            }
        };
        let rig = match motion.rig(&shot()) {
            Ok(rig) => rig,
            Err(what) => return assert!(!what.contains(char::is_control), "{what:?}"),
        };
        read.set(read.get() + 1);
        for time_s in [-1e9, -0.3, 0.0, 0.4, 1e9] {
            for view in Eye::BOTH.map(|eye| rig.view(time_s, eye)) {
                assert!(view.origin.is_finite() && (view.forward.length() - 1.0).abs() < 1e-3, "{view:?}");
                assert!(view.right.dot(view.up).abs() < 1e-3 && view.tan_half_yfov > 0.0, "{view:?}");
            }
        }
        if let Some(gaze) = motion.gaze() {
            assert!(gaze.iter().flat_map(|eye| eye.at(0.2)).all(|v| (0.0..=1.0).contains(&v)));
        }
        let (Some(optics), size) = (rig.optics, Extent::new(64, 48)) else { return };
        let Ok(grid) = optics.rectified(size) else { return };
        assert!(grid.area() > 0 && grid.area() <= 16 * size.area(), "{grid}");
        for (eye, at) in
            Eye::BOTH.into_iter().flat_map(|eye| [[0.0, 0.0], [64.0, 48.0], [20.0, 30.0]].map(|at| (eye, at)))
        {
            let ([x, y], density) = optics.rectified_point(eye, [size, grid], at);
            let is_inside = |v: f64, side: u32| v > -1.0 && v < f64::from(side) + 1.0;
            assert!(
                is_inside(x, grid.width) && is_inside(y, grid.height) && density > 0.0,
                "{x}, {y}, {density} of {grid}"
            );
        }
    });
    assert!(10 * read.get() > cases.get(), "only {} of {} files were motion", read.get(), cases.get());
}
