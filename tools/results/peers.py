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

# Mitsuba renders the materials of these shots brighter than the file says. One reference for both would compare them.
OWN_REFERENCE = ("hotel-room", "garage")
OWN = f"In {' and '.join(OWN_REFERENCE)}, each renderer has its own reference, since Mitsuba's materials are brighter."
SHOTS = ("cornell", "atrium", "towers", "hotel-room", "garage", "fox")
RAW = "not denoised"
# Speed-ups over a peer, with the titles of their columns.
COMPARED = (("without_history", "first frame"), ("with_history", "with history"), ("both_histories", "both with"))


def measure_peers(options, drivers):
    """Runs docs/results/peers/measure.py, and updates NAME.* beside it where they exist."""
    measured, out = [], options.out / "peers"
    here, absent = shots(options, SHOTS)
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
        page = options.root / f"docs/results/peers/{name}.md"
        for number, driver in enumerate(drivers, 1):
            files = out / name / (f"{name}-{number}" if number > 1 else name)
            sections.append(re.sub(r"\A## .*", f"## {driver.name}", files.with_suffix(".md").read_text()))
            if driver is drivers[0] and page.exists():
                shutil.copy(files.with_suffix(".toml"), page.with_suffix(".toml"))
            figures = json.loads(files.with_suffix(".json").read_text())
            measured += rows_of(name, driver, figures["beside"])
            bare = {(row["renderer"], row["setting"]): row for row in figures["rows"]}
            theirs, ours = bare["Mitsuba", "4 spp"], bare["diptych", f"4 spp, {RAW}"]
            raw = {"scene": name, "driver": driver.name, "peer": RAW, "spp": 4, "ms": theirs["ms"], "flip": theirs["flip"]}
            measured.append(raw | {"without_history": theirs["ms"] / ours["ms"], "own_flip": ours["flip"]})
        if page.exists():
            write_peer(options, name, page, sections)
    yield "beside", {
        "title": "Beside Mitsuba 3 and OIDN",
        "readme": {
            "rows": {"peer": ["fast"]},
            "columns": ["scene", *(f"{key}, {drivers[0].name}" for key, _ in COMPARED)],
            "note": f"{options.size} per eye, 4 samples; below 1, diptych is slower. Both with: Mitsuba has a history, too.",
        },
        "note": f"{options.size} per eye, 4 samples per pixel. How many times as fast as Mitsuba with OIDN, of that quality, "
        "diptych reaches the same FLIP (0 is best), in a first frame and with a history of frames. Both with: Mitsuba has a "
        "history, too, and therefore a lower FLIP to reach. Below 1, diptych is slower. Both not denoised: at equal "
        f"samples. {OWN}",
        "columns": [
            column("scene", "scene"),
            column("peer", "OIDN"),
            column("ms", "its time, ms", 0),
            column("flip", "its FLIP", 3),
            *(
                column(f"{key}, {driver.name}", f"{title}, {driver.name}", 1)
                for driver in drivers for key, title in COMPARED
            ),
        ],
        "rows": by_driver([row for row in measured if row["spp"] == 4]),
        "absent": absent,
    }
    yield "peers", {
        "title": "Time to the FLIP of Mitsuba + OIDN",
        "readme": None,
        "note": f"{options.size} per eye, {options.rounds} interleaved rounds, a reference of {options.peers_spp} samples. "
        "Two columns are the speed-up of diptych's fastest setting that reaches this FLIP, for each kind of frame. In two "
        f"more, OIDN filters the mean of Mitsuba's last {FRAMES} frames, reprojected by NumPy, whose time counts (not "
        "measured with 16 samples). Below 1, diptych is slower; – means that no setting reaches this FLIP. Not denoised: "
        f"speed-up at equal samples, both eyes fully traced. {OWN}",
        "columns": [
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
            column("own_flip", "diptych's FLIP", 3),
        ],
        "rows": measured,
        "absent": absent,
    }


def by_driver(rows):
    """One row for each scene and peer, whose speed-ups have the driver in their keys."""
    speed_ups = ("with_history", "without_history", "both_histories")
    merged = {}
    for row in rows:
        shared = {key: row[key] for key in ("scene", "peer", "ms", "flip")}
        of = merged.setdefault((row["scene"], row["peer"]), shared)
        of |= {f"{key}, {row['driver']}": row.get(key) for key in speed_ups}
    return list(merged.values())


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


def write_peer(options, name, file, sections):
    """The tables of all drivers below the introduction that docs/results/peers/NAME.md has, and their chart."""
    text = file.read_text().split("\n## ", 1)[0].rstrip("\n") + "\n\n" + "\n".join(sections)
    file.write_text(text)
    title = f"{name}, {options.size}: error against time; beside points, samples per pixel"
    file.with_suffix(".svg").write_text(chart(title, text))
