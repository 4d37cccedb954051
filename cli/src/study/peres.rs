//! Peres 2022, "Non-homogeneous denoising for virtual reality in real-time path tracing rendering" (master's thesis,
//! Niterói): foveated sampling and denoising in two and three layers against none (tables 4 and 5).

use super::arrangement::Arrangement;
use super::columns::Column;
use super::definition::{Camera, Size, Study};

pub const STUDY: Study = Study {
    name: "peres",
    title: "Foveated layers after Peres",
    tables: &[
        [
            "Time (table 4)",
            "Median makespan of warm frames at instants along the path, both eyes, and its interquartile range; the \
             speed-up is relative to Base, with its 95 % interval. Base: 4 samples and 5 iterations for every pixel. NH2LD \
             and NH3LD: on average 4, 3 and 2 samples per pixel in the inner, middle and outer layer, with 3, 5 and 5 or \
             2, 3 and 5 iterations.",
        ],
        [
            "Quality (table 5)",
            "Mean and standard deviation over instants along the path, for both eyes and all frames of each. The reference \
             has many samples and no denoiser; both are tonemapped at the shot's exposure. RMSE is a percentage of the \
             display range, so PSNR = -20 log10(RMSE / 100 %) at each instant.",
        ],
    ],
    source: "Peres 2022; times from table 4, the mean GPU time of 1000 frames along a path on a GeForce RTX 2080 at full \
             resolution; errors from table 5, which does not state its resolution or the quantity of its RMSE: its PSNR is \
             1.0 (Pink Room, Base) to 6.1 dB (Forest, Base) below the formula of ours. Scenes and renderers differ, so \
             compare the configurations of one scene, not the columns.",
    unlike: &[
        ["Pink Room, Sponza, Forest", "their files: --shots A,B,C"],
        ["Lambertian materials only", "scenes without specular materials; these have some"],
        ["reprojected accumulation over frames", "nothing; the thesis filters single frames too"],
        ["a GeForce RTX 2080", "a GPU"],
    ],
    shots: &[["builtin:gallery", "Pink Room"], ["builtin:atrium", "Sponza"], ["builtin:forest", "Forest"]],
    // Radii from table 2.
    sizes: &[
        Size { name: "FHD", width: 960, height: 1080, layer_radii_px: Some([144.0, 288.0]) },
        Size { name: "Quest 2", width: 1832, height: 1920, layer_radii_px: Some([265.0, 530.0]) },
    ],
    views: None,
    cameras: &[Camera::Stepping],
    frames: 16,
    gazes_ahead: false,
    arrangements: &[
        Arrangement::new("Base", &[]),
        Arrangement::new("NH2LD", &[("foveation", "layers"), ("iterations", "3,5,5")]),
        Arrangement::new("NH3LD", &[("foveation", "layers"), ("iterations", "2,3,5")]),
    ],
    columns: &[
        Column::new("time_ms", "ms", 2, |c| c.time_ms()),
        Column::new("time_ms_iqr", "iqr ms", 2, |c| c.range_ms()),
        Column::new("speedup", "speed-up", 2, |c| c.speedup()),
        Column::new("speedup_low", "95 %, from", 2, |c| c.speedup_end(0)),
        Column::new("speedup_high", "to", 2, |c| c.speedup_end(1)),
        Column::new("exposure_ev", "", 2, |c| c.other("exposure_ev")),
        Column::new("rmse_percent", "rmse %", 3, |c| c.rmse_percent()).in_table(1),
        Column::new("ssim", "ssim", 4, |c| c.error("ssim")).in_table(1),
        Column::new("ssim_deviation", "±", 4, |c| c.error_deviation("ssim")).in_table(1),
        Column::new("psnr", "psnr dB", 2, |c| c.error("psnr")).in_table(1),
        Column::new("psnr_deviation", "±", 2, |c| c.error_deviation("psnr")).in_table(1),
    ],
};
