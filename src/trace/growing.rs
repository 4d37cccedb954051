//! The JSON document of a trace, which is valid after every write.

use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::TraceError;
use super::event::{Event, Kind};
use crate::image::ImageError;

const HEAD: &str = "{\"traceEvents\":[";
const TAIL: &str = "\n],\"displayTimeUnit\":\"ms\",\"otherData\":";

/// Document to whose list of events more events can be appended. Each write replaces the end of the document (`TAIL`
/// and `otherData`) by the new events and a new end.
pub struct GrowingDocument {
    path: PathBuf,
    file: File,
    /// Byte offset at which the list of events ends.
    end: u64,
    is_empty: bool,
}

impl GrowingDocument {
    pub fn create(path: &Path) -> Result<Self, TraceError> {
        let failed = |source| ImageError::Write { path: path.to_owned(), source };
        // A pipe or the like cannot be overwritten in place, so it could not be kept valid.
        if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            let what = "the path exists but is not a regular file";
            return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, what)).into());
        }
        let mut file = File::create(path).map_err(failed)?;
        file.write_all(HEAD.as_bytes()).map_err(failed)?;
        Ok(Self { path: path.to_owned(), file, end: HEAD.len() as u64, is_empty: true })
    }

    /// Appends events: metadata such as names first, then all others in order of time.
    pub fn append(&mut self, mut events: Vec<Event>, other_data: &Map<String, Value>) -> Result<(), TraceError> {
        events.sort_by(|a, b| {
            let is_timed = |event: &Event| event.kind != Kind::Metadata;
            is_timed(a).cmp(&is_timed(b)).then(a.time_us.total_cmp(&b.time_us))
        });
        let written = self.write(&events, other_data);
        written.map_err(|source| ImageError::Write { path: self.path.clone(), source }.into())
    }

    /// Writes everything in one call, so that readers hardly ever see an incomplete document.
    fn write(&mut self, events: &[Event], other_data: &Map<String, Value>) -> io::Result<()> {
        let mut bytes = Vec::new();
        for event in events {
            bytes.extend_from_slice(if self.is_empty { b"\n" } else { b",\n" });
            serde_json::to_writer(&mut bytes, event)?;
            self.is_empty = false;
        }
        let list_bytes = bytes.len() as u64;
        bytes.extend_from_slice(TAIL.as_bytes());
        serde_json::to_writer(&mut bytes, other_data)?;
        bytes.extend_from_slice(b"}\n");
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(&bytes)?;
        self.file.set_len(self.end + bytes.len() as u64)?;
        self.end += list_bytes;
        Ok(())
    }
}
