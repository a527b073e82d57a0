"""Where things touch: contact shadows, spheres through a floor, points on what casts the shadow, two bodies."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchrender.effects.sky_shadows.light import SkyLight, prepare_light
from torchrender.effects.sky_shadows.options import INSIDE, SkyLightOptions
from torchrender.effects.sky_shadows.shade import hidden_bits, shade
from torchrender.report.all_frequency.ways import texel_sum
from torchrender.scene.sky.cube_map import texel_directions

UP = torch.tensor([0.0, 1.0, 0.0])
EXACT = SkyLightOptions(direct_bits=True)
HALF, SKIP = INSIDE.index("half"), INSIDE.index("skip")
TILT = torch.tensor([0.3, 0.8, 0.2]).double()


def smooth(options: SkyLightOptions = EXACT) -> SkyLight:
    return prepare_light((1.2 + texel_directions(32) @ TILT)[..., None].expand(-1, -1, -1, 3).contiguous(), options)


def balls(*rows: tuple[float, float, float, float]) -> Tensor:
    return torch.tensor([list(rows)]).double()


def left_by_rays(points: Tensor, normals: Tensor, centre: Tensor, radius: float, light: SkyLight) -> Tensor:
    """(P,3) a ray from every point through the middle of every texel, against one ball: the quadratic's root."""
    directions = texel_directions(32).reshape(-1, 3)
    towards = centre.double() - points.double()
    along = towards @ directions.T
    off = towards.square().sum(-1, keepdim=True) - along.square()
    hidden = (off < radius**2) & (along > 0)
    return texel_sum(hidden.reshape(-1, 6, 32, 32), normals, light)


def share(found: Tensor, wanted: Tensor, light: SkyLight, normals: Tensor) -> Tensor:
    """Difference in the unshadowed light."""
    whole = texel_sum(torch.zeros(len(normals), 6, 32, 32, dtype=torch.bool), normals, light)
    return ((found - wanted) / whole).abs()


def test_a_ball_on_the_floor_darkens_it_up_to_where_it_touches() -> None:
    light, away = smooth(), torch.tensor([0.01, 0.05, 0.2, 0.5, 1.0, 3.0]).double()
    points = torch.stack([away, torch.zeros(6).double(), torch.zeros(6).double()], dim=1)
    normals = UP.expand(6, 3)
    found = shade(points[None], normals[None], balls((0, 0.5, 0, 0.5)), light).radiance[0]
    wanted = left_by_rays(points, normals, torch.tensor([0.0, 0.5, 0.0]), 0.5, light)
    assert float(share(found, wanted, light, normals).max()) < 0.01
    assert bool((found[:, 0].diff() > 0).all())
    whole = shade(points[None], normals[None], balls((0, 0.5, 0, 0.5)), light).whole[0]
    assert float((found / whole)[0].max()) < 0.6  # the half-space of the ball is dark
    assert float((found / whole)[-1].min()) > 0.97


def test_a_sphere_through_the_floor_darkens_it_without_a_seam() -> None:
    """Inside of it the half-space towards its centre is dark: all of the light under its middle, and more is left
    farther out; where the surface comes out of the floor the two rules meet."""
    for options in (EXACT, SkyLightOptions()):
        light, spheres = smooth(options), balls((0, 0.3, 0, 0.5))
        rim = math.sqrt(0.5**2 - 0.3**2)
        away = torch.tensor([0.0, 0.1, 0.2, 0.3, rim - 1e-6, rim + 1e-6, 0.6, 1.0]).double()
        points = torch.stack([torch.zeros(8).double(), torch.zeros(8).double(), away], dim=1)[None]
        normals, inside = UP.expand(1, 8, 3), torch.full((1, 8), HALF)
        made = shade(points, normals, spheres, light, inside=inside)
        left = (made.radiance / made.whole)[0]
        assert float(left[0].max()) < (0.02 if options.direct_bits else 0.04)  # the table's last radius is 63 / 64
        assert float((left[4] - left[5]).abs().max()) < (1e-3 if options.direct_bits else 0.02)
        assert bool((left[:, 0].diff() > (-1e-3 if options.direct_bits else -0.03)).all())
        skipped = shade(points, normals, spheres, light, inside=torch.full((1, 8), SKIP))
        assert torch.equal(skipped.radiance[0, :5], skipped.whole[0, :5])


def test_points_on_a_ball_see_past_it_and_not_past_the_one_that_touches_it() -> None:
    """Two balls side by side: each shades the other's near side as rays tell, and not itself."""
    light = smooth()
    angle = torch.linspace(0.0, math.pi, 12).double()
    normals = torch.stack([angle.cos(), angle.sin(), torch.zeros(12).double()], dim=1)
    points = 0.5 * normals
    pair = balls((0, 0, 0, 0.5), (1.0, 0, 0, 0.5))
    own = torch.zeros(1, 12, dtype=torch.int64)
    inside = torch.full((1, 12), HALF)
    made = shade(points[None], normals.float()[None], pair, light, own_sphere=own, inside=inside)
    wanted = left_by_rays(points, normals.float(), torch.tensor([1.0, 0.0, 0.0]), 0.5, light)
    assert float(share(made.radiance[0], wanted, light, normals.float()).max()) < 0.015
    ratio = (made.radiance / made.whole)[0, :, 0]
    assert float(ratio[0]) < 0.01  # where they touch nothing arrives
    one = shade(
        points[None], normals.float()[None], pair, light, own_sphere=own, inside=inside, body=torch.zeros(2).long()
    )
    assert torch.equal(one.radiance[0, 0], one.whole[0, 0])  # a joint of one body does not darken itself
    assert torch.equal(one.radiance[0, 1:], made.radiance[0, 1:])
    assert float((ratio[normals[:, 0] < -0.2] - 1).abs().max()) < 1e-6  # nothing of the far side is hidden


def test_balls_that_reach_into_each_other_hide_what_the_larger_part_hides() -> None:
    """Spheres of two bodies that touch overlap; what they hide together is what either hides."""
    light = smooth()
    generator = torch.Generator().manual_seed(4)
    points = torch.rand(1, 40, 3, generator=generator).double() * 3 - 1.5
    points[..., 1] = -0.6
    normals = UP.expand(1, 40, 3)
    one, two = balls((0, 0, 0, 0.5)), balls((0.6, 0.1, 0, 0.5))
    bits = [hidden_bits(points, normals, s, EXACT) for s in (one, two, torch.cat([one, two], dim=1))]
    assert torch.equal(bits[2], bits[0] | bits[1]) and bool((bits[0] & bits[1]).any())
    both, alone = (shade(points, normals, s, light).radiance for s in (torch.cat([one, two], dim=1), one))
    assert bool((both <= alone + 1e-5).all())


def test_radiance_of_many_orders_keeps_the_small_ones() -> None:
    """A lamp of 1e6 in a dim sky: hidden, it leaves the sky's light, but for what a cosine changes over a texel."""
    radiance = torch.full((6, 32, 32, 3), 0.2).double()
    radiance[2, 13, 17] = 1e6
    light = prepare_light(radiance, EXACT)
    lamp = normalize(texel_directions(32)[2, 13, 17], dim=0)
    spheres = torch.cat([2 * lamp, torch.tensor([0.3]).double()])[None, None]
    point = torch.zeros(1, 1, 3)
    bits = hidden_bits(point, UP[None, None], spheres, EXACT)[0]
    assert bool(bits[0, 2, 13, 17])
    wanted = texel_sum(bits, UP[None], light)
    made = shade(point, UP[None, None], spheres, light)
    assert float(wanted.max()) < 0.2 < 100 < float(made.whole.min())
    assert float((made.radiance[0] - wanted).abs().max()) < 5e-4 * float(made.whole.max())


def test_what_truncation_makes_negative_is_zero_and_counted() -> None:
    """The finest wavelets of a single bright texel alone: points to which it is hidden may get less than nothing."""
    radiance = torch.zeros(6, 32, 32, 3).double()
    radiance[2, 13, 17] = 1e5
    light = prepare_light(radiance, SkyLightOptions(terms=3, ranking="magnitude", direct_bits=True))
    generator = torch.Generator().manual_seed(2)
    points = torch.rand(1, 2000, 3, generator=generator).double() * 4 - 2
    points[..., 1] = 0
    made = shade(points, UP.expand(1, 2000, 3), balls((0, 1, 0, 0.6)), light)
    assert made.negative > 0 and float(made.radiance.min()) == 0.0 and bool(torch.isfinite(made.radiance).all())


def test_levels_look_alike_under_a_smooth_sky() -> None:
    generator = torch.Generator().manual_seed(2)
    points = torch.rand(1, 80, 3, generator=generator).double() * 4 - 2
    points[..., 1] = 0
    normals, spheres = UP.expand(1, 80, 3), balls((0, 1, 0, 0.6), (0.8, 0.7, 0.3, 0.4))
    one, two, few = (
        shade(points, normals, spheres, smooth(SkyLightOptions(levels=levels, terms=terms))).radiance
        for levels, terms in ((1, 6138), (2, 6138), (2, 200))
    )
    whole = shade(points, normals, spheres[:, :0], smooth()).radiance
    assert 0 < float(((one - two) / whole).square().mean().sqrt()) < 0.005
    assert float(((few - two) / whole).square().mean().sqrt()) < 0.005
