//! Ray queries of the device find what shaders find. Where no adapter has them, a line says so.

use crate::common::{Stage, Subject, all_cores};
use crate::instances;
use diptych::accel::Layout;
use diptych::device::{self, GpuDevice, Selection, Traversal, TraversalChoice};
use diptych::exec::ExecError;
use diptych::image::{Extent, RgbImage};
use diptych::passes::Aov;
use diptych::schedule::Even;
use glam::Vec3;

const EXTENT: Extent = Extent::new(160, 90);

/// A device on an adapter that has ray queries, if there is one.
fn open(traversal: TraversalChoice) -> Option<GpuDevice> {
    let Some(able) = device::adapters().into_iter().find(|a| a.ray_queries && a.missing.is_empty()) else {
        eprintln!("\nSKIPPED: no adapter here has ray queries\n");
        return None;
    };
    let selection = Selection {
        adapters: Some(vec![able.index]),
        virtual_devices: 1,
        threads_per_device: Some(vec![all_cores()]),
        traversal,
    };
    Some(device::open(&selection).unwrap_or_else(|e| panic!("{e}")).remove(0))
}

/// What is seen of a subject: light and distance of each of the left eye's pixels.
struct Seen {
    linear: RgbImage,
    depth: Vec<f32>,
}

fn see(subject: &Subject, traversal: TraversalChoice) -> Option<Seen> {
    let gpu = open(traversal)?;
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.stages.aovs = vec![Aov::Depth];
    let mut stage = Stage::on(vec![gpu], subject, &settings, Box::new(Even::new(EXTENT.height, 1)));
    let linear = stage.frame(0).linear.left;
    let depth = stage.aov(0).left.swap_remove(0);
    // Not for tests that ask for devices of another traversal.
    drop(stage.into_devices());
    Some(Seen { linear, depth })
}

fn mean(image: &RgbImage) -> f64 {
    image.pixels.as_flattened().iter().map(|&c| f64::from(c)).sum::<f64>() / image.pixels.len() as f64
}

/// The same distances, but for rays along edges; paths that go on from there meet others.
#[test]
fn hardware_finds_what_shaders_find() {
    let crowd = instances::crowd();
    let subjects = || {
        let builtin = ["builtin:atrium", "builtin:forest", "builtin:checker"].map(Subject::load).into_iter();
        builtin.chain([Layout::Flat, Layout::TwoLevel].map(|layout| instances::subject(&crowd, layout, Vec3::ZERO)))
    };
    for subject in subjects() {
        let [compute, hardware] =
            [TraversalChoice::Compute, TraversalChoice::Hardware].map(|traversal| see(&subject, traversal));
        let (Some(compute), Some(hardware)) = (compute, hardware) else { return };
        let is_elsewhere = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 1e-4 * a.max(**b);
        let elsewhere = compute.depth.iter().zip(&hardware.depth).filter(is_elsewhere).count();
        let is_other = |(a, b): &(&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-3 * a[c].max(b[c]));
        let others = compute.linear.pixels.iter().zip(&hardware.linear.pixels).filter(is_other).count();
        let (before, after) = (mean(&compute.linear), mean(&hardware.linear));
        let pixels = compute.depth.len();
        println!("{}: of {pixels} pixels {elsewhere} are elsewhere, {others} have other light", subject.name);
        assert!(elsewhere * 1000 <= pixels, "{}: {elsewhere} of {pixels} pixels are elsewhere", subject.name);
        assert!(others * 50 <= pixels, "{}: {others} of {pixels} pixels have other light", subject.name);
        assert!((before / after - 1.0).abs() < 0.02, "{}: {before} and {after} in the mean", subject.name);
    }
}

#[test]
fn devices_of_both_traversals_are_refused() {
    let subject = Subject::load("builtin:cornell");
    let settings = subject.settings(16, 8);
    let gpus = [TraversalChoice::Compute, TraversalChoice::Hardware].map(open);
    let [Some(compute), Some(hardware)] = gpus else { return };
    assert_eq!([&compute, &hardware].map(|gpu| gpu.info.traversal), Traversal::ALL);
    let refused = subject.renderer(vec![compute, hardware], &settings);
    assert!(matches!(refused.err(), Some(ExecError::MixedTraversal)));
}
