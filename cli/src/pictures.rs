//! The pictures of a run. `run.json` lists them, so that a later run into the same folder can remove those that it does
//! not overwrite. Otherwise, they would look like pictures of the later run.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Deserialize;

use super::failure::Failure;
use diptych::passes::Aov;

pub struct Pictures {
    folder: PathBuf,
    earlier: BTreeSet<String>,
    written: Vec<String>,
}

impl Pictures {
    /// Starts the list of pictures of a run that writes into `folder`, and reads the list of the previous run. Call it
    /// before the run writes any file.
    pub fn of_folder(folder: &Path) -> Self {
        /// The part of `run.json` that matters. The parser skips the frames without storing them, since a long run has
        /// many.
        #[derive(Deserialize)]
        struct Run {
            #[serde(default)]
            pictures: Vec<String>,
        }
        let file = File::open(folder.join("run.json")).ok().map(BufReader::new);
        let run: Option<Run> = file.and_then(|file| serde_json::from_reader(file).ok());
        let names = run.map_or_else(Vec::new, |run| run.pictures).into_iter().filter(|name| is_ours(name));
        Self { folder: folder.to_owned(), earlier: names.collect(), written: Vec::new() }
    }

    /// Adds pictures that were written.
    pub fn add(&mut self, names: impl IntoIterator<Item = String>) {
        for name in names {
            self.earlier.remove(&name);
            self.written.push(name);
        }
    }

    /// Returns the names of the pictures that were written.
    pub fn names(&self) -> Vec<String> {
        self.written.clone()
    }

    /// Removes the pictures of the earlier run that this run has not overwritten.
    pub fn remove_earlier(self, quiet: bool) -> Result<(), Failure> {
        let paths: Vec<PathBuf> = self.earlier.iter().map(|name| self.folder.join(name)).collect();
        let stale: Vec<&PathBuf> = paths.iter().filter(|path| path.is_file()).collect();
        for path in &stale {
            std::fs::remove_file(path)
                .with_context(|| format!("cannot remove {}, a picture of an earlier run", path.display()))?;
        }
        if !stale.is_empty() && !quiet {
            log!("note: removed {} picture(s) of an earlier run from {}", stale.len(), self.folder.display());
        }
        Ok(())
    }
}

/// Returns true for a file name that a run gives to a picture. Other files are never removed, even if `run.json` lists
/// them.
fn is_ours(name: &str) -> bool {
    let is_aov = |stem: &str| Aov::ALL.iter().any(|aov| aov.name() == stem);
    let Some((stem, extension)) = name.split_once('.') else { return false };
    let numbered = ["view", "quilt_qs"].into_iter().find_map(|kind| stem.strip_prefix(kind));
    let is_numbered = numbered.is_some_and(|number| number.starts_with(|first: char| first.is_ascii_digit()));
    let is_stem = ["left", "right", "stereo", "anaglyph", "sheet"].contains(&stem) || is_aov(stem) || is_numbered;
    let is_plain = name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'.' || b == b'_');
    is_stem && is_plain && (extension.ends_with("exr") || extension.ends_with("png"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_results_count_as_pictures() {
        for ours in [
            "left.exr",
            "right.0007.exr",
            "left.normal.12345.exr",
            "holes.png",
            "stereo.0000.png",
            "sheet.png",
            "view00.exr",
            "view107.normal.0003.exr",
            "quilt_qs8x6a0.75.png",
            "quilt_qs8x6a1.0001.png",
        ] {
            assert!(is_ours(ours), "{ours}");
        }
        for other in [
            "",
            ".exr",
            "left",
            "notes.txt",
            "holiday.png",
            "../left.exr",
            "left./../a.exr",
            "left.exr.bak",
            "a/left.exr",
            "view.exr",
            "views.png",
            "quilt_qs8/../a.png",
        ] {
            assert!(!is_ours(other), "{other}");
        }
    }
}
