"""Tests of shots that are given as dicts."""

import base64
import json

import numpy as np
import pytest

import diptych as dp

SIZE = (32, 18)
SHOT = {
    "name": "box",
    "scene": "builtin:cornell",
    "animation": None,
    "rig": {
        "yfov_deg": np.float32(50),
        "key": [
            {"position": [0, 1, 3.2], "target": (0.0, 1.0, 0.0)},
            {"time_s": 2, "position": np.array([0.5, 1.0, 3.0]), "target": np.array([0, 1, 0])},
        ],
    },
    "light": [{"kind": "point", "position": [0, 1.5, 0], "color": [1, 0.5, 0.25], "intensity": 2, "radius_m": 0.1}],
    "exposure": {"ev": np.int64(1)},
}
TOML = """
name = "box"
scene = "builtin:cornell"
[rig]
yfov_deg = 50
[[rig.key]]
position = [0, 1, 3.2]
target = [0, 1, 0]
[[rig.key]]
time_s = 2
position = [0.5, 1, 3]
target = [0, 1, 0]
[[light]]
kind = "point"
position = [0, 1.5, 0]
color = [1, 0.5, 0.25]
intensity = 2
radius_m = 0.1
[exposure]
ev = 1
"""


def test_a_dict_is_the_shot_of_a_file(tmp_path):
    file = tmp_path / "shot.toml"
    file.write_text(TOML)
    scenes = [dp.load(SHOT), dp.load(file)]
    assert scenes[0].path_s == scenes[1].path_s == (0.0, 2.0)
    frames = [dp.Renderer(scene, size=SIZE).render(1.0) for scene in scenes]
    assert frames[0].left.tobytes() == frames[1].left.tobytes() and frames[0].left.mean() > 0.01
    assert frames[0].exposure_ev == frames[1].exposure_ev == 1.0


def test_settings_of_a_shot_yield_to_keywords(tmp_path):
    file = tmp_path / "shot.toml"
    file.write_text(TOML + '[render]\nsize = "32x18"\nspp = 2\n')
    for shot in (SHOT | {"render": {"size": "32x18", "spp": 2}}, file):
        scene = dp.load(shot)
        report = dp.Renderer(scene).render().report
        assert (report["spp"], dp.Renderer(scene, spp=4).render().report["spp"]) == (2, 4)
        assert dp.Renderer(scene).render().left.shape == (18, 32, 3)


def triangle(path):
    """Writes a glTF file with one triangle."""
    data = base64.b64encode(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32).tobytes()).decode()
    positions = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}
    gltf = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64," + data}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [positions],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    path.write_text(json.dumps(gltf))


def test_paths_are_relative_to_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "models").mkdir()
    (tmp_path / "elsewhere").mkdir()
    triangle(tmp_path / "models" / "one.gltf")
    rig = {"key": [{"position": [0, 0, 2], "target": [0, 0, 0]}]}
    monkeypatch.chdir(tmp_path)
    assert dp.load({"scene": "models/one.gltf", "rig": rig}).info["triangles"] == 1
    monkeypatch.chdir(tmp_path / "elsewhere")
    for path in ("../models/one.gltf", str(tmp_path / "models" / "one.gltf"), tmp_path / "models" / "one.gltf"):
        assert dp.load({"scene": path, "rig": rig}).info["triangles"] == 1
    with pytest.raises(ValueError, match="cannot read 'models/one.gltf'"):
        dp.load({"scene": "models/one.gltf", "rig": rig})
    # A file of others may still name only files in its own folder.
    shot = tmp_path / "elsewhere" / "shot.toml"
    shot.write_text('scene = "../models/one.gltf"')
    with pytest.raises(ValueError, match="not below its own folder"):
        dp.load(shot)


def endless():
    shot = {}
    shot["rig"] = shot
    return shot


@pytest.mark.parametrize(
    ("change", "error", "text"),
    [
        ({"scene": None}, ValueError, "'dict' is not valid: .*missing field `scene`"),
        ({"scene": "builtin:nowhere"}, ValueError, "no built-in scene 'nowhere'"),
        ({"model": "a.glb"}, ValueError, "unknown field `model`, expected one of `name`, `scene`"),
        ({"rig": {"yfov_deg": 200}}, ValueError, "'dict' is not valid: line [0-9]+: rig.yfov_deg"),
        ({"rig": {"yfov_deg": "wide"}}, ValueError, "rig.yfov_deg: invalid type: string"),
        ({"exposure": {"ev": float("nan")}}, ValueError, "exposure.ev"),
        ({"exposure": {"ev": object()}}, TypeError, "value of 'exposure.ev' in the shot has the type .*object"),
        ({"exposure": {1: 2}}, TypeError, "key 1 of a shot is no string"),
        ({"light": [{"kind": b"point"}]}, ValueError, "light"),
        (endless(), ValueError, "nested too deeply at 'rig.rig"),
    ],
)
def test_mistakes_in_a_dict_are_exceptions_with_the_texts_of_files(change, error, text):
    with pytest.raises(error, match=text):
        dp.load(SHOT | change)
