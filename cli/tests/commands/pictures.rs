//! A run removes pictures of an earlier run, which its `run.json` would not describe, and touches nothing else.

use std::collections::BTreeSet;
use std::path::Path;

use crate::common::diptych;

/// Renders into `out`; returns the messages.
fn render(out: &Path, options: &[&str]) -> String {
    let args = ["render", "builtin:cornell", "--size", "16x10", "--bounces", "1", "--out", out.to_str().unwrap()];
    let output = diptych(&[&args, options].concat());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{options:?}: {said}");
    said
}

fn names(out: &Path) -> BTreeSet<String> {
    std::fs::read_dir(out).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

#[test]
fn run_removes_stale_pictures_of_earlier_runs() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    render(out, &["--frames", "3", "--aov", "holes,depth", "--also", "anaglyph"]);
    let long = names(out);
    assert!(long.contains("left.holes.0002.exr") && long.contains("holes.0002.png"), "{long:?}");
    let kept = ["notes.txt", "left.png", "left.7.exr", "left.mine.0001.exr", "stereo.0001.png.bak", "my.left.0001.exr"];
    kept.iter().for_each(|name| std::fs::write(out.join(name), name).unwrap());

    // The same run again replaces all of them.
    assert!(!render(out, &["--frames", "3", "--aov", "holes,depth", "--also", "anaglyph"]).contains("earlier run"));
    assert!(names(out).is_superset(&long));

    // Frame 2 had 11 pictures; each of the others had an anaglyph and 5 auxiliary ones.
    let said = render(out, &["--frames", "2"]);
    assert!(said.contains(&format!("removed {} picture(s) of an earlier run", 11 + 2 * 6)), "{said}");
    let written =
        ["left.exr", "right.exr", "left.png", "right.png", "stereo.png"].map(|name| name.split_once('.').unwrap());
    let expected = written.iter().flat_map(|(eye, ext)| (0..2).map(move |i| format!("{eye}.{i:04}.{ext}")));
    let others = ["run.json", "frames.csv"].into_iter().chain(kept).map(str::to_owned);
    assert_eq!(names(out), expected.chain(others).collect());
    for name in kept {
        assert_eq!(std::fs::read_to_string(out.join(name)).unwrap(), name);
    }

    let said = render(out, &[]);
    assert!(said.contains("removed 10 picture(s)"), "{said}");
    assert!(!names(out).contains("left.0000.exr") && names(out).contains("left.exr"));
}

#[test]
fn run_keeps_pictures_of_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    // Like the run.json of `scale`, which writes no pictures.
    let of_numbers =
        r#"{ "version": "", "command": "", "settings": { "counts": [] }, "devices": [], "scene": {}, "frames": [] }"#;
    for run in [None, Some("not json"), Some(r#"{ "version": 1, "frames": [] }"#), Some(of_numbers)] {
        for name in ["left.0000.exr", "stereo.0005.png"] {
            std::fs::write(out.join(name), "of another").unwrap();
        }
        if let Some(run) = run {
            std::fs::write(out.join("run.json"), run).unwrap();
        }
        assert!(!render(out, &[]).contains("removed"), "{run:?}");
        assert_eq!(std::fs::read_to_string(out.join("left.0000.exr")).unwrap(), "of another");
        assert!(out.join("stereo.0005.png").exists());
        std::fs::remove_file(out.join("run.json")).unwrap();
    }
}
