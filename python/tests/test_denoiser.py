"""Tests of the denoiser alone."""

from pathlib import Path

import numpy as np
import pytest

import diptych as dp

SIZE = (64, 36)
PAGE = Path(__file__).parents[2] / "docs" / "guide" / "denoiser.md"
AOVS = ["emission", "albedo", "normal", "position"]


@pytest.fixture(scope="module")
def frames(scene):
    """Noisy frames: arrays of both eyes, and cameras."""
    renderer = dp.Renderer(scene, size=SIZE, denoiser="none", spp=2, reproject=False, aov=AOVS)
    rendered = [renderer.render(0.0, index=index) for index in range(8)]
    return [
        ({"color": (f.left, f.right)} | {name: f.aov(name) for name in AOVS}, f.cameras)  #
        for f in rendered
    ]


@pytest.fixture(scope="module")
def reference(scene):
    return dp.reference(scene, spp=128, size=SIZE)


def test_frames_are_denoised_with_history(frames, reference):
    denoiser = dp.Denoiser(SIZE, spp=2)
    images = [denoiser.denoise(**arrays, camera=cameras) for arrays, cameras in frames]
    assert all(image.shape == (2, 36, 64, 3) and image.dtype == np.float32 for image in images)
    for eye, right in enumerate((reference.left, reference.right)):
        compared = frames[-1][0]["color"][eye], images[0][eye], images[-1][eye]
        noisy, first, last = (float(np.sqrt(np.mean((image - right) ** 2))) for image in compared)
        # The last frame has 0.5 of either error.
        assert last < 0.65 * noisy and last < 0.7 * first, (noisy, first, last)
    denoiser.reset()
    arrays, cameras = frames[0]
    assert denoiser.denoise(**arrays, camera=cameras).tobytes() == images[0].tobytes()


def test_one_view_takes_images_of_any_real_type(frames):
    arrays, cameras = frames[0]
    left = {name: eyes[0] for name, eyes in arrays.items()}
    denoiser = dp.Denoiser(SIZE, views=1, spp=2)
    image = denoiser.denoise(**left, camera=cameras.left)
    denoiser.reset()
    doubles = {name: array.astype(np.float64)[:, ::-1][:, ::-1] for name, array in left.items()}
    assert image.shape == (36, 64, 3) and image.tobytes() == denoiser.denoise(**doubles, camera=[cameras.left]).tobytes()
    # Frames of animated scenes may tell where surfaces were.
    animated = dp.Denoiser(SIZE, views=1, spp=2, animated=True)
    told = animated.denoise(**left, last_position=left["position"], camera=cameras.left)
    animated.reset()
    assert told.tobytes() == animated.denoise(**left, camera=cameras.left).tobytes()


def test_a_camera_looks_at_its_target(frames, scene):
    _, cameras = frames[0]
    position, turn = cameras.left.position, cameras.left.world_to_camera[:3, :3]
    yfov_deg = 2 * np.degrees(np.arctan(0.5 * SIZE[1] / cameras.left.intrinsics[1, 1]))
    camera = dp.Camera.look_at(position, position + 3 * turn[:, 2], up=turn[:, 1], yfov_deg=yfov_deg, size=SIZE)
    assert np.allclose(camera.world_to_camera, cameras.left.world_to_camera, atol=1e-4)
    assert np.allclose(camera.world_to_ndc, cameras.left.world_to_ndc, atol=1e-4)
    with pytest.raises(ValueError, match="must differ"):
        dp.Camera.look_at((0, 0, 0), (0, 0, 0), yfov_deg=40, size=SIZE)


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"normal": np.zeros((36, 64, 3))}, ValueError, r"normal has the shape \(36, 64, 3\), not \(2, 36, 64, 3\)"),
        ({"albedo": np.zeros((2, 36, 64, 3), complex)}, TypeError, "albedo is an array of complex128"),
        ({"color": np.full((2, 36, 64, 3), np.nan)}, ValueError, "color of view 0 has 6912 values that are not finite"),
        ({"last_position": np.zeros((2, 36, 64, 3))}, ValueError, "last_position needs a denoiser of animated scenes"),
        ({"camera": dp.Camera.look_at((0, 0, 1), (0, 0, 0), yfov_deg=40, size=SIZE)}, ValueError, "1 cameras for 2"),
        ({"camera": [None, None]}, TypeError, "camera is a NoneType"),
        ({"camera": 2 * [dp.Camera.look_at((0, 0, 1), (0, 0, 0), yfov_deg=40, size=(8, 8))]}, ValueError, "8x8, not"),
        ({"camera": 2 * [dp.Camera(np.eye(4), np.eye(4), *SIZE)]}, ValueError, "singular|not square|not symmetric"),
    ],
)
def test_rejects_frames_that_do_not_fit(frames, change, error, text):
    arrays, cameras = frames[0]
    denoiser = dp.Denoiser(SIZE)
    with pytest.raises(error, match=text):
        denoiser.denoise(**({**arrays, "camera": cameras} | change))


@pytest.mark.parametrize("settings", [{"views": 3}, {"views": -1}, {"iterations": 11}, {"spp": 0}, {"adapter": 99}])
def test_rejects_settings_out_of_range(settings):
    with pytest.raises(ValueError):
        dp.Denoiser(SIZE, **settings)


def test_the_example_of_the_page_runs(capsys):
    (script, *_) = [block.split("```")[0] for block in PAGE.read_text().split("```python\n")[1:]]
    assert len(script.splitlines()) <= 25
    exec(script, {})
    noisy, denoised = (float(word) for word in capsys.readouterr().out.split() if word.startswith("0."))
    # It has two thirds of the noisy frame's FLIP, most of which is at edges.
    assert denoised < 0.8 * noisy
