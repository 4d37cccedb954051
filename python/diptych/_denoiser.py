"""The denoiser alone, for frames of any renderer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._frame import Camera, Image

# Largest relative difference at which pixels count as square and axes as orthonormal.
_TOLERANCE = 1e-3


class Denoiser:
    """Denoises frames of any renderer with `svgf`, and keeps the history from frame to frame.

    `size` is (width, height). With `views=2`, frames are stereo pairs, and the right view uses the left one's history
    where its own is missing. `iterations` is 1 to 10, `spp` the samples per pixel of a frame, `exposure_ev` the
    exposure in stops at which a radiance of 1 becomes white. `animated=True` is for surfaces that move: `denoise` then
    takes `last_position`. `adapter` is a number of `diptych info`.
    """

    def __init__(
        self,
        size: tuple[int, int],
        views: int = 2,
        iterations: int = 5,
        *,
        spp: int = 1,
        animated: bool = False,
        exposure_ev: float = 0.0,
        adapter: int | None = None,
    ):
        width, height = size
        if min(width, height, views, iterations, spp) < 1:
            raise ValueError("width, height, views, iterations and spp are at least 1")
        self.size: tuple[int, int] = (width, height)
        """Width and height of each view in pixels."""
        self.views: int = views
        """Number of views."""
        self._native = _native.FrameDenoiser(width, height, views, iterations, spp, animated, exposure_ev, adapter)

    def denoise(
        self,
        color: ArrayLike,
        albedo: ArrayLike,
        normal: ArrayLike,
        position: ArrayLike,
        last_position: ArrayLike | None = None,
        *,
        camera: Camera | Sequence[Camera],
        emission: ArrayLike | None = None,
    ) -> Image:
        """Denoises a frame, and returns its light as float32 of the shape of `color`.

        Arrays have the shape (height, width, 3) or, with two views, (2, height, width, 3). `color` is radiance and
        `albedo` the fraction of light that surfaces reflect, both linear RGB. `normal` and `position` are in world
        space. A pixel with the normal 0 or a position that is not finite shows no surface, and is not filtered.
        `last_position` is the position of the surface in the previous frame; without it, nothing has moved.
        `emission` is the part of `color` that surfaces and the sky emit; it is not filtered. `camera` is one for each
        view.
        """
        given = {"color": color, "albedo": albedo, "normal": normal, "position": position}
        arrays = [self._views_of(name, array) for name, array in given.items()]
        more = {"emission": emission, "last_position": last_position}
        optional = [None if array is None else self._views_of(name, array) for name, array in more.items()]
        cameras = [camera] if isinstance(camera, Camera) else list(camera)
        if len(cameras) != self.views:
            raise ValueError(f"there are {len(cameras)} cameras for {self.views} views")
        views: list[Any] = []
        for number, of_view in enumerate(cameras):
            images = [array[number] for array in arrays]
            others = [None if array is None else array[number] for array in optional]
            views.append((images, others, *self._pinhole(of_view)))
        denoised = self._native.denoise(views)
        return denoised[0] if self.views == 1 else np.stack(denoised)

    def reset(self) -> None:
        """Discards the history. Call it where the camera cuts to another place."""
        self._native.reset()

    def _views_of(self, name: str, given: ArrayLike) -> NDArray[np.float32]:
        """An array with one image for each view."""
        array = np.asarray(given)
        if array.dtype.kind not in "fiu":
            raise TypeError(f"{name} is an array of {array.dtype}, not of real numbers")
        (width, height), leading = self.size, () if self.views == 1 else (self.views,)
        if array.shape != (*leading, height, width, 3):
            raise ValueError(f"{name} has the shape {array.shape}, not {(*leading, height, width, 3)}")
        return np.ascontiguousarray(array, np.float32).reshape(self.views, height, width, 3)

    def _pinhole(self, camera: Camera) -> tuple[list[Any], float]:
        """Position, axes and tangent of half the vertical field of view of a camera."""
        if not isinstance(camera, Camera):
            raise TypeError(f"camera is a {type(camera).__name__}, not a diptych.Camera")
        if (camera.width, camera.height) != self.size:
            raise ValueError(f"the camera's image is {camera.width}x{camera.height}, not {self.size[0]}x{self.size[1]}")
        turn, k = camera.world_to_camera[:3, :3], camera.intrinsics
        if not np.allclose(turn.T @ turn, np.eye(3), atol=_TOLERANCE):
            raise ValueError("the camera's axes are not orthonormal")
        is_square = abs(k[0, 0] / k[1, 1] - 1) < _TOLERANCE
        offset = np.abs(k[:2, 2] / k[1, 1] - 0.5 * np.array(self.size) / k[1, 1])
        if not (is_square and (offset < _TOLERANCE).all()):
            raise ValueError("the camera's pixels are not square, or its view is not symmetric")
        return [camera.position.tolist(), *turn.T.tolist()], float(0.5 * camera.height / k[1, 1])
