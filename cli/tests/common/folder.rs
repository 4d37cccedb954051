//! Commands as lines of text, run in a folder for their files.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

use super::{Share, beside, diptych, program};

/// A folder for the files of a test. In command lines, `./NAME` and `OPTION=./NAME` are files in it, and `''` is an
/// empty argument.
pub struct Folder(tempfile::TempDir);

/// Exit status, results and messages of a command.
pub struct Said {
    pub status: Option<i32>,
    pub out: String,
    pub errors: String,
}

impl Said {
    pub fn new(output: Output) -> Self {
        let [out, errors] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).unwrap());
        Self { status: output.status.code(), out, errors }
    }

    #[track_caller]
    pub fn success(self, line: &str) -> Self {
        assert_eq!(self.status, Some(0), "{line}: {}", self.errors);
        self
    }

    /// Returns results and messages.
    pub fn all(&self) -> String {
        format!("{}{}", self.out, self.errors)
    }

    /// Returns the only JSON value, or the last event.
    #[track_caller]
    pub fn json(&self) -> Value {
        let last = || serde_json::from_str(self.out.lines().last().expect("no output"));
        serde_json::from_str(&self.out).or_else(|_| last()).unwrap_or_else(|e| panic!("{e}: {}", self.out))
    }

    #[track_caller]
    pub fn events(&self) -> Vec<Value> {
        self.out.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        if name.is_empty() { self.0.path().to_owned() } else { self.0.path().join(name) }
    }

    /// Returns a word of a command line with the path of its file.
    pub fn word(&self, word: &str) -> String {
        let (before, name) = match word.split_once("=./") {
            Some((option, name)) => (format!("{option}="), name),
            None => match word.strip_prefix("./") {
                Some(name) => (String::new(), name),
                None => return if word == "''" { String::new() } else { word.to_owned() },
            },
        };
        before + self.path(name).to_str().unwrap()
    }

    pub fn words(&self, line: &str) -> Vec<String> {
        line.split_whitespace().map(|word| self.word(word)).collect()
    }

    /// Runs a command in this process, whatever its status is.
    pub fn try_run(&self, line: &str) -> Said {
        Said::new(diptych(&self.words(line)))
    }

    /// Runs a command that must succeed.
    #[track_caller]
    pub fn run(&self, line: &str) -> Said {
        self.try_run(line).success(line)
    }

    /// Runs a command that must succeed beside other programs that take a share of the cores.
    #[track_caller]
    pub fn run_beside(&self, share: Share, line: &str) -> Said {
        Said::new(beside(&self.words(line), share)).success(line)
    }

    /// Returns a command that runs as a process.
    pub fn program(&self, line: &str) -> Command {
        program(&self.words(line))
    }

    /// Starts a process whose standard output is read or ignored.
    pub fn start(&self, line: &str, stdout: Stdio) -> Child {
        self.program(line).stdout(stdout).spawn().unwrap()
    }

    /// Writes an input file, and the folders that it needs; returns its path.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, bytes).unwrap();
        path
    }

    #[track_caller]
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    #[track_caller]
    pub fn text(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).unwrap()
    }

    #[track_caller]
    pub fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&self.bytes(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Returns the sorted names of files and folders in a folder.
    pub fn names(&self, name: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.path(name)) else { return Vec::new() };
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Returns the contents of all files in this folder and those below.
    pub fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let (mut files, mut folders) = (BTreeMap::new(), vec![self.path("")]);
        while let Some(folder) = folders.pop() {
            for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                if path.is_dir() {
                    folders.push(path);
                } else {
                    let bytes = std::fs::read(&path).unwrap();
                    files.insert(path, bytes);
                }
            }
        }
        files
    }

    /// Asserts that two folders have the same pictures of both eyes.
    #[track_caller]
    pub fn assert_same_eyes(&self, one: &str, other: &str) {
        for eye in ["left.exr", "right.exr"] {
            let [a, b] = [one, other].map(|folder| self.bytes(&format!("{folder}/{eye}")));
            assert!(a == b, "{eye} of {one} and {other} differ");
        }
    }

    /// Expects every line of a table to be refused with this exit status, by one error and without a file.
    ///
    /// A row has a command line, ` => `, and the parts of the error, between which is ` | `. Options alone belong to
    /// `command`. `{a b}` in a line makes a row of each word, which `{}` stands for in the parts.
    #[track_caller]
    pub fn refuses(&self, status: i32, command: &str, table: &str) {
        let before = self.files();
        for row in table.lines().map(str::trim).filter(|row| !row.is_empty()).flat_map(rows) {
            let (line, parts) = row.split_once(" => ").unwrap_or_else(|| panic!("a row without parts: {row}"));
            let line = if line.starts_with('-') { format!("{command} {line}") } else { line.to_owned() };
            let Said { status: found, out, errors } = self.try_run(&line);
            assert_eq!(found, Some(status), "{line}: {errors}");
            assert_eq!(errors.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{line}: {errors}");
            let (warnings, error) = errors.split_at(errors.find("error: ").unwrap());
            assert!(warnings.lines().all(|line| line.starts_with("warning: ")), "{line}: {errors}");
            assert!(out.is_empty() && !errors.contains("panicked"), "{line}: {out}{errors}");
            for part in parts.split(" | ").map(|part| self.word(part)) {
                assert!(error.contains(&part), "{line}: '{part}' is not in: {errors}");
            }
            assert!(self.files() == before, "{line}: files were written");
        }
    }
}

/// Returns the rows that a row of a table stands for.
fn rows(row: &str) -> Vec<String> {
    let Some((before, (values, after))) = row.split_once('{').and_then(|(a, b)| Some((a, b.split_once('}')?))) else {
        return vec![row.to_owned()];
    };
    values.split(' ').map(|value| format!("{before}{value}{after}").replace("{}", value)).collect()
}
