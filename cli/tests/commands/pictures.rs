//! A run removes pictures of an earlier run, which its `run.json` would not describe, and touches nothing else.

use std::collections::BTreeSet;

use crate::common::Folder;

/// Renders into a folder that keeps the files of earlier runs; returns the messages.
fn render(folder: &Folder, options: &str) -> String {
    folder.run(&format!("render builtin:cornell --size 16x10 --bounces 1 --out ./ {options}")).errors
}

fn names(folder: &Folder) -> BTreeSet<String> {
    folder.names("").into_iter().collect()
}

#[test]
fn run_removes_stale_pictures_of_earlier_runs() {
    let folder = Folder::new();
    render(&folder, "--frames 3 --aov holes,depth --also anaglyph");
    let long = names(&folder);
    assert!(long.contains("left.holes.0002.exr") && long.contains("holes.0002.png"), "{long:?}");
    let kept = ["notes.txt", "left.png", "left.7.exr", "left.mine.0001.exr", "stereo.0001.png.bak", "my.left.0001.exr"];
    for name in kept {
        folder.write(name, name);
    }

    // The same run again replaces all of them.
    assert!(!render(&folder, "--frames 3 --aov holes,depth --also anaglyph").contains("earlier run"));
    assert!(names(&folder).is_superset(&long));

    // Frame 2 had 11 pictures; each of the others had an anaglyph and 5 auxiliary ones.
    let said = render(&folder, "--frames 2");
    assert!(said.contains(&format!("removed {} picture(s) of an earlier run", 11 + 2 * 6)), "{said}");
    let written =
        ["left.exr", "right.exr", "left.png", "right.png", "stereo.png"].map(|name| name.split_once('.').unwrap());
    let expected = written.iter().flat_map(|(eye, ext)| (0..2).map(move |i| format!("{eye}.{i:04}.{ext}")));
    let others = ["run.json", "frames.csv"].into_iter().chain(kept).map(str::to_owned);
    assert_eq!(names(&folder), expected.chain(others).collect());
    for name in kept {
        assert_eq!(folder.text(name), name);
    }

    let said = render(&folder, "");
    assert!(said.contains("removed 10 picture(s)"), "{said}");
    assert!(!names(&folder).contains("left.0000.exr") && names(&folder).contains("left.exr"));
}

#[test]
fn run_keeps_pictures_of_other_programs() {
    let folder = Folder::new();
    // Like the run.json of `scale`, which writes no pictures.
    let of_numbers =
        r#"{ "version": "", "command": "", "settings": { "counts": [] }, "devices": [], "scene": {}, "frames": [] }"#;
    for run in [None, Some("not json"), Some(r#"{ "version": 1, "frames": [] }"#), Some(of_numbers)] {
        for name in ["left.0000.exr", "stereo.0005.png"] {
            folder.write(name, "of another");
        }
        if let Some(run) = run {
            folder.write("run.json", run);
        }
        assert!(!render(&folder, "").contains("removed"), "{run:?}");
        assert_eq!(folder.text("left.0000.exr"), "of another");
        assert!(folder.path("stereo.0005.png").exists());
        std::fs::remove_file(folder.path("run.json")).unwrap();
    }
}
