//! Compute shaders specialised for values of their override constants.

use std::borrow::Cow;

use wgpu::naga::back::PipelineConstants;
use wgpu::naga::back::pipeline_constants::process_overrides;
use wgpu::naga::front::wgsl::{Frontend, Options};
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
use wgpu::naga::{Module, ShaderStage, TypeInner};

use super::dead_code::remove_dead_code;
use crate::device::ShaderChecks;

/// Environment variable that has pipelines named on standard error, before and after the driver compiles them. What a
/// driver prints in between belongs to this kernel.
const NAMES_PIPELINES: &str = "DIPTYCH_NAME_PIPELINES";

/// A compute shader with values for its override constants, of which the device gets only the code that can run.
///
/// Pipelines of the renderer, its tests and its benchmarks are all built from this, so that they run the same code.
pub struct Specialization<'a> {
    pub label: &'a str,
    /// WGSL.
    pub text: &'a str,
    pub entry_point: &'a str,
    /// Names and values of override constants. Others keep the values that the text gives them.
    pub constants: &'a [(&'a str, f64)],
    pub zero_workgroup_memory: bool,
}

impl Specialization<'_> {
    /// Creates the pipeline with all run-time checks. The device's error scope receives faults of the shader.
    pub fn pipeline(&self, device: &wgpu::Device, layout: &wgpu::PipelineLayout) -> wgpu::ComputePipeline {
        // SAFETY: nothing relies on properties of the shader if all checks are on.
        unsafe { self.trusted_pipeline(device, layout, ShaderChecks::Full) }
    }

    /// Creates the pipeline. The device's error scope receives faults of the shader.
    ///
    /// # Safety
    /// The shader must keep to the rules that `checks` leaves out: its loops end, its integer divisors are not 0, and it
    /// uses ray queries as Vulkan defines.
    pub unsafe fn trusted_pipeline(
        &self,
        device: &wgpu::Device,
        layout: &wgpu::PipelineLayout,
        checks: ShaderChecks,
    ) -> wgpu::ComputePipeline {
        // The device gets a faulty shader as text, because the text is part of its message.
        let (source, constants) = match self.module(device.features()) {
            Some(module) => (wgpu::ShaderSource::Naga(Cow::Owned(module)), &[][..]),
            None => (wgpu::ShaderSource::Wgsl(self.text.into()), self.constants),
        };
        let names = std::env::var_os(NAMES_PIPELINES).is_some();
        if let (true, wgpu::ShaderSource::Naga(module)) = (names, &source) {
            let invocations: u32 = module.entry_points.iter().flat_map(|entry| entry.workgroup_size).product();
            let traces = module.types.iter().any(|(_, ty)| matches!(ty.inner, TypeInner::RayQuery { .. }));
            eprintln!("pipeline {} of {invocations} invocations, ray queries: {traces}", self.label);
        }
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(self.label), source };
        // SAFETY: the caller vouches for the shader, and removing code that cannot run adds no behaviour.
        let module = unsafe { device.create_shader_module_trusted(descriptor, checks.runtime_checks()) };
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(self.label),
            layout: Some(layout),
            module: &module,
            entry_point: Some(self.entry_point),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                zero_initialize_workgroup_memory: self.zero_workgroup_memory,
            },
            cache: None,
        });
        if names {
            eprintln!("end of pipeline {}", self.label);
        }
        pipeline
    }

    /// Returns the entry point without code that cannot run; `None` if the shader is faulty or needs features that no
    /// device is opened with.
    pub(super) fn module(&self, features: wgpu::Features) -> Option<Module> {
        let capabilities = capabilities(features);
        let mut options = Options::new();
        options.capabilities = capabilities;
        let module = Frontend::new_with_options(options).parse(self.text).ok()?;
        let info = Validator::new(ValidationFlags::all(), capabilities).validate(&module).ok()?;
        let constants: PipelineConstants =
            self.constants.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
        let entry_point = Some((ShaderStage::Compute, self.entry_point));
        let (module, _) = process_overrides(&module, &info, entry_point, &constants).ok()?;
        let mut module = module.into_owned();
        remove_dead_code(&mut module);
        Some(module)
    }
}

/// Returns the capabilities of shaders on devices with these features, of those with which devices are opened. All wgpu
/// backends used here convert half floats.
pub(super) fn capabilities(features: wgpu::Features) -> Capabilities {
    let mut capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32;
    capabilities.set(Capabilities::IMMEDIATES, features.contains(wgpu::Features::IMMEDIATES));
    capabilities.set(Capabilities::RAY_QUERY, features.contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY));
    capabilities
}
