"""Stereo frames by real-time path tracing, as NumPy arrays.

    import diptych as dp

    scene = dp.load("builtin:cornell")
    renderer = dp.Renderer(scene, size=(320, 180), devices=dp.virtual(2))
    frame = renderer.render(time=0.0)
    frame.left, frame.right  # float32 of the shape (height, width, 3), scene-referred linear RGB

Options have the names and the defaults of the command line, with underscores: `render_scale=0.5` is `--render-scale 0.5`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

# Mesa's device-selection layer prints an error on every start without a Wayland server. Drivers read the environment
# when a device is opened.
if sys.platform.startswith("linux") and "XDG_RUNTIME_DIR" not in os.environ:
    os.environ.setdefault("NODEVICE_SELECT", "1")

from . import _native  # noqa: E402

__version__ = _native.__version__
__all__ = [
    "Bench",
    "Camera",
    "Devices",
    "Errors",
    "Frame",
    "Player",
    "Renderer",
    "Scene",
    "Stereo",
    "bench",
    "compare",
    "dataset",
    "flip",
    "load",
    "read_exr",
    "reference",
    "virtual",
    "write_exr",
]

Image = NDArray[np.float32]

read_exr = _native.read_exr
write_exr = _native.write_exr


class Stereo(NamedTuple):
    """A value for each eye."""

    left: Any
    right: Any


@dataclass(frozen=True)
class Devices:
    """A choice of devices: `virtual` devices on each adapter, and the numbers of the adapters (all hardware GPUs by default)."""

    virtual: int = 1
    adapters: Sequence[int] | None = None
    threads_per_device: int | Sequence[int] | None = None

    def options(self) -> dict[str, Any]:
        return {"virtual": self.virtual, "devices": self.adapters, "threads_per_device": self.threads_per_device}


def virtual(count: int, *, threads_per_device: int | Sequence[int] | None = None) -> Devices:
    """Several devices on each adapter."""
    return Devices(count, threads_per_device=threads_per_device)


@dataclass(frozen=True)
class Camera:
    """The camera of an eye's image. Matrices transform row vectors: `point @ world_to_ndc`, with a 1 as the fourth component."""

    world_to_camera: NDArray[np.float64]
    """World to eye, in scene units: x to the right, y up, z along the view."""
    world_to_ndc: NDArray[np.float64]
    """World to image: after division by w, (0, 0) is its top left corner and (1, 1) its bottom right one."""
    width: int
    height: int

    @property
    def position(self) -> NDArray[np.float64]:
        """Position of the eye in the world, scene units."""
        turn = self.world_to_camera[:3, :3]
        return -self.world_to_camera[3, :3] @ np.linalg.inv(turn)

    @property
    def intrinsics(self) -> NDArray[np.float64]:
        """The matrix K of a pinhole camera with x to the right, y down and z along the view: `K @ point` is in pixels times z."""
        to_ndc = np.linalg.inv(self.world_to_camera) @ self.world_to_ndc
        pixels = np.array([self.width, self.height, 1.0])
        rows = to_ndc[:3][:, [0, 1, 3]].T * pixels[:, None]
        return rows * np.array([1.0, -1.0, 1.0])

    def project(self, points: NDArray[Any]) -> NDArray[np.float64]:
        """Positions of world-space points in the image, in pixels from its top left corner. The centre of the first pixel is (0.5, 0.5)."""
        points = np.asarray(points, dtype=np.float64)
        clip = points @ self.world_to_ndc[:3] + self.world_to_ndc[3]
        with np.errstate(divide="ignore", invalid="ignore"):
            return clip[..., :2] / clip[..., 3:] * np.array([self.width, self.height])


class Scene:
    """A loaded scene. `load` makes one. Several renderers can share it."""

    def __init__(self, native: _native.Scene):
        self._native = native

    @property
    def info(self) -> dict[str, Any]:
        """Description of the scene, as in run.json."""
        return json.loads(self._native.info_json())

    @property
    def path_s(self) -> tuple[float, float]:
        """Times at which the camera's path begins and ends, seconds."""
        return self._native.path_s

    def __repr__(self) -> str:
        info = self.info
        return f"<diptych.Scene {info['name']!r}: {info['triangles']} triangles>"


class Frame:
    """A rendered frame. Its arrays keep their values when further frames are rendered."""

    def __init__(self, native: _native.Frame):
        self._native = native
        self.left: Image = native.left
        """Left eye: scene-referred linear RGB, float32 of the shape (height, width, 3)."""
        self.right: Image = native.right
        """Right eye."""
        self._report: dict[str, Any] | None = None

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

    def aov(self, name: str) -> Stereo:
        """Auxiliary image of both eyes: float32 of the shape (height, width, channels), or (height, width) for one channel."""
        return Stereo(*(image[..., 0] if image.shape[2] == 1 else image for image in self._native.aov(name)))

    @property
    def cameras(self) -> Stereo:
        """`Camera` of each eye."""
        width, height = self._native.size
        eyes = [self.report["cameras"][eye] for eye in ("left", "right")]
        matrices = [(np.array(eye["world_to_camera"]), np.array(eye["world_to_ndc"])) for eye in eyes]
        return Stereo(*(Camera(*of_eye, width, height) for of_eye in matrices))

    def disparity(self) -> Stereo:
        """Disparity of each eye's pixels, float32 in pixels: the position in the left image minus that in the right one.

        It is exact, since it comes from the positions of surfaces: the renderer needs `aov=["position", "depth"]`. It
        is positive for surfaces in front of the eyes, and NaN for the sky.
        """
        positions, depths, cameras = self.aov("position"), self.aov("depth"), self.cameras
        eyes = []
        for position, depth in zip(positions, depths):
            left, right = (camera.project(position)[..., 0] for camera in cameras)
            eyes.append(np.where(depth > 0, left - right, np.nan).astype(np.float32))
        return Stereo(*eyes)

    def display(self) -> Stereo:
        """Picture of each eye, tonemapped: uint8 of the shape (height, width, 3)."""
        return Stereo(*self._native.display())

    def _repr_png_(self) -> bytes:
        return self._native.png()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes both eyes side by side as a PNG file."""
        with open(path, "wb") as file:
            file.write(self._native.png())

    def __repr__(self) -> str:
        width, height = self._native.size
        return f"<diptych.Frame {width}x{height}>"


class Player:
    """Iterator over the frames of a sequence inside a frame budget. `Renderer.play` makes one."""

    def __init__(self, native: _native.Player):
        self._native = native

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        return Frame(next(self._native))

    def close(self) -> None:
        """Ends the sequence. The renderer then has its devices back."""
        self._native.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class Renderer:
    """Renders frames of a scene. Options are those of `diptych render`, such as `spp=4` or `denoiser="none"`."""

    def __init__(
        self,
        scene: Scene,
        *,
        size: tuple[int, int] = (640, 360),
        devices: int | Devices = 1,
        **options: Any,
    ):
        self._native = _native.Renderer(scene._native, size=size, **_devices(devices), **options)
        self.scene = scene

    def render(
        self,
        time: float = 0.0,
        *,
        index: int | None = None,
        warm_up: int = 0,
        position: Sequence[float] | None = None,
        target: Sequence[float] | None = None,
        up: Sequence[float] = (0.0, 1.0, 0.0),
    ) -> Frame:
        """Renders a frame at a time in seconds: of the camera's path, or from `position` towards `target`, scene units.

        `index` keys the random numbers; it grows by 1 from frame to frame. `warm_up` frames of the same instant come
        first and give the denoiser a history, which otherwise consists of the frames rendered before.
        """
        pose = {"position": _triple(position), "target": _triple(target), "up": _triple(up)}
        return Frame(self._native.render(time, index=index, warm_up=warm_up, **pose))

    def play(
        self,
        budget_ms: tuple[float, float] = (11.0, 20.0),
        frames: int | None = None,
        *,
        fps: float = 72.0,
        time: float = 0.0,
        motion: str | os.PathLike[str] | None = None,
        pace: bool = False,
    ) -> Player:
        """Renders a sequence. The control loop sets the quality of each frame to keep frame times inside the budget.

        The camera follows its path, or the head motion in the file `motion`. The clock advances by 1 / `fps` with each
        frame and stands still in between; with `pace` it follows the time of day, and frames count the display periods
        that they miss. Close the player before you use the renderer again; the end of the sequence closes it too.
        """
        path = None if motion is None else os.fspath(motion)
        return Player(_native.Player(self._native, budget_ms, frames, fps=fps, time=time, motion=path, pace=pace))

    def begin_anew(self) -> None:
        """Discards the denoiser's history."""
        self._native.begin_anew()

    @property
    def devices(self) -> list[dict[str, Any]]:
        """Devices of the renderer, as in run.json."""
        return json.loads(self._native.devices_json())


def load(shot: str | os.PathLike[str], **options: Any) -> Scene:
    """Loads `builtin:NAME`, a shot (.toml) or a scene (.gltf, .glb). Options are those of a scene, such as `environment="sky"`."""
    return Scene(_native.load(os.fspath(shot), **options))


def reference(
    scene: Scene,
    spp: int = 256,
    *,
    size: tuple[int, int] = (640, 360),
    devices: int | Devices = 1,
    time: float = 0.0,
    time_limit: float | None = None,
    progress: Callable[[int, int], Any] | None = None,
    **options: Any,
) -> Frame:
    """Renders an unbiased reference: both eyes are traced, and nothing is filtered.

    `progress` is called after each pass with the number of samples per pixel so far and their total.
    """
    options |= _devices(devices) | {"size": size}
    native = _native.reference(scene._native, spp, time=time, time_limit=time_limit, progress=progress, **options)
    return Frame(native)


@dataclass(frozen=True)
class Errors:
    """Errors of an image, as `diptych compare` defines them; None where an error is undefined. Those of two eyes are means."""

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
    """Compares a frame or an eye's image with a reference. By default, frames are compared at their exposure, and arrays at 0 stops."""
    if exposure_ev is None:
        exposure_ev = reference.exposure_ev if isinstance(reference, Frame) else 0.0
    pairs = zip(_eyes(reference), _eyes(image), strict=True)
    eyes = [dict(_native.errors(*pair, exposure_ev=exposure_ev)) for pair in pairs]

    def mean(name: str) -> float | None:
        values = [eye[name] for eye in eyes]
        return None if None in values else sum(values) / len(values)

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
    size: tuple[int, int] = (640, 360),
    devices: int | Devices = 1,
    **options: Any,
) -> Bench:
    """Measures time and error of every combination of options. A list as an option's value is a set of settings.

    Each combination renders `frames` frames of the camera's path, of which the last, at `time`, is compared with the
    reference. `ms` is the median frame time.
    """
    from itertools import product
    from statistics import median

    reference = reference or globals()["reference"](scene, reference_spp, size=size, devices=devices, time=time)
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


def dataset(
    scene: Scene,
    poses: Iterable[float | dict[str, Any]],
    out: str | os.PathLike[str],
    *,
    aovs: Sequence[str] = ("depth", "normal", "motion"),
    spp: int = 64,
    **options: Any,
) -> int:
    """Writes stereo pairs with exact ground truth, one NPZ file for each pose; returns their number.

    A pose is a time in seconds, or a dict with `position` and `target`, and `up` and `time` if they differ from the
    defaults. Files have the arrays `left` and `right`, `disparity_left` and `disparity_right`, `NAME_left` and
    `NAME_right` for each auxiliary image, and `world_to_camera` and `world_to_ndc` of both eyes. Frames are not
    filtered unless you give a `denoiser`; both eyes are traced unless you give `reproject=True`.
    """
    os.makedirs(out, exist_ok=True)
    needed = list(dict.fromkeys([*aovs, "position", "depth"]))
    options = {"denoiser": "none", "reproject": False} | options
    renderer = Renderer(scene, spp=spp, aov=needed, **options)
    count = 0
    for count, pose in enumerate(poses, 1):
        renderer.begin_anew()
        frame = renderer.render(**pose) if isinstance(pose, dict) else renderer.render(pose)
        arrays: dict[str, NDArray[Any]] = {"left": frame.left, "right": frame.right}
        images = {name: frame.aov(name) for name in aovs} | {"disparity": frame.disparity()}
        for name, eyes in images.items():
            arrays |= {f"{name}_left": eyes.left, f"{name}_right": eyes.right}
        arrays["world_to_camera"] = np.stack([camera.world_to_camera for camera in frame.cameras])
        arrays["world_to_ndc"] = np.stack([camera.world_to_ndc for camera in frame.cameras])
        np.savez_compressed(os.path.join(out, f"{count - 1:06}.npz"), **arrays)
    return count


def _devices(devices: int | Devices) -> dict[str, Any]:
    return (virtual(devices) if isinstance(devices, int) else devices).options()


def _eyes(image: Frame | Image) -> list[Image]:
    if isinstance(image, Frame):
        return [image.left, image.right]
    return [np.ascontiguousarray(image, dtype=np.float32)]


def _triple(vector: Sequence[float] | None) -> tuple[float, ...] | None:
    return None if vector is None else tuple(float(part) for part in vector)
