//! Caches a device's pipelines: drivers take longer to compile a path tracer than to render a small frame with it.

use super::ShaderChecks;

/// Cache key of a pipeline on one device.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct PipelineKey {
    /// Name of one of the library's shaders, or the source text of a shader that the caller supplies.
    pub shader: String,
    /// Name of the include that implements the projection; empty if the shader does not depend on it.
    pub projection: &'static str,
    pub checks: ShaderChecks,
    /// Names and values of the override constants that the shader declares.
    pub constants: Vec<(&'static str, bool)>,
}

#[derive(Clone, Debug)]
pub struct Pipeline {
    pub compute: wgpu::ComputePipeline,
    /// Layout of bind group 1.
    pub layout: wgpu::BindGroupLayout,
}
