"""Measures starts, of small and large scenes, and the host's own time of a frame."""

import array
import copy
import json
import math
import os
import shutil
import struct
import time

from tables import column, say, shots

# The driver of AMD GPUs on the no-op device of Debian's package mesa-drm-shim: submissions end at once.
ICD = "/usr/share/vulkan/icd.d/radeon_icd.json"
NOOP_GPU = ["env", "LD_PRELOAD=libamdgpu_noop_drm_shim.so", "AMDGPU_GPU_ID=navi31", f"VK_ICD_FILENAMES={ICD}"]
NOOP_GPU += [f"VK_DRIVER_FILES={ICD}"]
HOST_SIZES = ("640x360", "1280x720")


def write_field(file, triangles):
    """Writes a height field of about as many triangles as glTF."""
    side = max(1, round(math.sqrt(triangles / 2)))
    positions, indices = array.array("f"), array.array("I")
    for z in range(side + 1):
        for x in range(side + 1):
            height = 0.02 * math.sin(40 * x / side) * math.cos(31 * z / side)
            positions.extend((x / side - 0.5, height, z / side - 0.5))
    for z in range(side):
        for x in range(side):
            at = z * (side + 1) + x
            indices.extend((at, at + side + 1, at + 1, at + 1, at + side + 1, at + side + 2))
    points, corners = positions.tobytes(), indices.tobytes()
    views = [{"buffer": 0, "byteLength": len(points)}]
    views += [{"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)}]
    accessors = [{"bufferView": 0, "componentType": 5126, "count": len(positions) // 3, "type": "VEC3"}]
    accessors[0] |= {"min": [-0.5, -0.02, -0.5], "max": [0.5, 0.02, 0.5]}
    accessors += [{"bufferView": 1, "componentType": 5125, "count": len(indices), "type": "SCALAR"}]
    scene = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]}
    scene |= {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}], "accessors": accessors}
    scene |= {"bufferViews": views, "buffers": [{"byteLength": len(points) + len(corners)}]}
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    with open(file, "wb") as glb:
        glb.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(points) + len(corners)))
        glb.write(struct.pack("<I4s", len(text), b"JSON") + text)
        glb.write(struct.pack("<I4s", len(points) + len(corners), b"BIN\0") + points + corners)
    return 2 * side * side


def start(driver, shot, caches):
    """Seconds until the end of a process that renders one small frame, and the largest memory that it held, MiB."""
    settings = ("--size", "64x36", "--spp", 1, "--warm-up", 0, "--set", f"scene_cache={caches}/scenes")
    begin = time.monotonic()
    driver.run("render", shot, *settings, caches=caches)
    return time.monotonic() - begin, driver.report()["peak_resident_mib"]


def starts(options, driver, name, shot):
    say(f"starts: {name}, {driver.name}")
    turns = []
    for _ in range(options.turns):
        caches = options.out / "caches"
        shutil.rmtree(caches, ignore_errors=True)
        turns.append((start(driver, shot, caches), start(driver, shot, caches)))
    (first_s, peak_mib), (second_s, _) = min(turns)
    row = {"scene": name, "driver": driver.name, "first_s": first_s, "second_s": second_s}
    return row | {"ratio": second_s / first_s, "peak_mib": peak_mib}


def measure_starts(options, drivers):
    here, absent = shots(options, ("cornell", "atrium", "hotel-room"))
    rows = [starts(options, driver, name, shot) for driver in drivers for name, shot in here]
    smallest = {}
    for triangles in (2, *options.large):
        file = options.out / "field.glb"
        count = write_field(file, triangles)
        for driver in drivers:
            row = starts(options, driver, "height field", file) | {"triangles": count}
            # What a scene costs beyond pipelines and images.
            base = smallest.setdefault(driver.name, row)
            if row is not base:
                row["us"] = (row["first_s"] - base["first_s"]) / count * 1e6
                row["bytes"] = (row["peak_mib"] - base["peak_mib"]) / count * 2**20
            rows.append(row)
        file.unlink()
    yield "starts", {
        "title": "Starts",
        "readme": None,
        "note": "A process that renders one frame of 64x36 pixels and ends: the first with empty caches of trees and "
        f"pipelines, the second with those of the first. Least of {options.turns} turns. Time and memory of a triangle "
        "are those beyond the scene of two triangles.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("triangles", "triangles", 0),
            column("first_s", "first start, s", 2),
            column("second_s", "second, s", 2),
            column("ratio", "second over first", 2),
            column("peak_mib", "peak memory, MiB", 0),
            column("us", "a triangle, µs", 2),
            column("bytes", "a triangle, bytes", 0),
        ],
        "rows": rows,
        "absent": absent,
    }


def host_time(driver, size, devices, frames):
    """CPU and elapsed time of a process that plays these frames, s."""
    settings = ("--size", size, "--virtual", devices, "--budget-ms", "11..20", "--frames", frames)
    settings += ("--set", "keep_going=on", "--set", "max_dispatch_ms=1000000")
    before, begin = os.times(), time.monotonic()
    driver.run("play", "builtin:cornell", *settings, caches=driver.out.parent / "caches")
    after = os.times()
    cpu_s = after.children_user + after.children_system - before.children_user - before.children_system
    return cpu_s, time.monotonic() - begin


def measure_host(options, drivers):
    rows = []
    driver = copy.copy(drivers[-1])
    driver.command = [*driver.command, *NOOP_GPU]
    few, many = options.host_frames
    for size in HOST_SIZES:
        for devices in (1, 2):
            say(f"host: {size}, {devices} devices")
            turns = [[host_time(driver, size, devices, frames) for frames in (few, many)] for _ in range(options.turns)]
            short, long = (map(min, zip(*times)) for times in zip(*turns))
            cpu_ms, ms = (1000 * (after - before) / (many - few) for before, after in zip(short, long))
            rows.append({"size": size, "devices": devices, "cpu_ms": cpu_ms, "ms": ms})
    yield "host", {
        "title": "The host's own time",
        "readme": None,
        "note": "`play builtin:cornell --budget-ms 11..20 --set max_dispatch_ms=1000000` on the driver of an AMD GPU "
        "(RADV, navi31) and a device that executes nothing, so that all time is the host's: difference between runs of "
        f"{few} and {many} frames, each the least of {options.turns} turns.",
        "columns": [
            column("size", "size of each eye"),
            column("devices", "devices", 0),
            column("cpu_ms", "CPU time of a frame, ms", 2),
            column("ms", "elapsed, ms", 2),
        ],
        "rows": rows,
        "absent": [],
    }
