"""Other programs that show frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native

if TYPE_CHECKING:
    from ._frame import Frame
    from ._renderer import Renderer


def to_tev(frame: Frame, address: str, name: str) -> None:
    for number, view in enumerate(frame.views.names):
        names, images = ["R", "G", "B"], [frame.views[number]]
        for aov in frame.aovs:
            names += [f"{aov}.{channel}" for channel in frame._native.channels(aov)]
            images.append(frame._native.aov(aov)[number])
        _native.show_in_tev(address, f"{name} {view}", np.concatenate(images, axis=2), names)


def to_rerun(frame: Frame, path: str) -> None:
    import rerun as rr

    pictures = frame.display()
    for number, view in enumerate(frame.views.names):
        camera = frame.cameras[number]
        # Columns are the camera's axes in the world: x to the right, y down, z along the view.
        turn = camera.world_to_camera[:3, :3] * np.array([1.0, -1.0, 1.0])
        place = rr.Transform3D(translation=camera.position, mat3x3=turn)
        pinhole = rr.Pinhole(
            image_from_camera=camera.intrinsics,
            width=camera.width,
            height=camera.height,
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        rr.log(f"{path}/{view}", place, pinhole)
        rr.log(f"{path}/{view}/picture", rr.Image(pictures[number]))
        if "depth" in frame.aovs:
            rr.log(f"{path}/{view}/depth", rr.DepthImage(frame.aov("depth")[number], meter=1.0))


def view(renderer: Renderer, time: float) -> Any:
    """Makes the widget of `Renderer.view`."""
    from jupyter_rfb import RemoteFrameBuffer

    class _View(RemoteFrameBuffer):  # type: ignore[misc, unused-ignore]
        """All views, seen from a place that the pointer and keys change."""

        # Frames after a movement, in which the denoiser gathers history.
        SETTLING = 16
        # Radians per pixel, and metres per step.
        TURN = 0.005
        STEP = 0.1
        KEYS = {"w": (0, 0, 1), "s": (0, 0, -1), "d": (1, 0, 0), "a": (-1, 0, 0), "e": (0, 1, 0), "q": (0, -1, 0)}

        def __init__(self) -> None:
            super().__init__()
            cameras = renderer.render(time).cameras
            eyes = [camera.position for camera in cameras]
            forward = cameras[0].world_to_camera[:3, 2]
            self._position = (eyes[0] + eyes[-1]) / 2
            self._yaw, self._pitch = np.arctan2(forward[0], -forward[2]), np.clip(np.arcsin(np.clip(forward[1], -1, 1)), -1.5, 1.5)
            baseline = float(np.linalg.norm(eyes[-1] - eyes[0]))
            self._unit = baseline / 0.064 if baseline > 0 else 1.0
            self._left = self.SETTLING
            self._pointer: tuple[float, float] | None = None
            width, height = len(cameras) * cameras[0].width, cameras[0].height
            self.css_width, self.css_height, self.resizable = f"{width}px", f"{height}px", False

        @property
        def pose(self) -> dict[str, Any]:
            """Position and target of the view, for `Renderer.render`."""
            return {"position": tuple(self._position), "target": tuple(self._position + self._axes()[2])}

        def _axes(self) -> Any:
            """Right, up and forward."""
            across = np.cos(self._pitch)
            forward = np.array([across * np.sin(self._yaw), np.sin(self._pitch), -across * np.cos(self._yaw)])
            right = np.array([np.cos(self._yaw), 0.0, np.sin(self._yaw)])
            return np.array([right, np.cross(right, forward), forward])

        def _move(self, steps: Any) -> None:
            self._position = self._position + np.asarray(steps) * self.STEP * self._unit @ self._axes()

        def handle_event(self, event: dict[str, Any]) -> None:
            kind = event["event_type"]
            if kind == "pointer_move" and 1 in event.get("buttons", ()):
                if self._pointer is not None:
                    self._yaw += (event["x"] - self._pointer[0]) * self.TURN
                    pitch = self._pitch - (event["y"] - self._pointer[1]) * self.TURN
                    self._pitch = float(np.clip(pitch, -1.5, 1.5))
                self._pointer = (event["x"], event["y"])
            elif kind in ("pointer_down", "pointer_up"):
                self._pointer = None
                return
            elif kind == "wheel":
                self._move((0, 0, -event["dy"] / 100))
            elif kind == "key_down" and event["key"].lower() in self.KEYS:
                self._move(self.KEYS[event["key"].lower()])
            else:
                return
            self._left = self.SETTLING
            self.request_draw()

        def get_frame(self) -> Any:
            if self._left > 0:
                self._left -= 1
                self.request_draw()
            return np.hstack(renderer.render(time, **self.pose).display())

    return _View()
