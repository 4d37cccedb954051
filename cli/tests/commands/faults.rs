//! Commands go on without a device that fails.

use crate::common::Folder;

#[test]
fn command_continues_without_its_first_device() {
    let folder = Folder::new();
    // This denoiser keeps no history that could be lost.
    let render = "render builtin:checker --size 64x36 --frames 3 --aov motion --denoiser atrous";
    folder.run(&format!("{render} --out ./one"));
    let lost = "--virtual 2 --disturb loss:dev0@1 --trace ./trace.json";
    let said = folder.run(&format!("{render} --out ./two {lost}")).errors;
    assert!(said.contains("warning: device 0 failed in frame 1"), "{said}");
    assert_eq!(folder.names("one"), folder.names("two"));
    for name in folder.names("one").iter().filter(|n| !["run.json", "frames.csv"].contains(&n.as_str())) {
        assert!(folder.bytes(&format!("one/{name}")) == folder.bytes(&format!("two/{name}")), "{name} differs");
    }
    let run = folder.json("two/run.json");
    let [fault] = &run["faults"].as_array().unwrap()[..] else { panic!("{run}") };
    assert_eq!((&fault["frame"], &fault["device"], &fault["kind"]), (&1.into(), &0.into(), &"loss".into()));
    assert_eq!(run["devices"].as_array().unwrap().len(), 2);
    assert_eq!(run["frames"][2]["stripes"], serde_json::json!([0, 36]));
    let trace = folder.json("trace.json");
    let events = || trace["traceEvents"].as_array().unwrap().iter();
    assert_eq!(events().filter(|e| e["name"] == "device taken out" && e["pid"] == 10).count(), 1);
    let frames = events().filter(|e| e["cat"] == "frame");
    assert_eq!(frames.map(|e| &e["args"]["devices"]).collect::<Vec<_>>(), ["0,1", "1", "1"]);
}

#[test]
fn command_fails_without_a_device_left() {
    let folder = Folder::new();
    let said = folder.try_run("render builtin:checker --size 32x18 --frames 2 --disturb loss:dev0@frame1 --out ./out");
    assert_eq!(said.status, Some(1), "{}", said.errors);
    assert!(said.errors.contains("no device is left") && said.errors.contains("device 0"), "{}", said.errors);
    // Complete earlier files stay.
    assert!(folder.names("out").contains(&"left.0000.exr".to_owned()));
}

#[test]
fn watchdog_drops_a_device_that_takes_too_long() {
    let line = "render builtin:checker --size 320x180 --spp 16 --set watchdog_ms=1 --out ./out";
    let said = Folder::new().try_run(line);
    assert_eq!(said.status, Some(1), "{}", said.errors);
    assert!(["within 1 ms", "more than 1 ms"].iter().any(|part| said.errors.contains(part)), "{}", said.errors);
}
