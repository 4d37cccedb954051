//! Checkpoint file of an accumulation: a line that identifies the format, a line of JSON, then the sums as
//! little-endian f64.

use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::fnv::hash_of;
use super::{Accumulation, Fingerprint, Half};
use crate::image::file::atomic_write;
use crate::image::{Extent, ImageError};

const FIRST_LINE: &[u8] = b"diptych accumulation 1\n";

#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    #[error("cannot read the checkpoint {path}: check that you may read it")]
    Read { path: PathBuf, source: io::Error },
    #[error("the checkpoint {path} is damaged ({what}): remove it to start over")]
    Damaged { path: PathBuf, what: String },
    #[error(
        "the checkpoint {path} belongs to a different render ({}): use the settings of that render, choose another folder, or remove it",
        differences.join(", ")
    )]
    Foreign { path: PathBuf, differences: Vec<String> },
    #[error(transparent)]
    Write(#[from] ImageError),
}

/// File of an accumulation, with its expected fingerprint and size.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    pub path: PathBuf,
    pub fingerprint: Fingerprint,
    pub extent: Extent,
    /// Number of views.
    pub views: usize,
}

#[derive(Serialize, Deserialize)]
struct Header {
    fingerprint: Fingerprint,
    /// Number of samples per pixel, over the even and over the odd passes.
    samples: [u32; 2],
    dropped: u64,
    /// Hash of the bytes after the header.
    checksum: String,
}

impl Checkpoint {
    /// Loads the accumulation; `None` if there is no file.
    ///
    /// # Errors
    /// [`CheckpointError::Read`] if the file cannot be read, [`CheckpointError::Damaged`] if it is damaged, and
    /// [`CheckpointError::Foreign`] if it has another fingerprint.
    pub fn load(&self) -> Result<Option<Accumulation>, CheckpointError> {
        let bytes = match fs::read(&self.path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(CheckpointError::Read { path: self.path.clone(), source }),
        };
        let damaged = |what: String| CheckpointError::Damaged { path: self.path.clone(), what };
        let (header, sums) = split(&bytes).map_err(damaged)?;
        let differences = header.fingerprint.differences(&self.fingerprint);
        if !differences.is_empty() {
            return Err(CheckpointError::Foreign { path: self.path.clone(), differences });
        }
        let expected = 2 * self.views * self.extent.area() * size_of::<[f64; 3]>();
        if sums.len() != expected {
            return Err(damaged(format!("it holds {} bytes of sums, not {expected}", sums.len())));
        }
        if hash_of(sums) != header.checksum {
            return Err(damaged("its sums are not those it was written with".into()));
        }
        let [a, b] = header.samples;
        a.checked_add(b).ok_or_else(|| damaged("its number of samples is too large".into()))?;
        Ok(Some(self.accumulation(&header, sums)))
    }

    fn accumulation(&self, header: &Header, sums: &[u8]) -> Accumulation {
        let values = sums.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect::<Vec<_>>();
        let mut eyes = values.as_chunks::<3>().0.chunks_exact(self.extent.area()).map(<[_]>::to_vec);
        let mut half = |samples| Half { samples, sums: eyes.by_ref().take(self.views).collect() };
        let halves = header.samples.map(&mut half);
        Accumulation { extent: self.extent, halves, dropped: header.dropped }
    }

    /// Writes `accumulation` to the file, and replaces the previous contents.
    ///
    /// # Errors
    /// [`CheckpointError::Write`] if the file cannot be written.
    pub fn save(&self, accumulation: &Accumulation) -> Result<(), CheckpointError> {
        let halves = &accumulation.halves;
        let values = halves.iter().flat_map(|h| &h.sums).flatten().flatten();
        let sums: Vec<u8> = values.flat_map(|v| v.to_le_bytes()).collect();
        let header = Header {
            fingerprint: self.fingerprint.clone(),
            samples: [halves[0].samples, halves[1].samples],
            dropped: accumulation.dropped,
            checksum: hash_of(&sums),
        };
        Ok(atomic_write(&self.path, |file| {
            file.write_all(FIRST_LINE)?;
            serde_json::to_writer(&mut *file, &header)?;
            file.write_all(b"\n")?;
            file.write_all(&sums)
        })?)
    }
}

/// Splits the file into its header and the bytes after it.
fn split(bytes: &[u8]) -> Result<(Header, &[u8]), String> {
    let rest = bytes.strip_prefix(FIRST_LINE).ok_or("it does not begin as a checkpoint does")?;
    let end = rest.iter().position(|&b| b == b'\n').ok_or("it ends within its header")?;
    let header = serde_json::from_slice(&rest[..end]).map_err(|e| format!("its header is invalid: {e}"))?;
    Ok((header, &rest[end + 1..]))
}
