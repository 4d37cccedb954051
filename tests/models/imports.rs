//! The library's modules depend on one another in one direction only: a module may name the modules above it in
//! `src/lib.rs`. This includes the code of tests, because a test that needs a lower module belongs beside that module.
//! It excludes comments, so that documentation may refer to lower modules.

use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// Modules with decision logic, which are tested without a device.
const WITHOUT_WGPU: [&str; 17] = [
    "image",
    "scene",
    "quality",
    "wgsl",
    "projection",
    "samples",
    "accel",
    "graph",
    "passes",
    "schedule",
    "control",
    "plan",
    "layout",
    "frame",
    "metrics",
    "accumulation",
    "trace",
];

fn source_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

fn tokens_of(file: &Path) -> TokenStream {
    let text = fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    TokenStream::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

fn is(token: Option<&TokenTree>, name: &str) -> bool {
    matches!(token, Some(TokenTree::Ident(ident)) if ident == name)
}

/// Returns true if the two tokens from `at` on are `::`.
fn is_separator(tokens: &[TokenTree], at: usize) -> bool {
    let is_colon = |token: &TokenTree| matches!(token, TokenTree::Punct(punct) if punct.as_char() == ':');
    tokens.get(at..at + 2).is_some_and(|pair| pair.iter().all(is_colon))
}

/// Returns the modules in the order of `src/lib.rs`.
fn modules() -> Vec<String> {
    let tokens: Vec<_> = tokens_of(&source_folder().join("lib.rs")).into_iter().collect();
    let is_file = |at: &[TokenTree]| is(at.first(), "mod") && matches!(&at[2], TokenTree::Punct(_));
    let names = tokens.windows(3).filter(|at| is_file(at)).map(|at| at[1].to_string());
    names.collect()
}

/// Returns all source files of a module, each with its depth in modules below the crate's root.
fn files(module: &str) -> Vec<(PathBuf, usize)> {
    fn collect(path: &Path, depth: usize, found: &mut Vec<(PathBuf, usize)>) {
        if path.is_dir() {
            for entry in fs::read_dir(path).expect("folders of sources can be read") {
                let path = entry.expect("folders of sources can be read").path();
                let is_root = path.file_name().is_some_and(|name| name == "mod.rs");
                collect(&path, if is_root { depth } else { depth + 1 }, found);
            }
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push((path.to_owned(), depth));
        }
    }
    let mut found = Vec::new();
    collect(&source_folder().join(module), 1, &mut found);
    let file = source_folder().join(format!("{module}.rs"));
    if file.is_file() {
        found.push((file, 1));
    }
    found
}

/// Adds the names at the root of the crate to which paths lead: in `crate::name`, in `crate::{name, name}`, and in
/// `super::name` from the top module of a file.
fn add_named(tokens: TokenStream, depth: usize, named: &mut Vec<String>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for (at, token) in tokens.iter().enumerate() {
        if let TokenTree::Group(group) = token {
            let is_module = group.delimiter() == Delimiter::Brace && at > 1 && is(tokens.get(at - 2), "mod");
            add_named(group.stream(), depth + usize::from(is_module), named);
        }
        let is_first = at < 2 || !is_separator(&tokens, at - 2);
        let supers = (0..).take_while(|i| is(tokens.get(at + 3 * i), "super")).count();
        let next = match is_first {
            true if is(Some(token), "crate") => at + 1,
            true if supers > 0 && supers >= depth => at + 3 * supers - 2,
            _ => continue,
        };
        if !is_separator(&tokens, next) {
            continue;
        }
        match tokens.get(next + 2) {
            Some(TokenTree::Ident(name)) => named.push(name.to_string()),
            Some(TokenTree::Group(group)) => {
                let listed: Vec<TokenTree> = group.stream().into_iter().collect();
                let is_comma = |token: &TokenTree| matches!(token, TokenTree::Punct(p) if p.as_char() == ',');
                let first = listed.split(is_comma).filter_map(|path| path.first());
                named.extend(first.map(ToString::to_string));
            }
            _ => {}
        }
    }
}

fn named(tokens: TokenStream, depth: usize) -> Vec<String> {
    let mut named = Vec::new();
    add_named(tokens, depth, &mut named);
    named
}

#[test]
fn modules_use_only_those_above_them() {
    let modules = modules();
    assert!(modules.len() > 10, "{modules:?}");
    let mut wrong = Vec::new();
    for (place, module) in modules.iter().enumerate() {
        let files = files(module);
        assert!(!files.is_empty(), "{module} has no file");
        for (file, depth) in files {
            let below = named(tokens_of(&file), depth).into_iter().filter(|name| modules[place + 1..].contains(name));
            wrong.extend(below.map(|name| format!("{} uses {name}", file.display())));
        }
    }
    assert!(wrong.is_empty(), "src/lib.rs has these modules further down: {wrong:#?}");
}

#[test]
fn modules_without_devices_do_not_use_wgpu() {
    fn knows_wgpu(tokens: TokenStream) -> bool {
        tokens.into_iter().any(|token| match token {
            TokenTree::Group(group) => knows_wgpu(group.stream()),
            other => is(Some(&other), "wgpu"),
        })
    }
    for module in WITHOUT_WGPU {
        for (file, _) in files(module) {
            assert!(!knows_wgpu(tokens_of(&file)), "{} uses wgpu", file.display());
        }
    }
}

/// Only the program knows its threads, and others may read the environment at any time. So the program changes the
/// environment itself, or installs the hook for the library. `cli::prepare_environment` belongs to the program.
#[test]
fn library_does_not_change_the_environment() {
    fn changes(tokens: TokenStream) -> bool {
        tokens.into_iter().any(|token| match token {
            TokenTree::Group(group) => changes(group.stream()),
            other => ["set_var", "remove_var"].iter().any(|name| is(Some(&other), name)),
        })
    }
    assert!(changes(
        TokenStream::from_str("fn f() { unsafe { std::env::set_var(name, value) } }").expect("it is Rust")
    ));
    let wrong: Vec<PathBuf> = modules()
        .iter()
        .flat_map(|module| files(module))
        .map(|(file, _)| file)
        .filter(|file| !file.ends_with("cli/environment.rs") && changes(tokens_of(file)))
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_kind_of_import_path_is_found() {
    let text = "
        use crate::one::Thing;
        use crate::{two::{Other, self}, three};
        /// [`crate::comment`]
        fn inline(x: crate::four::Thing) -> super::five::Thing { crate::six::run(x) }
        mod tests { use super::own; use super::super::seven; use super::super::super::outside; }
        pub(crate) struct Visible { text: &'static str }
        const TEXT: &str = \"crate::text\";
    ";
    let tokens = TokenStream::from_str(text).expect("the text is Rust");
    let expected = ["one", "two", "three", "four", "five", "six", "seven", "outside"];
    assert_eq!(named(tokens, 1), expected);
}

/// A guide that names tests that do not exist would be misleading.
#[test]
fn tests_named_in_architecture_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let guide = fs::read_to_string(root.join("ARCHITECTURE.md")).expect("ARCHITECTURE.md can be read");
    let (_, invariants) = guide.split_once("## Invariants").expect("it has invariants");
    let words = invariants.split('`').skip(1).step_by(2);
    let is_name =
        |word: &&str| word.matches('_').count() > 2 && word.chars().all(|c| c == '_' || c.is_ascii_lowercase());
    let names: Vec<&str> = words.filter(is_name).collect();
    assert!(names.len() > 20, "{names:?}");
    let mut sources = String::new();
    let mut folders = vec![root.join("src"), root.join("tests"), root.join("cli")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).expect("folders of sources can be read") {
            let path = entry.expect("folders of sources can be read").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                sources += &fs::read_to_string(&path).expect("sources can be read");
            }
        }
    }
    for name in names {
        assert!(sources.contains(&format!("fn {name}(")), "there is no test {name}");
    }
}
