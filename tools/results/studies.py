"""Measures the studies: experiments of publications, as published and with today's defaults."""

import json

from tables import column, say

LABELS = ("source", "conditions", "scene", "stands_for", "resolution", "camera", "devices", "arrangement")
SPEEDUP = [
    column("time_ms", "frame, ms", 1),
    column("speedup", "speed-up", 2),
    column("speedup_low", "95 %, from", 2),
    column("speedup_high", "to", 2),
]
STUDIES = {
    "leria": (
        "Leria et al. 2024: image-parallel stereo",
        ("--virtual", 2, "--threads-per-device", 1),
        "Makespan of a sequence with two frames in flight as published; the speed-up over the baseline is the median, least "
        "and most of three sequences. Stages: time per frame, both eyes, mean over the devices that run them.",
        [
            column("total_s", "all, s", 3),
            column("speedup", "speed-up", 2),
            column("speedup_least", "least", 2),
            column("speedup_most", "most", 2),
            column("primary_busy_share", "primary busy", 0, percent=True),
            column("others_busy_share", "others busy", 0, percent=True),
            column("path_tracing_ms", "path tracing, ms", 1),
            column("gbuffer_ms", "G-buffer, ms", 1),
            column("reprojection_ms", "reprojection, ms", 2),
            column("hole_filling_ms", "hole filling, ms", 2),
            column("denoising_ms", "denoising, ms", 1),
        ],
    ),
    "leria-lightfield": (
        "Leria et al. 2024: light fields",
        ("--virtual", 2, "--threads-per-device", 1),
        "Eight views 5 mm apart. Baseline: path tracing on all devices, all other stages on the primary. FLIP is against "
        "traced views. Stages: time per frame, all views, mean over the devices that run them; denoising is per view.",
        [
            column("total_s", "all, s", 3),
            column("frames_per_s", "frames/s", 2),
            column("time_ms", "frame, ms", 1),
            column("speedup", "over baseline", 2),
            column("over_one", "over one device", 2),
            column("flip_traced", "FLIP", 4),
            column("path_tracing_ms", "path tracing, ms", 1),
            column("reprojection_ms", "reprojection, ms", 2),
            column("shared_holes_ms", "shared holes, ms", 2),
            column("hole_filling_ms", "hole filling, ms", 2),
            column("denoising_ms", "denoising, ms", 1),
        ],
    ),
    "bmfr": (
        "Xu, Tong & Xu: dependent features of BMFR",
        ("--conditions", "published,today,each"),
        "The filter is the regression, or variance and iterations of svgf. `published+KEY=VALUE` is one departure alone.",
        [
            column("time_ms", "frame, ms", 1),
            column("path_ms", "path, ms", 1),
            column("filter_ms", "filter, ms", 1),
            column("filter_share", "of all stages", 1, percent=True),
            column("flip", "FLIP", 4),
            column("flicker", "flicker", 5),
        ],
    ),
    "koskela": (
        "Koskela et al. 2019: visual-polar space",
        (),
        "Speed-ups are over every pixel of the screen. The fovea's FLIP is within 5 degrees of a moving gaze.",
        [
            column("paths_left", "paths, left", 1, percent=True),
            *SPEEDUP,
            column("path_ms", "path, ms", 1),
            column("path_speedup", "its speed-up", 2),
            column("filter_ms", "filter, ms", 1),
            column("map_ms", "map, ms", 2),
            column("blur_ms", "blur, ms", 2),
            column("flip", "FLIP", 4),
            column("flip_acuity", "by acuity", 4),
            column("fovea_flip", "fovea's FLIP", 4),
        ],
    ),
    "andersson": (
        "Andersson & Hansson 2020: log-polar space",
        (),
        "Speed-ups are over every pixel of the screen (basic). SSIM at the gaze and at the edge is against a converged "
        "reference, then against basic.",
        [
            column("dispatched", "dispatched", 1, percent=True),
            column("traced", "traced", 1, percent=True),
            *SPEEDUP,
            column("flip", "FLIP", 4),
            column("ssim_gaze", "SSIM, gaze", 3),
            column("ssim_edge", "edge", 3),
            column("ssim_basic_gaze", "to basic, gaze", 3),
            column("ssim_basic_edge", "edge", 3),
        ],
    ),
    "peres": (
        "Peres 2022: foveated denoising",
        (),
        "Speed-ups are over Base. RMSE is a percentage of the display range.",
        [*SPEEDUP, column("rmse_percent", "RMSE, %", 2), column("ssim", "SSIM", 4), column("psnr", "PSNR, dB", 2)],
    ),
}


def measure_study(name):
    """The function that measures a study."""
    title, more, note, columns = STUDIES[name]

    def measure(options, drivers):
        driver = drivers[0]
        say(name)
        # Peres has 24 references, several of 230x240 pixels: with all samples they take more than an hour on two cores.
        reference_spp = options.reference_spp // 4 if name == "peres" else options.reference_spp
        arguments = ("--fraction", options.fraction, "--reference-spp", reference_spp, *more)
        if name.startswith("leria"):
            arguments = ("--fraction", options.fraction, *more)
        said = driver.program_says("study", name, *arguments, "--json", "--out", options.out / "study")
        rows = json.loads(said.splitlines()[-1])["rows"]
        keys = [c["key"] for c in columns]
        rows = [row for row in rows if any(row.get(key) is not None for key in keys)]
        labels = [label for label in LABELS if any(row.get(label) for row in rows)]
        kept = [{key: row.get(key) for key in (*labels, *keys)} for row in rows]
        command = " ".join(map(str, ("study", name, *arguments)))
        yield f"study-{name}", {
            "title": title,
            "readme": None,
            "note": f"`diptych {command}`. {note}",
            "columns": [*(column(label, label.replace("_", " ")) for label in labels), *columns],
            "rows": kept,
            "absent": [],
        }

    return measure


MEASUREMENTS = {f"study-{name}": measure_study(name) for name in STUDIES}
