//! The file of a run's trace. It is a valid document after every write, whatever becomes of the run.

use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::event::{Event, Kind};
use super::host::HostSpans;
use super::{Recorder, TraceError};
use crate::image::ImageError;

/// The trace-file of a run. Brought up to date by [`Recorder::flush`] and ended by [`TraceFile::finish`], or, with what
/// is known by then, when it is dropped because the run failed or panicked.
pub struct TraceFile {
    recorder: Recorder,
    is_finished: bool,
}

impl TraceFile {
    /// Creates or replaces the file and starts recording device lanes and this process's `tracing` spans.
    ///
    /// # Errors
    /// [`TraceError::Write`]; [`TraceError::SubscriberTaken`]: host spans can be recorded once in a process's life.
    pub fn start(path: &Path) -> Result<TraceFile, TraceError> {
        let recorder = Recorder::new();
        let host = HostSpans::install(recorder.origin())?;
        TraceFile::begin(recorder, Some(host), path)
    }

    /// As [`TraceFile::start`], but without host spans.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn start_without_host(path: &Path) -> Result<TraceFile, TraceError> {
        TraceFile::begin(Recorder::new(), None, path)
    }

    fn begin(recorder: Recorder, host: Option<HostSpans>, path: &Path) -> Result<TraceFile, TraceError> {
        recorder.open(Document::create(path)?, host);
        Ok(TraceFile { recorder, is_finished: false })
    }

    pub fn recorder(&self) -> Recorder {
        self.recorder.clone()
    }

    /// Writes the rest.
    ///
    /// # Errors
    /// [`TraceError::Write`], also of an earlier write.
    pub fn finish(mut self) -> Result<(), TraceError> {
        self.is_finished = true;
        self.recorder.close(true)
    }
}

impl Drop for TraceFile {
    fn drop(&mut self) {
        if !self.is_finished
            && let Err(error) = self.recorder.close(false)
        {
            eprintln!("trace: {error}");
        }
    }
}

const HEAD: &str = "{\"traceEvents\":[";
const TAIL: &str = "\n],\"displayTimeUnit\":\"ms\",\"otherData\":";

/// A list of events that can be added to: each write takes the place of the document's end and writes a new one.
pub(super) struct Document {
    path: PathBuf,
    file: File,
    /// Where the list of events ends.
    end: u64,
    is_empty: bool,
}

impl Document {
    pub fn create(path: &Path) -> Result<Document, TraceError> {
        let failed = |source| ImageError::Write { path: path.to_owned(), source };
        // What cannot be written twice in the same place, such as a pipe, cannot be kept valid.
        if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
            let what = "there is something else than a file by that name";
            return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, what)).into());
        }
        let mut file = File::create(path).map_err(failed)?;
        file.write_all(HEAD.as_bytes()).map_err(failed)?;
        Ok(Document { path: path.to_owned(), file, end: HEAD.len() as u64, is_empty: true })
    }

    /// Adds events, names first, then in order of time.
    pub fn append(&mut self, mut events: Vec<Event>, other_data: &Map<String, Value>) -> Result<(), TraceError> {
        events.sort_by(|a, b| {
            let is_timed = |event: &Event| event.kind != Kind::Metadata;
            is_timed(a).cmp(&is_timed(b)).then(a.time_us.total_cmp(&b.time_us))
        });
        let written = self.write(&events, other_data);
        written.map_err(|source| ImageError::Write { path: self.path.clone(), source }.into())
    }

    /// One write for all, so that the file is hardly ever seen in between.
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
