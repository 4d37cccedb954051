//! Files use one another in one direction only, so that each can be read after those that it uses. A `mod.rs` that
//! exports names of its children does not use them thereby. Tests are left out.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::str::FromStr;

use petgraph::Graph;
use petgraph::algo::tarjan_scc;
use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The names of a path, without `::`.
type Names = Vec<String>;

/// A file of sources: paths that it exports, and others that it names.
#[derive(Default)]
struct Source {
    exports: Vec<Names>,
    uses: Vec<Names>,
}

fn is(token: Option<&TokenTree>, text: &str) -> bool {
    token.is_some_and(|token| !matches!(token, TokenTree::Group(_)) && token.to_string() == text)
}

/// Returns the paths of a tree such as `a::{b, c::d as e}`, each after `prefix`.
fn tree(prefix: &[String], tokens: &[TokenTree]) -> Vec<Names> {
    let mut paths = Vec::new();
    for branch in tokens.split(|token| is(Some(token), ",")).filter(|branch| !branch.is_empty()) {
        let mut path = prefix.to_vec();
        let renamed = branch.iter().position(|token| is(Some(token), "as")).unwrap_or(branch.len());
        for token in &branch[..renamed] {
            match token {
                TokenTree::Ident(name) => path.push(name.to_string()),
                TokenTree::Group(group) => {
                    paths.extend(tree(&path, &group.stream().into_iter().collect::<Vec<_>>()));
                    path.clear();
                    break;
                }
                _ => {}
            }
        }
        if path.last().is_some_and(|name| name == "self") {
            path.pop();
        }
        paths.extend((!path.is_empty()).then_some(path));
    }
    paths
}

/// Adds the paths that tokens name.
fn collect(tokens: TokenStream, source: &mut Source) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut at = 0;
    while at < tokens.len() {
        // A type may capture lifetimes by `use<'a>`.
        if is(tokens.get(at), "use") && !is(tokens.get(at + 1), "<") {
            let end = at + tokens[at..].iter().position(|token| is(Some(token), ";")).expect("imports end");
            let paths = tree(&[], &tokens[at + 1..end]);
            let is_scope =
                |token: &TokenTree| matches!(token, TokenTree::Group(g) if g.delimiter() == Delimiter::Parenthesis);
            let before = at - usize::from(at > 0 && is_scope(&tokens[at - 1]));
            let is_export = before > 0 && is(tokens.get(before - 1), "pub");
            if is_export {
                source.exports.extend(paths)
            } else {
                source.uses.extend(paths)
            }
            at = end + 1;
            continue;
        }
        let is_tests = at > 0 && is(tokens.get(at - 1), "mod") && tokens[at].to_string().starts_with("tests");
        if is_tests && matches!(tokens.get(at + 1), Some(TokenTree::Group(_))) {
            at += 2;
            continue;
        }
        let is_root = is(tokens.get(at), "crate") || is(tokens.get(at), "super");
        if is_root && !(at > 0 && is(tokens.get(at - 1), ":")) {
            let separated = |at: usize| is(tokens.get(at), ":") && is(tokens.get(at + 1), ":");
            let mut path = vec![tokens[at].to_string()];
            while separated(at + 1) {
                let Some(TokenTree::Ident(name)) = tokens.get(at + 3) else { break };
                path.push(name.to_string());
                at += 3;
            }
            // A word by itself is a visibility.
            source.uses.extend((path.len() > 1).then_some(path));
        } else if let TokenTree::Group(group) = &tokens[at] {
            collect(group.stream(), source);
        }
        at += 1;
    }
}

struct Sources(BTreeMap<Names, Source>);

impl Sources {
    fn read(folder: &Path, module: &[String], sources: &mut BTreeMap<Names, Source>) {
        for entry in fs::read_dir(folder).expect("folders of sources can be read") {
            let path = entry.expect("folders of sources can be read").path();
            let stem = path.file_stem().expect("files have names").to_string_lossy().into_owned();
            let mut inner = module.to_vec();
            if !["mod", "lib", "main"].contains(&stem.as_str()) {
                inner.push(stem.clone());
            }
            if stem.contains("test") || stem == "main" {
                continue;
            }
            if path.is_dir() {
                Self::read(&path, &inner, sources);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).expect("sources can be read");
                let mut source = Source::default();
                collect(TokenStream::from_str(&text).expect("sources are Rust"), &mut source);
                if !["mod", "lib"].contains(&stem.as_str()) {
                    source.uses.extend(source.exports.iter().cloned());
                }
                sources.insert(inner, source);
            }
        }
    }

    /// Returns the path from the root of the crate, or `None` for a name of another crate.
    fn absolute(&self, module: &[String], path: &[String]) -> Option<Names> {
        let supers = path.iter().take_while(|name| *name == "super").count();
        let base = match path[0].as_str() {
            "crate" => return Some(path[1..].to_vec()),
            "super" => &module[..module.len().saturating_sub(supers)],
            "self" => return Some([module, &path[1..]].concat()),
            child => {
                return self.0.contains_key(&[module, &[child.to_owned()]].concat()).then(|| [module, path].concat());
            }
        };
        Some([base, &path[supers..]].concat())
    }

    /// Returns the file that defines the name at the end of a path, through up to six exports.
    fn definition(&self, path: &[String], exports: usize) -> Names {
        let length =
            (0..=path.len()).rev().find(|&length| self.0.contains_key(&path[..length])).expect("the root is there");
        let module = &path[..length];
        if let Some(name) = path.get(length).filter(|_| exports < 6) {
            let exported = self.0[module].exports.iter().filter_map(|export| self.absolute(module, export));
            if let Some(export) = exported.into_iter().find(|export| export.last() == Some(name)) {
                return self.definition(&export, exports + 1);
            }
        }
        module.to_vec()
    }

    /// Lists the circles, each with its files and those of the circle that they use.
    fn circles(&self) -> Vec<String> {
        let modules: Vec<&Names> = self.0.keys().collect();
        let place = |module: &Names| modules.binary_search(&module).expect("definitions are in files") as u32;
        let mut edges = Vec::new();
        for (module, source) in &self.0 {
            let used = source.uses.iter().filter_map(|path| self.absolute(module, path));
            let definitions = used.map(|path| self.definition(&path, 0)).filter(|definition| definition != module);
            edges.extend(definitions.map(|definition| (place(module), place(&definition))));
        }
        let graph = Graph::<(), ()>::from_edges(edges);
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
}

fn sources(files: &[(&str, &str)]) -> Sources {
    let folder = tempfile::tempdir().expect("folders can be made");
    for (file, text) in files {
        let path = folder.path().join(file);
        fs::create_dir_all(path.parent().expect("it is in the folder")).expect("folders can be made");
        fs::write(path, text).expect("files can be written");
    }
    let mut sources = BTreeMap::new();
    Sources::read(folder.path(), &[], &mut sources);
    Sources(sources)
}

#[test]
fn files_form_no_import_cycle() {
    for (folder, least) in [("src", 200), ("cli/src", 100)] {
        let mut sources = BTreeMap::new();
        Sources::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &[], &mut sources);
        assert!(sources.len() > least, "{folder}: {}", sources.len());
        let circles = Sources(sources).circles();
        assert!(circles.is_empty(), "{circles:#?}");
    }
}

#[test]
fn cycles_are_found_through_exports_and_inline_paths() {
    let root = ("lib.rs", "pub mod a; pub mod b;");
    let straight = ("a/mod.rs", "mod one; mod two; pub use one::One; pub(crate) use two::Two;");
    let two = ("a/two.rs", "use super::One; pub(crate) struct Two(One); mod tests { use crate::b::B; }");
    let uses = ("b.rs", "use crate::a::{self, Two as T}; pub struct B(T);");
    let files = |one| [root, straight, two, uses, ("a/one.rs", one)];
    assert_eq!(sources(&files("/// [`super::Two`]\npub struct One;")).circles(), [""; 0]);
    for one in [
        "use super::Two; pub struct One;",
        "use super::{two::{Two, self}}; pub struct One;",
        "pub struct One; fn f() -> crate::a::Two { todo() }",
        "pub struct One; fn f() { g(|| super::two::h()) }",
        "pub use crate::b::B; pub struct One;",
    ] {
        let circles = sources(&files(one)).circles();
        assert_eq!(circles.len(), 1, "{one}: {circles:?}");
        assert!(circles[0].contains("a::one uses"), "{circles:?}");
    }
}
