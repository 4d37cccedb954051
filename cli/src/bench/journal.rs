//! Journal of what `bench` has measured: a line for each setting that it compared with the reference, and for each
//! turn in which it timed all settings. An interrupted run resumes from it.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};

use crate::report::bench::{Measured, Timed};
use diptych::quality::Quality;

use crate::failure::Failure;

/// Name of the journal file in the folder of --out.
pub const FILE: &str = "bench.journal.jsonl";

/// The line of a setting.
#[derive(Serialize, Deserialize)]
struct Entry {
    /// Hash of everything that the measurement depends on, except the reference and the quality.
    subject: String,
    /// Key of the reference that the errors are measured against.
    reference: String,
    #[serde(rename = "knobs")]
    quality: Quality,
    measured: Measured,
}

/// The line of a turn.
#[derive(Serialize, Deserialize)]
struct Turn {
    subject: String,
    /// The frame of each setting.
    turn: Vec<(Quality, Timed)>,
}

pub struct Journal {
    path: PathBuf,
    file: File,
    subject: String,
    /// Entries of the file whose hash is `subject`.
    entries: Vec<Entry>,
    turns: Vec<Turn>,
}

impl Journal {
    /// Opens or creates the journal in `folder`; `fresh` empties it. Lines of other subjects and incomplete lines stay
    /// in the file but are ignored.
    pub fn open(folder: &Path, subject: String, fresh: bool) -> Result<Self, Failure> {
        let path = folder.join(FILE);
        let (file, text) = open(&path, fresh)
            .with_context(|| format!("cannot open the journal {}: check that you may write it", path.display()))?;
        let entries = text.lines().filter_map(|line| serde_json::from_str(line).ok());
        let entries = entries.filter(|e: &Entry| e.subject == subject).collect();
        let turns = text.lines().filter_map(|line| serde_json::from_str(line).ok());
        let turns = turns.filter(|t: &Turn| t.subject == subject).collect();
        Ok(Self { path, file, subject, entries, turns })
    }

    /// True if the journal has measurements against the reference with this key.
    pub fn knows(&self, reference: &str) -> bool {
        self.entries.iter().any(|e| e.reference == reference)
    }

    /// Returns the latest measurement of a setting against this reference.
    pub fn find(&self, reference: &str, quality: &Quality) -> Option<&Measured> {
        let found = self.entries.iter().rfind(|e| e.reference == reference && e.quality == *quality);
        found.map(|e| &e.measured)
    }

    /// Appends a measurement to the file immediately.
    pub fn add(&mut self, reference: &str, quality: &Quality, measured: &Measured) -> Result<(), Failure> {
        let (subject, reference) = (self.subject.clone(), reference.to_owned());
        let entry = Entry { subject, reference, quality: *quality, measured: measured.clone() };
        self.write(&entry)?;
        self.entries.push(entry);
        Ok(())
    }

    /// Returns the frames of a setting in all turns that timed each of these settings.
    pub fn turns<'a>(&'a self, settings: &'a [Quality], of: &'a Quality) -> impl Iterator<Item = &'a Timed> {
        let find = |turn: &'a Turn, quality: &Quality| Some(&turn.turn.iter().find(|(q, _)| q == quality)?.1);
        let whole = self.turns.iter().filter(move |turn| settings.iter().all(|s| find(turn, s).is_some()));
        whole.filter_map(move |turn| find(turn, of))
    }

    /// Appends a turn to the file immediately.
    pub fn add_turn(&mut self, turn: Vec<(Quality, Timed)>) -> Result<(), Failure> {
        let turn = Turn { subject: self.subject.clone(), turn };
        self.write(&turn)?;
        self.turns.push(turn);
        Ok(())
    }

    fn write(&mut self, line: &impl Serialize) -> Result<(), Failure> {
        let line = serde_json::to_string(line).context("cannot write a measurement as JSON")? + "\n";
        let written = self.file.write_all(line.as_bytes());
        Ok(written.with_context(|| format!("cannot write to {}", self.path.display()))?)
    }
}

/// Opens the file for appending and reads its text. Ends an incomplete last line, so that the next entry starts on a
/// new one.
fn open(path: &Path, fresh: bool) -> io::Result<(File, String)> {
    let text = match fs::read(path) {
        Ok(bytes) if !fresh => String::from_utf8_lossy(&bytes).into_owned(),
        Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(e),
        _ => String::new(),
    };
    let mut file = OpenOptions::new().create(true).append(true).open(path)?;
    if fresh {
        file.set_len(0)?;
    }
    if !text.is_empty() && !text.ends_with('\n') {
        file.write_all(b"\n")?;
    }
    Ok((file, text))
}
