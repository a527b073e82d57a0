"""What shows of several pictures: whose sky, and what of an earlier keyframe's outlines.

No sky is nearer than another, so the preferred picture's own shows wherever it reaches: through media every view has a
sky of its own, and an earlier one would be wrong.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

import torchrender as tr
from browser_stage import JPEG_READY, Visit, grown, run_script
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of
from torchrender_service.renderers.keyframes import Stamp, first_message, layer_message
from torchrender_service.renderers.streaming.layers import Layer

SIZE = (96, 64)
SKIES = ((0.8, 0.1, 0.1), (0.1, 0.7, 0.1), (0.1, 0.1, 0.9))
"""Of the newest keyframe, an earlier one, and its extra layer: linear."""
TURNS = (0.0, 0.35, -0.35)
WALL = 2.0
"""Depth of what the earlier keyframe shows in its upper half."""
SCRIPT = """
    const { Decoder } = await import("/js/decoder.js");
    const { Warp } = await import("/js/warp.js");
    const decoder = new Decoder();
    const warp = new Warp(document.createElement("canvas"));
    warp.resize(given.view.width, given.view.height);
    const pictures = [];
    for (const message of given.messages) pictures.push(warp.add(await decoder.decode(bytes(message).buffer, 1e8)));
    decoder.worker.terminate();
    warp.warp(pictures, given.view, 0.01);
    return text(warp.capture(false));
"""


def turned(angle: float, fov_deg: float) -> Cameras:
    """From the origin, so many radians to the right of the z axis."""
    ahead = (float(np.sin(angle)), 0.0, float(np.cos(angle)))
    return tr.Cameras.look_at((0.0, 0.0, 0.0), ahead, width=SIZE[0], height=SIZE[1], fov_deg=fov_deg, near=0.01)


def sees(camera: Cameras, view: Cameras) -> np.ndarray[Any, Any]:
    """(H,W) bool: pixels of a view that look where a camera from the same place does."""
    ways = view.rays()[1][0].reshape(-1, 3) @ camera.rotation[0].T
    k = camera.intrinsics[0].numpy()
    x, y, z = ways.numpy().T
    u, v = k[0, 0] * x / z + k[0, 2], k[1, 1] * y / z + k[1, 2]
    return ((z > 0) & (u > 0) & (v > 0) & (u < SIZE[0]) & (v < SIZE[1])).reshape(SIZE[1], SIZE[0])


def message(rank: int, camera: Cameras, depth: torch.Tensor) -> bytes:
    """A keyframe, or an extra layer, with one colour all over."""
    light = torch.tensor(SKIES[rank]).expand(*depth.shape, 3).contiguous()
    stamp = Stamp(id=rank, layers=1, color="webp", quality=100)
    if rank < 2:
        return first_message(stamp, camera, depth, light, render_ms=0.0, plan=None)
    known = torch.ones(depth.shape, dtype=torch.bool)
    return layer_message(Stamp(id=0, layers=2, color="webp"), 1, Layer(camera, depth, light, known), render_ms=0.0)


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)], ids=str)
def test_the_preferred_sky_shows_where_it_reaches(visit: Callable[..., Visit], order: tuple[int, ...]) -> None:
    page, view = visit(layers=0), turned(0.1, 70.0)
    page.wait(JPEG_READY)
    cameras = [turned(angle, 45.0) for angle in TURNS]
    depth = torch.full((SIZE[1], SIZE[0]), torch.inf)
    messages = [message(rank, cameras[rank], depth) for rank in order]
    shown = drawn(page, messages, view)
    expected = np.full((SIZE[1], SIZE[0]), -1)
    for rank in reversed(order):
        expected[sees(cameras[rank], view)] = rank
    assert {*np.unique(expected)} == {-1, 0, 1, 2}, "each sky shows somewhere, and nothing somewhere else"
    inside = np.ones_like(expected, dtype=bool)
    for rank in order:
        region = sees(cameras[rank], view)
        inside &= ~(grown(region) & grown(~region))
    assert (shown == expected)[inside].all() and inside.mean() > 0.7


def test_a_surface_hides_the_preferred_sky(visit: Callable[..., Visit]) -> None:
    page, view = visit(layers=0), turned(0.01, 40.0)
    page.wait(JPEG_READY)
    camera = turned(0.0, 45.0)
    sky = torch.full((SIZE[1], SIZE[0]), torch.inf)
    wall = sky.clone()
    wall[: SIZE[1] // 2] = WALL
    shown = drawn(page, [message(0, camera, sky), message(1, camera, wall)], view)
    assert (shown[: SIZE[1] // 2 - 2] == 1).all() and (shown[SIZE[1] // 2 + 2 :] == 0).all()


def test_outlines_of_earlier_keyframes_leave_no_ring(visit: Callable[..., Visit]) -> None:
    """Smooth outlines hold the colours of both sides: on the wall behind they would stay when the view moves."""
    page, camera = visit(layers=0), turned(0.0, 45.0)
    page.wait(JPEG_READY)
    depth = torch.full((SIZE[1], SIZE[0]), 2.0 * WALL)
    light = torch.tensor((0.05, 0.05, 0.5)).repeat(SIZE[1], SIZE[0], 1)
    light[19:45, 35:61] = torch.tensor((0.4, 0.05, 0.2))  # a pixel wide around what is near
    depth[20:44, 36:60] = WALL
    light[20:44, 36:60] = torch.tensor((0.8, 0.05, 0.05))
    stamp = Stamp(id=1, layers=1, color="webp", quality=100, still=True, samples=5)
    earlier = first_message(stamp, camera, depth, light, render_ms=0.0, plan=None)
    elsewhere = message(0, turned(2.5, 45.0), torch.full_like(depth, WALL))
    aside = replace(camera, camera_from_world=camera.camera_from_world.clone())
    aside.camera_from_world[0, 0, 3] -= 0.3
    shown = drawn(page, [elsewhere, earlier], aside)
    columns = (shown == 0).any(axis=0).nonzero()[0]
    assert 23 <= columns[-1] - columns[0] + 1 <= 25, "the square alone is red"
    assert (shown == 2).mean() > 0.7
    first = drawn(page, [earlier, elsewhere], camera)
    assert (first[19:45, 35:61] == 0).all(), "where it was taken, the newest picture shows as it came"


def drawn(page: Visit, messages: list[bytes], view: Cameras) -> np.ndarray[Any, Any]:
    """(H,W) whose sky each pixel shows, by its colour; -1: none."""
    header = header_of(view)
    camera = {name: getattr(header, name) for name in header.__struct_fields__}
    packed = [base64.b64encode(one).decode() for one in messages]
    got = base64.b64decode(run_script(page.page, SCRIPT, messages=packed, view=camera))
    pixels = np.frombuffer(got, np.uint8).reshape(SIZE[1], SIZE[0], 4)
    return np.where(pixels[..., 3] > 0, pixels[..., :3].argmax(axis=-1), -1)
