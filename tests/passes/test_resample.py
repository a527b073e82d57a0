"""What passes do that no effect does by itself: resampling, and shadows of each kind of light."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import torchrender as tr
from shadow_scenes import floor, quad
from torchrender.passes.picture.resample import resampled
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.light import DirectionalLight, RectLight
from torchrender.scene.model import Scene

MODES = ("nearest", "bilinear")


@settings(deadline=None, max_examples=40)
@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 20), st.integers(1, 20), st.sampled_from(MODES))
def test_one_colour_stays_one_colour(h: int, w: int, height: int, width: int, mode: str) -> None:
    made = resampled(torch.full((2, h, w, 3), 0.7), (height, width), mode)
    assert made.shape == (2, height, width, 3)
    torch.testing.assert_close(made, torch.full_like(made, 0.7))


@pytest.mark.parametrize("mode", MODES)
def test_scaled_up_light_is_never_negative_and_keeps_its_place(mode: str) -> None:
    small = torch.zeros(1, 8, 8, 3)
    small[0, 2, 5] = 100.0
    large = resampled(small, (32, 32), mode)
    assert float(large.min()) >= 0.0
    row, column = divmod(int(large[0, ..., 0].argmax()), 32)
    assert row // 4 == 2 and column // 4 == 5


def test_fewer_pixels_are_means() -> None:
    fine = torch.rand(1, 12, 12, 3, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(resampled(fine, (4, 6), "bilinear")[0, 0, 0], fine[0, :3, :2].mean(dim=(0, 1)))


@pytest.mark.parametrize("rows, size", [(12, 8), (12, 5), (7, 6), (9, 4), (6, 6)])
def test_samples_on_a_border_of_pixels_count_for_both_by_their_share(rows: int, size: int) -> None:
    """As of every sample repeated so often that pixels hold whole numbers of them."""
    fine = torch.rand(1, rows, rows + 1, 3, generator=torch.Generator().manual_seed(rows), dtype=torch.float64)
    often = fine.repeat_interleave(size, dim=1).repeat_interleave(size, dim=2)
    wanted = often.reshape(1, size, rows, size, rows + 1, 3).mean(dim=(2, 4))
    made = resampled(fine.requires_grad_(), (size, size), "bilinear")
    torch.testing.assert_close(made.detach(), wanted)
    assert made.dtype == torch.float64 and made.requires_grad


def room() -> Scene:
    roof = quad((-1.0, 1.0, 1.0), (2.0, 0, 0), (0, 0, -2.0), "roof")
    lamp = RectLight(
        corner=torch.tensor([-0.5, 3.0, -0.5]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0]),
        radiance=torch.full((3,), 4.0),
    )  # fmt: skip
    sun = DirectionalLight(direction=torch.tensor([0.4, -1.0, 0.0]))
    return Scene(meshes=(floor(), roof), lights=(lamp, sun))


def test_every_way_to_shadows_gives_about_the_same_picture() -> None:
    scene = room()
    camera = tr.Cameras.look_at([0.0, 6.0, 6.0], [0.0, 0.0, 0.0], width=64, height=64, near=0.1)
    exact = RenderOptions(point_shadows="traced", area_shadows="sampled")
    wanted = tr.render(scene, camera, options=exact).radiance
    plain = tr.render(scene, camera, options=replace(exact, shadows=False)).radiance
    shadow = float((plain - wanted).abs().mean())
    errors = {}
    for way in ("hard", "pcss", "sampled"):
        image = tr.render(scene, camera, options=RenderOptions(area_shadows=way))
        errors[way] = float((image.radiance - wanted).abs().mean()) / shadow
    assert errors["sampled"] < 0.05 and errors["pcss"] < 0.3 and errors["hard"] < 0.5, errors
    assert errors["sampled"] < min(errors["pcss"], errors["hard"])


def test_light_from_the_centre_is_the_rectangles_far_away_and_more_close_by() -> None:
    scene = room()
    ground = replace(scene, meshes=scene.meshes[:1], lights=scene.lights[:1])
    camera = tr.Cameras.look_at([0.0, 6.0, 0.01], [0.0, 0.0, 0.0], width=32, height=32, near=0.1)
    options = RenderOptions(shadows=False)

    def radiance(height: float, way: str) -> torch.Tensor:
        light = replace(ground.lights[0], corner=torch.tensor([-0.5, height, -0.5]))
        lit = replace(ground, lights=(light,))
        return tr.render(lit, camera, options=replace(options, area_light=way)).radiance[0, 16, 16]

    torch.testing.assert_close(radiance(50.0, "centre"), radiance(50.0, "polygon"), rtol=1e-3, atol=0.0)
    assert float(radiance(0.7, "centre")[0]) > 1.2 * float(radiance(0.7, "polygon")[0])
