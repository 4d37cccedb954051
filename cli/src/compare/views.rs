//! Views of the images in a folder, by the names of its files.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Error, ensure};
use diptych::scene::rig::Eye;

/// Images of views in a folder.
#[derive(Debug, Default, PartialEq)]
pub struct FolderViews {
    /// Number of views; `None` if the folder has no image of a view.
    count: Option<usize>,
    /// True if there are images without frame numbers.
    pub has_stills: bool,
    /// Frame numbers of the leftmost view's images.
    pub frames: BTreeSet<u32>,
}

impl FolderViews {
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let cannot_read = || format!("cannot read the folder {}", folder.display());
        let mut names = Vec::new();
        for entry in std::fs::read_dir(folder).with_context(cannot_read)? {
            names.extend(entry.with_context(cannot_read)?.file_name().into_string());
        }
        Ok(Self::of_names(names.iter().map(String::as_str)))
    }

    /// Finds views in the names of files. Two eyes take precedence over images named `view00`, `view01`, ….
    fn of_names<'a>(names: impl Iterator<Item = &'a str>) -> Self {
        let images: Vec<(&str, Option<u32>)> = names.filter_map(image).collect();
        let is_of_eyes = images.iter().any(|(stem, _)| numbered(stem).is_none());
        let count = match is_of_eyes {
            true => Some(2),
            false => images.iter().filter_map(|(stem, _)| numbered(stem)).max().map(|last| last + 1),
        };
        let own = || images.iter().filter(|(stem, _)| numbered(stem).is_none() == is_of_eyes);
        let frames = own().filter(|(stem, _)| ["left", "view00"].contains(stem)).filter_map(|(_, frame)| *frame);
        Self { count, has_stills: own().any(|(_, frame)| frame.is_none()), frames: frames.collect() }
    }
}

/// Returns the view and the frame number of an image's file, such as `left.exr` or `view07.0012.exr`.
fn image(name: &str) -> Option<(&str, Option<u32>)> {
    let (stem, rest) = name.split_once('.')?;
    let is_view = ["left", "right"].contains(&stem) || numbered(stem).is_some();
    let frame = if rest == "exr" { None } else { Some(rest.strip_suffix(".exr")?.parse().ok()?) };
    is_view.then_some((stem, frame))
}

/// Returns the number of a view that is none of two eyes.
fn numbered(stem: &str) -> Option<usize> {
    let digits = stem.strip_prefix("view").filter(|digits| digits.len() == 2)?;
    digits.parse().ok()
}

/// Returns the views of two folders, of which both must have as many; two eyes if neither folder has any.
pub fn common(folders: [&Path; 2], found: [&FolderViews; 2]) -> Result<Vec<Eye>, Error> {
    let [reference, image] = found.map(|found| found.count);
    if let Some((of_reference, of_image)) = reference.zip(image) {
        let [reference, image] = folders.map(Path::display);
        let hint = "render both with the same --views";
        ensure!(of_reference == of_image, "{reference} has {of_reference} view(s) and {image} has {of_image}: {hint}");
    }
    Ok(Eye::of_rig(reference.or(image).unwrap_or(2)).collect())
}

/// Returns the name of a view in messages.
pub fn name(eye: Eye) -> String {
    if eye.views() == 2 { format!("{eye} eye") } else { eye.file_stem() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_are_found_by_the_names_of_files() {
        for (names, count, has_stills, frames) in [
            ("left.exr right.exr left.depth.exr left.png", Some(2), true, &[][..]),
            ("left.0000.exr right.0000.exr left.0001.exr right.0007.exr", Some(2), false, &[0, 1]),
            ("view00.exr view01.exr view02.exr view07.depth.exr", Some(3), true, &[]),
            ("view00.0004.exr view03.0004.exr view03.0005.exr", Some(4), false, &[4]),
            ("right.exr view00.0001.exr view08.exr", Some(2), true, &[]),
            ("view0.exr view000.exr viewab.exr left.mine.0001.exr run.json", None, false, &[]),
        ] {
            let found = FolderViews::of_names(names.split(' '));
            let frames = frames.iter().copied().collect();
            assert_eq!(found, FolderViews { count, has_stills, frames }, "{names}");
        }
    }
}
