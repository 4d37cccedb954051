//! Frames in buffers of a device that the caller has opened.

use super::{EXTENT, Noisy, SPP, noisy, with_denoiser};
use crate::common::{Subject, devices, give_back, open_alone};
use diptych::denoise::{DenoiseError, FrameDenoiser, Given, GivenBuffers, Inputs, Settings};
use diptych::device::{DeviceError, GpuDevice};
use diptych::scene::rig::View;
use wgpu::{BufferUsages, Features, Limits};

const BYTES: u64 = 16 * EXTENT.area() as u64;

/// Opens a device on the adapter of [`devices`], without the library.
fn open(required_features: Features, required_limits: Limits) -> (wgpu::Device, wgpu::Queue) {
    let gpu = devices(1).pop().unwrap();
    let name = gpu.info.name.clone();
    give_back(gpu);
    open_alone(|| {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let adapter = adapters.into_iter().find(|adapter| adapter.get_info().name == name).unwrap();
        let descriptor = wgpu::DeviceDescriptor { required_features, required_limits, ..Default::default() };
        pollster::block_on(adapter.request_device(&descriptor)).unwrap()
    })
}

fn open_for_denoiser() -> (wgpu::Device, wgpu::Queue) {
    open(GpuDevice::REQUIRED_FEATURES, GpuDevice::required_limits(Limits::defaults()))
}

fn buffer(device: &wgpu::Device, size: u64, usage: BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

/// A view of a frame in buffers.
struct Buffered {
    camera: View,
    /// Color, albedo, normal, position, emission and last position.
    arrays: [wgpu::Buffer; 6],
}

impl Buffered {
    /// Copies a view to buffers that are longer than needed, with padding that is no number.
    fn new(device: &wgpu::Device, queue: &wgpu::Queue, view: &Given<'_>) -> Self {
        let Inputs { camera, color, emission, albedo, normal, position, last_position } = *view;
        let upload = |pixels: &[[f32; 3]]| {
            let padded: Vec<_> = pixels.iter().map(|&[x, y, z]| [x, y, z, f32::NAN]).collect();
            let buffer = buffer(device, BYTES + 16, BufferUsages::COPY_SRC | BufferUsages::COPY_DST);
            queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&padded));
            buffer
        };
        let [emission, last] = [emission.unwrap_or(color), last_position.unwrap_or(position)];
        Self { camera, arrays: [color, albedo, normal, position, emission, last].map(upload) }
    }

    /// Returns the view with the optional arrays that `like` has.
    fn given(&self, like: &Given<'_>) -> GivenBuffers<'_> {
        let [color, albedo, normal, position, emission, last] = &self.arrays;
        let emission = like.emission.map(|_| emission);
        let last_position = like.last_position.map(|_| last);
        GivenBuffers { emission, last_position, ..GivenBuffers::new(self.camera, color, albedo, normal, position) }
    }
}

/// Checks that frames in buffers have the bytes of frames on the host. All frames are recorded before any is submitted.
#[track_caller]
fn assert_equal(settings: &Settings, frames: &[Vec<Given<'_>>]) {
    let expected = with_denoiser(settings, |denoiser| {
        frames.iter().map(|views| denoiser.denoise(views).unwrap()).collect::<Vec<_>>()
    });
    let (device, queue) = open_for_denoiser();
    let gpu = GpuDevice::from_wgpu(device.clone(), queue.clone()).unwrap();
    let mut denoiser = FrameDenoiser::on(gpu, settings).unwrap();
    let readback = frames.iter().map(|views| {
        let mut encoder = device.create_command_encoder(&Default::default());
        let buffered: Vec<_> = views.iter().map(|view| Buffered::new(&device, &queue, view)).collect();
        let given: Vec<_> = buffered.iter().zip(views).map(|(buffered, view)| buffered.given(view)).collect();
        denoiser.record(&mut encoder, &given).unwrap();
        let copied = denoiser.outputs().into_iter().map(|output| {
            let to = buffer(&device, output.size(), BufferUsages::MAP_READ | BufferUsages::COPY_DST);
            encoder.copy_buffer_to_buffer(output, 0, &to, 0, output.size());
            to
        });
        (copied.collect::<Vec<_>>(), encoder.finish())
    });
    let (readback, commands): (Vec<_>, Vec<_>) = readback.unzip();
    queue.submit(commands);
    readback.iter().flatten().for_each(|buffer| buffer.map_async(wgpu::MapMode::Read, .., Result::unwrap));
    device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    for (index, (buffers, images)) in readback.iter().zip(&expected).enumerate() {
        assert_eq!(buffers.len(), settings.views);
        for (view, (buffer, image)) in buffers.iter().zip(images).enumerate() {
            let mapped = buffer.get_mapped_range(..).unwrap();
            let found: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&mapped);
            let same = image.pixels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).eq(found);
            assert!(same, "frame {index}, view {view} differs from that of the host");
        }
    }
}

#[test]
fn same_bytes_from_buffers_of_an_own_device() {
    let frames = noisy(&Subject::load("builtin:cornell"), &[0.0, 0.1, 0.2, 0.3]);
    let pairs: Vec<Vec<_>> = frames.iter().map(|views| views.each_ref().map(Noisy::given).to_vec()).collect();
    assert_equal(&Settings { spp: SPP, ..Settings::new(EXTENT) }, &pairs);
    // Surfaces of the left view move in the first two frames, and its lamps are not told.
    let moved = |[left, _]: &[Noisy; 2]| left.given().position.iter().map(|&[x, y, z]| [x + 0.02, y, z]).collect();
    let moved: Vec<Vec<_>> = frames.iter().map(moved).collect();
    let single =
        |i: usize| vec![Given { emission: None, last_position: (i < 2).then_some(&moved[i][..]), ..pairs[i][0] }];
    let singles: Vec<_> = (0..frames.len()).map(single).collect();
    assert_equal(&Settings { views: 1, is_animated: true, spp: SPP, ..Settings::new(EXTENT) }, &singles);
}

#[test]
fn rejects_buffers_that_do_not_fit() {
    let frames = noisy(&Subject::load("builtin:cornell"), &[0.0, 0.1]);
    let (device, queue) = open_for_denoiser();
    let settings = Settings { views: 1, is_animated: true, spp: SPP, ..Settings::new(EXTENT) };
    let gpu = GpuDevice::from_wgpu(device.clone(), queue.clone()).unwrap();
    let mut denoiser = FrameDenoiser::on(gpu, &settings).unwrap();
    let [first, second] = [0, 1].map(|i| frames[i][0].given());
    denoiser.denoise(&[first]).unwrap();
    let expected = denoiser.denoise(&[second]).unwrap();
    denoiser.reset();
    denoiser.denoise(&[first]).unwrap();
    let all = Given { last_position: Some(second.position), ..second };
    let wrong = [
        (buffer(&device, BYTES - 4, BufferUsages::COPY_SRC), "has 98300 bytes, but 96x64 pixels need 98304"),
        (buffer(&device, BYTES, BufferUsages::STORAGE), "is a buffer without the usage COPY_SRC"),
    ];
    let names = ["color", "albedo", "normal", "position", "emission", "last_position"];
    for (i, name) in names.into_iter().enumerate() {
        for (wrong, text) in &wrong {
            let mut buffered = Buffered::new(&device, &queue, &all);
            buffered.arrays[i] = wrong.clone();
            let mut encoder = device.create_command_encoder(&Default::default());
            let refused = denoiser.record(&mut encoder, &[buffered.given(&all)]).unwrap_err();
            assert!(matches!(refused, DenoiseError::Given(_)), "{refused:?}");
            assert_eq!(refused.to_string(), format!("{name} of view 0 {text}"));
        }
    }
    assert!(denoiser.denoise(&[second]).unwrap() == expected, "rejected buffers have changed the history");
}

#[test]
fn rejects_devices_that_lack_features_or_limits() {
    let lacking = |(device, queue): (wgpu::Device, wgpu::Queue)| match GpuDevice::from_wgpu(device, queue) {
        Err(DeviceError::GivenLacks { missing, .. }) => missing,
        other => panic!("{other:?}"),
    };
    assert_eq!(
        lacking(open(Features::empty(), Limits::defaults())),
        "immediate (push) constants, storage buffers per stage (8 of 13)"
    );
    let limits = Limits { max_immediate_size: 32, ..GpuDevice::required_limits(Limits::defaults()) };
    let required = GpuDevice::REQUIRED_FEATURES;
    assert_eq!(lacking(open(required, limits)), "bytes of immediate (push) constants (32 of 64)");
    // The size of buffers is checked against that of the images.
    let limits =
        Limits { max_storage_buffer_binding_size: BYTES - 4, ..GpuDevice::required_limits(Limits::defaults()) };
    let (device, queue) = open(required, limits);
    let gpu = GpuDevice::from_wgpu(device, queue).unwrap();
    let refused = FrameDenoiser::on(gpu, &Settings::new(EXTENT)).err().expect("its images are too large").to_string();
    assert!(refused.contains("max_storage_buffer_binding_size"), "{refused}");
}
