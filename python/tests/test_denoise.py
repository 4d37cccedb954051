"""Tests of denoisers that are written in Python."""

import time

import numpy as np
import pytest

import diptych as dp

SIZE = (64, 36)
WIDE = (1.0, 5000.0)


def half(colour, albedo, normal, position, motion, camera):
    return 0.5 * colour.astype(np.float64)


def slow(colour, *_):
    time.sleep(0.03)
    return colour


def test_a_denoiser_takes_arrays_and_replaces_the_colour(scene, tmp_path):
    calls = []

    def noted(*arrays):
        calls.append(arrays)
        return half(*arrays)

    frame = dp.Renderer(scene, size=SIZE, denoiser=noted, aov=["depth"]).render(0.5, index=3, warm_up=1)
    plain = dp.Renderer(scene, size=SIZE, denoiser="none").render(0.5, index=3, warm_up=1)
    for image, noisy in zip((frame.left, frame.right), (plain.left, plain.right)):
        assert image.dtype == np.float32 and image.tobytes() == (0.5 * noisy).tobytes()
    # The frame of the warm-up is denoised, too, both of its eyes.
    assert [arrays[-1].eye for arrays in calls] == ["left", "right"] * 2
    colour, albedo, normal, position, motion, camera = calls[-1]
    assert colour.tobytes() == plain.right.tobytes()
    assert [array.shape[2] for array in (albedo, normal, position, motion)] == [3, 3, 3, 2]
    assert camera.project(position).shape == (36, 64, 2) and frame.aov("depth").left.shape == (36, 64)
    assert albedo.tobytes() == frame.aov("base_color").right.tobytes()
    assert frame.report["denoiser_ms"] > 0 and "denoiser_ms" not in plain.report
    frame.save_exr(tmp_path, aovs=[])
    assert dp.read_exr(tmp_path / "right.exr").tobytes() == frame.right.tobytes()


def test_a_denoiser_must_keep_the_shape(scene):
    renderer = dp.Renderer(scene, size=SIZE, denoiser=lambda colour, *_: colour[..., 0])
    with pytest.raises(ValueError, match=r"<lambda> returned the shape \(36, 64\), not \(36, 64, 3\)"):
        renderer.render()


def test_sequences_count_the_time_of_a_denoiser(scene):
    class Cheapest:
        def __init__(self):
            self.observed = []

        def next(self, predicted_ms):
            return 0

        def observe(self, rung, frame_ms):
            self.observed.append(frame_ms)

    controller = Cheapest()
    with dp.Renderer(scene, size=SIZE, denoiser=slow).play(WIDE, frames=3, controller=controller) as player:
        frames = list(player)
    assert all(frame.report["denoiser_ms"] >= 60 for frame in frames)
    makespans = [frame.report["makespan_ms"] for frame in frames]
    assert controller.observed[2] >= makespans[2] + 60


def test_a_denoiser_is_a_row_of_a_bench(scene):
    grid = {"spp": [1], "denoiser": ["svgf", half, slow]}
    table = dp.bench(scene, size=SIZE, frames=2, turns=2, reference_spp=16, **grid)
    assert [row["denoiser"] for row in table] == ["svgf", "half", "slow"]
    svgf, dark, late = table
    assert late["ms"] >= 60 and late["ms_low"] < late["ms"] < late["ms_high"]
    assert dark["mean_ratio"] < 0.6 and abs(late["mean_ratio"] - 1.0) < 0.2
    with pytest.raises(ValueError, match="turns"):
        dp.bench(scene, size=SIZE, turns=0)
