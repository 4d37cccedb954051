"""Measures diptych alone. Each function that measures yields names of tables and the tables."""

import csv
import hashlib
import json
import statistics
import sys
from pathlib import Path

FRAMES, COLD, FPS = 16, 4, 72
INSTANT = (FRAMES - 1) / FPS
WITH_HISTORY, WITHOUT_HISTORY = f"{FRAMES}th frame of a path, with history", "first frame, no history"
DENOISING = ("accumulate", "variance", "svgf")
BUILT_IN = ("cornell", "atrium", "gallery", "studio", "towers")


def say(text):
    print(text, file=sys.stderr, flush=True)


def column(key, title, decimals=None, percent=False):
    """Text without `decimals`; with `percent` a fraction that is shown as such."""
    return {"key": key, "title": title} | ({} if decimals is None else {"decimals": decimals, "percent": percent})


def shots(options, names):
    """Pairs of a name and the shot that `render` takes, and a sentence about the shots that are absent."""
    files = {name: f"builtin:{name}" if name in BUILT_IN else options.scenes / f"{name}.toml" for name in names}
    here = [(name, shot) for name, shot in files.items() if name in BUILT_IN or shot.is_file()]
    absent = [name for name in names if name not in dict(here)]
    return here, [f"{', '.join(absent)} (scene files that are not in the repository)"] if absent else []


def reference(driver, options, name, shot):
    """The folder of a reference, which is kept for later runs of this program."""
    key = hashlib.sha256(Path(driver.program).read_bytes())
    key.update(Path(shot).read_bytes() if name not in BUILT_IN else b"")
    folder = options.out / f"reference-{name}-{options.size}-{options.reference_spp}-{key.hexdigest()[:16]}"
    if not (folder / "run.json").exists():
        at = ("--time", INSTANT, "--size", options.size)
        driver.run("render", shot, *at, "--reference", "--spp", options.reference_spp, out=folder)
    return folder


def measure_flip(options, drivers):
    driver, rows = drivers[0], []
    here, absent = shots(options, ("cornell", "atrium", "garage", "hotel-room", "ww2-cityscene"))
    for name, shot in here:
        say(f"flip: {name}")
        right = reference(driver, options, name, shot)

        def judged(images, *args):
            """Means over both eyes of FLIP and of the mean ratio."""
            driver.run("render", shot, "--size", options.size, "--spp", 1, *args)
            pairs = [(right / f"{eye}.exr", driver.out / f"{eye}{images}.exr") for eye in ("left", "right")]
            eyes = [json.loads(driver.program_says("compare", *pair, "--json")) for pair in pairs]
            return [statistics.fmean(eye[measure] for eye in eyes) for measure in ("flip", "mean_ratio")]

        first = ("--time", INSTANT, "--warm-up", 0)
        row = {"scene": name, "atrous": judged("", *first, "--denoiser", "atrous")[0], "first": judged("", *first)[0]}
        row["last"], row["mean_ratio"] = judged(f".{FRAMES - 1:04}", "--frames", FRAMES, "--fps", FPS)
        stages = driver.report()["frames"][-1]["stages"]
        busy_ms = sum(stage["busy_ms"] for stage in stages)
        row["denoising"] = sum(stage["busy_ms"] for stage in stages if stage["stage"] in DENOISING) / busy_ms
        rows.append(row)
    yield "flip", {
        "title": "FLIP of one sample per pixel",
        "readme": None,
        "note": f"FLIP (0 is best) at {options.size} per eye and 1 sample per pixel, at one instant, against a "
        f"reference of {options.reference_spp} samples; means of both eyes. The mean ratio and the denoiser's percentage "
        f"of the time of all stages are those of the {FRAMES}th frame.",
        "columns": [
            column("scene", "scene"),
            column("atrous", "`atrous`, each frame alone", 3),
            column("first", f"`svgf`, {WITHOUT_HISTORY}", 3),
            column("last", f"`svgf`, {WITH_HISTORY}", 3),
            column("mean_ratio", "mean ratio", 3),
            column("denoising", "denoiser", 0, percent=True),
        ],
        "rows": rows,
        "absent": absent,
    }


def measure_play(options, drivers):
    rows = []
    here, absent = shots(options, ("garage", "hotel-room", "atrium"))
    for name, shot in here:
        for driver in drivers:
            runs = []
            for number in range(options.plays):
                say(f"play: {name}, {driver.name}, run {number + 1} of {options.plays}")
                devices = ("--virtual", 2, "--threads-per-device", 1, "--fit")
                driver.run("play", shot, *devices, "--frames", options.play_frames, "--budget-ms", "11..20")
                report = driver.report()
                runs.append(report["play"] | {"size": report["settings"]["size"]})
            runs.sort(key=lambda play: play["in_band_share"])
            median = runs[(len(runs) - 1) // 2]
            copied = ("size", "judged_frames", "in_band_share", "missed_fraction", "makespan_ms_p50", "makespan_ms_p99")
            row = {"scene": name, "driver": driver.name} | {key: median[key] for key in copied}
            rows.append(row | {"least": runs[0]["in_band_share"], "most": runs[-1]["in_band_share"]})
    yield "play", {
        "title": "Frames within a budget of 11 to 20 ms",
        "readme": {
            "rows": {"driver": [drivers[0].name]},
            "columns": ["scene", "size", "in_band_share", "least", "missed_fraction", "makespan_ms_p50", "makespan_ms_p99"],
            "note": f"Two devices on {drivers[0].name}, {options.plays} runs.",
        },
        "note": f"`play --virtual 2 --threads-per-device 1 --fit --budget-ms 11..20 --frames {options.play_frames}`: "
        f"of {options.plays} runs, the one with the median percentage of frames within the budget; least and most are "
        "those of all runs. Frames in which the controller settles do not count.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("size", "size of each eye"),
            column("in_band_share", "frames within budget", 1, percent=True),
            column("least", "least", 1, percent=True),
            column("most", "most", 1, percent=True),
            column("missed_fraction", "display periods missed", 1, percent=True),
            column("makespan_ms_p50", "median, ms", 1),
            column("makespan_ms_p99", "99th percentile, ms", 1),
            column("judged_frames", "frames", 0),
        ],
        "rows": rows,
        "absent": absent,
    }


def number(text):
    return float(text) if text else None


def measure_scale(options, drivers):
    rows = []
    here, absent = shots(options, ("atrium", "gallery", "hotel-room"))
    for name, shot in here:
        for driver in drivers:
            say(f"scale: {name}, {driver.name}")
            counts = ("--counts", "1,2", "--simulate", "2,4,8", "--threads-per-device", 1)
            driver.run("scale", shot, "--size", options.scale_size, *counts)
            for file in ("scale.csv", "simulate.csv"):
                with open(driver.out / file, encoding="utf-8") as lines:
                    for read in csv.DictReader(lines):
                        if file == "simulate.csv" and read["devices"] == "1":
                            continue
                        row = {"scene": name, "driver": driver.name, "source": "measured", "devices": int(read["devices"])}
                        row |= {key: number(read[key]) for key in ("speedup", "efficiency")} | {"limit": read["limit"] or None}
                        if file == "scale.csv":
                            measured = ("makespan_ms", "speedup_low", "speedup_high")
                            row |= {key: number(read[key]) for key in measured}
                        else:
                            row |= {"source": "simulated", "makespan_ms": number(read["predicted_ms"])}
                            row["off"] = number(read["predicted_off"])
                        rows.append(row)
    yield "scale", {
        "title": "Speed-up over device counts",
        "readme": {
            "rows": {"driver": [drivers[0].name], "scene": ["atrium", "gallery"], "devices": [2, 4, 8]},
            "columns": ["scene", "source", "devices", "speedup", "speedup_low", "speedup_high", "limit", "off"],
            "note": f"{options.scale_size} per eye, {drivers[0].name}, 95 % intervals; simulations are off by that much.",
        },
        "note": f"{options.scale_size} per eye, 1 sample per pixel, devices of one thread; speed-up over one device, with its "
        "95 % interval over turns. Simulations know the costs that were measured on two devices; those of two are off by "
        "the given percentage.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("source", ""),
            column("devices", "devices", 0),
            column("makespan_ms", "frame, ms", 0),
            column("speedup", "speed-up", 2),
            column("speedup_low", "from", 2),
            column("speedup_high", "to", 2),
            column("efficiency", "efficiency", 2),
            column("limit", "limit"),
            column("off", "off by", 1, percent=True),
        ],
        "rows": rows,
        "absent": absent,
    }


def measure_drivers(options, drivers):
    rows = []
    here, absent = shots(options, ("garage", "hotel-room", "atrium"))
    for name, shot in here:
        medians = [[] for _ in drivers]
        for number in range(options.turns):
            for driver, taken in zip(drivers, medians):
                say(f"drivers: {name}, {driver.name}, turn {number + 1} of {options.turns}")
                settings = ("--size", options.size, "--spp", 1, "--frames", COLD + FRAMES, "--fps", FPS)
                driver.run("render", shot, *settings)
                taken.append(statistics.median(frame["makespan_ms"] for frame in driver.report()["frames"][COLD:]))
        base = statistics.fmean(medians[0])
        for driver, taken in zip(drivers, medians):
            ms = statistics.fmean(taken)
            times = {"ms": ms, "least": min(taken), "most": max(taken), "times": base / ms}
            rows.append({"scene": name, "driver": driver.name} | times)
    yield "drivers", {
        "title": "Frame times by driver",
        "readme": None,
        "note": f"{options.size} per eye, 1 sample per pixel, one device; mean over {options.turns} interleaved "
        f"turns of the median of {FRAMES} warm frames; least and most are those of the two medians.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("ms", "frame, ms", 0),
            column("least", "least", 0),
            column("most", "most", 0),
            column("times", "speed-up over the first driver", 2),
        ],
        "rows": rows,
        "absent": absent,
    }
