//! State that the window and the renderer's thread share. Neither waits for the other; new values replace old ones.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use diptych::exec::PerView;
use diptych::image::Image;
use diptych::quality::FrameQuality;

/// Number of recent frames kept for the plot.
const REMEMBERED: usize = 120;

pub type EyeImages = PerView<Image<[u8; 4]>>;

#[derive(Default)]
pub struct Shared {
    input: Mutex<Input>,
    output: Mutex<Output>,
    ends: AtomicBool,
}

/// User input at the window.
#[derive(Clone, Debug, Default)]
pub struct Input {
    /// Movement to the right, up and ahead, each −1 to 1, while keys are held.
    pub moves: [f64; 3],
    /// Rotation to the right and up, each −1 to 1, while keys are held.
    pub turns: [f64; 2],
    /// Mouse rotation to the right and up since the last [`Shared::take_input`], radians.
    pub dragged_rad: [f64; 2],
    pub is_fast: bool,
    /// Gaze as fractions of an eye's image from the top left.
    pub gaze: Option<[f64; 2]>,
    /// True if the camera is to join or leave the shot's path; [`Shared::take_input`] resets it.
    pub toggles_path: bool,
}

/// Newest results of the renderer's thread.
#[derive(Default)]
struct Output {
    picture: Option<EyeImages>,
    status: Status,
}

/// Data that the overlay shows.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Recent frames, the oldest first.
    pub frames: VecDeque<FrameStatus>,
    pub count: u64,
    pub in_band: u64,
    pub rungs: usize,
    pub follows_path: bool,
    /// Time from the sampling of a frame's pose to the return of the call that presented it, of the last frame that was
    /// presented, ms.
    pub presented_after_ms: Option<f64>,
    /// Exposure of the last frame in stops, if it is metered.
    pub metered_ev: Option<f32>,
    /// For each eye, the radii of the inner and middle foveal layers, and the gaze point, in pixels of the eye's image.
    pub circles: Option<[([f64; 2], [f64; 2]); 2]>,
}

#[derive(Clone, Debug)]
pub struct FrameStatus {
    /// When the frame's pose was sampled, and when the frame was complete.
    pub posed: Instant,
    pub at: Instant,
    pub makespan_ms: f64,
    pub in_band: bool,
    pub rung: usize,
    pub quality: FrameQuality,
    /// Rows per device.
    pub stripes: Vec<u32>,
}

impl Status {
    pub fn add(&mut self, frame: FrameStatus) {
        self.count += 1;
        self.in_band += u64::from(frame.in_band);
        if self.frames.len() == REMEMBERED {
            self.frames.pop_front();
        }
        self.frames.push_back(frame);
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub fn change_input(&self, change: impl FnOnce(&mut Input)) {
        change(&mut locked(&self.input));
    }

    /// Returns the current input, and resets mouse rotation and the path toggle.
    pub fn take_input(&self) -> Input {
        let mut input = locked(&self.input);
        let taken = input.clone();
        (input.dragged_rad, input.toggles_path) = ([0.0; 2], false);
        taken
    }

    /// Hands a frame to the window; `change` updates the rest of the overlay's data.
    pub fn show(&self, picture: EyeImages, frame: FrameStatus, change: impl FnOnce(&mut Status)) {
        let mut output = locked(&self.output);
        output.picture = Some(picture);
        output.status.add(frame);
        change(&mut output.status);
    }

    /// Returns the newest picture, if it was not taken before, and the data for the overlay.
    pub fn take_output(&self) -> (Option<EyeImages>, Status) {
        let mut output = locked(&self.output);
        (output.picture.take(), output.status.clone())
    }

    /// Asks the renderer's thread to stop.
    pub fn end(&self) {
        self.ends.store(true, Ordering::Relaxed);
    }

    pub fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }
}
