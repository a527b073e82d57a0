"""Light that spheres leave: closed forms, sums over texels, and hard cases."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchrender.effects.sky_shadows.light import SkyLight, cube_radiance, prepare_light, stored_normals
from torchrender.effects.sky_shadows.options import SkyLightOptions
from torchrender.effects.sky_shadows.picture import SHIFTS
from torchrender.effects.sky_shadows.shade import hidden_bits, shade
from torchrender.errors import InputError, OptionError
from torchrender.rays import RayCaster
from torchrender.report.all_frequency.ways import (
    best_harmonics,
    exponentiated_harmonics,
    mesh_bits,
    texel_sum,
    wavelet_sum,
)
from torchrender.scene.environment import Environment
from torchrender.scene.mesh import concatenate
from torchrender.scene.shapes import sphere
from torchrender.scene.sky.cube_map import solid_angles, texel_directions

UP = torch.tensor([0.0, 1.0, 0.0])
EXACT = SkyLightOptions(terms=6138)


def lamps(seed: int = 0, count: int = 6) -> Tensor:
    """(6,32,32,3) radiance of small bright lamps on a dim sky."""
    generator = torch.Generator().manual_seed(seed)
    axes = normalize(torch.randn(count, 3, generator=generator).double(), dim=-1)
    axes[:, 1] = axes[:, 1].abs()
    colors = torch.rand(count, 3, generator=generator).double() + 0.2
    glow = (120 * (texel_directions(32) @ axes.T - 1)).exp()
    return 20 * glow @ colors + 0.2


def smooth() -> Tensor:
    return (
        (1.2 + texel_directions(32) @ torch.tensor([[0.3], [0.8], [0.2]]).double()).expand(-1, -1, -1, 3).contiguous()
    )


def swarm(count: int = 64, seed: int = 1) -> Tensor:
    """(1,S,4) spheres over a plane."""
    generator = torch.Generator().manual_seed(seed)
    centres = normalize(torch.randn(count, 3, generator=generator).double(), dim=-1) * 0.6
    centres[:, 1] += 1.0
    return torch.cat([centres, torch.full((count, 1), 0.15).double()], dim=1)[None]


def plane(count: int, seed: int = 2) -> tuple[Tensor, Tensor]:
    points = torch.rand(1, count, 3, generator=torch.Generator().manual_seed(seed)).double() * 4 - 2
    points[..., 1] = 0
    return points, UP.expand(1, count, 3)


def error(found: Tensor, wanted: Tensor, light: SkyLight) -> float:
    """Root mean square, in percent of the unshadowed light."""
    whole = texel_sum(torch.zeros(1, 6, 32, 32, dtype=torch.bool), UP[None], light)
    return float(100 * ((found - wanted) / whole).square().mean().sqrt())


def test_constant_light_arrives_whole() -> None:
    light = prepare_light(torch.ones(6, 32, 32, 3).double())
    for options in (light.options, replace(light.options, blend="nearest")):
        made = prepare_light(torch.ones(6, 32, 32, 3).double(), options)
        normals = stored_normals(8, options.blend == "blend").float()[None]
        found = shade(torch.zeros_like(normals), normals, torch.zeros(1, 0, 4), made)
        assert float((found.radiance - 1).abs().max()) < 1e-6
        assert torch.equal(found.radiance, found.whole) and found.negative == 0


def test_solid_angles_fill_the_sphere() -> None:
    assert float(solid_angles(32).sum()) * 6 == pytest.approx(4 * math.pi, rel=1e-12)


def test_all_wavelets_are_the_plain_sum() -> None:
    generator = torch.Generator().manual_seed(3)
    hidden = torch.rand(5, 6, 32, 32, generator=generator) < 0.4
    normals = normalize(torch.randn(5, 3, generator=generator), dim=-1)
    light = prepare_light(torch.rand(6, 32, 32, 3, generator=generator).double())
    assert torch.allclose(wavelet_sum(hidden, normals, light), texel_sum(hidden, normals, light), rtol=1e-12)


def test_error_falls_with_terms_and_levels() -> None:
    points, normals = plane(150)
    light = prepare_light(lamps())
    wanted = texel_sum(hidden_bits(points, normals, swarm(), light.options)[0], normals[0], light)

    def of(**options: object) -> float:
        made = prepare_light(lamps(), SkyLightOptions(**options))  # type: ignore[arg-type]
        return error(shade(points, normals, swarm(), made).radiance[0], wanted, made)

    errors = [of(terms=n) for n in (50, 100, 200, 6138)]
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < 0.5 and errors[3] < 0.2
    assert errors[2] < of(terms=200, levels=1)
    assert errors[0] < of(terms=50, cosine_terms=50)


def test_the_letter_of_the_source_with_all_terms_is_ours() -> None:
    points, normals = plane(20)
    few = prepare_light(lamps(), EXACT)
    letter = prepare_light(lamps(), replace(EXACT, cosine_terms=6138, normals=4))
    other = prepare_light(lamps(), replace(EXACT, normals=4))
    a, b = (shade(points, normals, swarm(), one).radiance for one in (letter, other))
    assert torch.allclose(a, b, rtol=1e-4, atol=1e-6)
    assert error(shade(points, normals, swarm(), few).radiance[0], b[0], few) < 0.5


def test_the_table_costs_little_accuracy() -> None:
    points, normals = plane(150)
    light = prepare_light(lamps())
    table, exact = (
        texel_sum(hidden_bits(points, normals, swarm(), SkyLightOptions(direct_bits=way))[0], normals[0], light)
        for way in (False, True)
    )
    assert 0 < error(table, exact, light) < 4.0


def test_points_that_round_differently_know_what_lies_between() -> None:
    """Along a line the mean over the shifts is nearer to exact caps than the table is, and has smaller steps."""
    points = torch.zeros(1, 600, 3).double()
    points[0, :, 0] = torch.linspace(-2.0, 2.0, 600)
    normals = UP.expand(1, 600, 3)
    light = prepare_light(lamps())
    exact = shade(points, normals, swarm(), prepare_light(lamps(), SkyLightOptions(direct_bits=True))).radiance[0]
    plain = shade(points, normals, swarm(), light).radiance[0]
    shifts = torch.tensor(SHIFTS)[:, None, None].expand(-1, 1, 600, -1)
    parts = torch.stack([shade(points, normals, swarm(), light, shift=one).radiance[0] for one in shifts])
    mean = parts.mean(0)
    assert not torch.equal(parts[0], parts[1])
    assert error(mean, exact, light) < 0.75 * error(plain, exact, light)
    assert float(mean.diff(dim=0).abs().max()) < 0.75 * float(plain.diff(dim=0).abs().max())
    still = shade(points, normals, swarm(), light, shift=torch.zeros(1, 600, 3)).radiance[0]
    assert torch.equal(still, plain)


def test_less_error_than_spherical_harmonics() -> None:
    points, normals = plane(60)
    for radiance, times in ((smooth(), 5.0), (lamps(), 8.0)):
        light = prepare_light(radiance, SkyLightOptions(direct_bits=True))
        hidden = hidden_bits(points, normals, swarm(), light.options)[0]
        wanted = texel_sum(hidden, normals[0], light)
        ours = error(shade(points, normals, swarm(), light).radiance[0], wanted, light)
        harmonic = error(exponentiated_harmonics(points[0], normals[0], swarm()[0], light), wanted, light)
        best = error(best_harmonics(hidden, normals[0], light), wanted, light)
        assert times * ours < harmonic and best < harmonic


def test_one_sphere_over_a_plane_as_rays_see_it() -> None:
    points, normals = plane(120)
    ball = torch.tensor([[[0.0, 1.0, 0.0, 0.6]]]).double()
    light = prepare_light(smooth())
    shape = sphere(0.6, 64)
    shape = replace(shape, vertices=shape.vertices.double() + torch.tensor([0.0, 1.0, 0.0]).double())
    rays = texel_sum(mesh_bits(RayCaster(concatenate([shape])), points[0], normals[0], 1e-4), normals[0], light)
    assert error(shade(points, normals, ball, light).radiance[0], rays, light) < 1.0


def test_order_does_not_matter_and_more_spheres_hide_more() -> None:
    points, normals = plane(50)
    spheres = swarm()
    bits = hidden_bits(points, normals, spheres, SkyLightOptions())
    assert torch.equal(bits, hidden_bits(points, normals, spheres.flip(1), SkyLightOptions()))
    fewer = hidden_bits(points, normals, spheres[:, :40], SkyLightOptions())
    assert bool((bits | ~fewer).all()) and int(bits.sum()) > int(fewer.sum())


def test_batches_and_chunks_change_nothing() -> None:
    points, normals = plane(131)
    light = prepare_light(lamps())
    one = shade(points, normals, swarm(), light).radiance
    two = shade(
        points.expand(2, -1, -1), normals.expand(2, -1, -1), torch.cat([swarm(), swarm(seed=5)]), light
    ).radiance
    assert torch.equal(one[0], two[0])
    assert torch.equal(two[1:], shade(points, normals, swarm(seed=5), light).radiance)
    assert torch.equal(one, shade(points, normals, swarm(), prepare_light(lamps(), SkyLightOptions(chunk=7))).radiance)


def test_everything_and_nothing_hidden() -> None:
    points, normals = plane(3)
    light = prepare_light(lamps())
    around = torch.cat([torch.zeros(3, 3), torch.full((3, 1), 9.0)], dim=1)[None]
    inside = torch.ones(1, 3, dtype=torch.int64)  # "block"
    assert float(shade(points, normals, around, light, inside=inside).radiance.abs().max()) == 0.0
    skipped = shade(points, normals, around, light)
    assert torch.equal(skipped.radiance, skipped.whole)
    # Six spheres that leave no gap hide every texel.
    walls = torch.cat([torch.eye(3), -torch.eye(3)]) * 10.0
    closed = torch.cat([walls, torch.full((6, 1), 9.9999)], dim=1)[None]
    middle = torch.zeros(1, 1, 3)
    assert bool(hidden_bits(middle, UP[None, None], closed, SkyLightOptions(direct_bits=True))[..., 2, :, :].all())
    for direct in (False, True):
        options = SkyLightOptions(direct_bits=direct)
        left = shade(middle, UP[None, None], closed, prepare_light(lamps(), options)).radiance
        assert float(left.max()) < 1e-3


@pytest.mark.parametrize("direct", [False, True])
def test_points_at_spheres(direct: bool) -> None:
    """At the centre, on the surface, just outside; spheres of size zero; all finite and within what is there."""
    light = prepare_light(lamps(), SkyLightOptions(direct_bits=direct))
    spheres = torch.tensor([[[0.0, 0.0, 0.0, 1.0], [5.0, 0.0, 0.0, 0.0]]]).double()
    points = torch.tensor([[[0.0, 0, 0], [0, -1, 0], [0, -1 - 1e-12, 0], [0, -1.0001, 0], [5, 0, 0]]]).double()
    normals = UP.expand(1, 5, 3)
    for inside in range(3):
        found = shade(points, normals, spheres, light, inside=torch.full((1, 5), inside)).radiance
        assert bool(torch.isfinite(found).all()) and float(found.min()) >= 0
    half = shade(points, normals, spheres, light, inside=torch.full((1, 5), 2)).radiance
    # On the surface, from within and from without: the half-space of the sphere is dark.
    assert float((half[0, 1] - half[0, 2]).abs().max()) < 1e-3 and float(half[0, 1].max()) < 0.25 * float(
        half[0, 4].max()
    )


def test_own_sphere_hides_nothing() -> None:
    light = prepare_light(lamps())
    ball = torch.tensor([[[0.0, 1.2, 0.0, 0.5]]])
    point = torch.zeros(1, 2, 3)
    found = shade(point, UP.expand(1, 2, 3), ball, light, own_sphere=torch.tensor([[0, -1]]))
    assert torch.equal(found.radiance[0, 0], found.whole[0, 0])
    assert bool((found.radiance[0, 1] < found.whole[0, 1]).all())


def test_distant_tiny_spheres_can_be_left_out() -> None:
    dot = torch.tensor([[[0.0, 100.0, 0.0, 0.5]]])
    point = torch.zeros(1, 1, 3)
    assert int(hidden_bits(point, UP[None, None], dot, SkyLightOptions()).sum()) >= 1
    assert int(hidden_bits(point, UP[None, None], dot, SkyLightOptions(smallest=1 / 64)).sum()) == 0


def test_light_of_one_texel_and_of_none() -> None:
    radiance = torch.zeros(6, 32, 32, 3).double()
    dark = prepare_light(radiance)
    points, normals = plane(40)
    assert float(shade(points, normals, swarm(), dark).radiance.abs().max()) == 0 and len(dark.kept) == 0
    radiance[2, 13, 17] = 1e6
    light = prepare_light(radiance, SkyLightOptions(direct_bits=True))
    found = shade(points, normals, swarm(), light)
    hidden = hidden_bits(points, normals, swarm(), light.options)[0][:, 2, 13, 17]
    assert 0 < int(hidden.sum()) < 40 and len(light.kept) == 15  # three wavelets of each of five levels
    share = (found.radiance / found.whole)[0, :, 0]
    assert float(share[hidden].max()) < 1e-2 and float((share[~hidden] - 1).abs().max()) < 1e-2


def test_normals_blend_without_jumps() -> None:
    """A normal that turns: the largest step of the blend is at most a third of that of the nearest normal."""
    angle = torch.linspace(0.0, 2.5, 400)
    normals = torch.stack([angle.sin(), angle.cos(), 0.3 * angle.cos()], dim=-1)
    normals = normalize(normals, dim=-1)[None]
    steps = {}
    for blend in ("blend", "nearest"):
        light = prepare_light(lamps(), SkyLightOptions(blend=blend))
        value = shade(torch.zeros_like(normals), normals, swarm(), light).radiance[0]
        steps[blend] = float(value.diff(dim=0).abs().max())
    assert steps["blend"] <= steps["nearest"] / 3


def test_an_environment_as_a_cube_map_keeps_its_light() -> None:
    generator = torch.Generator().manual_seed(8)
    sky = Environment(radiance=torch.rand(64, 128, 3, generator=generator) ** 4, intensity=2.0, rotation_deg=37.0)
    normals = normalize(torch.randn(200, 3, generator=generator), dim=-1)
    found = shade(torch.zeros(1, 200, 3), normals[None], torch.zeros(1, 0, 4), prepare_light(sky)).radiance[0]
    wanted = sky.irradiance(normals) / math.pi
    assert float(((found - wanted) / wanted).abs().max()) < 0.03
    middle = cube_radiance(sky)[:, 16, 16]
    assert torch.allclose(middle.float(), sky.lookup(texel_directions(32)[:, 16, 16]).float(), atol=0.5)


def test_bad_input_is_named() -> None:
    light = prepare_light(lamps())
    points, normals = plane(2)
    with pytest.raises(InputError, match="spheres"):
        shade(points, normals, torch.zeros(1, 3), light)
    with pytest.raises(InputError, match="points"):
        shade(points * torch.nan, normals, swarm(), light)
    with pytest.raises(InputError, match="gradient"):
        shade(points.clone().requires_grad_(), normals, swarm(), light)
    with pytest.raises(InputError, match="negative"):
        prepare_light(-lamps())
    for wrong in ({"levels": 3}, {"terms": 0}, {"ranking": "size"}, {"normals": 2}, {"inside": "maybe"}):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            SkyLightOptions(**wrong)  # type: ignore[arg-type]
