//! Records commands with a device's pipelines.

use std::collections::HashMap;
use std::mem::offset_of;
use std::sync::Arc;

use super::compile::{Built, StageError, buffer_entry, projection_layout};
use super::images::{Images, Place};
use super::kernels::Kernels;
use crate::device::GpuDevice;
use crate::frame::RunConfig;
use crate::graph::{Bound, Format, Kernel, Program, Resource, Stage};
use crate::layout::{Camera, DisplayMap, Frame, Previous, Sampling};
use crate::passes::{Moving, PREVIOUS};
use crate::plan::{EyeImage, Groups, Launched, launched};
use crate::samples::PixelSamples;
use crate::scene::rig::Eye;
use crate::schedule::Position;
use crate::tables::{SceneBuffers, SceneTables, SceneUpdate, changing_entry, layout_entries, limits, scene_buffers};

/// Key of a bind group: the kernel's name, the bound images, and the [`Place`] that selects their buffers.
type GroupKey = (&'static str, Vec<(Bound, Eye)>, Place);

/// Pipelines, images and scene of one device, with which it records commands.
pub struct DeviceStages {
    config: RunConfig,
    pub images: Images,
    built: Vec<Built>,
    kernels: Kernels,
    /// Bind groups of kernels, by bound images.
    groups: HashMap<GroupKey, wgpu::BindGroup>,
    /// Bind groups by index of the pass in `program`, the latest one. They are clones of those in `groups`.
    of_passes: HashMap<(usize, Place), wgpu::BindGroup>,
    program: Option<Arc<Program>>,
    /// Bind group 0 by view, and by [`SceneUse`](crate::graph::SceneUse): the frame's constants, followed by nothing, by
    /// the scene, or by the tables that kernels write.
    frame_groups: Vec<[wgpu::BindGroup; 3]>,
    /// Bind group 2 of kernels that read constants of the projection.
    projection: Option<wgpu::BindGroup>,
    scene: SceneBuffers,
    /// The frame's constants by view, with the camera of its source and then with that of its partner; up to two views
    /// share one set.
    frames: Vec<wgpu::Buffer>,
    /// Copies of images that repeated dispatches add to, by binding and size in bytes.
    saved: HashMap<(usize, u64), wgpu::Buffer>,
}

fn find<'a>(built: &'a [Built], kernel: &Kernel, jitter: bool) -> Option<&'a Built> {
    built.iter().find(|b| b.kernel == *kernel && b.jitter.is_none_or(|j| j == jitter))
}

const UNIFORM: wgpu::BufferUsages = wgpu::BufferUsages::UNIFORM.union(wgpu::BufferUsages::COPY_DST);
const SCRATCH: wgpu::BufferUsages = wgpu::BufferUsages::COPY_SRC.union(wgpu::BufferUsages::COPY_DST);

/// Creates the bind group of the projection's constants; `None` if it has none.
fn bind_projection(gpu: &GpuDevice, config: &RunConfig) -> Option<wgpu::BindGroup> {
    let bytes = config.envelope.most.polar?.method().constants(config.screen());
    if bytes.is_empty() {
        return None;
    }
    let buffer = gpu.buffer("projection", bytes.len() as u64, UNIFORM);
    gpu.queue.write_buffer(&buffer, 0, &bytes);
    Some(gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("projection"),
        layout: &projection_layout(gpu),
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
    }))
}

impl DeviceStages {
    /// Creates the images of all programs, the scene's tables, and the pipelines that the device has not cached.
    pub fn new(
        gpu: &mut GpuDevice,
        mut config: RunConfig,
        tables: &SceneTables,
        programs: &[Program],
    ) -> Result<Self, StageError> {
        config.buffers.needs.instances |= tables.has_instances();
        limits::check(
            &gpu.device.limits(),
            gpu.info.index,
            limits::of_frames(programs, scene_buffers(gpu.quirks.tables)),
        )?;
        let scene = SceneBuffers::new(gpu, tables)?;
        let images = Images::new(gpu, programs, config.grid(), config.execution.frames_in_flight);
        let views = programs.iter().map(Program::views).max().unwrap_or(1);
        let sets = if views > 2 { 2 * views } else { 1 };
        let frames: Vec<_> = (0..sets).map(|_| gpu.buffer("frame", size_of::<Frame>() as u64, UNIFORM)).collect();
        let constants = buffer_entry(0, wgpu::BufferBindingType::Uniform);
        let label = Some("group 0");
        let layout = |entries: Vec<_>| {
            let entries = [vec![constants], entries].concat();
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries: &entries })
        };
        let layouts = [
            layout(Vec::new()),
            layout(layout_entries(gpu.scene_access())),
            layout(vec![changing_entry(gpu.quirks.tables)]),
        ];
        let of_view = |frame: &wgpu::Buffer| {
            let group = |layout: &wgpu::BindGroupLayout, entries: Vec<_>| {
                let first = wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() };
                let entries = [vec![first], entries].concat();
                gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label, layout, entries: &entries })
            };
            [
                group(&layouts[0], Vec::new()),
                group(&layouts[1], scene.entries()),
                group(&layouts[2], vec![scene.tables_entry()]),
            ]
        };
        let frame_groups = frames.iter().map(of_view).collect();
        let kernels = Kernels::new(programs, layouts);
        let built = kernels.build(gpu, &config)?;
        for (resource, bytes) in tables.skin_inputs().into_iter().filter(|(resource, _)| images.has(resource)) {
            gpu.queue.write_buffer(input(&images, resource), 0, bytes);
        }
        Ok(Self {
            images,
            built,
            kernels,
            groups: HashMap::new(),
            of_passes: HashMap::new(),
            program: None,
            frame_groups,
            projection: bind_projection(gpu, &config),
            config,
            scene,
            frames,
            saved: HashMap::new(),
        })
    }

    /// Builds the pipelines again if shaders are read from a folder and have changed.
    pub fn reload(&mut self, gpu: &mut GpuDevice) {
        if let Some(built) = self.kernels.rebuild(gpu, &self.config) {
            self.built = built;
            self.groups.clear();
            self.of_passes.clear();
        }
    }

    /// Writes the constants of a frame and of the one before, as [`of_views`](crate::frame::constants::of_views) returns
    /// them, and updates the scene's tables,
    /// for the next submission.
    pub fn begin(&mut self, gpu: &GpuDevice, constants: &[(Frame, Previous)], update: &SceneUpdate) {
        let bound = Bound { resource: PREVIOUS, buffer: 0, is_before: false };
        let has_previous = self.images.has(&PREVIOUS);
        let mut befores = has_previous.then(|| self.images.views(&bound, Place::default()));
        for (buffer, (frame, previous)) in self.frames.iter().zip(constants) {
            gpu.queue.write_buffer(buffer, 0, bytemuck::bytes_of(frame));
            if let Some(before) = befores.as_mut().and_then(Iterator::next) {
                gpu.queue.write_buffer(before, 0, bytemuck::bytes_of(previous));
            }
        }
        let pose = self.config.buffers.moving.as_ref().map(Moving::pose).filter(|pose| self.images.has(pose));
        if let Some(pose) = pose {
            gpu.queue.write_buffer(input(&self.images, pose), 0, bytemuck::cast_slice(&update.pose));
        }
        self.scene.update(gpu, update);
    }

    /// Records that the constants of a frame, which all views share, are set, for the commands that follow in the encoder.
    pub fn set_constants(
        &self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        frame: &Frame,
        previous: &Previous,
    ) {
        let mut set = |to: &wgpu::Buffer, bytes: &[u8]| {
            let staged = gpu.staged(bytemuck::cast_slice(bytes).iter().copied());
            encoder.copy_buffer_to_buffer(&staged, 0, to, 0, bytes.len() as u64);
        };
        set(&self.frames[0], bytemuck::bytes_of(frame));
        set(input(&self.images, PREVIOUS), bytemuck::bytes_of(previous));
    }

    /// Sets the display resampling of both eyes for submissions from here on.
    pub fn show(&self, gpu: &GpuDevice, maps: &[DisplayMap; 2]) {
        self.write(gpu, offset_of!(Frame, camera) + offset_of!(Camera, display_maps), bytemuck::cast_slice(maps));
    }

    /// Sets the least number of samples per pixel for submissions from here on.
    pub fn set_least_samples(&self, gpu: &GpuDevice, least: u32) {
        let at = offset_of!(Frame, sampling) + offset_of!(Sampling, samples) + offset_of!(PixelSamples, least);
        self.write(gpu, at, bytemuck::bytes_of(&least));
    }

    /// Writes a part of the constants of all views.
    fn write(&self, gpu: &GpuDevice, at: usize, bytes: &[u8]) {
        self.frames.iter().for_each(|frame| gpu.queue.write_buffer(frame, at as u64, bytes));
    }

    /// Runs every pipeline of these programs once on no rows, so that drivers compile it now rather than in the first
    /// frame.
    pub fn warm_up(&mut self, gpu: &GpuDevice, programs: &[Program]) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut warm: Vec<(&str, bool)> = Vec::new();
        for program in programs {
            let program = &Arc::new(program.clone());
            let place = Place::default();
            let mut recording = Recording { gpu, queries: None, encoder: &mut encoder, program, place };
            for (pass, linked) in program.passes().iter().enumerate() {
                let kernel = linked.pass.kernel;
                let of_kernel = self.built.iter().filter(|b| b.kernel.name == kernel.name);
                let kinds: Vec<bool> =
                    of_kernel.map(|b| b.jitter.unwrap_or(!self.config.envelope.centres_one())).collect();
                for jitter in kinds {
                    if !warm.contains(&(kernel.name, jitter)) {
                        warm.push((kernel.name, jitter));
                        let samples = PixelSamples::own(0..if jitter { 2 } else { 1 }, !jitter);
                        let all = Position::start(&(0..0))..Position::END;
                        let launches = launched(program, pass, &(0..0), &(0..0), &all, samples, gpu.info.index);
                        self.dispatch(&mut recording, pass, &launches, [None; 2]);
                    }
                }
            }
        }
        gpu.queue.submit([encoder.finish()]);
    }

    /// Records that an image is set to zero; of a list, only the counts of pixels and workgroups.
    pub fn clear(&self, to: &mut Recording<'_>, image: &EyeImage) {
        let bytes = (image.bound.resource.format == Format::List).then_some(8);
        to.encoder.clear_buffer(self.images.buffer(&image.bound, image.eye, to.place), 0, bytes);
    }

    /// Records a copy of an image that a pass binds at this number.
    pub fn save(&mut self, to: &mut Recording<'_>, binding: usize, image: &EyeImage) {
        let image = self.images.buffer(&image.bound, image.eye, to.place);
        let saved =
            self.saved.entry((binding, image.size())).or_insert_with(|| to.gpu.buffer("saved", image.size(), SCRATCH));
        to.encoder.copy_buffer_to_buffer(image, 0, saved, 0, image.size());
    }

    /// Records that the copy which [`Self::save`] made last is brought back.
    pub fn restore(&self, to: &mut Recording<'_>, binding: usize, image: &EyeImage) {
        let image = self.images.buffer(&image.bound, image.eye, to.place);
        if let Some(saved) = self.saved.get(&(binding, image.size())) {
            to.encoder.copy_buffer_to_buffer(saved, 0, image, 0, image.size());
        }
    }

    /// Records that the acceleration structures of dynamic geometry are built from the vertices that a pass wrote, and
    /// the timestamp `ends` behind it.
    pub fn build(&self, to: &mut Recording<'_>, pass: usize, ends: Option<u32>) {
        let pass = &to.program.passes()[pass].pass;
        let Some(resource) = pass.builds_from else { return };
        let bound = Bound { resource, buffer: 0, is_before: false };
        self.scene.build_structures(to.encoder, self.images.buffer(&bound, pass.view, to.place));
        // Acceleration structure builds belong to no pass, so an empty pass after them writes the timestamp.
        drop(to.begin_pass(pass.stage, [None, ends]));
    }

    /// Records the launches of a pass, between the timestamps of these indices.
    pub fn dispatch(
        &mut self,
        to: &mut Recording<'_>,
        pass: usize,
        launches: &[Launched],
        [begins, ends]: [Option<u32>; 2],
    ) {
        let Recording { gpu, program, place, .. } = *to;
        if !self.program.as_ref().is_some_and(|latest| Arc::ptr_eq(latest, program)) {
            self.program = Some(Arc::clone(program));
            self.of_passes.clear();
        }
        let linked = &program.passes()[pass];
        let (declared, kernel) = (&linked.pass, &linked.pass.kernel);
        // All pipelines of a kernel have the same layout.
        let Some(first) = self.built.iter().find(|built| built.kernel == *kernel) else { return };
        let (images, groups) = (&self.images, &mut self.groups);
        let group = self.of_passes.entry((pass, place)).or_insert_with(|| {
            let uses = declared.uses.iter().zip(&linked.images);
            let bound: Vec<_> = uses.map(|(used, &i)| (program.images()[i], declared.eye_of(used))).collect();
            let new = |key: &(_, Vec<_>, _)| bind(gpu, first, images, &key.1, place);
            groups.entry((kernel.name, bound, place)).or_insert_with_key(new).clone()
        });
        let mut recorded = to.begin_pass(declared.stage, [begins, ends]);
        let set = declared.view.index() + if declared.sees_partner() { declared.view.views() } else { 0 };
        let of_view = &self.frame_groups[set.min(self.frame_groups.len() - 1)];
        recorded.set_bind_group(0, &of_view[kernel.scene as usize], &[]);
        recorded.set_bind_group(1, &*group, &[]);
        recorded.set_bind_group(2, self.projection.as_ref(), &[]);
        for Launched { jitter, constants, groups } in launches {
            let Some(built) = find(&self.built, kernel, *jitter) else { continue };
            recorded.set_pipeline(&built.pipeline.compute);
            recorded.set_immediates(0, bytemuck::bytes_of(constants));
            match *groups {
                Groups::Direct([x, y, z]) => recorded.dispatch_workgroups(x, y, z),
                Groups::Listed(resource) => {
                    let bound = Bound { resource, buffer: 0, is_before: false };
                    recorded.dispatch_workgroups_indirect(images.buffer(&bound, declared.view, place), 4);
                }
            }
        }
    }
}

/// An encoder to record to, and the data that all commands of a frame share.
pub struct Recording<'a> {
    pub gpu: &'a GpuDevice,
    /// Timestamps around the dispatches; `None` if they are not timed.
    pub queries: Option<&'a wgpu::QuerySet>,
    pub encoder: &'a mut wgpu::CommandEncoder,
    pub program: &'a Arc<Program>,
    /// Selects the buffers that the frame writes.
    pub place: Place,
}

impl Recording<'_> {
    /// Begins a pass between the timestamps of these indices.
    fn begin_pass(&mut self, stage: Stage, [begins, ends]: [Option<u32>; 2]) -> wgpu::ComputePass<'_> {
        let times = begins.or(ends).and(self.queries).map(|query_set| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: begins,
            end_of_pass_write_index: ends,
        });
        let label = Some(stage.name());
        self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes: times })
    }
}

/// Returns the buffer of a resource that the host writes.
fn input(images: &Images, resource: Resource) -> &wgpu::Buffer {
    images.buffer(&Bound { resource, buffer: 0, is_before: false }, Eye::LEFT, Place::default())
}

fn bind(gpu: &GpuDevice, built: &Built, images: &Images, bound: &[(Bound, Eye)], place: Place) -> wgpu::BindGroup {
    let entry = |(i, (bound, eye)): (usize, &(Bound, Eye))| wgpu::BindGroupEntry {
        binding: i as u32,
        resource: images.buffer(bound, *eye, place).as_entire_binding(),
    };
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(built.kernel.name),
        layout: &built.pipeline.layout,
        entries: &bound.iter().enumerate().map(entry).collect::<Vec<_>>(),
    })
}
