//! A device with everything that its worker needs to execute tasks of frames.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use crate::device::{DeviceFailure, GpuClock, GpuDevice};
use crate::exec::messages::{Bytes, FrameJob, Pixels};
use crate::exec::output::Output;
use crate::exec::staging::{Mapped, Pool, ReadBack, Recorded};
use crate::exec::{ExecError, InjectedKind};
use crate::graph::{Bound, Program, Task, TaskKind};
use crate::scene::rig::Eye;
use crate::schedule::Position;
use crate::stages::{DeviceStages, Place, RunConfig, SceneTables, StageTask, Stamps, layout};

pub struct WorkerDevice {
    pub gpu: GpuDevice,
    stages: DeviceStages,
    stamps: Stamps,
    stamp_buffer: wgpu::Buffer,
    clock: GpuClock,
    pool: Pool,
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
        let mut stamps = Stamps::new(&gpu.device);
        stages.warm_up(&gpu, &mut stamps, programs.to_vec());
        gpu.wait(None).map_err(failed)?;
        let stamp_buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("stamps"),
            size: u64::from(2 * Stamps::CAPACITY) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let clock = GpuClock::of(&gpu);
        Ok(Self { gpu, stages, stamps, stamp_buffer, clock, pool: Pool::default(), origin })
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

    /// Prepares a frame: resets the timestamps and sets the program, the constants and the scene's update.
    pub fn begin(&mut self, job: &FrameJob, program: &Arc<Program>) {
        self.stamps.reset();
        self.stages.set_frame(&self.gpu, program, &job.constants, &job.previous, &job.update, job.place);
    }

    /// Sets each eye's mapping for the display resampling in later submissions of the frame.
    pub fn show(&self, maps: &[layout::DisplayMap; 2]) {
        self.stages.show(&self.gpu, maps);
    }

    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.gpu.device.create_command_encoder(&Default::default())
    }

    /// Records a part of a dispatch, `runs` times; returns the index of the dispatch's pair of timestamps.
    pub fn record(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        task: &Task,
        part: Range<Position>,
        runs: u32,
    ) -> Option<u32> {
        let TaskKind::Dispatch { pass, valid } = &task.kind else { return None };
        let stage_task = StageTask { part, ..StageTask::new(*pass, task.rows.clone(), valid.clone()) };
        self.stages.record(&self.gpu, encoder, &mut self.stamps, &stage_task, runs)
    }

    /// Records a copy of the task's rows of `image` to a readback buffer.
    pub fn record_copy(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        task: &Task,
        image: &Bound,
        place: Place,
    ) -> Recorded {
        let (offset, size) = self.stages.images.span(&image.resource, &task.rows);
        let source = self.stages.images.buffer(image, task.view, place);
        self.pool.record(&self.gpu, encoder, source, offset, size)
    }

    /// Records a copy of this frame's timestamps to a readback buffer, since the next frame overwrites them. Returns
    /// `None` if the frame has no timestamps.
    pub fn record_stamps(&mut self, encoder: &mut wgpu::CommandEncoder) -> Option<Recorded> {
        let written = self.stamps.written();
        (written > 0).then(|| {
            encoder.resolve_query_set(&self.stamps.queries, 0..written, &self.stamp_buffer, 0);
            self.pool.record(&self.gpu, encoder, &self.stamp_buffer, 0, u64::from(written) * 8)
        })
    }

    /// Writes the task's rows of an image; returns their size in bytes. The device executes the write at the head of
    /// its next submission.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the number of bytes is not that of the task's rows.
    pub fn write(&self, task: &Task, image: &Bound, place: Place, rows: &Bytes) -> Result<u64, DeviceFailure> {
        let (offset, size) = self.stages.images.span(&image.resource, &task.rows);
        if rows.len() as u64 != size {
            return Err(format!("{} bytes of rows arrived instead of {size}", rows.len()).into());
        }
        self.gpu.queue.write_buffer(self.stages.images.buffer(image, task.view, place), offset, rows);
        Ok(size)
    }

    /// Waits until the submission of a copy has completed; returns the copied bytes.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device or the mapping failed.
    pub fn finish(&mut self, back: ReadBack) -> Result<Mapped, DeviceFailure> {
        self.pool.finish(&self.gpu, back)
    }

    /// Returns the begin and end of tasks in milliseconds since the origin. `back` is the readback of all timestamps,
    /// and `pairs` holds the index of each task's pair of timestamps. `bracket_ms` lasts from the submission of the
    /// first task to the observed end of the last.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the readback failed.
    pub fn times(
        &mut self,
        back: ReadBack,
        pairs: &[u32],
        bracket_ms: &Range<f64>,
    ) -> Result<Vec<[f64; 2]>, DeviceFailure> {
        let all = bytemuck::pod_collect_to_vec::<u8, u64>(&self.finish(back)?);
        let ticks: Vec<u64> = pairs.iter().flat_map(|&pair| [0, 1].map(|end| all[2 * pair as usize + end])).collect();
        Ok(self.clock.host_ms(&ticks, bracket_ms).chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect())
    }

    /// Returns the maximum error of the device's times so far, in microseconds.
    pub fn clock_residual_us(&self) -> f64 {
        self.clock.residual_us
    }

    /// Submits copies of both eyes of `images` to the host; returns their readbacks.
    ///
    /// # Errors
    /// [`DeviceFailure`] if `images` contains an image that no pass writes.
    pub fn request(&mut self, images: &[Output], place: Place) -> Result<Vec<[ReadBack; 2]>, DeviceFailure> {
        let mut encoder = self.encoder();
        let mut copies = Vec::new();
        for image in images {
            let resource = self.stages.images.find(&image.name, image.number);
            let resource = resource.ok_or_else(|| format!("no pass writes the image {}", image.name))?;
            let bound = Bound { resource, buffer: 0, is_before: false };
            let (offset, size) = self.stages.images.whole(&resource);
            copies.push(Eye::ALL.map(|eye| {
                let source = self.stages.images.buffer(&bound, eye, place);
                self.pool.record(&self.gpu, &mut encoder, source, offset, size)
            }));
        }
        if copies.is_empty() {
            return Ok(Vec::new());
        }
        let submission = self.gpu.queue.submit([encoder.finish()]);
        Ok(copies.into_iter().map(|eyes| eyes.map(|copy| copy.submitted(submission.clone()))).collect())
    }

    /// Returns the buffers of a frame's outputs, for both eyes.
    pub fn buffers(&self, program: &Program, place: Place) -> Vec<(Output, [wgpu::Buffer; 2])> {
        let outputs = program.outputs().map(|number| &program.images()[number]);
        let buffers = |image: &Bound| Eye::ALL.map(|eye| self.stages.images.buffer(image, eye, place).clone());
        outputs.map(|image| (image.resource.into(), buffers(image))).collect()
    }

    /// Waits for the readbacks of a requested image; returns its bytes, left eye first.
    ///
    /// # Errors
    /// [`DeviceFailure`] if the device or the mapping failed.
    pub fn take(&mut self, [left, right]: [ReadBack; 2]) -> Result<Pixels, DeviceFailure> {
        Ok([self.finish(left)?.to_vec(), self.finish(right)?.to_vec()])
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
