//! Tests of reading and writing a shot's moves.

use glam::DVec3;

use super::*;
use crate::scene::motion::play::{Choice, Moved, Play};

#[test]
fn moves_are_read_and_checked() {
    let shot = parse(FULL, "x.toml").unwrap();
    let Play { animation, loops, moves } = &shot.play;
    assert_eq!((animation, loops, moves.len()), (&Choice::Named("Walk".into()), &false, 2));
    assert_eq!((&moves[0].of, &moves[1].of), (&Moved::Node("Door".into()), &Moved::Light(1)));
    let [first, last] = moves[0].keys[..] else { panic!("{moves:?}") };
    assert_eq!((first.time_s, first.rotation_deg, first.position), (0.0, Some(DVec3::Y * 90.0), None));
    assert_eq!((last.time_s, last.scale), (1.5, Some(DVec3::ONE)));
    assert_eq!(parse(MINIMAL, "x.toml").unwrap().play, Play::default());

    let wrong = |old: &str, new: &str, says: &[&str]| {
        assert!(FULL.contains(old), "the test's own text lacks {old}");
        let error = parse(&FULL.replacen(old, new, 1), "a.toml").unwrap_err().to_string();
        assert!(error.contains("line ") && says.iter().all(|part| error.contains(part)), "{error}");
    };
    wrong("light = 1\n", "light = 3\n", &["move[1].light is 3", "has 3 [[light]]"]);
    wrong("light = 1\n", "light = -1\n", &["light"]);
    wrong("light = 1\n", "", &["move[1]", "either a node or a light"]);
    wrong("light = 1\n", "node = 'Door'\n", &["move[1]", "another [[move]]"]);
    wrong("time_s = 1.5", "time_s = 0", &["move[0].key[1].time_s", "after 0 s"]);
    wrong("time_s = 1.5", "time_s = -1.5", &["move[0].key[1].time_s", "0 or a number above"]);
    wrong("rotation_deg = [0.0, 0.0, 0.0]\n", "", &["move[0].key[1]", "the same in all keys"]);
    wrong("[[move.key]]\nposition = [1.0, 2.0, 3.0]\n", "", &["move[1]", "[[move.key]]"]);
    wrong("position = [1.0, 2.0, 3.0]\n\n[gaze]", "\n[gaze]", &["move[1].key[0]", "give position"]);
    wrong("loop = false", "loop = 3", &["loop"]);
}

#[test]
fn shots_round_trip_through_text() {
    for (text, origin) in [(FULL, "x.toml"), (MINIMAL, "box.toml"), ("scene = 'a \\\"b\".glb'", "\"\n.toml")] {
        let shot = parse(text, origin).unwrap();
        assert_eq!(parse(&shot.text(), "other.toml").unwrap(), shot, "{}", shot.text());
    }
}
