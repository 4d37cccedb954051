//! `diptych graph`: the passes of a frame, without a device.

use crate::common::Folder;

#[track_caller]
fn graph(options: &str) -> String {
    Folder::new().run(&format!("graph builtin:cornell --size 64x36 {options}")).out
}

/// Returns the lines of the passes table that begin with a number and this name.
fn lines<'a>(text: &'a str, pass: &str) -> Vec<Vec<&'a str>> {
    let cells = |line: &'a str| line.split_whitespace().collect::<Vec<_>>();
    text.lines().map(cells).filter(|c| c.len() > 2 && c[0].parse::<u32>().is_ok() && c[1] == pass).collect()
}

#[test]
fn graph_prints_passes_and_transfers() {
    let text = graph("--virtual 2 --set halo=exchange");
    assert_eq!(lines(&text, "svgf").len(), 2 * 5);
    assert_eq!(lines(&text, "path_trace")[0][2..4], ["left", "64x36"]);
    let left_out = |text: &str, stage: &str, why: &str| {
        text.lines().any(|line| line.starts_with(stage) && line.trim_end().ends_with(why))
    };
    assert!(left_out(&text, "select", "no pixel is left to the denoiser"), "{text}");
    assert!(left_out(&text, "path_trace", "the view is reprojected"), "{text}");
    assert!(text.contains("last_guide") && text.contains("2 device(s)"), "{text}");

    let alone = graph("--denoiser none --reproject off");
    assert!(lines(&alone, "svgf").is_empty() && lines(&alone, "path_trace").len() == 2);
    assert!(left_out(&alone, "reproject", "the view is path traced"), "{alone}");
    assert!(alone.contains("0.00 MiB cross between devices"), "{alone}");
}

#[test]
fn graph_has_passes_of_all_views() {
    let text = graph("--views 4 --sources 3 --virtual 2");
    let views = |pass: &str| lines(&text, pass).iter().map(|cells| cells[2].to_owned()).collect::<Vec<_>>();
    assert_eq!(views("path_trace"), ["view00", "view01", "view03"]);
    assert_eq!((views("reproject"), views("resolve").len()), (vec!["view02".to_owned()], 4));
    let left_out = |stage: &str, who: &str| text.lines().any(|line| line.starts_with(stage) && line.contains(who));
    assert!(left_out("select", "4 views") && left_out("path_trace", "view02"), "{text}");
}

#[test]
fn graph_json_equals_its_text() {
    let options = "--virtual 2 --set halo=exchange";
    let (text, json) = (graph(options), graph(&format!("{options} --json")));
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let passes = json["passes"].as_array().unwrap();
    assert_eq!(passes.iter().filter(|pass| pass["pass"].as_str().unwrap().starts_with("svgf")).count(), 2 * 5);
    assert_eq!((&json["devices"], &passes[0]["eye"], &passes[0]["#"]), (&2.into(), &"left".into(), &0.into()));
    let tasks = format!("{} tasks on 2 device(s), {} of them", json["tasks"], json["pass_tasks"]);
    assert!(text.contains(&tasks), "{text}");
    assert!(json["transfers"][0]["bytes"].is_number() && json["left_out"][0]["why"].is_string(), "{json}");
}

#[test]
fn each_seam_policy_has_its_passes_and_transfers() {
    let of = |seam: &str| graph(&format!("--virtual 2 --denoiser atrous --seam {seam}"));
    let [none, filter, halo] = ["none", "filter", "halo"].map(of);
    assert_eq!([&none, &filter, &halo].map(|text| lines(text, "seam_filter").len()), [0, 2, 0], "{filter}");
    assert_eq!([&none, &filter, &halo].map(|text| lines(text, "atrous").len()), [10; 3], "{halo}");
    let crossing = |text: &str| -> f64 {
        let line = text.lines().find(|line| line.contains("MiB cross between devices")).unwrap();
        let words: Vec<&str> = line.split_whitespace().collect();
        words[words.iter().position(|word| *word == "MiB").unwrap() - 1].parse().unwrap()
    };
    assert!(crossing(&none) < crossing(&filter) && crossing(&filter) < crossing(&halo), "{none}{filter}{halo}");
}

#[test]
fn graph_writes_a_dot_file() {
    let folder = Folder::new();
    folder.run("graph builtin:cornell --size 64x36 --virtual 3 --dot ./frame.dot");
    let dot = folder.text("frame.dot");
    assert!(dot.starts_with("digraph {") && dot.contains("whole images") && dot.contains("device 2"), "{dot}");
    folder.refuses(1, "", "graph builtin:cornell --dot ./no/frame.dot => frame.dot");
}

#[test]
fn graph_output_equals_the_documentation() {
    let folder = Folder::new();
    let options = "--denoiser atrous --set iterations=2 --virtual 2 --size 320x180";
    let text = folder.run(&format!("graph builtin:cornell {options} --dot ./frame.dot")).out;
    assert!(text.lines().next().is_some_and(|line| line.contains("stripes of")), "{text}");
    assert!(text.contains("path_trace      right  the view is reprojected"), "{text}");
    let dot = folder.text("frame.dot");
    assert!(dot.starts_with("digraph {") && dot.contains("rows 90..180"), "{dot}");
    // The documentation quotes a part of this output.
    let page = include_str!("../../../docs/guide/traces.md");
    let (_, section) = page.split_once("## Print the frame graph").unwrap();
    let shown = section.split("```").nth(3).unwrap().lines().skip(1).filter(|line| *line != "...");
    for line in shown {
        let is_there = text.lines().any(|l| l.trim_end() == line.trim_end());
        assert!(is_there, "docs/guide/traces.md shows '{line}', not in {text}");
    }
}
