//! Atomic file writes: a file is written under a temporary name and renamed when it is complete. A [`LineFile`] grows
//! in place instead, so that a long run that is killed loses only its last line.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead, BufReader, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::ImageError;

/// Creates or replaces the file `path` with the output of `write`.
///
/// Writes to a temporary file in the same folder and renames it to `path` once it is complete. If `write` fails or
/// panics, removes the temporary file and keeps the old file at `path`. This guards against a failing program, not
/// against a power cut: nothing is synced to disk.
///
/// # Errors
/// [`ImageError::Write`] with the cause, also if `path` is not a regular file.
pub fn atomic_write(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<(), ImageError> {
    write_and_rename(path, write).map_err(|source| ImageError::Write { path: path.to_owned(), source })
}

fn write_and_rename(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
    refuse_other_than_files(path)?;
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

/// A file that grows by one line per unbuffered write. Readers ignore a last line without a newline, since it is
/// incomplete.
pub struct LineFile {
    path: PathBuf,
    file: File,
}

impl LineFile {
    /// Creates or empties the file.
    ///
    /// # Errors
    /// [`ImageError::Write`], also if `path` is not a regular file.
    pub fn create(path: &Path) -> Result<Self, ImageError> {
        let open = || {
            let file = OpenOptions::new().read(true).append(true).create(true).open(path)?;
            file.set_len(0).map(|()| file)
        };
        let file = refuse_other_than_files(path).and_then(|()| open());
        let file = file.map_err(|source| ImageError::Write { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Appends a line, which must end with a newline.
    ///
    /// # Errors
    /// [`ImageError::Write`]
    pub fn add(&mut self, line: &[u8]) -> Result<(), ImageError> {
        let written = self.file.write_all(line);
        written.map_err(|source| ImageError::Write { path: self.path.clone(), source })
    }

    /// Calls `take` with each complete line, without its newline.
    ///
    /// # Errors
    /// Errors of `take` and of reading.
    pub fn each_line<E: From<io::Error>>(&self, take: impl FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
        (&self.file).seek(SeekFrom::Start(0))?;
        each_line(&self.file, take)
    }

    /// Removes the file.
    ///
    /// # Errors
    /// [`ImageError::Write`]
    pub fn remove(&self) -> Result<(), ImageError> {
        fs::remove_file(&self.path).map_err(|source| ImageError::Write { path: self.path.clone(), source })
    }

    /// Gives the file its final name.
    ///
    /// # Errors
    /// [`ImageError::Write`]
    pub fn rename(self, path: &Path) -> Result<(), ImageError> {
        let renamed = refuse_other_than_files(path).and_then(|()| fs::rename(&self.path, path));
        renamed.map_err(|source| ImageError::Write { path: path.to_owned(), source })
    }
}

fn each_line<E: From<io::Error>>(file: &File, mut take: impl FnMut(&[u8]) -> Result<(), E>) -> Result<(), E> {
    let (mut reader, mut line) = (BufReader::new(file), Vec::new());
    while reader.read_until(b'\n', &mut line)? > 0 {
        if let Some(whole) = line.strip_suffix(b"\n") {
            take(whole)?;
        }
        line.clear();
    }
    Ok(())
}

/// Returns the number of complete lines of a file, or `None` if there is no file.
///
/// # Errors
/// Errors of reading the file.
pub fn count_lines(path: &Path) -> io::Result<Option<u64>> {
    let file = match File::open(path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
    };
    let mut lines = 0;
    each_line(&file, |_| {
        lines += 1;
        Ok::<_, io::Error>(())
    })?;
    Ok(Some(lines))
}

/// Renames the file of an interrupted run, so that a new run does not replace it. `finished` is the path that the
/// complete file would have got. The new name is that of `finished` with `.unfinished` before the extension, and with a
/// number if that name is taken. Returns the new path.
///
/// # Errors
/// [`ImageError::Write`]
pub fn keep_unfinished(file: &Path, finished: &Path) -> Result<PathBuf, ImageError> {
    let named = |number: Option<u32>| {
        let mut name = finished.file_stem().unwrap_or_default().to_owned();
        name.push(number.map_or_else(|| ".unfinished".to_owned(), |number| format!(".unfinished.{number}")));
        if let Some(extension) = finished.extension() {
            name.push(".");
            name.push(extension);
        }
        finished.with_file_name(name)
    };
    let mut names = std::iter::once(None).chain((2..).map(Some)).map(named);
    let is_free = |name: &PathBuf| fs::symlink_metadata(name).is_err();
    let kept = names.find(is_free).unwrap_or_else(|| file.to_owned());
    let renamed = fs::rename(file, &kept);
    renamed.map_err(|source| ImageError::Write { path: kept.clone(), source })?;
    Ok(kept)
}

/// Rejects devices and pipes, which a rename would replace by a regular file.
fn refuse_other_than_files(path: &Path) -> io::Result<()> {
    match fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        true => Err(io::Error::new(io::ErrorKind::InvalidInput, "the path exists but is not a regular file")),
        false => Ok(()),
    }
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
    fn atomic_write_replaces_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        for text in ["first", "second"] {
            atomic_write(&path, |w| w.write_all(text.as_bytes())).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(names_in(folder.path()), ["a.txt"]);
    }

    #[test]
    fn failing_writer_leaves_no_file() {
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
    fn panicking_writer_keeps_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, "old").unwrap();
        let outcome = std::panic::catch_unwind(|| atomic_write(&path, |_| panic!("expected by the test")));
        assert!(outcome.is_err());
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names_in(folder.path()), ["a.txt"]);
    }

    #[test]
    fn rejects_folders_and_paths_without_a_file_name() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path().to_owned(), folder.path().join("missing/a.txt"), "..".into(), "".into()] {
            assert!(atomic_write(&path, |_| Ok(())).is_err(), "{path:?}");
        }
        assert!(names_in(folder.path()).is_empty());
    }

    #[test]
    fn added_lines_are_readable_and_torn_ones_ignored() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, "of an earlier run").unwrap();
        let mut file = LineFile::create(&path).unwrap();
        assert_eq!(count_lines(&path).unwrap(), Some(0));
        file.add(b"one\n").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one\n");
        file.add(b"two\nthr").unwrap();
        let mut lines = Vec::new();
        let take = |line: &[u8]| {
            lines.push(line.to_vec());
            Ok::<_, io::Error>(())
        };
        file.each_line(take).unwrap();
        assert_eq!(lines, [b"one", b"two"]);
        assert_eq!(count_lines(&path).unwrap(), Some(2));
        file.rename(&folder.path().join("b.csv")).unwrap();
        assert_eq!(names_in(folder.path()), ["b.csv"]);
        assert_eq!(count_lines(&path).unwrap(), None);
        assert!(LineFile::create(folder.path()).is_err() && LineFile::create("".as_ref()).is_err());
    }

    #[test]
    fn unfinished_files_get_numbered_names() {
        let folder = tempfile::tempdir().unwrap();
        for (text, name) in [("1", "a.unfinished.csv"), ("2", "a.unfinished.2.csv"), ("3", "a.unfinished.3.csv")] {
            fs::write(folder.path().join("a.part"), text).unwrap();
            let kept = keep_unfinished(&folder.path().join("a.part"), &folder.path().join("a.csv")).unwrap();
            assert_eq!((kept.as_path(), fs::read_to_string(&kept).unwrap()), (&*folder.path().join(name), text.into()));
        }
        assert_eq!(names_in(folder.path()).len(), 3);
        assert!(keep_unfinished(&folder.path().join("a.part"), "a.csv".as_ref()).is_err());
    }
}
