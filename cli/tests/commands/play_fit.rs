//! `play` at sizes that do not fit the budget: it names a size that fits, plays there on demand, and stops if nothing fits.

use crate::common::{Folder, Said};
use crate::play::{LADDER, play};

/// Returns a folder with a ladder of one rung.
fn folder() -> Folder {
    let folder = Folder::new();
    folder.write("one.toml", LADDER.split_inclusive("\n\n").take(2).collect::<String>());
    folder
}

#[test]
fn play_names_a_size_that_fits_and_fit_takes_it() {
    let folder = folder();
    let play = |out: &str, options: &str| {
        let (Said { out, errors, .. }, run) =
            play(&folder, out, &format!("--size 480x320 --ladder ./one.toml {options}"));
        (out, errors, run)
    };
    let (_, errors, free) = play("free", "--budget-ms 0.01..30000 --frames 5 --fit");
    assert!(!errors.contains("fit") && free["play"]["fit"].is_null(), "{errors}");
    // The budget is a sixth of the time, which leaves room for other load on the machine.
    let median_ms = free["play"]["makespan_ms_p50"].as_f64().unwrap();
    let budget = format!("--budget-ms {}..{} --frames 3", median_ms / 10.0, median_ms / 6.0);

    let (_, errors, asked) = play("asked", &budget);
    let fit = &asked["play"]["fit"];
    let fitting = fit["fitting_size"].as_str().unwrap();
    assert_eq!([&fit["asked_size"], &fit["played_size"], &asked["settings"]["size"]], ["480x320"; 3]);
    let (width, height) = fitting.split_once('x').unwrap();
    let [width, height] = [width, height].map(|n| n.parse::<u32>().unwrap());
    assert!(width < 480 && width * 2 == height * 3, "{fitting}");
    assert!(fit["fitting_ms"].as_f64().unwrap() < median_ms / 6.0, "{fit}");
    let advice = format!("--size {fitting} should fit; --fit takes it");
    for part in ["at 480x320 the cheapest rung takes", &advice, "3 frames will take"] {
        assert!(errors.contains(part), "{part}: {errors}");
    }

    let (out, errors, taken) = play("taken", &format!("{budget} --fit"));
    let fit = &taken["play"]["fit"];
    let played = fit["played_size"].as_str().unwrap();
    assert_eq!((&fit["asked_size"], &fit["fitting_size"]), (&"480x320".into(), &played.into()));
    assert!(played != "480x320" && taken["settings"]["size"] == played, "{fit}");
    assert!(out.contains(&format!("playing at {played} instead")) && !errors.contains("will take"), "{out}");
    assert!(out.contains(&format!("{played}, denoiser atrous, 1 rung of ")), "{out}");
    let image = ::diptych::image::exr::read_rgb(&folder.path("taken/left.exr")).unwrap();
    assert_eq!(image.extent.to_string(), played);
}

#[test]
fn play_stops_if_nothing_fits_unless_it_keeps_going() {
    let folder = folder();
    // No machine renders a frame in 2 microseconds.
    let run = |options: &str| {
        let fixed = "play builtin:cornell --size 48x32 --ladder ./one.toml --budget-ms 0.001..0.002";
        let Said { status, errors, .. } =
            folder.try_run(&format!("{fixed} --fps 1000 --quiet --out ./out --frames {options}"));
        (status, folder.json("out/run.json")["frames"].as_array().unwrap().len(), errors)
    };
    let (status, frames, errors) = run("90");
    assert_eq!((status, frames), (Some(1), 30), "{errors}");
    let error = errors.lines().last().unwrap();
    assert!(error.starts_with("error: nothing fits the budget of 0.001 to 0.002 ms at 48x32: each of the"), "{errors}");
    assert!(error.ends_with("raise --budget-ms, or --set keep_going=on to play on"), "{errors}");
    assert!(folder.path("out/left.exr").is_file() && !folder.path("out/run.json.rows.part").exists());
    for (frames, options) in [(31, "31 --set keep_going=on"), (30, "30"), (31, "31 --disturb slow:dev0@3")] {
        let (status, played, errors) = run(options);
        assert_eq!((status, played), (Some(0), frames), "{options}: {errors}");
    }
}
