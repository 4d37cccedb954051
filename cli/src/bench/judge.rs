//! Measures how well a setting renders consecutive frames of a static camera: their errors against a reference, and
//! flicker.

use crate::report::bench::{KindColumns, Measured, Repeat, SeenErrors, Timed};
use crate::report::frames::FrameLine;
use crate::report::run::FrameRow;
use diptych::exec::{FrameReport, PerView};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;
use diptych::metrics::Pair;
use diptych::metrics::rings::Viewing;
use diptych::metrics::rivalry::Differences;
use diptych::scene::shot::Shot;

use super::reference::Reference;
use crate::failure::Failure;

/// Pairs the image of each eye with its reference. `right` holds the references of both eyes: the right (correct)
/// images, not those of the right eye.
pub fn pairs(loaded: &LoadedScene, right: &PerView<RgbImage>, image: &PerView<RgbImage>) -> Result<[Pair; 2], Failure> {
    let exposure_ev = loaded.shot.exposure_ev;
    Ok([Pair::new(right.left(), image.left(), exposure_ev)?, Pair::new(right.right(), image.right(), exposure_ev)?])
}

pub struct Judge<'a> {
    loaded: &'a LoadedScene,
    reference: &'a Reference,
    viewing: Viewing,
    repeats: Vec<Repeat>,
    before: Option<[Pair; 2]>,
}

impl<'a> Judge<'a> {
    /// Creates a judge of frames at the scene time `time_s`, in seconds, which determines the gaze.
    pub fn new(loaded: &'a LoadedScene, reference: &'a Reference, time_s: f64) -> Self {
        let Shot { gaze, rig, .. } = &loaded.shot;
        let viewing = Viewing { gaze: gaze.at(time_s), yfov_deg: rig.yfov_rad.to_degrees() };
        Self { loaded, reference, viewing, repeats: Vec::new(), before: None }
    }

    /// Adds the next frame: its report, its row for frames.csv and its linear image.
    pub fn add(&mut self, frame: &FrameReport, row: &FrameRow, image: &PerView<RgbImage>) -> Result<(), Failure> {
        let pairs = pairs(self.loaded, &self.reference.images, image)?;
        let mut eyes = [&pairs[0], &pairs[1]].map(|pair| SeenErrors::new(pair, &self.viewing));
        for (e, map) in self.reference.kinds.iter().flatten().enumerate() {
            eyes[e].by_kind = KindColumns(Some(pairs[e].by_kind(map)?));
        }
        if let Some(in_right) = &self.reference.in_right {
            let rivalry = Some(Differences::new(&pairs[0], &pairs[1], in_right)?.rivalry());
            eyes.iter_mut().for_each(|eye| eye.rivalry = rivalry);
        }
        let [left, right] = eyes;
        let change = |[left, right]: &[Pair; 2]| -> Result<_, Failure> {
            Ok(PerView::both(pairs[0].change_at_rest(left)?, pairs[1].change_at_rest(right)?))
        };
        let change = self.before.as_ref().map(change).transpose()?;
        let timed = Timed::new(frame, FrameLine::from(row));
        self.repeats.push(Repeat { timed, errors: PerView::both(left, right), change });
        self.before = Some(pairs);
        Ok(())
    }

    /// Returns the image of each eye in the last frame, paired with its reference; `None` before the first frame.
    pub fn last(&self) -> Option<&[Pair; 2]> {
        self.before.as_ref()
    }

    pub fn conclude(self) -> Measured {
        Measured::of(&self.repeats)
    }
}
