"""Views through media and panes: what these add and take belongs to the eye's rays and is carried nowhere; what lies
behind may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from keyframe_jobs import LOSSLESS_COLOR, STILL, aside, error, job, picture_of
from torchrender.pipeline.history import RenderHistory
from torchrender.renderer import render
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.procedural.fog import with_fog
from torchrender.wire.cameras import header_of
from torchrender.wire.codec import display_bytes
from torchrender_service.renderers.jobs import Bounds, SmoothKeyframe
from torchrender_service.renderers.streaming import stream_renderer
from torchrender_service.renderers.streaming.glass import veiled
from torchrender_service.renderers.streaming.haze import is_hazy
from torchrender_service.renderers.streaming.layers import cameras_around, extra_layers
from torchrender_service.renderers.streaming.samples import background_of
from torchrender_service.renderers.streaming.stream_renderer import ASIDE, STREAMED, StreamRenderer
from torchrender_service.renderers.viewing.appearance import options_of


def foggy():
    return with_fog(load("cornell_box"), {"scattering": 0.6})


def paned():
    """With a pane before the boxes, half transparent."""
    scene = load("cornell_box")
    half = tuple(
        replace(m, blend=True, alpha_cutoff=None, opacity=0.5) if k == 0 else m for k, m in enumerate(scene.materials)
    )
    return replace(scene, materials=half)


def patterned():
    """The same, and the pane is of several colours."""
    scene = paned()
    first = replace(scene.materials[0], diffuse_texture=torch.rand(4, 4, 3, generator=torch.Generator().manual_seed(0)))
    return replace(scene, materials=(first, *scene.materials[1:]))


def paned_in_fog():
    """Both."""
    return with_fog(paned(), {"scattering": 0.6})


def carries(data: bytes) -> bool:
    plan = picture_of(data).header.plan
    assert plan is not None
    return any(row["pass"] == "carried_light" for row in plan["rows"])


@pytest.mark.parametrize("make", [patterned, paned_in_fog])
def test_light_behind_what_differs_from_ray_to_ray_is_never_carried(make) -> None:
    scene, renderer = make(), StreamRenderer()
    there = aside(scene, 0.05)
    renderer.make(scene, job(scene, 1, **STILL))
    while renderer.smooth(SmoothKeyframe(session="one", id=2))["left"]:
        pass
    assert veiled(scene, there, STREAMED)
    for session in ("one", "two"):  # another one begins with what the first left
        wish = {"session": session, "camera": header_of(there)}
        moving = renderer.make(scene, job(scene, 3, **LOSSLESS_COLOR, **wish))["messages"][0]
        rest = renderer.make(scene, job(scene, 4, **STILL, **wish))["messages"][0]
        assert not carries(moving) and not carries(rest)
        assert error(rest, scene, there) < 1.5, "right at once where the view rests, outlines apart"
        assert renderer.smooth(SmoothKeyframe(session=session, id=5))["left"] == len(ASIDE) - 1, "none anew"


@pytest.mark.parametrize("make", [foggy, paned])
def test_light_behind_panes_and_media_is_carried_and_seen_through_those_of_the_new_view(make) -> None:
    scene, renderer = make(), StreamRenderer()
    camera = scene.camera(width=160, height=120)
    renderer.make(scene, job(scene, 1, **STILL, camera=header_of(camera)))
    while renderer.smooth(SmoothKeyframe(session="one", id=2))["left"]:
        pass
    matrix = camera.camera_from_world.clone()
    matrix[0, 0, 3] -= 0.04 * scene.diagonal
    there = replace(camera, camera_from_world=matrix)
    unhurried = {**LOSSLESS_COLOR, "bounds": Bounds(budget_ms=5000.0), "camera": header_of(there)}
    moving = renderer.make(scene, job(scene, 3, **unhurried))["messages"][0]
    wanted = display_bytes(render(scene, there, options=STREAMED).radiance[0]).astype(float)
    stale = display_bytes(render(scene, camera, options=STREAMED).radiance[0]).astype(float)
    off = np.abs(picture_of(moving).codes.numpy() - wanted)
    assert carries(moving)
    assert off.mean() < 2.5 and off.mean() < 0.25 * np.abs(stale - wanted).mean()
    assert np.percentile(off.max(axis=-1), 97) < 16.0, "borders of panes and halos stand where they are now"
    rest = renderer.make(scene, job(scene, 4, **STILL, camera=header_of(there)))["messages"][0]
    assert carries(rest)
    assert np.abs(picture_of(rest).codes.numpy() - wanted).mean() < 3.0  # outlines are smooth
    left = [renderer.smooth(SmoothKeyframe(session="one", id=5)) for _ in range(2)]
    assert [made["left"] for made in left] == [len(ASIDE), 0]
    assert not np.isnan(picture_of(left[-1]["messages"][0]).codes.numpy()).any()


def clear():
    """Without ambient visibility, whose pattern follows the pixels."""
    return replace(load("cornell_box"), ambient=torch.zeros(3))


@pytest.mark.parametrize(("make", "whole"), [(patterned, 6), (foggy, 6), (clear, 5)], ids=["anew", "haze", "clear"])
def test_further_pictures_are_of_what_is_shown(make, whole, monkeypatch) -> None:
    """The margin that only a moving view needs keeps the light of the first, be that carried; the same pixels are made
    of the rest."""
    scene, renderer, cameras = make(), StreamRenderer(), []

    def noted(name):
        usual = getattr(stream_renderer, name)

        def called(scene, asked, *rest):
            cameras.extend(asked if isinstance(asked, list) else [asked])
            return usual(scene, asked, *rest)

        monkeypatch.setattr(stream_renderer, name, called)

    noted("render_image")
    noted("moved_aside")
    camera, found = header_of(scene.camera(width=96, height=72)), []
    for session, margin in (("one", (0, 0)), ("two", (12, 9))):
        wish = {**STILL, "camera": camera, "session": session, "margin": margin}
        first = renderer.make(scene, job(scene, 1, **wish))["messages"][0]
        while not (last := renderer.smooth(SmoothKeyframe(session=session, id=2)))["messages"]:
            pass
        found.append([picture_of(data).codes.numpy().astype(int) for data in (first, last["messages"][0])])
    cameras = [one for k, one in enumerate(cameras) if k == 0 or one is not cameras[k - 1]]  # refused, then made anew
    count = 1 + len(ASIDE)
    assert [(c.width, c.height) for c in cameras] == [(96, 72)] * whole + [(72, 54)] * (2 * count - whole)
    for outer, part in zip(cameras[1:count], cameras[-len(ASIDE) :], strict=True):
        assert torch.allclose(part.intrinsics[0, :2, 2] + torch.tensor([12.0, 9.0]), outer.intrinsics[0, :2, 2])
    inner = np.zeros((72, 96), dtype=bool)
    inner[9:-9, 12:-12] = True
    (_, all_of_it), (first, part) = found
    assert np.abs(part - all_of_it)[inner].mean() < 0.5, "as if all of it had been made"
    assert np.abs(part - first)[inner].mean() > 0.05, "which is smoother than one picture"


def test_without_media_or_where_they_are_out_of_sight_light_is_carried() -> None:
    scene, renderer = foggy(), StreamRenderer()
    clear = options_of(STREAMED, ("media",))
    behind = aside(scene, 0.0)
    assert is_hazy(scene, behind, STREAMED) and not is_hazy(scene, behind, clear)
    fog = scene.media[0]
    away = replace(fog, low=fog.low + 100.0 * behind.eye[0], high=fog.high + 100.0 * behind.eye[0])
    assert not is_hazy(replace(scene, media=(away,)), behind, STREAMED)
    renderer.make(scene, job(scene, 1, off=("media",), **STILL))
    plan = picture_of(renderer.make(scene, job(scene, 2, off=("media",)))["messages"][0]).header.plan
    assert plan is not None and plan["rows"][0]["pass"] == "carried_light"


def test_the_sky_of_a_carried_picture_has_the_fog_of_the_new_view_before_it() -> None:
    """What media put before the sky that comes into view is found with that of all pixels, not once more."""
    scene, renderer = foggy(), StreamRenderer()
    renderer.make(scene, job(scene, 1, **STILL, camera=header_of(aside(scene, 0.5))))
    there = aside(scene, 0.56)
    wish = {**LOSSLESS_COLOR, "camera": header_of(there), "extra_layers": 1}
    moving = renderer.make(scene, job(scene, 2, **wish))["messages"][0]
    assert carries(moving)
    begun = renderer._sessions["one"].begun
    assert begun is not None and begun.options.scattering.air, "its further layers are seen through fog, too"
    image = render(scene, there, options=STREAMED)
    sky = ~image.visibility.covered[0].numpy()
    sky[:, :-8] = False  # the columns that have only come into view
    wanted = display_bytes(image.radiance[0])[sky].astype(float)
    assert sky.sum() > 50 and wanted.mean() > 2.0, "the fog shows"
    assert np.abs(picture_of(moving).codes.numpy()[sky] - wanted).mean() < 2.0


def test_what_shows_where_nothing_is_seen_has_fog_before_it() -> None:
    scene = foggy()
    camera = aside(scene, 0.6)
    image = render(scene, camera, options=STREAMED, history=RenderHistory())
    assert image.history is not None
    sky = ~image.visibility.covered[0]
    assert int(sky.sum()) > 100
    found = background_of(scene, image.visibility, STREAMED, image.history)
    shown, wanted = (display_bytes(light[sky]).astype(float) for light in (found, image.radiance[0]))
    assert float(wanted.mean()) > 2.0, "the fog shows"
    assert np.abs(shown - wanted).mean() < 1.5
    assert torch.isfinite(found).all()


def test_extra_layers_behind_panes_are_tinted() -> None:
    """Red glass before everything: nothing green or blue comes through it to another layer either."""
    scene = load("cornell_box")
    camera = aside(scene, 0.0)
    corners = torch.tensor([[-9.0, -9.0, 0.0], [9.0, -9.0, 0.0], [9.0, 9.0, 0.0], [-9.0, 9.0, 0.0]])
    turn = camera.world_from_camera[0].float()
    place = (turn[:3, :3] @ (corners + torch.tensor([0.0, 0.0, 0.05])).T).T + turn[:3, 3]
    glass = Material(name="glass", diffuse=torch.tensor([1.0, 0.0, 0.0]), metallic=0.0, transmission=1.0)
    panes = Mesh(
        vertices=place, faces=torch.tensor([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]), material=len(scene.materials)
    )
    red = scene.replace(meshes=[*scene.meshes, panes], materials=[*scene.materials, glass])
    found = []
    for one in (scene, red):
        image = render(one, camera, options=STREAMED, history=RenderHistory())
        assert image.history is not None and image.plan is not None
        around = cameras_around(camera, image.visibility.depth[0], 1)
        found.append(extra_layers(one, image.visibility, around, image.plan.options, image.history)[0])
    clear, tinted = found
    known = clear.known & tinted.known & clear.depth.isfinite()
    assert int(known.sum()) > 20
    assert float(clear.radiance[known][:, 1:].mean()) > 0.01
    assert float(tinted.radiance[known][:, 1:].max()) < 1e-3
    assert float(tinted.radiance[known][:, 0].mean()) > 0.1 * float(clear.radiance[known][:, 0].mean())
