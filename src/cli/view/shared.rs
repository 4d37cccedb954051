//! What the window and the renderer's thread tell each other. Neither waits: the newest counts.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use crate::exec::Stereo;
use crate::image::Image;
use crate::quality::FrameQuality;

/// Frames that are remembered for the plot.
const REMEMBERED: usize = 120;

pub type EyeImages = Stereo<Image<[u8; 4]>>;

#[derive(Default)]
pub struct Shared {
    input: Mutex<Input>,
    output: Mutex<Output>,
    ends: AtomicBool,
}

/// What whoever sits at the window wants.
#[derive(Clone, Debug, Default)]
pub struct Input {
    /// To the right, up and ahead, each −1 to 1, for as long as keys are held.
    pub moves: [f64; 3],
    /// To the right and up, each −1 to 1, likewise.
    pub turns: [f64; 2],
    /// To the right and up since it was last asked for, radians.
    pub dragged_rad: [f64; 2],
    pub is_fast: bool,
    /// Fractions of an eye's image from the top left.
    pub gaze: Option<[f64; 2]>,
    /// Asked for since it was last asked: to the path or off it.
    pub toggles_path: bool,
}

/// What came of frames.
#[derive(Default)]
struct Output {
    picture: Option<EyeImages>,
    news: News,
}

/// All that the overlay tells.
#[derive(Clone, Debug, Default)]
pub struct News {
    /// Oldest first.
    pub frames: VecDeque<FrameNews>,
    pub count: u64,
    pub in_band: u64,
    pub rungs: usize,
    pub follows_path: bool,
    /// Where foveal layers end and what is looked at, by eye, pixels of its image.
    pub circles: Option<[([f64; 2], [f64; 2]); 2]>,
}

#[derive(Clone, Debug)]
pub struct FrameNews {
    pub at: Instant,
    pub makespan_ms: f64,
    pub in_band: bool,
    pub rung: usize,
    pub quality: FrameQuality,
    /// Rows per device.
    pub stripes: Vec<u32>,
}

impl News {
    pub fn add(&mut self, frame: FrameNews) {
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

    /// The input by now; what happens once is taken out.
    pub fn take_input(&self) -> Input {
        let mut input = locked(&self.input);
        let taken = input.clone();
        (input.dragged_rad, input.toggles_path) = ([0.0; 2], false);
        taken
    }

    /// Hands a frame to the window; `change` sets what else is new.
    pub fn show(&self, picture: EyeImages, frame: FrameNews, change: impl FnOnce(&mut News)) {
        let mut output = locked(&self.output);
        output.picture = Some(picture);
        output.news.add(frame);
        change(&mut output.news);
    }

    /// The newest picture, if it was not taken before, and what there is to tell.
    pub fn take_output(&self) -> (Option<EyeImages>, News) {
        let mut output = locked(&self.output);
        (output.picture.take(), output.news.clone())
    }

    /// No further frame is wanted.
    pub fn end(&self) {
        self.ends.store(true, Ordering::Relaxed);
    }

    pub fn ends(&self) -> bool {
        self.ends.load(Ordering::Relaxed)
    }
}
