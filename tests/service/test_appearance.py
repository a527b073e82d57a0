"""Exposure, tone curve, and effects that are left out, in the keyframes of a stream."""

from __future__ import annotations

import base64
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.tonemap import tone_map
from torchrender.wire.cameras import header_of
from torchrender.wire.containers import read_container
from torchrender_service.renderers.jobs import Bounds, MakeKeyframe, SceneSource, SmoothKeyframe
from torchrender_service.renderers.streaming.stream_renderer import StreamRenderer
from torchrender_service.renderers.viewing.appearance import OFF, PACE, Exposure, Wish, as_wished, options_of
from torchrender_service.renderers.viewing.survey import controls_of, survey


@pytest.fixture(scope="module")
def scene() -> tr.Scene:
    return tr.load("cornell_box")


def made(renderer: StreamRenderer, scene: tr.Scene, number: int = 0, **rest: Any) -> Any:
    job = MakeKeyframe(
        session="one", scene=SceneSource(id="cornell_box"), id=number, pose=0, time_ms=0.0,
        camera=header_of(scene.camera(width=48, height=36)), still=True, extra_layers=0, direction=(0.0, 0.0, 0.0),
        baseline=0.0, color="webp", quality=100, bounds=Bounds(), **rest,
    )  # fmt: skip
    return read_container(renderer.make(scene, job, 5)["messages"][0], max_pixels=10**6, max_images=1)[0]


def test_colours_are_exposed_and_tone_mapped(scene: tr.Scene) -> None:
    renderer = StreamRenderer()
    plain = tr.render(scene, scene.camera(width=48, height=36)).radiance[0]
    for number, (ev, curve) in enumerate(((0.0, "none"), (-1.5, "none"), (1.0, "aces"), (0.5, "reinhard"))):
        image = made(renderer, scene, number, exposure=ev, tone_map=curve, settings=number)
        expected = srgb_from_linear(tone_map(plain, curve, exposure=ev)).numpy() * 255
        assert np.abs(image.codes.numpy() - expected).mean() < 4
        header = image.header
        assert (header.exposure, header.tone_map, header.settings, header.revision) == (ev, curve, number, 5)


def test_a_refined_mean_keeps_the_exposure(scene: tr.Scene) -> None:
    """What is white without exposure is not when it is darker: the mean is not clipped before."""
    bright = scene.replace(lights=tuple(replace(light, radiance=30.0 * light.radiance) for light in scene.lights))
    renderer = StreamRenderer()
    one = made(renderer, bright, exposure=-5.0)
    left = 1
    while left:
        answer = renderer.smooth(SmoothKeyframe(session="one", id=1))
        left = answer["left"]
    mean = read_container(answer["messages"][0], max_pixels=10**6, max_images=1)[0]
    assert mean.header.samples == 5 and mean.header.exposure == -5.0
    assert np.abs(mean.codes.numpy().astype(float) - one.codes.numpy()).mean() < 8


def test_an_automatic_exposure_follows_the_light() -> None:
    seen = SimpleNamespace(covered=torch.ones(1, 2, 2, dtype=torch.bool))
    image: Any = SimpleNamespace(radiance=torch.full((1, 2, 2, 3), 0.18), visibility=seen, exposure=0.0)
    exposure = Exposure()
    assert exposure.of(image, "auto", still=False) == pytest.approx(0.0, abs=1e-5)
    image.radiance = image.radiance * 16
    assert exposure.of(image, "auto", still=False) == pytest.approx(-4 * PACE, abs=1e-5), "a part of the way"
    assert exposure.of(image, "auto", still=True) == pytest.approx(-4.0, abs=1e-5), "at rest all of it"
    assert exposure.of(image, 1.5, still=False) == 1.5
    assert exposure.of(image, "as_lit", still=False) == 0.0
    image.exposure = None  # photometric lights
    assert exposure.of(image, "as_lit", still=False) == pytest.approx(-4.0, abs=1e-5)


def test_every_effect_can_be_left_out(scene: tr.Scene) -> None:
    usual = tr.RenderOptions()
    for effect in OFF:
        changed = options_of(usual, (effect,))
        assert changed != usual
    assert options_of(usual, ()) is usual
    assert as_wished(scene, Wish()) is scene
    dark = as_wished(scene, Wish(dark=True))
    assert not dark.lights and dark.is_lit, "not black"
    assert dark.geometry is scene.geometry


def test_rooms_are_walked_through_and_objects_orbited(scene: tr.Scene) -> None:
    """A room is one from outside, too, through its open side."""
    assert controls_of(scene, scene.camera(width=64, height=36)) == "walk"
    ball = tr.Scene(meshes=(tr.Mesh.sphere(1.0),))
    assert controls_of(ball, ball.camera(width=64, height=36)) == "orbit"
    inside = tr.Cameras.look_at((0.0, 0.0, 0.1), (1.0, 0.0, 0.1), width=64, height=36)
    assert controls_of(ball, inside) == "walk"


def test_scenes_without_triangles_are_orbited() -> None:
    sky = tr.Environment(radiance=torch.ones(4, 8, 3))
    for empty in (tr.Scene(), tr.Scene(environment=sky)):
        assert controls_of(empty, empty.camera(width=64, height=36)) == "orbit"
        found = survey(empty)
        assert not found["cameras"] and not any(base64.b64decode(found["obstacles"]["bits"]))


def test_a_survey_tells_what_is_in_the_way(scene: tr.Scene) -> None:
    import base64

    found = survey(scene)
    assert set(found["cameras"]) == set(scene.cameras)
    grid = found["obstacles"]
    nx, ny, nz = grid["dims"]
    packed = np.frombuffer(base64.b64decode(grid["bits"]), np.uint8)
    filled = np.unpackbits(packed, bitorder="little", count=nx * ny * nz).reshape(nz, ny, nx)
    places = scene.geometry.vertices.double().numpy()
    cells = np.clip(np.floor((places - grid["origin"]) / grid["cell"]).astype(int), 0, [nx - 1, ny - 1, nz - 1])
    assert filled[cells[:, 2], cells[:, 1], cells[:, 0]].all(), "every vertex lies in a filled cell"
    assert filled.mean() < 0.2
