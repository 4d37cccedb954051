//! Headset output with OpenXR: predicts display times and poses for frames, and submits their images.
//!
//! [`Runtime`] is the system's OpenXR runtime with a headset, before a session begins. [`Headset`] is a session with
//! the runtime. A frame begins with [`Headset::next_frame`], which waits as long as the runtime wants, and ends with
//! [`Headset::show`].

mod chain;
mod drawing;
mod error;
mod frame;
mod gaze;
mod input;
mod late_latching;
mod lifecycle;
mod pacing;
mod panel;
mod pose;
mod runtime;
mod session;
mod locomotion;

pub use drawing::Pixels;
pub use error::HeadsetError;
pub use frame::{HeadSample, HeadsetFrame, Next, Picture, Shown};
pub use input::Input;
pub use late_latching::Locator;
pub use lifecycle::State;
pub use locomotion::Locomotion;
pub use panel::Panel;
pub use runtime::Runtime;
pub use session::Headset;
