//! Published figures: README.md and docs/results/results.md are what `tools/results/measure.py --render` writes from
//! docs/results/results.json. Comparisons need Python and are skipped without it.

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

const FILES: [&str; 3] = ["README.md", "docs/results/results.md", "docs/results/results.json"];

fn published(file: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap_or_else(|e| panic!("{file}: {e}"))
}

/// Lets the script write these [`FILES`] again; `None` without Python.
fn rendered(files: &[String; 3]) -> Option<[String; 3]> {
    let folder = tempfile::tempdir().expect("a folder can be made");
    fs::create_dir_all(folder.path().join("docs/results")).expect("a folder can be made");
    FILES.iter().zip(files).for_each(|(file, text)| fs::write(folder.path().join(file), text).unwrap());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tools/results/measure.py");
    let mut command = Command::new("python3");
    let Ok(output) = command.arg("-B").arg(script).args(["--render", "--root"]).arg(folder.path()).output() else {
        eprintln!("there is no python3, so nothing was compared");
        return None;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(FILES.map(|file| fs::read_to_string(folder.path().join(file)).unwrap()))
}

#[test]
fn published_figures_equal_the_measured_ones() {
    let files = FILES.map(published);
    let Some(found) = rendered(&files) else { return };
    for ((file, expected), found) in FILES.iter().zip(&found).zip(&files) {
        assert!(found == expected, "{file} differs from what `python3 tools/results/measure.py --render` writes");
    }
}

#[test]
fn published_results_are_complete_and_name_no_path() {
    let text = published(FILES[2]);
    let results: Value = serde_json::from_str(&text).expect("results.json is JSON");
    let tables = results["tables"].as_object().expect("results have tables by name");
    for (name, table) in tables {
        assert_eq!(table["measured"]["smoke"], false, "{name} is of tiny images");
        assert!(table["rows"].as_array().is_some_and(|rows| !rows.is_empty()), "{name} has no rows");
    }
    // README.md has no other tables of results.
    for block in published(FILES[0]).split("<!-- results: ").skip(1) {
        let name = block.split(" -->").next().unwrap();
        assert!(tables.contains_key(name), "README.md, {name}: results.json has no such table");
    }
    for place in ["/home", "/root", "/tmp", "/work", "/Users", ":\\\\"] {
        assert!(!text.contains(place), "results.json names a path with {place}");
    }
}

/// Pages have all rows, and README.md those that a table selects, with each kind of cell and a caption.
#[test]
fn script_writes_the_measured_figures() {
    let column = |key: &str, title: &str| json!({ "key": key, "title": title });
    let number = |key: &str, decimals: u32, percent: bool| json!({ "key": key, "title": key, "decimals": decimals, "percent": percent });
    let columns = [column("scene", "of"), number("ms", 1, false), number("kept", 1, true), number("n", 0, false)];
    let rows = json!([
        { "scene": "atrium", "ms": 12.25, "kept": 0.9375, "n": 2 },
        { "scene": null, "ms": 0.05, "kept": null, "n": 1 },
    ]);
    let table = |title: &str, readme: Value, others: Value, absent: Value| {
        let measured = json!({
            "commit": "0123456", "date": "2026-01-31", "machine": "2 cores of Processor", "drivers": ["A 1", "B 2"],
            "smoke": false, "others": others,
        });
        json!({
            "title": title, "readme": readme, "note": "A note.", "columns": columns, "rows": rows, "absent": absent,
            "measured": measured,
        })
    };
    let readme = json!({ "rows": { "n": [2, 3] }, "columns": ["scene", "kept"], "note": "Some." });
    let results = json!({ "tables": {
        "new": table("New: 1 of 2", readme, json!(0.0123), json!(["garage (no files)"])),
        "old": table("Old", Value::Null, Value::Null, json!([])),
        "more": table("More", Value::Null, json!(0.0), json!([])),
    } });
    let text = |more: &str| {
        format!(
            "| of | ms | kept | n |\n| --- | --- | --- | --- |\n| atrium | 12.2 | 93.8 % | 2 |\n| – | 0.1 | – | 1 |\n\n\
             *A note. 2 cores of Processor; A 1; B 2. Commit 0123456, 2026-01-31{more}*\n"
        )
    };
    let readme = |rows: &str| format!("# Name\n\n<!-- results: new -->\n{rows}<!-- /results -->\n\n| a |\n");
    let Some(once) = rendered(&[readme("| stale |\n"), String::new(), results.to_string()]) else { return };
    let short = "| of | kept |\n| --- | --- |\n| atrium | 93.8 % |\n\n*Some. [All rows](docs/results/results.md#new-1-of-2): \
                 commit 0123456, 2 cores of Processor.*\n";
    assert_eq!(once[0], readme(short));
    let captions = [
        "; other programs took 1.2 % of the cores. Not measured: garage (no files).",
        ".",
        "; other programs took 0.0 % of the cores.",
    ];
    for (title, caption) in ["New: 1 of 2", "Old", "More"].into_iter().zip(captions) {
        assert!(once[1].contains(&format!("\n## {title}\n\n{}", text(caption))), "{}", once[1]);
    }
    assert_eq!(rendered(&once).unwrap(), once);
}
