"""Hits share their few rays: noise goes, means stay, and what faces another way does not mix."""

from __future__ import annotations

import pytest
import torch

from torchrender.effects.ambient.sharing import share_hits
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

UP = (0.0, 0.0, 1.0)


def plane(count: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Places on z = 0.3, their values, 0 or 1 at random, and how probable a 1 is."""
    random = torch.Generator().manual_seed(5)
    place = torch.rand(count, 3, generator=random, dtype=torch.float64)
    place[:, 2] = 0.3
    wanted = (0.2 + 0.6 * place[:, :1]).float()
    return place, (torch.rand(count, 1, generator=random) < wanted).float(), wanted


@pytest.mark.parametrize("wide", [1.0, 8.0])
def test_noise_goes_and_the_slope_stays(wide: float) -> None:
    """With rays as wide as hits lie apart, and with hits that lie farther apart than their rays are wide."""
    place, values, wanted = plane(40000)
    width = torch.full((40000,), 1.0 / 200.0 / wide)
    found = share_hits(place, torch.tensor(UP).expand(40000, 3), width, values, 1)
    assert float((values - wanted).std()) > 0.4
    assert float((found - wanted).square().mean().sqrt()) < 0.09
    assert float(found.mean()) == pytest.approx(float(wanted.mean()), abs=0.01)


def test_neighbouring_hits_get_nearly_the_same() -> None:
    place, values, _ = plane(40000)
    beside = place + torch.tensor([1e-4, 0.0, 0.0])
    both, normal = torch.cat([place, beside]), torch.tensor(UP).expand(80000, 3)
    found = share_hits(both, normal, torch.full((80000,), 0.004), torch.cat([values, values]), 1)
    assert float((found[:40000] - found[40000:]).abs().median()) < 0.004


def test_the_two_sides_of_a_sheet_and_walls_at_a_corner_do_not_mix() -> None:
    place, _, _ = plane(3000)
    normal = torch.eye(3)[torch.arange(3000) % 3] * torch.where(torch.arange(3000) % 2 == 0, 1.0, -1.0)[:, None]
    values = (torch.arange(3000) % 6).float()[:, None]
    found = share_hits(place, normal, torch.full((3000,), 0.01), values, 2)
    torch.testing.assert_close(found, values)


def test_rays_without_width_and_none_at_all_stay_as_they_are() -> None:
    place, values, _ = plane(50)
    normal = torch.tensor(UP).expand(50, 3)
    assert torch.equal(share_hits(place, normal, torch.zeros(50), values, 4), values)
    assert share_hits(place[:0], normal[:0], torch.zeros(0), values[:0], 4).shape == (0, 1)


@pytest.mark.parametrize("roughness", [0.02, 0.2])
def test_a_chrome_ball_shows_no_grain_on_a_plain_under_an_even_sky(roughness: float) -> None:
    """Measured without sharing: 0.29 and 0.25."""
    chrome = Material(diffuse=[0.9] * 3, metallic=1.0, roughness=roughness)
    scene = Scene(
        meshes=[Mesh.plane(6.0), Mesh.sphere(0.5, [0.0, 0.5, 0.0], material=1)],
        materials=[Material(diffuse=[0.6] * 3, metallic=0.0, roughness=1.0), chrome],
        environment=Environment.constant([1.0] * 3),
    )
    camera = Cameras.look_at([1.6, 1.4, 3.4], [0.0, 0.4, 0.0], width=160, height=120, fov_deg=25.0)
    picture = render(scene, camera, options=RenderOptions(reflections="traced"))
    ball = (picture.gbuffer.object_id[0] == 1).float()[None]
    inside = -torch.nn.functional.max_pool2d(-ball, 5, 1, 2)[0] > 0
    inside[:70] = False  # above, the sky is mirrored
    inside[85:] = False  # below, the ball's own dark
    assert int(inside.sum()) > 300
    value = picture.radiance[0].mean(dim=-1)
    around = sum(value.roll(s, d) for s, d in ((1, 0), (-1, 0), (1, 1), (-1, 1))) / 4.0
    assert float((value - around)[inside].std() / value[inside].mean()) < 0.04
