"""Tests of the examples in documents."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

import diptych as dp

GUIDE = Path(__file__).parents[2] / "docs" / "guide"
PAGES = [GUIDE / "python.md", GUIDE / "python-control.md"]


def blocks():
    return re.findall(r"^```python\n(.*?)^```$", "\n".join(page.read_text() for page in PAGES), re.MULTILINE | re.DOTALL)


def run(script, folder):
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=os.environ | {"PYTHONUTF8": "1"})
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_the_ten_lines_run(tmp_path):
    script = blocks()[0]
    assert sum(line.strip() != "" for line in script.splitlines()) == 10
    frame, played, flip = run(script, tmp_path)
    assert re.fullmatch(r"\(180, 320, 3\) float32 \d+", frame), frame
    assert re.fullmatch(r"\d+ of 20 frames within the budget", played), played
    assert re.fullmatch(r"FLIP 0\.\d{3}", flip) and 0.0 < float(flip.split()[1]) < 0.2, flip
    assert (tmp_path / "cornell.png").read_bytes().startswith(b"\x89PNG")


def test_the_controller_of_the_page_plays(scene):
    (script,) = [block for block in blocks() if "controller=" in block]
    names = {"renderer": dp.Renderer(scene, size=(64, 36))}
    exec(script, names)
    assert len(names["frames"]) == 100


def test_the_policy_of_the_page_distributes_rows(scene):
    (script,) = [block for block in blocks() if "policy=" in block]
    names = {"dp": dp, "np": np, "scene": scene}
    exec(script, names)
    frames = [names["renderer"].render(index=index) for index in range(3)]
    assert all(sum(frame.report["stripes"]) == 360 for frame in frames)
