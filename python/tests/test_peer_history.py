"""The history that `make peers HISTORY=1` gives to Mitsuba."""

import importlib.util
from pathlib import Path

import numpy as np

HISTORY = Path(__file__).parents[2] / "docs/results/peers/history.py"
WIDTH, HEIGHT = 8, 6


def module():
    spec = importlib.util.spec_from_file_location("peer_history", HISTORY)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def wall(history, x):
    """A camera at `x` in front of a wall on which a pixel is a unit wide, and the wall's images."""
    camera = history.Camera([x, 0.0, 3.0], [x, 0.0, 0.0], [0.0, 1.0, 0.0], 90.0)
    columns = np.arange(WIDTH) - (WIDTH - 1) / 2 + x
    rows = (HEIGHT - 1) / 2 - np.arange(HEIGHT)
    position = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    position[..., 0], position[..., 1] = np.meshgrid(columns, rows)
    normal = np.broadcast_to(np.float32([0.0, 0.0, 1.0]), position.shape)
    return camera, position, normal


def test_projection_finds_pixels():
    history = module()
    camera, position, _ = wall(history, 2.0)
    x, y, depth = camera.pixels(position, WIDTH, HEIGHT)
    assert np.allclose(x, np.arange(WIDTH)[None, :]) and np.allclose(y, np.arange(HEIGHT)[:, None])
    assert np.allclose(depth, 3.0)


def test_frames_of_a_camera_at_rest_are_averaged():
    history = module()
    camera, position, normal = wall(history, 0.0)
    albedo = np.full_like(position, 0.5)
    of_eye, total = history.History(), 0.0
    for number, value in enumerate([1.0, 4.0, 2.0, 5.0], 1):
        total += value
        mean = of_eye.add(camera, np.full_like(position, value), albedo, normal, position)
        assert np.allclose(mean, total / number), number
    for _ in range(40):
        mean = of_eye.add(camera, np.zeros_like(position), albedo, normal, position)
    # No more than the last frames count, so that old light fades.
    assert mean.max() < 3.0 * (1 - 1 / history.LONGEST) ** 20


def test_history_moves_with_surfaces():
    history = module()
    of_eye = history.History()
    pattern = np.random.default_rng(1).random((HEIGHT, WIDTH + 1, 3), np.float32)
    for x in (0, 1):
        camera, position, normal = wall(history, float(x))
        color = pattern[:, x : x + WIDTH] * (1 + x)
        mean = of_eye.add(camera, color, np.ones_like(position), normal, position)
    # What both frames show is their mean, and the last column is new.
    assert np.allclose(mean[:, :-1], 1.5 * pattern[:, 1:WIDTH], rtol=1e-4)
    assert np.allclose(mean[:, -1], 2.0 * pattern[:, WIDTH], rtol=1e-4)


def test_other_surfaces_begin_anew():
    history = module()
    camera, position, normal = wall(history, 0.0)
    grey = np.full_like(position, 0.5)
    lamp, behind, turned = grey.copy(), position.copy(), normal.copy()
    lamp[0, 0], behind[1, 1, 2], turned[2, 2] = 0.9, -0.5, [1.0, 0.0, 0.0]
    of_eye = history.History()
    of_eye.add(camera, np.ones_like(position), grey, normal, position)
    mean = of_eye.add(camera, np.full_like(position, 3.0), lamp, turned, behind)
    expected = np.full_like(position, 2.0)
    for at in ((0, 0), (1, 1), (2, 2)):
        expected[at] = 3.0
    assert np.allclose(mean, expected, rtol=1e-5)
