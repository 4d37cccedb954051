"""Frames and their cameras."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native, _sinks

Image = NDArray[np.float32]


class PerView(tuple[Any, ...]):
    """A value for each view, from left to right. Two views are the eyes."""

    __slots__ = ()

    @property
    def left(self) -> Any:
        """Value of the left one of two eyes."""
        return self._eyes()[0]

    @property
    def right(self) -> Any:
        """Value of the right one of two eyes."""
        return self._eyes()[1]

    @property
    def names(self) -> list[str]:
        """Names of the views in files: `left` and `right`, or `view00`, `view01` and so on."""
        return ["left", "right"] if len(self) == 2 else [f"view{number:02}" for number in range(len(self))]

    def _eyes(self) -> PerView:
        if len(self) != 2:
            raise AttributeError(f"only two views are left and right: index these {len(self)} from the left")
        return self


@dataclass(frozen=True)
class Camera:
    """The camera of a view.

    Matrices transform row vectors: `point @ world_to_ndc`, with a 1 as the fourth component.
    """

    world_to_camera: NDArray[np.float64]
    """World to camera, in scene units: x to the right, y up, z along the view."""
    world_to_ndc: NDArray[np.float64]
    """World to image: after division by w, (0, 0) is its top left corner and (1, 1) its bottom right one."""
    width: int
    height: int
    eye: str = "left"
    """Name of the view: `left`, `right`, or `view07`, for example."""

    @classmethod
    def look_at(
        cls,
        position: Sequence[float],
        target: Sequence[float],
        *,
        yfov_deg: float,
        size: tuple[int, int],
        up: Sequence[float] = (0.0, 1.0, 0.0),
        eye: str = "left",
    ) -> Camera:
        """Camera at a position that looks at a target, with square pixels. `size` is (width, height)."""
        at = np.asarray(position, np.float64)
        forward = np.asarray(target, np.float64) - at
        right = np.cross(forward, np.asarray(up, np.float64))
        lengths = np.linalg.norm(forward), np.linalg.norm(right)
        if not (np.isfinite(lengths).all() and min(lengths) > 0 and 0 < yfov_deg < 180):
            raise ValueError("position and target must differ, up must not be parallel to the view, yfov_deg below 180")
        z, x = forward / lengths[0], right / lengths[1]
        axes = np.stack([x, np.cross(x, z), z])
        to_camera = np.eye(4)
        to_camera[:3, :3], to_camera[3, :3] = axes.T, -axes @ at
        tan_y = np.tan(np.radians(yfov_deg) / 2)
        tan_x = tan_y * size[0] / size[1]
        to_ndc = np.zeros((4, 4))
        to_ndc[0, 0], to_ndc[2, 0] = 0.5 / tan_x, 0.5
        to_ndc[1, 1], to_ndc[2, 1] = -0.5 / tan_y, 0.5
        to_ndc[3, 2] = to_ndc[2, 3] = 1.0
        return cls(to_camera, to_camera @ to_ndc, *size, eye)

    @property
    def position(self) -> NDArray[np.float64]:
        """Position in the world, scene units."""
        turn = self.world_to_camera[:3, :3]
        return -self.world_to_camera[3, :3] @ np.linalg.inv(turn)

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """The matrix K of a pinhole camera with x to the right, y down and z along the view.

        `K @ point` is in pixels times z.
        """
        to_ndc = np.linalg.inv(self.world_to_camera) @ self.world_to_ndc
        pixels = np.array([self.width, self.height, 1.0])
        rows = to_ndc[:3][:, [0, 1, 3]].T * pixels[:, None]
        return rows * np.array([1.0, -1.0, 1.0])

    def project(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Positions of world-space points in the image, in pixels from its top left corner.

        The centre of the first pixel is (0.5, 0.5).
        """
        points = np.asarray(points, dtype=np.float64)
        clip = points @ self.world_to_ndc[:3] + self.world_to_ndc[3]
        with np.errstate(divide="ignore", invalid="ignore"):
            return clip[..., :2] / clip[..., 3:] * np.array([self.width, self.height])


class Frame:
    """A rendered frame. Its arrays keep their values when further frames are rendered."""

    def __init__(self, native: _native.Frame):
        self._native = native
        self.views = PerView(native.views)
        """Views from left to right: scene-referred linear RGB, float32 of the shape (height, width, 3)."""
        self._report: dict[str, Any] | None = None

    @property
    def left(self) -> Image:
        """Left one of two eyes, `views[0]`."""
        return self.views.left

    @property
    def right(self) -> Image:
        """Right one of two eyes, `views[1]`."""
        return self.views.right

    @property
    def report(self) -> dict[str, Any]:
        """Entry of the frame in run.json: times, rays, quality, cameras, the control loop's decision."""
        if self._report is None:
            self._report = json.loads(self._native.report_json)
        return self._report

    @property
    def exposure_ev(self) -> float:
        """Exposure of pictures, stops."""
        return self._native.exposure_ev

    @property
    def library_ms(self) -> float:
        """Time in milliseconds from Python's call until the images were in host memory."""
        return self._native.library_ms

    @property
    def aovs(self) -> list[str]:
        """Names of the auxiliary images."""
        return self._native.aovs

    def aov(self, name: str) -> PerView:
        """Auxiliary image of each view, float32.

        The shape is (height, width, channels), or (height, width) for one channel.
        """
        return PerView(image[..., 0] if image.shape[2] == 1 else image for image in self._native.aov(name))

    @property
    def cameras(self) -> PerView:
        """`Camera` of each view."""
        width, height = self._native.size
        cameras = zip(self.views.names, self.report["cameras"].values())
        matrices = [(name, np.array(of["world_to_camera"]), np.array(of["world_to_ndc"])) for name, of in cameras]
        return PerView(Camera(to_camera, to_ndc, width, height, name) for name, to_camera, to_ndc in matrices)

    def disparity(self) -> PerView:
        """Disparity of each view's pixels, float32 in pixels: the left image's position minus that in the right one.

        Of more than two views, these are the view and its neighbour on the right; the last one has that on the left.

        It is exact, since it comes from the positions of surfaces: the renderer needs `aov=["position", "depth"]`. It
        is positive for surfaces in front of the eyes, nearer than `convergence`, and NaN for the sky.
        """
        positions, depths, cameras = self.aov("position"), self.aov("depth"), self.cameras
        if len(cameras) < 2:
            raise ValueError("a single view has no disparity")
        views = []
        for number, (position, depth) in enumerate(zip(positions, depths)):
            first = min(number, len(cameras) - 2)
            left, right = (camera.project(position)[..., 0] for camera in cameras[first : first + 2])
            views.append(np.where(depth > 0, left - right, np.nan).astype(np.float32))
        return PerView(views)

    def display(self) -> PerView:
        """Picture of each view, tonemapped: uint8 of the shape (height, width, 3)."""
        return PerView(self._native.display())

    def _repr_png_(self) -> bytes:
        return self._native.png()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a PNG file: both eyes side by side, or more views in rows of four."""
        with open(path, "wb") as file:
            file.write(self._native.png())

    def save_exr(self, folder: str | os.PathLike[str], prefix: str = "", *, aovs: Sequence[str] | None = None) -> None:
        """Writes the arrays to EXR files in a folder, with cameras and times as attributes.

        Files have the names of `diptych render` after the prefix: `left.exr` and `left.depth.exr`, for example. `aovs`
        limits the auxiliary images; `disparity` may be among them.
        """
        images: dict[str | None, PerView] = {None: self.views}
        for aov in self.aovs if aovs is None else aovs:
            images[aov] = self.disparity() if aov == "disparity" else self.aov(aov)
        for name, views in images.items():
            for number, view in enumerate(views.names):
                file = f"{prefix}{view}.exr" if name is None else f"{prefix}{view}.{name}.exr"
                self._native.write_exr(os.path.join(folder, file), number, views[number], name)

    def to_tev(self, address: str = "127.0.0.1:14158", name: str = "diptych") -> None:
        """Shows all views and their auxiliary images in the viewer tev, which listens at HOST:PORT."""
        _sinks.to_tev(self, address, name)

    def to_rerun(self, path: str = "diptych") -> None:
        """Logs the views' pictures and cameras, and `depth` if the frame has it, with the package `rerun-sdk`."""
        _sinks.to_rerun(self, path)

    def __repr__(self) -> str:
        width, height = self._native.size
        return f"<diptych.Frame {width}x{height}>"
