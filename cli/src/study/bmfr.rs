//! Xu, Tong & Xu, "Real-Time Path Tracing Reconstruction In DXR": two ways to keep the fit of BMFR well conditioned, to
//! leave out linearly dependent features or to add noise to all of them.

use super::arrangement::Arrangement;
use super::columns::Column;
use super::definition::{Camera, Size, Study};

const PATHS: &[&str] = &["path_trace", "hole_fill"];
const FILTER: &[&str] = &["fit", "variance", "svgf"];

pub const STUDY: Study = Study {
    name: "bmfr",
    title: "Dependent features of BMFR",
    tables: &[[
        "Features left out, and noise",
        "1 sample per pixel, 1 indirect bounce; the camera follows its path and stops. bmfr leaves out dependent \
         features; bmfr_noise adds noise to all features. The denoisers take turns frame by frame. frame ms: median, \
         least and most. path: path tracing and hole filling. filter: the regression, or variance and iterations of svgf; \
         median of the sum over all devices, and its fraction of all stages. FLIP against the reference and flicker \
         between frames are means of both eyes.",
    ]],
    source: "Xu, Tong & Xu on a laptop's RTX 2070, one eye; their stage time is that of the regression with noise.",
    unlike: &[
        ["Falcor's default scene", "its file: --shots FILE"],
        ["one eye", "a frame of one view; diptych's frames have two"],
        ["an RTX 2070", "a GPU"],
    ],
    shots: &[["builtin:atrium", "Falcor's default scene"]],
    sizes: &[Size { name: "1080p", width: 1920, height: 1080, layer_radii_px: None }],
    views: None,
    cameras: &[Camera::Approaching],
    frames: 0,
    gazes_ahead: false,
    arrangements: &[
        Arrangement::new("svgf", &[("denoiser", "svgf")]),
        Arrangement::new("bmfr", &[("denoiser", "bmfr")]),
        Arrangement::new("bmfr_noise", &[("denoiser", "bmfr_noise")]),
    ],
    columns: &[
        Column::new("time_ms", "frame ms", 1, |c| c.time_ms()),
        Column::new("time_ms_min", "least", 1, |c| c.least_ms()),
        Column::new("time_ms_max", "most", 1, |c| c.most_ms()),
        Column::new("frames_per_s", "frames/s", 1, |c| c.time_ms().map(|ms| 1e3 / ms)),
        Column::new("path_ms", "path ms", 2, |c| c.stages_ms(PATHS)),
        Column::new("filter_ms", "filter ms", 2, |c| c.stages_ms(FILTER)),
        Column::new("filter_share", "filter %", 1, |c| c.stages_fraction(FILTER)).percent(),
        Column::new("flip", "FLIP", 4, |c| c.error("flip")),
        Column::new("flicker", "flicker", 5, |c| c.error("flicker")),
    ],
};
