//! A change of quality does not count as a change of light: history is kept as at constant quality.

use crate::common::{Stage, Subject, sampled, with_outputs};
use crate::reference::scenes::moving;
use diptych::graph::Resource;
use diptych::quality::{Denoiser, Filter, Quality};
use diptych::samples::Samples;

use super::watched;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;
const FPS: f64 = 72.0;

/// Samples per pixel, bounces and render scale.
type Rung = (f64, u32, f64);

/// Frames before the last one.
const BEFORE: usize = 5;

/// Gradients of a run's last frame (bits), and the mean fraction of history that it drops.
struct Last {
    gradients: Vec<u32>,
    dropped: f64,
}

/// Renders frames, of which the last has a rung of its own. Frame numbers are `stride` apart.
fn play(subject: &Subject, denoiser: Denoiser, [rung, last]: [Rung; 2], stride: u32, fps: f64) -> Last {
    let mut settings = subject.accumulated(WIDTH, HEIGHT);
    let most = &mut settings.envelope.most;
    let filter = Some(Filter::new(denoiser, 5));
    (most.filter, most.spp, most.scale) = (filter, Samples::of_mean(3.5), 0.5);
    settings.envelope.mixes_spp = true;
    settings.buffers.declarations = with_outputs(&["gradient", "light_change"]);
    let mut stage = Stage::alone(subject, &settings);
    for (i, (spp, bounces, scale)) in (0..).zip([rung; BEFORE].into_iter().chain([last])) {
        let spp = Samples::of_mean(spp);
        let quality = Quality { spp, bounces, filter, fovea: None, polar: None, scale };
        stage.set(move |params| params.quality = quality);
        stage.frame_at(0.3 + f64::from(i) / fps, stride * i);
    }
    let mut read = |name| stage.renderer().read_output(Resource::image::<u32>(name)).unwrap().into_left();
    let dropped: Vec<f32> = bytemuck::pod_collect_to_vec(&read("light_change"));
    Last {
        gradients: bytemuck::pod_collect_to_vec(&read("gradient")),
        dropped: dropped.iter().map(|v| f64::from(*v)).sum::<f64>() / dropped.len() as f64,
    }
}

const USUAL: Rung = (1.0, 6, 1.0);

/// Gradients compare the previous frame's paths with themselves, whatever the settings of the current frame.
#[test]
fn gradients_ignore_changes_of_bounces_and_scale() {
    let subject = watched(moving::everything());
    let changes = [
        (USUAL, (1.0, 2, 0.7)),
        (USUAL, (1.0, 1, 1.0)),
        ((1.0, 2, 1.0), (1.0, 6, 1.0)),
        (USUAL, (1.5, 6, 1.0)),
        (USUAL, (1.0, 6, 0.5)),
        ((1.0, 6, 0.5), USUAL),
    ];
    for (before, after) in sampled(changes, 3) {
        let [constant, changed] = [before, after].map(|last| play(&subject, Denoiser::SVGF, [before, last], 1, FPS));
        println!("{before:?} to {after:?}: drops {:.4} instead of {:.4}", changed.dropped, constant.dropped);
        assert!(constant.gradients.iter().any(|bits| *bits != 0), "there are no gradients");
        assert!(constant.gradients == changed.gradients, "gradients of {before:?} to {after:?}");
    }
}

#[test]
fn changed_sample_counts_drop_little_more_history() {
    let subject = watched(moving::everything());
    for denoiser in sampled([Denoiser::SVGF, Denoiser::BMFR], 2) {
        let dropped = |rungs, stride| play(&subject, denoiser, rungs, stride, FPS).dropped;
        let many = (3.0, 6, 1.0);
        let constant = dropped([USUAL; 2], 1);
        let (more, apart) = (dropped([USUAL, many], 1), dropped([USUAL; 2], 7));
        println!("{denoiser:?} drops {constant:.4}, with more samples {more:.4}, with numbers apart {apart:.4}");
        assert!(constant > 0.0, "{denoiser:?}: there are no gradients");
        // With several samples, rays do not go through the pixel centre, and frames further apart have other random
        // numbers.
        assert!(more.max(apart) < 2.0 * constant, "{denoiser:?}: {more} and {apart} instead of {constant}");
        let [fewer, as_many] = [[many, USUAL], [many; 2]].map(|rungs| dropped(rungs, 1));
        println!("after more samples {fewer:.4}, and as many again {as_many:.4}");
        assert!(fewer.min(as_many) > 0.0, "{denoiser:?}: frames of several samples have no gradients");
        assert!(fewer.max(as_many) < 2.0 * constant, "{denoiser:?}: {fewer} and {as_many} instead of {constant}");
    }
}

/// The light of several samples is a mean, which a single path differs from.
#[test]
fn static_scenes_drop_no_history_at_any_spp() {
    let subject = watched(moving::everything());
    for (before, after) in [(1.5, 1.5), (3.0, 3.0), (3.0, 1.0), (1.0, 3.0), (1.5, 2.0)] {
        let rungs = [before, after].map(|spp| (spp, 6, 1.0));
        assert_eq!(play(&subject, Denoiser::SVGF, rungs, 1, f64::INFINITY).dropped, 0.0, "{before} to {after}");
    }
}
