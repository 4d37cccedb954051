"""Traces and their swimlanes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from html import escape
from typing import Any

from . import _native

# The palette of Okabe and Ito, and darker variants, which colour-blind readers can tell apart.
COLOURS = (
    *("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442"),
    *("#004c76", "#8f6200", "#00553e", "#7d3f63", "#2b7299", "#7f3800", "#8c8416"),
)
TRANSFER = "#9a9a9a"
LANES = ("left", "right", "both", "upload", "download")

MARGIN, LABEL, RIGHT = 8, 90, 26
ROW, TITLE, AXIS, LEGEND = 16, 20, 34, 18


class Trace:
    """A trace that `diptych render --trace` or `diptych play --trace` wrote. `trace` reads one."""

    def __init__(self, path: str | os.PathLike[str]):
        contents = json.loads(_native.read_trace(path))
        self.devices: list[dict[str, Any]] = contents["devices"]
        """Devices: `pid`, the number of the device's process in the trace, and `name`."""
        self.frames: list[dict[str, Any]] = contents["frames"]
        """Frames: `frame`, the number, and `begin_ms` and `end_ms` since the first frame began."""
        self.tasks: list[dict[str, Any]] = contents["tasks"]
        """Passes and transfers: `pid`, `lane`, `name`, `frame`, `begin_ms`, `end_ms`, `rows` and `bytes`."""
        self.summary: dict[str, Any] = contents["summary"]
        """The summary of `diptych trace --json`."""

    def lanes(self, frames: int | Iterable[int] | None = None, *, width: int = 960) -> Lanes:
        """Draws the passes and transfers of each device over time; by default, those of the last three frames.

        `frames` is the number of a frame, or the numbers of several.
        """
        numbers = [frame["frame"] for frame in self.frames]
        if not numbers:
            raise ValueError("the trace has no frames of diptych devices")
        if frames is None:
            chosen = numbers[-3:]
        else:
            chosen = [frames] if isinstance(frames, int) else list(frames)
        missing = sorted(set(chosen).difference(numbers))
        if missing or not chosen:
            wanted = f"frame {missing[0]}" if missing else "chosen frame"
            raise ValueError(f"the trace has no {wanted}: it has frames {numbers[0]} to {numbers[-1]}")
        if width < 300:
            raise ValueError("lanes are at least 300 pixels wide")
        return Lanes(_svg(self, set(chosen), width))

    def __repr__(self) -> str:
        return f"<diptych.Trace: {len(self.devices)} devices, {len(self.frames)} frames, {len(self.tasks)} tasks>"


class Lanes:
    """Swimlanes of a trace, as an SVG image. Notebooks show it; the mouse pointer shows the times of a task."""

    def __init__(self, svg: str):
        self.svg = svg

    def _repr_svg_(self) -> str:
        return self.svg

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the SVG file."""
        with open(path, "w", encoding="utf-8") as file:
            file.write(self.svg)


def trace(path: str | os.PathLike[str]) -> Trace:
    """Reads a trace file, complete or truncated."""
    return Trace(path)


def _svg(trace: Trace, chosen: set[int], width: int) -> str:
    frames = [frame for frame in trace.frames if frame["frame"] in chosen]
    tasks = [task for task in trace.tasks if task["frame"] in chosen]
    begin = min(span["begin_ms"] for span in frames + tasks)
    end = max(span["end_ms"] for span in frames + tasks)
    scale = (width - MARGIN - LABEL - RIGHT) / max(end - begin, 1e-9)

    def x(ms: float) -> float:
        return MARGIN + LABEL + (ms - begin) * scale

    names = sorted({task["name"] for task in tasks if task["lane"] in LANES[:3]})
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(names)}
    # Lines are drawn first, and then names and tasks over them.
    lines: list[str] = []
    parts: list[str] = []
    tops: dict[tuple[int, str], int] = {}
    y = AXIS
    for device in trace.devices:
        halo = "paint-order='stroke' stroke='#ffffff' stroke-width='4'"
        parts.append(_text(MARGIN, y + 14, device["name"], f"font-weight='bold' {halo}"))
        y += TITLE
        used = {task["lane"] for task in tasks if task["pid"] == device["pid"]}
        for lane in (lane for lane in LANES if lane in used):
            parts.append(_text(MARGIN + 8, y + 12, lane))
            place = f"x='{x(begin):.2f}' y='{y + 1}' width='{(end - begin) * scale:.2f}' height='14'"
            lines.append(f"<rect {place} fill='#f2f2f2'/>")
            tops[device["pid"], lane] = y
            y += ROW
    bottom = y + 4
    step = _step(end - begin, (width - LABEL) / 90)
    for i in range(int((end - begin) / step) + 1):
        at = x(begin + i * step)
        lines.append(_line(at, AXIS - 4, bottom, "stroke='#dddddd'"))
        parts.append(_text(at, AXIS - 8, f"{i * step:g} ms", "text-anchor='middle' fill='#666666'"))
    for frame in frames:
        at = x(frame["begin_ms"])
        lines.append(_line(at, 14, bottom, "stroke='#444444' stroke-dasharray='3 2'"))
        parts.append(_text(at + 3, 12, f"frame {frame['frame']}"))
    for task in tasks:
        top = tops.get((task["pid"], task["lane"]))
        if top is None:
            continue
        wide = max((task["end_ms"] - task["begin_ms"]) * scale, 0.5)
        colour = colours.get(task["name"], TRANSFER) if task["lane"] in LANES[:3] else TRANSFER
        tip = escape(_tip(task))
        place = f"x='{x(task['begin_ms']):.2f}' y='{top + 1}' width='{wide:.2f}' height='14'"
        parts.append(f"<rect {place} fill='{colour}'><title>{tip}</title></rect>")
    across, y = MARGIN + LABEL, bottom + 8
    for name, colour in [*colours.items(), ("transfer", TRANSFER)]:
        long = 26 + 7 * len(name)
        if across + long > width - RIGHT and across > MARGIN + LABEL:
            across, y = MARGIN + LABEL, y + LEGEND
        parts.append(f"<rect x='{across}' y='{y}' width='11' height='11' fill='{colour}'/>")
        parts.append(_text(across + 15, y + 10, name))
        across += long
    height = y + LEGEND + MARGIN
    head = f"<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='{height}' viewBox='0 0 {width} {height}'"
    style = "font-family='sans-serif' font-size='11'"
    return f"{head} {style}><rect width='100%' height='100%' fill='#ffffff'/>{''.join(lines + parts)}</svg>\n"


def _line(x: float, top: float, bottom: float, style: str) -> str:
    return f"<line x1='{x:.2f}' x2='{x:.2f}' y1='{top}' y2='{bottom}' {style}/>"


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f"<text x='{x:.2f}' y='{y}' {style}>{escape(text)}</text>"


def _tip(task: dict[str, Any]) -> str:
    parts = [f"{task['name']}, {task['lane']}", f"{task['end_ms'] - task['begin_ms']:.3f} ms"]
    if task["rows"]:
        parts.append(f"rows {task['rows'][0]} to {task['rows'][1] - 1}")
    if task["bytes"] is not None:
        parts.append(f"{task['bytes']} bytes")
    return ", ".join(parts)


def _step(length: float, most: float) -> float:
    """Returns the distance of at most `most` marks on an axis: 1, 2 or 5 times a power of ten."""
    step = 10.0**-6
    while True:
        for factor in (1, 2, 5):
            if length / (step * factor) <= most:
                return step * factor
        step *= 10
