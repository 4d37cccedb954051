//! Records tasks with a device's pipelines.

use std::collections::HashMap;
use std::mem::offset_of;
use std::sync::Arc;

use super::RunConfig;
use super::compile::{Built, StageError, buffer_entry, build, projection_layout};
use super::images::{Images, Place};
use super::layout::{Camera, DisplayMap, Frame, PassConstants, Previous};
use super::limits;
use super::scene_tables::{SceneBuffers, SceneTables, SceneUpdate, changing_entries, layout_entries, scene_buffers};
use super::task::{StageTask, Stamps};
use super::workgroups::{Groups, workgroups};
use crate::device::GpuDevice;
use crate::frame::samples::PixelSamples;
use crate::graph::{Access, Bound, Format, Kernel, Program, Resource, SceneUse, Use};
use crate::image::Extent;
use crate::passes::{Moving, PREVIOUS};
use crate::scene::rig::Eye;

/// Key of a bind group: the kernel's name, the bound images, and the [`Place`] that selects their buffers.
type GroupKey = (&'static str, Vec<(Bound, Eye)>, Place);

/// Pipelines, images and scene of one device, with which it records tasks.
pub struct DeviceStages {
    config: RunConfig,
    /// Samples per pixel of the current frame, and the [`Place`] that selects its buffers.
    samples: PixelSamples,
    place: Place,
    pub images: Images,
    built: Vec<Built>,
    /// Bind groups of kernels, by bound images.
    groups: HashMap<GroupKey, wgpu::BindGroup>,
    /// Bind groups by index of the pass in the current program. They are clones of those in `groups`.
    of_passes: HashMap<(usize, Place), wgpu::BindGroup>,
    program: Option<Arc<Program>>,
    frame_only: wgpu::BindGroup,
    with_scene: wgpu::BindGroup,
    /// Bind group 0 of kernels that write the scene's tables: the frame's constants and these tables.
    changing_scene: wgpu::BindGroup,
    /// Bind group 2 of kernels that read constants of the projection.
    projection: Option<wgpu::BindGroup>,
    scene: SceneBuffers,
    frame: wgpu::Buffer,
    /// Snapshots of the images that repeated tasks add to, taken before the task, by binding and size in bytes.
    found: HashMap<(usize, u64), wgpu::Buffer>,
}

fn find<'a>(built: &'a [Built], kernel: &Kernel, jitter: bool) -> Option<&'a Built> {
    built.iter().find(|b| b.kernel == *kernel && b.jitter.is_none_or(|j| j == jitter))
}

fn uniform(gpu: &GpuDevice, label: &str, size: usize) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Creates the bind group of the projection's constants; `None` if it has none.
fn bind_projection(gpu: &GpuDevice, config: &RunConfig) -> Option<wgpu::BindGroup> {
    let bytes = config.envelope.most.polar?.method().constants(config.screen());
    if bytes.is_empty() {
        return None;
    }
    let buffer = uniform(gpu, "projection", bytes.len());
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
        let frame = uniform(gpu, "frame", size_of::<Frame>());
        let constants = buffer_entry(0, wgpu::BufferBindingType::Uniform);
        let all: Vec<_> = std::iter::once(constants).chain(layout_entries(gpu.scene_access())).collect();
        let group_layout = |label, entries: &[_]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
        };
        let frame_layout = group_layout("frame", &[constants]);
        let scene_layout = group_layout("frame and scene", &all);
        let changing: Vec<_> = std::iter::once(constants).chain(changing_entries(gpu.quirks.tables)).collect();
        let changing_layout = group_layout("frame and changed tables", &changing);
        let bind = |layout, entries: &[_]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("group 0"), layout, entries })
        };
        let first = wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() };
        let frame_only = bind(&frame_layout, std::slice::from_ref(&first));
        let with_scene =
            bind(&scene_layout, &std::iter::once(first.clone()).chain(scene.entries()).collect::<Vec<_>>());
        let tables_entry = std::iter::once(first).chain(scene.tables_entry()).collect::<Vec<_>>();
        let changing_scene = bind(&changing_layout, &tables_entry);
        let mut built: Vec<Built> = Vec::new();
        for pass in programs.iter().flat_map(Program::passes).map(|p| &p.pass) {
            if built.iter().any(|b| b.kernel == pass.kernel) {
                continue;
            }
            let group0 = match pass.kernel.scene {
                SceneUse::No => &frame_layout,
                SceneUse::Read => &scene_layout,
                SceneUse::Write => &changing_layout,
            };
            let _span = tracing::info_span!("build pipeline", shader = pass.kernel.name).entered();
            built.extend(build(gpu, pass, group0, &config)?);
        }
        for (resource, bytes) in tables.skin_inputs().into_iter().filter(|(resource, _)| images.has(resource)) {
            gpu.queue.write_buffer(input(&images, resource), 0, bytes);
        }
        Ok(Self {
            samples: PixelSamples::own(0..1, config.envelope.centres_one()),
            place: Place::default(),
            images,
            built,
            groups: HashMap::new(),
            of_passes: HashMap::new(),
            program: None,
            frame_only,
            with_scene,
            changing_scene,
            projection: bind_projection(gpu, &config),
            config,
            scene,
            frame,
            found: HashMap::new(),
        })
    }

    /// Sets the program and the constants for the tasks of the next submission. `place` selects the buffers that they
    /// write.
    pub fn set_frame(
        &mut self,
        gpu: &GpuDevice,
        program: &Arc<Program>,
        frame: &Frame,
        previous: &Previous,
        update: &SceneUpdate,
        place: Place,
    ) {
        if !self.program.as_ref().is_some_and(|p| Arc::ptr_eq(p, program)) {
            self.program = Some(Arc::clone(program));
            self.of_passes.clear();
        }
        (self.samples, self.place) = (frame.sampling.samples, place);
        gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        if self.images.has(&PREVIOUS) {
            gpu.queue.write_buffer(input(&self.images, PREVIOUS), 0, bytemuck::bytes_of(previous));
        }
        let pose = self.config.buffers.moving.as_ref().map(Moving::pose).filter(|pose| self.images.has(pose));
        if let Some(pose) = pose {
            gpu.queue.write_buffer(input(&self.images, pose), 0, bytemuck::cast_slice(&update.pose));
        }
        self.scene.update(gpu, update);
    }

    /// Sets the display resampling of both eyes for submissions from here on.
    pub fn show(&self, gpu: &GpuDevice, maps: &[DisplayMap; 2]) {
        let at = offset_of!(Frame, camera) + offset_of!(Camera, display_maps);
        gpu.queue.write_buffer(&self.frame, at as u64, bytemuck::cast_slice(maps));
    }

    pub fn extent(&self) -> Extent {
        self.config.buffers.extent
    }

    /// Runs every pipeline of these programs once on no rows, so that drivers compile it now rather than in the first
    /// frame.
    pub fn warm_up(&mut self, gpu: &GpuDevice, stamps: &mut Stamps, programs: Vec<Program>) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut warm: Vec<(&str, bool)> = Vec::new();
        for program in programs {
            let program = Arc::new(program);
            (self.program, self.place) = (Some(Arc::clone(&program)), Place::default());
            self.of_passes.clear();
            for (number, linked) in program.passes().iter().enumerate() {
                let kernel = linked.pass.kernel;
                let of_kernel = self.built.iter().filter(|b| b.kernel.name == kernel.name);
                let kinds: Vec<bool> =
                    of_kernel.map(|b| b.jitter.unwrap_or(!self.config.envelope.centres_one())).collect();
                for jitter in kinds {
                    if !warm.contains(&(kernel.name, jitter)) {
                        warm.push((kernel.name, jitter));
                        let count = if jitter { 2 } else { 1 };
                        self.samples = PixelSamples::own(0..count, !jitter);
                        self.record(gpu, &mut encoder, stamps, &StageTask::new(number, 0..0, 0..0), 1);
                    }
                }
            }
        }
        gpu.queue.submit([encoder.finish()]);
    }

    /// Records a task, or a part of one. Returns the index of the pair of timestamps around the whole task; `None` if
    /// all pairs are in use. To simulate a slow device, the task is repeated until it has run `runs` times. This
    /// changes no byte of the images: those that the task adds to are restored before each repetition.
    pub fn record(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        stamps: &mut Stamps,
        task: &StageTask,
        runs: u32,
    ) -> Option<u32> {
        let program = Arc::clone(self.program.as_ref()?);
        let linked = &program.passes()[task.pass];
        let pair = if task.begins() { stamps.begin() } else { stamps.current() };
        let builds_from = linked.pass.builds_from.filter(|_| task.ends() && !task.rows.is_empty());
        let added_to = if runs > 1 { self.keep_found(gpu, encoder, &program, task) } else { Vec::new() };
        for run in 0..runs {
            for (image, found) in added_to.iter().filter(|_| run > 0) {
                encoder.copy_buffer_to_buffer(found, 0, image, 0, image.size());
            }
            let begin = pair.filter(|_| run == 0 && task.begins()).map(|p| 2 * p);
            let end = pair.filter(|_| run + 1 == runs && task.ends()).map(|p| 2 * p + 1);
            let times = |begin: Option<u32>, end: Option<u32>| {
                begin.or(end).map(|_| wgpu::ComputePassTimestampWrites {
                    query_set: &stamps.queries,
                    beginning_of_pass_write_index: begin,
                    end_of_pass_write_index: end,
                })
            };
            self.record_once(gpu, encoder, times(begin, end.filter(|_| builds_from.is_none())), &program, task)?;
            if let Some(resource) = builds_from {
                let bound = Bound { resource, buffer: 0, is_before: false };
                let vertices = self.images.buffer(&bound, Eye::Left, self.place);
                self.scene.build_structures(encoder, vertices);
                // Acceleration structure builds belong to no pass, so an empty pass after them writes the end
                // timestamp.
                let (label, timestamp_writes) = (Some(linked.pass.stage.name()), times(None, end));
                drop(encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes }));
            }
        }
        pair
    }

    /// Saves copies of the images that a task adds to, and returns the images with their copies. Later parts of a task
    /// may add to any image that the first part wrote.
    fn keep_found(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        program: &Program,
        task: &StageTask,
    ) -> Vec<(wgpu::Buffer, wgpu::Buffer)> {
        let linked = &program.passes()[task.pass];
        let is_added_to = |used: &Use| used.access == Access::Add || (used.access.writes() && !task.begins());
        let mut kept = Vec::new();
        let uses = linked.pass.uses.iter().zip(&linked.images).enumerate();
        for (binding, (used, &image)) in uses.filter(|(_, (u, _))| is_added_to(u)) {
            let image = self.images.buffer(&program.images()[image], linked.pass.eye_of(used), self.place).clone();
            let found = self.found.entry((binding, image.size())).or_insert_with(|| scratch(gpu, image.size())).clone();
            encoder.copy_buffer_to_buffer(&image, 0, &found, 0, image.size());
            kept.push((image, found));
        }
        kept
    }

    fn record_once(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        times: Option<wgpu::ComputePassTimestampWrites<'_>>,
        program: &Program,
        task: &StageTask,
    ) -> Option<()> {
        let linked = &program.passes()[task.pass];
        let (declared, kernel) = (&linked.pass, &linked.pass.kernel);
        // All pipelines of a kernel have the same layout.
        let of_kernel = |jitter| find(&self.built, kernel, jitter);
        let first = of_kernel(false).or(of_kernel(true))?;
        let images = &self.images;
        let cleared = declared.uses.iter().zip(&linked.images).filter(|(u, _)| u.is_cleared && task.begins());
        for (used, &image) in cleared {
            // Clear only the counts of pixels and workgroups of a list.
            let bytes = (used.image.resource.format == Format::List).then_some(8);
            encoder.clear_buffer(images.buffer(&program.images()[image], declared.eye_of(used), self.place), 0, bytes);
        }
        let groups = &mut self.groups;
        let group = self.of_passes.entry((task.pass, self.place)).or_insert_with(|| {
            let uses = declared.uses.iter().zip(&linked.images);
            let bound: Vec<_> = uses.map(|(used, &i)| (program.images()[i], declared.eye_of(used))).collect();
            let new = |key: &(_, Vec<_>, _)| bind(gpu, first, images, &key.1, self.place);
            groups.entry((kernel.name, bound, self.place)).or_insert_with_key(new).clone()
        });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(declared.stage.name()),
            timestamp_writes: times,
        });
        let group0 = match kernel.scene {
            SceneUse::No => &self.frame_only,
            SceneUse::Read => &self.with_scene,
            SceneUse::Write => &self.changing_scene,
        };
        pass.set_bind_group(0, group0, &[]);
        pass.set_bind_group(1, &*group, &[]);
        pass.set_bind_group(2, self.projection.as_ref(), &[]);
        let extent = declared.grid.extent(program.extent);
        for (number, run) in (0..).zip(self.samples.runs(&declared.launches)) {
            let rows = task.rows_of(number);
            if rows.is_empty() && !task.rows.is_empty() {
                continue;
            }
            // Kernels that change the scene do nothing if their arguments are 0.
            let is_idle = rows.is_empty() && kernel.scene == SceneUse::Write;
            let constants = PassConstants {
                view: declared.view as u32,
                row_begin: rows.start,
                row_end: rows.end,
                valid_begin: task.valid.start,
                valid_end: task.valid.end,
                args: if is_idle { [0; 3] } else { run.args },
                width: extent.width,
                height: extent.height,
                device: gpu.info.index as u32,
            };
            pass.set_pipeline(&of_kernel(run.jitter)?.pipeline.compute);
            pass.set_immediates(0, bytemuck::bytes_of(&constants));
            match workgroups(declared.dispatch, kernel.workgroup, extent.width, &rows) {
                Groups::Direct([x, y, z]) => pass.dispatch_workgroups(x, y, z),
                Groups::Listed(list) => {
                    let bound = Bound { resource: list, buffer: 0, is_before: false };
                    pass.dispatch_workgroups_indirect(images.buffer(&bound, declared.view, self.place), 4);
                }
            }
        }
        Some(())
    }
}

/// Returns the buffer of a resource that the host writes.
fn input(images: &Images, resource: Resource) -> &wgpu::Buffer {
    images.buffer(&Bound { resource, buffer: 0, is_before: false }, Eye::Left, Place::default())
}

fn scratch(gpu: &GpuDevice, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("found"),
        size,
        usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
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
