//! Words that the documentation avoids: documentation of items that starts as a fragment instead of with a verb or a
//! noun, and "what" as a subject.

use std::fs;

use pulldown_cmark::{Event, Tag, TagEnd};

use crate::Repository;
use crate::links::parse;

/// The most uses of "what" in 1,000 words of all documents.
const WHAT_PER_1000: f64 = 2.5;
/// The most words of README.md.
const README_WORDS: usize = 1000;

/// Lists the faults, a line each.
pub fn faults(repository: &Repository) -> Result<Vec<String>, String> {
    let mut faults = Vec::new();
    for file in repository.files.iter().filter(|file| file.starts_with("src/") && file.ends_with(".rs")) {
        let text = fs::read_to_string(repository.root.join(file)).map_err(|error| format!("{file}: {error}"))?;
        let found = fragments(&text).into_iter();
        faults.extend(found.map(|line| format!("{file}:{line}: documentation that starts as a fragment")));
    }
    let (mut places, mut count) = (Vec::new(), 0);
    for (file, text) in &repository.documents {
        let words = words(text);
        count += words.len();
        let found = words.iter().filter(|(_, word)| word.eq_ignore_ascii_case("what"));
        places.extend(found.map(|(line, _)| format!("{file}:{line}: what")));
    }
    let rate = 1000.0 * places.len() as f64 / count.max(1) as f64;
    if rate > WHAT_PER_1000 {
        faults.append(&mut places);
        faults.push(format!("\"what\" is {rate:.1} of 1,000 words, more than {WHAT_PER_1000}"));
    }
    let readme = repository.documents.get("README.md").map_or(0, |text| words(text).len());
    if readme > README_WORDS {
        faults.push(format!("README.md has {readme} words, more than {README_WORDS}"));
    }
    Ok(faults)
}

/// Returns the words of a text with their lines, without code, tables, images and link targets.
fn words(text: &str) -> Vec<(usize, String)> {
    let mut words = Vec::new();
    let mut left_out = 0;
    for (event, range) in parse(text).into_offset_iter() {
        match event {
            Event::Start(Tag::CodeBlock(_) | Tag::Table(_) | Tag::Image { .. }) => left_out += 1,
            Event::End(TagEnd::CodeBlock | TagEnd::Table | TagEnd::Image) => left_out -= 1,
            Event::Text(prose) if left_out == 0 => {
                let line = 1 + text[..range.start].matches('\n').count();
                let found = prose.split(|c: char| !c.is_alphanumeric() && !"'’-".contains(c));
                words.extend(found.filter(|word| !word.is_empty()).map(|word| (line, word.to_owned())));
            }
            _ => {}
        }
    }
    words
}

/// Returns the lines at which documentation starts as a fragment, outside tests.
fn fragments(source: &str) -> Vec<usize> {
    let source = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let lines: Vec<&str> = source.lines().map(str::trim_start).collect();
    let documentation = |line: &str| ["///", "//!"].iter().find_map(|mark| line.strip_prefix(mark)).map(str::to_owned);
    let mut found = Vec::new();
    for (at, line) in lines.iter().enumerate() {
        let Some(text) = documentation(line) else { continue };
        if at > 0 && documentation(lines[at - 1]).is_some() {
            continue;
        }
        let item = lines[at..].iter().find(|line| !line.starts_with("//") && !line.starts_with("#["));
        if is_fragment(text.trim(), item.unwrap_or(&"")) {
            found.push(at + 1);
        }
    }
    found
}

/// Returns true if documentation of an item starts as a fragment. `Whether` is for items that are true or false.
fn is_fragment(text: &str, item: &str) -> bool {
    let mut words = text.split(|c: char| !c.is_alphanumeric());
    match (words.next().unwrap_or_default(), words.next().unwrap_or_default()) {
        ("By", "default") | ("As", "of") => false,
        ("What" | "Of" | "Where" | "Those" | "As" | "By", _) => true,
        ("Whether", _) => !item.contains("bool"),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fragments_are_told_from_sentences() {
        for (text, item) in [
            ("Returns the rows of a device", "pub fn rows(&self) -> u32 {"),
            ("Splits rows among devices", "fn split() {"),
            ("Rows of the image", "pub rows: u32,"),
            ("Time in milliseconds", "ms: f64,"),
            ("The rows", "rows: u32,"),
            ("By default 1", "spp: u32,"),
            ("As of version 2", "version: u32,"),
            ("Whether it is lit", "pub lit: bool,"),
            ("Whether it is lit", "fn is_lit(&self) -> bool {"),
            ("Ofcom", "x: u32,"),
            ("Whatever is left", "left: f32,"),
            ("Whereabouts", "place: Vec3,"),
            ("Asks a device", "fn ask() {"),
            ("Bytes per row", "bytes: u32,"),
            ("With a halo, rows are copied", "fn halo() {"),
            ("In bytes", "size: u64,"),
            ("From the left eye", "left: f32,"),
            ("None if it is empty", "fn last() {"),
            ("`What` the variant is", "kind: Kind,"),
            ("", "x: u32,"),
        ] {
            assert!(!is_fragment(text, item), "{text}: {item}");
        }
        for (text, item) in [
            ("Of a device", "rows: u32,"),
            ("Of all devices, the first", "fn first() {"),
            ("Of it", "x: u32,"),
            ("By device", "rows: Vec<u32>,"),
            ("By name", "fn find() {"),
            ("By how much", "gain: f32,"),
            ("As a file has it", "text: String,"),
            ("As `rows`", "columns: u32,"),
            ("As in the paper", "sigma: f32,"),
            ("Where rows begin", "begin: u32,"),
            ("Where the eye is", "eye: Vec3,"),
            ("Where it stands", "fn place() -> Vec3 {"),
            ("What a frame took", "ms: f64,"),
            ("What is left", "fn left() -> f32 {"),
            ("What", "kind: Kind,"),
            ("Whether and where", "place: Option<Vec3>,"),
            ("Whether it is lit, as a number", "lit: u32,"),
            ("Those below", "below: Vec<u32>,"),
            ("Those of the eye", "fn rows() {"),
            ("Those, sorted", "sorted: Vec<u32>,"),
        ] {
            assert!(is_fragment(text, item), "{text}: {item}");
        }
    }

    #[test]
    fn only_first_lines_of_documentation_outside_tests_count() {
        let source = "//! Of a module\n\n/// Rows\n/// Of a device\n#[derive(Clone)]\nstruct Rows;\n    /// Whether it is lit\n    \
                      #[serde(default)]\n    lit: bool,\n    /// By device\n    rows: u32,\n// Of a comment\n#[cfg(test)]\nmod \
                      tests {\n/// Of a test\nfn test() {}\n}\n";
        assert_eq!(fragments(source), [1, 10]);
    }

    #[test]
    fn words_are_those_of_prose() {
        let text = "# What *is* it\n\nIt's [what](what.md) `what`.\n\n```\nwhat\n```\n\n| what |\n| --- |\n| what |\n\n![what](a.png)";
        let found: Vec<_> = words(text).into_iter().map(|(line, word)| format!("{line} {word}")).collect();
        assert_eq!(found, ["1 What", "1 is", "1 it", "3 It's", "3 what"]);
    }

    #[test]
    fn a_repository_is_held_to_the_rules() {
        let check = |source: &str, readme: String| {
            let files = [("README.md", readme.as_str()), ("src/exec/run.rs", source)];
            crate::with_files(&files, |repository| faults(repository).expect("they are UTF-8"))
        };
        let run = "/// A run.\nstruct Run;\n";
        assert_eq!(check(run, format!("what {}", "word ".repeat(399))), [""; 0]);
        assert_eq!(check(&format!("{run}/// Of a run\nstruct Name;\n"), String::new()).len(), 1);
        assert_eq!(check(run, format!("what {}", "word ".repeat(398))).len(), 2);
        assert_eq!(check(run, "word ".repeat(1000)), [""; 0]);
        assert_eq!(check(run, "word ".repeat(1001)).len(), 1);
    }
}
