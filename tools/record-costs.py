"""Records the costs of a shot's frames on every rung of a ladder, for the tests in tests/models/control.

    python3 tools/record-costs.py --diptych target/release/diptych --out tests/models/control/recorded/NAME \
        --size 96x54 [--rungs 8] SHOT [OPTION OF play ...]

Measures a ladder with `bench`, pins `play` to each rung in turns, and writes NAME.toml, NAME.ladder.toml and NAME.png.
Needs nothing but Python.
"""

import argparse
import json
import math
import os
import re
import struct
import subprocess
import tempfile
import zlib
from statistics import median

FRAMES = 160
SKIPPED = 8
REPEATS = 3
STEPS = 128
# Stages whose work is the same on all rungs. The machine's speed drifts between runs, and their time tells by how much.
STEADY = ("accumulate", "resolve", "reproject", "tally")


def run(command):
    env = {**os.environ, "NODEVICE_SELECT": "1"}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=env)


def rungs(text):
    """Returns the header of a ladder's file and the text of each rung."""
    head, *rest = re.split(r"(?m)^\[\[rung\]\]$", text)
    return head, ["[[rung]]" + rung for rung in rest]


def frames(folder):
    rows = json.load(open(folder + "/run.json"))["frames"][SKIPPED:]
    for row in rows:
        values = {}
        for stage in row["stages"]:
            key = f"{stage['stage']} {stage['view']}"
            values[key] = values.get(key, 0.0) + stage["busy_ms"]
        overhead = row["makespan_ms"] - sum(values.values())
        yield {**values, "overhead": max(overhead, 0.0), "rays": row["rays"]}


def speed(rows):
    return median(sum(v for k, v in row.items() if k.split()[0] in STEADY) for row in rows)


def write_png(path, rows):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    # Filter 2: the difference to the row above, by bytes.
    lines, above = [], bytes(2 * len(rows[0]))
    for row in rows:
        line = struct.pack(f">{len(row)}H", *row)
        lines.append(b"\2" + bytes((a - b) & 255 for a, b in zip(line, above)))
        above = line
    header = struct.pack(">IIBBBBB", len(rows[0]), len(rows), 16, 0, 0, 0, 0)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
                   + chunk(b"IDAT", zlib.compress(b"".join(lines), 9)) + chunk(b"IEND", b""))


def stored(name, value):
    return round(STEPS * math.log2(1.0 + (value if name == "rays" else value * 1e3)))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--diptych", required=True)
    parser.add_argument("--out", required=True)
    parser.add_argument("--size", required=True)
    parser.add_argument("--rungs", type=int, default=8)
    parser.add_argument("--ladder", help="a measured ladder; bench measures one by default")
    parser.add_argument("shot")
    options, more = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        ladder = options.ladder
        if not ladder:
            run([options.diptych, "bench", options.shot, "--size", options.size, "--quiet", "--out", folder + "/bench"])
            ladder = folder + "/bench/ladder.toml"
        head, texts = rungs(open(ladder).read())
        # Rungs at even distances, the first and the last among them.
        count = min(options.rungs, len(texts))
        texts = [texts[round(i * (len(texts) - 1) / max(count - 1, 1))] for i in range(count)]
        recorded = [[None] * count for _ in range(REPEATS)]
        for repeat in range(REPEATS):
            for rung in range(count):
                one = folder + "/one.toml"
                with open(one, "w") as file:
                    file.write(head + texts[rung])
                run([options.diptych, "play", options.shot, "--size", options.size, "--virtual", "1", "--ladder", one,
                     "--frames", str(FRAMES + SKIPPED), "--budget-ms", "1..10000", "--fps", "60", "--quiet", "--out", folder + "/play", *more])
                recorded[repeat][rung] = list(frames(folder + "/play"))
        speeds = [[speed(rows) for rows in runs] for runs in recorded]
        usual = median(s for row in speeds for s in row)
        columns = [list(recorded[0][rung][0]) for rung in range(count)]
        image = []
        for repeat in range(REPEATS):
            for frame in range(FRAMES):
                row = []
                for rung in range(count):
                    values, factor = recorded[repeat][rung][frame], usual / speeds[repeat][rung]
                    row += [stored(n, values.get(n, 0.0) * (1.0 if n == "rays" else factor)) for n in columns[rung]]
                image.append(row)
    write_png(options.out + ".png", image)
    with open(options.out + ".ladder.toml", "w") as file:
        file.write(head + "".join(texts))
    width, height = options.size.split("x")
    with open(options.out + ".toml", "w") as file:
        file.write(f"# {' '.join([options.shot, *more])}\nwidth = {width}\nheight = {height}\nframes = {FRAMES}\ncolumns = [\n")
        file.writelines(f"    {json.dumps(names)},\n" for names in columns)
        file.write("]\n")
    print("speeds of the runs over their median:", [[round(s / usual, 2) for s in row] for row in speeds])


if __name__ == "__main__":
    main()
