//! Errors and warnings of reading a glTF file.

use std::collections::HashMap;

pub use crate::scene::error::Fault;

pub type Outcome<T> = Result<T, Fault>;

/// Prefixes an error with its location in the file, such as `mesh 3 'Chair'`.
pub trait Within {
    fn within(self, place: impl FnOnce() -> String) -> Self;
}

impl<T> Within for Outcome<T> {
    fn within(self, place: impl FnOnce() -> String) -> Self {
        self.map_err(|fault| match fault {
            Fault::Invalid(what) => Fault::Invalid(format!("{}: {what}", place())),
            Fault::Refused { place: inner, refusal } => {
                Fault::Refused { place: format!("{}: {inner}", place()), refusal }
            }
            other => other,
        })
    }
}

/// Returns kind, index and name of an object, such as `mesh 3 'Chair'`, or `mesh 3` if `name` is absent or empty.
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

/// Warnings without duplicates. Each has the first location to which it applies and counts all locations.
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

    /// Returns `None` for a part with a fault, and adds the warning `text`, unless `strict`. Requests that are not allowed
    /// or exceed the budget stay errors.
    pub fn tolerate<T>(&mut self, part: Outcome<T>, text: &str, place: &str, strict: bool) -> Outcome<Option<T>> {
        let what = match part {
            Err(Fault::Invalid(what)) if !strict => what,
            Err(Fault::Read { path, source }) if !strict => format!("cannot read '{path}': {source}"),
            part => return part.map(Some).within(|| place.to_owned()),
        };
        self.note(text, &format!("{place}: {what}"));
        Ok(None)
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
