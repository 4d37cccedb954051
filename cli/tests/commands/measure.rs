//! `info --check` times built-in scenes on each adapter and checks their images.

use crate::common::Folder;

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn check_measures_the_machine_and_its_images() {
    let folder = Folder::new();
    let result = folder.run("info --check --minutes 2 --sizes 16x9,32x18 --json --out ./").json();
    let machine = folder.json("machine.json");
    assert_eq!(result["machine"], machine);
    let rows = |name: &str| machine[name].as_array().unwrap().clone();
    let ready = rows("adapters").iter().filter(|a| a["missing"].as_array().unwrap().is_empty()).count();
    assert!(ready > 0 && rows("left_out").is_empty(), "{:?}", rows("left_out"));
    assert!(rows("frames").len() >= 8 * ready && rows("largest").len() == 8 * ready);
    assert!(rows("images").len() >= 4 * ready);
    for frame in rows("frames") {
        let [least, median, most] = ["least_ms", "median_ms", "most_ms"].map(|key| frame[key].as_f64().unwrap());
        assert!(0.0 < least && least <= median && median <= most, "{frame}");
        assert!(frame["stage_ms"]["path_trace"].as_f64().unwrap() > 0.0, "{frame}");
    }
    // The largest size of all may fit on a fast adapter.
    for largest in rows("largest") {
        let is_within = largest["median_ms"].as_f64().is_none_or(|ms| ms <= largest["within_ms"].as_f64().unwrap());
        assert!(is_within && largest["size"].is_null() == largest["median_ms"].is_null(), "{largest}");
    }
    assert!(rows("images").iter().all(|image| image["is_right"] == true), "{:?}", rows("images"));
    let scaling = rows("scaling");
    assert!(scaling.len() == 2 && scaling[0]["devices"] == 1 && scaling[1]["devices"].as_u64() > Some(1));
    let page = folder.text("report.html");
    for heading in ["Adapters", "Frame times", "Largest sizes within a budget", "Stages", "Scaling", "Images"] {
        assert!(page.contains(&format!("<h2>{heading}</h2>")), "{heading}");
    }
}

#[test]
#[ignore = "renders many pictures: `make test-full` runs it"]
fn check_names_sizes_beyond_its_time_limit() {
    let text = Folder::new().run("info --check --minutes 0.05 --sizes 64x36,128x72,256x144 --out ./").out;
    assert!(text.contains("left out: atrium at 256x144"), "{text}");
}
