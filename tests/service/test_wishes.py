"""What the pictures of a stream may cost, and what is said where that is not enough: in the words of who asked."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import pytest
import torch

from keyframe_jobs import job, picture_of
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender_service.logs import hearing, listen
from torchrender_service.renderers.jobs import Bounds, View
from torchrender_service.renderers.streaming.stream_renderer import StreamRenderer
from torchrender_service.renderers.streaming.wishes import in_words_of, picture_bounds
from torchrender_service.renderers.views import NARROWEST, camera_of_view, first_camera

SCENE = load("cornell_box")


def told(bounds: Bounds, *, still: bool = False, packing_ms: float = 40.0, **plan: Any) -> str:
    asked = job(SCENE, still=still, bounds=bounds)
    found = picture_bounds(asked, packing_ms)
    usual = {"predicted_ms": 120.0, "predicted_error": 0.08, "statement": "no settings reach it"}
    limits = {"budget_ms": found.budget_ms, "max_error": found.max_error}
    return str(in_words_of(asked, {**usual, **limits, **plan})["statement"])


def test_a_budget_that_nobody_asked_for_is_no_budget_that_is_not_kept() -> None:
    error = told(Bounds(max_error=0.05))
    assert error == (
        "while the view moves a picture has about 55 ms, and this one is expected to take 120 ms: an error of about"
        " 0.08 is expected; the bound of 0.05 is for the view at rest"
    )
    assert "bound" not in told(Bounds()) and "about 55 ms" in told(Bounds())
    assert told(Bounds(max_error=0.05), predicted_ms=None, predicted_error=None).count("expected") == 0


def test_a_budget_that_was_asked_for_is_named_as_it_was() -> None:
    assert told(Bounds(budget_ms=100.0)).startswith("of a budget of 100 ms the picture has 60 ms: that, less what")
    still = told(Bounds(budget_ms=100.0), still=True)
    assert still.startswith("of a budget of 100 ms the picture has 360 ms: 4 times that, at rest, less what")
    assert still.endswith("; no settings reach it")
    assert told(Bounds(budget_ms=100.0), packing_ms=0.0) == "no settings reach it"
    assert told(Bounds(max_error=0.05), still=True) == "no settings reach it", "there is no budget at rest"
    assert told(Bounds(max_error=0.05), statement="") == "", "nothing is said of what is kept"


def test_a_moving_keyframe_says_what_its_error_is_bounded_by() -> None:
    made = StreamRenderer().make(SCENE, job(SCENE, bounds=Bounds(max_error=1e-5)))
    plan = picture_of(made["messages"][0]).header.plan
    assert plan is not None and not plan["possible"]
    assert plan["statement"].startswith("while the view moves") and "budget" not in plan["statement"]
    assert plan["statement"].endswith("the bound of 1e-05 is for the view at rest")


def test_what_is_doubted_comes_with_the_plan() -> None:
    first, *rest = SCENE.materials
    scene = SCENE.replace(materials=[replace(first, opacity=0.5), *rest])
    plans = []
    with warnings.catch_warnings(), hearing("cornell_box"):
        listen()
        for shown in (SCENE, scene):
            made = StreamRenderer().make(shown, job(shown))
            plans.append(picture_of(made["messages"][0]).header.plan or {})
    assert "warnings" not in plans[0]
    (told,) = plans[1]["warnings"]
    assert "opacity 0.5 of material" in told and "is not used" in told


def half_width(camera: Cameras) -> float:
    """Tangent of the angle from the middle to a side."""
    return float(camera.width / camera.intrinsics[0, 0, 0] / 2)


@pytest.mark.parametrize("name", [None, "close"])
def test_a_phone_held_upright_sees_what_a_wider_one_would(name: str | None) -> None:
    walker = load("walker")
    wide = camera_of_view(walker, View(width=750, height=900, name=name))
    found = first_camera(walker, View(width=390, height=844, name=name))
    assert half_width(found) == pytest.approx(half_width(wide), rel=1e-9) and NARROWEST == 5 / 6
    assert torch.equal(found.camera_from_world, wide.camera_from_world)
    assert float(found.intrinsics[0, 0, 0]) == float(found.intrinsics[0, 1, 1]), "pixels stay square"
    for width, height in ((640, 360), (750, 900)):
        view = View(width=width, height=height, name=name)
        assert torch.equal(first_camera(walker, view).intrinsics, camera_of_view(walker, view).intrinsics)


def test_a_camera_that_is_narrow_itself_shows_no_more_than_its_own_picture() -> None:
    tall = Cameras.look_at((0.3, 0.3, -0.8), (0.3, 0.3, 0.0), width=100, height=200, fov_deg=60.0)
    found = first_camera(SCENE.replace(cameras={"tall": tall}), View(width=390, height=844))
    assert half_width(found) == pytest.approx(half_width(tall), rel=1e-9)


def test_the_walker_is_whole_on_a_phone() -> None:
    walker, view = load("walker"), View(width=390, height=844)

    def extent(camera: Cameras, time: float) -> tuple[float, float]:
        """Pixels from the left between which the figure is."""
        beside = ("court", "column", "plinth", "gravel")
        limbs = [mesh for mesh in walker.at(time).meshes if mesh.name.split()[0] not in beside]
        assert len(limbs) > 5
        pixels, _ = camera.project(torch.cat([mesh.vertices for mesh in limbs]))
        return float(pixels[0, :, 0].min()), float(pixels[0, :, 0].max())

    for time in (0.0, 2.0, 4.0, 6.0):  # of eight seconds about the plinth
        low, high = extent(first_camera(walker, view), time)
        assert low > 5 and high < 385, f"at {time} s"
    assert extent(camera_of_view(walker, view), 0.0)[1] > 390, "that is what it is for"


def test_a_scene_that_brings_no_camera_is_framed_as_before() -> None:
    scene = load("walker").replace(cameras={})
    view = View(width=390, height=844)
    assert torch.equal(first_camera(scene, view).intrinsics, camera_of_view(scene, view).intrinsics)
    looking = View(width=390, height=844, look_at={"eye": (2.0, 1.0, 2.0)})
    assert torch.equal(first_camera(SCENE, looking).intrinsics, camera_of_view(SCENE, looking).intrinsics)
