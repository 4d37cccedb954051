"""Measures the control loop beside an oracle: the rung that a measured ladder has for the same budget."""

import csv
import math
import statistics
import tomllib

from tables import column, say, shots

GRID = ("--denoiser", "svgf", "--spp", "1,2,4", "--iterations", "1,3,5", "--bounces", 6, "--render-scale", "0.5,0.7,1")
# An oracle may miss as many display periods as the loop, or this fraction of them.
MISSED = 0.02


def played(driver, shot, options, ladder, budget, controllers):
    """Means over the runs of each controller: fraction of display periods missed, and FLIP."""
    settings = ("--set", f"controller={','.join(controllers)}", "--set", f"runs={options.plays}")
    settings += ("--size", options.loop_size, "--frames", options.loop_frames, "--budget-ms", budget)
    driver.run("play", shot, *settings, *(("--ladder", ladder) if ladder else ()))
    runs = {}
    with open(driver.out / "comparison.csv", encoding="utf-8") as file:
        for run in csv.DictReader(file):
            runs.setdefault(run["controller"], []).append((float(run["missed_fraction"]), float(run["flip"])))
    return {controller: tuple(map(statistics.fmean, zip(*of))) for controller, of in runs.items()}


def measure_loop(options, drivers):
    rows = []
    here, absent = shots(options, ("cornell", "atrium", "hotel-room"))
    bench = options.out / "loop"
    for driver in drivers:
        for name, shot in here:
            say(f"loop: {name}, {driver.name}")
            measured = ("--size", options.loop_size, "--reference-spp", max(16, options.reference_spp // 2))
            driver.run("bench", shot, *GRID, *measured, out=bench)
            ladder = bench / "ladder.toml"
            times = [rung["time_ms"] for rung in tomllib.loads(ladder.read_text())["rung"]]
            # Half of the rungs fit, and a tenth of the time is headroom.
            most = 1.1 * math.sqrt(times[0] * times[-1])
            budget = f"{0.55 * most:.0f}..{most:.0f}"
            pinned = [f"pinned:{rung}" for rung, ms in enumerate(times) if ms <= most] or ["pinned:0"]
            results = played(driver, shot, options, ladder, budget, ["diptych", *pinned])
            missed, flip = results["diptych"]
            in_time = [of for of in map(results.get, pinned) if of[0] <= max(missed, MISSED)]
            oracle = min(in_time or [results[pinned[0]]], key=lambda of: of[1])
            # The comparison needs two controllers.
            built_in = played(driver, shot, options, None, budget, ["diptych", "pinned:0"])["diptych"]
            row = {"scene": name, "driver": driver.name, "budget": budget.replace("..", " to "), "rungs": len(times)}
            row |= {"missed": missed, "flip": flip, "built_in_missed": built_in[0], "built_in_flip": built_in[1]}
            row |= {"oracle_missed": oracle[0], "oracle_flip": oracle[1]}
            rows.append(row | {"over": flip / oracle[1], "built_in_over": built_in[1] / oracle[1]})
    yield "loop", {
        "title": "The control loop beside an oracle",
        "readme": None,
        "note": f"{options.loop_size} per eye, {options.loop_frames} frames, means of {options.plays} runs in turns. The "
        "oracle plays the single rung of the measured ladder with the least FLIP of those that miss at most "
        f"{MISSED * 100:.0f} % of the display periods, or as many as the loop. The loop changes between rungs, and the built-in "
        "ladder has others, so either may have less error than the oracle.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("budget", "budget, ms"),
            column("rungs", "rungs", 0),
            column("missed", "measured ladder: missed", 1, percent=True),
            column("flip", "FLIP", 4),
            column("built_in_missed", "built-in ladder: missed", 1, percent=True),
            column("built_in_flip", "FLIP", 4),
            column("oracle_missed", "oracle: missed", 1, percent=True),
            column("oracle_flip", "FLIP", 4),
            column("over", "measured over oracle", 3),
            column("built_in_over", "built-in over oracle", 3),
        ],
        "rows": rows,
        "absent": absent,
    }
