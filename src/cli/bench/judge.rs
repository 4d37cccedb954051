//! A setting judged by what a viewer sees: frames that follow one another while the camera rests, against a reference.

use crate::exec::{FrameReport, Stereo};
use crate::image::RgbImage;
use crate::loaded::LoadedScene;
use crate::metrics::Pair;
use crate::metrics::rings::Viewing;
use crate::metrics::temporal::Change;
use crate::report::bench::{Measured, Repeat, SeenErrors};
use crate::report::frames::FrameLine;
use crate::report::run::FrameRow;
use crate::scene::shot::Shot;

use super::reference::Reference;
use crate::cli::failure::Failure;

/// Each eye's picture with what it is held against.
pub fn pairs(loaded: &LoadedScene, right: &Stereo<RgbImage>, image: &Stereo<RgbImage>) -> Result<[Pair; 2], Failure> {
    let exposure_ev = loaded.shot.exposure_ev;
    Ok([Pair::new(&right.left, &image.left, exposure_ev)?, Pair::new(&right.right, &image.right, exposure_ev)?])
}

pub struct Judge<'a> {
    loaded: &'a LoadedScene,
    reference: &'a Reference,
    viewing: Viewing,
    repeats: Vec<Repeat>,
    /// Of each eye, between the frames so far.
    changes: [Change; 2],
    before: Option<[Pair; 2]>,
}

impl<'a> Judge<'a> {
    /// Of frames at `time_s`.
    pub fn new(loaded: &'a LoadedScene, reference: &'a Reference, time_s: f64) -> Self {
        let Shot { gaze, rig, .. } = &loaded.shot;
        let viewing = Viewing { gaze: gaze.at(time_s), yfov_deg: rig.yfov_rad.to_degrees() };
        Self { loaded, reference, viewing, repeats: Vec::new(), changes: Default::default(), before: None }
    }

    /// Takes the next frame in, with its row and its picture.
    pub fn add(&mut self, frame: &FrameReport, row: &FrameRow, image: &Stereo<RgbImage>) -> Result<(), Failure> {
        let pairs = pairs(self.loaded, &self.reference.images, image)?;
        let [left, right] = [&pairs[0], &pairs[1]].map(|pair| SeenErrors::new(pair, &self.viewing));
        self.repeats.push(Repeat::new(frame, Stereo { left, right }, FrameLine::from(row)));
        for (e, before) in self.before.iter().flatten().enumerate() {
            self.changes[e] = self.changes[e] + pairs[e].change_at_rest(before)?;
        }
        self.before = Some(pairs);
        Ok(())
    }

    /// The frames that follow are of another view, with a reference of its own.
    pub fn turn_to(&mut self, reference: &'a Reference) {
        (self.reference, self.before) = (reference, None);
    }

    /// The eyes of the last frame with what they are held against.
    pub fn last(&self) -> Option<&[Pair; 2]> {
        self.before.as_ref()
    }

    pub fn conclude(self) -> Measured {
        let [left, right] = self.changes;
        Measured::of(&self.repeats, Stereo { left, right })
    }
}
