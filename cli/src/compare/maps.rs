//! Maps of errors: pictures with fixed names in the folder of `--maps`.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use diptych::image::display::{DisplayImage, write_png};

use crate::failure::Failure;

/// Names of maps, in the order in which they are reported.
pub const ERROR: &str = "error.png";
pub const FLIP: &str = "flip.png";
pub const KIND: &str = "kind.png";
pub const RIVALRY: &str = "rivalry.png";

/// A map's name and picture, or the reason why it cannot be drawn.
pub type Map = (&'static str, Result<DisplayImage, String>);

/// Writes maps into a folder, each under its name once it is whole, and returns the names. `inputs` are files that must
/// not be replaced.
pub fn write<'a>(
    folder: &Path,
    maps: &[Map],
    inputs: impl Iterator<Item = &'a PathBuf>,
) -> Result<Vec<&'static str>, Failure> {
    let inputs: Vec<PathBuf> = inputs.filter_map(|path| path.canonicalize().ok()).collect();
    let drawn = || maps.iter().filter_map(|(name, map)| Some((*name, map.as_ref().ok()?)));
    for (name, _) in drawn() {
        if folder.join(name).canonicalize().is_ok_and(|path| inputs.contains(&path)) {
            let folder = folder.display();
            let error = anyhow!("--maps {folder}: {name} there is compared and would be lost: give another folder");
            return Err(Failure::Input(error));
        }
    }
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot write into '{}': choose another --maps", folder.display()))?;
    drawn().map(|(name, map)| Ok(write_png(&folder.join(name), map).map(|()| name)?)).collect()
}

/// Prints the written maps, and why the others are missing.
pub fn say(folder: &Path, maps: &[Map], written: &[&str]) {
    say!("maps in {}: {}", folder.display(), written.join(", "));
    for (name, reason) in maps.iter().filter_map(|(name, map)| Some((name, map.as_ref().err()?))) {
        say!("{name} is not written: {reason}");
    }
}
