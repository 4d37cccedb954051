//! Errors and warnings of reading a glTF file.

use std::collections::HashMap;
use std::path::Path;

use crate::scene::SceneError;
use crate::scene::budget::Exceeded;
use crate::scene::folder::AccessError;

/// A [`SceneError`] without the file's name.
#[derive(Debug)]
pub enum Fault {
    Invalid(String),
    /// Access denied, or over the budget.
    Refused(String),
    Read {
        path: String,
        source: std::io::Error,
    },
    Extensions {
        extensions: Vec<String>,
        hint: String,
    },
}

pub type Outcome<T> = Result<T, Fault>;

impl Fault {
    pub fn in_file(self, path: &Path) -> SceneError {
        let file = path.display().to_string();
        match self {
            Fault::Invalid(what) => SceneError::Invalid { path: file, what },
            Fault::Refused(what) => SceneError::Refused { path: file, what },
            Fault::Read { path, source } => SceneError::Read { path, source },
            Fault::Extensions { extensions, hint } => SceneError::Extensions { path: file, extensions, hint },
        }
    }
}

impl From<String> for Fault {
    fn from(what: String) -> Self {
        Fault::Invalid(what)
    }
}

impl From<AccessError> for Fault {
    fn from(error: AccessError) -> Self {
        match error {
            AccessError::Read { path, source } => Fault::Read { path: path.display().to_string(), source },
            AccessError::Refused(what) => Fault::Refused(what),
        }
    }
}

impl From<Exceeded> for Fault {
    fn from(error: Exceeded) -> Self {
        Fault::Refused(error.to_string())
    }
}

/// Adds the location of an error in the file.
pub trait Within {
    fn within(self, place: impl FnOnce() -> String) -> Self;
}

impl<T> Within for Outcome<T> {
    fn within(self, place: impl FnOnce() -> String) -> Self {
        self.map_err(|fault| match fault {
            Fault::Invalid(what) => Fault::Invalid(format!("{}: {what}", place())),
            Fault::Refused(what) => Fault::Refused(format!("{}: {what}", place())),
            other => other,
        })
    }
}

/// Returns `mesh 3 'Chair'`, or `mesh 3` if it has no name.
pub fn label(kind: &str, index: usize, name: &Option<String>) -> String {
    match name.as_deref() {
        Some(name) if !name.is_empty() => format!("{kind} {index} '{name}'"),
        _ => format!("{kind} {index}"),
    }
}

/// Returns `list[index]`, or an error that names the list.
pub fn lookup<'a, T>(list: &'a [T], kind: &str, index: usize) -> Outcome<&'a T> {
    list.get(index)
        .ok_or_else(|| Fault::Invalid(format!("it refers to {kind} {index}, but the file has {} of them", list.len())))
}

/// Warnings without duplicates: each has the first place it applies to and the number of further places.
#[derive(Debug, Default)]
pub struct Warnings {
    entries: Vec<Entry>,
    by_text: HashMap<String, usize>,
}

#[derive(Debug)]
struct Entry {
    text: String,
    first_place: String,
    count: usize,
}

impl Warnings {
    /// Adds a warning. `place` is empty if `text` is about the whole file.
    pub fn note(&mut self, text: &str, place: &str) {
        if let Some(&at) = self.by_text.get(text) {
            self.entries[at].count += 1;
            return;
        }
        self.by_text.insert(text.to_owned(), self.entries.len());
        self.entries.push(Entry { text: text.to_owned(), first_place: place.to_owned(), count: 1 });
    }

    pub fn into_texts(self) -> Vec<String> {
        self.entries
            .into_iter()
            .map(|Entry { text, first_place, count }| match (first_place.is_empty(), count) {
                (true, _) => text,
                (false, 1) => format!("{text} ({first_place})"),
                (false, n) => format!("{text} ({first_place} and {} more)", n - 1),
            })
            .collect()
    }
}
