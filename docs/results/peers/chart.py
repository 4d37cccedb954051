"""Draws time against error of tables that measure.py wrote, as SVG.

    chart.py TABLE.md [CHART.svg]

A file may hold the tables of several runs, each with its conditions: another driver each. diptych has a line for each
driver; the other renderers, who use none, have one line each, of the mean of their times over the runs.
"""

import math
import re
import sys
from html import escape
from pathlib import Path

# Okabe and Ito's colours (2008), which colour-blind readers can tell apart as well; cli/src/report/plot.rs has all but black.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
INK, GRID = "#282828", "#E1E1E1"
WIDTH = 800
LEFT, RIGHT, TOP, BOTTOM = 76, 776, 48, 446
# The axis' title, and below it the legend's first row.
TITLE, LEGEND = 488, 512

OURS = "diptych"
ROW = re.compile(r"^\| ([^|]+) \| (\d+) spp([^|]*) \| ([\d.]+) \| [^|]+ \| ([\d.]+) \|$", re.M)
# Settings that are drawn by themselves, beside their renderer's line, with what their point looks like.
ALONE = {
    "first frame": '<rect x="{0:.1f}" y="{1:.1f}" width="8" height="8" transform="translate(-4 -4)" {2}/>',
    "not denoised": '<path d="M{0:.1f} {1:.1f}m0 -5l5 9h-10z" {2}/>',
}


class Points:
    """What has been read: lines and single points, as {(samples or their label): [(milliseconds, FLIP) of each run]}."""

    def __init__(self, text):
        self.lines, self.alone = {}, []
        for run in re.split(r"^## .*$", text, flags=re.M)[1:]:
            driver = re.search(r"Mesa [\d.]*\d", run)
            for name, samples, more, ms, flip in ROW.findall(run):
                name += f", {driver[0]}" if name == OURS and driver else ""
                point, kind = (float(ms), float(flip)), more.removeprefix(", ")
                if kind in ALONE:
                    self.alone.append((name, kind, samples, *point))
                else:
                    # A render scale traces paths for its square's share of the pixels.
                    scale = float(kind.removeprefix("render scale ") or 1)
                    label = f"{int(samples) * scale**2:g}"
                    self.lines.setdefault(name, {}).setdefault(label, []).append(point)

    def drawn(self):
        """(name, [(label, milliseconds, FLIP)]) of each line, which takes the mean of its times, from the fastest."""
        for name, labels in self.lines.items():
            points = [(label, sum(p[0] for p in of) / len(of), of[0][1]) for label, of in labels.items()]
            yield name, sorted(points, key=lambda p: p[1])


class Axis:
    """A logarithmic one, with round ticks."""

    def __init__(self, values, begin, end):
        self.least, self.most = math.log(min(values) / 1.12), math.log(max(values) * 1.12)
        self.begin, self.end = begin, end
        steps = [m * 10.0**d for d in range(-4, 7) for m in (1, 1.5, 2, 3, 5, 7)]
        self.ticks = []
        for step in steps:
            inside = self.least <= math.log(step) <= self.most
            if inside and (not self.ticks or abs(self.at(step) - self.at(self.ticks[-1])) > 10 * len(f"{step:g}")):
                self.ticks.append(step)

    def at(self, value):
        share = (math.log(value) - self.least) / (self.most - self.least)
        return self.begin + share * (self.end - self.begin)


def text(x, y, what, size=14, anchor="middle", more=""):
    return f'<text x="{x:.0f}" y="{y:.0f}" font-size="{size}" text-anchor="{anchor}"{more}>{escape(what)}</text>'


def grid(x, y):
    for tick in x.ticks:
        yield f'<path d="M{x.at(tick):.1f} {TOP}V{BOTTOM}" stroke="{GRID}"/>'
        yield text(x.at(tick), BOTTOM + 18, f"{tick:g}")
    for tick in y.ticks:
        yield f'<path d="M{LEFT} {y.at(tick):.1f}H{RIGHT}" stroke="{GRID}"/>'
        yield text(LEFT - 8, y.at(tick) + 5, f"{tick:g}", anchor="end")
    yield f'<path d="M{LEFT} {TOP}V{BOTTOM}H{RIGHT}" stroke="{INK}" fill="none"/>'
    yield text((LEFT + RIGHT) / 2, TITLE, "time of a stereo frame, ms", 16)
    middle = (TOP + BOTTOM) / 2
    yield text(20, middle, "FLIP, mean of both eyes", 16, more=f' transform="rotate(-90 20 {middle:.0f})"')


def legend(entries, rows):
    """Of names and functions that draw a mark at a place, in columns of so many rows."""
    for number, (name, mark) in enumerate(entries):
        x, y = (LEFT, (LEFT + RIGHT) / 2)[number // rows] + 14, LEGEND + 17 * (number % rows)
        yield mark(x, y)
        yield text(x + 12, y + 4, name, 12, "start")


def dot(colour):
    return lambda x, y: f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{colour}"/>'


def shape(kind, colour):
    style = f'fill="#FFFFFF" stroke="{colour}" stroke-width="2"'
    return lambda x, y: ALONE[kind].format(x, y, style)


def joined(x, y, points, style):
    path = "L".join(f"{x.at(ms):.1f} {y.at(flip):.1f}" for _, ms, flip in points)
    return f'<path d="M{path}" {style} fill="none"/>'


def chart(title, table):
    """The SVG of such a file's text."""
    read = Points(table)
    lines = list(read.drawn())
    x = Axis([p[1] for _, points in lines for p in points] + [p[3] for p in read.alone], LEFT, RIGHT)
    y = Axis([p[2] for _, points in lines for p in points] + [p[4] for p in read.alone], BOTTOM, TOP)
    colours = {name: COLOURS[number % len(COLOURS)] for number, (name, _) in enumerate(lines)}
    entries = [(name, dot(colour)) for name, colour in colours.items()]
    entries += [(f"{OURS}, {kind}", shape(kind, INK)) for kind in dict.fromkeys(p[1] for p in read.alone)]
    rows = -(-len(entries) // 2)
    height = LEGEND + 17 * rows
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" viewBox="0 0 {WIDTH} {height}" '
        f'font-family="sans-serif" fill="{INK}">',
        f'<rect width="{WIDTH}" height="{height}" fill="#FFFFFF"/>',
        text(WIDTH / 2, 30, title, 20),
        *grid(x, y),
    ]
    marks = []
    for name, points in lines:
        parts.append(joined(x, y, points, f'stroke="{colours[name]}" stroke-width="2"'))
        first = sorted((p[2:] for p in read.alone if p[:2] == (name, "first frame")), key=lambda p: p[1])
        if len(first) > 1:
            parts.append(joined(x, y, first, f'stroke="{colours[name]}" stroke-dasharray="4 4"'))
        marks += [(name, dot(colours[name]), *point) for point in points]
    marks += [(name, shape(kind, colours[name]), *point) for name, kind, *point in read.alone]
    for name, mark, label, ms, flip in marks:
        px, py = x.at(ms), y.at(flip)
        # Towards where no line is: ours fall on the left, the others' on the right.
        dx, dy, anchor = (-7, 13, "end") if name.startswith(OURS) else (7, -6, "start")
        parts += [mark(px, py), text(px + dx, py + dy, label, 11, anchor, f' style="fill:{colours[name]}"')]
    return "\n".join([*parts, *legend(entries, rows), "</svg>\n"])


def main():
    table = Path(sys.argv[1])
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else table.with_suffix(".svg")
    text = table.read_text()
    size = re.search(r"^(\d+x\d+) per eye", text, re.M)
    name = f"{table.stem}, {size[1]}" if size else table.stem
    out.write_text(chart(f"{name}: error against time; beside points, samples per pixel", text))


if __name__ == "__main__":
    main()
