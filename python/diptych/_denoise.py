"""Denoisers that are functions of arrays."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from ._frame import Camera, Frame, Image

AOVS = ("base_color", "normal", "position", "motion")
"""Auxiliary images that a denoiser takes, in this order."""

DenoiserFunction = Callable[[Image, Image, Image, Image, Image, Camera], Any]
"""Denoises a view: colour, albedo, normal, position, motion and camera to colour.

Images are float32 of the shape (height, width, channels), as those of `Frame`; `motion` has two channels.
"""


def split(options: dict[str, Any]) -> tuple[DenoiserFunction | None, dict[str, Any]]:
    """Takes a function out of the options of a renderer, which then renders what the function needs."""
    denoiser = options.get("denoiser")
    if not callable(denoiser):
        return None, options
    given = options.get("aov") or []
    given = given.split(",") if isinstance(given, str) else list(given)
    return denoiser, options | {"denoiser": "none", "aov": given + [aov for aov in AOVS if aov not in given]}


def name(denoiser: Any) -> Any:
    """Name of a denoiser in tables."""
    return getattr(denoiser, "__name__", type(denoiser).__name__) if callable(denoiser) else denoiser


def denoise(frame: Frame, denoiser: DenoiserFunction) -> Frame:
    """Denoises all views. The report has the time that this takes, as `denoiser_ms`."""
    begin = time.perf_counter()
    albedo, normal, position, motion = (frame.aov(aov) for aov in AOVS)
    views = []
    for colour, *guides in zip(frame.views, albedo, normal, position, motion, frame.cameras):
        denoised = np.ascontiguousarray(denoiser(colour, *guides), np.float32)
        if denoised.shape != colour.shape:
            text = f"the denoiser {name(denoiser)} returned the shape {denoised.shape}, not {colour.shape}"
            raise ValueError(text)
        views.append(denoised)
    ms = (time.perf_counter() - begin) * 1e3
    denoised_frame = Frame(frame._native.with_light(views))
    denoised_frame.report["denoiser_ms"] = ms
    return denoised_frame
