"""Tests of controllers and policies that are written in Python."""

import threading

import pytest

import diptych as dp

SIZE = (64, 36)
WIDE = (1.0, 5000.0)


@pytest.fixture(scope="module")
def renderer(scene):
    return dp.Renderer(scene, size=SIZE, devices=2)


class Turns:
    """A controller that takes rungs in turn."""

    def __init__(self, rungs):
        self.rungs, self.predicted, self.observed = list(rungs), [], []

    def next(self, predicted_ms):
        self.predicted.append(predicted_ms)
        return self.rungs[len(self.predicted) - 1]

    def observe(self, rung, makespan_ms):
        self.observed.append((rung, makespan_ms))


def test_a_controller_chooses_the_rungs(renderer):
    controller = Turns([3, 0, 5])
    with renderer.play(WIDE, frames=3, controller=controller) as player:
        rungs = player.ladder
        reports = [frame.report for frame in player]
    assert [report["rung"] for report in reports] == [3, 0, 5]
    assert controller.observed == [(report["rung"], report["makespan_ms"]) for report in reports]
    assert all(len(times) == len(rungs) and min(times) > 0 for times in controller.predicted)
    assert [report["expected_ms"] for report in reports] == [
        times[rung] for rung, times in zip([3, 0, 5], controller.predicted)
    ]
    assert all(report["bounces"] == rungs[report["rung"]]["bounces"] for report in reports)
    assert all(a["error"] >= b["error"] for a, b in zip(rungs, rungs[1:])) and len(rungs) > 5


def test_a_controller_may_lack_observe_and_its_time_is_counted(renderer):
    class Slow:
        def next(self, predicted_ms):
            threading.Event().wait(0.05)
            return 0

    with renderer.play(WIDE, frames=2, controller=Slow()) as player:
        assert all(frame.report["decide_ms"] > 50 for frame in player)


@pytest.mark.parametrize(
    ("chosen", "error", "text"),
    [
        (10_000, ValueError, "rung 10000, but the ladder has rungs 0 to"),
        (-1, ValueError, "rung -1, but"),
        (0.5, TypeError, "returned 0.5, which is not the index"),
        (None, TypeError, "returned None"),
    ],
)
def test_a_wrong_rung_is_an_exception_and_the_sequence_goes_on(renderer, chosen, error, text):
    with renderer.play(WIDE, frames=2, controller=Turns([0, chosen, 1])) as player:
        next(player)
        with pytest.raises(error, match=text):
            next(player)
        assert next(player).report["index"] == 1
    assert renderer.render().left.shape == (36, 64, 3)


def test_exceptions_of_a_controller_surface(renderer):
    class Failing(Turns):
        def observe(self, rung, makespan_ms):
            raise LookupError("observed")

    with renderer.play(WIDE, frames=2, controller=Turns([])) as player, pytest.raises(IndexError):
        next(player)
    with renderer.play(WIDE, frames=2, controller=Failing([0])) as player, pytest.raises(LookupError, match="observed"):
        next(player)
    with pytest.raises(TypeError, match=r"method next\(predicted_ms\), which int lacks"):
        renderer.play(WIDE, frames=2, controller=3)


def test_a_controller_cannot_use_the_player_that_calls_it(renderer):
    class Closing:
        def next(self, predicted_ms):
            player.close()
            return 0

    with renderer.play(WIDE, frames=2, controller=Closing()) as player:
        with pytest.raises(RuntimeError, match="callback cannot use"):
            next(player)
