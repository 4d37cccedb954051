//! Divides frames among two virtual devices by a policy that is not one of the library's, and checks that the images are
//! those of one device, byte for byte.
//!
//! `cargo run --release --example own_policy`

use std::sync::Arc;
use std::time::Instant;

use anyhow::ensure;
use diptych::accel::Accel;
use diptych::device::{self, Selection};
use diptych::exec::{RenderSettings, Renderer};
use diptych::graph::{Assignment, Stripes};
use diptych::image::{Extent, RgbImage};
use diptych::scene::load::load_shot;
use diptych::schedule::{CostModel, Policy};
use diptych::stages::SceneTables;

const EXTENT: Extent = Extent::new(96, 64);
const FRAMES: u32 = 3;

/// The first device has a third of the rows in one frame and two thirds in the next.
struct Alternating {
    devices: usize,
    frame: usize,
}

impl Policy for Alternating {
    fn name(&self) -> &'static str {
        "alternating"
    }

    /// The cost model, of which this policy makes no use, predicts what rows would take on each device.
    fn assign(&mut self, _model: &CostModel) -> Assignment {
        let edge = if self.frame.is_multiple_of(2) { EXTENT.height / 3 } else { EXTENT.height * 2 / 3 };
        self.frame += 1;
        // One inner edge for two devices, none for one.
        let inner = vec![edge; self.devices - 1];
        Assignment::uniform(Stripes::from_edges(EXTENT.height, &inner))
    }

    /// Called when a device has failed.
    fn remove_device(&mut self, _device: usize) {
        self.devices -= 1;
    }
}

/// Both eyes of the frames that so many virtual devices render.
fn frames(count: usize) -> anyhow::Result<Vec<[RgbImage; 2]>> {
    let (shot, scene) = load_shot("builtin:cornell")?;
    let tables = Arc::new(SceneTables::new(&scene, Accel::build(&scene)?)?);
    let settings = RenderSettings::new(EXTENT, &scene, &tables);
    let devices = device::open(&Selection { virtual_devices: count, ..Selection::default() })?;
    let policy = Box::new(Alternating { devices: devices.len(), frame: 0 });
    let mut renderer = Renderer::new(devices, tables, settings, policy, Instant::now())?;
    let mut frames = Vec::new();
    for frame in 0..FRAMES {
        let report = renderer.render(&shot.rig, f64::from(frame) / 72.0, frame)?;
        let stripes: Vec<String> =
            report.assignment.common().iter().map(|(i, rows)| format!("{i}: {rows:?}")).collect();
        println!("frame {frame}, {:.1} ms, rows by device {}", report.makespan_ms, stripes.join(", "));
        let linear = renderer.read_linear()?;
        frames.push([linear.left, linear.right]);
    }
    Ok(frames)
}

fn main() -> anyhow::Result<()> {
    // SAFETY: no other thread of this program reads the environment while devices are opened.
    unsafe { device::set_environment_hook(|name, value| std::env::set_var(name, value)) };
    let one = frames(1)?;
    let two = frames(2)?;
    // Bits are compared, not numbers, of which 0 and -0 would be equal.
    let bits = |frames: &[[RgbImage; 2]]| -> Vec<u32> {
        frames.iter().flatten().flat_map(|eye| eye.pixels.as_flattened()).map(|value| value.to_bits()).collect()
    };
    ensure!(bits(&one) == bits(&two), "the images of two devices differ from those of one");
    println!("{FRAMES} frames of two devices have the bytes of one device");
    Ok(())
}
