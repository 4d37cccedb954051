//! The shaders' traversal on one device that uses all cores.

use diptych::accel::Layout;
use diptych::device::{self, GpuDevice, Selection, ShaderChecks, Traversal, TraversalChoice};
use diptych::graph::Kernel;
use diptych::image::Extent;
use diptych::layout::{Camera, Frame};
use diptych::stages::{Specialization, override_names, shader_text};
use diptych::tables::{SceneBuffers, layout_entries as scene_layout_entries};
use wgpu::util::DeviceExt;

use super::{BenchRay, Case, Workload};

pub struct Gpu {
    gpu: GpuDevice,
    pipeline: wgpu::ComputePipeline,
    groups: [wgpu::BindGroup; 2],
    hits: wgpu::Buffer,
    workgroups: [u32; 2],
}

fn entry(binding: u32, ty: wgpu::BufferBindingType) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

fn bound(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}

fn bind_layout(device: &wgpu::Device, entries: &[wgpu::BindGroupLayoutEntry]) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries })
}

fn pipeline(
    gpu: &GpuDevice,
    layouts: [&wgpu::BindGroupLayout; 2],
    text: &str,
    case: Case,
    has_instances: bool,
) -> wgpu::ComputePipeline {
    let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &layouts.map(Some),
        immediate_size: 32,
    });
    let declared = override_names(text);
    // Triangles are opaque, as for obvhs.
    let value = |name: &str| f64::from(u8::from(name == "HAS_INSTANCES" && has_instances));
    let mut constants: Vec<_> = declared.iter().filter(|n| n.starts_with("HAS_")).map(|n| (*n, value(n))).collect();
    constants.push(("SEGMENTS", case.segments() as f64));
    constants.push(("ANY_HIT", f64::from(u8::from(case == Case::Shadow))));
    let main = Specialization {
        label: "rays",
        text,
        entry_point: "main",
        constants: &constants,
        zero_workgroup_memory: false,
    };
    // SAFETY: loops end, integer divisors are not 0, and bounds stay checked.
    unsafe { main.trusted_pipeline(&gpu.device, &pipeline_layout, ShaderChecks::Fast) }
}

impl Gpu {
    /// # Panics
    /// If there is no device, or the shader is rejected.
    pub fn new(workload: &Workload, layout: Layout, case: Case, rays: &[BenchRay], traversal: Traversal) -> Self {
        let traversal = match traversal {
            Traversal::Compute => TraversalChoice::Compute,
            Traversal::Hardware => TraversalChoice::Hardware,
        };
        let selection = Selection { traversal, ..Selection::default() };
        // SAFETY: no other thread of a benchmark reads the environment while a device is opened.
        unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
        let gpu = device::open(&selection).unwrap_or_else(|e| panic!("{e}")).swap_remove(0);
        let tables = workload.tables(layout);
        let scene = SceneBuffers::new(&gpu, &tables).expect("the scene fits");
        let Extent { width, height } = workload.extent;
        let mut frame = Frame { camera: Camera { width, height, ..Default::default() }, ..Default::default() };
        tables.describe(&mut frame);
        let init = |contents: &[u8], usage| {
            gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor { label: None, contents, usage })
        };
        let frame = init(bytemuck::bytes_of(&frame), wgpu::BufferUsages::UNIFORM);
        let rays = init(bytemuck::cast_slice(rays), wgpu::BufferUsages::STORAGE);
        let hits = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: rays.size() / size_of::<BenchRay>() as u64 * 8,
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
        let mut entries = vec![entry(0, wgpu::BufferBindingType::Uniform)];
        entries.extend(scene_layout_entries(gpu.scene_access()));
        let layouts = [
            bind_layout(&gpu.device, &entries),
            bind_layout(&gpu.device, &[entry(0, storage(true)), entry(1, storage(false))]),
        ];
        let group = |layout, entries: &[_]| {
            gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries })
        };
        let mut scene_entries = vec![bound(0, &frame)];
        scene_entries.extend(scene.entries());
        let groups = [group(&layouts[0], &scene_entries), group(&layouts[1], &[bound(0, &rays), bound(1, &hits)])];
        let kernel = Kernel::from_text("rays", include_str!("../rays.wgsl")).reading_scene();
        let source = shader_text(&kernel, &[], gpu.scene_access());
        let pipeline = pipeline(&gpu, [&layouts[0], &layouts[1]], &source, case, tables.has_instances());
        let workgroups = [workload.extent.width.div_ceil(8), workload.extent.height.div_ceil(8)];
        Self { gpu, pipeline, groups, hits, workgroups }
    }

    /// Traces all rays once.
    pub fn trace(&self) {
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.groups[0], &[]);
        pass.set_bind_group(1, &self.groups[1], &[]);
        pass.dispatch_workgroups(self.workgroups[0], self.workgroups[1], 1);
        drop(pass);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait(None).expect("the device works");
    }

    /// Returns the number of rays with different results: only one side has a hit, or the distances differ by more than
    /// 1e-4 in relative terms. Instances cause more of the latter: a ray's origin is rounded in their space, which
    /// matters for short distances.
    pub fn differing(&self, expected: &[[u32; 2]], case: Case) -> usize {
        let differs = |(found, expected): &(&[u32; 2], &[u32; 2])| {
            if case == Case::Shadow {
                return found[0] != expected[0];
            }
            let (a, b) = (f32::from_bits(found[0]), f32::from_bits(expected[0]));
            let hits = [found, expected].map(|r| r[1] != u32::MAX);
            hits[0] != hits[1] || hits[0] && (a - b).abs() > 1e-4 * a.abs()
        };
        // Entries after the end of a path stay zero on the device.
        let traced = |(found, expected): &(&[u32; 2], &[u32; 2])| *found != &[0; 2] || expected[0] != 0;
        self.read_hits().iter().zip(expected).filter(|pair| traced(pair) && differs(pair)).count()
    }

    fn read_hits(&self) -> Vec<[u32; 2]> {
        let device = &self.gpu.device;
        let copy = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: self.hits.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.hits, 0, &copy, 0, self.hits.size());
        self.gpu.queue.submit([encoder.finish()]);
        copy.slice(..).map_async(wgpu::MapMode::Read, |_| {});
        self.gpu.wait(None).expect("the device works");
        let bytes = copy.slice(..).get_mapped_range().expect("the copy is mapped");
        bytemuck::cast_slice(&bytes).to_vec()
    }
}
