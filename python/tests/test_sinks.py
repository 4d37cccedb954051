"""Tests of views in other programs."""

import socket
import struct
import threading

import numpy as np
import pytest


def test_tev_gets_every_channel(renderer):
    frame = renderer.render(0.0, index=0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        sent = []

        def listen():
            for _ in range(2):
                connection, _ = server.accept()
                with connection:
                    sent.append(b"".join(iter(lambda: connection.recv(1 << 16), b"")))

        viewer = threading.Thread(target=listen)
        viewer.start()
        frame.to_tev(f"127.0.0.1:{server.getsockname()[1]}", name="box")
        viewer.join()
    for eye, image, packets in zip(("left", "right"), (frame.left, frame.right), sent):
        (length,) = struct.unpack_from("<I", packets)
        create, update = packets[:length], packets[length:]
        width, height, count = struct.unpack_from("<III", create, 6 + len(f"box {eye}") + 1)
        assert (width, height, count) == (64, 36, 3 + 3 + 1 + 3)
        names = create[6 + len(f"box {eye}") + 1 + 12 :].split(b"\0")[:-1]
        expected = ["R", "G", "B", "position.X", "position.Y", "position.Z", "depth.Z", "normal.X", "normal.Y", "normal.Z"]
        assert [name.decode() for name in names] == expected
        planes = np.frombuffer(update[-4 * count * width * height :], dtype="<f4").reshape(count, height, width)
        assert np.array_equal(planes[:3].transpose(1, 2, 0), image)
        assert np.array_equal(planes[6], frame.aov("depth")[eye == "right"])


def test_a_viewer_that_does_not_listen_is_named(renderer):
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(RuntimeError, match=address):
        renderer.render(0.0, index=0).to_tev(address)


def test_the_view_follows_the_pointer_and_keys(renderer):
    pytest.importorskip("jupyter_rfb", reason="the view needs the package jupyter_rfb")
    view = renderer.view()
    start = view.get_frame()
    assert start.shape == (36, 128, 3) and start.dtype == np.uint8 and start.mean() > 10
    before = view.pose
    view.handle_event({"event_type": "key_down", "key": "w"})
    moved = np.subtract(view.pose["position"], before["position"])
    ahead = np.subtract(before["target"], before["position"])
    assert np.allclose(moved, 0.1 * ahead, atol=1e-6)
    view.handle_event({"event_type": "pointer_down", "x": 5, "y": 5})
    for x in (5, 45):
        view.handle_event({"event_type": "pointer_move", "x": x, "y": 5, "buttons": (1,)})
    ahead_now = np.subtract(view.pose["target"], view.pose["position"])
    right = view.pose["position"] + np.cross(ahead, (0, 1, 0)) - np.asarray(view.pose["position"])
    assert np.isclose(ahead_now @ ahead, np.cos(0.2), atol=1e-6) and ahead_now @ right > 0
    assert not np.array_equal(view.get_frame(), start)
    view.handle_event({"event_type": "resize", "width": 10, "height": 10})


def test_rerun_gets_pictures_and_cameras(renderer):
    rerun = pytest.importorskip("rerun", reason="the package rerun-sdk is not installed")
    rerun.init("diptych", spawn=False)
    renderer.render(0.0, index=0).to_rerun("eyes")
