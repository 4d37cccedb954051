"""Stereo frames by real-time path tracing, as NumPy arrays.

    import diptych as dp

    scene = dp.load("builtin:cornell")
    renderer = dp.Renderer(scene, size=(320, 180), devices=dp.virtual(2))
    frame = renderer.render(time=0.0)
    frame.left, frame.right  # float32 of the shape (height, width, 3), scene-referred linear RGB

Options have the names and the defaults of the command line, with underscores: `render_scale=0.5` is
`--set render_scale=0.5`.
"""

from __future__ import annotations

import os
import sys

# Mesa's device-selection layer prints an error on every start without a Wayland server. Drivers read the environment
# when a device is opened.
if sys.platform.startswith("linux") and "XDG_RUNTIME_DIR" not in os.environ:
    os.environ.setdefault("NODEVICE_SELECT", "1")

from ._dataset import dataset  # noqa: E402
from ._denoise import DenoiserFunction  # noqa: E402
from ._denoiser import Denoiser  # noqa: E402
from ._frame import Camera, Frame, PerView  # noqa: E402
from ._measure import Bench, Errors, bench, compare, flip  # noqa: E402
from ._native import __version__, read_exr, write_exr  # noqa: E402
from ._renderer import Controller, Devices, Player, Renderer, Scene, load, reference, virtual  # noqa: E402
from ._trace import Lanes, Trace, trace  # noqa: E402

__all__ = [
    "Bench",
    "Camera",
    "Controller",
    "Denoiser",
    "DenoiserFunction",
    "Devices",
    "Errors",
    "Frame",
    "Lanes",
    "PerView",
    "Player",
    "Renderer",
    "Scene",
    "Trace",
    "bench",
    "compare",
    "dataset",
    "flip",
    "load",
    "read_exr",
    "reference",
    "trace",
    "virtual",
    "write_exr",
]
