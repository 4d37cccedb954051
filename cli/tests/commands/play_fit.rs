//! `play` at sizes that do not fit the budget: it names a size that fits, plays there on demand, and stops if nothing fits.

use crate::common::diptych;
use crate::play::{LADDER, says};
use serde_json::Value;

#[test]
fn play_names_a_size_that_fits_and_fit_takes_it() {
    let folder = tempfile::tempdir().unwrap();
    let ladder = folder.path().join("one.toml");
    std::fs::write(&ladder, LADDER.split_inclusive("\n\n").take(2).collect::<String>()).unwrap();
    let size = ["--size", "480x320", "--ladder", ladder.to_str().unwrap()];
    let run = |name: &str, options: &[&str]| says(&folder.path().join(name), &[&size, options].concat());
    let (_, stderr, free) = run("free", &["--budget-ms", "0.01..30000", "--frames", "5", "--fit"]);
    assert!(!stderr.contains("fit") && free["play"]["fit"].is_null(), "{stderr}");
    // The budget is a sixth of the time, which leaves room for other load on the machine.
    let median_ms = free["play"]["makespan_ms_p50"].as_f64().unwrap();
    let budget = format!("{}..{}", median_ms / 10.0, median_ms / 6.0);

    let (_, stderr, asked) = run("asked", &["--budget-ms", &budget, "--frames", "3"]);
    let fit = &asked["play"]["fit"];
    let [fitting, played] = ["fitting_size", "played_size"].map(|name| fit[name].as_str().unwrap().to_owned());
    assert_eq!(
        (&fit["asked_size"], played.as_str(), &asked["settings"]["size"]),
        (&"480x320".into(), "480x320", &"480x320".into())
    );
    let (width, height) = fitting.split_once('x').unwrap();
    let [width, height] = [width, height].map(|n| n.parse::<u32>().unwrap());
    assert!(width < 480 && width * 2 == height * 3, "{fitting}");
    assert!(fit["fitting_ms"].as_f64().unwrap() < median_ms / 6.0, "{fit}");
    for part in [
        "at 480x320 the cheapest rung takes",
        &format!("--size {fitting} should fit; --fit takes it"),
        "3 frames will take",
    ] {
        assert!(stderr.contains(part), "{part}: {stderr}");
    }

    let (stdout, stderr, taken) = run("taken", &["--budget-ms", &budget, "--frames", "3", "--fit"]);
    let fit = &taken["play"]["fit"];
    let played = fit["played_size"].as_str().unwrap();
    assert_eq!((&fit["asked_size"], &fit["fitting_size"]), (&"480x320".into(), &played.into()));
    assert!(played != "480x320" && taken["settings"]["size"] == played, "{fit}");
    assert!(stdout.contains(&format!("playing at {played} instead")) && !stderr.contains("will take"), "{stdout}");
    assert!(stdout.contains(&format!("{played}, denoiser atrous, 1 rung of ")), "{stdout}");
    let image = ::diptych::image::exr::read_rgb(&folder.path().join("taken/left.exr")).unwrap();
    assert_eq!(image.extent.to_string(), played);
}

#[test]
fn play_stops_if_nothing_fits_unless_it_keeps_going() {
    let folder = tempfile::tempdir().unwrap();
    let ladder = folder.path().join("one.toml");
    std::fs::write(&ladder, LADDER.split_inclusive("\n\n").take(2).collect::<String>()).unwrap();
    // No machine renders a frame in 2 microseconds.
    let size = ["--size", "48x32", "--ladder", ladder.to_str().unwrap(), "--budget-ms", "0.001..0.002"];
    let run = |frames: &str, more: &[&str]| {
        let out = folder.path().join("out");
        let args = ["play", "builtin:cornell", "--fps", "1000", "--quiet", "--out", out.to_str().unwrap()];
        let output = diptych(&[&args, &size[..], &["--frames", frames], more].concat());
        let text = std::fs::read_to_string(out.join("run.json")).unwrap();
        let run: Value = serde_json::from_str(&text).unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), run["frames"].as_array().unwrap().len(), stderr)
    };
    let (status, frames, stderr) = run("90", &[]);
    assert_eq!((status, frames), (Some(1), 30), "{stderr}");
    let error = stderr.lines().last().unwrap();
    assert!(error.starts_with("error: nothing fits the budget of 0.001 to 0.002 ms at 48x32: each of the"), "{stderr}");
    assert!(error.ends_with("raise --budget-ms, or --set keep_going=on to play on"), "{stderr}");
    assert!(folder.path().join("out/left.exr").is_file() && !folder.path().join("out/run.json.rows.part").exists());
    for (frames, more) in [("31", &["--set", "keep_going=on"][..]), ("30", &[]), ("31", &["--disturb", "slow:dev0@3"])]
    {
        let (status, played, stderr) = run(frames, more);
        assert_eq!((status, played.to_string().as_str()), (Some(0), frames), "{more:?}: {stderr}");
    }
}
