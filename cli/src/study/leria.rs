//! Leria, Mäkitalo & Jääskeläinen 2024, "Real-time Stereoscopic Image-parallel Path Tracing": distributing every stage
//! over the devices, against a baseline that distributes path tracing alone.

use super::arrangement::Arrangement;
use super::columns::Column;
use super::definition::{Camera, Size, Study};

/// Stages that the paper's denoising stands for: from accumulation to TAA and tonemapping, and the tallies.
pub const DENOISING: &[&str] = &[
    "select",
    "accumulate",
    "gradient",
    "gradient_smooth",
    "variance",
    "svgf",
    "seam_filter",
    "compose",
    "resolve",
    "to_screen",
    "tally",
];

pub const STUDY: Study = Study {
    name: "leria",
    title: "Distributed stages, after Leria et al.",
    tables: &[
        [
            "Makespan",
            "Baseline: path tracing on all devices, all other stages on the primary. Proposed: every stage on all \
             devices. Sequences of frames along the path take turns, with two frames in flight as published. all s: \
             median makespan of a sequence. frame ms: median makespan of a frame, which overlaps with the next one. \
             speed-up: the baseline's makespan of the sequence over that of the arrangement, median, least and most of \
             three. busy: time in stages over a frame's makespan, median over frames. Simulated: one frame on a virtual \
             clock with the costs measured in the proposed arrangement.",
        ],
        [
            "Stages",
            "Time per frame in ms, both eyes: mean over the devices that run the stage, median over frames. Denoising \
             includes recording the previous frame. Sending and receiving: host time in transfers, which other work may \
             hide. Cited: the baseline's times are those of the primary, except for path tracing and sending.",
        ],
    ],
    source: "Leria, Mäkitalo & Jääskeläinen 2024, several GPUs, 1280x720 per eye, 1 sample, 6 bounces, SVGF; times of \
             about 104 frames, and speed-ups computed from them, 2.25 on average; times of stages from the table \
             'Performance per stage'.",
    unlike: &[
        ["San Miguel, Sponza, Bistro Exterior", "their files: --shots A,B,C"],
        ["four GPUs", "GPUs; --simulate predicts four devices from measured costs"],
        ["G-buffer by rasterisation", "a rasteriser; diptych traces primary rays"],
        ["scene update, record previous buffer, stitching, blit", "stages of their own; here they are part of others"],
        ["control loop, 11 to 20 ms", "`play --budget-ms 11..20 --set controller=diptych,pinned:0`"],
    ],
    shots: &[["builtin:gallery", "San Miguel"], ["builtin:atrium", "Sponza"], ["builtin:towers", "Bistro Exterior"]],
    sizes: &[Size { name: "720p", width: 1280, height: 720, layer_radii_px: None }],
    views: None,
    cameras: &[Camera::Following],
    frames: 104,
    gazes_ahead: false,
    arrangements: &[
        Arrangement { distributes: Some(&["path_trace"]), ..Arrangement::new("baseline", &[]) },
        Arrangement::new("proposed", &[]),
    ],
    columns: &[
        Column::new("frames", "frames", 0, |c| c.other("frames")),
        Column::new("total_s", "all s", 3, |c| c.other("total_s")),
        Column::new("time_ms", "frame ms", 1, |c| c.time_ms()),
        Column::new("time_ms_iqr", "iqr ms", 1, |c| c.range_ms()),
        Column::new("speedup", "speed-up", 2, |c| c.other("speedup")),
        Column::new("speedup_least", "least", 2, |c| c.other("speedup_least")),
        Column::new("speedup_most", "most", 2, |c| c.other("speedup_most")),
        Column::new("primary_busy_share", "primary busy %", 0, |c| c.busy(0)).percent(),
        Column::new("others_busy_share", "others busy %", 0, |c| c.busy(1)).percent(),
        Column::new("skinning_ms", "skinning", 3, |c| c.mean_of_devices_ms(&["skin", "refit"])).in_table(1),
        Column::new("path_tracing_ms", "path tracing", 2, |c| c.mean_of_devices_ms(&["path_trace"])).in_table(1),
        Column::new("gbuffer_ms", "G-buffer", 2, |c| c.mean_of_devices_ms(&["gbuffer", "motion"])).in_table(1),
        Column::new("reprojection_ms", "reprojection", 2, |c| c.mean_of_devices_ms(&["reproject"])).in_table(1),
        Column::new("hole_filling_ms", "hole filling", 2, |c| c.mean_of_devices_ms(&["hole_fill"])).in_table(1),
        Column::new("denoising_ms", "denoising", 2, |c| c.mean_of_devices_ms(DENOISING)).in_table(1),
        Column::new("tonemapping_ms", "tonemapping", 2, |c| c.mean_of_devices_ms(&["tonemap"])).in_table(1),
        Column::new("sending_ms", "sending", 2, |c| c.mean_of_devices_ms(&["download"])).in_table(1),
        Column::new("receiving_ms", "receiving", 2, |c| c.mean_of_devices_ms(&["upload"])).in_table(1),
    ],
};
