//! Trees of earlier runs, kept in a folder. A tree is found by a hash of its triangles, so a scene that changed gets a
//! new one.
//!
//! Files are complete when they appear under their names, so several processes may share a folder. Damaged files are
//! ignored with a note and written again; files that cannot be read are ignored with a note. When the folder exceeds its
//! limit, the trees that were used longest ago go first. Files whose names are not of this module's form are the user's
//! and stay.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, SystemTime};

use bytemuck::{Pod, Zeroable, bytes_of, bytes_of_mut, cast_slice, cast_slice_mut};
use obvhs::cwbvh::node::CwBvhNode;
use twox_hash::XxHash3_128;

use super::built::Built;
use super::flatten::Flat;
use crate::image::file::atomic_write;

/// Least number of triangles of a tree that is looked for; smaller ones are built in less time.
const LEAST_TRIANGLES: usize = 100_000;
/// Least time for which a tree is kept.
const LEAST_BUILD: Duration = Duration::from_secs(1);
/// Bytes of all trees in the folder.
const MOST_BYTES: u64 = 4 << 30;
/// Age of a file that a run has not finished writing, after which the run must have been killed.
const LONGEST_WRITE: Duration = Duration::from_secs(24 * 3600);
/// The first 16 bytes of a file, which change with the format.
const MAGIC: [u8; 16] = *b"diptych tree 1\0\0";
/// Builders of trees, which are part of the key: other versions may build other trees.
const BUILDERS: &str = concat!("diptych ", env!("CARGO_PKG_VERSION"), ", obvhs 0.4.0");

/// A folder of trees, or none.
#[derive(Debug, Default)]
pub struct TreeCache {
    folder: Option<PathBuf>,
    least_triangles: usize,
    least_build: Duration,
    most_bytes: u64,
    notes: Mutex<Vec<String>>,
}

/// Hash of the triangles of a tree and of how it is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Key(u128);

impl TreeCache {
    /// Keeps no trees.
    pub fn off() -> Self {
        Self::default()
    }

    /// Keeps trees in this folder, which is created when the first tree is written.
    pub fn in_folder(folder: PathBuf) -> Self {
        let folder = Some(folder);
        Self {
            folder,
            least_triangles: LEAST_TRIANGLES,
            least_build: LEAST_BUILD,
            most_bytes: MOST_BYTES,
            ..Self::default()
        }
    }

    /// Returns what went wrong with files, and forgets it. No run depends on these files.
    pub fn take_notes(&self) -> Vec<String> {
        std::mem::take(&mut *self.notes.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn note(&self, path: &Path, what: &str) {
        let note = format!("the tree in {} {what}", path.display());
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(note);
    }

    /// Returns the tree over these triangles from the folder, or else builds it and keeps it if that took long.
    ///
    /// # Errors
    /// Errors of `build`.
    pub(super) fn tree<E>(
        &self,
        flat: &Flat<'_>,
        splits: bool,
        build: impl FnOnce() -> Result<Built, E>,
    ) -> Result<Built, E> {
        let Some(folder) = self.folder.as_deref().filter(|_| flat.len() >= self.least_triangles) else {
            return build();
        };
        let key = {
            let _span = tracing::info_span!("hash triangles").entered();
            Key::of(flat, splits)
        };
        let path = folder.join(format!("{:032x}.tree", key.0));
        match read(&path, key, flat.len()) {
            Ok(built) => return Ok(built),
            Err(error) => match error.kind() {
                io::ErrorKind::NotFound => {}
                io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
                    self.note(&path, &format!("is damaged and is built again: {error}"));
                }
                _ => {
                    self.note(&path, &format!("cannot be read: {error}"));
                    return build();
                }
            },
        }
        let begin = std::time::Instant::now();
        let built = build()?;
        if begin.elapsed() >= self.least_build
            && let Err(error) = self.keep(folder, &path, key, &built)
        {
            self.note(&path, &format!("cannot be kept: {error}"));
        }
        Ok(built)
    }

    fn keep(&self, folder: &Path, path: &Path, key: Key, built: &Built) -> io::Result<()> {
        let _span = tracing::info_span!("keep tree").entered();
        fs::create_dir_all(folder)?;
        atomic_write(path, |file| write(file, key, built)).map_err(io::Error::other)?;
        self.remove_oldest(folder, path)
    }

    /// Removes the trees that were used longest ago until the others are within the limit. Keeps `newest`.
    fn remove_oldest(&self, folder: &Path, newest: &Path) -> io::Result<()> {
        let mut trees: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let path = entry.path();
            let name = entry.file_name();
            let Some(name) = name.to_str().and_then(Name::of) else { continue };
            // Another process may have removed it.
            let Ok(metadata) = fs::symlink_metadata(&path) else { continue };
            if !metadata.is_file() {
                continue;
            }
            if name == Name::Tree {
                trees.push((metadata.modified()?, metadata.len(), path));
            } else if metadata.modified()?.elapsed().is_ok_and(|age| age > LONGEST_WRITE) {
                let _ = fs::remove_file(path);
            }
        }
        let mut bytes: u64 = trees.iter().map(|(_, len, _)| len).sum();
        trees.retain(|(.., path)| path != newest);
        trees.sort();
        for (_, len, path) in trees {
            if bytes <= self.most_bytes {
                break;
            }
            if fs::remove_file(path).is_ok() {
                bytes -= len;
            }
        }
        Ok(())
    }
}

/// Kinds of this module's files, by their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Name {
    Tree,
    /// The temporary file of a tree that a run has not finished writing.
    Part,
}

impl Name {
    fn of(name: &str) -> Option<Self> {
        let is_tree = |name: &str| {
            let is_hex = |digit: u8| digit.is_ascii_digit() || (b'a'..=b'f').contains(&digit);
            name.strip_suffix(".tree").is_some_and(|key| key.len() == 32 && key.bytes().all(is_hex))
        };
        let part = || {
            let (tree, random) = name.strip_prefix('.')?.strip_suffix(".part")?.split_at_checked(32 + ".tree".len())?;
            Some(is_tree(tree) && random.bytes().all(|byte| byte.is_ascii_alphanumeric()))
        };
        match is_tree(name) {
            true => Some(Self::Tree),
            false => (part() == Some(true)).then_some(Self::Part),
        }
    }
}

impl Key {
    fn of(flat: &Flat<'_>, splits: bool) -> Self {
        let mut hasher = XxHash3_128::new();
        hasher.write(&MAGIC);
        hasher.write(BUILDERS.as_bytes());
        hasher.write(&[u8::from(splits)]);
        let mut batch = Vec::with_capacity(1024);
        for first in (0..flat.len()).step_by(batch.capacity()) {
            batch.clear();
            batch.extend((first..flat.len().min(first + 1024)).map(|i| flat.vertices(i)));
            hasher.write(cast_slice::<[glam::Vec3; 3], u8>(&batch));
        }
        Self(hasher.finish_128())
    }
}

/// A file's first bytes. Nodes and indices follow.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: [u8; 16],
    key: Key,
    nodes: u64,
    indices: u64,
    /// Hash of all that follows.
    content: u128,
}

fn content(nodes: &[CwBvhNode], order: &[u32]) -> u128 {
    let mut hasher = XxHash3_128::new();
    hasher.write(cast_slice(nodes));
    hasher.write(cast_slice(order));
    hasher.finish_128()
}

fn write(mut file: impl Write, key: Key, Built { nodes, order }: &Built) -> io::Result<()> {
    let content = content(nodes, order);
    let header = Header { magic: MAGIC, key, nodes: nodes.len() as u64, indices: order.len() as u64, content };
    file.write_all(bytes_of(&header))?;
    file.write_all(cast_slice(nodes))?;
    file.write_all(cast_slice(order))
}

/// Reads a tree over `triangles` triangles. A header that claims more than such a tree can have is refused before memory
/// is allocated: the length of the file proves nothing, since a sparse file is as long as it likes.
fn read(path: &Path, key: Key, triangles: usize) -> io::Result<Built> {
    let mut file = File::open(path)?;
    let _span = tracing::info_span!("read tree").entered();
    let damaged = |what: &str| io::Error::new(io::ErrorKind::InvalidData, what.to_owned());
    let mut header = Header::zeroed();
    file.read_exact(bytes_of_mut(&mut header))?;
    if header.magic != MAGIC || header.key != key {
        return Err(damaged("it is of another tree"));
    }
    // Splits add at most one entry per triangle, and each node but the root has at least two children or entries.
    let triangles = triangles as u64;
    if !(triangles..=2 * triangles).contains(&header.indices) || header.nodes > header.indices {
        return Err(damaged("it has another number of nodes than it should"));
    }
    let bytes = u128::from(header.nodes) * size_of::<CwBvhNode>() as u128 + u128::from(header.indices) * 4;
    if u128::from(file.metadata()?.len()) != size_of::<Header>() as u128 + bytes {
        return Err(damaged("it has another length than it should"));
    }
    let mut nodes = vec![CwBvhNode::zeroed(); header.nodes as usize];
    let mut order = vec![0u32; header.indices as usize];
    file.read_exact(cast_slice_mut(&mut nodes))?;
    file.read_exact(cast_slice_mut(&mut order))?;
    if content(&nodes, &order) != header.content {
        return Err(damaged("its bytes have changed"));
    }
    let built = Built { nodes, order };
    if !built.is_sound(triangles as usize) {
        return Err(damaged("its nodes refer to others that do not exist"));
    }
    // Trees that are used stay.
    let _ = file.set_modified(SystemTime::now());
    Ok(built)
}

#[cfg(test)]
mod tests;
