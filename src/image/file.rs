//! Files appear under their name whole or not at all: they are written aside and renamed.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::ImageError;

/// Creates or replaces the file `path` with what `write` writes.
///
/// The bytes go to a temporary file in the same folder, which takes the name `path` once all of them are written.
/// If `write` fails or panics, the temporary file is removed and what was at `path` before is still there. This guards
/// against a failing program, not against a power cut: nothing is synced to the disk.
///
/// # Errors
/// [`ImageError::Write`] with the cause, also when `path` is something other than a file.
pub fn atomic_write(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<(), ImageError> {
    write_and_rename(path, write).map_err(|source| ImageError::Write { path: path.to_owned(), source })
}

fn write_and_rename(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    // A rename would put a plain file in the place of a device or a pipe.
    if fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "there is something else than a file by that name"));
    }
    let no_name = || io::Error::new(io::ErrorKind::InvalidInput, "the path does not end in a file name");
    let name = path.file_name().ok_or_else(no_name)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut prefix = OsString::from(".");
    prefix.push(name);
    let aside =
        tempfile::Builder::new().prefix(&prefix).suffix(".part").make_in(folder, |path| File::create_new(path))?;
    let (file, aside) = aside.into_parts();
    let mut buffered = BufWriter::new(file);
    write(&mut buffered)?;
    buffered.flush()?;
    drop(buffered);
    aside.persist(path).map_err(|e| e.error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_in(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_written_file_replaces_the_old_one_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for text in ["first", "second"] {
            atomic_write(&path, |w| w.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names_in(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_failing_writer_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let error = atomic_write(&path, |w| {
            w.write_all(&[7; 100_000])?;
            Err(io::Error::other("the renderer stopped"))
        })
        .unwrap_err();
        assert!(error.to_string().contains("a.txt"), "{error}");
        assert!(names_in(folder.path()).is_empty());
    }

    #[test]
    fn a_panicking_writer_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").unwrap();
        let outcome = std::panic::catch_unwind(|| atomic_write(&path, |_| panic!("expected by the test")));
        assert!(outcome.is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names_in(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_folder_a_missing_folder_and_no_name_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_owned(), folder.path().join("missing/a.txt"), "..".into(), "".into()] {
            assert!(atomic_write(&path, |_| Ok(())).is_err(), "{path:?}");
        }
        assert!(names_in(folder.path()).is_empty());
    }
}
