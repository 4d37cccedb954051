//! The interface that other programs rely on: options, columns of CSV files and stage names, as recorded in
//! `tests/interface`. A change is either intended or a mistake: `DIPTYCH_WRITE_INTERFACE=1` writes the files.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::common::Folder;

/// Environment variable to write the files instead of comparing them.
const WRITES: &str = "DIPTYCH_WRITE_INTERFACE";

#[track_caller]
fn assert_recorded(name: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interface").join(name);
    if std::env::var_os(WRITES).is_some() {
        fs::write(&path, text).unwrap();
    }
    let recorded = fs::read_to_string(&path).unwrap_or_default();
    let lines = |text: &str| text.lines().map(str::to_owned).collect::<BTreeSet<_>>();
    let [lost, new] = [(&recorded, text), (&text.to_owned(), &recorded)].map(|(a, b)| &lines(a) - &lines(b));
    assert!(recorded == text, "tests/interface/{name}: lost {lost:#?}, new {new:#?}: see {WRITES}");
}

/// Lines, with the commands that have each.
type Recorded = BTreeMap<String, Vec<&'static str>>;

fn text(lines: &Recorded) -> String {
    lines.iter().map(|(line, commands)| format!("{line}: {}\n", commands.join(" "))).collect()
}

/// Lists options with the names of their values.
#[test]
fn options_equal_the_recorded_ones() {
    let mut options = Recorded::new();
    for command in ["render", "play", "scale", "bench", "compare", "trace", "graph", "info", "export"] {
        let help = Folder::new().run(&format!("{command} --help")).out;
        for line in help.lines().map(str::trim_start).filter(|line| line.starts_with("--") || line.starts_with("-h")) {
            let words = line.split_whitespace().take_while(|word| word.starts_with(['-', '<', '[']));
            options.entry(words.collect::<Vec<_>>().join(" ")).or_default().push(command);
        }
    }
    assert_recorded("options.txt", &text(&options));
}

/// Options of programs with other features, and of other programs.
const OTHER_OPTIONS: &str =
    "--broadcast-scene --late-border --panel --screenshot --xr --bind-to --map-by --mca --signal";

/// Adds what Markdown files below `path` show of the command line: spans and lines which begin with `--` or a command.
fn add_code(path: &Path, code: &mut Vec<String>) {
    if path.is_dir() {
        fs::read_dir(path).unwrap().for_each(|entry| add_code(&entry.unwrap().path(), code));
    } else if path.extension().is_some_and(|extension| extension == "md") {
        let text = fs::read_to_string(path).unwrap();
        let spans = text.lines().flat_map(|line| line.split('`'));
        code.extend(spans.filter(|span| span.starts_with("--") || span.starts_with("diptych ")).map(str::to_owned));
    }
}

#[test]
fn documents_name_only_options_that_exist() {
    let folder = Folder::new();
    let commands = "render play scale bench compare trace graph info export study generate".split(' ');
    let help: String = commands.map(|command| folder.run(&format!("{command} --help")).out).collect();
    let known: BTreeSet<&str> = help.split([' ', ',', '\n']).chain(OTHER_OPTIONS.split(' ')).collect();
    let settings = folder.run("info --settings").out;
    // The guide to adding a setting adds an outline.
    let keys: BTreeSet<&str> =
        settings.lines().filter_map(|line| line.split_whitespace().next()).chain(["outline"]).collect();
    let mut code = Vec::new();
    for path in ["docs", "README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "examples", "src"] {
        add_code(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path), &mut code);
    }
    assert!(code.len() > 300, "there are only {} pieces of code", code.len());
    let is_wrong = |code: &&String| {
        let words: Vec<&str> = code.split([' ', '=', '|', '(', ')', ',', '…']).collect();
        let option = |word: &&str| word.starts_with("--") && word.contains(char::is_alphabetic);
        let is_key = |word: &str| !word.is_empty() && word.chars().all(|c| c.is_ascii_lowercase() || c == '_');
        words.iter().filter(|word| option(word)).any(|word| !known.contains(word))
            || words.windows(2).any(|pair| pair[0] == "--set" && is_key(pair[1]) && !keys.contains(pair[1]))
    };
    let wrong: Vec<_> = code.iter().filter(is_wrong).collect();
    assert!(wrong.is_empty(), "no such option or setting: {wrong:#?}");
}

/// Lists the columns of every CSV file, and the members of run.json by path.
#[test]
fn columns_and_members_equal_the_recorded_ones() {
    let folder = Folder::new();
    let (mut columns, mut members) = (String::new(), Recorded::new());
    for (command, options) in [
        ("render", "--virtual 2 --frames 2 --warm-up 0"),
        ("play", "--frames 3 --budget-ms 1..1000"),
        ("scale", "--counts 1,2 --frames 1 --warm-up 0 --simulate 4"),
        ("bench", "--quick --spp 1 --bounces 1 --denoiser svgf --reference-spp 16"),
    ] {
        let small = "builtin:cornell --size 32x18 --threads-per-device 1 --quiet";
        folder.run(&format!("{command} {small} {options} --out ./{command}"));
        for file in folder.names(command).iter().filter(|name| name.ends_with(".csv")) {
            let text = folder.text(&format!("{command}/{file}"));
            columns += &format!("{command} {file} {}\n", text.lines().next().unwrap());
        }
        let mut paths = BTreeSet::new();
        collect("", &folder.json(&format!("{command}/run.json")), &mut paths);
        paths.into_iter().for_each(|path| members.entry(path[1..].to_owned()).or_default().push(command));
    }
    // The columns of the critical path depend on the stages that happen to be on it.
    let columns = columns.split(',').filter(|column| !column.starts_with("critical_")).collect::<Vec<_>>().join(",");
    assert_recorded("columns.txt", &columns);
    assert_recorded("run_json.txt", &text(&members));
}

/// Adds the paths of all members of a value, except options and the details of devices and faults.
fn collect(path: &str, value: &Value, members: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => {
            for (name, value) in object {
                let path = format!("{path}.{name}");
                if !path.ends_with(".settings") && !path.ends_with(".stage_ms") {
                    collect(&path, value, members);
                }
                members.insert(path);
            }
        }
        Value::Array(values) => values.iter().for_each(|value| collect(&format!("{path}[]"), value, members)),
        _ => {}
    }
}
