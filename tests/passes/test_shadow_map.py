"""Views of lights that are fitted to what an eye sees: they fit as long as it sees the same."""

from __future__ import annotations

from dataclasses import replace
from types import ModuleType

import pytest
import torch

import torchrender as tr
from torchrender.passes.light import shadow_map, standing_maps
from torchrender.pipeline.pace import RECENT

VIEW = tr.Cameras.look_at([0.6, 1.7, 4.0], [0.0, 0.7, 0.0], width=64, height=48, fov_deg=55.0)
ASIDE = tr.Cameras.look_at([1.6, 1.7, 3.5], [0.0, 0.7, 0.0], width=64, height=48, fov_deg=55.0)
GREY = tr.Material(name="grey", diffuse=[0.6, 0.5, 0.4])
BLACK = tr.Material(name="black", diffuse=[0.0, 0.0, 0.0])


def scene(floor: tr.Material) -> tr.Scene:
    return tr.Scene(
        meshes=[tr.Mesh.plane(6.0, name="floor"), tr.Mesh.box(0.6, [0.0, 0.3, 0.2], name="crate", material=1)],
        materials=[floor, GREY],
        lights=[tr.PointLight(position=[1.2, 2.2, 0.6], intensity=3.0)],
        name="crate",
    )


def calls_of(monkeypatch: pytest.MonkeyPatch, module: ModuleType, name: str) -> list[int]:
    """Grows by one at each call of a module's function."""
    calls: list[int] = []
    function = getattr(module, name)

    def counting(*given):
        calls.append(1)
        return function(*given)

    monkeypatch.setattr(module, name, counting)
    return calls


def test_views_of_lights_are_fitted_once_to_what_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    fitted = calls_of(monkeypatch, shadow_map, "view_cameras")
    lit, history = scene(GREY), tr.RenderHistory()
    options = tr.RenderOptions(point_shadows="maps", ambient_visibility="off")

    def picture(what: tr.Scene, view: tr.Cameras) -> torch.Tensor:
        nonlocal history
        image = tr.render(what, view, options=options, history=replace(history, sequence=False))
        assert image.history is not None
        history = image.history
        alone = tr.render(what, view, options=options)
        fitted.pop()  # of the picture alone
        torch.testing.assert_close(image.radiance, alone.radiance, rtol=0, atol=0)
        return image.radiance

    picture(lit, VIEW)
    assert len(fitted) == 1
    picture(lit, VIEW)
    assert len(fitted) == 1
    picture(lit, ASIDE)
    assert len(fitted) == 2
    picture(lit, VIEW)
    assert len(fitted) == 3
    # The same triangles and lights, and a floor that light changes: it was none of what the views were fitted to.
    dark = replace(lit, materials=(BLACK, GREY))
    history = tr.RenderHistory()
    picture(dark, VIEW)
    picture(replace(dark, materials=lit.materials), VIEW)
    assert len(fitted) == 5


def test_maps_that_still_fit_teach_nothing_of_what_drawing_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else those that have to be drawn again some pictures on are expected in no time, and late."""
    drawn = calls_of(monkeypatch, standing_maps, "draw_shadow_map")
    lit, history = scene(GREY), tr.RenderHistory()
    options = tr.RenderOptions(point_shadows="maps", ambient_visibility="off")
    tr.render(lit, VIEW, options=options)  # kernels are there
    taught, told = 0, []
    for number in range(6):
        eye = [0.6 + 0.002 * number, 1.7, 4.0]
        view = tr.Cameras.look_at(eye, [0.0, 0.7, 0.0], width=64, height=48, fov_deg=55.0)
        drawn.clear()
        image = tr.render(lit, view if number < 5 else ASIDE, options=options, history=history)
        assert image.history is not None and image.history.pace is not None and image.plan is not None
        history = image.history
        row = image.plan.row("shadow_map")
        assert row.amounts is not None and (row.amounts[0] > 0.0) == bool(drawn)
        taught += bool(drawn)
        told.append(bool(drawn))
        assert len(image.history.pace.recent.get(("shadow_map", row.setting), ())) == min(taught, RECENT)
    assert any(told[1:]) and not all(told), "some fit, some do not"
