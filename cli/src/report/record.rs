//! Records a session that may last for hours, in memory that does not grow. Rows go to files as frames end; sums and
//! distributions stay in memory.

use std::io;
use std::path::{Path, PathBuf};

use serde::ser::{Error, SerializeSeq, Serializer};
use serde_json::value::RawValue;

use super::frame_row::{FrameRow, FrameRows};
use super::frames::FrameLine;
use super::headset::HeadsetTally;
use super::play::PlayTally;
use diptych::image::ImageError;
use diptych::image::file::{LineFile, count_lines, keep_unfinished};

/// Names of files in the run's folder: one line per finished frame, and the rows for `run.json` until that file is
/// written.
const LINES: &str = "frames.csv";
const ROWS: &str = "run.json.rows.part";

/// Record of the finished frames of a run with a time budget: rows in files, and sums in memory.
pub struct FrameRecord {
    lines: LineFile,
    /// Number of devices at the start of the run.
    devices: usize,
    rows: SpooledRows,
    pub play: PlayTally,
    pub headset: HeadsetTally,
}

impl FrameRecord {
    /// Starts a record of frames on this number of devices in `folder`. `budget_ms` is the shortest and the longest time
    /// per frame within the budget.
    ///
    /// # Errors
    /// [`ImageError`] if a file cannot be written.
    pub fn create(folder: &Path, devices: usize, budget_ms: [f64; 2]) -> Result<Self, ImageError> {
        let rows = SpooledRows(LineFile::create(&folder.join(ROWS))?);
        let mut lines = LineFile::create(&folder.join(LINES))?;
        lines.add(&FrameLine::header(devices))?;
        Ok(Self { lines, devices, rows, play: PlayTally::new(budget_ms), headset: HeadsetTally::default() })
    }

    /// Adds the row of a frame, and returns once the row has been written to the files.
    ///
    /// # Errors
    /// [`ImageError`] if a file cannot be written.
    pub fn add(&mut self, row: &FrameRow) -> Result<(), ImageError> {
        self.rows.add(row)?;
        self.lines.add(&FrameLine::from(row).text(self.devices))?;
        self.play.add(row);
        row.headset.iter().for_each(|row| self.headset.add(row));
        Ok(())
    }

    /// Returns the rows for `run.json`.
    pub fn rows(&self) -> &SpooledRows {
        &self.rows
    }

    /// Removes the file of spooled rows. Call this once `run.json` contains the rows.
    ///
    /// # Errors
    /// [`ImageError`] if the file cannot be removed.
    pub fn finish(&self) -> Result<(), ImageError> {
        self.rows.0.remove()
    }
}

/// Rows of frames in a file, each as a line of JSON.
pub struct SpooledRows(LineFile);

impl SpooledRows {
    fn add(&mut self, row: &FrameRow) -> Result<(), ImageError> {
        let line = serde_json::to_vec(row).map(|mut line| {
            line.push(b'\n');
            line
        });
        match line {
            Ok(line) => self.0.add(&line),
            Err(error) => Err(ImageError::Write { path: ROWS.into(), source: error.into() }),
        }
    }
}

impl FrameRows for &SpooledRows {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        /// Error of reading the file, or of the serializer.
        struct Failed<E>(E);
        impl<E: Error> From<io::Error> for Failed<E> {
            fn from(error: io::Error) -> Self {
                Self(E::custom(error))
            }
        }
        let mut list = serializer.serialize_seq(None)?;
        let element = |line: &[u8]| {
            let row: &RawValue = serde_json::from_slice(line).map_err(|error| Failed(S::Error::custom(error)))?;
            list.serialize_element(row).map_err(Failed)
        };
        self.0.each_line(element).map_err(|Failed(error)| error)?;
        list.end()
    }
}

/// Files with the rows of a run that ended before it wrote `run.json`, for example because it was killed.
pub struct Unfinished {
    pub frames: u64,
    /// New paths of the files.
    pub kept: Vec<PathBuf>,
}

impl Unfinished {
    /// Renames the files of an unfinished run, so that the next run into the folder does not replace them. Returns
    /// `None` if the last run finished.
    ///
    /// # Errors
    /// [`ImageError`] if a file cannot be read or renamed.
    pub fn keep(folder: &Path) -> Result<Option<Self>, ImageError> {
        let rows = folder.join(ROWS);
        let frames = count_lines(&rows).map_err(|source| ImageError::Read { path: rows.clone(), source })?;
        let Some(frames) = frames.filter(|frames| *frames > 0) else { return Ok(None) };
        let mut kept = vec![keep_unfinished(&rows, &folder.join("run.jsonl"))?];
        let lines = folder.join(LINES);
        if lines.is_file() {
            kept.push(keep_unfinished(&lines, &lines)?);
        }
        Ok(Some(Self { frames, kept }))
    }
}
