"""Pictures of a view at rest: shadows by maps that are there, and margins of what was sent first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from keyframe_jobs import STILL, aside, job, picture_of
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP
from torchrender.pipeline.history import RenderHistory
from torchrender.renderer import render
from torchrender.scene.light import PointLight
from torchrender.scene.load import load
from torchrender.scene.procedural.fog import with_fog
from torchrender.wire.cameras import header_of
from torchrender_service.renderers.jobs import Bounds, SmoothKeyframe
from torchrender_service.renderers.streaming import stream_renderer
from torchrender_service.renderers.streaming.rest import coarseness, with_maps_at_hand
from torchrender_service.renderers.streaming.stream_renderer import STREAMED, StreamRenderer


@pytest.fixture(scope="module")
def scene():
    return load("cornell_box")


def foggy(scene):
    return with_fog(scene, {"scattering": 0.6})


def made_of_all(scene, camera, options=STREAMED):
    """A picture with the maps of everything that it leaves."""
    shadow = replace(options.shadow, coverage="scene")
    wish = replace(options, shadow=shadow, buffers=(SCENE_SHADOW_MAP.name,))
    return render(scene, camera, options=wish, history=RenderHistory.alone())


def test_shadows_are_by_maps_of_everything_where_these_are_there_and_fine_enough(scene) -> None:
    camera = scene.camera(width=64, height=48)
    image = made_of_all(scene, camera)
    past = image.history
    assert past is not None
    assert with_maps_at_hand(scene, camera, STREAMED, past).shadow.coverage == "scene"
    other = replace(scene, lights=(PointLight(position=[0.0, 0.0, 0.0]),))
    filtered = replace(STREAMED, shadow=replace(STREAMED.shadow, edges="map"))
    for lit, options, history in (
        (scene, STREAMED, RenderHistory.alone()),
        (scene, replace(STREAMED, shadows=False), past),
        (scene, filtered, past),
        (other, STREAMED, past),
    ):
        assert with_maps_at_hand(lit, camera, options, history) is options
    few = replace(STREAMED, shadow=replace(STREAMED.shadow, size=64))
    coarse = made_of_all(scene, camera, few)
    assert coarse.history is not None
    assert with_maps_at_hand(scene, camera.scaled(8.0), few, coarse.history) is few


def test_texels_are_measured_in_pixels(scene) -> None:
    camera = scene.camera(width=64, height=48)
    image = made_of_all(scene, camera)
    (made,), few = image.buffers[SCENE_SHADOW_MAP.name], image.visibility
    assert coarseness(made, camera.scaled(2.0), few) == pytest.approx(2.0 * coarseness(made, camera, few))
    nothing = replace(few, triangle=torch.full_like(few.triangle, -1))
    assert coarseness(made, camera, nothing) == 0.0


@pytest.mark.parametrize(("make", "shown"), [(lambda scene: scene, (72, 54)), (foggy, (96, 72))], ids=["clear", "haze"])
def test_what_is_made_anew_after_a_carried_picture_is_what_is_shown(scene, make, shown, monkeypatch) -> None:
    """The margin keeps the light that was carried into it; moving views take both."""
    scene, sizes = replace(make(scene), ambient=torch.zeros(3)), []  # of few rays, whose pattern follows the pixels
    usual = stream_renderer.render_image

    def noted(scene, camera, *rest):
        sizes.append((camera.width, camera.height))
        return usual(scene, camera, *rest)

    monkeypatch.setattr(stream_renderer, "render_image", noted)
    renderer, wish = StreamRenderer(), {**STILL, "margin": (12, 9), "mirrors": True}
    there = [replace(aside(scene, right), width=64, height=48).scaled(1.5) for right in (0.0, 0.005)]
    for number, camera in enumerate(there):
        first = renderer.make(scene, job(scene, number, **wish, camera=header_of(camera)))["messages"][0]
    assert sizes == [(96, 72)], "the second one is carried"
    made = renderer.smooth(SmoothKeyframe(session="one", id=2))
    assert sizes[1:] == [shown]
    while made["left"]:
        made = renderer.smooth(SmoothKeyframe(session="one", id=2))
    fresh = StreamRenderer()
    fresh.make(scene, job(scene, 1, **wish, camera=header_of(there[1])))
    anew = fresh.smooth(SmoothKeyframe(session="one", id=2))["messages"][0]
    last, first, anew = (picture_of(data).codes.numpy().astype(int) for data in (made["messages"][0], first, anew))
    inner = np.zeros((72, 96), dtype=bool)
    inner[9:-9, 12:-12] = True
    assert np.abs(last - anew)[inner].mean() < 0.5
    assert np.abs(last - anew)[~inner].mean() < 4.0
    assert renderer._sessions["one"].lit.pictures[-1].light.shape == (72, 96, 3)


def test_a_bound_of_the_error_is_kept_by_maps_that_fit(scene, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(stream_renderer, "with_maps_at_hand", lambda *given: asked.append(1) or given[2])
    for bounds in (Bounds(max_error=0.05), Bounds()):
        renderer = StreamRenderer()
        for number in range(2):
            camera = header_of(aside(scene, 0.005 * number))
            renderer.make(scene, job(scene, number, **STILL | {"camera": camera, "bounds": bounds}))
        while renderer.smooth(SmoothKeyframe(session="one", id=2))["left"]:
            pass
        assert len(asked) == 2 * (bounds == Bounds())
