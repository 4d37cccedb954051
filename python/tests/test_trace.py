"""Tests of traces."""

import xml.etree.ElementTree as xml
from pathlib import Path

import pytest

import diptych as dp

TRACES = Path(__file__).parents[2] / "traces"
SVG = "{http://www.w3.org/2000/svg}"


def titles(lanes):
    return [title.text for title in xml.fromstring(lanes._repr_svg_()).iter(f"{SVG}title")]


def texts(lanes):
    return [text.text for text in xml.fromstring(lanes.svg).iter(f"{SVG}text")]


def test_a_trace_has_frames_tasks_and_a_summary():
    trace = dp.trace(TRACES / "atrium-2-devices.json")
    assert [frame["frame"] for frame in trace.frames] == [0, 1, 2] and len(trace.devices) == 2
    assert trace.frames[0]["begin_ms"] == 0 < trace.frames[0]["end_ms"] <= trace.frames[1]["begin_ms"]
    busy = {device["pid"]: 0.0 for device in trace.devices}
    for task in trace.tasks:
        if task["lane"] not in ("upload", "download"):
            busy[task["pid"]] += task["end_ms"] - task["begin_ms"]
    for device in trace.summary["devices"]:
        assert busy[device["pid"]] == pytest.approx(device["busy_ms"], rel=0.02)


def test_lanes_show_each_task_once():
    trace = dp.trace(TRACES / "atrium-2-devices.json")
    for frames in (None, 1, [0, 2], range(3)):
        chosen = {0, 1, 2} if frames is None else {frames} if isinstance(frames, int) else set(frames)
        lanes = trace.lanes(frames)
        assert len(titles(lanes)) == sum(task["frame"] in chosen for task in trace.tasks) > 100
        assert {f"frame {number}" for number in chosen} == {text for text in texts(lanes) if text.startswith("frame")}
    assert any(title.startswith("path_trace, left, ") and ", rows 0 to " in title for title in titles(trace.lanes()))


def test_lanes_are_within_the_image():
    trace = dp.trace(TRACES / "atrium-play.json")
    for width in (300, 1200):
        image = xml.fromstring(trace.lanes(range(8, 14), width=width).svg)
        height = float(image.get("height"))
        boxes = [rect for rect in image.iter(f"{SVG}rect") if rect.get("x")]
        right = [float(box.get("x")) + float(box.get("width")) for box in boxes]
        assert max(right) <= width and min(float(box.get("x")) for box in boxes) >= 0
        assert max(float(box.get("y")) + float(box.get("height")) for box in boxes) <= height


def test_lanes_are_saved(tmp_path):
    lanes = dp.trace(TRACES / "atrium-2-devices.json").lanes(2)
    lanes.save(tmp_path / "lanes.svg")
    assert (tmp_path / "lanes.svg").read_text(encoding="utf-8") == lanes.svg


def test_names_in_a_trace_are_text(tmp_path):
    file = tmp_path / "trace.json"
    text = (TRACES / "atrium-2-devices.json").read_text()
    file.write_text(text.replace("path_trace", "<b>&'").replace("device 0:", "</svg>"))
    lanes = dp.trace(file).lanes()
    assert any(title.startswith("<b>&'") for title in titles(lanes))
    assert any(text.startswith("</svg>") for text in texts(lanes))


def test_mistakes_are_exceptions(tmp_path):
    file = tmp_path / "trace.json"
    with pytest.raises(ValueError, match="cannot read trace"):
        dp.trace(file)
    file.write_text("nothing")
    with pytest.raises(ValueError, match="is not a trace"):
        dp.trace(file)
    file.write_text("[]")
    with pytest.raises(ValueError, match="no frames of diptych devices"):
        dp.trace(file).lanes()
    trace = dp.trace(TRACES / "atrium-2-devices.json")
    with pytest.raises(ValueError, match="no frame 7: it has frames 0 to 2"):
        trace.lanes([1, 7])
    with pytest.raises(ValueError, match="no chosen frame"):
        trace.lanes([])
    with pytest.raises(ValueError, match="300 pixels"):
        trace.lanes(width=10)
