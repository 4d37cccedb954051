"""Errors against references, and tables of time and error."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from statistics import median
from typing import Any

import numpy as np

from . import _native, _renderer
from ._frame import Frame, Image
from ._renderer import Devices, Renderer, Scene


@dataclass(frozen=True)
class Errors:
    """Errors of an image, as `diptych compare` defines them; None where an error is undefined.

    Those of two eyes are means.
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
    """Compares a frame or an eye's image with a reference.

    By default, frames are compared at their exposure, and arrays at 0 stops.
    """
    if exposure_ev is None:
        exposure_ev = reference.exposure_ev if isinstance(reference, Frame) else 0.0
    pairs = zip(_eyes(reference), _eyes(image), strict=True)
    eyes = [dict(_native.errors(*pair, exposure_ev=exposure_ev)) for pair in pairs]

    def mean(name: str) -> Any:
        values = [eye[name] for eye in eyes]
        known = [value for value in values if value is not None]
        return sum(known) / len(known) if len(known) == len(values) else None

    return Errors(**{name: mean(name) for name in eyes[0]})


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
    time: float = 0.0,
    fps: float = 72.0,
    size: tuple[int, int] | None = None,
    devices: int | Devices = 1,
    **options: Any,
) -> Bench:
    """Measures time and error of every combination of options. A list as an option's value is a set of settings.

    Each combination renders `frames` frames of the camera's path, of which the last, at `time`, is compared with the
    reference. `ms` is the median frame time.
    """
    reference = reference or _renderer.reference(scene, reference_spp, size=size, devices=devices, time=time)
    grid = {name: value if isinstance(value, (list, tuple)) else [value] for name, value in options.items()}
    rows = Bench()
    for values in product(*grid.values()):
        settings = dict(zip(grid, values))
        renderer = Renderer(scene, size=size, devices=devices, **settings)
        rendered = [renderer.render(time - i / fps, index=frames - 1 - i) for i in reversed(range(frames))]
        errors = compare(rendered[-1], reference)
        ms = median(frame.report["makespan_ms"] for frame in rendered)
        rows.append(settings | {"ms": ms} | vars(errors))
    return rows


def _eyes(image: Frame | Image) -> list[Image]:
    if isinstance(image, Frame):
        return [image.left, image.right]
    return [np.ascontiguousarray(image, dtype=np.float32)]
