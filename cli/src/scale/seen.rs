//! The page of `diptych scale`: the last picture, and a frame of each count.

use crate::failure::Failure;
use crate::output::same_bits;
use crate::page;
use crate::report::html::Section;
use crate::report::lanes::LaneFrame;
use crate::report::pictures::Group;
use crate::report::scale::ScaleRow;
use diptych::exec::{FrameReport, PerView};
use diptych::image::RgbImage;
use diptych::loaded::LoadedScene;

/// Pictures and frames for the page.
#[derive(Default)]
pub struct Seen {
    /// The last frame on one device.
    picture: Option<PerView<RgbImage>>,
    /// For each further measurement, true if its last frame has the same bytes as `picture`; `None` if it has another
    /// size.
    same_bytes: Vec<Option<bool>>,
    /// A frame of median makespan for each row.
    frames: Vec<FrameReport>,
}

impl Seen {
    pub fn add(&mut self, picture: Option<PerView<RgbImage>>, frame: Option<FrameReport>) {
        self.frames.extend(frame);
        match (&self.picture, picture) {
            (Some(first), Some(picture)) => {
                let is_alike = first.left().extent == picture.left().extent;
                self.same_bytes.push(is_alike.then(|| same_bits(first, &picture)));
            }
            (None, picture) => self.picture = picture,
            (Some(_), None) => {}
        }
    }

    pub fn pictures(&self, loaded: &LoadedScene) -> Result<Option<Section>, Failure> {
        let Some(picture) = &self.picture else { return Ok(None) };
        let bytes = match &self.same_bytes[..] {
            [] => "Only one count was measured.",
            same if same.contains(&None) => "Counts have different sizes.",
            same if same.iter().all(|same| *same == Some(true)) => "All counts gave the same bytes.",
            _ => "Not all counts gave the same bytes.",
        };
        let note = format!("The last frame of one device. {bytes}");
        let frame = Group::of_frame("last frame".into(), picture, loaded.shot.exposure_ev);
        page::pictures(note, &[frame]).map(Some)
    }

    pub fn swimlanes(&self, rows: &[ScaleRow]) -> Result<Section, Failure> {
        let name = |row: &ScaleRow| format!("{} device(s), {}", row.devices, row.policy);
        let frames = rows.iter().zip(&self.frames);
        let frames: Vec<LaneFrame> = frames.map(|(row, frame)| LaneFrame::new(name(row), frame)).collect();
        let note = "A frame of median makespan for each count and policy.";
        page::swimlanes(note.to_owned(), &frames, frames.len().saturating_sub(1), None)
    }
}
