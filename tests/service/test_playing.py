"""Streams of scenes that move: a clock per session, and keyframes of the scene at its time."""

from __future__ import annotations

import pytest
import torch

from torchrender.scene.load import load
from torchrender.wire.cameras import header_of
from torchrender.wire.containers import decode_keyframe
from torchrender.wire.messages import Keyframe, Pose, Type, decode, split_blobs
from torchrender_service.renderers.jobs import Bounds, MakeKeyframe, SceneSource
from torchrender_service.renderers.streaming.stream_renderer import StreamRenderer
from torchrender_service.streams.placement import Placement, Shown
from torchrender_service.streams.sessions import SceneClock


def test_a_clock_counts_while_it_plays() -> None:
    clock = SceneClock()
    assert clock.at(5.0) is None
    clock.play(False, 5.0)
    assert clock.at(6.0) is None, "what never played stands as its file does"
    clock.play(True, 10.0)
    assert clock.at(12.5) == 2.5
    clock.play(True, 13.0)
    assert clock.at(14.0) == 4.0
    clock.play(False, 14.0)
    assert clock.at(99.0) == 4.0
    clock.play(True, 100.0)
    assert clock.at(101.0) == 5.0


def test_a_scene_that_plays_needs_the_next_keyframe_at_once() -> None:
    camera = header_of(load("cornell_box").camera(width=8, height=8))
    placement = Placement(0.5, 0.0)
    placement.take_pose(Pose(seq=1, time_ms=0.0, camera=camera, moving=False), 0.0)
    placement.begin(0, 0.0, timed=True)
    placement.done(0, Shown(camera, 1.0, 1.0, True, smooth=True))
    assert placement.due(9.0) is None
    placement.playing = True
    assert placement.due(9.0) == "moving"
    placement.begin(1, 9.0, timed=True)
    assert placement.due(9.1) is None, "two are on the way"


def test_keyframes_show_the_scene_at_its_time() -> None:
    scene = load("walker", size=3000)
    camera = header_of(scene.camera("above", width=48, height=36))
    renderer = StreamRenderer()
    found = []
    for number, seconds in enumerate((None, 2.0, 10.0, 4.0)):
        job = MakeKeyframe(
            session="s", scene=SceneSource(id="walker"), id=number, pose=0, time_ms=0.0, camera=camera, still=False,
            extra_layers=0, direction=(0.0, 0.0, 0.0), baseline=0.0, color="jpeg", quality=90,
            bounds=Bounds(budget_ms=10.0), scene_s=seconds,
        )  # fmt: skip
        received = decode(renderer.make(scene, job)["messages"][0], (Type.KEYFRAME,))
        assert isinstance(received.message, Keyframe)
        found.append((received.message, decode_keyframe(received.message, split_blobs(received), received.blobs)))
    assert [header.scene_s for header, _ in found] == [None, 2.0, pytest.approx(2.0), 4.0], "it plays again and again"
    depth = [image.depth for _, image in found]
    assert torch.allclose(depth[1], depth[2]) and not torch.allclose(depth[1], depth[3])
