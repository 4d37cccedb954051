//! `diptych compare` of two folders: a sequence against its reference, per frame and between consecutive frames.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::exec::Stereo;
use crate::image::{RgbImage, exr};
use crate::metrics::temporal::{Change, Surfaces};
use crate::metrics::{MEASURES, Pair};
use crate::report::study::{SequenceRow, sequence_table};
use anyhow::{Context, bail, ensure};

use super::viewing::{Sourced, differences, source_note};
use crate::cli::failure::Failure;

/// Names and meanings of the measures that only sequences have.
pub const SEQUENCE_MEASURES: [(&str, &str); 3] = [
    ("flicker", "mean change of a surface's error from one frame to the next; 0 is best"),
    ("ghosting", "RMSE of newly seen surfaces over that of all others; above 1 may be trails"),
    ("new_share", "fraction of surface pixels that are newly seen"),
];

/// A sequence and its reference: their folders, exposure and frame numbers.
struct Sequence<'a> {
    reference: &'a Path,
    image: &'a Path,
    exposure: Sourced<f32>,
    frames: BTreeSet<u32>,
}

/// Compares two sequences and prints the measures. `exposure_ev` is the value of --exposure, in stops.
pub fn run(reference: &Path, image: &Path, exposure_ev: Option<f32>, json: bool) -> Result<(), Failure> {
    let sequence = Sequence::find(reference, image, exposure_ev).map_err(Failure::Input)?;
    let row = |eye| sequence.row(eye).map_err(Failure::Input);
    let rows = Stereo { left: row("left")?, right: row("right")? };
    if json {
        say!("{}", serde_json::to_string(&rows).map_err(anyhow::Error::from)?);
        return Ok(());
    }
    say!("{}\n", sequence_table(&rows).text().trim_end());
    let exposure = ("exposure_ev", source_note(sequence.exposure.source));
    let shown = MEASURES.into_iter().filter(|(name, _)| ["relmse", "psnr", "flip", "mean_ratio"].contains(name));
    for (name, meaning) in [exposure].into_iter().chain(shown).chain(SEQUENCE_MEASURES) {
        if !meaning.is_empty() {
            say!("{name:<12} {meaning}");
        }
    }
    Ok(())
}

impl<'a> Sequence<'a> {
    /// Finds the frames of both folders, which must have the same consecutive numbers.
    fn find(reference: &'a Path, image: &'a Path, exposure_ev: Option<f32>) -> Result<Self, anyhow::Error> {
        let [of_reference, of_image] = [frames_in(reference)?, frames_in(image)?];
        for (folder, own, other) in [(image, &of_image, &of_reference), (reference, &of_reference, &of_image)] {
            if let Some(&frame) = other.difference(own).next() {
                bail!("there is no {}: render both with the same --frames", colour(folder, "left", frame).display());
            }
        }
        let few = "frame(s) named like left.0000.exr, but a sequence needs two: render with --frames, or name \
                   folders that both have left.exr and right.exr";
        ensure!(of_image.len() > 1, "{} has {} {few}", image.display(), of_image.len());
        let mut following = of_image.iter().zip(of_image.iter().skip(1));
        if let Some((last, next)) = following.find(|(a, b)| *a + 1 != **b) {
            bail!("{} has no frame between {last} and {next}: frame numbers must be consecutive", image.display());
        }
        let first = of_image.first().copied().unwrap_or_default();
        let tags = |folder| Ok::<_, anyhow::Error>(exr::read_colour(&colour(folder, "left", first))?.tags);
        let exposure = Sourced::exposure(exposure_ev, &tags(reference)?, &tags(image)?);
        Ok(Self { reference, image, exposure, frames: of_image })
    }

    fn row(&self, eye: &'static str) -> Result<SequenceRow, anyhow::Error> {
        let mut before: Option<(Pair, Surfaces)> = None;
        let (mut errors, mut changes) = (Vec::new(), Change::default());
        let mut has_warned = false;
        for &frame in &self.frames {
            let (now, warnings) =
                self.frame(eye, frame).with_context(|| format!("cannot compare frame {frame}, {eye} eye"))?;
            // Most frames share their warnings, so report only those of the first frame that has some.
            if !has_warned {
                warnings.iter().for_each(|warning| eprintln!("warning: frame {frame}, {eye} eye: {warning}"));
            }
            has_warned |= !warnings.is_empty();
            errors.push(now.0.errors());
            if let Some((pair, surfaces)) = &before {
                changes = changes + now.0.change_since(pair, &now.1.history(surfaces)?)?;
            }
            before = Some(now);
        }
        Ok(SequenceRow::new(eye, self.exposure.value, errors, changes.into()))
    }

    /// Reads a frame of an eye with its surfaces, and lists contradictions between the files' metadata.
    fn frame(&self, eye: &str, frame: u32) -> Result<((Pair, Surfaces), Vec<String>), anyhow::Error> {
        let read = |folder: &Path| exr::read_colour(&colour(folder, eye, frame));
        let (reference, image) = (read(self.reference)?, read(self.image)?);
        let pair = Pair::new(&reference.image, &image.image, self.exposure.value)?;
        // Read the auxiliary images from the image's folder, not the reference's: all passes of a reference are at one
        // instant, so its motion vectors would be zero.
        let aov = |name: &str, channels| -> Result<RgbImage, anyhow::Error> {
            let path = self.image.join(format!("{eye}.{name}.{frame:04}.exr"));
            ensure!(path.is_file(), "there is no {}: render with --aov motion,position,normal", path.display());
            Ok(exr::read_channels(&path, channels)?)
        };
        let xyz = ["X", "Y", "Z"];
        let mut surfaces = Surfaces::new(aov("motion", ["X", "Y", "Y"])?, aov("position", xyz)?, aov("normal", xyz)?)?;
        // Only dynamic scenes need the surfaces' positions in the previous frame.
        if self.image.join(format!("{eye}.last_position.{frame:04}.exr")).is_file() {
            surfaces = surfaces.with_last_position(aov("last_position", xyz)?)?;
        }
        Ok(((pair, surfaces), differences(&reference.tags, &image.tags)))
    }
}

fn colour(folder: &Path, eye: &str, frame: u32) -> PathBuf {
    folder.join(format!("{eye}.{frame:04}.exr"))
}

/// Returns the frame numbers of the left eye's files.
pub fn frames_in(folder: &Path) -> Result<BTreeSet<u32>, anyhow::Error> {
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
