//! The file of a run's trace. It is a valid document after every write, even if the run fails.

use std::io::{self, Write};
use std::path::Path;

use super::growing::GrowingDocument;
use super::host::HostSpans;
use super::{Recorder, TraceError};

/// Trace file of a run. [`Recorder::flush`] updates the file, and [`TraceFile::finish`] completes it. If the run fails
/// or panics, dropping this `TraceFile` ends the file with the events recorded so far.
pub struct TraceFile {
    recorder: Recorder,
}

impl TraceFile {
    /// Creates or replaces the file and starts recording device lanes and this process's `tracing` spans.
    ///
    /// # Errors
    /// [`TraceError::Write`]; [`TraceError::SubscriberTaken`] if this process already has a `tracing` subscriber, for
    /// example from an earlier call.
    pub fn start(path: &Path) -> Result<TraceFile, TraceError> {
        let recorder = Recorder::new();
        let host = HostSpans::install(recorder.origin())?;
        TraceFile::begin(recorder, Some(host), path)
    }

    /// Starts the file like [`TraceFile::start`], but without host spans.
    ///
    /// # Errors
    /// [`TraceError::Write`]
    pub fn start_without_host(path: &Path) -> Result<TraceFile, TraceError> {
        TraceFile::begin(Recorder::new(), None, path)
    }

    fn begin(recorder: Recorder, host: Option<HostSpans>, path: &Path) -> Result<TraceFile, TraceError> {
        recorder.open(GrowingDocument::create(path)?, host);
        Ok(TraceFile { recorder })
    }

    pub fn recorder(&self) -> Recorder {
        self.recorder.clone()
    }

    /// Writes the remaining events and ends the trace.
    ///
    /// # Errors
    /// [`TraceError::Write`] if this write or an earlier one failed.
    pub fn finish(self) -> Result<(), TraceError> {
        self.recorder.close(true)
    }
}

impl Drop for TraceFile {
    fn drop(&mut self) {
        // This has no effect on a finished trace.
        if let Err(error) = self.recorder.close(false) {
            // A panic would end a run that is unwinding already.
            let _ = writeln!(io::stderr(), "trace: {error}");
        }
    }
}
