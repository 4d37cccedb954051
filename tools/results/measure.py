"""Measures all tables of results in one run, and writes docs/results/results.json and .md and README.md's tables.

    measure.py [options]        as `make numbers` runs it

Needs Python 3.11 and the release program. Each table records the commit, date, machine and drivers of its measurement,
so you can measure one again and keep the others. A test compares README.md and results.md with results.json.
"""

import argparse
import datetime
import json
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

from driver import ROOT, Driver

sys.path.append(str(ROOT / "docs/results/peers"))

from loop import measure_loop  # noqa: E402
from machine import processor  # noqa: E402
from peers import measure_peers  # noqa: E402
from quiet import Meanwhile, wait_for_quiet  # noqa: E402
from tables import measure_drivers, measure_flip, measure_play, measure_scale, say  # noqa: E402
from starts import measure_host, measure_starts  # noqa: E402
from studies import MEASUREMENTS as STUDIES  # noqa: E402
from text import write  # noqa: E402
from views import measure_views  # noqa: E402

# Sizes and counts of a real run, and of a smoke test.
REAL = argparse.Namespace(
    size="320x180", scale_size="640x360", reference_spp=512, turns=2, plays=3, play_frames=600, peers_spp=1024, rounds=2,
    fraction=0.125, large=(2_000_000, 10_000_000), host_frames=(40, 240), loop_size="96x54", loop_frames=240,
)
SMOKE = argparse.Namespace(
    size="48x27", scale_size="64x36", reference_spp=8, turns=2, plays=1, play_frames=40, peers_spp=16, rounds=1,
    fraction=0.03, large=(20_000,), host_frames=(10, 20), loop_size="48x27", loop_frames=40,
)

MEASUREMENTS = {
    "flip": measure_flip,
    "play": measure_play,
    "scale": measure_scale,
    "drivers": measure_drivers,
    "loop": measure_loop,
    "views": measure_views,
    "starts": measure_starts,
    "host": measure_host,
    "peers": measure_peers,
    **STUDIES,
}
# Images hardly depend on the driver, so these run on one driver only.
ON_ONE_DRIVER = ("flip", *STUDIES)


def git(*args):
    return subprocess.run(["git", *args], cwd=ROOT, stdout=subprocess.PIPE, text=True).stdout.strip()


def commit():
    """The commit, marked if the program or these scripts differ from it."""
    sources = ("src", "cli/src", "shaders", "scenes", "Cargo.lock", "tools/results", "docs/results/peers/*.py")
    changed = git("status", "--porcelain", "--", *sources)
    return (git("rev-parse", "--short=7", "HEAD") or "unknown") + (" with changes" if changed else "")


def rounded(value):
    """Numbers to six digits, in whatever holds them."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: rounded(of) for key, of in value.items()}
    return [rounded(of) for of in value] if isinstance(value, list) else value


def measure(options, results):
    program = str(Path(options.diptych).resolve())
    drivers = [Driver(command, program, options.out / "run") for command in ["", *options.driver]]
    if len({driver.full for driver in drivers}) < len(drivers):
        sys.exit(f"--driver runs no other driver than the installed one: {drivers[0].full}")
    for driver in drivers[1:]:
        # A command may run programs in a system of its own, which lacks the folder.
        if options.scenes.exists() and subprocess.run([*driver.command, "test", "-d", options.scenes]).returncode != 0:
            sys.exit(f"under --driver {shlex.join(driver.command)}, there is no {options.scenes}")
    for name in options.tables:
        meanwhile, begin = Meanwhile(), time.monotonic()
        used = drivers[:1] if name in ON_ONE_DRIVER else drivers
        measured = {"commit": commit(), "date": datetime.date.today().isoformat(), "machine": processor()}
        measured |= {"drivers": [driver.full for driver in used], "smoke": options.smoke}
        tables = dict(MEASUREMENTS[name](options, used))
        measured["others"] = meanwhile.others()
        for table, content in tables.items():
            results["tables"][table] = rounded(content | {"measured": measured})
        write(options.root, results)
        say(f"{name}: {time.monotonic() - begin:.0f} s")


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--tables", default="", help=f"some of {' '.join(MEASUREMENTS)}; peers needs --peers")
    parser.add_argument("--diptych", default=ROOT / "target/release/diptych", help="the program")
    parser.add_argument(
        "--driver", action="append", default=[], metavar="COMMAND", help="runs another command under another driver"
    )
    parser.add_argument(
        "--scenes",
        type=Path,
        default=ROOT / "out/scenes",
        help="folder of garage.toml, hotel-room.toml and ww2-cityscene.toml",
    )
    parser.add_argument("--peers", type=Path, help="Python that has the packages of peers/requirements.txt")
    parser.add_argument("--root", type=Path, default=ROOT, help="folder whose README.md and docs are written")
    parser.add_argument("--render", action="store_true", help="measure nothing; write the files from results.json")
    parser.add_argument("--smoke", action="store_true", help="try everything at tiny sizes, into out/numbers/smoke")
    options = parser.parse_args()
    options.tables = options.tables.split() or [name for name in MEASUREMENTS if name != "peers" or options.peers]
    unknown = [name for name in options.tables if name not in MEASUREMENTS]
    if unknown:
        parser.error(f"there is no table {unknown[0]}: {' '.join(MEASUREMENTS)}")
    if "peers" in options.tables and not options.peers:
        parser.error("the table peers needs --peers")
    options.scenes, options.out = options.scenes.resolve(), ROOT / "out/numbers"
    vars(options).update(vars(SMOKE if options.smoke else REAL))
    return options


def main():
    options = arguments()
    if options.smoke:
        options.root = options.out / "smoke"
        shutil.rmtree(options.root, ignore_errors=True)
        shutil.copytree(ROOT / "docs/results/peers", options.root / "docs/results/peers")
        for file in ("README.md", "docs/results/results.json"):
            shutil.copy(ROOT / file, options.root / file)
    results = json.loads((options.root / "docs/results/results.json").read_text())
    if options.render:
        write(options.root, results)
        return
    if not options.smoke:
        wait_for_quiet()
    measure(options, results)
    left_out = [name for name in MEASUREMENTS if name not in options.tables]
    if left_out:
        say(f"not measured: {', '.join(left_out)}")
    say(f"written: README.md, results.json and results.md in docs/results of {options.root}")


if __name__ == "__main__":
    main()
