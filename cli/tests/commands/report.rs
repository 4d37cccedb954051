//! `--report` writes one self-contained page. `make test-full` runs its script in Chromium.

use std::path::Path;
use std::process::Command;

use crate::common::{Folder, is_thorough};
use crate::runs::run;
use serde_json::Value;

/// Runs a command on a small picture; returns the page.
fn report(folder: &Folder, line: &str) -> String {
    folder.run(&format!("{line} --size 48x32 --quiet --report --out ./"));
    folder.text("report.html")
}

/// Returns the data of the page's live figures of a kind.
fn data(page: &str, kind: &str) -> Value {
    let begin = format!("data-kind=\"{kind}\"><script type=\"application/json\">");
    let (_, rest) = page.split_once(&begin).unwrap_or_else(|| panic!("no {kind}"));
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
}

/// Asserts that nothing is fetched: the page embeds all that it refers to.
fn stands_alone(page: &str) {
    for attribute in ["src=\"", "href=\"", "url("] {
        for (at, _) in page.match_indices(attribute) {
            let to = &page[at + attribute.len()..];
            assert!(to.starts_with("data:image/png;base64,"), "{attribute}{}", to.get(..60).unwrap_or(to));
        }
    }
    let foreign = ["<link", "@import", "fetch(", "XMLHttpRequest", "http://", "https://"];
    let namespaces = page.replace("http://www.w3.org/2000/svg", "");
    assert!(foreign.iter().all(|word| !namespaces.contains(word)));
}

/// Asserts that every frame's tasks are complete, have valid shapes, and end with the frame at the latest, within clock
/// errors.
fn lanes_are_sound(lanes: &Value, frames: usize) {
    let (shapes, found) = (lanes["shapes"].as_array().unwrap(), lanes["frames"].as_array().unwrap());
    assert_eq!(found.len(), frames);
    assert!(lanes["shown"].as_u64().unwrap() < frames as u64);
    for frame in found {
        let (tasks, ms) = (frame["tasks"].as_array().unwrap(), frame["ms"].as_f64().unwrap());
        assert!(!tasks.is_empty() && tasks.len().is_multiple_of(3), "{frame}");
        let mut begin = 0;
        for task in tasks.chunks(3).map(|t| [0, 1, 2].map(|i| t[i].as_i64().unwrap())) {
            assert!((task[0] as usize) < shapes.len() && task[2] >= 0, "{task:?}");
            begin += task[1];
            assert!((begin + task[2]) as f64 / 1e3 < ms + 5.0, "{task:?} of a frame of {ms} ms");
        }
    }
}

/// In a long run, opens the page of `out` in Chromium; returns the document after its script ran.
fn browse(out: &Path) -> Option<String> {
    if !is_thorough() {
        return None;
    }
    let page = format!("file://{}", out.join("report.html").display());
    let profile = format!("--user-data-dir={}", out.join("profile").display());
    let fixed = ["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--v=0"];
    let mut command = Command::new("chromium");
    command.args(fixed).args([&profile, "--virtual-time-budget=2000", "--window-size=1200,900", "--dump-dom", &page]);
    let output = command.output().expect("the long tests open pages in chromium, which is to be on the PATH");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!said.contains("CONSOLE") && !said.contains("Uncaught"), "{said}");
    let document = String::from_utf8(output.stdout).unwrap();
    assert!(document.contains("data-ready=\"1\""), "the script did not end: {said}");
    Some(document)
}

#[test]
fn page_of_play_shows_frames_and_reference() {
    let folder = Folder::new();
    let shape = "--budget-ms 0.01..30000 --frames 12 --fps 1000 --virtual 2 --set report_spp=64";
    let disturbed = "--disturb slow:dev1@4..6 --disturb scene-cut@8 --disturb loss:dev1@frame10";
    let page = report(&folder, &format!("play builtin:cornell {shape} {disturbed}"));
    stands_alone(&page);
    lanes_are_sound(&data(&page, "lanes"), 12);
    let run = folder.json("run.json");
    let timeline = data(&page, "timeline");
    let frames = run["frames"].as_array().unwrap();
    for column in ["index", "rung"] {
        assert!(frames.iter().map(|f| &f[column]).eq(timeline[column].as_array().unwrap()), "{column}");
    }
    for (frame, samples) in frames.iter().zip(timeline["spp"].as_array().unwrap()) {
        let [spp, scale] = ["spp", "scale"].map(|name| frame[name].as_f64().unwrap());
        assert!((spp * scale * scale - samples.as_f64().unwrap()).abs() < 0.01, "{frame}");
    }
    let names: Vec<_> = timeline["disturbed"].as_array().unwrap().iter().map(|d| (&d["name"], &d["from"])).collect();
    let expected = [("slow: device 1", 4), ("scene cut", 8), ("loss: device 1", 10)].map(|(n, f)| (n.into(), f.into()));
    assert_eq!(names, expected.each_ref().map(|(name, from): &(Value, Value)| (name, from)));
    assert!(frames.iter().map(|f| &f["stripes"]).eq(timeline["rows"].as_array().unwrap()), "{timeline}");
    let rows = |frame: usize| timeline["rows"][frame].as_array().unwrap().iter().filter(|rows| **rows != 0).count();
    assert_eq!([9, 10, 11].map(rows), [2, 1, 1]);
    assert_eq!(page.matches("<img").count(), 6);
    for part in ["reference, 64 spp", "FLIP, left eye (mean 0.", "builtin:cornell", "triangles", "<h2>Rungs</h2>"] {
        assert!(page.contains(part), "no {part}");
    }
    // The reference has the camera position after the jump.
    folder.run("render builtin:cornell --reference --spp 64 --time 0.011 --size 48x32 --out ./before");
    let other = folder.run("compare ./before/left.exr ./left.exr --json").json();
    let flip: f64 = page.split_once("FLIP, left eye (mean ").unwrap().1[..6].parse().unwrap();
    assert!(flip < 0.8 * other["flip"].as_f64().unwrap(), "{flip} against {other}");
    if let Some(document) = browse(&folder.path("")) {
        let lanes = ["0 left", "0 right", "0 transfers", "1 left", "1 right", "1 transfers"];
        for part in lanes.into_iter().chain(["scene cut", "slow: device 1", "loss: device 1"]) {
            assert!(document.contains(&format!(">{part}</text>")), "no {part}");
        }
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn page_of_bench_shows_front_and_other_renderers() {
    let folder = Folder::new();
    let peer = |name, time_ms, flip| format!("[[peer]]\nname = '{name}'\ntime_ms = {time_ms}\nflip = {flip}\n");
    folder.write("peers.toml", peer("Slow", "1e6", "0.999") + &peer("Right", "1", "1e-6"));
    let grid = "--quick --spp 1,2 --bounces 2 --denoiser none,atrous --reference-spp 16";
    let page =
        report(&folder, &format!("bench builtin:cornell --repeats 1 --warm-up 0 --set peers=./peers.toml {grid}"));
    stands_alone(&page);
    let names: Vec<String> =
        data(&page, "lanes")["frames"].as_array().unwrap().iter().map(|f| f["name"].to_string()).collect();
    assert!(names[0].contains("fastest: ") && names.len() <= 3, "{names:?}");
    lanes_are_sound(&data(&page, "lanes"), names.len());
    assert_eq!(page.matches("<img").count(), 5 * names.len() + 2);
    let peer = "<td class=\"number\">0.999</td>";
    for part in ["Fronts and quality ladder", "Slow", peer, "<td>none</td>", "Time against error"] {
        assert!(page.contains(part), "no {part}");
    }
    // Other renderers appear only on the page.
    assert!(!folder.text("ladder.svg").contains("Slow"));
    browse(&folder.path(""));
}

#[test]
fn page_of_scale_shows_a_frame_per_count() {
    let run = run("in flight");
    let page = run.text("report.html");
    stands_alone(&page);
    let lanes = data(&page, "lanes");
    lanes_are_sound(&lanes, 2);
    assert_eq!((&lanes["frames"][1]["name"], &lanes["shown"]), (&"2 device(s), measured".into(), &1.into()));
    assert!(page.contains("All counts gave the same bytes.") && page.matches("<img").count() == 2);
    browse(&run.folder());
}
