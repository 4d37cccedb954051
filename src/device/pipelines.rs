//! Pipelines that a device keeps: drivers take longer to compile a path tracer than to render a small frame with it.

use super::ShaderChecks;

/// What pipelines of one device differ in.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PipelineKey {
    pub shader: &'static str,
    pub checks: ShaderChecks,
    /// The override constants that the shader declares.
    pub constants: Vec<(&'static str, bool)>,
}

#[derive(Clone, Debug)]
pub struct Pipeline {
    pub compute: wgpu::ComputePipeline,
    /// Of group 1.
    pub layout: wgpu::BindGroupLayout,
}
