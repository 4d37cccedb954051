"""Measures diptych beside Mitsuba 3 with OIDN, by docs/results/peers/measure.py, and updates NAME.* beside it."""

import json
import os
import re
import shlex
import shutil
import subprocess

from chart import chart
from driver import ROOT
from tables import FRAMES, WITH_HISTORY, WITHOUT_HISTORY, column, shots

# Mitsuba renders this shot's materials brighter than the file says. One reference for both would compare materials.
OWN_REFERENCE = ("hotel-room",)


def measure_peers(options, drivers):
    """Runs docs/results/peers/measure.py, and updates NAME.* beside it."""
    compared, undenoised, out = [], [], options.out / "peers"
    here, absent = shots(options, ("cornell", "atrium", "hotel-room"))
    # A folder that is also visible to commands that run another driver.
    scratch = options.out / "scratch"
    scratch.mkdir(parents=True, exist_ok=True)
    for name, shot in here:
        sections = []
        settings = ["--size", options.size, "--reference-spp", options.peers_spp, "--rounds", options.rounds, "--history"]
        settings += ["--out", out, *(["--own-reference"] if name in OWN_REFERENCE else [])]
        for driver in drivers:
            settings += ["--diptych", shlex.join([*driver.command, driver.program])]
        command = [options.peers, ROOT / "docs/results/peers/measure.py", *settings, shot]
        environment = os.environ | {"TMPDIR": str(scratch)}
        subprocess.run(list(map(str, command)), check=True, stdout=subprocess.DEVNULL, cwd=ROOT, env=environment)
        for number, driver in enumerate(drivers, 1):
            files = out / name / (f"{name}-{number}" if number > 1 else name)
            sections.append(re.sub(r"\A## .*", f"## {driver.name}", files.with_suffix(".md").read_text()))
            if driver is drivers[0]:
                shutil.copy(files.with_suffix(".toml"), options.root / f"docs/results/peers/{name}.toml")
            measured = json.loads(files.with_suffix(".json").read_text())
            compared += rows_of(name, driver, measured["beside"])
            bare = {(row["renderer"], row["setting"]): row for row in measured["rows"]}
            theirs, ours = bare["Mitsuba", "4 spp"], bare["diptych", "4 spp, not denoised"]
            pair = {"peer_ms": theirs["ms"], "peer_flip": theirs["flip"], "ms": ours["ms"], "flip": ours["flip"]}
            undenoised.append({"scene": name, "driver": driver.name} | pair | {"times": theirs["ms"] / ours["ms"]})
        write_peer(options, name, sections)
    columns = [
        column("scene", "scene"),
        column("driver", "driver"),
        column("peer", "Mitsuba + OIDN"),
        column("spp", "samples", 0),
        column("flip", "its FLIP", 3),
        column("ms", "its time, ms", 0),
        column("with_history", WITH_HISTORY, 1),
        column("without_history", WITHOUT_HISTORY, 1),
        column("flip_of_history", "its FLIP with history", 3),
        column("both_histories", "both with history", 1),
    ]
    note = (
        f"{options.size} per eye, {options.rounds} interleaved rounds, a reference of {options.peers_spp} samples. Two "
        "columns are the speed-up of diptych's fastest setting that reaches this FLIP, for each kind of frame. In the last "
        f"two, OIDN filters the mean of Mitsuba's last {FRAMES} frames, reprojected by NumPy, whose time counts (not "
        "measured with 16 samples). Below 1, diptych is slower; – means that no setting reaches this FLIP."
    )
    common = {"note": note, "columns": columns, "absent": absent}
    four = [row for row in compared if row["spp"] == 4]
    title, place = "Time to the FLIP of Mitsuba + OIDN", "## Results"
    yield "peers", {"title": f"{title} with 4 samples", "readme": place, "rows": four} | common
    others = [row for row in compared if row["spp"] != 4]
    yield "peers-more", {"title": f"{title} with 1 and 16 samples", "readme": None, "rows": others} | common
    yield "undenoised", {
        "title": "Four samples without denoising",
        "readme": None,
        "note": f"{options.size} per eye, 4 samples per pixel, times of a stereo frame; both eyes fully traced.",
        "columns": [
            column("scene", "scene"),
            column("driver", "driver"),
            column("peer_ms", "Mitsuba, ms", 0),
            column("peer_flip", "its FLIP", 3),
            column("ms", "diptych, ms", 0),
            column("flip", "its FLIP", 3),
            column("times", "diptych times as fast", 2),
        ],
        "rows": undenoised,
        "absent": absent,
    }


def rows_of(scene, driver, beside):
    """A row of each peer without history, with its figures with history where they were measured."""
    rows = {}
    for row in beside:
        name, _, history = row["renderer"].removeprefix("Mitsuba + OIDN, ").partition(f", {FRAMES} frames")
        speed_up = {key: row[key] and row["ms"] / row[key]["ms"] for key in ("with_history", "without_history")}
        if history:
            rows[name, row["setting"]] |= {"flip_of_history": row["flip"], "both_histories": speed_up["with_history"]}
        else:
            own = {"scene": scene, "driver": driver.name, "peer": name, "spp": int(row["setting"].split()[0])}
            absent = {"flip_of_history": None, "both_histories": None}
            rows[name, row["setting"]] = own | {"ms": row["ms"], "flip": row["flip"]} | speed_up | absent
    return list(rows.values())


def write_peer(options, name, sections):
    """The tables of all drivers below the introduction that docs/results/peers/NAME.md has, and their chart."""
    file = options.root / f"docs/results/peers/{name}.md"
    text = file.read_text().split("\n## ", 1)[0].rstrip("\n") + "\n\n" + "\n".join(sections)
    file.write_text(text)
    title = f"{name}, {options.size}: error against time; beside points, samples per pixel"
    file.with_suffix(".svg").write_text(chart(title, text))
