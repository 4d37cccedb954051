//! `diptych graph` shows the passes of a frame without a device.

use crate::common::diptych;

#[test]
fn passes_and_what_is_left_out_are_shown_and_tasks_are_written_for_graphviz() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("frame.dot");
    let options = ["--denoiser", "atrous", "--iterations", "2", "--virtual", "2", "--size", "320x180"];
    let output = diptych(&[&["graph", "builtin:cornell"], &options[..], &["--dot", file.to_str().unwrap()]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.lines().next().is_some_and(|line| line.contains("stripes of")), "{text}");
    assert!(text.contains("path_trace   right  the right eye is reprojected"), "{text}");
    let dot = std::fs::read_to_string(file).unwrap();
    assert!(dot.starts_with("digraph {") && dot.contains("rows 90..180"), "{dot}");
    // The guide shows a part of this output.
    let guide = include_str!("../../docs/guide.md");
    let (_, section) = guide.split_once("## Look at the passes of a frame").unwrap();
    let shown = section.split("```").nth(3).unwrap().lines().skip(1).filter(|line| *line != "...");
    for line in shown {
        assert!(text.lines().any(|l| l.trim_end() == line.trim_end()), "the guide shows '{line}', not in {text}");
    }
}
