//! Checks on a device that shaders sample lights with the densities that they report.

use glam::{Affine3A, Vec3};
use wgpu::util::DeviceExt;

use super::shader::Shader;
use crate::accel::Accel;
use crate::device::{self, Selection, ShaderChecks};
use crate::graph::Kernel;
use crate::image::{Extent, RgbImage};
use crate::layout::{Frame, Sampling};
use crate::samples::PixelSamples;
use crate::scene::{Environment, Instance, Light, LightKind, Material, Mesh, Scene};
use crate::tables::{SceneBuffers, SceneTables, layout_entries};

/// Number of directions to sample, and of uniform directions: a multiple of 64 within one row of workgroups.
const COUNT: usize = 1 << 18;

/// Number of bins over the cosine with +y, and over the azimuth.
const BINS: [usize; 2] = [12, 24];

const PROBE: &str = "
//!include frame rng math tables environment lights hits
struct Answer {
    // A direction that was sampled, and the density that came with it; 0: none.
    sampled: vec4<f32>,
    // Densities there of the light that a ray finds, and of the environment.
    found: vec4<f32>,
    // A direction of even density over the sphere, and the density of all lights together.
    elsewhere: vec4<f32>,
}
@group(1) @binding(0) var<storage, read_write> answers: array<Answer>;

fn densities(p: vec3<f32>, n: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    let hit = trace_closest(p, direction, 0u);
    var lamp = 0.0;
    if hit.prim != NO_PRIM {
        if (hit.prim & SPHERE) != 0u {
            lamp = sphere_pdf(p, n, hit.prim & ~SPHERE, false);
        } else {
            let tri = stored_triangle(hit.prim);
            let m = stored_material(tri.material);
            let faces = dot(cross(tri.v1 - tri.v0, tri.v2 - tri.v0), direction) < 0.0;
            if faces || (m.flags & DOUBLE_SIDED) != 0u {
                lamp = triangle_light_pdf(p, n, hit.prim, hit.t, direction, false);
            }
        }
    }
    return vec2<f32>(lamp, env_light_pdf(direction, false));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let p = frame.camera.views[0].origin;
    let n = frame.camera.views[0].forward;
    var rng = rng_for(vec2<u32>(id.x, 0u), 0u, 0u);
    let choice = random2(&rng);
    let s = sample_light(p, n, choice, random2(&rng), false);
    let u = random2(&rng);
    let z = 1.0 - 2.0 * u.x;
    let around = vec2<f32>(cos(2.0 * PI * u.y), sin(2.0 * PI * u.y)) * sqrt(max(1.0 - z * z, 0.0));
    let even = vec3<f32>(around.x, z, around.y);
    let d = densities(p, n, even);
    answers[id.x] = Answer(
        vec4<f32>(s.direction, s.pdf),
        vec4<f32>(densities(p, n, s.direction), 0.0, 0.0),
        vec4<f32>(even, d.x + d.y),
    );
}
";

#[derive(Clone, Copy, Debug, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Answer {
    sampled: [f32; 4],
    found: [f32; 4],
    elsewhere: [f32; 4],
}

/// Samples the lights on a device from a surface at `p` facing `n` or, with `n` zero, from a point that light reaches
/// from all sides.
fn ask(scene: &Scene, p: Vec3, n: Vec3) -> Vec<Answer> {
    let selection = Selection { virtual_devices: 1, ..Selection::default() };
    let gpus = device::open(&selection).expect("this test needs an adapter");
    let (gpu, accel) = (&gpus[0], Accel::build(scene).unwrap());
    let tables = SceneTables::new(scene, accel).unwrap();
    let sampling = Sampling { seed: 5, samples: PixelSamples::own(0..0, true), ..Default::default() };
    let mut frame = Frame { sampling, ..Frame::default() };
    frame.camera.views[0].origin = p;
    frame.camera.views[0].forward = n;
    tables.describe(&mut frame);
    let scene = SceneBuffers::new(gpu, &tables).unwrap();
    let buffer_type = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    let group_layout =
        |entries: &[_]| gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries });
    let constants = buffer_type(0, wgpu::BufferBindingType::Uniform);
    let scene_layout = group_layout(&[vec![constants], layout_entries(gpu.scene_access())].concat());
    let answers_layout = group_layout(&[buffer_type(0, wgpu::BufferBindingType::Storage { read_only: false })]);
    let frame = gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
        label: None,
        contents: bytemuck::bytes_of(&frame),
        usage: wgpu::BufferUsages::UNIFORM,
    });
    let size = (COUNT * size_of::<Answer>()) as u64;
    let new_buffer = |usage| {
        gpu.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    };
    let answers = new_buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let readable = new_buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let bind = |layout, entries: &[_]| {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries })
    };
    let first = wgpu::BindGroupEntry { binding: 0, resource: frame.as_entire_binding() };
    let groups = [
        bind(&scene_layout, &std::iter::once(first).chain(scene.entries()).collect::<Vec<_>>()),
        bind(&answers_layout, &[wgpu::BindGroupEntry { binding: 0, resource: answers.as_entire_binding() }]),
    ];
    let pipeline = probe(gpu, &[Some(&scene_layout), Some(&answers_layout)]);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &groups[0], &[]);
        pass.set_bind_group(1, &groups[1], &[]);
        pass.dispatch_workgroups(COUNT as u32 / 64, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&answers, 0, &readable, 0, size);
    gpu.queue.submit([encoder.finish()]);
    readable.slice(..).map_async(wgpu::MapMode::Read, |mapped| mapped.unwrap());
    gpu.wait(None).unwrap();
    bytemuck::cast_slice(&readable.slice(..).get_mapped_range().unwrap()).to_vec()
}

fn probe(gpu: &device::GpuDevice, layouts: &[Option<&wgpu::BindGroupLayout>]) -> wgpu::ComputePipeline {
    let shader = Shader::new(&Kernel::from_text("probe", PROBE).reading_scene(), &[], gpu.scene_access()).unwrap();
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: layouts,
        immediate_size: 0,
    });
    shader.pipeline(&gpu.device, "probe", &layout, &[], ShaderChecks::Full)
}

/// Checks that directions are sampled as often as the density says, bin by bin, and that each comes with its density.
fn hold(what: &str, scene: &Scene, p: Vec3, n: Vec3) {
    let answers = ask(scene, p, n);
    let bin = |d: &[f32; 4]| {
        let [rows, columns] = BINS.map(|n| n as f64);
        let turn = f64::from(d[2]).atan2(f64::from(d[0])) / std::f64::consts::TAU + 0.5;
        let row = (0.5 * (f64::from(d[1]) + 1.0) * rows).clamp(0.0, rows - 1.0) as usize;
        row * BINS[1] + (turn * columns).clamp(0.0, columns - 1.0) as usize
    };
    let mut seen = vec![0.0; BINS[0] * BINS[1]];
    let mut expected = seen.clone();
    let mut variance = seen.clone();
    let mut wrong = 0;
    // Uniform directions are too sparse to find lights of a higher density. For these, only densities are compared.
    let densest = (COUNT as f64 / (4.0 * std::f64::consts::PI) / 50.0) as f32;
    for a in &answers {
        let density = a.sampled[3];
        if density > 0.0 {
            seen[bin(&a.sampled)] += f64::from(u8::from(density < densest));
            let off = |found: f32| (found / density - 1.0).abs();
            wrong += usize::from(off(a.found[0]).min(off(a.found[1])) > 2e-3);
        }
        let density = if a.elsewhere[3] < densest { a.elsewhere[3] } else { 0.0 };
        let weight = 4.0 * std::f64::consts::PI * f64::from(density);
        expected[bin(&a.elsewhere)] += weight;
        variance[bin(&a.elsewhere)] += weight * weight;
    }
    // Rays along an edge may miss the sampled light.
    assert!((wrong as f64) < 1e-3 * COUNT as f64, "{what}: {wrong} samples of {COUNT} have another density when found");
    assert!(seen.iter().sum::<f64>() > 0.2 * COUNT as f64, "{what}: too little is sampled to tell");
    let mut squares = Vec::new();
    for i in 0..seen.len() {
        let spread = expected[i].max(seen[i]) + variance[i];
        if expected[i] + seen[i] >= 10.0 {
            squares.push((seen[i] - expected[i]).powi(2) / spread);
        }
    }
    let chi2 = squares.iter().sum::<f64>() / squares.len() as f64;
    let bound = 1.0 + 5.0 * (2.0 / squares.len() as f64).sqrt();
    assert!(chi2 < bound, "{what}: mean z² {chi2:.3} over {} bins, {bound:.3} allowed", squares.len());
    println!("{what}: mean z² {chi2:.3} over {} bins ({bound:.3} allowed), {wrong} of {COUNT} off", squares.len());
}

fn empty() -> Scene {
    let materials = vec![Material { emissive: Vec3::new(2.0, 1.0, 0.5), ..Material::default() }];
    Scene { materials, ..Scene::empty("lights") }
}

/// Adds a triangle with edges of about 1 at `centre`, facing `normal`.
fn triangle(scene: &mut Scene, centre: Vec3, normal: Vec3, material: usize) {
    let (u, v) = normal.normalize().any_orthonormal_pair();
    let corners = [u, -0.5 * u + 0.9 * v, -0.5 * u - 0.9 * v].map(|d| centre + 0.6 * d);
    let [a, b, c] = corners;
    let positions = if (b - a).cross(c - a).dot(normal) > 0.0 { vec![a, b, c] } else { vec![a, c, b] };
    scene.meshes.push(Mesh { positions, triangles: vec![[0, 1, 2]], material, ..Mesh::default() });
    scene.instances.push(Instance { mesh: scene.meshes.len() - 1, world_from_local: Affine3A::IDENTITY });
}

/// Returns triangles and spheres around the origin that do not occlude one another. Some face away from it.
fn lamps() -> Scene {
    let mut scene = empty();
    let two_sided = Material { double_sided: true, ..scene.materials[0].clone() };
    scene.materials.push(two_sided);
    for k in 0..14u32 {
        // A spiral from pole to pole.
        let y = 1.0 - (k as f32 + 0.5) / 7.0;
        let (s, c) = (2.4 * k as f32).sin_cos();
        let ring = (1.0 - y * y).sqrt();
        let at = Vec3::new(ring * c, y, ring * s);
        let distance = 2.0 + 0.3 * (k % 5) as f32;
        let tilt = Vec3::new(0.4, -0.3, 0.2);
        match k % 4 {
            0 => triangle(&mut scene, at * distance, -at + tilt, 0),
            1 => triangle(&mut scene, at * distance, if k % 8 == 1 { at } else { -at + tilt }, 1),
            2 => scene.lights.push(Light {
                kind: LightKind::Point { position: at * distance, radius: 0.3 + 0.02 * k as f32 },
                strength: Vec3::splat(1.0 + k as f32),
            }),
            _ => scene.lights.push(Light {
                kind: LightKind::Spot {
                    position: at * distance,
                    radius: 0.25,
                    direction: (tilt - at).normalize(),
                    cos_inner: 0.9,
                    cos_outer: 0.5,
                },
                strength: Vec3::splat(4.0),
            }),
        }
    }
    triangle(&mut scene, Vec3::new(0.3, -4.0, 3.0), Vec3::new(0.1, -1.0, 0.0), 0);
    scene
}

/// Returns a sky with one bright texel.
fn sky(extent: Extent) -> Environment {
    let mut image = RgbImage::filled(extent, [0.1, 0.2, 0.4]);
    let at = extent.width as usize * (extent.height as usize / 4) + extent.width as usize - 1;
    image.pixels[at] = [900.0, 800.0, 600.0];
    Environment::Map { image: image.into(), rotation_deg: 77.0 }
}

#[test]
fn lamps_are_sampled_with_the_density_of_rays() {
    let scene = lamps();
    hold("lamps from all sides", &scene, Vec3::ZERO, Vec3::ZERO);
    hold("lamps from above", &scene, Vec3::ZERO, Vec3::Y);
    hold("lamps askew", &scene, Vec3::new(0.2, 0.1, -0.3), Vec3::new(0.6, -0.64, 0.48));
}

#[test]
fn skies_are_sampled_with_the_density_of_rays() {
    for extent in [Extent::new(24, 12), Extent::new(3, 1), Extent::new(700, 301)] {
        let mut scene = lamps();
        scene.environment = sky(extent);
        hold(&format!("lamps under {extent}"), &scene, Vec3::ZERO, Vec3::ZERO);
        hold(&format!("only {extent}"), &Scene { environment: sky(extent), ..empty() }, Vec3::ZERO, Vec3::Y);
    }
}

#[test]
fn extreme_lamps_are_sampled_with_the_density_of_rays() {
    let sphere = |position, radius| Light { kind: LightKind::Point { position, radius }, strength: Vec3::ONE };
    for (what, scale) in [("thousandth", 1e-3f32), ("million", 1e6)] {
        let mut scene = empty();
        scene.lights = vec![
            sphere(Vec3::Y * 1.0001 * scale, scale),
            sphere(Vec3::new(-5.0, -3.0, 0.0) * scale, 2.0 * scale),
            sphere(Vec3::NEG_Y * 10.0 * scale, 0.01 * scale),
        ];
        hold(what, &scene, Vec3::ZERO, Vec3::ZERO);
    }
}
