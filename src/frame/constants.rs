//! Frame constants, which all shaders of a frame read.

use glam::{DMat3, DVec3};

use super::foveation::EVERYWHERE;
use super::{Foveation, FrameParams, RunConfig};
use crate::image::Extent;
use crate::layout;
use crate::passes::Display;
use crate::samples::PixelSamples;
use crate::scene::optics::Optics;
use crate::scene::rig::{Eye, Rig};
use crate::tables::SceneTables;

/// Returns the constants of a frame, which have its outermost views, and all views. They declare that there is no history;
/// a caller that has one sets `history`.
pub fn constants(
    config: &RunConfig,
    params: &FrameParams,
    tables: &SceneTables,
    samples: PixelSamples,
) -> (layout::Frame, Vec<layout::View>) {
    let FrameParams { time_s, index, seed, ref quality, gaze, .. } = *params;
    let extent = config.buffers.extent;
    let aspect = f64::from(extent.width) / f64::from(extent.height);
    let Extent { width, height } = config.grid();
    let rig = params.rig.at(time_s).relative_to(tables.origin());
    let later = params.shown_from.as_ref().map_or(rig.clone(), |later| later.relative_to(tables.origin()));
    let screen = config.screen();
    let optics = rig.optics.as_ref().filter(|_| config.buffers.display != Display::Direct);
    let rectified = optics.map(|optics| (optics, screen));
    let layers = config.foveation().map(|layers| {
        let radii = quality.fovea.unwrap_or(EVERYWHERE);
        Foveation { radii, ..layers }.describe(gaze, extent, rectified)
    });
    let view = |eye: Eye| {
        let mut view = layout::View::new(&rig.view(time_s, eye), aspect);
        if let Some(optics) = optics {
            [view.tan_half_x, view.tan_half_y] = optics.rendered_tan_half(screen).map(|tan| tan as f32);
        }
        let Some(polar) = config.envelope.most.polar else { return view };
        let gaze = gaze[eye.index()];
        polar.look(optics.map_or(gaze, |optics| on_screen(optics, eye, [extent, screen], gaze)), view, screen)
    };
    let views: Vec<layout::View> = Eye::of_rig(config.buffers.views).map(view).collect();
    let mut frame = layout::Frame {
        camera: layout::Camera {
            views: [views[0], views[views.len() - 1]],
            centre: config.centre(index, samples),
            width,
            height,
            display_maps: optics.map_or_else(Default::default, |optics| {
                let sizes = [extent, screen];
                if config.buffers.display.is_late() {
                    late_display_maps(optics, sizes, [&rig, &later])
                } else {
                    display_maps(optics, sizes)
                }
            }),
        },
        sampling: layout::Sampling {
            index,
            seed,
            samples,
            reflections: quality.bounces.max(1),
            indirect_clamp: config.indirect_clamp,
            sampled_fraction: (quality.scale * quality.scale) as f32,
            // If frames keep a history, the sampling mask changes, so that it covers every pixel over several frames.
            mask_turn: if config.keeps_history() { index.wrapping_mul(GOLDEN_RATIO) } else { 0 },
            ..Default::default()
        },
        foveation: layout::Foveation { layer_iterations: quality.iterations().into(), ..layers.unwrap_or_default() },
        history: layout::History::new(None, 0..0),
        display: layout::Display {
            exposure: params.exposure_ev.exp2(),
            tone: config.tone as u32,
            storage_scale: config.exposure_ev.round().exp2(),
            ..Default::default()
        },
        ..Default::default()
    };
    tables.describe(&mut frame);
    (frame, views)
}

/// Returns the constants of each view. The entries of `views` are a view of this and of the previous frame. In the
/// constants of a view, the first camera is that of its source, and the second one its own; it has random numbers of its
/// own. Another set for each view follows, in which the first camera is that of its partner. Two eyes share one set of
/// constants.
pub fn of_views(
    frame: &layout::Frame,
    previous: &layout::Previous,
    views: &[[layout::View; 2]],
    sources: usize,
) -> Vec<(layout::Frame, layout::Previous)> {
    if views.len() == 2 {
        return vec![(*frame, *previous)];
    }
    let of_view = |(eye, other): (Eye, Eye)| {
        let (mut frame, mut previous) = (*frame, *previous);
        let shown = [other, eye].map(|eye| views[eye.index()]);
        frame.camera.views = shown.map(|[now, _]| now);
        previous.views = shown.map(|[_, before]| before);
        let key = (eye.index() as u32).wrapping_sub(eye.main().index() as u32).wrapping_mul(GOLDEN_RATIO);
        frame.sampling.seed = frame.sampling.seed.wrapping_add(key);
        previous.sampling.seed = previous.sampling.seed.wrapping_add(key);
        (frame, previous)
    };
    let eyes = Eye::of_rig(views.len()).map(|eye| eye.among(sources));
    let with_sources = eyes.clone().map(|eye| (eye, eye.source()));
    with_sources.chain(eyes.map(|eye| (eye, eye.partner().unwrap_or(eye.source())))).map(of_view).collect()
}

/// Maps a point of an eye's displayed image to the shared projection. Points are fractions of their image's size.
fn on_screen(optics: &Optics, eye: Eye, [shown, rectified]: [Extent; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    let sides = |extent: Extent| [f64::from(extent.width), f64::from(extent.height)];
    let ([width, height], [columns, rows]) = (sides(shown), sides(rectified));
    let ([x, y], _) = optics.rectified_point(eye, [shown, rectified], [x * width, y * height]);
    [x / columns, y / rows]
}

/// Returns each eye's mapping from its displayed image of `size` to its rectified image of `grid`.
fn display_maps(optics: &Optics, [size, grid]: [Extent; 2]) -> [layout::DisplayMap; 2] {
    Eye::BOTH.map(|eye| display_map(optics.homography(eye, size, grid), DVec3::ZERO))
}

/// Returns each eye's mapping from the image displayed at the pose of the second rig to the rectified image rendered at
/// the first. Each rig has one key. `sizes` are the extents of the displayed and the rectified image.
pub fn late_display_maps(optics: &Optics, sizes: [Extent; 2], rigs: [&Rig; 2]) -> [layout::DisplayMap; 2] {
    Eye::BOTH.map(|eye| {
        let (columns, moved) = optics.later_homography(eye, sizes, rigs);
        display_map(columns, moved)
    })
}

fn display_map(columns: DMat3, moved: DVec3) -> layout::DisplayMap {
    let [across, down, corner] = [columns.x_axis, columns.y_axis, columns.z_axis].map(|column| column.as_vec3());
    layout::DisplayMap { across, down, corner, moved: moved.as_vec3(), ..Default::default() }
}

/// The fractional part of the golden ratio, times 2^32.
const GOLDEN_RATIO: u32 = 0x9e37_79b9;
