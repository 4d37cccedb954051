"""Measures rows of cameras: what further views cost, and how far they are from traced ones."""

import json
import statistics

from tables import column, say, shots

COUNTS = (2, 4, 8, 16, 48)
# The count with which holes are also measured without sharing.
SHARED = 16
BASELINE_M = 0.005
WARM_UP, FRAMES = 2, 3
HOLES = ("share_holes", "hole_fill")
SAMPLES_OF_REFERENCES = 32
# The views of every row are the middle ones of the longest.
MOST = COUNTS[-1]


def row_of(count):
    return ("--views", count, "--baseline", BASELINE_M)


def stage_times(report):
    """Median time of each stage and view, ms."""
    times = {}
    for frame in report["frames"]:
        for stage in frame["stages"]:
            times.setdefault((stage["view"], stage["stage"]), []).append(stage["busy_ms"])
    return {key: statistics.median(taken) for key, taken in times.items()}


def timed(driver, shot, options, count, *args):
    """Times of one row, ms: of the source, and means over the other views and of their holes."""
    frames = ("--size", options.size, "--spp", 1, "--warm-up", WARM_UP, "--frames", FRAMES, "--fps", 72)
    driver.run("render", shot, *row_of(count), *frames, *args)
    times = stage_times(driver.report())
    source = next(view for view, stage in times if stage == "path_trace")
    others = {view for view, _ in times} - {source}
    total = sum(ms for (view, _), ms in times.items() if view in others) / len(others)
    # The outermost views have no partner, so they share nothing.
    inner = [view for view in others if int(view[4:6]) not in (0, count - 1)] if count > 2 else []
    holes = sum(ms for (view, stage), ms in times.items() if view in inner and stage in HOLES)
    return {
        "source_ms": sum(ms for (view, _), ms in times.items() if view == source),
        "view_ms": total,
        "holes_ms": holes / len(inner) if inner else None,
        "holes": driver.report()["frames"][-1]["hole_fraction"],
    }


def flips(driver, options, name, shot):
    """FLIP of reprojected views over that of traced ones, by count: the mean and the largest of the views."""
    half = "x".join(str(int(side) // 2) for side in options.size.split("x"))
    right = options.out / f"reference-row-{name}"
    driver.run("render", shot, *row_of(MOST), "--size", half, "--reference", "--spp", SAMPLES_OF_REFERENCES, out=right)

    def judged(count, *args):
        driver.run("render", shot, *row_of(count), "--size", half, "--spp", 1, "--warm-up", 3, *args)
        stems = ("left", "right") if count == 2 else [f"view{view:02}" for view in range(count)]
        places = range((MOST - count) // 2, MOST)
        pairs = [(right / f"view{place:02}.exr", driver.out / f"{stem}.exr") for place, stem in zip(places, stems)]
        return [json.loads(driver.program_says("compare", *pair, "--json"))["flip"] for pair in pairs]

    for count in COUNTS:
        say(f"views: {name}, FLIP of {count}")
        ratios = [ours / traced for ours, traced in zip(judged(count), judged(count, "--reproject", "off"))]
        yield count, (statistics.fmean(ratios), max(ratios))


def measure_views(options, drivers):
    rows = []
    here, absent = shots(options, ("atrium", "hotel-room", "gallery"))
    for name, shot in here:
        # Images hardly depend on the driver.
        errors = dict(flips(drivers[-1], options, name, shot))
        for driver in drivers:
            for count in COUNTS:
                say(f"views: {name}, {driver.name}, {count}")
                times = timed(driver, shot, options, count)
                row = {"scene": name, "driver": driver.name, "views": count} | times
                row["cost"] = times["view_ms"] / times["source_ms"]
                row["flip"], row["most_flip"] = errors[count]
                if count == SHARED:
                    row["own_holes_ms"] = timed(driver, shot, options, count, "--set", "share_holes=off")["holes_ms"]
                rows.append(row)
    yield "views", {
        "title": "Rows of cameras",
        "readme": None,
        "note": f"{options.size} per view, 1 sample per pixel, {BASELINE_M * 1000:.0f} mm between neighbours, one source, one "
        "device. Times of all stages, means over the views that are not the source; those of holes are means over inner "
        f"views, which share them with the outermost ones. FLIP of reprojected over that of traced views, both denoised, "
        f"fourth frame at half of this size, against references of {SAMPLES_OF_REFERENCES} samples: mean and largest of "
        "all views.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("views", "views", 0),
            column("source_ms", "source, ms", 0),
            column("view_ms", "further view, ms", 0),
            column("cost", "its cost", 2),
            column("holes", "holes", 1, percent=True),
            column("holes_ms", "holes, ms", 1),
            column("own_holes_ms", "not shared, ms", 1),
            column("flip", "FLIP over traced", 3),
            column("most_flip", "largest", 3),
        ],
        "rows": rows,
        "absent": absent,
    }
