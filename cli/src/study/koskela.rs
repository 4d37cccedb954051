//! Koskela et al. 2019, "Foveated Real-Time Path Tracing in Visual-Polar Space": visual-polar images against every pixel
//! of the screen and against other distributions of as many samples.

use super::arrangement::{Arrangement, sample_as_visual_polar};
use super::columns::Column;
use super::definition::{Camera, Size, Study};

const PATHS: &[&str] = &["path_trace", "hole_fill"];
/// Accumulation and the regression, or the iterations of svgf.
const FILTER: &[&str] = &["accumulate", "fit", "accumulate_fitted", "variance", "svgf"];

pub const STUDY: Study = Study {
    name: "koskela",
    title: "Visual-polar images after Koskela et al.",
    tables: &[
        [
            "Visual-polar, and as many samples elsewhere",
            "1 sample per sampled pixel, 1 indirect bounce, bmfr everywhere; the camera follows its path and stops. The \
             arrangements take turns frame by frame. full: every pixel of the screen. uniform: a render scale with as many \
             samples as visual-polar. linear: every pixel within 10 degrees of the gaze; further out, the probability \
             falls linearly to a floor at 20 degrees, chosen for the same number of samples. log-polar: kernel exponent 4, \
             the aspect ratio of the screen, no full-resolution area, and σ chosen for the same number of traced pixels. \
             paths: pixels that start paths over pixels of the screen, with those at silhouettes, which are always \
             traced. path: path tracing and hole filling; its speed-up over full, with the 95 % interval of the frame's. \
             filter: accumulation and regression. map, blur: resampling the polar image to the screen. Stage times are \
             medians of the sum over all devices.",
        ],
        [
            "Errors",
            "FLIP, also weighted by the acuity of visual-polar space and by Geisler & Perry's, and flicker are for a static \
             gaze, means of both eyes. The fovea's are for pixels within 5 degrees of the gaze while it moves at 15 degrees \
             per second; flicker compares consecutive frames.",
        ],
    ],
    source: "Koskela et al. 2019, section 5, on a Vega Frontier Edition, one eye of 1280x1440, BMFR; their map is 0.2 ms of \
             mipmaps and 0.6 ms of mapping. Their linear falloff has a floor of 20 % and 1.5 times the samples of \
             visual-polar. Their viewers saw more artefacts in the fovea with uniform (p = 8.2e-7) and linear samples \
             (p = 0.0023) than with visual-polar ones, and more distracting artefacts with log-polar ones (p = 0.0059), \
             whose σ was 1.8.",
    unlike: &[
        ["one eye", "a frame of one view; paths_left and the shares of stages compare"],
        ["reductions of 71 and 88 %", "a scale of visual-polar space; diptych has the 61 % of the second user study"],
        ["coherence: random starting points, random kill", "kernels that shuffle or kill paths"],
        ["user studies", "viewers and a headset with eye tracking"],
        ["a Vega Frontier Edition", "a GPU"],
    ],
    shots: &[["builtin:atrium", "the paper's scenes"]],
    sizes: &[Size { name: "FOVE", width: 1280, height: 1440, layer_radii_px: None }],
    views: None,
    cameras: &[Camera::Approaching],
    frames: 0,
    gazes_ahead: false,
    arrangements: &[
        Arrangement::new("full", &[]),
        Arrangement::new("uniform", &[]).adapt(sample_as_visual_polar),
        Arrangement::new("linear", &[("foveation", "layers")]).adapt(sample_as_visual_polar),
        Arrangement::new("visual-polar", &[("foveation", "visual-polar")]),
        Arrangement::new("log-polar", &[("foveation", "log-polar")]).adapt(sample_as_visual_polar),
    ],
    columns: &[
        Column::new("floor", "floor %", 1, |c| c.other("floor")).percent(),
        Column::new("sigma", "σ", 3, |c| c.other("sigma")),
        Column::new("paths_left", "paths, left %", 1, |c| c.other("paths_left")).percent(),
        Column::new("paths_right", "right %", 1, |c| c.other("paths_right")).percent(),
        Column::new("time_ms", "frame ms", 1, |c| c.time_ms()),
        Column::new("speedup", "speed-up", 2, |c| c.speedup()),
        Column::new("speedup_low", "95 %, from", 2, |c| c.speedup_end(0)),
        Column::new("speedup_high", "to", 2, |c| c.speedup_end(1)),
        Column::new("path_ms", "path ms", 2, |c| c.stages_ms(PATHS)),
        Column::new("path_speedup", "path's speed-up", 2, |c| c.stages_speedup(PATHS)),
        Column::new("filter_ms", "filter ms", 2, |c| c.stages_ms(FILTER)),
        Column::new("map_ms", "map ms", 2, |c| c.stages_ms(&["to_screen"])),
        Column::new("blur_ms", "blur ms", 2, |c| c.stages_ms(&["polar_blur"])),
        Column::new("flip", "FLIP", 4, |c| c.error("flip")).in_table(1),
        Column::new("flip_acuity", "by acuity", 4, |c| c.error("flip_acuity")).in_table(1),
        Column::new("flip_foveated", "foveated", 4, |c| c.error("flip_foveated")).in_table(1),
        Column::new("flicker", "flicker", 5, |c| c.error("flicker")).in_table(1),
        Column::new("fovea_flip", "fovea's FLIP", 4, |c| c.other("fovea_flip")).in_table(1),
        Column::new("fovea_flicker", "fovea's flicker", 5, |c| c.other("fovea_flicker")).in_table(1),
    ],
};
