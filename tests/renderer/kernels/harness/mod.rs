//! Runs one kernel on given buffers. It finds bindings, overrides and entry point by name in the shader's source, so
//! the order of bindings does not matter.

mod buffers;
mod reflect;
mod tests;

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use diptych::device::{GpuDevice, SceneAccess, Traversal};
use diptych::layout::{Frame, PassConstants};
use diptych::projection::PolarSpace;
use diptych::stages::{ShaderVariant, Specialization, override_names, shader_text_of};
use diptych::tables::{SceneBuffers, SceneTables, layout_entries as scene_layout_entries};
use diptych::wgsl::Words;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

pub use self::buffers::{Buffer, Outputs, Stripe, only_in};
use self::reflect::{Binding, Kind, assert_same_names, binding, layout_entry};
use super::camera::Constants;
use crate::common::{self, Subject};

#[derive(Clone)]
struct Compiled {
    pipeline: wgpu::ComputePipeline,
    bindings: Vec<Binding>,
}

/// An override constant's name and value.
pub type Override = (&'static str, bool);

/// Device for all kernel tests, with its compiled pipelines.
struct Bench {
    gpu: GpuDevice,
    compiled: HashMap<(String, Vec<Override>), Compiled>,
}

fn bench() -> MutexGuard<'static, Bench> {
    static BENCH: OnceLock<Mutex<Bench>> = OnceLock::new();
    let bench = BENCH.get_or_init(|| {
        let gpu = common::devices_to_lose(1).remove(0);
        Mutex::new(Bench { gpu, compiled: HashMap::new() })
    });
    bench.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns how the kernels' device traces rays.
pub fn traversal() -> Traversal {
    bench().gpu.info.traversal
}

/// A shader with its override constants; those without a value are off.
pub struct Kernel {
    name: &'static str,
    source: String,
    overrides: Vec<Override>,
    /// Scene that the kernel reads, if any.
    scene: Option<Arc<SceneTables>>,
}

impl Kernel {
    pub fn new(shader: &'static str, overrides: &[Override]) -> Self {
        Self::projected(None, shader, overrides)
    }

    /// Creates a kernel for images in this polar projection, or in the perspective one.
    pub fn projected(polar: Option<PolarSpace>, shader: &'static str, overrides: &[Override]) -> Self {
        let access = SceneAccess::default();
        Self::of(shader, shader_text_of(shader, ShaderVariant { access, polar }), overrides)
    }

    /// Creates a kernel that reads this scene, with the scene's override constants and `overrides`.
    pub fn with_scene(shader: &'static str, overrides: &[Override], subject: &Subject) -> Self {
        let source = shader_text_of(shader, bench().gpu.scene_access());
        let declared = override_names(&source);
        let needs = subject.needs.constants().into_iter().filter(|(name, _)| declared.contains(name));
        let overrides: Vec<_> = overrides.iter().copied().chain(needs).collect();
        Self { scene: Some(Arc::clone(&subject.tables)), ..Self::of(shader, source, &overrides) }
    }

    /// Combines the functions that `shader` includes with a kernel of the test's own.
    pub fn beside(shader: &'static str, overrides: &[Override], kernel: &str) -> Self {
        Self::cut(shader, SceneAccess::default(), overrides, kernel)
    }

    /// Combines the functions that `shader` includes with a kernel of the test's own that reads this scene.
    pub fn beside_scene(shader: &'static str, tables: &Arc<SceneTables>, kernel: &str) -> Self {
        let access = bench().gpu.scene_access();
        Self { scene: Some(Arc::clone(tables)), ..Self::cut(shader, access, &[], kernel) }
    }

    fn cut(shader: &'static str, access: SceneAccess, overrides: &[Override], kernel: &str) -> Self {
        let whole = shader_text_of(shader, access);
        let end = whole.find("@group(1)").unwrap_or_else(|| panic!("shader '{shader}' binds nothing"));
        Self::of(shader, format!("{}{kernel}", &whole[..end]), overrides)
    }

    fn of(name: &'static str, source: String, overrides: &[Override]) -> Self {
        Self { name, source, overrides: overrides.to_vec(), scene: None }
    }

    /// Dispatches `columns` invocations for every row of the stripe that `pass` names. The pass's grid is the frame.
    pub fn run(&self, constants: &Constants, pass: PassConstants, columns: u32, buffers: &[(&str, Buffer)]) -> Outputs {
        let rows = pass.row_end - pass.row_begin;
        self.run_groups(constants, pass, self.groups([columns, rows]), buffers)
    }

    /// Returns the workgroups that cover these columns and rows.
    fn groups(&self, extent: [u32; 2]) -> [u32; 2] {
        let (_, size) = self.source.rsplit_once("@workgroup_size(").expect("a kernel has workgroups");
        let mut edges = size.split([',', ')']).map(|edge| edge.trim().parse().expect("a number"));
        extent.map(|length| length.div_ceil(edges.next().expect("a kernel of columns and rows")))
    }

    /// Dispatches workgroups for the stripe that `pass` names.
    pub fn run_groups(
        &self,
        constants: &Constants,
        pass: PassConstants,
        groups: [u32; 2],
        buffers: &[(&str, Buffer)],
    ) -> Outputs {
        let (width, height) = (constants.width, constants.height);
        self.run_frame(&constants.frame(), PassConstants { width, height, ..pass }, groups, buffers)
    }

    /// Dispatches workgroups of a pass without rows.
    pub fn run_once(&self, frame: &Frame, args: [u32; 3], groups: [u32; 2], buffers: &[(&str, Buffer)]) -> Outputs {
        self.run_frame(frame, PassConstants { args: Words(args), ..Default::default() }, groups, buffers)
    }

    /// Dispatches an invocation for each pixel of the rows that `pass` names.
    pub fn run_rows(&self, frame: &Frame, pass: PassConstants, buffers: &[(&str, Buffer)]) -> Outputs {
        let groups = self.groups([pass.width, pass.row_end - pass.row_begin]);
        self.run_frame(frame, pass, groups, buffers)
    }

    /// Dispatches workgroups with these frame constants. Output images have the rows of the pass.
    pub fn run_frame(
        &self,
        frame: &Frame,
        pass: PassConstants,
        groups: [u32; 2],
        buffers: &[(&str, Buffer)],
    ) -> Outputs {
        let mut bench = bench();
        let key = (self.source.clone(), self.overrides.clone());
        if !bench.compiled.contains_key(&key) {
            let new = self.compile(&bench.gpu);
            bench.compiled.insert(key.clone(), new);
        }
        let outputs = self.dispatch(&bench.gpu, &bench.compiled[&key], frame, pass, groups, buffers);
        for (name, buffer) in buffers {
            if let (Buffer::Image(before), Some(after)) = (buffer, outputs.0.get(*name)) {
                let row = before.len() / pass.height as usize;
                let (begin, end) = (row * pass.row_begin as usize, row * pass.row_end as usize);
                assert!(before[..begin] == after[..begin], "{}: '{name}' was written above the stripe", self.name);
                assert!(before[end..] == after[end..], "{}: '{name}' was written below the stripe", self.name);
            }
        }
        outputs
    }

    fn compile(&self, gpu: &GpuDevice) -> Compiled {
        let module = naga::front::wgsl::parse_str(&self.source)
            .unwrap_or_else(|e| panic!("{}: {}", self.name, e.emit_to_string(&self.source)));
        let declared: Vec<_> = module.overrides.iter().filter_map(|(_, o)| o.name.as_deref()).collect();
        let mut values: Vec<_> = self.overrides.iter().map(|&(name, on)| (name, f64::from(u8::from(on)))).collect();
        let is_off = |name: &&&str| !self.overrides.iter().any(|(given, _)| given == *name);
        values.extend(declared.iter().filter(is_off).map(|name| (*name, 0.0)));
        let given: Vec<_> = values.iter().map(|&(name, _)| name).collect();
        assert_same_names(&format!("{}: override constants", self.name), &declared, &given);
        let mut bindings: Vec<_> = module.global_variables.iter().filter_map(|(_, v)| binding(v)).collect();
        bindings.sort_by_key(|b| (b.group, b.number));
        let (device, label) = (&gpu.device, Some(self.name));
        let group =
            |entries: &[_]| device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries });
        let entries = |group| bindings.iter().filter(move |b| b.group == group).map(|b| layout_entry(b.number, b.kind));
        let scene = self.scene.iter().flat_map(|_| scene_layout_entries(gpu.scene_access()));
        let frame = std::iter::once(layout_entry(0, Kind::Uniform)).chain(scene);
        let constants = group(&frame.chain(entries(0)).collect::<Vec<_>>());
        let buffers = group(&entries(1).collect::<Vec<_>>());
        let projection = group(&entries(2).collect::<Vec<_>>());
        let groups = [Some(&constants), Some(&buffers), Some(&projection)];
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &groups[..if entries(2).next().is_some() { 3 } else { 2 }],
            immediate_size: size_of::<PassConstants>() as u32,
        });
        let main = Specialization {
            label: self.name,
            text: &self.source,
            entry_point: "main",
            constants: &values,
            zero_workgroup_memory: true,
        };
        let pipeline = main.pipeline(device, &layout);
        assert!(gpu.failure().is_none(), "{}: {:?}", self.name, gpu.failure());
        Compiled { pipeline, bindings }
    }

    fn dispatch(
        &self,
        gpu: &GpuDevice,
        compiled: &Compiled,
        frame: &Frame,
        pass: PassConstants,
        [across, down]: [u32; 2],
        buffers: &[(&str, Buffer)],
    ) -> Outputs {
        let declared: Vec<_> = compiled.bindings.iter().map(|b| b.name.as_str()).collect();
        let given: Vec<_> = buffers.iter().map(|(name, _)| *name).collect();
        assert_same_names(&format!("{}: bindings", self.name), &declared, &given);
        let device = &gpu.device;
        let made = |contents: &[u8], usage| {
            device.create_buffer_init(&BufferInitDescriptor { label: Some(self.name), contents, usage })
        };
        let uniform = made(bytemuck::bytes_of(frame), wgpu::BufferUsages::UNIFORM);
        let scene = self.scene.as_ref().map(|tables| SceneBuffers::new(gpu, tables).expect("the scene fits"));
        let bound: Vec<_> = (compiled.bindings.iter())
            .map(|binding| {
                let bytes = buffers.iter().find(|(name, _)| *name == binding.name).map(|(_, b)| b.bytes());
                let usage = match binding.kind {
                    Kind::Uniform => wgpu::BufferUsages::UNIFORM,
                    _ => wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
                };
                (binding, made(bytes.expect("names were compared"), usage))
            })
            .collect();
        let group = |index, entries: &[_]| {
            let layout = &compiled.pipeline.get_bind_group_layout(index);
            device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some(self.name), layout, entries })
        };
        let of = |group| bound.iter().filter(move |(b, _)| b.group == group).map(|(b, buffer)| entry(b.number, buffer));
        let of_scene = scene.iter().flat_map(SceneBuffers::entries);
        let frame_group =
            group(0, &std::iter::once(entry(0, &uniform)).chain(of_scene).chain(of(0)).collect::<Vec<_>>());
        let buffer_group = group(1, &of(1).collect::<Vec<_>>());
        let projection_group = of(2).next().map(|bound| group(2, &[bound]));
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut compute = encoder.begin_compute_pass(&Default::default());
            compute.set_pipeline(&compiled.pipeline);
            compute.set_bind_group(0, &frame_group, &[]);
            compute.set_bind_group(1, &buffer_group, &[]);
            if let Some(group) = &projection_group {
                compute.set_bind_group(2, group, &[]);
            }
            compute.set_immediates(0, bytemuck::bytes_of(&pass));
            compute.dispatch_workgroups(across, down, 1);
        }
        let read: Vec<_> = (bound.iter().filter(|(binding, _)| binding.kind == Kind::Write))
            .map(|(binding, buffer)| {
                let copy = device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some(&binding.name),
                    size: buffer.size(),
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
                (binding.name.clone(), copy)
            })
            .collect();
        gpu.queue.submit([encoder.finish()]);
        read.iter().for_each(|(_, copy)| copy.slice(..).map_async(wgpu::MapMode::Read, |_| {}));
        gpu.wait(None).unwrap_or_else(|e| panic!("{}: {e:?}", self.name));
        let bytes = |copy: &wgpu::Buffer| copy.slice(..).get_mapped_range().expect("the copy is mapped").to_vec();
        Outputs(read.into_iter().map(|(name, copy)| (name, bytes(&copy))).collect())
    }
}

fn entry(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}
