//! Pictures that an earlier run left in the folder of this one, where they would be taken for this one's.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::ValueEnum;
use serde::Deserialize;
use serde::de::IgnoredAny;

use diptych::passes::Aov;

use super::failure::Failure;
use super::output::SHEET;

/// What a picture shows, as its name says it, and which frame of a sequence it is of.
type Picture = (String, Option<u32>);

/// The pictures of an earlier run that this one has not made anew.
pub struct Stale {
    folder: PathBuf,
    earlier: BTreeMap<Picture, PathBuf>,
}

impl Stale {
    /// What is in `folder` before anything is written there. Without a `run.json` of this program no file is taken for
    /// an earlier picture.
    pub fn find(folder: &Path) -> Self {
        let mut earlier = BTreeMap::new();
        if has_run(folder) {
            let names = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
            earlier.extend(names.filter_map(|path| Some((picture(path.file_name()?.to_str()?)?, path))));
        }
        Self { folder: folder.to_owned(), earlier }
    }

    /// A frame's pictures are written.
    pub fn wrote(&mut self, number: Option<u32>, aovs: &[Aov], anaglyph: bool) {
        let mut shown = vec!["left.exr".to_owned(), "right.exr".to_owned(), "stereo.png".to_owned()];
        shown.extend(anaglyph.then(|| "anaglyph.png".to_owned()));
        for aov in aovs.iter().map(|aov| aov.name()) {
            shown.extend([format!("left.{aov}.exr"), format!("right.{aov}.exr"), format!("{aov}.png")]);
        }
        for what in shown {
            self.earlier.remove(&(what, number));
        }
    }

    /// The contact sheet is written.
    pub fn wrote_sheet(&mut self) {
        self.earlier.remove(&(SHEET.to_owned(), None));
    }

    /// Removes the others, and says how many there were.
    pub fn remove(self, quiet: bool) -> Result<(), Failure> {
        let Self { folder, earlier: stale } = self;
        for path in stale.values() {
            std::fs::remove_file(path)
                .with_context(|| format!("cannot remove {}, a picture of an earlier run", path.display()))?;
        }
        if !stale.is_empty() && !quiet {
            eprintln!("note: removed {} picture(s) of an earlier run from {}", stale.len(), folder.display());
        }
        Ok(())
    }
}

/// Whether the folder has a `run.json` of this program, of a command that writes pictures: `scale` and `bench`, which have
/// `--counts`, write none.
fn has_run(folder: &Path) -> bool {
    /// Members that such a file has. Frames may be those of hours, so they are skipped as they are read.
    #[derive(Deserialize)]
    struct Run {
        #[serde(rename = "version")]
        _version: IgnoredAny,
        #[serde(rename = "command")]
        _command: IgnoredAny,
        #[serde(rename = "devices")]
        _devices: IgnoredAny,
        #[serde(rename = "scene")]
        _scene: IgnoredAny,
        #[serde(rename = "frames")]
        _frames: IgnoredAny,
        settings: serde_json::Map<String, serde_json::Value>,
    }
    let file = File::open(folder.join("run.json")).ok().map(BufReader::new);
    let run: Option<Run> = file.and_then(|file| serde_json::from_reader(file).ok());
    run.is_some_and(|run| !run.settings.contains_key("counts"))
}

/// What `left.0007.exr` shows, `left.exr`, and that it is of frame 7; none of a name that this program does not give.
fn picture(name: &str) -> Option<Picture> {
    let is_aov = |name: &str| Aov::value_variants().iter().find(|aov| aov.name() == name);
    let (stem, extension) = name.rsplit_once('.')?;
    let (what, number) = match stem.rsplit_once('.') {
        Some((what, digits)) if digits.bytes().all(|b| b.is_ascii_digit()) => {
            let number = digits.parse().ok().filter(|n: &u32| format!("{n:04}") == digits)?;
            (what, Some(number))
        }
        _ => (stem, None),
    };
    let is_ours = match (what.split_once('.'), extension) {
        (None, "exr") => matches!(what, "left" | "right"),
        (Some((eye, aov)), "exr") => matches!(eye, "left" | "right") && is_aov(aov).is_some(),
        (None, "png") => {
            matches!(what, "stereo" | "anaglyph" | "sheet") || is_aov(what).is_some_and(|aov| aov.counts())
        }
        _ => false,
    };
    is_ours.then(|| (format!("{what}.{extension}"), number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_that_the_program_gives_are_pictures_of_it() {
        let is = |name: &str, what: &str, number| assert_eq!(picture(name), Some((what.to_owned(), number)), "{name}");
        is("left.exr", "left.exr", None);
        is("right.0007.exr", "right.exr", Some(7));
        is("left.normal.12345.exr", "left.normal.exr", Some(12345));
        is("right.base_color.exr", "right.base_color.exr", None);
        is("sheet.png", "sheet.png", None);
        is("stereo.0000.png", "stereo.png", Some(0));
        is("holes.png", "holes.png", None);
        for other in [
            "left.png",
            "stereo.exr",
            "left.7.exr",
            "left.00007.exr",
            "left.-001.exr",
            "left.mine.exr",
            "normal.png",
            "left.exr.bak",
            "left",
            ".exr",
            "",
            "left..exr",
            "my.left.0000.exr",
            "LEFT.exr",
            "left.0000.0000.exr",
        ] {
            assert_eq!(picture(other), None, "{other}");
        }
    }
}
