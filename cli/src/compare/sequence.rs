//! `diptych compare` of two folders: a sequence against its reference, per frame and between consecutive frames.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::report::statistics::mean_of_some;
use crate::report::study::{SequenceRow, sequence_table};
use crate::report::{cell, text_table};
use anyhow::{Context, anyhow, bail, ensure};
use diptych::exec::PerView;
use diptych::image::exr::{self, Tags};
use diptych::metrics::rivalry::{Differences, RIVALRY_MEASURES, Rivalry};
use diptych::metrics::surfaces::{Sighting, Surfaces};
use diptych::metrics::temporal::{Change, MovingSurfaces};
use diptych::metrics::{Errors, MEASURES, Pair};
use diptych::scene::rig::Eye;
use serde::Serialize;

use super::rivalry::{View, neighbours};
use super::rows::{Values, mean};
use super::viewing::{Source, differences, source_note};
use super::views::{FolderViews, name};
use super::{Comparison, aovs, rivalry, viewing};
use crate::failure::Failure;

/// Names and meanings of the measures that only sequences have.
pub const SEQUENCE_MEASURES: [(&str, &str); 3] = [
    ("flicker", "mean change of a surface's error from one frame to the next; 0 is best"),
    ("ghosting", "RMSE of newly seen surfaces over that of all others; above 1 may be trails"),
    ("new_share", "fraction of surface pixels that are newly seen"),
];

pub const RIVALRY_FLICKER: (&str, &str) =
    ("rivalry_flicker", "mean change of the eyes' difference from one frame to the next; 0 is best");

/// A sequence and its reference: their folders, exposure and frame numbers.
struct Sequence<'a> {
    reference: &'a Path,
    image: &'a Path,
    exposure_ev: f32,
    exposure_source: Source,
    frames: &'a BTreeSet<u32>,
    eyes: Vec<Eye>,
}

/// True if two folders are compared as sequences: both have at least two numbered frames, or neither has images without
/// frame numbers.
pub fn is_sequence(folders: [&FolderViews; 2]) -> bool {
    folders.iter().all(|folder| folder.frames.len() > 1) || folders.iter().all(|folder| !folder.has_stills)
}

/// Compares two sequences of these views, prints the measures, and returns their means over views and frames.
pub fn run(comparison: &Comparison<'_>, folders: [&FolderViews; 2], eyes: Vec<Eye>) -> Result<Values, Failure> {
    let Comparison { args, image, .. } = comparison;
    let sequence = Sequence::find([&args.reference, image], folders, eyes, args.exposure).map_err(Failure::Input)?;
    let results = sequence.results().map_err(Failure::Input)?;
    comparison.finish(&results, || Ok(Vec::new()), || print(&sequence, &results))?;
    let rows = || results.rows.iter();
    let means = MEASURES.iter().map(|(name, _)| (*name, mean(rows().map(|row| row.mean.get(name)))));
    let changes = |row: &SequenceRow| [row.temporal.flicker, row.temporal.ghosting, row.temporal.new_share];
    let changes =
        SEQUENCE_MEASURES.iter().enumerate().map(|(i, (name, _))| (*name, mean(rows().map(|row| changes(row)[i]))));
    let rivalry = RIVALRY_MEASURES.iter().map(|(name, _)| *name).zip(results.rivalry.values());
    Ok(means.chain(changes).chain(rivalry).chain([(RIVALRY_FLICKER.0, results.rivalry_flicker)]).collect())
}

fn print(sequence: &Sequence<'_>, results: &Results) {
    say!("{}\n", sequence_table(&results.rows).text().trim_end());
    let values = results.rivalry.values().into_iter().chain([results.rivalry_flicker]);
    let rivalry: Vec<_> = RIVALRY_MEASURES.into_iter().chain([RIVALRY_FLICKER]).zip(values).collect();
    let row = rivalry.iter().map(|(_, value)| cell(*value, 6)).collect();
    say!("{}\n", text_table(&rivalry.iter().map(|((name, _), _)| *name).collect::<Vec<_>>(), &[row]).trim_end());
    let exposure = ("exposure_ev", source_note(sequence.exposure_source));
    let shown = MEASURES.into_iter().filter(|(name, _)| ["relmse", "psnr", "flip", "mean_ratio"].contains(name));
    for (name, meaning) in
        [exposure].into_iter().chain(shown).chain(SEQUENCE_MEASURES).chain(RIVALRY_MEASURES).chain([RIVALRY_FLICKER])
    {
        if !meaning.is_empty() {
            say!("{name:<15} {meaning}");
        }
    }
}

impl<'a> Sequence<'a> {
    /// Finds the frames of both folders, which must have the same consecutive numbers.
    fn find(
        [reference, image]: [&'a Path; 2],
        folders: [&'a FolderViews; 2],
        eyes: Vec<Eye>,
        exposure_ev: Option<f32>,
    ) -> Result<Self, anyhow::Error> {
        let [of_reference, of_image] = folders.map(|folder| &folder.frames);
        for (folder, own, other) in [(image, of_image, of_reference), (reference, of_reference, of_image)] {
            if let Some(&frame) = other.difference(own).next() {
                bail!("there is no {}: render both with the same --frames", colour(folder, eyes[0], frame).display());
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
        let tags = |folder| Ok::<_, anyhow::Error>(exr::read_colour(&colour(folder, eyes[0], first))?.tags);
        let (exposure_ev, exposure_source) = viewing::exposure_ev(exposure_ev, &tags(reference)?, &tags(image)?);
        Ok(Self { reference, image, exposure_ev, exposure_source, frames: of_image, eyes })
    }

    /// Compares all views frame by frame.
    fn results(&self) -> Result<Results, anyhow::Error> {
        let mut views: Vec<_> = self.eyes.iter().map(|eye| ViewSums::new(*eye)).collect();
        let (mut rivalries, mut flickers) = (Vec::new(), Vec::new());
        // Differences between neighbours in the frame before.
        let mut before: Vec<Option<Differences>> = Vec::new();
        for &frame in self.frames {
            let mut histories = Vec::new();
            for view in &mut views {
                let now = self.frame(view.eye, frame);
                let now = now.with_context(|| format!("cannot compare frame {frame}, {}", name(view.eye)))?;
                histories.push(view.add(frame, now)?);
            }
            let shown: Vec<_> = views.iter().flat_map(|view| &view.before).map(ViewFrame::view).collect();
            let found: Vec<_> = neighbours(&shown).map(rivalry::differences).collect::<Result<_, _>>()?;
            for ((now, before), history) in found.iter().zip(&before).zip(&histories) {
                if let Some(((now, before), history)) = now.as_ref().zip(before.as_ref()).zip(history.as_ref()) {
                    flickers.extend(now.flicker(before, history));
                }
            }
            let of_pair = |found: &Option<Differences>| found.as_ref().map(Differences::rivalry).unwrap_or_default();
            rivalries.extend(found.iter().map(of_pair));
            before = found;
        }
        let row = |view: ViewSums| SequenceRow::new(view.eye, self.exposure_ev, view.errors, view.changes.into());
        let rows = views.into_iter().map(row).collect();
        Ok(Results { rows, rivalry: Rivalry::mean_of(&rivalries), rivalry_flicker: mean_of_some(flickers) })
    }

    /// Reads a frame of a view with its surfaces, and lists contradictions between the files' metadata.
    fn frame(&self, eye: Eye, frame: u32) -> Result<ViewFrame, anyhow::Error> {
        let read = |folder: &Path| exr::read_colour(&colour(folder, eye, frame));
        let (reference, image) = (read(self.reference)?, read(self.image)?);
        let pair = Pair::new(&reference.image, &image.image, self.exposure_ev)?;
        // Read the auxiliary images from the image's folder, not the reference's: all passes of a reference are at one
        // instant, so its motion vectors would be zero.
        let path = colour(self.image, eye, frame);
        let missing = |name: &str| {
            let file = aovs::beside(&path, name);
            anyhow!("there is no {}: render with --aov motion,position,normal", file.display())
        };
        let motion = aovs::read(&path, "motion", ["X", "Y", "Y"])?.ok_or_else(|| missing("motion"))?;
        let xyz = |name: &str| aovs::read(&path, name, ["X", "Y", "Z"])?.ok_or_else(|| missing(name));
        let (position, normal) = (xyz("position")?, xyz("normal")?);
        let mut surfaces = MovingSurfaces::new(Surfaces::new(position.image, normal.image)?, motion.image)?;
        // Only dynamic scenes need the surfaces' positions in the previous frame.
        if let Some(last_position) = aovs::read(&path, "last_position", ["X", "Y", "Z"])? {
            surfaces = surfaces.with_last_position(last_position.image)?;
        }
        let warnings = differences(&reference.tags, &image.tags);
        Ok(ViewFrame { pair, surfaces, shown: rivalry::shown(&path)?, tags: position.tags, warnings })
    }
}

/// A frame of a view.
struct ViewFrame {
    pair: Pair,
    surfaces: MovingSurfaces,
    /// Surfaces that mirrors and glass show, if auxiliary images tell them.
    shown: Option<Surfaces>,
    /// Metadata of the auxiliary images.
    tags: Tags,
    warnings: Vec<String>,
}

impl ViewFrame {
    fn view(&self) -> View<'_> {
        let Self { pair, surfaces, shown, tags, .. } = self;
        View { pair, surfaces: surfaces.surfaces(), shown: shown.as_ref(), tags }
    }
}

/// Errors of a view's frames so far.
struct ViewSums {
    eye: Eye,
    before: Option<ViewFrame>,
    errors: Vec<Errors>,
    changes: Change,
    has_warned: bool,
}

impl ViewSums {
    fn new(eye: Eye) -> Self {
        Self { eye, before: None, errors: Vec::new(), changes: Change::default(), has_warned: false }
    }

    /// Adds a frame. Returns where the previous one shows its surfaces.
    fn add(&mut self, frame: u32, now: ViewFrame) -> Result<Option<Vec<Sighting>>, anyhow::Error> {
        // Most frames share their warnings, so report only those of the first frame that has some.
        if !self.has_warned {
            now.warnings.iter().for_each(|warning| log!("warning: frame {frame}, {}: {warning}", name(self.eye)));
        }
        self.has_warned |= !now.warnings.is_empty();
        self.errors.push(now.pair.errors());
        let history = self.before.as_ref().map(|before| now.surfaces.history(&before.surfaces)).transpose()?;
        if let Some((before, history)) = self.before.as_ref().zip(history.as_ref()) {
            self.changes = self.changes + now.pair.change_since(&before.pair, history)?;
        }
        self.before = Some(now);
        Ok(history)
    }
}

/// Results of a sequence, as printed by `--json`.
#[derive(Serialize)]
struct Results {
    #[serde(flatten)]
    rows: PerView<SequenceRow>,
    /// Means over neighbouring views and frames.
    #[serde(flatten)]
    rivalry: Rivalry,
    rivalry_flicker: Option<f64>,
}

fn colour(folder: &Path, eye: Eye, frame: u32) -> PathBuf {
    folder.join(format!("{}.{frame:04}.exr", eye.file_stem()))
}
