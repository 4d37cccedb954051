"""The extension module, written in Rust. Use the package `diptych`."""

from os import PathLike
from typing import Any, Callable, final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import Self

_Image = NDArray[np.float32]

__all__ = [
    "__version__",
    "Scene",
    "Renderer",
    "Frame",
    "Player",
    "FrameDenoiser",
    "load",
    "reference",
    "errors",
    "flip_map",
    "interval",
    "write_exr",
    "read_exr",
    "read_trace",
    "show_in_tev",
]
__version__: str

@final
class Scene:
    path_s: tuple[float, float]
    def info_json(self) -> str: ...

@final
class Frame:
    views: list[_Image]
    exposure_ev: float
    library_ms: float
    report_json: str
    aovs: list[str]
    size: tuple[int, int]
    def channels(self, name: str) -> list[str]: ...
    def aov(self, name: str) -> list[_Image]: ...
    def display(self) -> list[NDArray[np.uint8]]: ...
    def png(self) -> bytes: ...
    def with_light(self, views: list[_Image]) -> Self: ...
    def write_exr(self, path: str | PathLike[str], view: int, image: _Image, name: str | None = None) -> None: ...

@final
class Renderer:
    def __new__(cls, scene: Scene, *, policy: Any = None, **options: Any) -> Self: ...
    def render(
        self,
        time: float = 0.0,
        *,
        index: int | None = None,
        warm_up: int = 0,
        position: tuple[float, ...] | None = None,
        target: tuple[float, ...] | None = None,
        up: tuple[float, ...] | None = ...,
    ) -> Frame: ...
    def begin_anew(self) -> None: ...
    def devices_json(self) -> str: ...

@final
class Player:
    ladder_json: str
    def __new__(
        cls,
        renderer: Renderer,
        budget_ms: tuple[float, float],
        frames: int | None,
        *,
        fps: float = 72.0,
        time: float = 0.0,
        motion: str | None = None,
        pace: bool = False,
        controller: Any = None,
    ) -> Self: ...
    def __next__(self) -> Frame: ...
    def spend(self, ms: float) -> None: ...
    def close(self) -> None: ...

_Axes = list[tuple[float, float, float]]
_View = tuple[list[_Image], list[_Image | None], _Axes, float]

@final
class FrameDenoiser:
    def __new__(
        cls,
        width: int,
        height: int,
        views: int,
        iterations: int,
        spp: int,
        animated: bool,
        exposure_ev: float,
        adapter: int | None,
    ) -> Self: ...
    def denoise(self, views: list[_View]) -> list[_Image]: ...
    def reset(self) -> None: ...

def load(shot: str | dict[str, Any], **options: Any) -> Scene: ...
def reference(
    scene: Scene,
    spp: int = 256,
    *,
    time: float = 0.0,
    index: int = 0,
    time_limit: float | None = None,
    progress: Callable[[int, int], Any] | None = None,
    **options: Any,
) -> Frame: ...
def errors(reference: _Image, image: _Image, exposure_ev: float) -> list[tuple[str, float | None]]: ...
def flip_map(reference: _Image, image: _Image, exposure_ev: float) -> _Image: ...
def interval(values: list[float]) -> list[float] | None: ...
def write_exr(path: str | PathLike[str], array: _Image) -> None: ...
def read_exr(path: str | PathLike[str]) -> _Image: ...
def show_in_tev(address: str, name: str, image: _Image, channels: list[str]) -> None: ...
def read_trace(path: str | PathLike[str]) -> str: ...
