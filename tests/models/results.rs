//! Published figures: the tables in README.md and docs/results/results.md agree with docs/results/results.json. This
//! file formats tables a second time, like `tools/results/text.py`.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

const END: &str = "<!-- /results -->\n";

fn text_of(value: &Value) -> &str {
    value.as_str().unwrap_or_else(|| panic!("{value} is no text"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("{value} is no list"))
}

fn line(cells: impl Iterator<Item = String>) -> String {
    format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "))
}

fn cell(column: &Value, row: &Value) -> String {
    let value = &row[text_of(&column["key"])];
    let Some(decimals) = column["decimals"].as_u64() else {
        return value.as_str().unwrap_or("–").to_owned();
    };
    let decimals = decimals as usize;
    match (value.as_f64(), column["percent"] == true) {
        (Some(number), true) => format!("{:.decimals$} %", number * 100.0),
        (Some(number), false) => format!("{number:.decimals$}"),
        (None, _) => "–".to_owned(),
    }
}

/// Returns the rows of a table and its caption.
fn table_text(table: &Value) -> String {
    let (columns, measured) = (list(&table["columns"]), &table["measured"]);
    let mut text = line(columns.iter().map(|column| text_of(&column["title"]).to_owned()));
    text += &line(columns.iter().map(|_| "---".to_owned()));
    text.extend(list(&table["rows"]).iter().map(|row| line(columns.iter().map(|column| cell(column, row)))));
    let field = |name: &str| text_of(&measured[name]);
    let drivers: Vec<&str> = list(&measured["drivers"]).iter().map(text_of).collect();
    text += &format!("\n*{} {}; {}.", text_of(&table["note"]), field("machine"), drivers.join("; "));
    text += &format!(" Commit {}, {}", field("commit"), field("date"));
    if let Some(others) = measured["others"].as_f64() {
        text += &format!("; other programs took {:.1} % of the cores", others * 100.0);
    }
    let absent = list(&table["absent"]).iter().map(|absent| format!(" Not measured: {}.", text_of(absent)));
    text + "." + &absent.collect::<String>() + "*\n"
}

fn tables(results: &Value) -> impl Iterator<Item = (&String, &Value)> {
    results["tables"].as_object().expect("results have tables by name").iter()
}

/// Returns a table's section of docs/results/results.md.
fn section(table: &Value) -> String {
    format!("\n## {}\n\n{}", text_of(&table["title"]), table_text(table))
}

/// Returns the blocks of a text between marker comments, by name.
fn blocks(text: &str) -> Vec<(&str, &str)> {
    let begun = text.split("<!-- results: ").skip(1);
    let named = begun.map(|rest| rest.split_once(" -->\n").expect("a block has a name"));
    named.map(|(name, rest)| (name, rest.split_once(END).expect("a block has an end").0)).collect()
}

/// Returns the differences of both texts from the results; none if they agree.
fn differences(results: &Value, readme: &str, page: &str) -> Vec<String> {
    let mut found = Vec::new();
    let blocks = blocks(readme);
    for (name, table) in tables(results) {
        let of: Vec<&str> = blocks.iter().filter(|(block, _)| block == name).map(|(_, text)| *text).collect();
        let expected: &[String] = if table["readme"].is_string() { &[table_text(table)] } else { &[] };
        if of != expected {
            found.push(format!("README.md, {name}: {of:#?} instead of {expected:#?}"));
        }
        if !page.contains(&section(table)) {
            found.push(format!("docs/results/results.md, {name}: it lacks {}", section(table)));
        }
    }
    let unknown = blocks.iter().filter(|(name, _)| results["tables"].get(name).is_none());
    found.extend(unknown.map(|(name, _)| format!("README.md, {name}: docs/results/results.json has no such table")));
    if page.matches("\n## ").count() != tables(results).count() {
        found.push("docs/results/results.md has other tables than docs/results/results.json".to_owned());
    }
    found
}

fn read(root: &Path, file: &str) -> String {
    fs::read_to_string(root.join(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}

fn differences_in(root: &Path) -> Vec<String> {
    let results = serde_json::from_str(&read(root, "docs/results/results.json")).expect("the results are JSON");
    differences(&results, &read(root, "README.md"), &read(root, "docs/results/results.md"))
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn published_figures_equal_the_measured_ones() {
    assert_eq!(differences_in(root()), Vec::<String>::new(), "python3 tools/results/measure.py --render writes them");
}

#[test]
fn published_results_are_complete_and_name_no_path() {
    let text = read(root(), "docs/results/results.json");
    let results: Value = serde_json::from_str(&text).expect("docs/results/results.json is JSON");
    for (name, table) in tables(&results) {
        assert_eq!(table["measured"]["smoke"], false, "{name} is of tiny images");
        assert!(!list(&table["rows"]).is_empty(), "{name} has no rows");
    }
    for place in ["/home", "/root", "/tmp", "/work", "/Users", ":\\\\"] {
        assert!(!text.contains(place), "docs/results/results.json names a path with {place}");
    }
}

/// Returns results with each kind of cell.
fn sample() -> Value {
    let column = |key: &str, title: &str| json!({ "key": key, "title": title });
    let number = |key: &str, title: &str, decimals: u32, percent: bool| json!({ "key": key, "title": title, "decimals": decimals, "percent": percent });
    let columns = [
        column("scene", "scene"),
        number("ms", "time, ms", 1, false),
        number("kept", "kept", 1, true),
        number("devices", "devices", 0, false),
    ];
    let measured = json!({
        "commit": "0123456", "date": "2026-01-31", "machine": "2 cores of Processor", "drivers": ["A 1", "B 2"],
        "smoke": false, "others": 0.0123,
    });
    let rows = json!([
        { "scene": "atrium", "ms": 12.25, "kept": 0.9375, "devices": 2 },
        { "scene": null, "ms": 0.05, "kept": null, "devices": 1 },
    ]);
    let table = |title: &str, readme: Value, others: f64, absent: Value| {
        let mut measured = measured.clone();
        measured["others"] = if others.is_nan() { Value::Null } else { others.into() };
        json!({
            "title": title, "readme": readme, "note": "A note.", "columns": columns, "rows": rows, "absent": absent,
            "measured": measured,
        })
    };
    json!({ "tables": {
        "new": table("New", json!("## New"), 0.0123, json!(["garage (no files)"])),
        "old": table("Old", json!("## Old"), f64::NAN, json!([])),
        "kept": table("Kept", json!("## Old"), 0.0, json!([])),
        "more": table("More", Value::Null, 0.0, json!([])),
    } })
}

/// A README with a stale table, before the sample's tables are inserted.
const README: &str = "# Name\n\n## Old\n\nWords.\n\n| a |\n| --- |\n| 1 |\n\n*A caption.*\n\nMore words.\n\n\
    <!-- results: kept -->\n| stale |\n<!-- /results -->\n\n## New\n\nWords alone.\n\n## Options\n\n| option |\n| --- |\n| a |\n";

/// Returns the README with the sample's tables.
fn readme_with(results: &Value) -> String {
    let block = |name: &str| format!("<!-- results: {name} -->\n{}{END}", table_text(&results["tables"][name]));
    let [new, old, kept] = ["new", "old", "kept"].map(block);
    format!(
        "# Name\n\n## Old\n\nWords.\n\n{old}\nMore words.\n\n{kept}\n## New\n\nWords alone.\n\n{new}\n## Options\n\n\
         | option |\n| --- |\n| a |\n"
    )
}

fn page_of(results: &Value) -> String {
    "# Results\n".to_owned() + &tables(results).map(|(_, table)| section(table)).collect::<String>()
}

#[test]
fn tables_have_their_figures_and_a_caption() {
    let expected = "\
        | scene | time, ms | kept | devices |\n\
        | --- | --- | --- | --- |\n\
        | atrium | 12.2 | 93.8 % | 2 |\n\
        | – | 0.1 | – | 1 |\n\
        \n\
        *A note. 2 cores of Processor; A 1; B 2. Commit 0123456, 2026-01-31; other programs took 1.2 % of the cores. \
        Not measured: garage (no files).*\n";
    assert_eq!(table_text(&sample()["tables"]["new"]), expected);
}

#[test]
fn unmeasured_figures_are_detected() {
    let results = sample();
    let (readme, page) = (readme_with(&results), page_of(&results));
    assert_eq!(differences(&results, &readme, &page), Vec::<String>::new());
    let wrong = [
        (readme.replacen("12.2", "11.2", 1), page.clone(), "a figure of README.md"),
        (readme.replacen("0123456", "0123457", 1), page.clone(), "a caption of README.md"),
        (readme.replace("<!-- results: new -->", "<!-- results: other -->"), page.clone(), "an unknown table"),
        (README.to_owned(), page.clone(), "a README without the tables"),
        (readme.clone(), page.replacen("93.8", "94.8", 1), "a figure of docs/results/results.md"),
        (readme.clone(), page.clone() + "\n## Another\n", "another table of docs/results/results.md"),
    ];
    for (readme, page, what) in wrong {
        assert!(!differences(&results, &readme, &page).is_empty(), "{what} is not found");
    }
}

/// Skips the comparison without Python.
#[test]
fn script_writes_the_measured_figures() {
    let folder = tempfile::tempdir().expect("a folder can be made");
    let here = folder.path();
    let results = sample();
    fs::create_dir_all(here.join("docs/results")).expect("a folder can be made");
    fs::write(here.join("docs/results/results.json"), results.to_string()).expect("a file can be written");
    fs::write(here.join("README.md"), README).expect("a file can be written");
    let script = root().join("tools/results/measure.py");
    for run in ["first", "second"] {
        let mut command = Command::new("python3");
        command.arg("-B").arg(&script).arg("--render").arg("--root").arg(here);
        let Ok(output) = command.output() else {
            eprintln!("there is no python3, so nothing was compared");
            return;
        };
        assert!(output.status.success(), "{run}: {}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(differences_in(here), Vec::<String>::new(), "{run} run");
        assert_eq!(read(here, "README.md"), readme_with(&results), "{run} run");
    }
}
