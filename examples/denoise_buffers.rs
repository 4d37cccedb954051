//! Denoises frames that a shader writes to buffers, on a wgpu device of this program.
//!
//! `cargo run --release --example denoise_buffers`

use diptych::Extent;
use diptych::denoise::{FrameDenoiser, GivenBuffers, Settings};
use diptych::device::GpuDevice;
use diptych::scene::rig::View;
use glam::Vec3;
use wgpu::BufferUsages as Usages;

const EXTENT: Extent = Extent::new(256, 144);
const FRAMES: u32 = 16;
const CAMERA: View =
    View { origin: Vec3::ZERO, right: Vec3::X, up: Vec3::Y, forward: Vec3::NEG_Z, tan_half_yfov: 0.5, shift_x: 0.0 };

/// Renders a wall 2 in front of the camera, which reflects 80 % of noisy light with a mean of 0.5.
const RENDERER: &str = "
@group(0) @binding(0) var<storage, read_write> color: array<vec3<f32>>;
@group(0) @binding(1) var<storage, read_write> albedo: array<vec3<f32>>;
@group(0) @binding(2) var<storage, read_write> normal: array<vec3<f32>>;
@group(0) @binding(3) var<storage, read_write> position: array<vec3<f32>>;
@group(0) @binding(4) var<uniform> frame: u32;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let size = 8u * groups.xy;
    let i = id.y * size.x + id.x;
    var random = (i + frame * size.x * size.y) * 747796405u + 2891336453u;
    random = ((random >> ((random >> 28u) + 4u)) ^ random) * 277803737u;
    random ^= random >> 22u;
    color[i] = vec3<f32>(0.8 * f32(random >> 8u) / 16777216.0);
    albedo[i] = vec3<f32>(0.8);
    normal[i] = vec3<f32>(0.0, 0.0, 1.0);
    let from_centre = 2.0 * (vec2<f32>(id.xy) + 0.5 - 0.5 * vec2<f32>(size)) / f32(size.y);
    position[i] = vec3<f32>(from_centre.x, -from_centre.y, -2.0);
}";

fn main() -> anyhow::Result<()> {
    let instance = wgpu::Instance::default();
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
        required_features: GpuDevice::REQUIRED_FEATURES,
        required_limits: GpuDevice::required_limits(wgpu::Limits::default()),
        ..Default::default()
    }))?;
    let new = |size, usage| {
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    };
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(RENDERER.into()),
    });
    let renderer = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: None,
        compilation_options: Default::default(),
        cache: None,
    });
    let bytes = 16 * EXTENT.area() as u64;
    let [color, albedo, normal, position] = [(); 4].map(|()| new(bytes, Usages::STORAGE | Usages::COPY_SRC));
    let number = new(4, Usages::UNIFORM | Usages::COPY_DST);
    let bound = [&color, &albedo, &normal, &position, &number];
    let entry = |i| wgpu::BindGroupEntry { binding: i, resource: bound[i as usize].as_entire_binding() };
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &renderer.get_bind_group_layout(0),
        entries: &[0, 1, 2, 3, 4].map(entry),
    });

    let settings = Settings { views: 1, ..Settings::new(EXTENT) };
    let mut denoiser = FrameDenoiser::on(GpuDevice::from_wgpu(device.clone(), queue.clone())?, &settings)?;
    let [noisy, denoised] = [(); 2].map(|()| new(bytes, Usages::MAP_READ | Usages::COPY_DST));
    for frame in 0..FRAMES {
        queue.write_buffer(&number, 0, &frame.to_le_bytes());
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&renderer);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(EXTENT.width / 8, EXTENT.height / 8, 1);
        drop(pass);
        denoiser.record(&mut encoder, &[GivenBuffers::new(CAMERA, &color, &albedo, &normal, &position)])?;
        encoder.copy_buffer_to_buffer(&color, 0, &noisy, 0, bytes);
        encoder.copy_buffer_to_buffer(denoiser.outputs()[0], 0, &denoised, 0, bytes);
        queue.submit([encoder.finish()]);
    }

    for (name, buffer) in [("noisy", noisy), ("denoised", denoised)] {
        buffer.map_async(wgpu::MapMode::Read, .., |result| result.expect("the device has failed"));
        device.poll(wgpu::PollType::wait_indefinitely())?;
        let pixels: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&buffer.get_mapped_range(..)?);
        let squares: f32 = pixels.iter().map(|pixel| (pixel[0] - 0.4).powi(2)).sum();
        println!("{name}: RMSE {:.4}", (squares / pixels.len() as f32).sqrt());
    }
    Ok(())
}
