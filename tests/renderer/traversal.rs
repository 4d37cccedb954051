//! Hardware ray queries give the same hits as compute traversal. Without an adapter that supports them, the test only
//! prints that.

use crate::common::{Stage, Subject, open_on};
use crate::instances;
use crate::moving::watched;
use crate::pictures::mean;
use crate::reference::scenes::moving;
use diptych::accel::Layout;
use diptych::device::{self, GpuDevice, Traversal, TraversalChoice};
use diptych::exec::ExecError;
use diptych::image::{Extent, RgbImage};
use diptych::passes::Aov;
use diptych::scene::AlphaMode;
use diptych::schedule::Even;
use glam::Vec3;

const EXTENT: Extent = Extent::new(160, 90);

/// Opens a device on an adapter that supports ray queries, if there is one.
fn open(traversal: TraversalChoice) -> Option<GpuDevice> {
    let Some(able) = device::adapters().into_iter().find(|a| a.ray_queries && a.missing.is_empty()) else {
        eprintln!("\nSKIPPED: no adapter here has ray queries\n");
        return None;
    };
    Some(open_on(able.index, 1, traversal).remove(0))
}

/// Image of a subject: light and distance of the left eye's pixels.
struct Seen {
    linear: RgbImage,
    depth: Vec<f32>,
}

/// Returns the last of the frames at these times.
fn see(subject: &Subject, traversal: TraversalChoice, times_s: &[f64]) -> Option<Seen> {
    let gpu = open(traversal)?;
    let mut settings = subject.settings(EXTENT.width, EXTENT.height);
    settings.buffers.aovs = vec![Aov::Depth];
    let mut stage = Stage::on(vec![gpu], subject, &settings, Box::new(Even::new(EXTENT.height, 1)));
    let frames = (0..).zip(times_s).map(|(index, &time_s)| stage.frame_at(time_s, index));
    let linear = frames.last()?.linear.into_left();
    let depth = stage.aov(0).into_left().swap_remove(0);
    // This device must not go to tests that expect another traversal.
    drop(stage.into_devices());
    Some(Seen { linear, depth })
}

/// Distances agree, except for rays along edges; paths from there have different hits.
#[test]
fn hardware_traversal_matches_compute_traversal() {
    let crowd = instances::crowd();
    let subjects = || {
        let builtin = ["builtin:atrium", "builtin:forest", "builtin:checker"].map(Subject::load).into_iter();
        builtin.chain([Layout::Flat, Layout::TwoLevel].map(|layout| instances::subject(&crowd, layout, Vec3::ZERO)))
    };
    for subject in subjects() {
        let [compute, hardware] =
            [TraversalChoice::Compute, TraversalChoice::Hardware].map(|traversal| see(&subject, traversal, &[0.0]));
        let (Some(compute), Some(hardware)) = (compute, hardware) else { return };
        assert_same_is_found(&subject.name, &compute, &hardware);
    }
}

/// Deforming bodies, opaque and with alpha, and blocks that share a mesh: one is mirrored, and one is away for a while.
#[test]
fn hardware_traversal_follows_dynamic_geometry() {
    let mut masked = moving::skinned();
    masked.materials.iter_mut().for_each(|m| m.alpha_mode = AlphaMode::Mask { cutoff: 0.5 });
    for scene in [moving::skinned(), moving::morphed(), masked, moving::rigid()] {
        let subject = watched(scene);
        let see = |times_s: &[f64]| {
            [TraversalChoice::Compute, TraversalChoice::Hardware].map(|traversal| see(&subject, traversal, times_s))
        };
        // The block is there, away, and back.
        for times_s in [&[0.3, 1.0][..], &[0.3, 1.0, 1.2]] {
            let [Some(compute), Some(hardware)] = see(times_s) else { return };
            assert_same_is_found(&format!("{} after {times_s:?} s", subject.name), &compute, &hardware);
        }
    }
}

#[track_caller]
fn assert_same_is_found(name: &str, compute: &Seen, hardware: &Seen) {
    let is_elsewhere = |(a, b): &(&f32, &f32)| (*a - *b).abs() > 1e-4 * a.max(**b);
    let elsewhere = compute.depth.iter().zip(&hardware.depth).filter(is_elsewhere).count();
    let is_other = |(a, b): &(&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-3 * a[c].max(b[c]));
    let others = compute.linear.pixels.iter().zip(&hardware.linear.pixels).filter(is_other).count();
    let (before, after) = (mean(&compute.linear), mean(&hardware.linear));
    let pixels = compute.depth.len();
    println!("{name}: of {pixels} pixels {elsewhere} are elsewhere, {others} have other light");
    assert!(elsewhere * 1000 <= pixels, "{name}: {elsewhere} of {pixels} pixels are elsewhere");
    assert!(others * 50 <= pixels, "{name}: {others} of {pixels} pixels have other light");
    assert!((before / after - 1.0).abs() < 0.02, "{name}: {before} and {after} in the mean");
}

#[test]
fn rejects_devices_of_mixed_traversal() {
    let subject = Subject::load("builtin:cornell");
    let settings = subject.settings(16, 8);
    let gpus = [TraversalChoice::Compute, TraversalChoice::Hardware].map(open);
    let [Some(compute), Some(hardware)] = gpus else { return };
    assert_eq!([&compute, &hardware].map(|gpu| gpu.info.traversal), Traversal::ALL);
    let refused = subject.renderer(vec![compute, hardware], &settings);
    assert!(matches!(refused.err(), Some(ExecError::MixedTraversal)));
}
