//! Sessions: the runtime paces the frames, predicts their display times and poses, and takes their images.

use std::sync::Arc;
use std::time::Duration;

use openxr::{
    CompositionLayerBase, CompositionLayerProjection, CompositionLayerProjectionView, Event, EventDataBuffer,
    FrameStream, FrameWaiter, Posef, ReferenceSpaceType, Session, Time, Vulkan, sys,
};

use super::chain::{COLOURS, DEPTHS};
use super::drawing::{Drawing, depth_info};
use super::error::{HeadsetError, OpenXrResult};
use super::frame::{HeadSample, HeadsetFrame, Next, Picture, Shown};
use super::gaze::{GazeFilter, in_image};
use super::input::{Controls, Input};
use super::late_latching::{Locator, Spaces};
use super::lifecycle::{Lifecycle, State, Step};
use super::pacing::Pacing;
use super::panel::Panel;
use super::pose::{are_alike, eye_view, head_eyes};
use super::runtime::{Runtime, STEREO};
use crate::device::{GpuDevice, HeadsetDevice};
use crate::image::Extent;
use crate::scene::head::HeadPose;
use crate::scene::optics::HeadEyes;
use crate::scene::rig::Eye;

/// Interval at which a session that does not run is polled.
const PAUSE: Duration = Duration::from_millis(10);

/// A session with a headset and one image size. Handles are dropped in the order of the fields.
pub struct Headset {
    colour: Drawing,
    depth: Option<Drawing>,
    controls: Controls,
    locator: Locator,
    stream: FrameStream<Vulkan>,
    waiter: FrameWaiter,
    session: Session<Vulkan>,
    device: HeadsetDevice,
    runtime: Runtime,
    events: EventDataBuffer,
    lifecycle: Lifecycle,
    pacing: Pacing,
    /// Last located eyes.
    eyes: Option<HeadEyes>,
    /// Filter of the gaze, once a tracker has reported one.
    gaze: Option<GazeFilter>,
    is_to_end: bool,
    /// True if the runtime was asked to end the session.
    is_asked: bool,
}

impl Headset {
    /// Starts a session with images of this size per eye, on a device from [`Runtime::open_device`].
    ///
    /// # Errors
    /// Errors of the runtime or of the device.
    pub fn start(runtime: Runtime, device: HeadsetDevice, extent: Extent) -> Result<Self, HeadsetError> {
        let (session, waiter, stream) = device.session(&runtime.xr, runtime.system).to("create a session")?;
        let space = |kind| session.create_reference_space(kind, Posef::IDENTITY).to("create a reference space");
        let spaces = Spaces { local: space(ReferenceSpaceType::LOCAL)?, head: space(ReferenceSpaceType::VIEW)? };
        let locator = Locator { spaces: Arc::new(spaces), clock: runtime.tells_time.then(|| runtime.xr.clone()) };
        let lacks = HeadsetError::Lacks { runtime: runtime.name.clone(), what: "an 8-bit sRGB swapchain format" };
        let colour = Drawing::new(&device, &session, &COLOURS, extent)?.ok_or(lacks)?;
        let depth = if runtime.takes_depth { Drawing::new(&device, &session, &DEPTHS, extent)? } else { None };
        let controls = Controls::new(&runtime.xr, &session, runtime.tracks_eyes)?;
        Ok(Self {
            colour,
            depth,
            controls,
            locator,
            stream,
            waiter,
            session,
            device,
            runtime,
            events: EventDataBuffer::new(),
            lifecycle: Lifecycle::default(),
            pacing: Pacing::default(),
            eyes: None,
            gaze: None,
            is_to_end: false,
            is_asked: false,
        })
    }

    pub fn runtime(&self) -> &Runtime {
        &self.runtime
    }

    /// Returns true if [`Self::show`] uses [`Picture::distances`].
    pub fn takes_depth(&self) -> bool {
        self.depth.is_some()
    }

    /// Returns the states that the session has been in so far.
    pub fn states(&self) -> &[State] {
        self.lifecycle.states()
    }

    /// Returns true if the runtime has lost the headset.
    pub fn is_lost(&self) -> bool {
        self.lifecycle.state() == Some(State::LossPending)
    }

    /// Asks the runtime to end the session; [`Self::next_frame`] reports the end. Call it repeatedly until then: a
    /// session that does not run yet may still begin.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn ask_to_end(&mut self) -> Result<(), HeadsetError> {
        self.is_to_end = true;
        if !self.lifecycle.runs() || std::mem::replace(&mut self.is_asked, true) {
            return Ok(());
        }
        self.session.request_exit().to("exit the session")
    }

    /// Handles pending events, then waits until the runtime wants a frame.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn next_frame(&mut self) -> Result<Next, HeadsetError> {
        self.follow()?;
        if self.lifecycle.has_ended() || self.is_to_end && !self.lifecycle.runs() {
            return Ok(Next::Ended);
        }
        if !self.lifecycle.runs() {
            self.pacing.pause();
            std::thread::sleep(PAUSE);
            return Ok(Next::Idle);
        }
        let paced = self.waiter.wait().to("wait for a frame")?;
        self.stream.begin().to("begin a frame")?;
        let display = paced.predicted_display_time;
        let located = if paced.should_render { self.locate(display)? } else { None };
        let Some((HeadSample { head, at: sampled }, eyes)) = located else {
            self.pacing.pause();
            self.stream.end(display, self.runtime.blend, &[]).to("end a frame")?;
            return Ok(Next::Idle);
        };
        let period_ns = paced.predicted_display_period.as_nanos();
        let missed = self.pacing.missed(display, period_ns);
        let display_s = self.pacing.since_first_s(display);
        let input = self.controls.read(&self.session, &self.locator.spaces.head, display)?;
        let gaze = self.gaze(&input, &eyes, display_s);
        let frame = HeadsetFrame { display, period_ns, sampled, display_s, head, eyes, missed, input, gaze };
        Ok(Next::Frame(Box::new(frame)))
    }

    /// Returns a locator for late latching, which predicts the head's pose from any thread.
    pub fn locator(&self) -> Locator {
        self.locator.clone()
    }

    /// Filters the reported gaze and projects it into the left and the right eye's image, as fractions from the top
    /// left. Returns `None` before a tracker has reported a gaze.
    fn gaze(&mut self, input: &Input, eyes: &HeadEyes, at_s: f64) -> Option<[[f64; 2]; 2]> {
        if input.gaze.is_some() {
            self.gaze.get_or_insert_default();
        }
        let gaze = self.gaze.as_mut()?.next(input.gaze, at_s);
        Some([&eyes.left, &eyes.right].map(|eye| in_image(gaze, eye)))
    }

    /// Creates a panel of `extent` pixels that is `width_m` metres wide, ahead of the head pose `head`. Returns `None`
    /// if the session offers no format for it.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn panel(&self, extent: Extent, width_m: f64, head: HeadPose) -> Result<Option<Panel>, HeadsetError> {
        Panel::new(&self.device, &self.session, extent, width_m, head)
    }

    /// Returns true if the headset's device is also the first rendering device.
    pub fn renders(&self) -> bool {
        self.device.renders()
    }

    /// Returns the device that draws panels, for use while no frame is being rendered.
    pub fn gpu(&self) -> &GpuDevice {
        &self.device.gpu
    }

    /// Locates the head and the eyes at a display time; returns `None` if either is unknown.
    fn locate(&mut self, display: Time) -> Result<Option<(HeadSample, HeadEyes)>, HeadsetError> {
        let head = &self.locator.spaces.head;
        let (_, views) = self.session.locate_views(STEREO, display, head).to("locate the eyes")?;
        let told = if let [left, right] = &views[..] { head_eyes([left, right]) } else { None };
        // Keep the previous eyes if only rounding errors differ, so that they are identical between frames.
        if let Some(told) = told.filter(|told| self.eyes.is_none_or(|eyes| !are_alike(&eyes, told))) {
            self.eyes = Some(told);
        }
        Ok(self.locator.at(display).zip(self.eyes))
    }

    /// Restarts the frame times and the count of missed periods at the next frame.
    pub fn begin_anew(&mut self) {
        self.pacing = Pacing::default();
    }

    /// Ends a frame without showing anything.
    ///
    /// # Errors
    /// Errors of the runtime.
    pub fn skip(&mut self, frame: &HeadsetFrame) -> Result<(), HeadsetError> {
        self.stream.end(frame.display, self.runtime.blend, &[]).to("end a frame")
    }

    /// Submits a frame.
    ///
    /// # Errors
    /// Errors of the runtime or of the device.
    pub fn show(&mut self, frame: &HeadsetFrame, picture: &Picture) -> Result<Shown, HeadsetError> {
        let gpu = &self.device.gpu;
        let (eyes, metres_per_unit) = (&frame.eyes, picture.metres_per_unit);
        self.colour.fill(gpu, &picture.images, eyes, metres_per_unit)?;
        let distances = self.depth.as_mut().zip(picture.distances.as_ref());
        let has_depth = distances.is_some();
        if let Some((depth, distances)) = distances {
            depth.fill(gpu, distances, eyes, metres_per_unit)?;
        }
        if let Some(failure) = gpu.failure() {
            return Err(HeadsetError::Failed(failure.what));
        }
        let colour = self.colour.lock();
        let depth = self.depth.as_ref().filter(|_| has_depth).map(Drawing::lock);
        let infos = depth.as_ref().map(|images| Eye::BOTH.map(|eye| depth_info(images, eye)));
        let views = Eye::BOTH.map(|eye| {
            let (pose, fov) = eye_view(frame.head, &frame.eyes, eye);
            let view =
                CompositionLayerProjectionView::new().pose(pose).fov(fov).sub_image(colour.layer(eye.index() as u32));
            let Some(infos) = &infos else { return view };
            let next = std::ptr::from_ref(&infos[eye.index()]).cast();
            // SAFETY: everything that the view points to outlives the end of the frame, and its extension is enabled.
            unsafe {
                CompositionLayerProjectionView::from_raw(sys::CompositionLayerProjectionView {
                    next,
                    ..view.into_raw()
                })
            }
        });
        let world = CompositionLayerProjection::new().space(&self.locator.spaces.local).views(&views);
        let panel = picture.panel.map(|panel| (panel, panel.lock()));
        let panel = panel.as_ref().map(|(panel, images)| panel.layer(images, &self.locator.spaces.local));
        let layers: [Option<&CompositionLayerBase<Vulkan>>; 2] = [Some(&world), panel.as_deref()];
        let layers: Vec<_> = layers.into_iter().flatten().collect();
        self.stream.end(frame.display, self.runtime.blend, &layers).to("accept the layers of a frame")?;
        Ok(frame.shown(self.locator.now()))
    }

    /// Handles all pending events.
    fn follow(&mut self) -> Result<(), HeadsetError> {
        loop {
            let entered = match self.runtime.xr.poll_event(&mut self.events).to("report an event")? {
                None => return Ok(()),
                Some(Event::SessionStateChanged(change)) => State::of(change.state()),
                Some(Event::InstanceLossPending(_)) => Some(State::LossPending),
                Some(_) => None,
            };
            match entered.map(|state| self.lifecycle.enter(state)) {
                Some(Step::Begin) => drop(self.session.begin(STEREO).to("begin the session")?),
                Some(Step::End) => drop(self.session.end().to("end the session")?),
                Some(Step::Nothing) | None => {}
            }
        }
    }
}

impl Drop for Headset {
    /// Waits until the device has finished with the images, before the runtime destroys them. If the device hangs, the
    /// wait ends at the device's time limit.
    fn drop(&mut self) {
        let _ = self.device.gpu.wait(None);
    }
}
