"""Records the costs of a shot's frames on every rung of a ladder, for the tests in tests/models/control.

    python3 tools/record-costs.py --diptych target/release/diptych --out tests/models/control/recorded/NAME \
        --size 96x54 --loop 8 [--rungs 13] SHOT [OPTION OF play ...]

Measures a ladder with `bench`, lets `play` use its rungs in turns of a few frames, and writes NAME.toml,
NAME.ladder.toml and NAME.png. Each frame of the camera's path, which starts again after `--loop` seconds, is recorded on
each rung. Turns are short, so that the machine's speed drifts alike for all rungs. Needs nothing but Python.
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

TURN = 12
REPEATS = 3
STEPS = 128


def run(command):
    env = {**os.environ, "NODEVICE_SELECT": "1"}
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=env)


def rungs(text):
    """Returns the header of a ladder's file and the text of each rung."""
    head, *rest = re.split(r"(?m)^\[\[rung\]\]$", text)
    return head, ["[[rung]]" + rung for rung in rest]


def frames(folder):
    """Yields the rung of each frame of a run, and its costs."""
    for row in json.load(open(folder + "/run.json"))["frames"]:
        values = {}
        for stage in row["stages"]:
            key = f"{stage['stage']} {stage['view']}"
            values[key] = values.get(key, 0.0) + stage["busy_ms"]
        overhead = row["makespan_ms"] - sum(values.values())
        yield row["rung"], {**values, "overhead": max(overhead, 0.0), "rays": row["rays"]}


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
    parser.add_argument("--loop", type=float, required=True)
    parser.add_argument("--rungs", type=int, default=13)
    parser.add_argument("--ladder", help="a measured ladder; bench measures one by default")
    parser.add_argument("shot")
    options, more = parser.parse_known_args()
    with tempfile.TemporaryDirectory() as folder:
        ladder = options.ladder
        if not ladder:
            run([options.diptych, "bench", options.shot, "--size", options.size, "--quiet", "--out", folder + "/bench"])
            ladder = folder + "/bench/ladder.toml"

        def play(count, fps, controller):
            run([options.diptych, "play", options.shot, "--size", options.size, "--virtual", "1", "--ladder", ladder,
                 "--frames", str(count), "--budget-ms", "1..10000", "--fps", str(fps), "--set", f"controller={controller}",
                 "--quiet", "--out", folder + "/play", *more])
            return rungs(open(folder + "/play/ladder.toml").read())

        # `play` adds rungs between measured ones.
        head, texts = play(2, 1000.0, "diptych")
        step = max(1, round(len(texts) / options.rungs))
        texts = texts[::step]
        count = len(texts)
        # Each turn of the path meets each rung if the two numbers have no common divisor.
        turns = next(n for n in range(10, 30) if math.gcd(n, count) == 1)
        length = turns * TURN
        play(length * count * REPEATS, length / options.loop, f"turns:{TURN}:{step}")
        recorded = [[[None] * count for _ in range(length)] for _ in range(REPEATS)]
        for frame, (rung, values) in enumerate(frames(folder + "/play")):
            recorded[frame // (length * count)][frame % length][rung // step] = values
    columns = [list(recorded[0][0][rung]) for rung in range(count)]
    image = []
    for row in (row for repeat in recorded for row in repeat):
        image.append([stored(n, values.get(n, 0.0)) for names, values in zip(columns, row) for n in names])
    write_png(options.out + ".png", image)
    with open(options.out + ".ladder.toml", "w") as file:
        file.write(head + "".join(texts))
    width, height = options.size.split("x")
    with open(options.out + ".toml", "w") as file:
        file.write(f"# {' '.join([options.shot, *more])}\nwidth = {width}\nheight = {height}\nframes = {length}\nturn = {TURN}\ncolumns = [\n")
        file.writelines(f"    {json.dumps(names)},\n" for names in columns)
        file.write("]\n")


if __name__ == "__main__":
    main()
