//! The denoiser alone, for frames of any renderer. [`FrameDenoiser`] takes arrays of a frame and runs the passes of
//! `svgf` on one device, without a scene, workers or a frame budget.

mod array;
mod error;
mod given;

pub use array::Array;
pub use error::DenoiseError;
pub use given::{Given, GivenBuffers, Inputs};

use std::sync::Arc;

use glam::Vec2;

use crate::accel::Accel;
use crate::device::staging::{Pool, Recorded};
use crate::device::{self, DeviceFailure, GpuDevice, Selection};
use crate::frame::RunConfig;
use crate::graph::{Bound, Pass, Program, Resource};
use crate::image::{Extent, Image, RgbImage};
use crate::layout;
use crate::passes::denoise::import;
use crate::passes::tonemap::LINEAR;
use crate::passes::{FrameSpec, Moving, Views, declare};
use crate::plan::launched;
use crate::projection::within;
use crate::quality::{Denoiser, Filter};
use crate::samples::PixelSamples;
use crate::scene::Scene;
use crate::scene::needs::SceneNeeds;
use crate::scene::rig::Eye;
use crate::schedule::Position;
use crate::stages::{DeviceStages, Place, Recording};
use crate::tables::SceneTables;

/// Settings that all frames of a [`FrameDenoiser`] share.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Size of each view's image.
    pub extent: Extent,
    /// Number of views: 1, or 2 for a stereo pair.
    pub views: usize,
    /// Iterations of the filter, 1 to 10. Each doubles its radius.
    pub iterations: u32,
    /// Samples per pixel of each frame. They weight frames against one another.
    pub spp: u32,
    /// True if surfaces move, so that frames have positions of the previous frame ([`Given::last_position`]).
    pub is_animated: bool,
    /// Exposure in stops at which a radiance of 1 becomes white.
    pub exposure_ev: f32,
}

impl Settings {
    /// Returns the defaults for images of this size: two views of a static scene, with one sample per pixel.
    pub fn new(extent: Extent) -> Self {
        let iterations = Denoiser::DEFAULT_ITERATIONS;
        Self { extent, views: 2, iterations, spp: 1, is_animated: false, exposure_ev: 0.0 }
    }

    /// Checks whether all settings are valid.
    ///
    /// # Errors
    /// [`DenoiseError::Setting`] with the first that is not.
    pub fn check(&self) -> Result<(), DenoiseError> {
        within("width", self.extent.width, Extent::SIDES)?;
        within("height", self.extent.height, Extent::SIDES)?;
        within("views", self.views, 1..=Eye::BOTH.len())?;
        within("iterations", self.iterations, 1..=Denoiser::MAX_ITERATIONS)?;
        within("spp", self.spp, 1..=65536)?;
        Ok(within("exposure_ev", self.exposure_ev, -60.0..=60.0)?)
    }

    /// Returns the specification of a frame with a history. The first frame has the same passes.
    fn spec(&self) -> FrameSpec {
        FrameSpec {
            views: Views::Traced,
            filter: Some(Denoiser::SVGF),
            iterations: self.iterations,
            history_rows: Some(self.extent.height),
            moving: self.is_animated.then(Moving::default),
            imported: true,
            ..FrameSpec::new(self.extent, 1)
        }
    }

    /// Returns the configuration that selects the variants of shaders.
    fn config(&self) -> RunConfig {
        let mut config = RunConfig::new(self.extent, SceneNeeds::of(&Scene::empty("")));
        config.envelope.most.filter = Some(Filter::new(Denoiser::SVGF, self.iterations));
        // Samples are spread over their pixels, as those of frames of several are.
        config.envelope.most.spp = self.spp.max(2).into();
        config.buffers.moving = self.is_animated.then(Moving::default);
        config.cache = false;
        config
    }
}

/// Denoises frames of any renderer with `svgf`, and keeps the history from frame to frame.
///
/// ```
/// use diptych::Extent;
/// use diptych::denoise::{DenoiseError, FrameDenoiser, Given, Settings};
/// use diptych::scene::rig::View;
///
/// /// Denoises a sequence of one view; a frame's arrays are color, albedo, normal and position.
/// fn denoise(frames: &[(View, [Vec<[f32; 3]>; 4])]) -> Result<(), DenoiseError> {
///     let mut denoiser = FrameDenoiser::new(&Settings { views: 1, ..Settings::new(Extent::new(640, 360)) })?;
///     for (camera, [color, albedo, normal, position]) in frames {
///         let denoised = denoiser.denoise(&[Given::new(*camera, color, albedo, normal, position)])?;
///         println!("{:?}", denoised[0].pixels[0]);
///     }
///     Ok(())
/// }
/// ```
pub struct FrameDenoiser {
    settings: Settings,
    gpu: GpuDevice,
    stages: DeviceStages,
    program: Arc<Program>,
    /// Readback buffers of [`Self::denoise`].
    pool: Pool,
    /// Constants of the last frame; `None` if there is no history.
    previous: Option<layout::Previous>,
    denoised: u64,
}

impl FrameDenoiser {
    /// Creates a denoiser on the first hardware GPU, or on a software adapter if there is none.
    ///
    /// # Errors
    /// Errors of [`Self::on`], and [`DenoiseError::Open`] if no device can be opened.
    pub fn new(settings: &Settings) -> Result<Self, DenoiseError> {
        settings.check()?;
        Self::on(Self::open(&Selection::default())?, settings)
    }

    /// Opens the first device of a selection.
    ///
    /// # Errors
    /// [`DenoiseError::Open`] if no device can be opened.
    pub fn open(selection: &Selection) -> Result<GpuDevice, DenoiseError> {
        let first = device::open(selection)?.into_iter().next();
        Ok(first.ok_or(device::DeviceError::NoAdapter)?)
    }

    /// Creates a denoiser on an open device, of the library or of your own ([`GpuDevice::from_wgpu`]). It compiles the
    /// shaders, and waits until the device is idle.
    ///
    /// # Errors
    /// [`DenoiseError::Setting`] if a setting is invalid, [`DenoiseError::Stage`] if the device cannot run the passes,
    /// [`DenoiseError::Device`] if it fails.
    pub fn on(mut gpu: GpuDevice, settings: &Settings) -> Result<Self, DenoiseError> {
        settings.check()?;
        // A renderer may have left the limit of its frame budget.
        gpu.patience = GpuDevice::START_PATIENCE;
        let spec = settings.spec();
        let is_seen = |pass: &Pass| pass.view.index() < settings.views;
        let passes: Vec<Pass> = declare(&spec).passes.into_iter().filter(is_seen).collect();
        let program = Program::new(spec.extent, spec.seam, passes).map_err(crate::stages::StageError::from)?;
        let (tables, programs) = (no_scene()?, [program]);
        let mut stages = DeviceStages::new(&mut gpu, settings.config(), &tables, &programs)?;
        stages.warm_up(&gpu, &programs);
        gpu.wait(None)?;
        let [program] = programs;
        let (settings, program) = (settings.clone(), Arc::new(program));
        Ok(Self { settings, gpu, stages, program, pool: Pool::default(), previous: None, denoised: 0 })
    }

    /// Returns the device, for use by another denoiser or renderer. It keeps its compiled pipelines.
    pub fn into_device(self) -> GpuDevice {
        self.gpu
    }

    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Discards the history. Call it where the camera cuts to another place.
    pub fn reset(&mut self) {
        self.previous = None;
    }

    /// Denoises a frame, given by one entry per view, the left one first. It continues the history of the frames before,
    /// and of two views, the right one uses the left one's history where its own is missing. Returns the image of each
    /// view in linear RGB.
    ///
    /// # Errors
    /// [`DenoiseError::Given`] if the number of views, the size of an array or a value is wrong, which leaves the history as
    /// it is; [`DenoiseError::Device`] if the device fails.
    pub fn denoise(&mut self, views: &[Given<'_>]) -> Result<Vec<RgbImage>, DenoiseError> {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.record(&mut encoder, views)?;
        let extent = self.settings.extent;
        let bytes = LINEAR.bytes(extent);
        let record = |output| self.pool.record(&self.gpu, &mut encoder, output, 0, bytes);
        let copies: Vec<Recorded> = self.outputs().into_iter().map(record).collect();
        let submission = self.gpu.queue.submit([encoder.finish()]);
        let pixel = |bytes: &[u8]| {
            let [r, g, b, _]: [f32; 4] = bytemuck::pod_read_unaligned(bytes);
            [r, g, b]
        };
        let image = |copy: Recorded| {
            let bytes = self.pool.finish(&self.gpu, copy.submitted(submission.clone()))?;
            Ok(Image { extent, pixels: bytes.chunks_exact(size_of::<[f32; 4]>()).map(pixel).collect() })
        };
        copies.into_iter().map(image).collect()
    }

    /// Records the passes of a frame like [`Self::denoise`], without submitting them or waiting for them. The denoised
    /// images are in [`Self::outputs`] for the commands that follow.
    ///
    /// The values of buffers are not checked: write no infinity or NaN, except to positions.
    ///
    /// Submit the encoders of successive frames in the order in which they were recorded. If you do not submit one, call
    /// [`Self::reset`].
    ///
    /// # Errors
    /// [`DenoiseError::Given`] if the number of views, the size or usage of an array or a value is wrong, which records
    /// nothing and leaves the history as it is.
    pub fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        views: &[Inputs<impl Array>],
    ) -> Result<(), DenoiseError> {
        given::check(&self.settings, views)?;
        let constants = self.constants(views);
        let previous = self.previous.unwrap_or_else(|| (&constants).into());
        self.stages.set_constants(&self.gpu, encoder, &constants, &previous);
        for (eye, given) in Eye::BOTH.into_iter().zip(views) {
            self.import(encoder, eye, given);
        }
        self.dispatch(encoder, Place::of(self.denoised, 1), constants.sampling.samples);
        (self.previous, self.denoised) = (Some((&constants).into()), self.denoised + 1);
        Ok(())
    }

    /// Returns the buffer of each view's denoised image: linear RGB and 1, four `f32` per pixel, row after row from the top
    /// left. Its usages are `STORAGE`, `COPY_SRC` and `COPY_DST`. All frames are denoised into the same buffers.
    pub fn outputs(&self) -> Vec<&wgpu::Buffer> {
        let output = |eye| self.stages.images.buffer(&bound(LINEAR), eye, Place::default());
        Eye::BOTH.into_iter().take(self.settings.views).map(output).collect()
    }

    fn constants<A>(&self, views: &[Inputs<A>]) -> layout::Frame {
        let Extent { width, height } = self.settings.extent;
        let aspect = f64::from(width) / f64::from(height);
        let view = |eye: usize| layout::View::new(&views[eye.min(views.len() - 1)].camera, aspect);
        layout::Frame {
            // The light of a pixel is its mean, which its centre represents.
            camera: layout::Camera {
                views: [view(0), view(1)],
                centre: Vec2::splat(0.5),
                width,
                height,
                ..Default::default()
            },
            sampling: layout::Sampling {
                index: self.denoised as u32,
                samples: PixelSamples::own(0..self.settings.spp, false),
                ..Default::default()
            },
            foveation: layout::Foveation {
                layer_iterations: [self.settings.iterations; 3].into(),
                ..Default::default()
            },
            history: layout::History::new(self.previous.map(|_| height), 0..0),
            display: layout::Display {
                exposure: self.settings.exposure_ev.exp2(),
                storage_scale: self.settings.exposure_ev.round().exp2(),
                ..Default::default()
            },
            ..Default::default()
        }
    }

    /// Records copies of a view's arrays to the images that the passes import.
    fn import<A: Array>(&self, encoder: &mut wgpu::CommandEncoder, eye: Eye, given: &Inputs<A>) {
        let target = |resource| self.stages.images.buffer(&bound(resource), eye, Place::default());
        let mut copy = |resource: Resource, array: A| {
            let bytes = resource.bytes(self.settings.extent);
            encoder.copy_buffer_to_buffer(&array.buffer(&self.gpu), 0, target(resource), 0, bytes);
        };
        copy(import::COLOR, given.color);
        copy(import::REFLECTANCE, given.albedo);
        copy(import::NORMAL, given.normal);
        copy(import::POSITION, given.position);
        if self.settings.is_animated {
            copy(import::last_position(&self.settings.spec()), given.last_position.unwrap_or(given.position));
        }
        match given.emission {
            Some(emission) => copy(import::EMITTED, emission),
            None => encoder.clear_buffer(target(import::EMITTED), 0, None),
        }
    }

    fn dispatch(&mut self, encoder: &mut wgpu::CommandEncoder, place: Place, samples: PixelSamples) {
        let Self { gpu, stages, program, .. } = self;
        let mut recording = Recording { gpu, queries: None, encoder, program, place };
        for (pass, linked) in program.passes().iter().enumerate() {
            let rows = linked.pass.grid.extent(program.extent).rows();
            let all = Position::start(&rows)..Position::END;
            let launches = launched(program, pass, &rows, &rows, &all, samples, gpu.info.index);
            stages.dispatch(&mut recording, pass, &launches, [None; 2]);
        }
    }
}

/// Returns the tables of an empty scene, which no pass reads.
fn no_scene() -> Result<SceneTables, DeviceFailure> {
    let scene = Scene::empty("imported");
    let accel = Accel::build(&scene).map_err(|e| e.to_string())?;
    SceneTables::new(&scene, accel).map_err(|e| e.to_string().into())
}

/// Returns the first buffer of a resource, with the contents of this frame.
fn bound(resource: Resource) -> Bound {
    Bound { resource, buffer: 0, is_before: false }
}
