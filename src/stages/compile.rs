//! Compiles the pipelines of passes on a device.

use super::shader::{Shader, ShaderVariant, override_names};
use super::shader_files::ShaderError;
use crate::device::{GpuDevice, Pipeline, PipelineKey};
use crate::frame::RunConfig;
use crate::graph::{Access, Format, Kernel, Pass, ProgramError, Use};
use crate::layout::PassConstants;
use crate::tables::LimitExceeded;

const PASS_BYTES: u32 = size_of::<PassConstants>() as u32;

#[derive(Debug, thiserror::Error)]
pub enum StageError {
    #[error(transparent)]
    Limit(#[from] LimitExceeded),
    #[error(transparent)]
    Program(#[from] ProgramError),
    #[error(transparent)]
    Shader(#[from] ShaderError),
    #[error("device {device} refused the shader {shader}: {what}")]
    Pipeline { device: usize, shader: &'static str, what: String },
}

/// A kernel's pipeline.
pub struct Built {
    pub kernel: Kernel,
    /// True if the pipeline is specialised for jittered frames, false for unjittered ones; `None` if it serves both.
    pub jitter: Option<bool>,
    pub pipeline: Pipeline,
}

/// Returns the pipelines of a pass: one for unjittered and one for jittered frames if the run has both and the shader
/// depends on it, otherwise a single one. The device caches them.
pub fn build(
    gpu: &mut GpuDevice,
    pass: &Pass,
    group0: &wgpu::BindGroupLayout,
    config: &RunConfig,
) -> Result<Vec<Built>, StageError> {
    let kernel = pass.kernel;
    let variant = ShaderVariant { access: gpu.scene_access(), polar: config.envelope.most.polar };
    let shader = Shader::new(&kernel, &pass.uses, variant)?;
    let declared = override_names(shader.text());
    let one = |kind: Option<bool>, jitter| {
        let constants = config.constants(jitter).into_iter().filter(|(n, _)| declared.contains(n)).collect();
        // Foreign shaders (from outside the library) may share a name, so their text is the key.
        let name = if shader.is_foreign() { shader.text() } else { kernel.name };
        let (name, checks) = (name.to_owned(), shader.checks(config.execution.checks));
        let key = PipelineKey { shader: name, projection: shader.projection, checks, constants };
        let pipeline = match gpu.pipelines.get(&key) {
            Some(kept) => kept,
            None => {
                let new = compile(gpu, pass, group0, &key, &shader)?;
                gpu.pipelines.insert(key, &new);
                new
            }
        };
        Ok(Built { kernel, jitter: kind, pipeline })
    };
    match config.envelope.jitters() {
        &[jitter] => Ok(vec![one(None, jitter)?]),
        _ if !declared.contains(&"JITTER") => Ok(vec![one(None, false)?]),
        kinds => kinds.iter().map(|&jitter| one(Some(jitter), jitter)).collect(),
    }
}

fn compile(
    gpu: &GpuDevice,
    pass: &Pass,
    group0: &wgpu::BindGroupLayout,
    key: &PipelineKey,
    shader: &Shader,
) -> Result<Pipeline, StageError> {
    let name = pass.kernel.name;
    let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
    let entries: Vec<_> = pass.uses.iter().enumerate().map(|(i, used)| layout_entry(i as u32, used)).collect();
    let layout =
        gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(name), entries: &entries });
    let projection = projection_layout(gpu);
    let groups = [Some(group0), Some(&layout), Some(&projection)];
    let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(name),
        bind_group_layouts: &groups[..if shader.reads_projection() { 3 } else { 2 }],
        immediate_size: PASS_BYTES,
    });
    let constants: Vec<_> = key.constants.iter().map(|&(name, on)| (name, f64::from(u8::from(on)))).collect();
    let compute = shader.pipeline(&gpu.device, name, &pipeline_layout, &constants, key.checks);
    if let Some(error) = pollster::block_on(scope.pop()) {
        let (device, what) = (gpu.info.index, error.to_string());
        return Err(StageError::Pipeline { device, shader: name, what });
    }
    Ok(Pipeline { compute, layout })
}

/// Returns the layout of the bind group of the projection's constants.
pub fn projection_layout(gpu: &GpuDevice) -> wgpu::BindGroupLayout {
    let entries = &[buffer_entry(0, wgpu::BufferBindingType::Uniform)];
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some("projection"), entries })
}

fn layout_entry(binding: u32, used: &Use) -> wgpu::BindGroupLayoutEntry {
    let ty = match used.image.resource.format {
        Format::Uniform { .. } => wgpu::BufferBindingType::Uniform,
        Format::Texels { .. } | Format::List => {
            wgpu::BufferBindingType::Storage { read_only: used.access == Access::Read }
        }
    };
    buffer_entry(binding, ty)
}

pub fn buffer_entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}
