//! Checks the repository in the current folder or in FOLDER: `lint [FOLDER]`. Lists each fault by file and line; exits
//! with status 1 if there are any.

mod links;
mod prose;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::{env, fs};

/// Files of a repository, by their paths below its root.
struct Repository<'a> {
    root: &'a Path,
    files: BTreeSet<String>,
    /// Texts of the Markdown files.
    documents: BTreeMap<String, String>,
}

impl<'a> Repository<'a> {
    fn read(root: &'a Path, files: BTreeSet<String>) -> Result<Self, String> {
        let mut documents = BTreeMap::new();
        for file in files.iter().filter(|file| file.ends_with(".md")) {
            let text = fs::read_to_string(root.join(file)).map_err(|error| format!("{file}: {error}"))?;
            documents.insert(file.clone(), text);
        }
        if documents.is_empty() {
            return Err(format!("{}: there is no Markdown file", root.display()));
        }
        Ok(Self { root, files, documents })
    }
}

/// Calls `check` with a repository of these files; its folder also contains `ignored.md`.
#[cfg(test)]
fn with_files<T>(files: &[(&str, &str)], check: impl FnOnce(&Repository) -> T) -> T {
    let folder = tempfile::tempdir().expect("folders can be made");
    for (file, text) in [("ignored.md", "[a](nowhere)")].iter().chain(files) {
        let path = folder.path().join(file);
        fs::create_dir_all(path.parent().expect("it is below the root")).expect("folders can be made");
        fs::write(path, text).expect("files can be written");
    }
    let files = files.iter().map(|(file, _)| (*file).to_owned()).collect();
    check(&Repository::read(folder.path(), files).expect("the files can be read"))
}

/// Lists the files that git tracks, or would track after they are added.
fn tracked(root: &Path) -> Result<BTreeSet<String>, String> {
    let mut git = Command::new("git");
    git.current_dir(root).args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]);
    let output = git.output().map_err(|error| format!("git: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).trim().to_owned());
    }
    let listed = String::from_utf8_lossy(&output.stdout);
    Ok(listed.split('\0').filter(|file| root.join(file).is_file()).map(str::to_owned).collect())
}

fn main() -> ExitCode {
    let folder = env::args().nth(1).unwrap_or_else(|| ".".to_owned());
    let root = Path::new(&folder);
    let faults = tracked(root)
        .and_then(|files| Repository::read(root, files))
        .and_then(|repository| Ok([links::broken(&repository), prose::faults(&repository)?].concat()));
    match faults {
        Ok(faults) if faults.is_empty() => ExitCode::SUCCESS,
        Ok(faults) => {
            eprintln!("{}", faults.join("\n"));
            ExitCode::FAILURE
        }
        Err(error) => {
            eprintln!("lint: {error}");
            ExitCode::FAILURE
        }
    }
}
