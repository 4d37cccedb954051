//! Caches a device's pipelines: drivers take longer to compile a path tracer than to render a small frame with it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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

/// Compiled pipelines, which all successive and simultaneous users of a device share.
#[derive(Clone, Debug, Default)]
pub struct Pipelines(Arc<Mutex<HashMap<PipelineKey, Pipeline>>>);

impl Pipelines {
    fn kept(&self) -> MutexGuard<'_, HashMap<PipelineKey, Pipeline>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn len(&self) -> usize {
        self.kept().len()
    }

    pub fn is_empty(&self) -> bool {
        self.kept().is_empty()
    }

    pub(crate) fn get(&self, key: &PipelineKey) -> Option<Pipeline> {
        self.kept().get(key).cloned()
    }

    pub(crate) fn insert(&self, key: PipelineKey, new: &Pipeline) {
        self.kept().insert(key, new.clone());
    }
}
