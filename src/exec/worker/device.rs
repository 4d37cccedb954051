//! A device with everything that its worker needs to execute tasks of frames.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use super::speeds::Speeds;
use crate::device::staging::{Mapped, Pool, ReadBack, Recorded};
use crate::device::{DeviceFailure, GpuClock, GpuDevice};
use crate::exec::messages::{Bytes, FrameJob, Pixels};
use crate::exec::output::Output;
use crate::exec::{ExecError, InjectedKind};
use crate::frame::RunConfig;
use crate::frame::constants::of_views;
use crate::graph::{Bound, Program};
use crate::plan::{EyeImage, MOST_TIMED, Rows};
use crate::stages::{DeviceStages, Place, Recording};
use crate::tables::SceneTables;

pub struct WorkerDevice {
    pub gpu: GpuDevice,
    pub stages: DeviceStages,
    queries: wgpu::QuerySet,
    stamp_buffer: wgpu::Buffer,
    pub clock: GpuClock,
    pool: Pool,
    pub speeds: Speeds,
    /// Number of views from which others are reprojected.
    sources: usize,
    origin: Instant,
}

impl WorkerDevice {
    /// Creates the images and pipelines of these programs, and warms up the pipelines. Times count from `origin`, once
    /// [`Self::calibrate`] has been called.
    ///
    /// # Errors
    /// [`ExecError`] if the device fails at once, has too little memory or cannot compile a stage.
    pub fn new(
        mut gpu: GpuDevice,
        config: &RunConfig,
        tables: &SceneTables,
        programs: &[Program],
        origin: Instant,
    ) -> Result<Self, ExecError> {
        gpu.patience = GpuDevice::START_PATIENCE;
        let device = gpu.info.index;
        let failed = |failure: DeviceFailure| ExecError::Device { device, what: failure.what };
        let mut stages = DeviceStages::new(&mut gpu, config.clone(), tables, programs)?;
        let queries = gpu.timestamps("stamps", 2 * MOST_TIMED as u32);
        stages.warm_up(&gpu, programs);
        gpu.wait(None).map_err(failed)?;
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let stamp_buffer = gpu.buffer("stamps", 2 * MOST_TIMED as u64 * 8, usage);
        let clock = GpuClock::of(&gpu);
        let (pool, speeds, sources) = (Pool::default(), Speeds::default(), config.buffers.sources);
        Ok(Self { gpu, stages, queries, stamp_buffer, clock, pool, speeds, sources, origin })
    }

    /// Measures the offset of the device's clock. Call this directly before the first frame: the clocks may have
    /// drifted apart by a millisecond if devices have compiled pipelines since then.
    ///
    /// # Errors
    /// [`ExecError`] if the device fails.
    pub fn calibrate(&mut self) -> Result<(), ExecError> {
        let failed = |failure: DeviceFailure| ExecError::Device { device: self.gpu.info.index, what: failure.what };
        self.clock.calibrate(&self.gpu, self.origin).map_err(failed)?;
        self.gpu.info.clock_residual_us = self.clock.residual_us;
        Ok(())
    }

    /// Returns the milliseconds since the origin.
    pub fn now_ms(&self) -> f64 {
        self.origin.elapsed().as_secs_f64() * 1e3
    }

    pub fn inject(&self, kind: InjectedKind) {
        match kind {
            InjectedKind::Loss => self.gpu.device.destroy(),
            InjectedKind::Hang => loop {
                std::thread::park();
            },
            InjectedKind::Oom => self.gpu.report_out_of_memory(),
            // Nothing to do here: the renderer has doubled `FrameJob::runs` for this device.
            InjectedKind::Slow => {}
        }
    }

    /// Writes the constants of a frame, and updates the scene's tables, for the next submission.
    pub fn begin(&mut self, job: &FrameJob) {
        self.stages.reload(&mut self.gpu);
        let constants = of_views(&job.constants, &job.previous, &job.views, self.sources);
        self.stages.begin(&self.gpu, &constants, &job.update);
    }

    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.gpu.device.create_command_encoder(&Default::default())
    }

    /// Returns the stages, and a recording of their commands to an encoder.
    pub fn recording<'a>(
        &'a mut self,
        encoder: &'a mut wgpu::CommandEncoder,
        program: &'a Arc<Program>,
        place: Place,
    ) -> (&'a mut DeviceStages, Recording<'a>) {
        let Self { gpu, stages, queries, .. } = self;
        (stages, Recording { gpu, queries: Some(queries), encoder, program, place })
    }

    /// Records a copy of rows to a readback buffer.
    pub fn record_copy(&mut self, encoder: &mut wgpu::CommandEncoder, rows: &Rows, place: Place) -> Recorded {
        let Rows { image: EyeImage { bound, eye }, rows, .. } = rows;
        let (offset, size) = self.stages.images.span(&bound.resource, rows);
        let source = self.stages.images.buffer(bound, *eye, place);
        self.pool.record(&self.gpu, encoder, source, offset, size)
    }

    /// Records a copy of the first `count` pairs of timestamps to a readback buffer.
    pub fn record_stamps(&mut self, encoder: &mut wgpu::CommandEncoder, count: usize) -> Recorded {
        let written = 2 * count as u32;
        encoder.resolve_query_set(&self.queries, 0..written, &self.stamp_buffer, 0);
        self.pool.record(&self.gpu, encoder, &self.stamp_buffer, 0, u64::from(written) * 8)
    }

    /// Writes rows of an image; returns their size in bytes. The device executes the write at the head of its next
    /// submission.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the number of bytes is not that of the rows.
    pub fn write(&self, to: &Rows, place: Place, bytes: &Bytes) -> Result<u64, DeviceFailure> {
        let Rows { image: EyeImage { bound, eye }, rows, .. } = to;
        let (offset, size) = self.stages.images.span(&bound.resource, rows);
        if bytes.len() as u64 != size {
            return Err(format!("{} bytes of rows arrived instead of {size}", bytes.len()).into());
        }
        self.gpu.queue.write_buffer(self.stages.images.buffer(bound, *eye, place), offset, bytes);
        Ok(size)
    }

    /// Waits until the submission of a copy has completed; returns the copied bytes.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device or the mapping failed.
    pub fn finish(&mut self, back: ReadBack) -> Result<Mapped, DeviceFailure> {
        self.pool.finish(&self.gpu, back)
    }

    /// Returns the begin and end of all timed dispatches in milliseconds since the origin. `back` is the readback of
    /// their timestamps. `bracket_ms` lasts from the first submission to the observed end of the last.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the readback failed.
    pub fn times(&mut self, back: ReadBack, bracket_ms: &Range<f64>) -> Result<Vec<[f64; 2]>, DeviceFailure> {
        let ticks = bytemuck::pod_collect_to_vec::<u8, u64>(&self.finish(back)?);
        Ok(self.clock.host_ms(&ticks, bracket_ms).chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect())
    }

    /// Submits copies of all views of `images` to the host; returns their readbacks.
    ///
    /// # Errors
    /// [`DeviceFailure`] if `images` contains an image that no pass writes.
    pub fn request(&mut self, images: &[Output], place: Place) -> Result<Vec<Vec<ReadBack>>, DeviceFailure> {
        let mut encoder = self.encoder();
        let mut copies = Vec::new();
        for image in images {
            let resource = self.stages.images.find(&image.name, image.number);
            let resource = resource.ok_or_else(|| format!("no pass writes the image {}", image.name))?;
            let bound = Bound { resource, buffer: 0, is_before: false };
            let (offset, size) = self.stages.images.whole(&resource);
            let sources = self.stages.images.views(&bound, place);
            let record = |source| self.pool.record(&self.gpu, &mut encoder, source, offset, size);
            copies.push(sources.map(record).collect::<Vec<_>>());
        }
        if copies.is_empty() {
            return Ok(Vec::new());
        }
        let submission = self.gpu.queue.submit([encoder.finish()]);
        Ok(copies
            .into_iter()
            .map(|views| views.into_iter().map(|copy| copy.submitted(submission.clone())).collect())
            .collect())
    }

    /// Returns the buffers of a frame's outputs, for all views.
    pub fn buffers(&self, program: &Program, place: Place) -> Vec<(Output, Vec<wgpu::Buffer>)> {
        let outputs = program.outputs().map(|number| &program.images()[number]);
        let buffers = |image: &Bound| self.stages.images.views(image, place).cloned().collect();
        outputs.map(|image| (image.resource.into(), buffers(image))).collect()
    }

    /// Waits for the readbacks of a requested image; returns its bytes, the leftmost view first.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device or the mapping failed.
    pub fn take(&mut self, views: Vec<ReadBack>) -> Result<Pixels, DeviceFailure> {
        views.into_iter().map(|view| Ok(self.finish(view)?.to_vec())).collect()
    }

    /// Returns true if a submission has completed. With `waits`, waits until it has.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device failed or took too long.
    pub fn has_ended(&self, last: &wgpu::SubmissionIndex, waits: bool, frame: u32) -> Result<bool, DeviceFailure> {
        if !waits {
            return self.gpu.has_ended(last);
        }
        let _span = tracing::info_span!("wait for device", frame).entered();
        self.gpu.wait(Some(last.clone())).map(|()| true)
    }
}
