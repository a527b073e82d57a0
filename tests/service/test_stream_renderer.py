"""Keyframes inside a renderer: what they may cost."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import torch

from reflection_scenes import looking, mirror_scene
from torchrender.passes.mirrors.key_frame import KEY_FRAME
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.renderer import render
from torchrender.scene.load import load
from torchrender.scene.procedural.fog import with_fog
from torchrender.wire.cameras import header_of
from torchrender.wire.codec import display_bytes
from torchrender.wire.containers import KeyframeImage, read_container
from torchrender_service.renderers import stream_renderer
from torchrender_service.renderers.jobs import Bounds, MakeKeyframe, MakeLayers, SceneSource, SmoothKeyframe
from torchrender_service.renderers.stream_renderer import (
    ASIDE,
    MAX_REFINED,
    MOVING_BUDGET_MS,
    PACKING_SHARE,
    STILL_FACTOR,
    STREAMED,
    StreamRenderer,
)
from torchrender_service.renderers.viewing.appearance import wish_of

HUNDRED = Bounds(budget_ms=100.0)


@pytest.fixture(scope="module")
def scene():
    return load("cornell_box")


def job(scene, number: int = 0, **rest) -> MakeKeyframe:
    given = {
        "session": "one",
        "scene": SceneSource(id="cornell_box"),
        "id": number,
        "pose": number,
        "time_ms": 0.0,
        "camera": header_of(scene.camera(width=64, height=48)),
        "still": False,
        "extra_layers": 0,
        "direction": (0.0, 0.0, 0.0),
        "baseline": 0.0,
        "color": "jpeg",
        "quality": 85,
        "bounds": HUNDRED,
    }
    return MakeKeyframe(**given | rest)


def picture_of(data: bytes) -> KeyframeImage:
    return read_container(data, max_pixels=10**6, max_images=1)[0]


def budgets(scene, count: int, *, still: bool = False, bounds: Bounds = HUNDRED) -> list[float | None]:
    """Of the pictures inside ``count`` keyframes of one session."""
    renderer = StreamRenderer()
    found = []
    for number in range(count):
        made = renderer.make(scene, job(scene, number, still=still, bounds=bounds))
        plan = picture_of(made["messages"][0]).header.plan
        assert plan is not None
        found.append(plan["budget_ms"])
    return found


def test_a_budget_is_for_the_whole_keyframe(scene, monkeypatch) -> None:
    """What it took to pack the one before is kept free, half of the budget at most."""
    slow = stream_renderer.first_message

    def slower(*arguments, **options):
        time.sleep(pause)
        return slow(*arguments, **options)

    monkeypatch.setattr(stream_renderer, "first_message", slower)
    pause = 0.02
    first, second = budgets(scene, 2)
    assert first == 100.0
    assert second is not None and second <= 80.0
    pause = 0.2
    assert budgets(scene, 2)[1] == pytest.approx((1.0 - PACKING_SHARE) * 100.0)


def test_refinements_may_cost_more_and_moving_pictures_have_a_budget_anyway(scene) -> None:
    assert budgets(scene, 1, still=True) == [STILL_FACTOR * 100.0]
    assert budgets(scene, 1, bounds=Bounds()) == [MOVING_BUDGET_MS]
    assert budgets(scene, 1, still=True, bounds=Bounds()) == [None]


STILL = {"still": True, "bounds": Bounds(), "color": "webp", "quality": 100}


@pytest.mark.parametrize(("ambient", "left"), [(False, 0.5), (True, 0.75)])
def test_a_refinement_becomes_the_mean_of_five_pictures(scene, ambient, left) -> None:
    """Edges become smooth; the pattern of ambient visibility, the same in all five, stays: it follows the pixels."""
    scene = scene if ambient else replace(scene, ambient=torch.zeros(3))
    renderer = StreamRenderer()
    first = picture_of(renderer.make(scene, job(scene, 1, extra_layers=2, **STILL))["messages"][0])
    assert first.header.samples == 1
    renderer.make_layers(MakeLayers(session="one", id=1))
    steps = [renderer.smooth(SmoothKeyframe(session="one", id=2)) for _ in ASIDE]
    assert [step["left"] for step in steps] == [3, 2, 1, 0]
    assert not any(step["messages"] for step in steps[:-1])
    last = picture_of(steps[-1]["messages"][0])
    assert (last.header.id, last.header.samples, last.header.layers, last.header.still) == (2, 5, 3, True)
    assert last.header.pose == first.header.pose
    assert (last.depth == first.depth).all()
    assert len(renderer.make_layers(MakeLayers(session="one", id=2))["messages"]) == 2
    camera = scene.camera(width=64, height=48)
    reference = display_bytes(render(scene, camera, options=replace(STREAMED, supersample=4.0)).radiance[0]).astype(
        float
    )
    errors = [np.abs(picture.codes.numpy() - reference).mean() for picture in (first, last)]
    assert errors[1] < left * errors[0]


@pytest.mark.parametrize("bright", range(1 + len(ASIDE)))
def test_a_pixel_too_bright_in_one_picture_counts_as_white_once(scene, monkeypatch, bright) -> None:
    """Light beyond white would else outshine the other pictures: edges of lamps would stay jagged."""
    usual = stream_renderer.render_image
    count = 0

    def painted(*arguments, **options):
        """Black, but for one pixel of one of the pictures."""
        nonlocal count
        image, plan = usual(*arguments, **options)
        radiance = torch.zeros_like(image.radiance)
        radiance[0, 20, 30] = 50.0 if count == bright else 0.0
        count += 1
        return replace(image, radiance=radiance), plan

    monkeypatch.setattr(stream_renderer, "render_image", painted)
    renderer = StreamRenderer()
    renderer.make(scene, job(scene, 1, **STILL))
    steps = [renderer.smooth(SmoothKeyframe(session="one", id=2)) for _ in ASIDE]
    codes = picture_of(steps[-1]["messages"][0]).codes
    expected = torch.zeros(48, 64, 3)
    expected[20, 30] = 1.0 / (1 + len(ASIDE))
    assert count == 1 + len(ASIDE)
    assert np.array_equal(codes.numpy(), display_bytes(expected))


def test_a_new_session_shares_what_a_scene_has_but_no_reflections(monkeypatch) -> None:
    """Reused reflections are of the views before, and those were another client's."""
    usual, given = stream_renderer.render_image, []

    def noting(scene, camera, bounds, options=None, history=None):
        given.append(history)
        return usual(scene, camera, bounds, options, history)

    monkeypatch.setattr(stream_renderer, "render_image", noting)
    renderer, scene = StreamRenderer(), mirror_scene()
    monkeypatch.setattr(stream_renderer, "MOVING_BUDGET_MS", None)  # which might rule reuse out
    wish = {"bounds": Bounds(), "camera": header_of(looking(48))}
    for number, session in enumerate(("one", "one", "one", "two")):
        renderer.make(scene, job(scene, number, session=session, **wish))
    kept = [history.kept for history in given]
    assert not kept[0]
    assert KEY_FRAME.name in kept[2], "the scene mirrors, and the same session goes on"
    assert KEY_FRAME.name not in kept[3]
    assert kept[3][RAY_CASTER.name].value is kept[2][RAY_CASTER.name].value


def test_a_refinement_that_was_overtaken_is_not_gone_on_with(scene) -> None:
    renderer = StreamRenderer()
    gone = {"messages": [], "left": 0}
    assert renderer.smooth(SmoothKeyframe(session="one", id=1)) == gone
    renderer.make(scene, job(scene, 1, **STILL))
    assert renderer.smooth(SmoothKeyframe(session="one", id=2))["left"] == 3
    renderer.make(scene, job(scene, 2))
    assert renderer.smooth(SmoothKeyframe(session="one", id=3)) == gone
    renderer.make(scene, job(scene, 3, **STILL))
    renderer.forget(session="one")
    assert renderer.smooth(SmoothKeyframe(session="one", id=4)) == gone


def test_few_refinements_are_kept(scene) -> None:
    renderer = StreamRenderer()
    for number in range(MAX_REFINED + 1):
        renderer.make(scene, job(scene, number, session=str(number), **STILL))
    left = [renderer.smooth(SmoothKeyframe(session=str(k), id=9))["left"] for k in range(MAX_REFINED + 1)]
    assert left == [0] + [3] * MAX_REFINED


def test_mirrors_come_as_a_layer_of_their_own_to_those_who_ask() -> None:
    room, camera = mirror_scene(), header_of(looking(64))
    plain = StreamRenderer().make(room, job(room, camera=camera, bounds=Bounds(budget_ms=5000.0)))
    made = StreamRenderer().make(room, job(room, camera=camera, bounds=Bounds(budget_ms=5000.0), mirrors=True))
    assert len(plain["messages"]) == 1 and len(made["messages"]) == 2
    first, mirrors = (picture_of(message) for message in made["messages"])
    assert (first.header.layers, mirrors.header.layer) == (2, 1)
    assert mirrors.header.mirrors and not first.header.mirrors
    assert int(mirrors.known.sum()) > 300
    shown = mirrors.known & torch.isfinite(mirrors.depth)
    assert bool((mirrors.depth[shown] > first.depth[shown]).all())  # behind the glass
    dull = load("cornell_box")
    assert len(StreamRenderer().make(dull, job(dull, mirrors=True))["messages"]) == 1


def test_media_follow_a_session_without_a_scene_being_loaded(scene) -> None:
    foggy = with_fog(scene, {"scattering": 0.4})
    renderer = StreamRenderer()
    lossless = {"color": "webp", "quality": 100}

    def light(number: int, **rest) -> np.ndarray:
        made = renderer.make(foggy, job(foggy, number, **lossless, **rest))
        return picture_of(made["messages"][0]).codes.numpy().astype(float)

    usual, thick, clear = light(0), light(1, density=8.0), light(2, density=0.0)
    assert np.abs(thick - usual).mean() > 5 and np.abs(clear - usual).mean() > 5
    state = renderer._sessions["one"]
    before = state.as_wished(foggy, wish_of(job(foggy, density=3.0)))
    assert state.as_wished(foggy, wish_of(job(foggy, density=3.0))) is before, "the same wish is the same scene"
    assert before.geometry is foggy.geometry
