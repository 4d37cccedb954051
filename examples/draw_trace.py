#!/usr/bin/env python3
"""Draws one frame of a trace-file as SVG: a row for each device and thread that carries packets, a box for each span.

    diptych render builtin:atrium --virtual 2 --frames 3 --trace trace.json --out out/frame
    python examples/draw_trace.py trace.json 2 > frame.svg

It needs nothing but Python."""

import json
import sys
from html import escape

WIDTH, ROW, LEFT, GAP = 1200, 14, 190, 8
LANES = ["left", "right", "both", "upload", "download"]
COLOURS = {"left": "#4878a8", "right": "#8a62a8", "both": "#5f9a62", "upload": "#d08a3c", "download": "#c9b04a"}
HOST = {"wait for rows of others": "#e3dcd2", "wait for device": "#ece8e2", "send to rank": "#b8433c",
        "receive from rank": "#2f8f8a", "wait for own rows": "#f1ead2"}


def main(path, number):
    with open(path, encoding="utf-8") as file:
        events = json.load(file)["traceEvents"]
    processes = {e["pid"]: e["args"]["name"] for e in events if e["name"] == "process_name"}
    threads = {(e["pid"], e["tid"]): e["args"]["name"] for e in events if e["name"] == "thread_name"}
    spans = [e for e in events if e["ph"] == "X"]
    frames = [e for e in spans if threads.get((e["pid"], e["tid"])) == "frames" and e["args"].get("frame") == number]
    if not frames or frames[0]["dur"] <= 0:
        sys.exit(f"{path} has no frame {number}")
    begin, length = frames[0]["ts"], frames[0]["dur"]
    rows = {}
    for span in spans:
        track = (span["pid"], span["tid"])
        name = threads.get(track, "")
        is_lane = span["pid"] >= 10 and name in LANES
        if not is_lane and not (span["name"] in HOST and (name == "post" or name.startswith("device "))):
            continue
        at, end = span["ts"] - begin, span["ts"] + span["dur"] - begin
        if end > 0 and at < length:
            colour = COLOURS[name] if is_lane else HOST[span["name"]]
            rows.setdefault(track, []).append((max(at, 0), min(end, length), colour, span["name"]))
    def label(track):
        return threads[track] if track[0] >= 10 and threads[track] in LANES else "thread " + threads[track]
    out, y, before = [], 24, None
    scale = (WIDTH - LEFT - 10) / length
    for track in sorted(rows):
        if track[0] != before:
            before, y = track[0], y + GAP + ROW
            out.append(f'<text x="4" y="{y - 4}" font-weight="bold">{escape(processes.get(track[0], ""))}</text>')
        out.append(f'<text x="12" y="{y + ROW - 4}">{escape(label(track))}</text>')
        for at, end, colour, name in sorted(rows[track], key=lambda span: span[0] - span[1]):
            x, width = LEFT + at * scale, max((end - at) * scale, 0.6)
            out.append(f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{ROW - 2}" fill="{colour}">'
                       f"<title>{escape(name)}, {end - at:.0f} µs</title></rect>")
        y += ROW
    ticks = "".join(f'<text x="{LEFT + length * i / 4 * scale:.0f}" y="14" text-anchor="middle">'
                    f"{length * i / 4e3:.1f} ms</text>" for i in range(4))
    print(f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{y + 10}" font-family="sans-serif" '
          f'font-size="10"><rect width="100%" height="100%" fill="#fff"/>{ticks}{"".join(out)}</svg>')


if len(sys.argv) != 3:
    sys.exit(__doc__)
main(sys.argv[1], int(sys.argv[2]))
