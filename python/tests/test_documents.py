"""Tests of the examples in documents."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

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


def test_the_denoiser_of_the_page_is_measured(scene, capsys):
    (script,) = [block for block in blocks() if "def mean(" in block]
    assert len(script.split("\n\n")[0].splitlines()) <= 15
    exec(script, {"dp": dp, "np": np, "scene": scene})
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["svgf", "mean"]
    assert all(0 < float(line.split()[-1]) < 0.2 for line in lines), lines


def test_oidn_is_measured(scene):
    pytest.importorskip("pyoidn", reason="OIDN needs the package pyoidn")
    (script,) = [block for block in blocks() if "import pyoidn" in block]
    names = {"dp": dp, "np": np, "scene": scene}
    exec(script, names)
    svgf, oidn = names["table"]
    assert (svgf["denoiser"], oidn["denoiser"]) == ("svgf", "oidn") and oidn["flip"] < 0.2
