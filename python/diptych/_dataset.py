"""Data sets of stereo pairs, and of more views."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np

from ._renderer import Renderer, Scene


def dataset(
    scene: Scene,
    poses: Iterable[float | dict[str, Any]],
    out: str | os.PathLike[str],
    *,
    aovs: Sequence[str] = ("depth", "normal", "motion"),
    spp: int = 64,
    format: Literal["npz", "exr"] = "npz",
    **options: Any,
) -> int:
    """Writes the views of each pose with exact ground truth, and returns the number of poses.

    A pose is a time in seconds, or a dict with `position` and `target`, and `up` and `time` if they differ from the
    defaults. Frames are not filtered unless you give a `denoiser`; all views are traced unless you give
    `reproject=True`.

    A pose has one NPZ file with the arrays `left` and `right`, `disparity_left` and `disparity_right`, `NAME_left` and
    `NAME_right` for each auxiliary image, and `world_to_camera` and `world_to_ndc` of both eyes. Other numbers of views
    are named `view00`, `view01` and so on, in place of `left` and `right`; a single one has no disparity. With the
    format `exr`, there is one EXR file for each image, such as `000000.left.exr` and `000000.left.disparity.exr`, with
    the same values.
    """
    if format not in ("npz", "exr"):
        raise ValueError(f"format is 'npz' or 'exr', not {format!r}")
    os.makedirs(out, exist_ok=True)
    needed = list(dict.fromkeys([*aovs, "position", "depth"]))
    settings: dict[str, Any] = {"denoiser": "none", "reproject": False} | options
    renderer = Renderer(scene, spp=spp, aov=needed, **settings)
    count = 0
    for count, pose in enumerate(poses, 1):
        renderer.begin_anew()
        frame = renderer.render(**pose) if isinstance(pose, dict) else renderer.render(pose)
        views, has_disparity = frame.views.names, len(frame.views) > 1
        if format == "exr":
            frame.save_exr(out, f"{count - 1:06}.", aovs=[*aovs, "disparity"] if has_disparity else aovs)
            continue
        arrays: dict[str, Any] = dict(zip(views, frame.views))
        images = {name: frame.aov(name) for name in aovs} | ({"disparity": frame.disparity()} if has_disparity else {})
        for name, of_views in images.items():
            arrays |= {f"{name}_{view}": image for view, image in zip(views, of_views)}
        arrays["world_to_camera"] = np.stack([camera.world_to_camera for camera in frame.cameras])
        arrays["world_to_ndc"] = np.stack([camera.world_to_ndc for camera in frame.cameras])
        np.savez_compressed(os.path.join(out, f"{count - 1:06}.npz"), **arrays)
    return count
