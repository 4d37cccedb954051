//! Checks the links of all Markdown files in the repository: files and folders that they name, and anchors of headings.
//!
//!     rustc --edition 2024 -o out/links tools/links.rs && out/links
//!
//! Run it in the root of the repository. It lists each broken link by file and line, and then exits with status 1. A link
//! may lead to files that git tracks or would track; links to other sites are not followed. Anchors are made of headings
//! that begin with `#`, as GitHub makes them, and `#L10` names a line of any other text file.
//! `tests/models` has this file as a module for its tests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Where a link leads, and the line that it stands on.
type Link = (usize, String);

#[cfg(not(test))]
fn main() {
    let root = Path::new(".");
    match tracked(root).and_then(|files| broken_links(root, &files)) {
        Ok(broken) if broken.is_empty() => {}
        Ok(broken) => {
            eprintln!("{}", broken.join("\n"));
            std::process::exit(1);
        }
        Err(error) => {
            eprintln!("links: {error}");
            std::process::exit(1);
        }
    }
}

/// Lists the broken links of `files`, which are below `root`, a line each.
fn broken_links(root: &Path, files: &BTreeSet<String>) -> Result<Vec<String>, String> {
    let mut texts = BTreeMap::new();
    for file in files.iter().filter(|file| file.ends_with(".md")) {
        let text = fs::read_to_string(root.join(file)).map_err(|error| format!("{file}: {error}"))?;
        texts.insert(file.as_str(), text);
    }
    if texts.is_empty() {
        return Err("no Markdown file was found".to_owned());
    }
    let mut broken = Vec::new();
    for (file, text) in &texts {
        for (line, target) in links(text) {
            if let Err(reason) = check(root, files, &texts, file, &target) {
                broken.push(format!("{file}:{line}: {target}: {reason}"));
            }
        }
    }
    Ok(broken)
}

/// Files that git tracks, or would once they are added.
#[cfg(not(test))]
fn tracked(root: &Path) -> Result<BTreeSet<String>, String> {
    let mut git = std::process::Command::new("git");
    git.current_dir(root).args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]);
    let output = git.output().map_err(|error| format!("git: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    let listed = String::from_utf8_lossy(&output.stdout);
    Ok(listed.split('\0').filter(|file| root.join(file).is_file()).map(str::to_owned).collect())
}

fn check(
    root: &Path,
    files: &BTreeSet<String>,
    texts: &BTreeMap<&str, String>,
    from: &str,
    target: &str,
) -> Result<(), String> {
    if is_elsewhere(target) {
        return Ok(());
    }
    let (path, anchor) = target.split_once('#').map_or((target, None), |(path, anchor)| (path, Some(anchor)));
    let path = match path {
        "" => from.to_owned(),
        path => resolve(from, &unescape(path)).ok_or("it leads out of the repository")?,
    };
    let is_file = files.contains(&path);
    if !is_file && !path.is_empty() && !files.iter().any(|file| file.starts_with(&format!("{path}/"))) {
        return Err(format!("the repository has no {path}"));
    }
    let Some(anchor) = anchor else { return Ok(()) };
    if let Some(text) = texts.get(path.as_str()) {
        let anchor = unescape(anchor);
        let found = anchors(text).contains(&anchor);
        return if found { Ok(()) } else { Err(format!("{path} has no heading for #{anchor}")) };
    }
    let number = anchor.strip_prefix('L').and_then(|number| number.parse::<usize>().ok());
    let number = number.filter(|_| is_file).ok_or("it has an anchor, and no headings")?;
    let text = fs::read_to_string(root.join(&path)).map_err(|error| error.to_string())?;
    if (1..=text.lines().count()).contains(&number) { Ok(()) } else { Err(format!("{path} has no line {number}")) }
}

/// Whether a target begins with a scheme, as `https:`, or names another host.
fn is_elsewhere(target: &str) -> bool {
    let scheme = target.split_once(':').map_or("", |(scheme, _)| scheme);
    let is_scheme = scheme.len() > 1 && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    is_scheme || target.starts_with("//")
}

/// Path below the root that a file's link leads to.
fn resolve(from: &str, path: &str) -> Option<String> {
    let folder = from.rsplit_once('/').map_or("", |(folder, _)| folder);
    let whole = path.strip_prefix('/').map_or_else(|| format!("{folder}/{path}"), str::to_owned);
    let mut parts = Vec::new();
    for part in whole.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}

/// Decodes `%20` and the like.
fn unescape(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut decoded = Vec::new();
    let mut at = 0;
    while let Some(&byte) = bytes.get(at) {
        let hex = text.get(at + 1..at + 3).filter(|_| byte == b'%');
        let value = hex.and_then(|hex| u8::from_str_radix(hex, 16).ok());
        decoded.push(value.unwrap_or(byte));
        at += if value.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&decoded).into_owned()
}

/// Lines outside of fenced code, with their numbers.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fence: Option<&str> = None;
    text.lines().enumerate().filter_map(move |(at, line)| {
        let trimmed = line.trim_start();
        let first = trimmed.chars().next().filter(|c| "`~".contains(*c)).unwrap_or(' ');
        let marks = &trimmed[..trimmed.len() - trimmed.trim_start_matches(first).len()];
        match fence {
            Some(open) if marks.starts_with(open) && trimmed.trim_end() == marks => fence = None,
            Some(_) => {}
            // Code may stand in a line of its own between more than two backticks.
            None if marks.len() > 2 && first != ' ' && !trimmed[marks.len()..].contains('`') => fence = Some(marks),
            None => return Some((at + 1, line)),
        }
        None
    })
}

/// Splits a line into text and code between backticks, which is true.
fn spans(line: &str) -> Vec<(bool, &str)> {
    let mut spans = Vec::new();
    let mut rest = line;
    while let Some(at) = rest.find('`') {
        let opened = rest[at..].trim_start_matches('`');
        let marks = &rest[at..rest.len() - opened.len()];
        spans.push((false, &rest[..at]));
        // As many backticks end it, no more and no fewer.
        let mut from = 0;
        let end = loop {
            let Some(found) = opened[from..].find(marks).map(|found| from + found) else { break None };
            let run = opened[found..].len() - opened[found..].trim_start_matches('`').len();
            if run == marks.len() {
                break Some(found);
            }
            from = found + run;
        };
        let code = end.unwrap_or(0);
        spans.push(if end.is_some() { (true, &opened[..code]) } else { (false, marks) });
        rest = &opened[if end.is_some() { code + marks.len() } else { 0 }..];
    }
    spans.push((false, rest));
    spans
}

/// Links and images, `[text](target)`, definitions, `[name]: target`, and the attributes `href` and `src`.
fn links(text: &str) -> Vec<Link> {
    let mut found = Vec::new();
    for (number, line) in prose(text) {
        // A code span may be a link's text, so a link may end in the next span: spans become one line without their code.
        let line: String = spans(line).into_iter().filter(|(is_code, _)| !is_code).map(|(_, text)| text).collect();
        for (at, _) in line.match_indices("](") {
            found.extend(destination(&line[at + 2..]).map(|target| (number, target)));
        }
        let definition = line.trim_start().strip_prefix('[').and_then(|rest| rest.split_once("]:"));
        if let Some((_, rest)) = definition.filter(|(name, _)| !name.contains([']', '^'])) {
            found.extend(rest.split_whitespace().next().map(|word| (number, word.trim_matches(['<', '>']).to_owned())));
        }
        for attribute in ["href=\"", "src=\""] {
            let after = line.match_indices(attribute).map(|(at, _)| &line[at + attribute.len()..]);
            found.extend(after.filter_map(|rest| Some((number, rest.split_once('"')?.0.to_owned()))));
        }
    }
    found
}

/// Reads `target)`, `<target>)` or `target "title")`.
fn destination(rest: &str) -> Option<String> {
    if let Some(rest) = rest.strip_prefix('<') {
        return Some(rest.split_once('>')?.0.to_owned());
    }
    let mut open = 0;
    let end = rest.find(|c: char| {
        open += i32::from(c == '(') - i32::from(c == ')');
        c.is_whitespace() || open < 0
    });
    Some(rest[..end?].to_owned())
}

/// Anchors of a text's headings: letters, digits, `_` and `-` in lower case, with `-` for a space. A second heading of the
/// same words gets `-1`.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    for (_, line) in prose(text) {
        let heading = line.trim_start_matches('#');
        let level = line.len() - heading.len();
        if !(1..=6).contains(&level) || !heading.starts_with([' ', '\t']) {
            continue;
        }
        let heading = heading.trim().trim_end_matches('#').trim_end();
        let words: String = spans(heading).into_iter().map(|(is_code, text)| plain(is_code, text)).collect();
        let anchor: String = words.trim().chars().filter_map(in_anchor).flat_map(char::to_lowercase).collect();
        let mut candidates = (0..).map(|i| if i == 0 { anchor.clone() } else { format!("{anchor}-{i}") });
        anchors.extend(candidates.find(|candidate| !anchors.contains(candidate)));
    }
    anchors
}

fn in_anchor(c: char) -> Option<char> {
    match c {
        ' ' => Some('-'),
        '-' | '_' => Some(c),
        c => c.is_alphanumeric().then_some(c),
    }
}

/// Text of a part of a heading without the targets of its links.
fn plain(is_code: bool, text: &str) -> String {
    let mut parts = text.split("](");
    let first = parts.next().unwrap_or("").to_owned();
    if is_code {
        return text.to_owned();
    }
    parts.fold(first, |plain, part| plain + part.split_once(')').map_or("", |(_, after)| after))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Broken links of a repository with these files, in whose folder `ignored.md` is as well.
    fn broken(files: &[(&str, &str)]) -> Vec<String> {
        let folder = tempfile::tempdir().expect("folders can be made");
        for (file, text) in [("ignored.md", "[a](nowhere)")].iter().chain(files) {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().expect("it is below the root")).expect("folders can be made");
            fs::write(path, text).expect("files can be written");
        }
        let files = files.iter().map(|(file, _)| (*file).to_owned()).collect();
        broken_links(folder.path(), &files).expect("the files can be read")
    }

    const DOCS: [(&str, &str); 3] = [
        (
            "docs/guide.md",
            "# The `--guide`: a *first* [look](x.md), it's 2_3\n## Twice\n## Twice ##\n```\n# code\n```\n",
        ),
        ("docs/x.md", "x"),
        ("src/a b.rs", "1\n2\n"),
    ];

    #[test]
    fn links_that_lead_somewhere_pass() {
        for link in [
            "[a](docs)",
            "[a](docs/)",
            "[a](.)",
            "[a](/docs/x.md)",
            "[a](docs/../docs/./x.md)",
            "[a](docs/x.md \"title\")",
            "![a](<src/a b.rs>)",
            "[a](src/a%20b.rs#L2)",
            "[`code`](docs/x.md)",
            "[![a](docs/x.md)](docs/guide.md)",
            "[a](docs/guide.md#the---guide-a-first-look-its-2_3)",
            "[a](docs/guide.md#twice), [a](docs/guide.md#twice-1)",
            "[a](#own)\n# Own",
            "[a]: docs/x.md",
            "<img src=\"docs/x.md\"> <a href=\"#own\">\n# Own",
            "[a](https://example.org/nowhere#x), <https://example.org>, [a](mailto:a@example.org), [a](//example.org)",
            "`[a](nowhere)`, ``[a](nowhere) ` [a](nowhere)``",
            "```sh\n[a](nowhere)\n```",
            "~~~\n```\n[a](nowhere)\n~~~",
            "a[1] (see below), x[i](j",
        ] {
            assert_eq!(broken(&[&DOCS[..], &[("README.md", link)]].concat()), [""; 0], "{link}");
        }
    }

    #[test]
    fn links_that_lead_nowhere_are_listed() {
        for (link, line, reason) in [
            ("[a](nowhere.md)", 1, "nowhere.md: the repository has no nowhere.md"),
            ("\n\ntext [a](docs/x.md), [b](docs/X.md)", 3, "docs/X.md: the repository has no docs/X.md"),
            ("[a](doc)", 1, "doc: the repository has no doc"),
            ("[a](ignored.md)", 1, "ignored.md: the repository has no ignored.md"),
            ("[a](docs/../../x.md)", 1, "docs/../../x.md: it leads out of the repository"),
            ("[a](docs/guide.md#first)", 1, "docs/guide.md#first: docs/guide.md has no heading for #first"),
            ("[a](docs/guide.md#twice-2)", 1, "docs/guide.md#twice-2: docs/guide.md has no heading for #twice-2"),
            ("[a](docs/guide.md#code)", 1, "docs/guide.md#code: docs/guide.md has no heading for #code"),
            ("[a](#Own)\n# Own", 1, "#Own: README.md has no heading for #Own"),
            ("[a](src/a%20b.rs#L3)", 1, "src/a%20b.rs#L3: src/a b.rs has no line 3"),
            ("[a](src/a%20b.rs#first)", 1, "src/a%20b.rs#first: it has an anchor, and no headings"),
            ("[a](docs#guide)", 1, "docs#guide: it has an anchor, and no headings"),
            ("[`code`](nowhere)", 1, "nowhere: the repository has no nowhere"),
            ("[![a](docs/x.md)](nowhere)", 1, "nowhere: the repository has no nowhere"),
            ("![a](<no where>)", 1, "no where: the repository has no no where"),
            ("[a]: nowhere", 1, "nowhere: the repository has no nowhere"),
            ("<img src=\"nowhere\">", 1, "nowhere: the repository has no nowhere"),
            ("``` not a fence ```\n[a](nowhere)", 2, "nowhere: the repository has no nowhere"),
            ("```\n```\n[a](nowhere)", 3, "nowhere: the repository has no nowhere"),
            ("one ` backtick, [a](nowhere)", 1, "nowhere: the repository has no nowhere"),
        ] {
            let found = broken(&[&DOCS[..], &[("README.md", link)]].concat());
            assert_eq!(found, [format!("README.md:{line}: {reason}")], "{link}");
        }
    }

    #[test]
    fn a_repository_without_documents_is_refused() {
        assert!(broken_links(Path::new("."), &BTreeSet::new()).is_err());
    }
}
