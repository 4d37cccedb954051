//! Shot files with damaged lines, values and bytes.

use diptych::scene::Scene;
use diptych::scene::budget::Budget;
use diptych::scene::complete::{Overrides, complete};
use diptych::scene::motion::Motion;
use diptych::scene::rig::Eye;
use diptych::scene::shot::Draft;
use proptest::prelude::*;
use proptest::sample::{Index, select};

use crate::bytes::{self, Damage};
use crate::hold;

/// A shot with every kind of entry.
const SEED: &str = include_str!("seed.toml");

const VALUES: &str = r#"0 | -0.0 | -1 | 1e-300 | 1e38 | 4e38 | 1e300 | 1e400 | nan | -nan | inf | -inf | 90 | 179.9999999 |
    180 | 9223372036854775807 | -9223372036854775808 | 0x7f | true | "" | "spot" | "builtin:" | "sky.exr" |
    '\u0000' | [] | [0, 0, 0] | [1e-30, 0, 0] | [1e38, -1e38, 1e38] | [nan, 0, 0] | [[]] |
    [[0, 0, 0], [0, 1, 1]] | {} | { a = 1 } | 1979-05-27"#;

#[derive(Clone, Debug)]
enum Edit {
    /// Line and its new value.
    Value(Index, &'static str),
    /// Replaces one number within a line.
    Number(Index, Index, &'static str),
    Drop(Index),
    Copy(Index, Index),
    Bytes(Damage),
    Nest(Index, u16),
}

fn edit() -> impl Strategy<Value = Edit> {
    prop_oneof![
        4 => (any::<Index>(), select(bytes::listed(VALUES))).prop_map(|(line, v)| Edit::Value(line, v)),
        4 => (any::<Index>(), any::<Index>(), select(bytes::listed(VALUES)[..17].to_vec())).prop_map(|(l, n, v)| Edit::Number(l, n, v)),
        1 => any::<Index>().prop_map(Edit::Drop),
        1 => (any::<Index>(), any::<Index>()).prop_map(|(from, to)| Edit::Copy(from, to)),
        2 => bytes::damage().prop_map(Edit::Bytes),
        1 => (any::<Index>(), any::<u16>()).prop_map(|(line, depth)| Edit::Nest(line, depth)),
    ]
}

fn set_value(line: &mut String, value: &str) {
    if let Some(at) = line.find('=') {
        line.truncate(at + 1);
        line.push_str(value);
    }
}

fn set_number(line: &mut String, which: Index, value: &str) {
    let starts: Vec<usize> = line.match_indices(['[', ',', '=']).map(|(at, _)| at + 1).collect();
    if let Some(&at) = (!starts.is_empty()).then(|| which.get(&starts)) {
        let end = line[at..].find([',', ']']).map_or(line.len(), |n| at + n);
        line.replace_range(at..end, value);
    }
}

fn apply(edits: &[Edit]) -> String {
    let mut text = SEED.to_owned();
    for edit in edits {
        if let Edit::Bytes(damage) = edit {
            let mut bytes = text.into_bytes();
            bytes::apply(&mut bytes, std::slice::from_ref(damage));
            text = String::from_utf8_lossy(&bytes).into_owned();
            continue;
        }
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        if lines.is_empty() {
            break;
        }
        let n = lines.len();
        match edit {
            Edit::Value(line, value) => set_value(&mut lines[line.index(n)], value),
            Edit::Number(line, which, value) => set_number(&mut lines[line.index(n)], *which, value),
            Edit::Drop(line) => drop(lines.remove(line.index(n))),
            Edit::Copy(from, to) => lines.insert(to.index(n), lines[from.index(n)].clone()),
            Edit::Nest(line, depth) => set_value(&mut lines[line.index(n)], &"[".repeat(usize::from(*depth))),
            Edit::Bytes(_) => {}
        }
        text = lines.join("\n");
    }
    text
}

fn check(text: &str) {
    let Ok(draft) = Draft::parse(text, "fuzz.toml").map_err(|error| assert!(!error.to_string().is_empty())) else {
        return;
    };
    let mut scene = Scene::empty("fuzz");
    let shot = complete(draft, &Overrides::default(), &mut scene, &Motion::default(), &Budget::unlimited()).unwrap();
    for time_s in [-1.0, 0.0, 0.7, 1e9] {
        for eye in Eye::BOTH {
            let view = shot.rig.view(time_s, eye);
            let vectors = [view.origin, view.right, view.up, view.forward];
            assert!(vectors.iter().all(|v| v.is_finite()) && view.tan_half_yfov > 0.0, "{view:?}");
        }
        assert!(shot.gaze.at(time_s).iter().all(|x| (0.0..=1.0).contains(x)));
    }
    assert!(shot.lights().iter().all(|light| light.strength.is_finite() && light.strength.min_element() >= 0.0));
}

#[test]
fn edited_shots_load_or_are_rejected() {
    assert!(Draft::parse(SEED, "seed.toml").is_ok(), "{:?}", Draft::parse(SEED, "seed.toml"));
    hold(2000, 64 << 20, prop::collection::vec(edit(), 1..5), |edits| check(&apply(&edits)));
}
