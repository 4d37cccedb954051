"""The extension module, written in Rust. Use the package `diptych`."""

from os import PathLike
from typing import Any, Callable

import numpy as np
from numpy.typing import NDArray

__version__: str

Image = NDArray[np.float32]

class Scene:
    path_s: tuple[float, float]
    def info_json(self) -> str: ...

class Frame:
    left: Image
    right: Image
    exposure_ev: float
    library_ms: float
    report_json: str
    aovs: list[str]
    size: tuple[int, int]
    def aov(self, name: str) -> list[Image]: ...
    def display(self) -> list[NDArray[np.uint8]]: ...
    def png(self) -> bytes: ...

class Renderer:
    size: tuple[int, int]
    def __init__(self, scene: Scene, **options: Any) -> None: ...
    def render(
        self,
        time: float = 0.0,
        *,
        index: int | None = None,
        warm_up: int = 0,
        position: tuple[float, ...] | None = None,
        target: tuple[float, ...] | None = None,
        up: tuple[float, ...] | None = None,
    ) -> Frame: ...
    def begin_anew(self) -> None: ...
    def devices_json(self) -> str: ...

class Player:
    def __init__(
        self,
        renderer: Renderer,
        budget_ms: tuple[float, float],
        frames: int | None,
        *,
        fps: float = 72.0,
        time: float = 0.0,
        motion: str | None = None,
        pace: bool = False,
    ) -> None: ...
    def __iter__(self) -> Player: ...
    def __next__(self) -> Frame: ...
    def close(self) -> None: ...

def load(shot: str, **options: Any) -> Scene: ...
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
def errors(reference: Image, image: Image, exposure_ev: float = 0.0) -> list[tuple[str, float | None]]: ...
def flip_map(reference: Image, image: Image, exposure_ev: float = 0.0) -> Image: ...
def write_exr(path: str | PathLike[str], array: Image) -> None: ...
def read_exr(path: str | PathLike[str]) -> Image: ...
