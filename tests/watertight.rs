//! No ray leaks between triangles that share an edge or a vertex: rays aimed at exactly those, on a device, by the
//! renderer's own traversal.

mod common;
mod reference;

use std::collections::HashMap;

use bytemuck::Zeroable;
use diptych::accel::{Accel, Node, Triangle};
use diptych::device::{self, GpuDevice, Selection};
use diptych::scene::Mesh;
use diptych::stages::layout::Frame;
use glam::{Vec3, vec3};
use reference::sampling::Rng;
use reference::scenes::{add_matte, empty, icosphere, place};
use wgpu::util::DeviceExt;

/// Rays of one dispatch.
const BATCH: usize = 1 << 18;

/// An entry point behind the text of a stage, so that what is tested is the very code that renders.
const AIM: &str = "
struct Aimed {
    origin: vec4<f32>,
    direction: vec4<f32>,
}
@group(1) @binding(8) var<storage, read> aimed: array<Aimed>;
@group(1) @binding(9) var<storage, read_write> found: array<u32>;

@compute @workgroup_size(64)
fn aim(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&found) {
        return;
    }
    let ray = aimed[id.x];
    found[id.x] = traverse(ray.origin.xyz, ray.direction.xyz, 3.0e38, 0u, false).prim;
}
";

type Ray = [[f32; 4]; 2];

struct Tracer {
    gpu: GpuDevice,
    pipeline: wgpu::ComputePipeline,
}

impl Tracer {
    fn new() -> Self {
        let adapter = device::adapters().into_iter().find(|a| a.missing.is_empty());
        let adapter = adapter.expect("these tests need an adapter: on Linux, install mesa-vulkan-drivers");
        let selection = Selection { adapters: Some(vec![adapter.index]), virtual_devices: 1, threads_per_device: None };
        let gpu = device::open(&selection).unwrap().remove(0);
        let text = device::wgsl("gbuffer") + AIM;
        let descriptor = wgpu::ShaderModuleDescriptor { label: None, source: wgpu::ShaderSource::Wgsl(text.into()) };
        let checks = device::ShaderChecks::Fast.runtime_checks();
        // SAFETY: every loop of the traversal ends and no integer is divided; bounds are checked.
        let module = unsafe { gpu.device.create_shader_module_trusted(descriptor, checks) };
        let constants = [("HAS_ALPHA", 0.0)];
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("aim"),
            compilation_options: wgpu::PipelineCompilationOptions { constants: &constants, ..Default::default() },
            cache: None,
        });
        assert_eq!(gpu.failure(), None);
        Self { gpu, pipeline }
    }

    fn buffer(&self, contents: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let descriptor = wgpu::util::BufferInitDescriptor { label: None, contents, usage };
        self.gpu.device.create_buffer_init(&descriptor)
    }

    /// The nodes as the shaders have them, 1024 in a row of texels.
    fn node_texture(&self, nodes: &[Node]) -> wgpu::TextureView {
        let rows = nodes.len().div_ceil(1024);
        let mut texels = bytemuck::cast_slice::<Node, u8>(nodes).to_vec();
        texels.resize(rows * 1024 * size_of::<Node>(), 0);
        let descriptor = wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: 5120, height: rows as u32, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Uint,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        let order = wgpu::util::TextureDataOrder::LayerMajor;
        let texture = self.gpu.device.create_texture_with_data(&self.gpu.queue, &descriptor, order, &texels);
        texture.create_view(&Default::default())
    }

    fn bind(&self, group: u32, resources: &[(u32, wgpu::BindingResource<'_>)]) -> wgpu::BindGroup {
        self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &self.pipeline.get_bind_group_layout(group),
            entries: &resources
                .iter()
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
                .collect::<Vec<_>>(),
        })
    }

    /// For each ray, the first triangle it meets, u32::MAX if there is none.
    fn trace(&self, scene: &wgpu::BindGroup, rays: &[Ray]) -> Vec<u32> {
        let storage = wgpu::BufferUsages::STORAGE;
        let aimed = self.buffer(bytemuck::cast_slice(rays), storage);
        let zeros = vec![0u32; rays.len()];
        let found = self.buffer(bytemuck::cast_slice(&zeros), storage | wgpu::BufferUsages::COPY_SRC);
        let results = self.bind(1, &[(8, aimed.as_entire_binding()), (9, found.as_entire_binding())]);
        let read = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let back = self.buffer(bytemuck::cast_slice(&zeros), read);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, scene, &[]);
            pass.set_bind_group(1, &results, &[]);
            pass.dispatch_workgroups(rays.len().div_ceil(64) as u32, 1, 1);
        }
        encoder.copy_buffer_to_buffer(&found, 0, &back, 0, None);
        self.gpu.queue.submit([encoder.finish()]);
        back.map_async(wgpu::MapMode::Read, .., Result::unwrap);
        self.gpu.wait(None).unwrap();
        bytemuck::cast_slice(&back.get_mapped_range(..).unwrap()).to_vec()
    }
}

/// A closed surface, and from where rays are aimed at it.
struct Case {
    name: &'static str,
    mesh: Mesh,
    /// Rays start in this box. Inside the surface, none may leave.
    from: [Vec3; 2],
    /// Aim only at points that are this much beside the line of sight's own normal: 0 for every point.
    facing: f32,
}

/// The icosphere with each vertex moved in or out by up to `roughness` of the radius.
fn boulder(levels: u32, roughness: f32, scale: f32, centre: Vec3) -> Mesh {
    let mut mesh = Mesh { normals: Vec::new(), ..icosphere(levels, true, 0) };
    let mut rng = Rng::new(7, 0);
    // Vertices that triangles share may stand in the list several times.
    let mut moved = HashMap::new();
    for p in &mut mesh.positions {
        let at = p.to_array().map(f32::to_bits);
        let radius = *moved.entry(at).or_insert_with(|| 1.0 + roughness * (2.0 * rng.uniform() as f32 - 1.0));
        *p = centre + scale * radius * *p;
    }
    mesh
}

/// A cube of edge `size` whose faces are grids of `cells` a side, on a lattice of exact numbers if both are powers
/// of two.
fn lattice(cells: u32, size: f32, corner: Vec3) -> Mesh {
    let mut mesh = Mesh::default();
    let mut index = HashMap::new();
    let step = size / cells as f32;
    for axis in 0..3 {
        for side in [0, cells] {
            for i in 0..cells {
                for j in 0..cells {
                    let mut vertex = |u: u32, v: u32| {
                        let mut at = [0; 3];
                        (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, u, v);
                        *index.entry(at).or_insert_with(|| {
                            mesh.positions.push(corner + step * Vec3::from(at.map(|c| c as f32)));
                            mesh.positions.len() as u32 - 1
                        })
                    };
                    let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                    mesh.triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    mesh
}

fn around(centre: Vec3, reach: f32) -> [Vec3; 2] {
    [centre - reach, centre + reach]
}

fn cases() -> Vec<Case> {
    let inside = |name, mesh, centre, reach| Case { name, mesh, from: around(centre, reach), facing: 0.0 };
    let far = vec3(4096.0, -2048.0, 1024.0);
    vec![
        inside("ball, from inside", boulder(5, 0.0, 1.0, Vec3::ZERO), Vec3::ZERO, 0.5),
        inside("boulder, from inside", boulder(4, 0.1, 1.0, Vec3::ZERO), Vec3::ZERO, 0.5),
        inside("boulder of 1e-3", boulder(4, 0.1, 1e-3, Vec3::ZERO), Vec3::ZERO, 5e-4),
        inside("boulder of 1e6", boulder(4, 0.1, 1e6, Vec3::ZERO), Vec3::ZERO, 5e5),
        inside("boulder 4,700 radii off", boulder(4, 0.1, 1.0, far), far, 0.25),
        inside("cube of exact cells", lattice(32, 2.0, Vec3::NEG_ONE), Vec3::ZERO, 0.99),
        inside("cube of exact cells, from its centre", lattice(32, 2.0, Vec3::NEG_ONE), Vec3::ZERO, 0.0),
        inside("cube of odd cells", lattice(37, 0.3, vec3(-0.1, 0.05, 0.7)), vec3(0.05, 0.2, 0.85), 0.14),
        inside("cube of 12 triangles", lattice(1, 2.0, Vec3::NEG_ONE), Vec3::ZERO, 0.999),
        Case {
            name: "boulder, from 30 radii",
            mesh: boulder(4, 0.02, 1.0, Vec3::ZERO),
            from: around(vec3(20.0, -15.0, 18.0), 1.0),
            facing: 0.5,
        },
        Case {
            name: "boulder, from 10,000 radii",
            mesh: boulder(4, 0.02, 1.0, Vec3::ZERO),
            from: around(vec3(6e3, 5e3, -6e3), 100.0),
            facing: 0.5,
        },
    ]
}

/// A ray from the case's box at a vertex, or at a point on an edge.
fn aim(case: &Case, centre: Vec3, rng: &mut Rng) -> Ray {
    let mut random = || rng.uniform() as f32;
    loop {
        let origin = case.from[0] + (case.from[1] - case.from[0]) * vec3(random(), random(), random());
        let pick = |x: f32, n: usize| ((x * n as f32) as usize).min(n - 1);
        let triangle = case.mesh.triangles[pick(random(), case.mesh.triangles.len())];
        let corner = pick(random(), 3);
        let [a, b] = [triangle[corner], triangle[(corner + 1) % 3]].map(|v| case.mesh.positions[v as usize]);
        let along = random();
        let target = if along < 0.4 { a } else { a + (b - a) * ((along - 0.4) / 0.6) };
        let Some(direction) = (target - origin).try_normalize() else { continue };
        if case.facing > 0.0 && -direction.dot((target - centre).normalize()) < case.facing {
            continue;
        }
        return [origin.extend(0.0).to_array(), direction.extend(0.0).to_array()];
    }
}

fn leaks(tracer: &Tracer, case: &Case, rays: usize) -> usize {
    let mut scene = empty(case.name);
    add_matte(&mut scene, Vec3::ONE);
    place(&mut scene, case.mesh.clone());
    let centre = case.mesh.positions.iter().sum::<Vec3>() / case.mesh.positions.len() as f32;
    let accel = Accel::build(&scene).unwrap();
    let storage = wgpu::BufferUsages::STORAGE;
    let nodes = tracer.node_texture(&accel.nodes);
    let triangles = tracer.buffer(bytemuck::cast_slice::<Triangle, u8>(&accel.triangles), storage);
    // Zeros: no tree but that of the triangles.
    let frame = tracer.buffer(bytemuck::bytes_of(&Frame::zeroed()), wgpu::BufferUsages::UNIFORM);
    let tables = [
        (0, frame.as_entire_binding()),
        (1, wgpu::BindingResource::TextureView(&nodes)),
        (2, triangles.as_entire_binding()),
    ];
    let tables = tracer.bind(0, &tables);
    let mut rng = Rng::new(3, 0);
    let mut missed = 0;
    for begin in (0..rays).step_by(BATCH) {
        let mut batch: Vec<Ray> = (begin..rays.min(begin + BATCH)).map(|_| aim(case, centre, &mut rng)).collect();
        for [origin, _] in &mut batch {
            let near = Vec3::from_slice(origin).as_dvec3() - accel.origin;
            *origin = near.as_vec3().extend(0.0).to_array();
        }
        missed += tracer.trace(&tables, &batch).iter().filter(|&&prim| prim == u32::MAX).count();
    }
    missed
}

fn assert_nothing_leaks(rays: usize) {
    let tracer = Tracer::new();
    let cases = cases();
    let each = rays.div_ceil(cases.len());
    let count = |case| leaks(&tracer, case, each);
    let leaks: Vec<_> = cases.iter().map(|case| (case.name, count(case))).collect();
    println!("leaks of {each} rays each: {leaks:#?}");
    assert!(leaks.iter().all(|(_, missed)| *missed == 0), "rays leak, of {each} each: {leaks:#?}");
}

#[test]
fn no_ray_leaks_at_edges_and_vertices() {
    assert_nothing_leaks(1_000_000);
}

#[test]
#[ignore = "takes a minute: run it after changes to intersection"]
fn no_ray_of_ten_million_leaks_at_edges_and_vertices() {
    assert_nothing_leaks(10_000_000);
}
