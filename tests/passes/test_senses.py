"""What passes sense of a picture."""

from __future__ import annotations

from typing import Any

import pytest
import torch

import torchrender as tr
from torchrender.passes.senses import SIDE, borders, detail, difference, few, partly_lit
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import sense_of
from torchrender.scene.model import Scene


def frame(**options: Any) -> Frame:
    camera = tr.Cameras.look_at((0, 0, 2), (0, 0, 0), width=8, height=8)
    return Frame(
        scene=Scene(),
        cameras=camera,
        options=RenderOptions(**options),
        history=RenderHistory(),
        values={},
        asked={},
        hits=lambda *_: pytest.fail("nothing is hit"),
    )


def stripes(width: int, period: int, size: int = 128) -> torch.Tensor:
    on = (torch.arange(size) // period) % 2 == 0
    return (0.2 + 0.6 * on.float())[None, None, :, None].expand(1, size, size, 3)[:, :, :width]


def test_one_colour_has_no_detail_and_finer_stripes_have_more() -> None:
    assert detail(frame(), torch.full((1, 40, 50, 3), 0.3)) == (0.0, 0.0)
    coarse, fine = (detail(frame(), stripes(128, period)) for period in (8, 2))
    assert fine[0] == pytest.approx(4 * coarse[0], rel=0.2) and fine[1] > 2 * coarse[1]


def test_detail_is_that_of_the_picture_whatever_is_rendered() -> None:
    whole, half = detail(frame(), stripes(128, 8)), detail(frame(supersample=0.5), stripes(128, 4)[:, :64, :64])
    assert half[0] == pytest.approx(whole[0], rel=0.1)


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (2, 2), (3, 5), (17, 300)])
def test_pictures_of_any_size_have_a_detail(size: tuple[int, int]) -> None:
    found = detail(frame(), torch.rand(2, *size, 3))
    assert all(0.0 <= value <= 2.0 for value in found)


def test_few_pixels_stand_for_all() -> None:
    assert few(torch.zeros(2, 1000, 30, 3)).shape[1] <= SIDE
    assert few(torch.arange(4.0).reshape(1, 2, 2)).tolist() == [[[0, 1], [2, 3]]]
    ramp = torch.linspace(0, 1, 900)[None, :, None].expand(1, 900, 900)
    assert float(few(ramp).mean()) == pytest.approx(0.5, abs=0.01)


def test_borders_of_shadows_are_counted_light_by_light() -> None:
    covered = torch.ones(1, 10, 10, dtype=torch.bool)
    covered[:, 5:] = False
    lit, part = torch.ones(1, 10, 10), torch.ones(1, 10, 10)
    part[:, :, 0] = 0.5
    assert partly_lit(covered, [lit, 1 - lit]) == 0.0
    assert partly_lit(covered, [part, part]) == pytest.approx(0.1)
    assert partly_lit(covered, []) == 0.0


@pytest.mark.parametrize("width", [1, 6], ids=["hard", "soft"])
@pytest.mark.parametrize("size", [64, 640])
def test_borders_are_as_long_as_they_are_whatever_found_them(size: int, width: int) -> None:
    """A straight border across the picture: one pixel in each row, of as many pixels as a row has."""
    ramp = ((torch.arange(float(size)) - size / 2) / width).clamp(0.0, 1.0).expand(1, size, size)
    everywhere = torch.ones(1, size, size, dtype=torch.bool)
    assert borders(frame(), everywhere, [ramp]) == pytest.approx(1 / size, rel=0.02)
    assert borders(frame(), everywhere, [ramp, ramp.transpose(1, 2)]) == pytest.approx(2 / size, rel=0.02)
    # Rendered with half as many pixels along each side, it is the same border of the same picture.
    assert borders(frame(supersample=0.5), everywhere, [ramp]) == pytest.approx(0.5 / size, rel=0.02)
    assert borders(frame(), everywhere & (torch.arange(size) < size // 3), [ramp]) == 0.0
    assert borders(frame(), everywhere, []) == 0.0


def test_a_difference_is_one_of_display_values_with_one_exposure() -> None:
    grey = torch.full((1, 4, 4, 3), 0.5)
    assert difference(frame(), grey, grey) == 0.0
    dark = difference(frame(exposure=-8.0), grey, 2 * grey)
    assert 0.0 < dark < difference(frame(), grey, 2 * grey)


def test_a_dark_corner_is_sensed_by_the_passes_it_hangs_on() -> None:
    floor, wall = tr.Mesh.plane(4.0, name="floor"), tr.Mesh.box((0.2, 2.0, 4.0), (-0.5, 1.0, 0.0), name="wall")
    lamp = tr.PointLight(position=(3.0, 3.0, 0.0), intensity=(8.0, 8.0, 8.0))
    camera = tr.Cameras.look_at((3, 3, 3), (0, 0, 0), width=64, height=64)

    def sensed(*meshes: tr.Mesh, ambient: float) -> dict[str, float]:
        scene = Scene(meshes=meshes, lights=(lamp,), ambient=torch.full((3,), ambient), name="corner")
        image = tr.render(scene, camera, history=RenderHistory(), budget_ms=1e6)
        assert image.history is not None and image.history.pace is not None
        return dict(image.history.pace.known)

    alone, both, dim = sensed(floor, ambient=0.5), sensed(floor, wall, ambient=0.5), sensed(floor, wall, ambient=0.05)
    name = sense_of("ambient_visibility")
    assert both[name] > 5 * max(alone[name], 1e-4) and both[name] > 2 * dim[name] > 0
    assert both[sense_of("gbuffer")] > alone[sense_of("gbuffer")] > 0
    assert sense_of("point_shadow") in both and sense_of("reflections") not in both
