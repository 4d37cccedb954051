//! Rooms made into pipelines on a device.

use super::layout::Pass;
use super::scene_tables::TableError;
use super::{Room, Slot, StageSettings};
use crate::device::{GpuDevice, Pipeline, PipelineKey, override_names, wgsl};

const PASS_BYTES: u32 = size_of::<Pass>() as u32;

#[derive(Debug, thiserror::Error)]
pub enum StageError {
    #[error(transparent)]
    Tables(#[from] TableError),
    #[error(transparent)]
    Images(#[from] super::TooLarge),
    #[error("device {device} refused the shader of stage {stage}: {what}")]
    Pipeline { device: usize, stage: &'static str, what: String },
}

/// A room with its pipeline.
pub struct Built {
    pub room: &'static Room,
    /// Whether it is for frames whose samples are spread over pixels; none: for any.
    pub jitter: Option<bool>,
    pub pipeline: Pipeline,
}

impl Built {
    /// The same pipeline for another room.
    pub fn with(&self, room: &'static Room) -> Self {
        Self { room, jitter: self.jitter, pipeline: self.pipeline.clone() }
    }
}

/// A room's pipelines for all frames that there may be.
pub fn build(
    gpu: &mut GpuDevice,
    room: &'static Room,
    group0: &wgpu::BindGroupLayout,
    settings: &StageSettings,
) -> Result<Vec<Built>, StageError> {
    let source = wgsl(room.shader);
    let declared = override_names(&source);
    let mut one = |kind: Option<bool>, jitter| {
        let constants = settings.constants(jitter).into_iter().filter(|(n, _)| declared.contains(n)).collect();
        let key = PipelineKey { shader: room.shader, checks: settings.checks, constants };
        let pipeline = match gpu.pipelines.get(&key) {
            Some(kept) => kept.clone(),
            None => {
                let new = compile(gpu, room, group0, &key, &source)?;
                gpu.pipelines.entry(key).or_insert(new).clone()
            }
        };
        Ok(Built { room, jitter: kind, pipeline })
    };
    match settings.jitters() {
        &[jitter] => Ok(vec![one(None, jitter)?]),
        _ if !declared.contains(&"JITTER") => Ok(vec![one(None, false)?]),
        kinds => kinds.iter().map(|&jitter| one(Some(jitter), jitter)).collect(),
    }
}

fn compile(
    gpu: &GpuDevice,
    room: &Room,
    group0: &wgpu::BindGroupLayout,
    key: &PipelineKey,
    source: &str,
) -> Result<Pipeline, StageError> {
    let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let descriptor =
        wgpu::ShaderModuleDescriptor { label: Some(room.shader), source: wgpu::ShaderSource::Wgsl(source.into()) };
    // SAFETY: the shader is part of this crate. Its loops end, its integer divisors are not zero; bounds stay checked.
    let module = unsafe { gpu.device.create_shader_module_trusted(descriptor, key.checks.runtime_checks()) };
    let entries: Vec<_> = room.slots.iter().enumerate().map(|(i, s)| slot_layout(i as u32, *s)).collect();
    let layout = gpu
        .device
        .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(room.shader), entries: &entries });
    let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(room.shader),
        bind_group_layouts: &[Some(group0), Some(&layout)],
        immediate_size: PASS_BYTES,
    });
    let constants: Vec<_> = key.constants.iter().map(|&(name, on)| (name, f64::from(u8::from(on)))).collect();
    let compute = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(room.shader),
        layout: Some(&pipeline_layout),
        module: &module,
        entry_point: Some("main"),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &constants,
            zero_initialize_workgroup_memory: false,
        },
        cache: None,
    });
    if let Some(error) = pollster::block_on(scope.pop()) {
        let (device, stage, what) = (gpu.info.index, room.stage.name(), error.to_string());
        return Err(StageError::Pipeline { device, stage, what });
    }
    Ok(Pipeline { compute, layout })
}

fn slot_layout(binding: u32, slot: Slot) -> wgpu::BindGroupLayoutEntry {
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    buffer_entry(
        binding,
        match slot {
            Slot::Read(..) | Slot::FilterSource => storage(true),
            Slot::Write(_) | Slot::FilterTarget | Slot::AovTarget => storage(false),
            Slot::PreviousViews => wgpu::BufferBindingType::Uniform,
        },
    )
}

pub fn buffer_entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}
