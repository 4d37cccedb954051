"""Tests of the package, with images of a few thousand pixels."""

import ctypes
import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

import diptych as dp

SIZE = (64, 36)
PROGRAM = os.environ.get("DIPTYCH")


def test_frames_are_arrays_of_linear_light(renderer):
    frame = renderer.render(0.0, index=0, warm_up=2)
    for image in (frame.left, frame.right):
        assert image.shape == (36, 64, 3) and image.dtype == np.float32 and image.flags.c_contiguous
        assert np.isfinite(image).all() and 0.01 < image.mean() < 1.0
    assert frame.aovs == ["position", "depth", "normal"]
    assert frame.aov("depth").left.shape == (36, 64)
    normals, hit = frame.aov("normal").left, frame.aov("depth").left > 0
    assert hit.mean() > 0.3 and np.allclose(np.linalg.norm(normals[hit], axis=1), 1.0, atol=1e-3)
    assert sum(frame.report["stripes"]) == 36
    assert frame.display().left.dtype == np.uint8
    assert frame._repr_png_().startswith(b"\x89PNG")


def test_arrays_keep_their_values_when_further_frames_are_rendered(renderer):
    first = renderer.render(0.0, index=0, warm_up=1)
    copies = first.left.copy(), first.aov("depth").right.copy()
    other = renderer.render(3.0, index=9, warm_up=1)
    assert np.array_equal(first.left, copies[0]) and np.array_equal(first.aov("depth").right, copies[1])
    assert not np.array_equal(first.left, other.left)


def test_a_frame_depends_on_its_warm_up_alone(scene, renderer):
    frames = [renderer.render(0.5, index=3, warm_up=2) for _ in range(2)]
    fresh = dp.Renderer(scene, size=SIZE, devices=2).render(0.5, index=3, warm_up=2)
    assert frames[0].left.tobytes() == frames[1].left.tobytes() == fresh.left.tobytes()


def test_devices_and_index_make_the_same_bytes(scene, renderer):
    one = dp.Renderer(scene, size=SIZE)
    frames = [r.render(0.5, index=3, warm_up=2) for r in (renderer, one)]
    assert frames[0].left.tobytes() == frames[1].left.tobytes()
    assert frames[0].right.tobytes() == frames[1].right.tobytes()


@pytest.mark.skipif(PROGRAM is None, reason="DIPTYCH does not name the program")
def test_frames_have_the_bytes_of_the_command_line(renderer, tmp_path):
    command = [PROGRAM, "render", "builtin:cornell", "--size", "64x36", "--virtual", "2", "--warm-up", "3"]
    subprocess.run([*command, "--time", "0.5", "--quiet", "--out", tmp_path], check=True)
    frame = renderer.render(0.5, index=0, warm_up=3)
    for eye, image in (("left", frame.left), ("right", frame.right)):
        assert dp.read_exr(tmp_path / f"{eye}.exr").tobytes() == image.tobytes()


@pytest.mark.skipif(PROGRAM is None, reason="DIPTYCH does not name the program")
def test_frames_are_saved_as_the_files_of_the_command_line(renderer, tmp_path):
    command = [PROGRAM, "render", "builtin:cornell", "--size", "64x36", "--virtual", "2", "--warm-up", "1"]
    aovs = ["--aov", "position,depth,normal"]
    subprocess.run([*command, *aovs, "--time", "0.5", "--quiet", "--out", tmp_path / "program"], check=True)
    (tmp_path / "python").mkdir()
    renderer.render(0.5, index=0, warm_up=1).save_exr(tmp_path / "python")
    files = sorted(file.name for file in (tmp_path / "program").glob("*.exr"))
    assert files == sorted(file.name for file in (tmp_path / "python").iterdir()) and len(files) == 8
    for file in files:
        assert (tmp_path / "python" / file).read_bytes() == (tmp_path / "program" / file).read_bytes(), file


def test_poses_replace_the_path(renderer):
    frame = renderer.render(position=(0.0, 1.0, 3.2), target=(0.0, 1.0, 0.0), warm_up=1)
    eyes = [camera.position for camera in frame.cameras]
    assert np.allclose((eyes[0] + eyes[1]) / 2, (0.0, 1.0, 3.2), atol=1e-5)
    assert np.isclose(np.linalg.norm(eyes[1] - eyes[0]), 0.064, atol=1e-5)
    with pytest.raises(ValueError, match="orientation"):
        renderer.render(position=(0, 0, 0), target=(0, 0, 0))
    with pytest.raises(ValueError, match="both"):
        renderer.render(position=(0, 0, 0))


def test_cameras_find_the_pixel_of_a_surface(scene):
    frame = dp.Renderer(scene, size=SIZE, aov=["position", "depth"], denoiser="none").render()
    rows, columns = np.mgrid[0:36, 0:64] + 0.5
    camera, position = frame.cameras.left, frame.aov("position").left
    hit = frame.aov("depth").left > 0
    assert hit.mean() > 0.3
    projected = camera.project(position)
    assert np.abs(projected[..., 0] - columns)[hit].max() < 1e-2
    assert np.abs(projected[..., 1] - rows)[hit].max() < 1e-2
    local = (np.c_[position[hit], np.ones(hit.sum())] @ camera.world_to_camera)[:, :3]
    pixels = (local * [1, -1, 1]) @ camera.intrinsics.T
    assert np.allclose(pixels[:, :2] / pixels[:, 2:], projected[hit], atol=1e-3)


def test_disparity_is_that_of_parallel_pinhole_cameras(scene):
    frame = dp.Renderer(scene, size=SIZE, aov=["position", "depth"], denoiser="none").render()
    camera, disparity = frame.cameras.left, frame.disparity().left
    position = frame.aov("position").left.astype(np.float64)
    along = (np.concatenate([position, np.ones((36, 64, 1))], axis=2) @ camera.world_to_camera)[..., 2]
    hit = frame.aov("depth").left > 0
    expected = camera.intrinsics[0, 0] * 0.064 / along
    assert np.abs(disparity - expected)[hit].max() < 1e-3
    assert np.isnan(disparity[~hit]).all()


def test_a_sequence_stays_inside_a_wide_budget_and_gives_the_devices_back(renderer):
    with renderer.play(budget_ms=(1.0, 5000.0), frames=4) as player:
        with pytest.raises(RuntimeError, match="close the player"):
            renderer.render()
        frames = list(player)
    assert [frame.report["index"] for frame in frames] == [0, 1, 2, 3]
    assert all(frame.report["in_band"] and frame.report["makespan_ms"] > 0 for frame in frames)
    assert np.isclose(frames[3].report["time_s"], 3 / 72)
    assert renderer.render().left.shape == (36, 64, 3)


def test_a_paced_sequence_counts_the_periods_that_python_misses(renderer):
    with renderer.play(budget_ms=(1.0, 5000.0), fps=2.0, frames=2, pace=True) as player:
        next(player)
        time.sleep(1.6)
        assert next(player).report["missed_periods"] >= 2


def test_head_motion_moves_the_eyes(renderer, tmp_path):
    file = tmp_path / "head.jsonl"
    turned = [0.0, 0.7071067811865476, 0.0, 0.7071067811865476]
    lines = [(0.0, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]), (1.0, [0.0, 0.1, 0.0], turned)]
    names = ("time_s", "position_m", "orientation")
    samples = [{"diptych_motion": 1}, *(dict(zip(names, line)) for line in lines)]
    file.write_text("".join(json.dumps(sample) + "\n" for sample in samples))
    with renderer.play((1.0, 5000.0), frames=2, fps=1.0, motion=file) as player:
        first, second = (frame.cameras.left.world_to_camera for frame in player)
    assert np.abs(first - second).max() > 0.5
    with pytest.raises(ValueError, match="head.jsonl"):
        file.write_text("no motion\n")
        renderer.play(frames=1, motion=file)


def test_a_reference_converges_and_tells_its_progress(scene, renderer):
    told = []
    reference = dp.reference(scene, 64, size=SIZE, progress=lambda done, of: told.append((done, of)))
    assert told[-1] == (64, 64) and reference.report["spp"] == 64
    noisy = dp.Renderer(scene, size=SIZE, denoiser="none").render()
    filtered = renderer.render(0.0, warm_up=15)
    errors = [dp.compare(frame, reference) for frame in (noisy, filtered, reference)]
    assert errors[0].rmse > 2 * errors[1].rmse > 0 and errors[2].rmse == 0 and errors[0].flip > errors[1].flip
    assert abs(errors[1].mean_ratio - 1) < 0.1
    pair, exposure_ev = (noisy.left, reference.left), reference.exposure_ev
    of_left = dp.compare(*pair, exposure_ev=exposure_ev).flip
    assert np.isclose(dp.flip(*pair, exposure_ev=exposure_ev).mean(), of_left, rtol=1e-4)


def test_an_exception_in_progress_ends_a_reference(scene):
    passes = []

    def progress(done, of):
        passes.append(done)
        raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        dp.reference(scene, 1 << 16, size=SIZE, progress=progress)
    assert len(passes) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
def test_control_c_ends_a_reference(tmp_path):
    # Shells ignore Ctrl-C in jobs in the background, and programs inherit that.
    script = (
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
        "import diptych as dp; s = dp.load('builtin:cornell'); print('ready', flush=True); "
        "dp.reference(s, 1 << 20, size=(32, 18))"
    )
    run = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert run.stdout.readline() == "ready\n"
        time.sleep(2.0)
        run.send_signal(2)
        _, errors = run.communicate(timeout=60)
    finally:
        run.kill()
    assert errors.strip().endswith("KeyboardInterrupt") and run.returncode != 0


def test_a_bench_is_a_table(scene):
    table = dp.bench(scene, size=SIZE, frames=2, reference_spp=16, spp=[1, 2], denoiser=["none", "svgf"])
    assert [(row["spp"], row["denoiser"]) for row in table] == [(1, "none"), (1, "svgf"), (2, "none"), (2, "svgf")]
    assert all(row["ms"] > 0 and row["flip"] > 0 for row in table)


def test_a_data_set_has_exact_ground_truth(scene, tmp_path):
    poses = [0.0, 1.0, {"position": (0.0, 1.0, 3.2), "target": (0.0, 1.0, 0.0)}]
    assert dp.dataset(scene, poses, tmp_path, size=SIZE, spp=2) == 3
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["000000.npz", "000001.npz", "000002.npz"]
    with np.load(files[1]) as pair:
        assert pair["left"].shape == (36, 64, 3) and pair["world_to_ndc"].shape == (2, 4, 4)
        disparity = pair["disparity_left"]
        seen = ~np.isnan(disparity)
        # A surface that both eyes see has the same disparity in both.
        rows, columns = np.nonzero(seen)
        matched = np.round(columns - disparity[seen]).astype(int)
        inside = (matched >= 0) & (matched < 64)
        other = pair["disparity_right"][rows[inside], matched[inside]]
        assert np.nanmedian(np.abs(other - disparity[seen][inside])) < 0.05


def test_a_data_set_of_exr_files_has_the_same_values(scene, tmp_path):
    openexr = pytest.importorskip("OpenEXR")
    options = {"size": SIZE, "spp": 1, "aovs": ["depth", "normal"]}
    poses = [0.0, {"position": (0.0, 1.0, 3.2), "target": (0.0, 1.0, 0.0), "time": 0.5}]
    assert dp.dataset(scene, poses, tmp_path / "npz", **options) == 2
    assert dp.dataset(scene, poses, tmp_path / "exr", format="exr", **options) == 2
    assert len(list((tmp_path / "exr").iterdir())) == 2 * 2 * 4
    for number in range(2):
        with np.load(tmp_path / "npz" / f"{number:06}.npz") as pair:
            for i, eye in enumerate(("left", "right")):
                for name in (None, "depth", "normal", "disparity"):
                    file = f"{number:06}.{eye}.exr" if name is None else f"{number:06}.{eye}.{name}.exr"
                    with openexr.File(str(tmp_path / "exr" / file), separate_channels=True) as opened:
                        channels, header = opened.channels(), dict(opened.header())
                        names = sorted(channels, key="RGBXYZ".index)
                        image = np.stack([channels[key].pixels for key in names], axis=-1)
                    expected = pair[eye if name is None else f"{name}_{eye}"]
                    assert image.tobytes() == expected.tobytes(), file
                    for key, entry in (("world_to_camera", "worldToCamera"), ("world_to_ndc", "worldToNDC")):
                        assert np.array_equal(np.reshape(header[entry], (4, 4)), np.float32(pair[key][i]))
    with pytest.raises(ValueError, match="format is 'npz' or 'exr', not 'png'"):
        dp.dataset(scene, poses, tmp_path, format="png")


@pytest.mark.parametrize("views", [1, 3])
def test_frames_have_any_number_of_views(tmp_path, views):
    scene = dp.load("builtin:cornell", views=views, baseline=0.05)
    frame = dp.Renderer(scene, size=SIZE, aov=["position", "depth"], denoiser="none").render()
    names = [f"view{number:02}" for number in range(views)]
    assert frame.views.names == names and [camera.eye for camera in frame.cameras] == names
    assert len({image.tobytes() for image in frame.views}) == len(frame.aov("depth")) == len(frame.display()) == views
    for of_eyes in (lambda: frame.left, lambda: frame.cameras.right, lambda: frame.aov("depth").left):
        with pytest.raises(AttributeError, match=f"only two views are left and right: index these {views}"):
            of_eyes()
    frame.save_exr(tmp_path)
    assert len(list(tmp_path.iterdir())) == 3 * views
    assert dp.read_exr(tmp_path / f"{names[-1]}.exr").tobytes() == frame.views[-1].tobytes()
    assert frame._repr_png_().startswith(b"\x89PNG")
    reference = dp.reference(scene, 16, size=SIZE)
    assert len(reference.views) == views and 0 < dp.compare(frame, reference).flip < 0.5
    with pytest.raises(ValueError, match=f"the shot has {views}"):
        dp.Renderer(scene, size=SIZE).play(frames=1)


def test_a_data_set_has_the_disparity_of_neighbouring_views(tmp_path):
    scene = dp.load("builtin:cornell", views=4, baseline=0.05)
    assert dp.dataset(scene, [0.0], tmp_path, aovs=["depth", "position"], size=SIZE, spp=1) == 1
    with np.load(tmp_path / "000000.npz") as arrays:
        assert len(arrays.files) == 4 * 4 + 2
        for number, matrices in enumerate(zip(arrays["world_to_camera"], arrays["world_to_ndc"])):
            view, camera = f"view{number:02}", dp.Camera(*matrices, *SIZE)
            assert arrays[view].shape == (36, 64, 3)
            position = arrays[f"position_{view}"].astype(np.float64)
            along = (np.concatenate([position, np.ones((36, 64, 1))], axis=2) @ camera.world_to_camera)[..., 2]
            hit, disparity = arrays[f"depth_{view}"] > 0, arrays[f"disparity_{view}"]
            assert np.abs(disparity - camera.intrinsics[0, 0] * 0.05 / along)[hit].max() < 1e-3
            assert hit.mean() > 0.3 and np.isnan(disparity[~hit]).all()
    with pytest.raises(ValueError, match="single view"):
        dp.Renderer(dp.load("builtin:cornell", views=1), size=SIZE, aov=["position", "depth"]).render().disparity()


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda s: dp.Renderer(s, sizes=3), TypeError, "no option 'sizes'"),
        (lambda s: dp.Renderer(s, spp=0), ValueError, "spp"),
        (lambda s: dp.Renderer(s, environment="sky"), TypeError, "give it to load"),
        (lambda s: dp.Renderer(s, denoiser="none", render_scale=0.5), ValueError, "render_scale"),
        (lambda s: dp.Renderer(s, devices=dp.Devices(adapters=[99])), ValueError, "no adapter 99"),
        (lambda s: dp.load("nothing.glb"), ValueError, "cannot read 'nothing.glb'"),
        (lambda s: dp.load("builtin:cornell", spp=3), TypeError, "option of a renderer"),
        (lambda s: dp.load("builtin:cornell", strict="maybe"), ValueError, "strict cannot be maybe: not one of on, off"),
        (lambda s: dp.Renderer(s, controller="pid"), TypeError, "no option 'controller'"),
        (lambda s: dp.Renderer(s, time_limit=1.0), TypeError, "no option 'time_limit'"),
        (lambda s: dp.reference(s, denoiser="svgf"), TypeError, "is not filtered"),
        (lambda s: dp.reference(s, clamp=3), TypeError, "unbiased"),
        (lambda s: dp.compare(np.zeros((4, 4, 3)), np.zeros((4, 5, 3))), RuntimeError, "differ in size"),
        (lambda s: dp.compare(np.zeros((4, 4)), np.zeros((4, 4))), ValueError, r"\(height, width, 3\)"),
        (lambda s: dp.compare(np.zeros((4, 4, 2)), np.zeros((4, 4, 2))), ValueError, r"shape \(height, width, 3\)"),
        (lambda s: dp.read_exr("nothing.exr"), RuntimeError, "nothing.exr"),
    ],
)
def test_mistakes_are_exceptions_with_the_texts_of_the_command_line(scene, call, error, text):
    with pytest.raises(error, match=text):
        call(scene)


def test_options_take_the_types_of_python(scene):
    assert dp.Renderer(scene, size=SIZE, aov=[]).render().aovs == []
    options = {"foveation": "layers", "gaze": np.array([0.5, 0.5]), "iterations": (2, 2, 2), "clamp": None}
    renderer = dp.Renderer(scene, size=SIZE, reproject=np.False_, **options)
    assert "from_left" not in renderer.render().report
    for strict in (True, 1, "off"):
        assert dp.load("builtin:cornell", exposure=-1, strict=strict).info["name"] == "cornell"


def test_threads_may_share_a_renderer(renderer):
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(4) as pool:
        frames = list(pool.map(lambda i: renderer.render(0.1, index=i), range(8)))
    assert all(np.isfinite(frame.left).all() for frame in frames)


def test_memory_does_not_grow_over_a_thousand_frames(scene):
    psutil = pytest.importorskip("psutil")
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is None:
        pytest.skip("needs the C library's malloc_trim")

    def memory():
        # Otherwise, arrays that leaked would first fill what compiling the pipelines has left free.
        trim(0)
        return psutil.Process().memory_info().rss

    renderer = dp.Renderer(scene, size=(32, 18), devices=2, aov=["normal"])

    def render(frames):
        for _ in range(frames):
            frame = renderer.render()
            assert frame.left.shape == frame.aov("normal").right.shape == (18, 32, 3)
            assert frame.report["index"] >= 0

    render(50)
    before = memory()
    render(1000)
    # An array that leaked would add 6.9 kB for each frame, 6.9 MB in all.
    assert memory() - before < 3 << 20
