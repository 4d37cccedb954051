"""Tests of controllers and policies that are written in Python."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
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

    def observe(self, rung, frame_ms):
        self.observed.append((rung, frame_ms))


def test_a_controller_chooses_the_rungs(renderer):
    controller = Turns([3, 0, 5])
    with renderer.play(WIDE, frames=3, controller=controller) as player:
        rungs = player.ladder
        reports = [frame.report for frame in player]
    assert [report["rung"] for report in reports] == [3, 0, 5]
    assert [rung for rung, _ in controller.observed] == [3, 0, 5]
    assert all(ms >= report["makespan_ms"] for (_, ms), report in zip(controller.observed, reports))
    assert all(len(times) == len(rungs) and min(times) > 0 for times in controller.predicted)
    expected = [times[rung] for rung, times in zip([3, 0, 5], controller.predicted)]
    assert all(0 < report["expected_ms"] <= ms for report, ms in zip(reports, expected))
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
        def observe(self, rung, frame_ms):
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


@pytest.fixture(scope="module")
def asked(scene):
    """A renderer whose policy tests may replace, since it takes seconds to make one."""

    def stripes(costs, rows):
        return renderer.stripes(costs, rows)

    renderer = dp.Renderer(scene, size=SIZE, devices=2, policy=stripes)
    return renderer


def test_a_policy_distributes_the_rows(asked, renderer):
    calls = []

    def stripes(costs, height):
        calls.append((costs, height))
        return [10, 26]

    asked.stripes = stripes
    frames = [asked.render(0.5, index=3, warm_up=2), renderer.render(0.5, index=3, warm_up=2)]
    assert frames[0].report["stripes"] == [10, 26] != frames[1].report["stripes"]
    assert frames[0].left.tobytes() == frames[1].left.tobytes()
    assert frames[0].right.tobytes() == frames[1].right.tobytes()
    assert [(costs.shape, height) for costs, height in calls] == [((2, 36), 36)] * 3
    assert (calls[2][0] > 0).all() and np.ptp(calls[2][0][0]) > 0
    with asked.play(WIDE, frames=2) as player:
        assert all(frame.report["stripes"] == [10, 26] for frame in player)
    assert asked.render().report["stripes"] == [10, 26]


def test_costs_predict_the_frame(scene):
    costs = []

    def stripes(predicted, rows):
        costs.append(predicted.sum(axis=1))
        return [rows]

    renderer = dp.Renderer(scene, size=(160, 90), policy=stripes)
    reports = [renderer.render(index=index).report for index in range(12)]
    assert costs[0] == 90
    busy = [report["makespan_ms"] for report in reports]
    assert 0.6 < np.median(costs[6:]) / np.median(busy[6:]) < 1.3


def test_the_time_of_a_policy_is_time_of_planning(asked):
    def stripes(costs, rows):
        threading.Event().wait(0.05)
        return np.array([rows - 1, 1])

    asked.stripes = stripes
    assert asked.render().report["plan_ms"] > 50
    with asked.play(WIDE, frames=1) as player:
        assert next(player).report["plan_ms"] > 50


@pytest.mark.parametrize(
    ("rows", "error", "text"),
    [
        ([36], ValueError, "rows for 1 devices, but 2 render"),
        ([1, 2, 33], ValueError, "rows for 3 devices"),
        ([18, 19], ValueError, r"rows \[18, 19\], which are not at least 0 each and 36 in all"),
        ([18, 17], ValueError, "36 in all"),
        ([40, -4], ValueError, "at least 0"),
        ([-4, 40], ValueError, "at least 0"),
        ([2**40, 36 - 2**40], ValueError, "at least 0"),
        ([17.5, 18.5], TypeError, "not the number of rows of each device"),
        (None, TypeError, "returned None, not the number"),
        ("no", TypeError, "returned 'no'"),
    ],
)
def test_wrong_rows_are_exceptions(asked, rows, error, text):
    asked.stripes = lambda costs, height: rows
    with pytest.raises(error, match=text):
        asked.render()


def test_exceptions_of_a_policy_surface_and_frames_go_on(asked):
    answers = iter([[18, 18], LookupError("no rows"), [20, 16], [0, 36], [36, 0]])

    def stripes(costs, rows):
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    asked.stripes = stripes
    assert asked.render().report["stripes"] == [18, 18]
    with pytest.raises(LookupError, match="no rows"):
        asked.render()
    assert asked.render().report["stripes"] == [20, 16]
    with asked.play(WIDE) as player:
        assert next(player).report["stripes"] == [0, 36]
        assert next(player).report["stripes"] == [36, 0]
    assert next(answers, None) is None


def test_a_policy_cannot_use_the_renderer_that_calls_it(asked):
    for use in (asked.render, asked.play, asked.begin_anew, lambda: asked.devices):
        asked.stripes = lambda costs, rows: use()
        with pytest.raises(RuntimeError, match="callback cannot use"):
            asked.render()


def test_a_policy_is_a_function_and_excludes_other_policies(scene):
    with pytest.raises(TypeError, match="policy is a function"):
        dp.Renderer(scene, policy=3)
    with pytest.raises(TypeError, match="either policy or balance"):
        dp.Renderer(scene, policy=lambda costs, rows: [rows], balance="even")


def test_threads_that_share_a_renderer_call_its_policy(asked):
    asked.stripes = lambda costs, rows: [rows // 2, rows // 2]
    with ThreadPoolExecutor(4) as pool:
        frames = list(pool.map(lambda index: asked.render(index=index), range(8)))
    assert all(frame.report["stripes"] == [18, 18] for frame in frames)


def test_a_callback_may_use_the_scene(scene):
    names = []

    def progress(done, of):
        names.append(scene.info["name"])
        dp.Renderer(scene, size=SIZE)

    dp.reference(scene, 8, size=SIZE, progress=progress)
    assert set(names) == {"cornell"}


def test_a_policy_knows_the_devices_that_are_left(scene):
    calls = []

    def stripes(costs, rows):
        calls.append(len(costs))
        return [12, *[0] * (len(costs) - 2), rows - 12] if len(costs) > 1 else [rows]

    renderer = dp.Renderer(scene, size=SIZE, devices=3, policy=stripes, disturb="loss:dev1@2")
    reports = [renderer.render(index=index).report for index in range(5)]
    assert [report["stripes"] for report in reports] == [[12, 0, 24]] * 2 + [[18, 0, 18]] + [[12, 0, 24]] * 2
    assert calls == [3, 3, 3, 2, 2]
