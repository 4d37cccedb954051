"""Scenes, renderers and sequences."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from . import _denoise, _native, _sinks
from ._denoise import DenoiserFunction
from ._frame import Frame


@dataclass(frozen=True)
class Devices:
    """A choice of devices: `virtual` devices on each adapter, and the numbers of the adapters.

    By default, all hardware GPUs are used.
    """

    virtual: int = 1
    adapters: Sequence[int] | None = None
    threads_per_device: int | Sequence[int] | None = None

    def options(self) -> dict[str, Any]:
        return {"virtual": self.virtual, "devices": self.adapters, "threads_per_device": self.threads_per_device}


def virtual(count: int, *, threads_per_device: int | Sequence[int] | None = None) -> Devices:
    """Several devices on each adapter."""
    return Devices(count, threads_per_device=threads_per_device)


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


def _plain(value: Any, levels: int = 64) -> Any:
    """Replaces mappings, sequences and NumPy scalars by Python's own, in so many levels."""
    if levels == 0:
        return value
    if isinstance(value, Mapping):
        return {key: _plain(entry, levels - 1) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry, levels - 1) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def load(shot: str | os.PathLike[str] | Mapping[str, Any], **options: Any) -> Scene:
    """Loads `builtin:NAME`, a shot (.toml or a dict) or a scene (.gltf, .glb).

    A dict has the keys of a shot file, such as `{"scene": "model.glb", "exposure": {"ev": 1}}`. Paths in it are
    relative to the current folder. Options are those of a scene, such as `environment="sky"`.
    """
    return Scene(_native.load(_plain(shot) if isinstance(shot, Mapping) else os.fspath(shot), **options))


class Controller(Protocol):
    """Chooses the rungs of the frames of a sequence, see `Renderer.play`. The method `observe` may be missing."""

    def next(self, predicted_ms: list[float]) -> int:
        """Returns the index of the next frame's rung, given the predicted frame times of all rungs."""

    def observe(self, rung: int, frame_ms: float) -> None:
        """Takes the measured time of a finished frame: its makespan, and the host's time before and after."""


Policy = Callable[[NDArray[np.float64], int], Iterable[int]]


class Player:
    """Iterator over the frames of a sequence inside a frame budget. `Renderer.play` makes one."""

    def __init__(self, native: _native.Player, denoiser: DenoiserFunction | None = None):
        self._native = native
        self._denoiser = denoiser

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        frame = Frame(next(self._native))
        if self._denoiser is None:
            return frame
        frame = _denoise.denoise(frame, self._denoiser)
        self._native.spend(frame.report["denoiser_ms"])
        return frame

    @property
    def ladder(self) -> list[dict[str, Any]]:
        """Rungs of the quality ladder, from the cheapest to the best: estimated time and error, and the settings."""
        return json.loads(self._native.ladder_json)

    def close(self) -> None:
        """Ends the sequence. The renderer then has its devices back."""
        self._native.close()

    def __enter__(self) -> Player:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class Renderer:
    """Renders frames of a scene. Options are those of `diptych render`, such as `spp=4` or `denoiser="none"`.

    By default, `size` is that of the shot's table `[render]`, else (640, 360).

    `policy` distributes the rows of each frame over the devices, in place of the option `balance`. It takes the
    predicted costs in milliseconds, an array of the shape (devices, rows), and the number of rows; it returns the
    number of rows of each device.

    `denoiser` may be a function of a view's arrays: colour, albedo, normal, position, motion and `Camera`. It returns
    the denoised colour. Its time for all views is `denoiser_ms` in the report of a frame.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        size: tuple[int, int] | None = None,
        devices: int | Devices = 1,
        policy: Policy | None = None,
        **options: Any,
    ):
        self._denoiser, options = _denoise.split(options)
        self._native = _native.Renderer(scene._native, policy=policy, size=size, **_devices(devices), **options)
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
        pose: dict[str, Any] = {"position": _triple(position), "target": _triple(target), "up": _triple(up)}
        if self._denoiser is None:
            return Frame(self._native.render(time, index=index, warm_up=warm_up, **pose))
        # A denoiser may keep a history, too.
        if warm_up > 0:
            self._native.begin_anew()
        for before in range(warm_up, -1, -1):
            number = None if index is None else (index - before) % 2**32
            frame = _denoise.denoise(Frame(self._native.render(time, index=number, **pose)), self._denoiser)
        return frame

    def play(
        self,
        budget_ms: tuple[float, float] = (11.0, 20.0),
        frames: int | None = None,
        *,
        fps: float = 72.0,
        time: float = 0.0,
        motion: str | os.PathLike[str] | None = None,
        pace: bool = False,
        controller: Controller | None = None,
    ) -> Player:
        """Renders a sequence of two views. The control loop sets quality to keep frame times inside the budget.

        The camera follows its path, or the head motion in the file `motion`. The clock advances by 1 / `fps` with each
        frame and stands still in between; with `pace` it follows the time of day, and frames count the display periods
        that they miss. Close the player before you use the renderer again; the end of the sequence closes it too.

        `controller` replaces the control loop: before each frame, its method `next` takes the predicted times of the
        ladder's rungs and returns the index of one; after it, `observe` takes the rung and the frame time. `ladder` of
        the player lists the rungs.
        """
        path = None if motion is None else os.fspath(motion)
        timing: dict[str, Any] = {"fps": fps, "time": time, "motion": path, "pace": pace}
        native = _native.Player(self._native, budget_ms, frames, controller=controller, **timing)
        return Player(native, self._denoiser)

    def view(self, time: float = 0.0) -> Any:
        """Returns an interactive view of all cameras, a widget for notebooks. It needs the package `jupyter_rfb`.

        Drag to turn, scroll or press W, A, S, D, Q, E to move. `pose` of the widget is the place seen from, for `render`.
        """
        return _sinks.view(self, time)

    def begin_anew(self) -> None:
        """Discards the denoiser's history."""
        self._native.begin_anew()

    @property
    def devices(self) -> list[dict[str, Any]]:
        """Devices of the renderer, as in run.json."""
        return json.loads(self._native.devices_json())


def reference(
    scene: Scene,
    spp: int = 256,
    *,
    size: tuple[int, int] | None = None,
    devices: int | Devices = 1,
    time: float = 0.0,
    time_limit: float | None = None,
    progress: Callable[[int, int], Any] | None = None,
    **options: Any,
) -> Frame:
    """Renders an unbiased reference: all views are traced, and nothing is filtered.

    `progress` is called after each pass with the number of samples per pixel so far and their total.
    """
    options |= _devices(devices) | {"size": size}
    native = _native.reference(scene._native, spp, time=time, time_limit=time_limit, progress=progress, **options)
    return Frame(native)


def _devices(devices: int | Devices) -> dict[str, Any]:
    return (virtual(devices) if isinstance(devices, int) else devices).options()


def _triple(vector: Sequence[float] | None) -> tuple[float, ...] | None:
    return None if vector is None else tuple(float(part) for part in vector)
