"""Slopes against finite differences, bias arithmetic, soft window, and the disc of taps."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.numerics.shadow_compare import (
    LightView,
    depth_bias,
    disc_points,
    project_with_slope,
    soft_window,
    texel_width,
)


def view(orthographic: bool) -> LightView:
    turn, _ = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64))
    shift = torch.tensor([0.1, -0.2, 4.0], dtype=torch.float64)
    return LightView(turn, shift, (90.0, 70.0), (40.0, 30.0), 1.0, 9.0, orthographic)


@pytest.mark.parametrize("orthographic", [False, True])
def test_slopes_equal_finite_differences(orthographic):
    light = view(orthographic)
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(200, 3, generator=generator, dtype=torch.float64) * 2 - 1
    normals = torch.nn.functional.normalize(torch.randn(200, 3, generator=generator, dtype=torch.float64), dim=-1)
    at = project_with_slope(points, normals, light)
    normal = normals @ light.rotation.T
    camera = points @ light.rotation.T + light.translation

    def depth(u, v):
        """Where the pixel's line of sight meets the plane."""
        x, y = (u - light.centre[0]) / light.focal[0], (v - light.centre[1]) / light.focal[1]
        plane = (normal * camera).sum(-1)
        if orthographic:
            return (plane - normal[:, 0] * x - normal[:, 1] * y) / normal[:, 2]
        return plane / (normal[:, 0] * x + normal[:, 1] * y + normal[:, 2])

    assert torch.allclose(depth(at.u, at.v), at.z, atol=1e-9)
    h = 1e-5
    for slope, (du, dv) in ((at.slope_u, (h, 0)), (at.slope_v, (0, h))):
        difference = (depth(at.u + du, at.v + dv) - depth(at.u - du, at.v - dv)) / (2 * h)
        tame = slope.abs() < 1.0
        assert int(tame.sum()) > 150 and torch.allclose(slope[tame], difference[tame], atol=1e-5)


def test_edge_on_planes_and_points_behind_have_no_nan():
    light = view(False)._replace(rotation=torch.eye(3, dtype=torch.float64), translation=torch.zeros(3))
    points = torch.tensor([[0.0, 0.0, 2.0], [1.0, 0.0, -1.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    at = project_with_slope(points, torch.tensor([[1.0, 0, 0], [0, 0, 1.0], [0, 1.0, 0]]), light)
    assert all(not bool(torch.isnan(value).any()) for value in at)
    assert at.slope_u[0] == torch.inf and at.u[1] == 40.0


def test_bias_grows_with_slope_and_reach_until_the_plane_takes_over():
    """Limits are texels, here of 0.1 scene units: b0 is 0.01 and b_max 0.2, whatever the depth range."""
    light = LightView(torch.eye(3).double(), torch.zeros(3).double(), (10.0, 10.0), (0.0, 0.0), -1.0, 9.0, True)
    normals = torch.tensor([[0.0, 0, 1], [0.6, 0, 0.8], [1.0, 0, 0.001]])
    at = project_with_slope(torch.zeros(3, 3, dtype=torch.float64), normals, light)
    bias, steep = depth_bias(at, light, (0.1, 1.0, 2.0), 0.5)
    assert bias.tolist() == pytest.approx([0.01, 0.01 + 0.075, 0.01]) and steep.tolist() == [False, False, True]
    bias_wide, steep_wide = depth_bias(at, light, (0.1, 2.0, 2.0), 1.5)
    assert float(bias_wide[1]) == pytest.approx(0.01) and bool(steep_wide[1])  # 0.01 + 2 * 2 * 0.075 exceeds 0.2
    constant, steep = depth_bias(at, light, (0.1, 0.0, 2.0), 0.5)
    assert constant.tolist() == pytest.approx([0.01] * 3) and not bool(steep.any())
    far = light._replace(far=1e6)
    assert torch.equal(depth_bias(at, far, (0.1, 1.0, 2.0), 0.5)[0], bias)


def test_a_texel_widens_with_depth_in_perspective_alone():
    """The coarser axis counts; points behind the light have no width and so no bias."""
    light = LightView(torch.eye(3).double(), torch.zeros(3).double(), (20.0, 10.0), (0.0, 0.0), 1.0, 9.0, False)
    points, normals = torch.tensor([[0.0, 0, 2], [0, 0, 6], [0, 0, -1]]), torch.tensor([[0.0, 0, -1]] * 3)
    at = project_with_slope(points, normals, light)
    assert texel_width(at, light).tolist() == pytest.approx([0.2, 0.6, 0.0])
    assert depth_bias(at, light, (0.5, 1.0, 8.0), 0.5)[0].tolist() == pytest.approx([0.1, 0.3, 0.0])
    assert texel_width(at, light._replace(orthographic=True)).tolist() == pytest.approx([0.1] * 3)


def test_soft_window_gradient_points_from_shadow_to_light():
    light = LightView(torch.eye(3).double(), torch.zeros(3).double(), (1.0, 1.0), (2.0, 2.0), 0.0, 10.0, True)
    depth = torch.full((4, 4), 2.0, requires_grad=True)
    points = torch.tensor([[0.1, 0.2, 2.05]], dtype=torch.float64, requires_grad=True)
    at = project_with_slope(points, torch.tensor([[0.0, 0, -1]]), light)
    bias = depth_bias(at, light, (0.0, 1.0, 0.2), 0.5)
    value = soft_window(depth, at, bias, 0.1, 0, 1.0, True)
    assert float(value.detach()) == pytest.approx(1 / (1 + torch.e**0.5), abs=1e-6)
    value.sum().backward()
    assert points.grad[0, 2] < 0 and float(depth.grad.sum()) == pytest.approx(-float(points.grad[0, 2]), rel=1e-6)


@pytest.mark.parametrize("count", [4, 16, 32, 128])
def test_disc_points_fill_the_disc(count):
    points = disc_points(count)
    assert points.shape == (count, 2) and torch.allclose(points.mean(0), torch.zeros(2).double(), atol=1e-12)
    assert float(points.square().sum(1).mean()) == pytest.approx(0.5)
    assert float(points.norm(dim=1).max()) < 1.4
    gaps = torch.cdist(points, points) + 9 * torch.eye(count)
    assert float(gaps.amin(1).min()) > 0.6 / count**0.5
    assert torch.equal(points, disc_points(count)) and not torch.equal(points, disc_points(count, 1))


@settings(deadline=None, max_examples=50)
@given(
    seed=st.integers(0, 2**31),
    size=st.floats(-6, 6),
    orthographic=st.booleans(),
    n=st.sampled_from([None, 0, 2]),
    outside=st.sampled_from([None, 0.0, 1.0]),
)
def test_comparisons_stay_between_dark_and_lit(seed, size, orthographic, n, outside):
    """Any plane at any scale, in front of the light and behind it: a number in [0, 1], a bias within its limits."""
    scale = 10.0**size
    generator = torch.Generator().manual_seed(seed)
    light = view(orthographic)
    light = light._replace(
        translation=light.translation * scale, near=scale, far=9 * scale,
        focal=tuple(f / scale for f in light.focal) if orthographic else light.focal,
    )  # fmt: skip
    points = 3 * scale * torch.randn(60, 3, generator=generator, dtype=torch.float64)
    normals = torch.nn.functional.normalize(torch.randn(60, 3, generator=generator, dtype=torch.float64), dim=-1)
    at = project_with_slope(points, normals, light)
    assert not any(bool(torch.isnan(part).any()) for part in at)
    bias, steep = depth_bias(at, light, (0.5, 1.0, 8.0), 1.5)
    texel = (scale if orthographic else at.z.clamp_min(0)) / 70.0  # the smaller focal length: the wider side
    assert bool(((bias >= 0) & (bias <= 8.0 * texel * (1 + 1e-9))).all())
    depth = scale * (1 + 8 * torch.rand(60, 80, generator=generator))
    depth[torch.rand(60, 80, generator=generator) < 0.2] = torch.inf
    lit = soft_window(depth, at, (bias, steep), 1e-3 * scale, n, outside, orthographic)
    assert bool(((lit >= 0) & (lit <= 1)).all())
