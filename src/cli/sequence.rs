//! `diptych compare` of two folders: a sequence against its reference, frame by frame and from frame to frame.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use diptych::exec::Stereo;
use diptych::image::{RgbImage, exr};
use diptych::metrics::Pair;
use diptych::metrics::temporal::{Change, Surfaces};
use diptych::report::study::{SequenceRow, sequence_table};

use super::failure::Failure;

/// Numbers of the frames, where they are, and how they are shown.
struct Sequence<'a> {
    reference: &'a Path,
    image: &'a Path,
    exposure_ev: f32,
    frames: BTreeSet<u32>,
}

pub fn run(reference: &Path, image: &Path, exposure_ev: f32, json: bool) -> Result<(), Failure> {
    let rows = compare(reference, image, exposure_ev).map_err(Failure::Input)?;
    if json {
        say!("{}", serde_json::to_string(&rows).map_err(anyhow::Error::from)?);
    } else {
        say!("{}", sequence_table(&rows).text().trim_end());
    }
    Ok(())
}

fn compare(reference: &Path, image: &Path, exposure_ev: f32) -> Result<Stereo<SequenceRow>, anyhow::Error> {
    let sequence = Sequence::find(reference, image, exposure_ev)?;
    Ok(Stereo { left: sequence.row("left")?, right: sequence.row("right")? })
}

impl<'a> Sequence<'a> {
    /// Both folders must have the same frames, one after another.
    fn find(reference: &'a Path, image: &'a Path, exposure_ev: f32) -> Result<Self, anyhow::Error> {
        let [of_reference, of_image] = [frames_in(reference)?, frames_in(image)?];
        for (folder, own, other) in [(image, &of_image, &of_reference), (reference, &of_reference, &of_image)] {
            if let Some(&frame) = other.difference(own).next() {
                bail!("there is no {}: render as many --frames", colour(folder, "left", frame).display());
            }
        }
        let few = "frame(s) named as left.0000.exr, and a sequence takes two: render with --frames";
        ensure!(of_image.len() > 1, "{} has {} {few}", image.display(), of_image.len());
        let mut following = of_image.iter().zip(of_image.iter().skip(1));
        if let Some((last, next)) = following.find(|(a, b)| *a + 1 != **b) {
            bail!("{} has no frame between {last} and {next}: frames must follow one another", image.display());
        }
        Ok(Self { reference, image, exposure_ev, frames: of_image })
    }

    fn row(&self, eye: &'static str) -> Result<SequenceRow, anyhow::Error> {
        let mut before: Option<(Pair, Surfaces)> = None;
        let (mut errors, mut changes) = (Vec::new(), Change::default());
        for &frame in &self.frames {
            let now = self.frame(eye, frame).with_context(|| format!("cannot compare frame {frame}, {eye} eye"))?;
            errors.push(now.0.errors());
            if let Some((pair, surfaces)) = &before {
                changes = changes + now.0.change_since(pair, &now.1.history(surfaces)?)?;
            }
            before = Some(now);
        }
        Ok(SequenceRow::new(eye, self.exposure_ev, errors, changes.into()))
    }

    fn frame(&self, eye: &str, frame: u32) -> Result<(Pair, Surfaces), anyhow::Error> {
        let [reference, image] = [self.reference, self.image].map(|folder| exr::read_rgb(&colour(folder, eye, frame)));
        let pair = Pair::new(&reference?, &image?, self.exposure_ev)?;
        // The passes of a reference are of one instant, so that its own motion would be none.
        let aov = |name: &str, channels| -> Result<RgbImage, anyhow::Error> {
            let path = self.image.join(format!("{eye}.{name}.{frame:04}.exr"));
            ensure!(path.is_file(), "there is no {}: render with --aov motion,position,normal", path.display());
            Ok(exr::read_channels(&path, channels)?)
        };
        let xyz = ["X", "Y", "Z"];
        let surfaces = Surfaces::new(aov("motion", ["X", "Y", "Y"])?, aov("position", xyz)?, aov("normal", xyz)?)?;
        Ok((pair, surfaces))
    }
}

fn colour(folder: &Path, eye: &str, frame: u32) -> PathBuf {
    folder.join(format!("{eye}.{frame:04}.exr"))
}

/// Numbers of the left eye's frames.
fn frames_in(folder: &Path) -> Result<BTreeSet<u32>, anyhow::Error> {
    let cannot_read = || format!("cannot read the folder {}", folder.display());
    let mut frames = BTreeSet::new();
    for entry in std::fs::read_dir(folder).with_context(cannot_read)? {
        let name = entry.with_context(cannot_read)?.file_name();
        let number: Option<u32> =
            name.to_str().and_then(|n| n.strip_prefix("left.")?.strip_suffix(".exr")?.parse().ok());
        frames.extend(number);
    }
    Ok(frames)
}
