//! Pipelines of all kernels of a run, built again when a file changes in the folder that shaders are read from.

use std::path::PathBuf;
use std::time::SystemTime;

use super::compile::{Built, StageError, build};
use super::shader_files::state;
use crate::device::GpuDevice;
use crate::frame::RunConfig;
use crate::graph::{Pass, Program};

/// Passes of all kernels, with the layouts and files that their pipelines are built from.
pub struct Kernels {
    /// One pass for each kernel.
    passes: Vec<Pass>,
    /// Layouts of bind group 0, by [`SceneUse`](crate::graph::SceneUse).
    layouts: [wgpu::BindGroupLayout; 3],
    /// State of the files that the pipelines are built from.
    state: Vec<(PathBuf, Option<SystemTime>, u64)>,
}

impl Kernels {
    pub fn new(programs: &[Program], layouts: [wgpu::BindGroupLayout; 3]) -> Self {
        let mut passes: Vec<Pass> = Vec::new();
        for pass in programs.iter().flat_map(Program::passes).map(|linked| &linked.pass) {
            if !passes.iter().any(|known| known.kernel == pass.kernel) {
                passes.push(pass.clone());
            }
        }
        Self { passes, layouts, state: state() }
    }

    /// Returns the pipelines that the device has cached, and builds the others.
    pub fn build(&self, gpu: &mut GpuDevice, config: &RunConfig) -> Result<Vec<Built>, StageError> {
        let mut built = Vec::new();
        for pass in &self.passes {
            let group0 = &self.layouts[pass.kernel.scene as usize];
            let _span = tracing::info_span!("build pipeline", shader = pass.kernel.name).entered();
            built.extend(build(gpu, pass, group0, config)?);
        }
        Ok(built)
    }

    /// Builds the pipelines again if a file has changed in the folder that shaders are read from. A shader with an error
    /// keeps the former pipelines; standard error has its message.
    pub fn rebuild(&mut self, gpu: &mut GpuDevice, config: &RunConfig) -> Option<Vec<Built>> {
        let state = state();
        if state == self.state {
            return None;
        }
        self.state = state;
        self.build(gpu, config).inspect_err(|error| eprintln!("{error}")).ok()
    }
}
