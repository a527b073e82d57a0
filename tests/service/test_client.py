"""The Python client against a real server."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from websockets.exceptions import ConnectionClosedError
from websockets.frames import Close

from service_server import RunningServer
from torchrender.client import StreamClient, StreamClosed, StreamedKeyframe, StreamError
from torchrender.client.session import closed
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.wire.codec import display_bytes

SIZE = (96, 72)


def moved(camera: Cameras, x: float) -> Cameras:
    matrix = camera.camera_from_world.clone()
    matrix[:, 0, 3] -= x
    return replace(camera, camera_from_world=matrix)


def still_keyframe(client: StreamClient) -> StreamedKeyframe:
    client.send_pose(client.camera, moving=False)
    while (keyframe := client.receive()).samples == 1:
        pass
    return keyframe


def test_keyframes_come_as_tensors_and_are_reprojected_here(server: RunningServer) -> None:
    with StreamClient.connect(server.url, "cornell_box", size=SIZE, layers=2, overscan=1.2) as client:
        keyframe = still_keyframe(client)
        images = keyframe.depth_images()
        assert images.depth.shape == (3, 86, 114)
        assert keyframe.plan is not None and keyframe.latency_ms > 0 and keyframe.bytes > 1000
        unmoved = client.view(keyframe.images[0].camera)
        assert bool(unmoved.valid.all())
        error = display_bytes(unmoved.color[0]).astype(int) - keyframe.images[0].codes.numpy()
        assert np.abs(error).max() <= 1  # far better than the 50 dB that are asked for
        aside = client.view(moved(client.camera, 0.03))
        assert aside.color.shape == (1, SIZE[1], SIZE[0], 3)
        holes = float((~aside.valid).float().mean())
        assert holes < 0.01
        client.send_pose(moved(client.camera, 0.05), velocity=(0.2, 0.0, 0.0))
        assert client.receive(holes=holes).id > keyframe.id


def test_wishes_and_resync(server: RunningServer) -> None:
    with StreamClient.connect(server.url, "cornell_box", size=SIZE, layers=0) as client:
        last = still_keyframe(client)
        client.wish(budget_ms=400.0, layers=1)
        fresh = client.receive()
        assert fresh.id > last.id and len(fresh.images) == 2
        client.resync()
        assert client.receive().id > fresh.id
        assert [k.id for k in client.kept] == sorted(k.id for k in client.kept) and len(client.kept) == 2


def test_views_are_drawn_from_keyframes_of_one_state_of_the_scene(server: RunningServer) -> None:
    """What a program has moved, or an animation, is not seen twice."""
    with StreamClient.connect(server.url, "cornell_box", size=SIZE, layers=1, overscan=1.2, keep=2) as client:
        earlier = still_keyframe(client)
        newest = client.receive(pose=client.send_pose(moved(client.camera, 0.3)))
        assert (earlier.revision, earlier.scene_s) == (newest.revision, newest.scene_s) == (0, None)
        aside = moved(client.camera, -0.2)
        both = client.view(aside)
        assert client.kept[-2].id >= earlier.id and int(both.source.max()) >= len(newest.images), (
            "the earlier one fills what the newest does not reach"
        )
        for other in ({"revision": 1}, {"scene_s": 0.5}):
            client.kept[-1] = replace(newest, **other)
            alone = client.view(aside)
            assert int(alone.source.max()) < len(newest.images)
            assert float(alone.valid.float().mean()) < float(both.valid.float().mean())


def test_reconnecting_keeps_the_keyframes(server: RunningServer) -> None:
    client = StreamClient.connect(server.url, "cornell_box", size=SIZE, layers=0)
    still_keyframe(client)
    with client.reconnect() as other:
        assert bool(other.view(other.camera).valid.any())
        assert still_keyframe(other).id > other.kept[0].id
        with pytest.raises(StreamClosed):
            client.send_pose(client.camera)
    with pytest.raises(StreamError, match="403"):
        other.reconnect()


def test_what_the_service_refuses_is_said(server: RunningServer) -> None:
    for scene, wishes, status in (("nothing", {}, 404), ("cornell_box", {"layers": 9}, 422)):
        with pytest.raises(StreamError) as caught:
            StreamClient.connect(server.url, scene, size=SIZE, **wishes)
        assert caught.value.problem["status"] == status
    with pytest.raises(InputError, match="url must look like"):
        StreamClient.connect("localhost:80", "cornell_box")
    with pytest.raises(StreamError, match="cannot be reached"):
        StreamClient.connect("http://127.0.0.1:9", "cornell_box", timeout_s=2)


def test_a_keyframe_of_a_pose_can_be_waited_for(server: RunningServer) -> None:
    with StreamClient.connect(server.url, "cornell_box", size=SIZE) as client:
        client.send_pose(client.camera)
        number = client.send_pose(moved(client.camera, 0.05))
        assert client.receive(pose=number).pose >= number


def test_bad_cameras(server: RunningServer) -> None:
    with StreamClient.connect(server.url, "cornell_box", size=SIZE, camera={"name": "close"}) as client:
        with pytest.raises(InputError, match="single perspective camera"):
            client.send_pose(client.camera[[0, 0]])
        skewed = client.camera.intrinsics.clone()
        skewed[:, 0, 1] = 4.0
        with pytest.raises(InputError, match=r"camera: messages tell no skew, intrinsics\[0, 1\] must be 0, got 4"):
            client.send_pose(replace(client.camera, intrinsics=skewed))
        for name in ("velocity", "spin"):
            with pytest.raises(InputError, match=f"{name} must be finite"):
                client.send_pose(client.camera, **{name: (0.0, float("nan"), 0.0)})
        with pytest.raises(InputError, match="nothing was received"):
            client.view(client.camera)
        huge = replace(client.camera, near=torch.tensor(1e18), far=torch.tensor(torch.inf))
        client.send_pose(huge)
        with pytest.raises(StreamError, match="near"):
            client.receive()


@pytest.mark.parametrize(
    ("wish", "told"),
    [
        ({"density": -1}, "density"),
        ({"layers": 9}, "layers"),
        ({"layers": 1.5}, "layers"),
        ({"budget_ms": float("nan")}, "budget_ms"),
        ({"budget_ms": 0.0}, "budget_ms"),
        ({"max_error": 5}, "max_error"),
        ({"asymmetry": "g"}, "asymmetry"),
        ({"playing": object()}, "object"),
        ({"exposure": 99.0}, "exposure"),
        ({"exposure": "bright"}, "exposure"),
        ({"tone_map": "film"}, "tone_map"),
        ({"off": ("fog",)}, "off"),
        ({"speed": 3}, "wish takes no speed"),
    ],
)
def test_wishes_that_the_service_would_refuse_are_told_at_once(
    server: RunningServer, wish: dict[str, object], told: str
) -> None:
    with StreamClient.connect(server.url, "cornell_box", size=SIZE, layers=0) as client:
        with pytest.raises(InputError, match=told):
            client.wish(**wish)
        assert still_keyframe(client).images, "nothing was sent, nothing comes back"


def test_wishes_for_the_look(server: RunningServer) -> None:
    with StreamClient.connect(server.url, "cornell_box", size=SIZE, layers=0) as client:
        before = still_keyframe(client)
        client.wish(exposure=2.0, tone_map="aces", off=("shadows",))
        after = client.receive()
        assert after.id > before.id
        bright = [float(k.images[0].codes.float().mean()) for k in (before, after)]
        assert bright[1] > bright[0] + 10


def test_the_end_of_a_stream_has_its_reason() -> None:
    told = closed(ConnectionClosedError(Close(1008, "keyframes are not acknowledged"), None))
    assert str(told) == "the stream was closed with 1008: keyframes are not acknowledged"
    assert told.retry_after_s is None
    assert str(closed(ConnectionClosedError(None, None))) == "the stream was closed with 1006"


def test_an_address_that_is_not_the_services_is_named(server: RunningServer) -> None:
    for path in ("/x", "/x/y"):
        with pytest.raises(StreamError, match=f"{path}/v1/sessions answers 405 .*: no torchrender service has that"):
            StreamClient.connect(server.url + path, "cornell_box", size=SIZE)
