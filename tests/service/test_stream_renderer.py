"""Keyframes inside a renderer: what they may cost."""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
import pytest
import torch

import torchrender as tr
from keyframe_jobs import HUNDRED, LOSSLESS_COLOR, STILL, aside, error, job, picture_of
from reflection_scenes import looking, mirror_scene
from torchrender.clock import interruptible
from torchrender.passes.mirrors.hit_shader import look_made_with
from torchrender.passes.mirrors.key_frame import KEY_FRAME
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.procedural.fog import with_fog
from torchrender.wire.cameras import header_of
from torchrender.wire.codec import display_bytes
from torchrender_service.renderers.jobs import Bounds, MakeLayers, SmoothKeyframe
from torchrender_service.renderers.streaming import carrying, stream_renderer, wishes
from torchrender_service.renderers.streaming.carrying import LitViews
from torchrender_service.renderers.streaming.stream_renderer import (
    ASIDE,
    MAX_REFINED,
    STREAMED,
    StreamRenderer,
)
from torchrender_service.renderers.streaming.wishes import MOVING_BUDGET_MS, PACKING_SHARE, STILL_FACTOR
from torchrender_service.renderers.viewing.appearance import wish_of


@pytest.fixture(scope="module")
def scene():
    return load("cornell_box")


def budgets(scene, count: int, *, still: bool = False, bounds: Bounds = HUNDRED) -> list[float | None]:
    """Of the pictures inside ``count`` keyframes of one session, each made anew."""
    renderer = StreamRenderer()
    found = []
    for number in range(count):
        renderer.forget(scene="cornell_box")
        if number:
            renderer._sessions["one"].lit = LitViews()
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


@pytest.mark.parametrize(("ambient", "left"), [(False, 0.5), (True, 0.92)])
def test_a_refinement_becomes_the_mean_of_five_pictures(scene, ambient, left) -> None:
    """Shadows and textures become smooth, as outlines are from the first; the pattern of ambient visibility stays.

    It follows the pixels and is the same in all five.
    """
    scene = scene if ambient else replace(scene, ambient=torch.zeros(3))
    renderer = StreamRenderer()
    first = picture_of(renderer.make(scene, job(scene, 1, extra_layers=2, **STILL))["messages"][0])
    assert first.header.samples == 1
    renderer.make_layers(MakeLayers(session="one", id=1))
    step = renderer.smooth(SmoothKeyframe(session="one", id=2))
    assert step["left"] == 0
    last = picture_of(step["messages"][0])
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

    def painted():
        """Black, but for one pixel of one of the pictures."""
        nonlocal count
        radiance = torch.zeros(48, 64, 3)
        radiance[20, 30] = 50.0 if count == bright else 0.0
        count += 1
        return radiance

    def first(*arguments, **options):
        image, plan = usual(*arguments, **options)
        return replace(image, radiance=painted()[None]), plan

    monkeypatch.setattr(stream_renderer, "render_image", first)
    monkeypatch.setattr(stream_renderer, "moved_aside", lambda _, cameras, *__: [painted() for _ in cameras])
    renderer = StreamRenderer()
    renderer.make(scene, job(scene, 1, **STILL))
    codes = picture_of(renderer.smooth(SmoothKeyframe(session="one", id=2))["messages"][0]).codes
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
    monkeypatch.setattr(wishes, "MOVING_BUDGET_MS", None)  # which might rule reuse out
    monkeypatch.setattr(stream_renderer, "carried_picture", lambda *_, **__: None)  # all are made anew
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
    for number in (0, 1):  # the second one of known light
        renderer.make(scene, job(scene, number, **STILL))
    assert renderer.smooth(SmoothKeyframe(session="one", id=2))["left"] == len(ASIDE)
    renderer.make(scene, job(scene, 2))
    assert renderer.smooth(SmoothKeyframe(session="one", id=3)) == gone
    renderer.make(scene, job(scene, 3, **STILL))
    renderer.forget(session="one")
    assert renderer.smooth(SmoothKeyframe(session="one", id=4)) == gone


def test_layers_come_once_and_only_of_the_last_keyframe(scene) -> None:
    renderer = StreamRenderer()
    asked = renderer.make(scene, job(scene, 1, extra_layers=2))
    first = picture_of(asked["messages"][0]).header
    assert asked["extra_layers"] == 2 and first.layers == 3
    assert renderer.make_layers(MakeLayers(session="one", id=0)) == {"messages": []}
    assert renderer.make_layers(MakeLayers(session="other", id=1)) == {"messages": []}
    found = [picture_of(data).header for data in renderer.make_layers(MakeLayers(session="one", id=1))["messages"]]
    assert [(layer.id, layer.layer, layer.layers) for layer in found] == [(1, 1, 3), (1, 2, 3)]
    assert renderer.make_layers(MakeLayers(session="one", id=1)) == {"messages": []}
    renderer.make(scene, job(scene, 2, extra_layers=1))
    renderer.make(scene, job(scene, 3))
    assert renderer.make_layers(MakeLayers(session="one", id=2)) == {"messages": []}


def test_few_refinements_are_kept(scene) -> None:
    renderer = StreamRenderer()
    for number in range(MAX_REFINED + 1):
        renderer.make(scene, job(scene, number, session=str(number), **STILL))
    made = [renderer.smooth(SmoothKeyframe(session=str(k), id=9))["messages"] for k in range(MAX_REFINED + 1)]
    assert [len(messages) for messages in made] == [0] + [1] * MAX_REFINED


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


def test_a_moving_view_takes_the_light_of_those_at_rest(scene) -> None:
    """Within a budget that leaves nothing but the cheapest settings it looks like the picture at rest."""
    there = aside(scene, 0.01)
    hurry = {"bounds": Bounds(budget_ms=1.0), "camera": header_of(there), **LOSSLESS_COLOR}
    alone = StreamRenderer().make(scene, job(scene, 1, **hurry))["messages"][0]
    renderer = StreamRenderer()
    renderer.make(scene, job(scene, 1, **STILL))
    carried = renderer.make(scene, job(scene, 2, **hurry))["messages"][0]
    plan = picture_of(carried).header.plan
    assert plan is not None and plan["rows"][0]["pass"] == "carried_light"
    assert error(carried, scene, there) < 0.3 * error(alone, scene, there)
    assert error(carried, scene, there) < 4.0


def test_light_of_another_scene_or_with_other_effects_is_not_taken(scene) -> None:
    def carries(renderer: StreamRenderer, scene, **rest) -> bool:
        made = renderer.make(scene, job(scene, 2, **rest))["messages"][0]
        plan = picture_of(made).header.plan
        assert plan is not None
        return any(row["pass"] == "carried_light" for row in plan["rows"])

    renderer = StreamRenderer()
    renderer.make(scene, job(scene, 1, **STILL))
    assert carries(renderer, scene)
    assert not carries(renderer, scene, bounds=Bounds(max_error=0.1)), "an error can be promised of what is made anew"
    assert carries(renderer, scene)
    assert not carries(renderer, scene, off=("shadows",))
    renderer.make(scene, job(scene, 1, **STILL))
    assert carries(renderer, scene)
    assert not carries(renderer, replace(scene, ambient=torch.ones(3)))
    turned = aside(scene, 0.0)
    turned.camera_from_world[0, [0, 2]] *= -1.0
    renderer.make(scene, job(scene, 1, **STILL))
    assert not carries(renderer, scene, camera=header_of(turned)), "the other way nothing of it is seen"


def test_a_view_at_rest_begins_with_what_is_known_and_is_then_made_anew(scene) -> None:
    renderer, there = StreamRenderer(), aside(scene, 0.005)
    renderer.make(scene, job(scene, 1, **STILL))
    first = renderer.make(scene, job(scene, 2, **STILL | {"camera": header_of(there)}))["messages"][0]
    assert error(first, scene, there) < 6.0
    steps = [renderer.smooth(SmoothKeyframe(session="one", id=3)) for _ in range(2)]
    assert [step["left"] for step in steps] == [len(ASIDE), 0], "the first one anew, the others together"
    smooth = picture_of(steps[-1]["messages"][0]).codes.numpy().astype(int)
    fresh = StreamRenderer()
    fresh.make(scene, job(scene, 2, **STILL | {"camera": header_of(there)}))
    anew = picture_of(fresh.smooth(SmoothKeyframe(session="one", id=3))["messages"][0]).codes.numpy()
    assert np.abs(smooth - anew).mean() < 0.5


def test_another_session_begins_with_the_light_of_the_last_smooth_picture(scene) -> None:
    renderer = StreamRenderer()
    renderer.make(scene, job(scene, 1, **STILL))
    smooth = renderer.smooth(SmoothKeyframe(session="one", id=2))["messages"][0]
    before = renderer.bytes

    def error_of_first(session: str) -> float:
        wish = {"session": session, "bounds": Bounds(budget_ms=1.0), **LOSSLESS_COLOR}
        made = picture_of(renderer.make(scene, job(scene, 3, **wish))["messages"][0])
        return float(np.abs(made.codes.numpy() - picture_of(smooth).codes.numpy().astype(float)).mean())

    assert error_of_first("two") < 2.0
    renderer.forget(scene="cornell_box")
    assert error_of_first("three") > 4.0
    assert 0 < before < 2**26


def test_moving_views_are_carried_from_the_first_picture_until_one_is_at_rest(scene) -> None:
    """Also in other sessions: after a renderer died ten that never rest do not all make every picture anew."""
    renderer, there = StreamRenderer(), aside(scene, 0.01)

    def carried(made, number: int = 0) -> bool:
        plan = picture_of(made["messages"][number]).header.plan
        assert plan is not None
        return plan["rows"][0]["pass"] == "carried_light"

    assert not carried(renderer.make(scene, job(scene, 1)))
    wish = {"camera": header_of(there), **LOSSLESS_COLOR}
    second = renderer.make(scene, job(scene, 2, **wish))
    other = renderer.make(scene, job(scene, 1, session="two", **wish))
    assert carried(second) and carried(other)
    assert error(second["messages"][0], scene, there) < 4.0
    assert error(other["messages"][0], scene, there) < 4.0
    assert not carried(renderer.make(scene, job(scene, 3, **STILL))), "a view at rest owes nothing to one in a hurry"
    lit = renderer._sessions["one"].lit
    assert lit.quick is None and len(lit.pictures) == 1
    assert not carried(renderer.make(scene, job(scene, 4, session="two", off=("shadows",))))


def test_what_one_session_has_shaded_no_other_one_shades_again(scene, monkeypatch) -> None:
    """Ten that look at the same after a renderer died would else keep each other waiting for a second."""
    usual, shaded = carrying.shade_pixels, []

    def noting(scene, seen, wanted, options, past):
        shaded.append(int(wanted.sum()))
        return usual(scene, seen, wanted, options, past)

    monkeypatch.setattr(carrying, "shade_pixels", noting)
    renderer, there = StreamRenderer(), aside(scene, 0.06)
    wish = {"camera": header_of(there), **LOSSLESS_COLOR}

    def fresh(number: int, session: str, **rest) -> int:
        shaded.clear()
        made = renderer.make(scene, job(scene, number, session=session, **wish, **rest))["messages"][0]
        assert error(made, scene, there) < 4.0 or rest
        return sum(shaded)

    renderer.make(scene, job(scene, 1))
    first = fresh(2, "one")
    before = renderer.bytes
    assert first > 10 and fresh(1, "two") < 0.2 * first
    assert fresh(1, "three", off=("shadows",)) == 0, "made as a whole: light with shadows is none without"
    renderer.make(scene, job(scene, 1, session="four"))
    assert fresh(2, "four") < 0.2 * first, "what another wish made took nothing away"
    assert renderer._beginnings.bytes > 84 * first and renderer.bytes > before
    renderer.forget(scene="cornell_box")
    renderer.make(scene, job(scene, 1, session="five"))
    assert fresh(2, "five") > 0.5 * first


LEISURELY = {"bounds": Bounds(budget_ms=5000.0)}
"""Of moving views, however busy the machine is."""


@pytest.mark.parametrize("first", [LEISURELY, STILL], ids=["moving", "at rest"])
def test_a_moving_view_that_turned_away_is_carried_from_there_on(scene, first) -> None:
    """Only the first picture of what none has shown is made anew; those from before serve the way back."""
    renderer = StreamRenderer()

    def carried(number: int, camera: Cameras, **rest) -> bool:
        made = renderer.make(scene, job(scene, number, camera=header_of(camera), **rest))["messages"][0]
        plan = picture_of(made).header.plan
        assert plan is not None
        return plan["rows"][0]["pass"] == "carried_light"

    turned, further = aside(scene, 0.0), aside(scene, 0.01)
    for camera in (turned, further):
        camera.camera_from_world[0, [0, 2]] *= -1.0
    renderer.make(scene, job(scene, 1, **first))
    assert not carried(2, turned, **LEISURELY)
    assert carried(3, further, **LEISURELY)
    assert carried(4, aside(scene, 0.01), **LEISURELY) or first is LEISURELY
    assert not carried(5, further, **STILL), "a view at rest owes nothing to one in a hurry"


def test_what_no_picture_shows_is_filled_along_its_surface(scene) -> None:
    """Of many pixels that are new a lattice is shaded, and those between look like what is around them."""
    renderer, there = StreamRenderer(), aside(scene, 0.06)
    renderer.make(scene, job(scene, 1, **STILL))
    lit = renderer._sessions["one"].lit
    lit.room = 64
    wish = {"camera": header_of(there), "bounds": Bounds(budget_ms=100.0), **LOSSLESS_COLOR}
    made = renderer.make(scene, job(scene, 2, **wish))["messages"][0]
    assert error(made, scene, there) < 8.0
    assert not (picture_of(made).codes.amax(dim=-1) == 0).any(), "no pixel stays black"


def test_a_moving_view_shades_few_pixels_and_those_quickly(scene, monkeypatch) -> None:
    """About as many as it has time for, at the borders too, and what takes as long for few as for all is left out."""
    usual, shaded = carrying.shade_pixels, []

    def noting(scene, seen, wanted, options, past):
        shaded.append((int(wanted.sum()), options))
        return usual(scene, seen, wanted, options, past)

    monkeypatch.setattr(carrying, "shade_pixels", noting)
    renderer, camera = StreamRenderer(), scene.camera(width=64, height=48)
    renderer.make(scene, job(scene, 1, **STILL, camera=header_of(camera.sub_camera(12, 9, 40, 30))))
    renderer._sessions["one"].lit.room = 64
    renderer.make(scene, job(scene, 2))
    renderer.make(scene, job(scene, 3, **STILL))
    renderer.make(scene, job(scene, 4, **STILL, camera=header_of(aside(scene, 0.06))))
    (few, quick), (_, exact) = shaded
    assert 32 < few < 2 * 64
    assert quick.tracing.bounces == exact.tracing.bounces == 1 < STREAMED.tracing.bounces
    assert quick.scattering.slices < exact.scattering.slices and quick.shadow == exact.shadow, "no shadow vanishes"
    assert look_made_with(quick) == look_made_with(exact), "both share what shades hits"


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


def test_a_picture_in_a_hurry_is_as_bright_as_one_at_rest(scene) -> None:
    """Ambient visibility is found quickly rather than left out, but where the session leaves it out."""
    lit = replace(scene, lights=(), ambient=torch.full((3,), 0.8))
    camera = lit.camera(width=240, height=180)
    hurry = {"bounds": Bounds(budget_ms=1.0), "camera": header_of(camera), **LOSSLESS_COLOR}

    def mean(options=STREAMED, **rest) -> tuple[float, float]:
        made = picture_of(StreamRenderer().make(lit, job(lit, 1, **hurry, **rest))["messages"][0])
        wanted = display_bytes(render(lit, camera, options=options).radiance[0])
        return float(made.codes.numpy().mean()), float(wanted.mean())

    open_, open_wanted = mean(replace(STREAMED, ambient_visibility="off"), off=("ambient",))
    shut, shut_wanted = mean()
    assert open_wanted > shut_wanted + 5.0, "it matters here"
    assert abs(shut - shut_wanted) < 0.5 * (open_wanted - shut_wanted)
    assert abs(open_ - open_wanted) < 0.2 * (open_wanted - shut_wanted)


def test_a_preview_is_made_at_the_fastest_settings_and_leaves_no_light(scene) -> None:
    """Others would spread its few pixels over all of theirs."""
    renderer = StreamRenderer()
    made = picture_of(
        renderer.make(scene, job(scene, 1, preview=True, bounds=Bounds(), **LOSSLESS_COLOR))["messages"][0]
    )
    rows = {row["pass"]: row for row in made.header.plan["rows"] if row["runs"]}
    assert made.header.plan["budget_ms"] is None, "there is no search"
    assert rows["gbuffer"]["settings"] == "1" and rows["soft_shadow"]["settings"] == "hard"
    state = renderer._sessions["one"]
    assert state.lit.quick is None and not state.lit.pictures and state.packing_ms == 0.0
    wanted = display_bytes(render(scene, scene.camera(width=64, height=48), options=STREAMED).radiance[0])
    assert abs(float(made.codes.numpy().mean()) - float(wanted.mean())) < 4.0, "as bright as others"


def test_a_picture_at_rest_can_be_taken_back_while_its_edges_are_smoothed(scene) -> None:
    renderer = StreamRenderer()
    looks: list[str] = []  # whose steps these are
    with interruptible(lambda: looks.append(sys._getframe(4).f_code.co_name)):
        renderer.make(scene, job(scene, 1, **STILL))
        assert looks.count("smooth_edges") == 2 * len(ASIDE)
        while renderer.smooth(SmoothKeyframe(session="one", id=2))["left"]:
            pass
    assert looks.count("moved_aside") == 2 * len(ASIDE)


def test_a_picture_in_a_hurry_mirrors_what_is_there() -> None:
    """What stands on a shiny floor is mirrored in it, not the windows that the middle of the room sees."""
    room = load("living_room", size=20_000)
    camera = room.camera(width=320, height=200)
    hurry = {"bounds": Bounds(budget_ms=1.0), "camera": header_of(camera), **LOSSLESS_COLOR}

    def brighter(options=STREAMED, **rest) -> tuple[float, float]:
        """Than a picture at rest, in the mean; and by how much blocks of 20 x 20 pixels differ, but for the worst."""
        made = picture_of(StreamRenderer().make(room, job(room, 1, **hurry, **rest))["messages"][0])
        wanted = display_bytes(render(room, camera, options=options).radiance[0]).astype(float)
        blocks = (made.codes.numpy() - wanted).mean(-1).reshape(10, 20, 16, 20).mean((1, 3))
        return float(blocks.mean()), float(np.quantile(np.abs(blocks), 0.95))

    mean, local = brighter()
    plain, plain_local = brighter(replace(STREAMED, reflections="off"), off=("reflections",))
    assert mean - plain < 3.8, "mirrors make it brighter by little"
    assert local < 2.0 * plain_local


def test_a_moving_picture_is_as_smooth_as_one_at_rest(monkeypatch) -> None:
    """What changes from pixel to pixel comes as the mean of as many places; a preview is smooth by being small."""
    texture = torch.rand(64, 64, 3, generator=torch.Generator().manual_seed(7))
    scene = tr.Scene(
        meshes=(tr.Mesh.plane(4.0),),
        materials=(tr.Material(diffuse_texture=texture),),
        lights=(tr.DirectionalLight(direction=(0.2, -1.0, 0.1)),),
        cameras={"above": tr.Cameras.look_at((0.0, 3.0, 0.1), (0.0, 0.0, 0.0), width=64, height=48, fov_deg=50.0)},
    )
    there = header_of(aside(scene, 0.01))

    def codes(**rest) -> tuple[np.ndarray, np.ndarray]:
        """Of a moving picture, after one at rest elsewhere, and of the first at rest of the same view."""
        renderer = StreamRenderer()
        renderer.make(scene, job(scene, 1, **STILL))
        made = [job(scene, 2, camera=there, **LOSSLESS_COLOR, **rest), job(scene, 3, camera=there, **STILL)]
        moving, still = (picture_of(renderer.make(scene, one)["messages"][0]).codes.numpy() for one in made)
        return moving.astype(float), still.astype(float)

    off = [np.abs(np.subtract(*codes(**rest))).mean() for rest in ({}, {"preview": True})]
    monkeypatch.setattr(stream_renderer, "mean_of_places", lambda *given: given[1])
    off += [np.abs(np.subtract(*codes(**rest))).mean() for rest in ({}, {"preview": True})]
    assert off[0] < 0.5 * off[2], "it is smoother, and so nearer"
    assert off[1] == off[3], "a preview stays as it is"
