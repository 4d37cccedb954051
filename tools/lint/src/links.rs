//! Links of Markdown files: to files, folders, headings and lines of the repository. Links to other sites are not followed.

use std::collections::BTreeSet;
use std::fs;

use pulldown_cmark::{Event, Options, Parser, Tag, TagEnd};

use crate::Repository;

/// Lists the broken links of all documents, a line each.
pub fn broken(repository: &Repository) -> Vec<String> {
    let mut broken = Vec::new();
    for (file, text) in &repository.documents {
        for (at, target) in links(text) {
            if let Err(reason) = check(repository, file, &target) {
                let line = 1 + text[..at].matches('\n').count();
                broken.push(format!("{file}:{line}: {target}: {reason}"));
            }
        }
    }
    broken
}

fn check(repository: &Repository, from: &str, target: &str) -> Result<(), String> {
    if is_elsewhere(target) {
        return Ok(());
    }
    let (path, anchor) = target.split_once('#').map_or((target, None), |(path, anchor)| (path, Some(anchor)));
    let path = match path {
        "" => from.to_owned(),
        path => resolve(from, &unescape(path)).ok_or("it leads out of the repository")?,
    };
    let is_file = repository.files.contains(&path);
    let is_folder = path.is_empty() || repository.files.iter().any(|file| file.starts_with(&format!("{path}/")));
    if !is_file && !is_folder {
        return Err(format!("the repository has no {path}"));
    }
    let Some(anchor) = anchor else { return Ok(()) };
    if let Some(text) = repository.documents.get(&path) {
        let anchor = unescape(anchor);
        return if anchors(text).contains(&anchor) {
            Ok(())
        } else {
            Err(format!("{path} has no heading for #{anchor}"))
        };
    }
    let number = anchor.strip_prefix('L').and_then(|number| number.parse::<usize>().ok());
    let number = number.filter(|_| is_file).ok_or("it has an anchor, and no headings")?;
    let text = fs::read_to_string(repository.root.join(&path)).map_err(|error| error.to_string())?;
    if (1..=text.lines().count()).contains(&number) { Ok(()) } else { Err(format!("{path} has no line {number}")) }
}

/// Whether a target begins with a scheme, as `https:`, or names another host.
fn is_elsewhere(target: &str) -> bool {
    let scheme = target.split_once(':').map_or("", |(scheme, _)| scheme);
    let is_scheme = scheme.len() > 1 && scheme.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    is_scheme || target.starts_with("//")
}

/// Returns the path below the root that a file's link leads to.
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

fn parse(text: &str) -> Parser<'_> {
    Parser::new_ext(text, Options::ENABLE_TABLES | Options::ENABLE_STRIKETHROUGH)
}

/// Targets of links and images, and of the attributes `href` and `src`, with the byte that each begins at. Definitions
/// that no link uses count as well.
fn links(text: &str) -> Vec<(usize, String)> {
    let parser = parse(text);
    let definitions = parser.reference_definitions().iter();
    let mut found: Vec<_> = definitions.map(|(_, link)| (link.span.start, link.dest.to_string())).collect();
    for (event, range) in parser.into_offset_iter() {
        match event {
            Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                found.push((range.start, dest_url.into_string()));
            }
            Event::Html(html) | Event::InlineHtml(html) => {
                for attribute in ["href=\"", "src=\""] {
                    for (at, _) in html.match_indices(attribute) {
                        let target = html[at + attribute.len()..].split_once('"').map(|(target, _)| target.to_owned());
                        found.extend(target.map(|target| (range.start + at, target)));
                    }
                }
            }
            _ => {}
        }
    }
    found.sort();
    found
}

/// Anchors of a text's headings as GitHub makes them: letters, digits, `_` and `-` in lower case, with `-` for a space. A
/// second heading of the same words gets `-1`.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut anchors = BTreeSet::new();
    let mut heading: Option<String> = None;
    for event in parse(text) {
        match event {
            Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
            Event::Text(text) | Event::Code(text) => {
                if let Some(heading) = &mut heading {
                    *heading += &text;
                }
            }
            Event::End(TagEnd::Heading(_)) => {
                let words = heading.take().unwrap_or_default();
                let anchor: String = words.trim().chars().filter_map(in_anchor).flat_map(char::to_lowercase).collect();
                let mut candidates = (0..).map(|i| if i == 0 { anchor.clone() } else { format!("{anchor}-{i}") });
                anchors.extend(candidates.find(|candidate| !anchors.contains(candidate)));
            }
            _ => {}
        }
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

#[cfg(test)]
mod tests {
    use std::path::Path;

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
        super::broken(&Repository::read(folder.path(), files).expect("the files can be read"))
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
        assert!(Repository::read(Path::new("."), BTreeSet::new()).is_err());
    }
}
