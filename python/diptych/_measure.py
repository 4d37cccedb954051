"""Errors against references, and tables of time and error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from statistics import median
from typing import Any

import numpy as np

from . import _denoise, _native, _renderer
from ._frame import Frame, Image
from ._renderer import Devices, Renderer, Scene


@dataclass(frozen=True)
class Errors:
    """Errors of an image, as `diptych compare` defines them; None where an error is undefined.

    Those of a frame are means over its views.
    """

    rmse: float
    relmse: float
    psnr: float
    ssim: float | None
    flip: float
    mean_ratio: float | None
    block16: float | None
    nonfinite_px: float
    nonfinite_reference_px: float


def compare(image: Frame | Image, reference: Frame | Image, *, exposure_ev: float | None = None) -> Errors:
    """Compares a frame or a view's image with a reference.

    By default, frames are compared at their exposure, and arrays at 0 stops.
    """
    if exposure_ev is None:
        exposure_ev = reference.exposure_ev if isinstance(reference, Frame) else 0.0
    pairs = zip(_views(reference), _views(image), strict=True)
    views = [dict(_native.errors(*pair, exposure_ev=exposure_ev)) for pair in pairs]

    def mean(name: str) -> Any:
        values = [view[name] for view in views]
        known = [value for value in values if value is not None]
        return sum(known) / len(known) if len(known) == len(values) else None

    return Errors(**{name: mean(name) for name in views[0]})


def flip(image: Image, reference: Image, *, exposure_ev: float = 0.0) -> Image:
    """FLIP of each pixel: 0 where no difference is seen, float32 of the shape (height, width)."""
    return _native.flip_map(reference, image, exposure_ev=exposure_ev)[..., 0]


class Bench(list[dict[str, Any]]):
    """Rows of `bench`."""

    def to_pandas(self) -> Any:
        """Converts the rows to a pandas DataFrame."""
        import pandas

        return pandas.DataFrame(self)


def bench(
    scene: Scene,
    *,
    reference: Frame | None = None,
    reference_spp: int = 256,
    frames: int = 16,
    turns: int = 5,
    time: float = 0.0,
    fps: float = 72.0,
    size: tuple[int, int] | None = None,
    devices: int | Devices = 1,
    **options: Any,
) -> Bench:
    """Measures time and error of every combination of options. A list as an option's value is a set of settings.

    Each combination renders `frames` frames of the camera's path, of which the last, at `time`, is compared with the
    reference. Then all combinations are timed in turns, so that other programs slow all of them down alike. `ms` is the
    median frame time over `turns` turns, and `ms_low` and `ms_high` are the ends of its 95 % interval, or None.

    A denoiser may be a function, see `Renderer`. Its time, and that of the auxiliary images that it takes, are part of
    the frame's.
    """
    if turns < 1:
        raise ValueError("turns: give a number from 1")
    reference = reference or _renderer.reference(scene, reference_spp, size=size, devices=devices, time=time)
    grid = {name: value if isinstance(value, (list, tuple)) else [value] for name, value in options.items()}
    combinations = [dict(zip(grid, values)) for values in product(*grid.values())]

    def last(settings: dict[str, Any], times: list[float]) -> Frame:
        """Renders a frame at each time with a new renderer, since all renderers together may not fit into memory."""
        renderer = Renderer(scene, size=size, devices=devices, **settings)
        return [renderer.render(at, index=index) for index, at in enumerate(times)][-1]

    path = [time - i / fps for i in reversed(range(frames))]
    errors = [compare(last(settings, path), reference) for settings in combinations]
    times_ms: list[list[float]] = [[] for _ in combinations]
    for turn in range(turns):
        for i in range(len(combinations)):
            i = (turn + i) % len(combinations)
            times_ms[i].append(_frame_ms(last(combinations[i], [time] * 3)))
    rows = Bench()
    for settings, found, of_turns in zip(combinations, errors, times_ms):
        low, high = _native.interval(of_turns) or (None, None)
        times = {"ms": median(of_turns), "ms_low": low, "ms_high": high}
        rows.append({key: _denoise.name(value) for key, value in settings.items()} | times | vars(found))
    return rows


def _frame_ms(frame: Frame) -> float:
    """Frame time, with that of a denoiser in Python and of the auxiliary images that it takes."""
    report = frame.report
    return report["makespan_ms"] + (report["aov_ms"] + report["denoiser_ms"] if "denoiser_ms" in report else 0.0)


def _views(image: Frame | Image) -> list[Image]:
    if isinstance(image, Frame):
        return list(image.views)
    return [np.ascontiguousarray(image, dtype=np.float32)]
