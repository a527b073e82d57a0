"""Shadows by rays: shadow edges in closed form, the share of a half hidden light, and limits."""

from __future__ import annotations

import pytest
import torch

from shadow_scenes import flat_image, floor, quad
from torchrender.effects.shadows import traced
from torchrender.effects.shadows.traced import traced_visibilities, traced_visibility
from torchrender.errors import OptionError
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.model import Scene

# Two units above the floor, over all of x < 0.
ROOF = quad((-4.0, 2.0, 4.0), (4.0, 0, 0), (0, 0, -8.0), "roof")
SCENE = Scene(meshes=(floor(), ROOF))
BELOW = Scene(meshes=(floor(),))
GBUFFER = rasterize(BELOW, flat_image(64, 48))  # the floor alone is seen
X = GBUFFER.position[..., 0]
CASTER = RayCaster(SCENE.geometry)


def test_a_slanted_sun_moves_the_edge_by_the_height() -> None:
    sun = DirectionalLight(direction=torch.tensor([0.5, -1.0, 0.0]))
    seen = traced_visibility(CASTER, sun, GBUFFER)
    inside = GBUFFER.covered & ((X - 1.0).abs() > 1e-3) & (X > -2.9)
    assert torch.equal(seen[inside], (X > 1.0).float()[inside])


def test_a_point_light_throws_the_edge_outwards() -> None:
    lamp = PointLight(position=torch.tensor([-1.0, 4.0, 0.0]))
    seen = traced_visibility(CASTER, lamp, GBUFFER)
    inside = GBUFFER.covered & ((X - 1.0).abs() > 1e-3)
    assert torch.equal(seen[inside], (X > 1.0).float()[inside])


def test_half_of_a_light_is_seen_from_below_its_edge() -> None:
    light = RectLight(
        corner=torch.tensor([-1.0, 4.0, -1.0]), edge_u=torch.tensor([2.0, 0, 0]), edge_v=torch.tensor([0, 0, 2.0])
    )
    seen = traced_visibility(CASTER, light, GBUFFER, samples=16)
    # From (x, 0) the part of the light beyond the roof's edge, which hides it up to -x at the light's height.
    expected = ((1.0 + X) / 2.0).clamp(0.0, 1.0)
    assert float((seen - expected)[GBUFFER.covered].abs().max()) <= 1 / 32 + 1e-3


def test_light_from_below_is_not_seen() -> None:
    up = DirectionalLight(direction=torch.tensor([0.0, 1.0, 0.0]))
    assert float(traced_visibility(CASTER, up, GBUFFER)[GBUFFER.covered].max()) == 0.0


def test_limits() -> None:
    sun = DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0]))
    with pytest.raises(OptionError, match="samples"):
        traced_visibility(CASTER, sun, GBUFFER, samples=0)
    with pytest.raises(OptionError, match="offset"):
        traced_visibility(CASTER, sun, GBUFFER, offset=-1.0)


def test_many_lights_at_once_are_what_each_of_them_is_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """In parts, too, of which the last one is smaller; some are parallel, below the floor, or on it."""
    down = torch.tensor([0.0, -1.0, 0.0])
    places = torch.rand(30, 3, generator=torch.Generator().manual_seed(5)) * 8.0 - 3.0
    lights: dict[int, Light] = {3 * n: PointLight(position=place) for n, place in enumerate(places)}
    lights[1] = DirectionalLight(direction=torch.tensor([0.5, -1.0, 0.0]))
    lights[2] = SpotLight(position=torch.tensor([1.0, 3.0, 0.0]), direction=down)
    lights[4] = PointLight(position=GBUFFER.position[GBUFFER.covered][100])
    alone = {n: traced_visibility(CASTER, light, GBUFFER) for n, light in lights.items()}
    assert 0.1 < float(torch.stack(list(alone.values())).mean()) < 0.9
    for at_once in (1, 4 * int(GBUFFER.covered.sum()), 1 << 30):
        monkeypatch.setattr(traced, "_AT_ONCE", at_once)
        found = traced_visibilities(CASTER, lights, GBUFFER)
        assert found.keys() == alone.keys() and all(torch.equal(found[n], alone[n]) for n in lights)
    assert traced_visibilities(CASTER, {}, GBUFFER) == {}
