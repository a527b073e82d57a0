"""Points in eight bytes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from point_scenes import psnr, random_cloud, sphere_cloud
from torchrender.errors import OptionError
from torchrender.kernels.points.codec import longest_tangent
from torchrender.points.cloud import PointCloud
from torchrender.points.codec import compress, decompress, fit_palette, half_extent, short_axis
from torchrender.points.draw import render_points
from torchrender.points.tree import PatchOptions, build_patches


def slow_decode(codes: np.ndarray, half: np.ndarray, short: int, palette: np.ndarray, normals: str):
    """One node by the published byte layout."""
    b = [int(v) for v in codes]
    cells = [(b[0] << 3) | (b[3] >> 5), (b[1] << 3) | ((b[3] >> 2) & 7), (b[2] << 2) | (b[3] & 3)]
    axes = [a for a in range(3) if a != short] + [short]
    position = np.zeros(3)
    for axis, cell, count in zip(axes, cells, (2048, 2048, 1024)):
        position[axis] = -half[axis] + 2 * half[axis] * (cell + 0.5) / count
    if normals == "angles":
        theta, phi = (b[4] + 0.5) * math.pi / 256, (b[5] + 0.5) * 2 * math.pi / 256
        normal = [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]
    else:
        x, y = (b[4] + 0.5) / 128 - 1, (b[5] + 0.5) / 128 - 1
        z = 1 - abs(x) - abs(y)
        if z < 0:
            x, y = math.copysign(1 - abs(y), x), math.copysign(1 - abs(x), y)
        normal = list(np.array([x, y, z]) / np.linalg.norm([x, y, z]))
    return position, np.array(normal), palette[b[7]]


@pytest.mark.parametrize("normals", ["angles", "octahedron"])
def test_round_trip_within_the_stated_errors(normals):
    plain = build_patches(random_cloud(4000), PatchOptions(max_points=512, max_variation=1 / 3, max_cone_deg=180))
    packed = compress(plain, normals=normals)
    assert packed.nodes.access.codes.shape == (len(plain.nodes), 8) and packed.nodes.access.codes.dtype == np.uint8
    found = decompress(packed).nodes
    half, short = half_extent(plain.headers), short_axis(plain.headers)
    patch = torch.repeat_interleave(torch.arange(len(half)), plain.headers.start[:, -1] - plain.headers.start[:, 0])
    cells = torch.full((len(half), 3), 4096.0).scatter(1, short[:, None], 2048.0)
    limit = (2 * half / cells)[patch] * (1 + 1e-3) + 1e-6
    assert bool(((found.position - plain.nodes.position).abs() <= limit).all())
    cosine = (found.normal.double() * plain.nodes.normal.double()).sum(1)
    known = plain.nodes.normal.norm(dim=1) > 0
    angle = torch.rad2deg(cosine[known].clamp(-1, 1).acos())
    assert float(angle.max()) <= (0.79 if normals == "angles" else 0.96)
    assert float(angle.mean()) < 0.37
    palette = packed.nodes.palette
    nearest = palette[(plain.nodes.radius[:, None] - palette).abs().argmin(1)]
    torch.testing.assert_close(found.radius, nearest)
    assert float(((found.radius - plain.nodes.radius) / plain.nodes.radius).abs().max()) < 0.08
    # sRGB codes: half a step.
    assert float((found.color - plain.nodes.color).abs().max()) < 0.5 / 255 * 2.4 / 1.055 + 1e-4


@pytest.mark.parametrize("normals", ["angles", "octahedron"])
def test_decoding_is_that_of_a_slow_twin(normals):
    plain = build_patches(random_cloud(200), PatchOptions(max_points=256, min_points=64))
    packed = compress(plain, normals=normals)
    found, half, short = decompress(packed).nodes, half_extent(plain.headers).numpy(), short_axis(plain.headers)
    for patch in range(len(half)):
        for node in range(int(plain.headers.start[patch, 0]), int(plain.headers.start[patch, -1])):
            wanted = slow_decode(
                packed.nodes.access.codes[node], half[patch], int(short[patch]), packed.nodes.palette.numpy(), normals
            )
            for value, other in zip((found.position[node], found.normal[node], found.radius[node]), wanted):
                np.testing.assert_allclose(value.numpy(), other, atol=1e-6, rtol=1e-6)


def test_the_longest_tangent_is_chosen():
    g = torch.Generator().manual_seed(0)
    for normal in torch.nn.functional.normalize(torch.randn(300, 3, generator=g).double(), dim=1).tolist():
        tangents = np.cross(normal, np.eye(3))
        lengths = np.linalg.norm(tangents, axis=1)
        chosen = longest_tangent(*normal)
        assert lengths[chosen] == pytest.approx(lengths.max()) and lengths[chosen] >= math.sqrt(2 / 3) - 1e-12


def test_bytes_hold_the_tangent_choice_and_zeros():
    packed = compress(build_patches(random_cloud(300)))
    normal = decompress(build_patches(random_cloud(300))).nodes.normal
    byte = packed.nodes.access.codes[:, 6]
    assert (byte & 63 == 0).all()
    assert byte.tolist() == [longest_tangent(*n) << 6 for n in normal.double().tolist()]


def test_pictures_of_compressed_points_look_the_same():
    plain = build_patches(sphere_cloud(60_000))
    camera = plain.camera(width=512, height=512)
    first, second = render_points(plain, camera), render_points(compress(plain), camera)
    assert psnr(second.image, first.image) > 40.0


def test_palette_of_a_wide_range_errs_by_less_than_a_percent_or_two():
    g = torch.Generator().manual_seed(0)
    radius = 100.0 ** torch.rand(50_000, generator=g) * 1e-3
    palette = fit_palette(radius)
    assert len(palette) == 256 and bool((palette[1:] >= palette[:-1]).all())
    near = (radius[:, None] - palette).abs().amin(1) / radius
    assert float(near.mean()) < 0.006 and float(near.max()) < 0.02


def test_few_radii_are_kept_exactly():
    radius = torch.tensor([0.5, 0.25, 3.0, 0.5])
    assert set(radius.tolist()) <= set(fit_palette(radius).tolist())


def test_compressing_again_changes_nothing():
    packed = compress(build_patches(random_cloud(500)))
    assert compress(packed) is packed
    with pytest.raises(OptionError, match="normals"):
        compress(packed, normals="spherical")


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 1e-20, 1.0, 1e12]), st.sampled_from([0.0, 1e9, -3e7]))
def test_flat_tiny_and_distant_boxes_come_back(seed, extent, offset):
    g = torch.Generator().manual_seed(seed)
    position = torch.rand(40, 3, generator=g).double()
    position = position * torch.tensor([1.0, extent, 0.0]).double() + offset
    cloud = PointCloud(position=position, normal=torch.randn(40, 3, generator=g), radius=torch.full((40,), 0.01))
    plain = build_patches(cloud)
    found = decompress(compress(plain)).nodes
    limit = 2 * half_extent(plain.headers)[0] / 2048 * (1 + 1e-3) + 1e-30
    float32 = plain.nodes.position.abs().amax(0) * 1e-6
    assert bool(((found.position - plain.nodes.position).abs().amax(0) <= limit + float32).all())
