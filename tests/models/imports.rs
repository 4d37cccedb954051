//! Imports go in one direction: a module of the library uses only those above it in `src/lib.rs`, and no files use one
//! another in a circle. A `mod.rs` that exports names of its children does not use them thereby. Comments do not count.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use petgraph::Graph;
use petgraph::algo::tarjan_scc;
use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The names of a path, without `::`.
type Names = Vec<String>;

/// A file of sources: its words without literals, and absolute paths that it exports, uses, and uses in tests.
#[derive(Default)]
struct Source {
    words: Names,
    exports: Vec<Names>,
    uses: Vec<Names>,
    tests: Vec<Names>,
}

fn flatten(tokens: TokenStream, words: &mut Names) {
    for token in tokens {
        match token {
            TokenTree::Group(group) => {
                let [open, close] = match group.delimiter() {
                    Delimiter::Brace => ["{", "}"],
                    _ => ["(", ")"],
                };
                words.push(open.to_owned());
                flatten(group.stream(), words);
                words.push(close.to_owned());
            }
            TokenTree::Literal(_) => {}
            word => words.push(word.to_string()),
        }
    }
}

fn is_separated(words: &[String], at: usize) -> bool {
    words.get(at..at + 2).is_some_and(|pair| pair == [":", ":"])
}

/// Adds the paths of a tree such as `a::{b, c::d as e}`; returns where it ends.
fn tree(words: &[String], mut at: usize, mut path: Names, paths: &mut Vec<Names>) -> usize {
    loop {
        if words[at] == "{" {
            at += 1;
            while words[at] != "}" {
                at = tree(words, at, path.clone(), paths);
                at += usize::from(words[at] == ",");
            }
            return at + 1;
        }
        path.push(words[at].clone());
        at += 1;
        if !is_separated(words, at) {
            break;
        }
        at += 2;
    }
    path.pop_if(|name| name == "self");
    paths.extend((!path.is_empty()).then_some(path));
    if words.get(at).is_some_and(|word| word == "as") { at + 2 } else { at }
}

fn absolute(module: &[String], path: &[String]) -> Names {
    let supers = path.iter().take_while(|name| *name == "super").count();
    match path[0].as_str() {
        "crate" => path[1..].to_vec(),
        "self" => [module, &path[1..]].concat(),
        _ => [&module[..module.len().saturating_sub(supers)], &path[supers..]].concat(),
    }
}

impl Source {
    fn parse(text: &str, file: &[String]) -> Self {
        let mut source = Self::default();
        flatten(text.parse().expect("sources are Rust"), &mut source.words);
        let words = &source.words;
        let (mut module, mut depth, mut inline, mut at) = (file.to_vec(), 0, Vec::new(), 0);
        while at < words.len() {
            let word = words[at].as_str();
            if word == "{" {
                depth += 1;
                if at > 1 && words[at - 2] == "mod" {
                    module.push(words[at - 1].clone());
                    inline.push(depth);
                }
            } else if word == "}" {
                inline.pop_if(|opened| *opened == depth).map(|_| module.pop());
                depth -= 1;
            }
            // A type may capture lifetimes by `use<'a>`, and a word by itself is a visibility.
            let is_import = word == "use" && words[at + 1] != "<";
            let is_first = at == 0 || words[at - 1] != ":";
            let is_path = is_first && ["crate", "super", "self"].contains(&word) && is_separated(words, at + 1);
            if !is_import && !is_path {
                at += 1;
                continue;
            }
            let is_export = is_import && at > 0 && ["pub", ")"].contains(&words[at - 1].as_str());
            let is_test = module[file.len()..].iter().any(|name| name.starts_with("tests"));
            let mut paths = Vec::new();
            at = tree(words, at + usize::from(is_import), Vec::new(), &mut paths);
            let list = match (is_test, is_export) {
                (true, _) => &mut source.tests,
                (false, true) => &mut source.exports,
                (false, false) => &mut source.uses,
            };
            list.extend(paths.iter().map(|path| absolute(&module, path)));
        }
        source
    }
}

/// Sources by module.
struct Sources(BTreeMap<Names, Source>);

impl Sources {
    /// Parses files, whose paths begin in the folder of sources.
    fn new(files: impl IntoIterator<Item = (PathBuf, String)>) -> Self {
        let parse = |(path, text): (PathBuf, String)| {
            let stem = path.with_extension("");
            let mut module: Names = stem.iter().map(|name| name.to_string_lossy().into_owned()).collect();
            let is_root = module.pop_if(|name| name == "mod" || name == "lib").is_some();
            let mut source = Source::parse(&text, &module);
            if !is_root {
                source.uses.extend(source.exports.iter().cloned());
            }
            (module, source)
        };
        Self(files.into_iter().map(parse).collect())
    }

    /// Returns the file that defines the name at the end of a path, through up to six exports.
    fn definition(&self, path: &[String], exports: usize) -> Names {
        let length = (0..=path.len()).rev().find(|&length| self.0.contains_key(&path[..length]));
        let module = &path[..length.expect("the root is there")];
        let Some(name) = path.get(module.len()).filter(|_| exports < 6) else { return module.to_vec() };
        let export = self.0[module].exports.iter().find(|export| export.last() == Some(name));
        export.map_or_else(|| module.to_vec(), |export| self.definition(export, exports + 1))
    }

    /// Lists the circles of files other than tests, each with its files and those of the circle that they use.
    fn circles(&self) -> Vec<String> {
        let is_test = |module: &&Names| module.iter().any(|name| name.contains("test"));
        let modules: Vec<&Names> = self.0.keys().filter(|module| !is_test(module)).collect();
        let place = |module: &Names| modules.binary_search(&module).ok().map(|place| place as u32);
        let edges = modules.iter().flat_map(|&module| {
            let used = self.0[module].uses.iter().map(|path| self.definition(path, 0)).filter(move |to| to != module);
            used.filter_map(move |to| Some((place(module)?, place(&to)?)))
        });
        let graph = Graph::<(), ()>::from_edges(edges.collect::<Vec<_>>());
        let circles = tarjan_scc(&graph).into_iter().filter(|circle| circle.len() > 1);
        let listed = circles.map(|circle| {
            let lines = circle.iter().map(|&from| {
                let used = graph.neighbors(from).filter(|to| circle.contains(to));
                let used: BTreeSet<String> = used.map(|to| modules[to.index()].join("::")).collect();
                format!("{} uses {}", modules[from.index()].join("::"), Vec::from_iter(used).join(", "))
            });
            lines.collect::<Vec<_>>().join("; ")
        });
        listed.collect()
    }

    /// Lists the paths to modules below their own in the root.
    fn downward(&self) -> Vec<String> {
        let words = &self.0[&Vec::new()].words;
        let modules: Vec<_> = words.windows(3).filter(|at| at[0] == "mod" && at[2] == ";").map(|at| &at[1]).collect();
        let place = |path: &Names| modules.iter().position(|module| path.first() == Some(module));
        let mut wrong = Vec::new();
        for (module, source) in self.0.iter().filter(|(module, _)| place(module).is_some()) {
            let paths = [&source.uses, &source.exports, &source.tests].into_iter().flatten();
            let below = paths.filter(|path| place(path) > place(module));
            wrong.extend(below.map(|path| format!("{} uses {}", module.join("::"), path.join("::"))));
        }
        wrong
    }
}

/// Returns the Rust files below a folder of the repository, with their paths in it.
fn files(folder: &str) -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let (mut folders, mut found) = (vec![root.clone()], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("folders of sources can be read") {
            let path = entry.expect("folders of sources can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).expect("sources can be read");
                found.push((path.strip_prefix(&root).expect("it is in the folder").to_owned(), text));
            }
        }
    }
    found
}

#[test]
fn modules_use_only_those_above_them() {
    let wrong = Sources::new(files("src")).downward();
    assert!(wrong.is_empty(), "src/lib.rs has these modules further down: {wrong:#?}");
}

#[test]
fn files_form_no_import_cycle() {
    for (folder, least) in [("src", 200), ("cli/src", 100)] {
        let sources = Sources::new(files(folder).into_iter().filter(|(path, _)| !path.ends_with("main.rs")));
        assert!(sources.0.len() > least, "{folder}: {}", sources.0.len());
        let circles = sources.circles();
        assert!(circles.is_empty(), "{circles:#?}");
    }
}

fn has(source: &Source, word: &str) -> bool {
    source.words.iter().any(|other| other == word)
}

/// Decision logic is tested without a device.
#[test]
fn modules_without_devices_do_not_use_wgpu() {
    const FREE: &str = "image scene quality wgsl projection samples accel graph passes schedule control plan layout \
        frame metrics accumulation trace";
    let (users, others): (Vec<_>, Vec<_>) = Sources::new(files("src")).0.into_iter().partition(|(_, s)| has(s, "wgpu"));
    for free in FREE.split_whitespace() {
        let of = |list: &[(Names, Source)]| {
            list.iter().filter(|(module, _)| module.first().is_some_and(|m| m == free)).count()
        };
        assert!(of(&users) == 0 && of(&others) > 0, "{free} uses wgpu, or does not exist");
    }
}

/// Only the program knows its threads, and others may read the environment at any time. So the program changes the
/// environment itself, or installs the hook for the library.
#[test]
fn library_does_not_change_the_environment() {
    let changes = |source: &Source| has(source, "set_var") || has(source, "remove_var");
    assert!(changes(&Source::parse("fn f() { unsafe { std::env::set_var(name, value) } }", &[])));
    let wrong: Vec<_> = Sources::new(files("src")).0.into_iter().filter(|(_, source)| changes(source)).collect();
    assert!(wrong.is_empty(), "{:?}", wrong.iter().map(|(module, _)| module).collect::<Vec<_>>());
}

#[test]
fn imports_are_found_in_trees_exports_and_paths() {
    let root = ("lib.rs", "pub mod a; pub mod b;");
    let straight = ("a/mod.rs", "mod one; mod two; pub use one::One; pub(crate) use two::Two;");
    let two = ("a/two.rs", "use super::One; pub(crate) struct Two(One); mod tests { use super::super::super::b::B; }");
    let uses = ("b.rs", "use crate::a::{self, Two as T}; pub struct B(T); const TEXT: &str = \"crate::text\";");
    let sources = |one: &str| {
        let files = [root, straight, two, uses, ("a/one.rs", one)];
        Sources::new(files.map(|(path, text)| (path.into(), text.to_owned())))
    };
    let clean = sources("/// [`super::Two`]\npub struct One;");
    assert_eq!((clean.circles(), clean.downward()), (vec![], vec!["a::two uses b::B".to_owned()]));
    for one in [
        "use super::Two; pub struct One;",
        "use super::{two::{Two, self}}; pub struct One;",
        "pub struct One; fn f() -> crate::a::Two { todo() }",
        "pub struct One; fn f() { g(|| super::two::h()) }",
        "pub use crate::b::B; pub struct One;",
    ] {
        let circles = sources(one).circles();
        assert_eq!(circles.len(), 1, "{one}: {circles:?}");
        assert!(circles[0].contains("a::one uses"), "{circles:?}");
    }
}

/// A guide that names tests that do not exist would be misleading.
#[test]
fn tests_named_in_architecture_exist() {
    let guide = Path::new(env!("CARGO_MANIFEST_DIR")).join("ARCHITECTURE.md");
    let guide = fs::read_to_string(guide).expect("ARCHITECTURE.md can be read");
    let (_, invariants) = guide.split_once("## Invariants").expect("it has invariants");
    let is_name =
        |word: &str| word.matches('_').count() > 2 && word.chars().all(|c| c == '_' || c.is_ascii_lowercase());
    let names: Vec<&str> = invariants.split('`').skip(1).step_by(2).filter(|word| is_name(word)).collect();
    assert!(names.len() > 20, "{names:?}");
    let sources: String = ["src", "tests", "cli"].into_iter().flat_map(files).map(|(_, text)| text).collect();
    let missing: Vec<_> = names.iter().filter(|name| !sources.contains(&format!("fn {name}("))).collect();
    assert!(missing.is_empty(), "there are no tests {missing:?}");
}
