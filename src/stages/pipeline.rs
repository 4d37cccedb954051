//! Tasks recorded with a device's pipelines.

use std::collections::HashMap;
use std::ops::Range;

use super::compile::{Built, StageError, buffer_entry, build};
use super::images::{Images, Place};
use super::layout::{Frame, Pass, View};
use super::scene_tables::{SceneBuffers, SceneTables, layout_entries};
use super::{Dispatch, Of, ROOMS, Slot, StageSettings, Work};
use crate::device::GpuDevice;
use crate::graph::{PhysicalImage, Resource, Stage};
use crate::image::Extent;
use crate::scene::rig::Eye;

/// Edge of the workgroups of row-wise shaders.
const TILE: u32 = 8;

/// Timestamps around a frame's tasks.
pub struct Stamps {
    pub queries: wgpu::QuerySet,
    used: u32,
}

impl Stamps {
    /// Most tasks of a frame that are timed.
    pub const CAPACITY: u32 = 256;

    pub fn new(device: &wgpu::Device) -> Self {
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("stamps"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * Self::CAPACITY,
        });
        Self { queries, used: 0 }
    }

    pub fn reset(&mut self) {
        self.used = 0;
    }

    /// Queries written since the reset.
    pub fn written(&self) -> u32 {
        2 * self.used
    }

    /// Index of the next pair, or none left.
    fn next(&mut self) -> Option<u32> {
        let pair = self.used;
        (pair < Self::CAPACITY).then(|| self.used += 1)?;
        Some(pair)
    }
}

#[derive(PartialEq, Eq, Hash)]
struct GroupKey {
    stage: Stage,
    view: Eye,
    filter: Option<(PhysicalImage, PhysicalImage)>,
    index: u32,
    place: Place,
}

/// What one device needs to carry out any task.
pub struct DeviceStages {
    settings: StageSettings,
    /// Samples per pixel, filter iterations and place of the frame that is set.
    spp: u32,
    iterations: u32,
    place: Place,
    pub images: Images,
    rooms: Vec<Built>,
    groups: HashMap<GroupKey, wgpu::BindGroup>,
    frame_only: wgpu::BindGroup,
    with_scene: wgpu::BindGroup,
    frame: wgpu::Buffer,
    previous: wgpu::Buffer,
    /// The counts that a repeated task begins with.
    kept: Option<wgpu::Buffer>,
}

fn find(rooms: &[Built], stage: Stage, jitter: bool) -> Option<&Built> {
    rooms.iter().find(|b| b.room.stage == stage && b.jitter.is_none_or(|j| j == jitter))
}

fn uniform(gpu: &GpuDevice, label: &str, size: usize) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size: size as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

impl DeviceStages {
    /// Makes images, scene tables and those pipelines of `stages` that the device does not have.
    pub fn new(
        gpu: &mut GpuDevice,
        mut settings: StageSettings,
        tables: &SceneTables,
        stages: &[Stage],
    ) -> Result<Self, StageError> {
        settings.needs.instances |= tables.has_instances();
        let images = Images::new(gpu, &settings)?;
        let scene = SceneBuffers::new(gpu, tables)?;
        let frame = uniform(gpu, "frame", size_of::<Frame>());
        let previous = uniform(gpu, "previous views", 2 * size_of::<View>());
        let constants = buffer_entry(0, wgpu::BufferBindingType::Uniform);
        let all: Vec<_> = std::iter::once(constants).chain(layout_entries()).collect();
        let group_layout = |label, entries: &[_]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries })
        };
        let frame_layout = group_layout("frame", &[constants]);
        let scene_layout = group_layout("frame and scene", &all);
        let bind = |layout, entries: &[_]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("group 0"), layout, entries })
        };
        let first = wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() };
        let frame_only = bind(&frame_layout, std::slice::from_ref(&first));
        let with_scene = bind(&scene_layout, &std::iter::once(first).chain(scene.entries()).collect::<Vec<_>>());
        let mut rooms = Vec::new();
        for room in ROOMS.iter().filter(|r| stages.contains(&r.stage)) {
            let group0 = if room.reads_scene { &scene_layout } else { &frame_layout };
            let _span = tracing::info_span!("build pipeline", stage = room.stage.name()).entered();
            // Rooms that differ in their dispatches alone share their pipelines.
            let same: Vec<Built> =
                rooms.iter().filter(|b: &&Built| b.room.shader == room.shader).map(|b| b.with(room)).collect();
            rooms.extend(if same.is_empty() { build(gpu, room, group0, &settings)? } else { same });
        }
        Ok(Self {
            spp: settings.spp,
            iterations: settings.iterations,
            settings,
            place: Place::default(),
            images,
            rooms,
            groups: HashMap::new(),
            frame_only,
            with_scene,
            frame,
            previous,
            kept: None,
        })
    }

    /// Sets the constants that the next submission's tasks see, and the place of what they leave.
    pub fn set_frame(&mut self, gpu: &GpuDevice, frame: &Frame, previous: &[View; 2], place: Place) {
        (self.spp, self.place) = (frame.spp, place);
        self.iterations = frame.layer_iterations.into_iter().fold(0, u32::max);
        gpu.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(frame));
        gpu.queue.write_buffer(&self.previous, 0, bytemuck::cast_slice(previous));
    }

    pub fn extent(&self) -> Extent {
        self.settings.extent
    }

    /// Runs every pipeline once on no rows, so that drivers compile now what they would at the first frame.
    pub fn warm_up(&mut self, gpu: &GpuDevice, stamps: &mut Stamps) {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let most = self.spp;
        let kinds = self.rooms.iter().map(|b| (b.room.stage, if b.jitter == Some(false) { 1 } else { most }));
        for (stage, spp) in kinds.collect::<Vec<_>>() {
            self.spp = spp;
            let filter = Some((Resource::Filtered(1), Resource::Filtered(2)));
            let task = StageTask { stage, view: Eye::Right, index: 0, rows: 0..0, valid: 0..0, filter };
            self.record(gpu, &mut encoder, stamps, &task, 1);
        }
        gpu.queue.submit([encoder.finish()]);
    }

    /// Records a task; returns the pair of timestamps around it, if any is left. It runs `runs` times, which takes that
    /// much longer and changes no byte: all stages set what they write, but for the counts (`adds_counts`).
    pub fn record(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        stamps: &mut Stamps,
        task: &StageTask,
        runs: u32,
    ) -> Option<u32> {
        find(&self.rooms, task.stage, self.settings.jitter(self.spp))?;
        let pair = stamps.next();
        let queries = |at: Option<u32>| at.map(|_| &stamps.queries);
        let counted = (runs > 1 && adds_counts(task.stage)).then(|| {
            let counts = self.images.buffer(PhysicalImage::Tally, task.view, self.place).clone();
            let kept = self.kept.get_or_insert_with(|| scratch(gpu, counts.size())).clone();
            encoder.copy_buffer_to_buffer(&counts, 0, &kept, 0, counts.size());
            (counts, kept)
        });
        for run in 0..runs {
            if let Some((counts, kept)) = counted.as_ref().filter(|_| run > 0) {
                encoder.copy_buffer_to_buffer(kept, 0, counts, 0, counts.size());
            }
            let begin = pair.filter(|_| run == 0).map(|p| 2 * p);
            let end = pair.filter(|_| run + 1 == runs).map(|p| 2 * p + 1);
            let times = queries(begin.or(end)).map(|query_set| wgpu::ComputePassTimestampWrites {
                query_set,
                beginning_of_pass_write_index: begin,
                end_of_pass_write_index: end,
            });
            self.record_once(gpu, encoder, times, task)?;
        }
        pair
    }

    fn record_once(
        &mut self,
        gpu: &GpuDevice,
        encoder: &mut wgpu::CommandEncoder,
        times: Option<wgpu::ComputePassTimestampWrites<'_>>,
        task: &StageTask,
    ) -> Option<()> {
        let jitter = self.settings.jitter(self.spp);
        let built = find(&self.rooms, task.stage, jitter)?;
        let key = GroupKey {
            stage: task.stage,
            view: task.view,
            filter: task.filter.map(|(a, b)| (a.physical(), b.physical())),
            index: if task.stage == Stage::Aov { task.index } else { 0 },
            place: self.place,
        };
        let (images, previous) = (&self.images, &self.previous);
        let group = self.groups.entry(key).or_insert_with_key(|k| bind_slots(gpu, built, images, previous, k));
        for &(image, bytes) in built.room.clears {
            encoder.clear_buffer(self.images.buffer(image, task.view, self.place), 0, bytes);
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(task.stage.name()),
            timestamp_writes: times,
        });
        pass.set_pipeline(&built.pipeline.compute);
        pass.set_bind_group(0, if built.room.reads_scene { &self.with_scene } else { &self.frame_only }, &[]);
        pass.set_bind_group(1, &*group, &[]);
        let work = Work {
            settings: &self.settings,
            spp: self.spp,
            iterations: self.iterations,
            view: task.view,
            index: task.index,
            device: gpu.info.index,
        };
        for dispatch in (built.room.dispatches)(&work) {
            let (args, columns) = match dispatch {
                Dispatch::Rows { columns, args } => (args, Some(columns)),
                Dispatch::Holes { args } => (args, None),
            };
            let constants = Pass {
                view: task.view as u32,
                row_begin: task.rows.start,
                row_end: task.rows.end,
                valid_begin: task.valid.start,
                valid_end: task.valid.end,
                args,
            };
            pass.set_immediates(0, bytemuck::bytes_of(&constants));
            match columns {
                Some(columns) => {
                    let rows = task.rows.end - task.rows.start;
                    pass.dispatch_workgroups(columns.div_ceil(TILE), rows.div_ceil(TILE).max(1), 1);
                }
                // The list is empty as long as nothing was reprojected.
                None if task.rows.is_empty() => pass.dispatch_workgroups(1, 1, 1),
                None => {
                    pass.dispatch_workgroups_indirect(
                        self.images.buffer(PhysicalImage::Holes, task.view, self.place),
                        4,
                    );
                }
            }
        }
        Some(())
    }
}

/// Whether a stage adds to the pixels' counts instead of setting them. The other images that it reads and writes, it
/// sets at its first sample, or sets bits of that are the same every time.
fn adds_counts(stage: Stage) -> bool {
    matches!(stage, Stage::PathTrace | Stage::HoleFill | Stage::Accumulate | Stage::Resolve | Stage::Tonemap)
}

fn scratch(gpu: &GpuDevice, size: u64) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("kept counts"),
        size,
        usage: wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// One stage on one view and one run of rows.
#[derive(Clone, Debug)]
pub struct StageTask {
    pub stage: Stage,
    pub view: Eye,
    pub index: u32,
    pub rows: Range<u32>,
    pub valid: Range<u32>,
    pub filter: Option<(Resource, Resource)>,
}

fn bind_slots(
    gpu: &GpuDevice,
    built: &Built,
    images: &Images,
    previous: &wgpu::Buffer,
    key: &GroupKey,
) -> wgpu::BindGroup {
    let filter = key.filter.unwrap_or((PhysicalImage::Radiance, PhysicalImage::Ping));
    let buffer = |slot: Slot| match slot {
        Slot::Read(image, Of::TaskView) | Slot::Write(image) => images.buffer(image, key.view, key.place),
        Slot::Read(image, Of::Left) => images.buffer(image, Eye::Left, key.place),
        Slot::FilterSource => images.buffer(filter.0, key.view, key.place),
        Slot::FilterTarget => images.buffer(filter.1, key.view, key.place),
        Slot::AovTarget => images.buffer(PhysicalImage::Aov(key.index as u8), key.view, key.place),
        Slot::PreviousViews => previous,
    };
    let slots = built.room.slots.iter().enumerate();
    let entries: Vec<_> = slots
        .map(|(i, &slot)| wgpu::BindGroupEntry { binding: i as u32, resource: buffer(slot).as_entire_binding() })
        .collect();
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some(built.room.shader),
        layout: &built.pipeline.layout,
        entries: &entries,
    })
}
