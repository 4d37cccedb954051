//! Leria et al. 2024, "Interactive Multi-GPU Light Field Path Tracing Using Multi-Source Spatial Reprojection": a row of
//! views on several devices, reprojected from one or several sources.

use super::arrangement::Arrangement;
use super::columns::Column;
use super::definition::{Camera, Size, Study, ViewRow};
use super::leria::DENOISING;

const REPROJECTION: &[&str] = &["reproject", "reproject_filtered"];

pub const STUDY: Study = Study {
    name: "leria-lightfield",
    title: "Light fields on several devices, after Leria et al.",
    tables: &[
        [
            "Makespan",
            "Baseline: path tracing of the source on all devices, all other stages on the primary, as in the study leria. \
             One device, one source, several sources (three; in the paper four): every stage on all of these devices. \
             Traced: every view is path traced. Sequences of frames along the path take turns. all s: median makespan of \
             a sequence. frame ms: that of a frame. speed-up: over the baseline. over one: over one device; medians of \
             three sequences. \
             FLIP: mean over views of the last frame against that of traced; noise is a part of it. Simulated: one frame \
             on a virtual clock with the costs measured on all devices, also for one device.",
        ],
        [
            "Stages",
            "Time per frame in ms, all views: mean over the devices that run the stage, median over frames. Denoising \
             is the time per view.",
        ],
    ],
    source: "Leria, Mäkitalo, Jääskeläinen, Sjöström & Zhang 2024, abstract: four RTX A6000, one source view on each, \
             least and most of four scenes. Speed-ups are over earlier pipelines on several GPUs, for 100x1 views of \
             768x432. Frames per second are of all light fields.",
    unlike: &[
        ["100x1 views of 768x432", "--views 100 --fraction 1"],
        ["two light fields of 6x6 views, one for each eye", "cameras above each other; diptych's are in a row"],
        ["its four scenes", "their files: --shots FILE"],
        ["four GPUs, one source on each", "GPUs; --simulate predicts four devices, which share the rows of all views"],
        ["earlier pipelines", "their programs; the baseline is that of the study leria"],
        [
            "DaSH (Leria et al. 2026), hole filling 1.8 times as fast on average",
            "subsampled holes; share_holes traces those that views share once",
        ],
    ],
    shots: &[["builtin:atrium", "its four scenes"]],
    sizes: &[Size { name: "432p", width: 768, height: 432, layer_radii_px: None }],
    views: Some(ViewRow { count: 8, baseline_m: 0.005 }),
    cameras: &[Camera::Following],
    frames: 8,
    gazes_ahead: false,
    arrangements: &[
        Arrangement { distributes: Some(&["path_trace"]), ..Arrangement::new("baseline", &[]) },
        Arrangement { devices: Some(1), ..Arrangement::new("one device", &[]) },
        Arrangement::new("one source", &[]),
        Arrangement::new("several sources", &[("sources", "3")]),
        Arrangement::new("traced", &[("reproject", "off")]),
    ],
    columns: &[
        Column::new("views", "views", 0, |c| c.other("views")),
        Column::new("frames", "frames", 0, |c| c.other("frames")),
        Column::new("total_s", "all s", 3, |c| c.other("total_s")),
        Column::new("frames_per_s", "frames/s", 2, |c| Some(c.other("frames")? / c.other("total_s")?)),
        Column::new("time_ms", "frame ms", 1, |c| c.time_ms()),
        Column::new("speedup", "speed-up", 2, |c| c.other("speedup")),
        Column::new("over_one", "over one", 2, |c| c.other("over_one")),
        Column::new("flip_traced", "FLIP", 4, |c| c.other("flip_traced")),
        Column::new("path_tracing_ms", "path tracing", 2, |c| c.mean_of_devices_ms(&["path_trace"])).in_table(1),
        Column::new("gbuffer_ms", "G-buffer", 2, |c| c.mean_of_devices_ms(&["gbuffer"])).in_table(1),
        Column::new("reprojection_ms", "reprojection", 2, |c| c.mean_of_devices_ms(REPROJECTION)).in_table(1),
        Column::new("shared_holes_ms", "shared holes", 2, |c| c.mean_of_devices_ms(&["share_holes"])).in_table(1),
        Column::new("hole_filling_ms", "hole filling", 2, |c| c.mean_of_devices_ms(&["hole_fill"])).in_table(1),
        Column::new("denoising_ms", "denoising", 2, |c| Some(c.mean_of_devices_ms(DENOISING)? / c.other("views")?))
            .in_table(1),
    ],
};
