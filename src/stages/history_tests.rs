//! Tests that non-finite values in a frame's history do not spread and are counted. They are injected between two
//! frames, on a device.

use std::sync::Arc;

use glam::{DVec3, UVec3, Vec2};

use super::{DeviceStages, Place, Recording};
use crate::accel::Accel;
use crate::device::{self, GpuDevice, Selection};
use crate::frame::RunConfig;
use crate::graph::{Assignment, Bound, FrameGraph, Program, Stripes};
use crate::image::Extent;
use crate::layout::{Camera, Display, Foveation, Frame, History, Previous, Sampling, View};
use crate::passes::{Declarations, FrameSpec, RowTally, Views};
use crate::plan::{Command, Commands, Share};
use crate::quality::{Denoiser, Filter};
use crate::samples::PixelSamples;
use crate::scene::builtin;
use crate::scene::needs::SceneNeeds;
use crate::scene::rig::{Eye, Rig, RigKey};
use crate::schedule::Splits;
use crate::tables::SceneTables;

const EXTENT: Extent = Extent { width: 48, height: 32 };
const ITERATIONS: u32 = 3;
const HISTORY_ROWS: u32 = 4;

/// NaN as a float and as two half floats.
const NAN: u32 = 0x7fc0_7fc0;

/// Renders consecutive frames of a scene on one device, as `exec` does.
struct Bench {
    gpu: GpuDevice,
    stages: DeviceStages,
    tables: SceneTables,
    frames: u32,
    before: Option<Previous>,
}

fn spec(history_rows: Option<u32>) -> FrameSpec {
    FrameSpec { views: Views::Traced, iterations: ITERATIONS, history_rows, ..FrameSpec::new(EXTENT, 1) }
}

fn program(history_rows: Option<u32>) -> Program {
    Declarations::default().check(&spec(history_rows)).unwrap()
}

/// Returns the image that reports call `name`.
fn image(name: &str) -> Bound {
    *program(Some(0)).images().iter().find(|b| b.name() == name).expect(name)
}

impl Bench {
    fn new(gloss: bool) -> Self {
        let scene = builtin::find("checker").unwrap().build();
        let selection = Selection { virtual_devices: 1, ..Selection::default() };
        let mut gpu = device::open(&selection).expect("this test needs an adapter").swap_remove(0);
        let tables = SceneTables::new(&scene, Accel::build(&scene).unwrap()).unwrap();
        let needs = SceneNeeds { gloss, ..SceneNeeds::of(&scene) };
        let mut config = RunConfig::new(EXTENT, needs);
        config.envelope.most.filter = Some(Filter::new(Denoiser::SVGF, ITERATIONS));
        config.buffers.reproject = false;
        let stages = DeviceStages::new(&mut gpu, config, &tables, &[program(Some(0))]).unwrap();
        Self { gpu, stages, tables, frames: 0, before: None }
    }

    /// Renders the next frame, with both eyes moved `step` to the right since the previous one. Returns the colours of
    /// both eyes and the number of dropped values.
    fn frame(&mut self, step: f64) -> (Vec<f32>, u32) {
        let (frame, place) = (self.constants(step), Place::of(u64::from(self.frames), 1));
        let before = self.before.replace(Previous::from(&frame));
        let assignment = Assignment::uniform(Stripes::even(EXTENT.height, 1));
        let program = Arc::new(program(before.map(|_| HISTORY_ROWS)));
        let graph = FrameGraph::build(&program, &assignment, before.map(|_| &assignment));
        let previous = before.unwrap_or(Previous::from(&frame));
        self.stages.begin(&self.gpu, &[(frame, previous)], &Default::default());
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        let (gpu, program) = (&self.gpu, &program);
        let mut to = Recording { gpu, queries: None, encoder: &mut encoder, program, place };
        let samples = frame.sampling.samples;
        let (ticket, device, repeats, injected) = (0, 0, 1, None);
        let share = Share { ticket, device, samples, splits: &Splits::default(), repeats, injected, asks: false };
        for command in Commands::new(&graph, &share).list {
            match command {
                Command::Clear(image) => self.stages.clear(&mut to, &image),
                Command::Dispatch { pass, launches, .. } => {
                    self.stages.dispatch(&mut to, pass, &launches, [None; 2]);
                }
                _ => {}
            }
        }
        self.gpu.queue.submit([encoder.finish()]);
        self.frames += 1;
        let [colors, rows] =
            ["linear", "row_tally"].map(|name| Eye::BOTH.map(|eye| self.read(&image(name), eye, place)).concat());
        let rows: &[RowTally] = bytemuck::cast_slice(&rows);
        (bytemuck::cast_slice(&colors).to_vec(), rows.iter().map(|row| row.nonfinite).sum())
    }

    fn constants(&self, step: f64) -> Frame {
        let position = DVec3::new(step * f64::from(self.frames), 1.6, 0.0);
        let key = RigKey { time_s: 0.0, position, target: position + DVec3::new(0.0, -0.15, -10.0), up: DVec3::Y };
        let rig = Rig { yfov_rad: 1.05, baseline_m: 0.064, ..Rig::of_keys(vec![key]) };
        let mut frame = Frame {
            camera: Camera {
                views: Eye::BOTH.map(|eye| View::new(&rig.view(0.0, eye), 1.5)),
                centre: Vec2::splat(0.5),
                width: EXTENT.width,
                height: EXTENT.height,
                ..Default::default()
            },
            sampling: Sampling {
                index: self.frames,
                reflections: 2,
                sampled_fraction: 1.0,
                samples: PixelSamples::own(0..1, true),
                ..Default::default()
            },
            foveation: Foveation { layer_iterations: UVec3::splat(ITERATIONS), ..Default::default() },
            history: History::new(self.before.map(|_| HISTORY_ROWS), 0..0),
            display: Display { exposure: 1.0, storage_scale: 1.0, ..Default::default() },
            ..Frame::default()
        };
        self.tables.describe(&mut frame);
        frame
    }

    fn read(&self, image: &Bound, eye: Eye, place: Place) -> Vec<u8> {
        let from = self.stages.images.buffer(image, eye, place);
        let to = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: from.size(),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(from, 0, &to, 0, from.size());
        self.gpu.queue.submit([encoder.finish()]);
        to.slice(..).map_async(wgpu::MapMode::Read, |mapped| mapped.unwrap());
        self.gpu.wait(None).unwrap();
        to.slice(..).get_mapped_range().unwrap().to_vec()
    }

    /// Overwrites these words of the centre pixel in the left eye's image of the last frame.
    fn poison(&self, image: &Bound, words: std::ops::Range<u64>) {
        let pixel = u64::from(EXTENT.height / 2 * EXTENT.width + EXTENT.width / 2);
        let last = self.stages.images.buffer(image, Eye::LEFT, Place::of(u64::from(self.frames), 1));
        for word in words {
            self.gpu.queue.write_buffer(last, 16 * pixel + 4 * word, bytemuck::bytes_of(&NAN));
        }
    }
}

/// Covers eyes that stand still, creep and move, with and without separate specular radiance.
#[test]
fn non_finite_history_is_dropped_and_counted() {
    let places = [
        ("last_history", 0..4),
        ("last_history", 1..2),
        ("last_moments", 0..2),
        ("last_moments", 2..3),
        ("last_resolved", 0..4),
        ("last_resolved", 2..3),
        ("last_resolved", 3..4),
    ];
    for gloss in [false, true] {
        let mut bench = Bench::new(gloss);
        for step in [0.0, 1e-4, 0.01] {
            assert_eq!(bench.frame(step).1, 0);
            for (name, words) in places.clone() {
                let what = format!("gloss {gloss}, step {step}, {name} {words:?}");
                bench.poison(&image(name), words);
                let [(first, dropped), (second, later)] = [0, 1].map(|_| bench.frame(step));
                let is_sound = |colors: &[f32]| colors.iter().all(|c| c.is_finite() && *c >= 0.0);
                assert!(is_sound(&first) && is_sound(&second), "{what}: it is still there");
                assert!((1..=32).contains(&dropped), "{what}: {dropped} values were counted");
                assert_eq!(later, 0, "{what}: it came back");
            }
        }
    }
}
