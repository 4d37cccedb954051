//! Pose of a headset in the scene, and late latching of the pose that a frame is shown from.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use diptych::exec::PoseSource;
use diptych::headset::{HeadSample, HeadsetError, HeadsetFrame, Locator, Locomotion};
use diptych::image::Extent;
use diptych::loaded::LoadedScene;
use diptych::scene::head::{HeadPose, Space};
use diptych::scene::optics::{HeadEyes, Optics};
use diptych::scene::rig::Rig;

use super::super::renderer::speed_per_s;
use crate::failure::Failure;

/// Maximum time step of thumbstick locomotion between two frames, seconds.
const LONGEST_STEP_S: f64 = 0.25;

/// Pose of the OpenXR session's reference space in the scene, and the headset's eyes.
#[derive(Clone)]
pub struct Placement {
    shot: Rig,
    pub space: Space,
    eyes: HeadEyes,
    size: Extent,
    /// True if frames need no display resampling, because there is no overscan and the eyes are symmetric. Fixed for
    /// the session.
    is_plain: bool,
    /// Overscan on every side, degrees; 0 turns late reprojection off.
    border_deg: f64,
    locomotion: Locomotion,
    speed_m_per_s: f64,
    before: Option<Instant>,
}

impl Placement {
    /// Sets the rig of the loaded shot to the headset's eyes. Returns the placement of the headset's reference space in
    /// the scene.
    pub fn new(loaded: &mut LoadedScene, eyes: HeadEyes, size: Extent, border_deg: f64) -> Result<Self, Failure> {
        let space = loaded.space.with_eyes(eyes).map_err(HeadsetError::Eyes)?;
        let shot = loaded.shot.rig.clone();
        let speed_m_per_s = speed_per_s(&loaded.scene) * shot.metres_per_unit;
        let locomotion = Locomotion::default();
        let is_plain = border_deg <= 0.0 && space.rig_at(HeadPose::default(), &shot).plain_at(size).optics.is_none();
        let world = Self { shot, space, eyes, size, is_plain, border_deg, locomotion, speed_m_per_s, before: None };
        loaded.space = space;
        loaded.shot.rig = world.rig(HeadPose::default());
        Ok(world)
    }

    fn rig(&self, head: HeadPose) -> Rig {
        let rig = self.space.rig_at(self.locomotion.placed(head), &self.shot);
        if self.is_plain {
            return Rig { optics: None, ..rig };
        }
        if self.border_deg <= 0.0 {
            return rig;
        }
        let bare = || Optics::with_border(&rig, self.size, self.border_deg);
        let optics = Some(rig.optics.map_or_else(bare, |optics| optics.widened(self.border_deg)));
        Rig { optics, ..rig }
    }

    /// Returns the rig of a frame, after thumbstick locomotion and with the frame's eyes, whose distance may have
    /// changed.
    pub fn rig_of(&mut self, frame: &HeadsetFrame) -> Result<Rig, Failure> {
        let (now, is_first) = (Instant::now(), self.before.is_none());
        let passed_s = self.before.replace(now).map_or(0.0, |before| (now - before).as_secs_f64().min(LONGEST_STEP_S));
        self.locomotion.go(frame.head, frame.input.stick, self.speed_m_per_s, passed_s);
        if is_first || frame.input.recentres {
            self.locomotion.recentre(frame.head);
        }
        if frame.eyes != self.eyes {
            self.space = self.space.with_eyes(frame.eyes).map_err(HeadsetError::Eyes)?;
            self.eyes = frame.eyes;
        }
        Ok(self.rig(frame.head))
    }
}

/// Late latching: gives a frame's worker the newest head pose once the rest of the frame is done.
pub struct Late {
    locator: Locator,
    asked: Mutex<Option<Asked>>,
}

struct Asked {
    index: u32,
    frame: HeadsetFrame,
    world: Placement,
    /// The head pose that was latched last.
    answer: Option<HeadSample>,
}

impl Late {
    pub fn new(locator: Locator) -> Arc<Self> {
        Arc::new(Self { locator, asked: Mutex::default() })
    }

    pub fn source(self: &Arc<Self>) -> Arc<PoseSource> {
        let late = Arc::clone(self);
        Arc::new(move |index| late.answer(index))
    }

    /// Begins frame `index`: until [`Self::end`], the pose source answers requests for this frame.
    pub fn begin(&self, index: u32, frame: &HeadsetFrame, world: &Placement) {
        let asked = Asked { index, frame: *frame, world: world.clone(), answer: None };
        *self.asked.lock().unwrap_or_else(PoisonError::into_inner) = Some(asked);
    }

    fn answer(&self, index: u32) -> Option<Rig> {
        let mut asked = self.asked.lock().unwrap_or_else(PoisonError::into_inner);
        let asked = asked.as_mut().filter(|asked| asked.index == index)?;
        let sample = self.locator.head(&asked.frame)?;
        asked.answer = Some(sample);
        Some(asked.world.rig(sample.head))
    }

    /// Ends the frame; returns the head pose that was latched for it, if any.
    pub fn end(&self) -> Option<HeadSample> {
        self.asked.lock().unwrap_or_else(PoisonError::into_inner).take()?.answer
    }
}
