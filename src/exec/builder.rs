//! The builder of renderers.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::ranks::Devices;
use super::stopping::StopFlag;
use super::{ExecError, Renderer};
use crate::device::{self, DeviceError, Selection};
use crate::frame::RunConfig;
use crate::image::Extent;
use crate::loaded::LoadedScene;
use crate::quality::{Envelope, Quality};
use crate::scene::rig::Rig;
use crate::schedule::{Measured, Policy};

/// An error of [`Builder::build`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The rectified image of eyes with custom optics would be too large.
    #[error("{0}")]
    Optics(String),
    #[error(transparent)]
    Device(#[from] DeviceError),
    #[error(transparent)]
    Exec(#[from] ExecError),
}

type NewPolicy<'a> = dyn FnOnce(u32, usize) -> Box<dyn Policy> + 'a;
type Change<'a> = dyn FnOnce(&mut RunConfig) + 'a;

/// Builds a [`Renderer`]. Settings that you leave out have the defaults of `diptych render`.
#[must_use]
pub struct Builder<'a> {
    scene: &'a LoadedScene,
    extent: Extent,
    envelope: Envelope,
    config: Option<RunConfig>,
    changes: Vec<Box<Change<'a>>>,
    selection: Selection,
    devices: Option<Devices>,
    policy: Box<NewPolicy<'a>>,
    origin: Instant,
    stop: StopFlag,
}

impl Renderer {
    /// Returns a builder of a renderer for this scene.
    ///
    /// ```no_run
    /// use diptych::{LoadedScene, Renderer};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let scene = LoadedScene::load("builtin:cornell")?;
    /// let mut renderer = Renderer::builder(&scene).size(640, 360).devices(2).build()?;
    /// let report = renderer.render(&renderer.frame(&scene.shot.rig, 0.0, 0))?;
    /// println!("{:.1} ms", report.makespan_ms);
    /// # Ok(())
    /// # }
    /// ```
    pub fn builder(scene: &LoadedScene) -> Builder<'_> {
        Builder {
            scene,
            extent: Extent::new(640, 360),
            envelope: Quality::default().into(),
            config: None,
            changes: Vec::new(),
            selection: Selection::default(),
            devices: None,
            policy: Box::new(|rows: u32, devices: usize| -> Box<dyn Policy> { Box::new(Measured::new(rows, devices)) }),
            origin: Instant::now(),
            stop: StopFlag::default(),
        }
    }
}

impl<'a> Builder<'a> {
    /// Sets the size of each eye's image, in pixels.
    pub fn size(mut self, width: u32, height: u32) -> Self {
        self.extent = Extent::new(width, height);
        self
    }

    /// Sets the quality of frames. Single frames may have a lower one, see [`FrameParams`](super::FrameParams).
    pub fn quality(self, quality: Quality) -> Self {
        self.envelope(quality.into())
    }

    /// Sets the bounds of the qualities that frames may have.
    pub fn envelope(mut self, envelope: Envelope) -> Self {
        self.envelope = envelope;
        self
    }

    /// Returns the camera of the scene's shot.
    pub(crate) fn rig(&self) -> &Rig {
        &self.scene.shot.rig
    }

    /// Returns the size of each eye's image.
    pub(crate) fn extent(&self) -> Extent {
        self.config.as_ref().map_or(self.extent, |config| config.buffers.extent)
    }

    /// Opens `count` virtual devices on each adapter.
    pub fn devices(mut self, count: usize) -> Self {
        self.selection.virtual_devices = count;
        self
    }

    /// Opens the devices of a selection.
    pub fn select(mut self, selection: Selection) -> Self {
        self.selection = selection;
        self
    }

    /// Uses devices that are already open.
    pub fn on(mut self, devices: impl Into<Devices>) -> Self {
        self.devices = Some(devices.into());
        self
    }

    /// Sets the policy that distributes the rows of a frame over devices. `make` takes the number of rows of an image
    /// and the number of devices.
    pub fn policy(mut self, make: impl FnOnce(u32, usize) -> Box<dyn Policy> + 'a) -> Self {
        self.policy = Box::new(make);
        self
    }

    /// Sets the configuration, which replaces that derived from [`Self::size`] and [`Self::quality`].
    pub fn config(mut self, config: RunConfig) -> Self {
        self.config = Some(config);
        self
    }

    /// Adds a change to the configuration. [`Self::build`] applies such changes last, in order.
    pub fn configure(mut self, change: impl FnOnce(&mut RunConfig) + 'a) -> Self {
        self.changes.push(Box::new(change));
        self
    }

    /// Sets the time from which times in reports count. The default is the time of the call of [`Renderer::builder`].
    pub fn origin(mut self, origin: Instant) -> Self {
        self.origin = origin;
        self
    }

    /// Ends the renderer's work early once `flag` is set: [`Self::build`] and waits for frames then return
    /// [`ExecError::Stopped`], and the renderer can render no more. Frames that end within 250 ms are still completed.
    /// Devices stay busy with what was submitted, and nothing waits for them.
    pub fn stop(mut self, flag: Arc<AtomicBool>) -> Self {
        self.stop = flag.into();
        self
    }

    /// Opens the devices, unless they are already open, and compiles all pipelines.
    ///
    /// # Errors
    /// [`BuildError`] if the rectified image would be too large, the devices cannot be opened, or the renderer cannot
    /// be created.
    pub fn build(self) -> Result<Renderer, BuildError> {
        let Self { scene, extent, envelope, config, changes, selection, devices, policy, origin, stop } = self;
        let config = config.map_or_else(|| RunConfig::for_envelope(scene, extent, envelope), Ok);
        let mut config = config.map_err(BuildError::Optics)?;
        changes.into_iter().for_each(|change| change(&mut config));
        let devices = devices.map_or_else(|| device::open(&selection).map(Devices::from), Ok)?;
        let policy = policy(config.grid().height, devices.len());
        Ok(Renderer::start(devices, Arc::clone(&scene.tables), config, policy, origin, stop)?)
    }
}
