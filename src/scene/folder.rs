//! Access to files that a shot or a glTF file names. These names are untrusted: unless the user allows more, files must
//! be below the folder of the file that names them, and within the scene's memory budget.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::Refusal;
use super::budget::{Budget, Held};
use super::error::Fault;

/// Permissions for reading a scene's files, and the source that they are read from.
#[derive(Clone, Copy, Debug)]
pub struct Access<'a> {
    pub budget: &'a Budget,
    /// Allows files outside the folder of the file that names them.
    pub allow_outside: bool,
    /// Refuses a scene with a fault in a texture or an animation, instead of leaving that part out with a warning.
    pub strict: bool,
    pub source: Source<'a>,
}

impl<'a> Access<'a> {
    /// Grants access to files on disk below the folder of the file that names them.
    pub fn of(budget: &'a Budget) -> Self {
        Self { budget, allow_outside: false, strict: false, source: Source::Disk }
    }

    /// Returns the canonical path if files are read from disk, so that all names of a file give the same path. Files
    /// that are sent between machines keep the path by which they are named.
    pub fn one_path(&self, path: PathBuf) -> PathBuf {
        if let Source::Disk | Source::Shot(_) = self.source { fs::canonicalize(&path).unwrap_or(path) } else { path }
    }
}

/// Contents of files, by the paths from which they were read.
pub type Files = BTreeMap<PathBuf, Vec<u8>>;

/// Source of a scene's files.
#[derive(Clone, Copy, Debug)]
pub enum Source<'a> {
    Disk,
    /// Files on disk. Their contents are also collected in this map, so that they can be sent to another machine.
    Kept(&'a Mutex<Files>),
    /// Files sent from another machine, which has checked access.
    Sent(&'a Files),
    /// Files on disk, except for the shot, which has this text. The caller has written it, so it may name files
    /// anywhere.
    Shot(&'a str),
}

/// Folder of a file. The names of other files in that file are relative to this folder.
#[derive(Clone, Debug)]
pub struct Folder<'a> {
    path: PathBuf,
    pub access: Access<'a>,
}

impl<'a> Folder<'a> {
    /// Returns the folder of the file at `path`.
    pub fn of(path: &Path, access: Access<'a>) -> Self {
        Self { path: path.parent().unwrap_or(Path::new("")).to_owned(), access }
    }

    /// Returns the path of a named file. The name's parts are separated by `/`, or by the `\` of Windows.
    ///
    /// # Errors
    /// A fault if access is denied, or if there is no such file.
    pub fn find(&self, name: &str) -> Result<PathBuf, Fault> {
        let outside = || Fault::from(Refusal::Outside(shorten(name)));
        let slashed = name.replace('\\', "/");
        let path = self.path.join(&slashed);
        if self.access.allow_outside || matches!(self.access.source, Source::Sent(_)) {
            // On other systems, a file may have a backslash in its name.
            let literal = self.path.join(name);
            let exists = match self.access.source {
                Source::Sent(files) => files.contains_key(&literal),
                _ => literal.exists(),
            };
            return Ok(if exists { literal } else { path });
        }
        // Checks the name before asking the file system: whether a file exists elsewhere is private, and on Windows a
        // lookup of a network share reveals the user to its owner.
        if !leads_down(&slashed) {
            return Err(outside());
        }
        let real = |at: &Path| {
            let at = if at.as_os_str().is_empty() { Path::new(".") } else { at };
            fs::canonicalize(at).map_err(|source| Fault::Read { path: path.display().to_string(), source })
        };
        let is_below = real(&path)?.starts_with(real(&self.path)?);
        if is_below { Ok(path) } else { Err(outside()) }
    }
}

/// Returns true if a name stays below its folder, judged by its text alone. Drives and network shares are rejected on
/// every system, even where they have no special meaning.
fn leads_down(name: &str) -> bool {
    let is_drive = name.as_bytes().get(1) == Some(&b':');
    let mut depth = 0usize;
    let steps_down = |step: Component| match step {
        Component::Normal(_) => {
            depth += 1;
            true
        }
        Component::CurDir => true,
        Component::ParentDir => match depth.checked_sub(1) {
            Some(above) => {
                depth = above;
                true
            }
            None => false,
        },
        Component::RootDir | Component::Prefix(_) => false,
    };
    !is_drive && !name.contains('\0') && Path::new(name).components().all(steps_down)
}

/// Reads a whole regular file. Rejects pipes and devices, which may never end.
///
/// # Errors
/// A fault if the file cannot be read or exceeds the budget.
pub fn read<'a>(path: &Path, access: Access<'a>) -> Result<Held<'a>, Fault> {
    let failed = |source| Fault::Read { path: path.display().to_string(), source };
    if let Source::Sent(files) = access.source {
        let bytes = files.get(path).ok_or_else(|| failed(io::ErrorKind::NotFound.into()))?;
        let reserved = access.budget.reserve(bytes.len() as u64)?;
        return Ok(Held { bytes: bytes.clone(), reserved });
    }
    let metadata = fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        return Err(failed(io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file")));
    }
    let reserved = access.budget.reserve(metadata.len())?;
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    File::open(path).and_then(|file| file.take(metadata.len()).read_to_end(&mut bytes)).map_err(failed)?;
    if let Source::Kept(files) = access.source {
        files.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned(), bytes.clone());
    }
    Ok(Held { bytes, reserved })
}

/// Shortens a long name for display.
pub fn shorten(name: &str) -> String {
    const SHOWN: usize = 80;
    match name.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &name[..end]),
        None => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::budget::ByteSize;

    /// Creates `outer/secret.bin` beside `outer/inner/`, which holds `own.bin` and `below/own.bin`.
    fn tree() -> tempfile::TempDir {
        let outer = tempfile::tempdir().unwrap();
        fs::create_dir_all(outer.path().join("inner/below")).unwrap();
        for name in ["secret.bin", "inner/own.bin", "inner/below/own.bin"] {
            fs::write(outer.path().join(name), name).unwrap();
        }
        outer
    }

    fn folder(outer: &tempfile::TempDir, budget: &Budget, allow_outside: bool, name: &str) -> Result<PathBuf, String> {
        let folder = Folder::of(&outer.path().join("inner/scene.gltf"), Access { allow_outside, ..Access::of(budget) });
        folder.find(name).map_err(|error| error.in_file("scene.gltf").to_string())
    }

    #[test]
    fn names_below_the_folder_are_found() {
        let (outer, budget) = (tree(), Budget::unlimited());
        for name in ["own.bin", "./own.bin", "below/own.bin", "below/../own.bin", "below//.././own.bin"] {
            for allow_outside in [false, true] {
                let found = folder(&outer, &budget, allow_outside, name);
                assert_eq!(found, Ok(outer.path().join("inner").join(name)), "{name}");
            }
        }
        for name in ["below\\own.bin", ".\\below\\..\\own.bin", "below\\..\\below/own.bin"] {
            for allow_outside in [false, true] {
                let found = folder(&outer, &budget, allow_outside, name);
                assert_eq!(found, Ok(outer.path().join("inner").join(name.replace('\\', "/"))), "{name}");
            }
        }
        assert!(folder(&outer, &budget, false, "lost.bin").unwrap_err().contains("lost.bin"));
    }

    #[test]
    fn rejects_names_outside_unless_allowed() {
        let (outer, budget) = (tree(), Budget::unlimited());
        let secret = outer.path().join("secret.bin");
        for name in ["../secret.bin", "below/../../secret.bin", secret.to_str().unwrap()] {
            let error = folder(&outer, &budget, false, name).unwrap_err();
            assert!(error.contains("secret.bin") && error.contains("allow files outside"), "{error}");
            assert!(folder(&outer, &budget, true, name).is_ok_and(|found| found.exists()), "{name}");
        }
        let elsewhere = ["/", "..", "../inner/own.bin", "//host/share/a.bin", "C:/a.bin", "C:a.bin", "a\0b"];
        for name in
            elsewhere.into_iter().chain(["\\\\host\\share\\a.bin", "..\\secret.bin", "below\\..\\..\\secret.bin"])
        {
            let error = folder(&outer, &budget, false, name).unwrap_err();
            assert!(error.contains("allow files outside"), "{name}: {error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_are_resolved_before_the_check() {
        let (outer, budget) = (tree(), Budget::unlimited());
        let inner = outer.path().join("inner");
        let link = |to: &str, name: &str| std::os::unix::fs::symlink(to, inner.join(name)).unwrap();
        link("../secret.bin", "file.bin");
        link("..", "up");
        link("below", "down");
        for name in ["file.bin", "up/secret.bin", "up/inner/../secret.bin"] {
            assert!(folder(&outer, &budget, false, name).unwrap_err().contains("allow files outside"), "{name}");
            assert!(folder(&outer, &budget, true, name).is_ok(), "{name}");
        }
        assert!(folder(&outer, &budget, false, "down/own.bin").is_ok());
        assert!(folder(&outer, &budget, false, "up/inner/own.bin").is_ok());
    }

    #[test]
    fn rejects_files_beyond_the_budget() {
        let outer = tree();
        let path = outer.path().join("secret.bin");
        let budget = Budget::new(ByteSize(15));
        let held = read(&path, Access::of(&budget)).unwrap();
        assert_eq!((&*held, budget.left()), (&b"secret.bin"[..], 5));
        let error = read(&path, Access::of(&budget)).unwrap_err().in_file("a").to_string();
        assert!(["10 bytes", "5 bytes", "15 bytes", "raise the limit"].iter().all(|p| error.contains(p)), "{error}");
        drop(held);
        assert_eq!(budget.left(), 15);
        assert!(matches!(read(outer.path(), Access::of(&budget)), Err(Fault::Read { .. })));
    }

    #[test]
    fn kept_files_are_read_without_the_disk() {
        let (outer, budget, kept) = (tree(), Budget::new(ByteSize(60)), Mutex::default());
        let path = outer.path().join("inner/own.bin");
        let access = Access { source: Source::Kept(&kept), ..Access::of(&budget) };
        drop(read(&path, access).unwrap());
        drop(outer);
        let files = kept.into_inner().unwrap();
        let access = Access { source: Source::Sent(&files), ..Access::of(&budget) };
        let found = Folder::of(&path, access).find("own.bin").unwrap();
        assert_eq!(&*read(&found, access).unwrap(), b"inner/own.bin");
        assert!(matches!(read(&path.with_file_name("other.bin"), access), Err(Fault::Read { .. })));
        let small = Budget::new(ByteSize(5));
        assert!(matches!(read(&found, Access { budget: &small, ..access }), Err(Fault::Refused { .. })));
    }
}
