//! Help is correct: its sections, and the defaults that a run without options uses.

use serde_json::Value;

use crate::common::Folder;

/// Returns the names of all commands.
fn commands() -> Vec<String> {
    let all = Folder::new().run("--help").out;
    let (_, listed) = all.split_once("Commands:\n").unwrap();
    let names = listed.lines().map_while(|line| line.strip_prefix("  ")).filter_map(|line| line.split(' ').next());
    let names: Vec<_> = names.filter(|name| !["", "help"].contains(name)).map(str::to_owned).collect();
    assert_eq!(names.len(), 11, "{names:?}");
    names
}

#[track_caller]
fn help(command: &str) -> String {
    Folder::new().run(&format!("{command} --help")).out
}

#[test]
fn help_has_sections_with_tests_last() {
    let sections = ["Options:", "What to render:", "Quality:", "Output:", "Devices:", "For tests:"];
    for (command, count) in [("render", 6), ("play", 6), ("scale", 5), ("bench", 5)] {
        let text = help(command);
        let found: Vec<&str> = text.lines().filter(|line| sections.contains(line)).collect();
        assert_eq!(found, sections[..count], "{command}");
        let (_, unsorted) = text.split_once("Options:\n").unwrap();
        let unsorted = unsorted.split("What to render:").next().unwrap();
        assert_eq!(unsorted.matches("\n      --").count(), 0, "{command}: options without a section: {unsorted}");
    }
}

#[test]
fn help_has_no_rustdoc_links() {
    for command in &commands() {
        let text = help(command);
        assert!(!text.contains("[`") && !text.contains("::"), "{command}: {text}");
    }
}

#[test]
fn completions_and_manual_pages_have_every_command() {
    let folder = Folder::new();
    folder.run("generate man --out ./man");
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = folder.run(&format!("generate {shell}")).out;
        for command in &commands() {
            assert!(text.contains(command.as_str()), "{shell} does not complete {command}");
        }
        assert!(text.contains("budget-ms"), "{shell}");
    }
    for command in &commands() {
        let page = folder.text(&format!("man/diptych-{command}.1"));
        assert!(page.contains(".TH"), "{command}");
    }
    let page = folder.text("man/diptych-render.1");
    assert!(page.contains("Three layers"), "what values mean is in it");
    let page = folder.text("man/diptych-settings.1");
    assert!(page.contains("halo=") && page.contains("watchdog_ms=") || page.contains("watchdog\\_ms="), "{page}");
}

/// Returns the default of each option in a command's help that states one.
fn defaults(text: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for option in text.split("\n      --").skip(1) {
        let name = option.split([' ', '\n']).next().unwrap();
        let option = option.split_whitespace().collect::<Vec<_>>().join(" ");
        if let Some((_, rest)) = option.split_once("[default: ") {
            found.push((name.to_owned(), rest.split(']').next().unwrap().to_owned()));
        }
    }
    found
}

/// Formats a setting as help does.
fn written(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(values) => values.iter().map(written).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

/// Returns true for a default that can be compared, false for one described in words.
fn is_value(text: &str) -> bool {
    !text.contains([' ', ';'])
}

#[test]
fn defaults_in_help_equal_those_in_run_json() {
    let folder = Folder::new();
    for (command, given) in [
        ("render", "--size 16x9 --quiet"),
        ("play", "--size 16x9 --quiet --frames 2 --budget-ms 0.01..1000"),
        ("scale", "--size 16x9 --quiet --warm-up 0"),
        ("bench", "--size 16x9 --quiet --spp 1 --bounces 2 --denoiser none --reference-spp 16"),
    ] {
        folder.run(&format!("{command} builtin:checker --out ./{command} {given}"));
        let run = folder.json(&format!("{command}/run.json"));
        let mut compared = 0;
        for (name, default) in defaults(&help(command)) {
            let was_given = given.split(' ').any(|word| word.strip_prefix("--") == Some(&name));
            if was_given || !is_value(&default) {
                continue;
            }
            let ran = &run["settings"][name.replace('-', "_")];
            let numbers = |text: &str| text.split(',').map(|n| n.parse().ok()).collect::<Option<Vec<f64>>>();
            let is_same =
                written(ran) == default || numbers(&default).is_some_and(|n| numbers(&written(ran)) == Some(n));
            assert!(is_same, "{command} --{name}: {default} in help, {ran} ran");
            compared += 1;
        }
        assert!(compared >= 4, "{command}: {compared}");
        if command == "scale" {
            let frames = run["frames"].as_array().unwrap().len();
            assert_eq!(run["settings"]["frames"].as_u64(), Some(frames as u64 / 2), "of one device and of two");
        }
    }
}
