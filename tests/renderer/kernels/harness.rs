//! Runs one kernel on given buffers. Bindings, overrides and entry point are found in the shader's own text by their
//! names, so that neither the order of bindings nor the renderer's declaration of its passes matters here.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::{Mutex, OnceLock, PoisonError};

use bytemuck::{Pod, Zeroable};
use diptych::device::{GpuDevice, wgsl};
use diptych::stages::layout::Pass;
use naga::{AddressSpace, StorageAccess};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

use super::camera::Constants;
use crate::common;

/// Edge of the workgroups of all kernels.
const TILE: u32 = 8;

/// The rows that a dispatch computes, and those that it may read.
#[derive(Clone, Debug)]
pub struct Stripe {
    pub rows: Range<u32>,
    pub valid: Range<u32>,
}

impl Stripe {
    pub fn pass(&self, view: usize, args: [u32; 3]) -> Pass {
        Pass {
            view: view as u32,
            row_begin: self.rows.start,
            row_end: self.rows.end,
            valid_begin: self.valid.start,
            valid_end: self.valid.end,
            args,
        }
    }
}

/// What stands at a binding: an image, of which only the stripe's rows may be written, or anything else.
pub enum Buffer {
    Image(Vec<u8>),
    Whole(Vec<u8>),
}

impl Buffer {
    pub fn image<T: Pod>(pixels: &[T]) -> Self {
        Self::Image(bytemuck::cast_slice(pixels).to_vec())
    }

    pub fn whole<T: Pod>(values: &[T]) -> Self {
        Self::Whole(bytemuck::cast_slice(values).to_vec())
    }

    fn bytes(&self) -> &[u8] {
        match self {
            Self::Image(bytes) | Self::Whole(bytes) => bytes,
        }
    }
}

/// What the writable bindings hold after a dispatch.
pub struct Outputs(BTreeMap<String, Vec<u8>>);

impl Outputs {
    pub fn get<T: Pod>(&self, name: &str) -> Vec<T> {
        let bytes = self.0.get(name).unwrap_or_else(|| panic!("no writable binding is named '{name}'"));
        bytemuck::pod_collect_to_vec(bytes)
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Uniform,
    Read,
    Write,
}

/// A binding of group 1, as the shader declares it.
#[derive(Clone)]
struct Binding {
    name: String,
    number: u32,
    kind: Kind,
}

#[derive(Clone)]
struct Compiled {
    pipeline: wgpu::ComputePipeline,
    bindings: Vec<Binding>,
}

/// The device that all tests of kernels share, with what was compiled on it.
struct Bench {
    gpu: GpuDevice,
    compiled: HashMap<(String, Vec<(&'static str, bool)>), Compiled>,
}

fn bench() -> &'static Mutex<Bench> {
    static BENCH: OnceLock<Mutex<Bench>> = OnceLock::new();
    BENCH.get_or_init(|| {
        let gpu = common::devices(1, common::all_cores()).remove(0);
        Mutex::new(Bench { gpu, compiled: HashMap::new() })
    })
}

/// A shader with values for all of its override constants.
pub struct Kernel {
    name: &'static str,
    source: String,
    overrides: Vec<(&'static str, bool)>,
}

impl Kernel {
    pub fn new(shader: &'static str, overrides: &[(&'static str, bool)]) -> Self {
        Self { name: shader, source: wgsl(shader), overrides: overrides.to_vec() }
    }

    /// The functions that `shader` includes, followed by a kernel of the test's own.
    pub fn beside(shader: &'static str, overrides: &[(&'static str, bool)], kernel: &str) -> Self {
        let whole = wgsl(shader);
        let end = whole.find("@group(1)").unwrap_or_else(|| panic!("shader '{shader}' binds nothing"));
        Self { name: shader, source: format!("{}{kernel}", &whole[..end]), overrides: overrides.to_vec() }
    }

    /// Dispatches `columns` invocations for every row of the stripe that `pass` names.
    pub fn run(&self, constants: &Constants, pass: Pass, columns: u32, buffers: &[(&str, Buffer)]) -> Outputs {
        let mut bench = bench().lock().unwrap_or_else(PoisonError::into_inner);
        let key = (self.source.clone(), self.overrides.clone());
        if !bench.compiled.contains_key(&key) {
            let new = self.compile(&bench.gpu);
            bench.compiled.insert(key.clone(), new);
        }
        let outputs = self.dispatch(&bench.gpu, &bench.compiled[&key], constants, pass, columns, buffers);
        drop(bench);
        for (name, buffer) in buffers {
            if let (Buffer::Image(before), Some(after)) = (buffer, outputs.0.get(*name)) {
                let row = before.len() / constants.height as usize;
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
        let given: Vec<_> = self.overrides.iter().map(|&(name, _)| name).collect();
        assert_same_names(&format!("{}: override constants", self.name), &declared, &given);
        let mut bindings: Vec<_> = module.global_variables.iter().filter_map(|(_, v)| binding(v)).collect();
        bindings.sort_by_key(|b| b.number);
        let (device, label) = (&gpu.device, Some(self.name));
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label,
            source: wgpu::ShaderSource::Wgsl(self.source.as_str().into()),
        });
        let group =
            |entries: &[_]| device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries });
        let constants = group(&[layout_entry(0, Kind::Uniform)]);
        let buffers = group(&bindings.iter().map(|b| layout_entry(b.number, b.kind)).collect::<Vec<_>>());
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label,
            bind_group_layouts: &[Some(&constants), Some(&buffers)],
            immediate_size: size_of::<Pass>() as u32,
        });
        let values: Vec<_> = self.overrides.iter().map(|&(name, on)| (name, f64::from(u8::from(on)))).collect();
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label,
            layout: Some(&layout),
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &values, ..Default::default() },
            cache: None,
        });
        assert!(gpu.failure().is_none(), "{}: {:?}", self.name, gpu.failure());
        Compiled { pipeline, bindings }
    }

    fn dispatch(
        &self,
        gpu: &GpuDevice,
        compiled: &Compiled,
        constants: &Constants,
        pass: Pass,
        columns: u32,
        buffers: &[(&str, Buffer)],
    ) -> Outputs {
        let declared: Vec<_> = compiled.bindings.iter().map(|b| b.name.as_str()).collect();
        let given: Vec<_> = buffers.iter().map(|(name, _)| *name).collect();
        assert_same_names(&format!("{}: bindings", self.name), &declared, &given);
        let device = &gpu.device;
        let made = |contents: &[u8], usage| {
            device.create_buffer_init(&BufferInitDescriptor { label: Some(self.name), contents, usage })
        };
        let uniform = made(&constants.bytes(), wgpu::BufferUsages::UNIFORM);
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
        let frame_group = group(0, &[entry(0, &uniform)]);
        let buffer_group = group(1, &bound.iter().map(|(b, buffer)| entry(b.number, buffer)).collect::<Vec<_>>());
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut compute = encoder.begin_compute_pass(&Default::default());
            compute.set_pipeline(&compiled.pipeline);
            compute.set_bind_group(0, &frame_group, &[]);
            compute.set_bind_group(1, &buffer_group, &[]);
            compute.set_immediates(0, bytemuck::bytes_of(&pass));
            let rows = pass.row_end - pass.row_begin;
            compute.dispatch_workgroups(columns.div_ceil(TILE), rows.div_ceil(TILE), 1);
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

/// Panics unless both lists hold the same names, each once.
fn assert_same_names(what: &str, declared: &[&str], given: &[&str]) {
    let missing: Vec<_> = declared.iter().filter(|name| !given.contains(name)).collect();
    let unknown: Vec<_> = given.iter().filter(|name| !declared.contains(name)).collect();
    assert!(
        missing.is_empty() && unknown.is_empty() && declared.len() == given.len(),
        "{what}: the shader declares {declared:?}; the test lacks {missing:?} and has {unknown:?} beside them"
    );
}

fn binding(variable: &naga::GlobalVariable) -> Option<Binding> {
    let place = variable.binding.filter(|b| b.group == 1)?;
    let name = variable.name.clone()?;
    let kind = match variable.space {
        AddressSpace::Uniform => Kind::Uniform,
        AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Kind::Write,
        AddressSpace::Storage { .. } => Kind::Read,
        other => panic!("'{name}' is in {other:?}, which the harness does not bind"),
    };
    Some(Binding { name, number: place.binding, kind })
}

fn layout_entry(binding: u32, kind: Kind) -> wgpu::BindGroupLayoutEntry {
    let ty = match kind {
        Kind::Uniform => wgpu::BufferBindingType::Uniform,
        Kind::Read => wgpu::BufferBindingType::Storage { read_only: true },
        Kind::Write => wgpu::BufferBindingType::Storage { read_only: false },
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

/// `value` in rows `rows` of an image, elsewhere what no kernel may read: bits that are not finite as any format.
pub fn only_in<T: Zeroable + Pod>(rows: &Range<u32>, width: u32, pixels: &[T]) -> Vec<T> {
    let mut out = pixels.to_vec();
    let (begin, end) = ((rows.start * width) as usize, (rows.end * width) as usize);
    for (at, pixel) in out.iter_mut().enumerate() {
        if at < begin || at >= end {
            bytemuck::bytes_of_mut(pixel).fill(0xff);
        }
    }
    out
}
