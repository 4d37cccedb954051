//! Andersson & Hansson 2020, "Performance Optimizations for Foveated Real-Time Raytracing" (master's thesis, Lund):
//! log-polar images in the thesis's modes against every pixel of the screen, by rings around the gaze.

use super::arrangement::{Arrangement, without_blur};
use super::columns::Column;
use super::definition::{Camera, Size, Study};

/// Returns a mode with the parameters that `polar` names.
const fn mode(name: &'static str, settings: &'static [(&'static str, &'static str)]) -> Arrangement {
    Arrangement::new(name, settings).adapt(without_blur)
}

const LOG_POLAR: (&str, &str) = ("foveation", "log-polar");

pub const STUDY: Study = Study {
    name: "andersson",
    title: "Log-polar images after Andersson & Hansson",
    tables: &[
        [
            "Log-polar, and every pixel of the screen",
            "1 sample per traced pixel, no blur, central gaze. basic: every pixel of the screen; fov: log-polar; kernel: \
             log-polar with a kernel; composite: with every pixel around the gaze, at three values of σ; composite-kernel: \
             both. The modes take turns frame by frame. As published, there is direct light alone, without denoiser and \
             TAA; today, there are 6 bounces, svgf and TAA. dispatched, traced: pixels of the left eye's image, and those \
             that start paths, relative to the screen. frame: median; speed-up: relative to basic, with its 95 % interval. \
             The other times are medians of the sum over all devices and both eyes. still: the camera does not move; \
             moving: frames at instants along its path, each with history from the path before it.",
        ],
        [
            "Errors",
            "Against a converged reference of the same instant, means of both eyes and all frames; the thesis compares with \
             16 noise-free rays per pixel. FLIP is also weighted by the acuity of visual-polar space and by Geisler & \
             Perry's. SSIM is that of the innermost and of the outermost ring; 'to basic' compares with the frames of that \
             mode, whose noise both have.",
        ],
    ],
    source: "Andersson & Hansson 2020, tables 5.2 to 5.4 and chapter 6, on a Titan V, one eye, noise-free rays, with \
             antialiasing where stated; their speed-ups are relative to basic frames without antialiasing. Where they give \
             a range of SSIM, its middle.",
    unlike: &[
        ["Sponza, Bistro", "their files: --shots A,B"],
        ["noise-free shading", "scenes that points and suns without size light"],
        ["TAA without a denoiser", "a denoiser that accumulates alone; today's rows have svgf and TAA"],
        ["Gaussian blur from a sixth of the diagonal", "blur in the errors, which the thesis leaves out as well"],
        ["frustum tracing (chapter 4)", "an acceleration structure that the program may edit"],
        ["a Titan V", "a GPU"],
    ],
    shots: &[["builtin:atrium", "Sponza"], ["builtin:towers", "Bistro"]],
    sizes: &[Size { name: "1080p", width: 1920, height: 1080, layer_radii_px: None }],
    views: None,
    cameras: &[Camera::Still, Camera::Moving],
    frames: 20,
    gazes_ahead: true,
    arrangements: &[
        Arrangement::new("basic", &[]),
        mode("fov", &[LOG_POLAR, ("polar", "fov")]),
        mode("kernel", &[LOG_POLAR, ("polar", "kernel")]),
        mode("composite", &[LOG_POLAR, ("polar", "composite")]),
        mode("composite-1.7", &[LOG_POLAR, ("polar", "1.7,1,0.2,0.33")]),
        mode("composite-2.0", &[LOG_POLAR, ("polar", "2,1,0.2,0.33")]),
        mode("composite-kernel", &[LOG_POLAR, ("polar", "composite-kernel")]),
    ],
    columns: &[
        Column::new("dispatched", "dispatched %", 1, |c| c.other("dispatched")).percent(),
        Column::new("traced", "traced %", 1, |c| c.other("paths_left")).percent(),
        Column::new("time_ms", "frame ms", 2, |c| c.time_ms()),
        Column::new("speedup", "speed-up", 2, |c| c.speedup()),
        Column::new("speedup_low", "95 %, from", 2, |c| c.speedup_end(0)),
        Column::new("speedup_high", "to", 2, |c| c.speedup_end(1)),
        Column::new("gbuffer_ms", "gbuffer ms", 2, |c| c.stages_ms(&["gbuffer", "motion"])),
        Column::new("path_ms", "path ms", 2, |c| c.stages_ms(&["path_trace", "hole_fill"])),
        Column::new("filter_ms", "filter ms", 2, |c| c.stages_ms(&["accumulate", "variance", "svgf", "compose"])),
        Column::new("resolve_ms", "TAA ms", 2, |c| c.stages_ms(&["resolve"])),
        Column::new("map_ms", "map ms", 2, |c| c.stages_ms(&["polar_blur", "to_screen"])),
        Column::new("flip", "FLIP", 4, |c| c.error("flip")).in_table(1),
        Column::new("flip_acuity", "by acuity", 4, |c| c.error("flip_acuity")).in_table(1),
        Column::new("flip_foveated", "foveated", 4, |c| c.error("flip_foveated")).in_table(1),
        Column::new("flicker", "flicker", 5, |c| c.error("flicker")).in_table(1),
        Column::new("ssim_gaze", "SSIM, gaze", 3, |c| c.other("ssim_gaze")).in_table(1),
        Column::new("ssim_edge", "edge", 3, |c| c.other("ssim_edge")).in_table(1),
        Column::new("ssim_basic_gaze", "to basic, gaze", 3, |c| c.other("ssim_basic_gaze")).in_table(1),
        Column::new("ssim_basic_edge", "edge", 3, |c| c.other("ssim_basic_edge")).in_table(1),
    ],
};
