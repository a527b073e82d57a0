"""Patches and their levels of detail."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from point_scenes import random_cloud, sphere_cloud
from torchrender.errors import InputError, OptionError
from torchrender.points.cloud import PointCloud
from torchrender.points.tree import PatchOptions, PatchSet, build_patches, level_starts


def level_rows(patches: PatchSet, patch: int) -> list[range]:
    start = patches.headers.start[patch].tolist()
    return [range(a, b) for a, b in pairwise(start) if b > a]


def world_position(patches: PatchSet, patch: int, rows: range) -> torch.Tensor:
    return patches.nodes.position[rows.start : rows.stop].double() + patches.headers.centre[patch]


@pytest.mark.parametrize("cloud", [sphere_cloud(20_000), random_cloud(3000)], ids=["sphere", "noise"])
def test_every_point_lies_in_exactly_one_patch_and_in_its_deepest_level(cloud):
    patches = build_patches(cloud, PatchOptions(max_points=512))
    found = torch.cat([world_position(patches, p, level_rows(patches, p)[-1]) for p in range(len(patches.headers))])
    assert int(patches.headers.count.sum()) == len(found) == len(cloud)
    mine, theirs = (a.numpy()[np.lexsort(a.numpy().T.round(4))] for a in (found, cloud.position))
    np.testing.assert_allclose(mine, theirs, atol=2e-6)
    box = patches.headers.box
    for p in range(len(patches.headers)):
        leaves = world_position(patches, p, level_rows(patches, p)[-1])
        assert bool((leaves >= box[p, 0] - 1e-6).all() and (leaves <= box[p, 1] + 1e-6).all())


def halves(count: int) -> list[list[int]]:
    """Sizes of the nodes of every level of a patch by the definition, the deepest level holding single points."""
    levels = [[count]]
    while max(levels[-1]) > 1:
        below = []
        for size in levels[-1]:
            below += [size] if size == 1 else [(size + 1) // 2, size // 2]
        levels.append(below)
    return levels


@pytest.mark.parametrize("count", [1, 2, 3, 5, 64, 77, 1000])
def test_nodes_are_those_of_a_slow_twin(count):
    cloud = random_cloud(count, seed=count)
    patches = build_patches(
        cloud, PatchOptions(max_points=1024, min_points=1000, max_variation=1 / 3, max_cone_deg=180)
    )
    assert len(patches.headers) == 1
    rows = level_rows(patches, 0)
    sizes = halves(count)
    assert [len(r) for r in rows] == [len(s) for s in sizes]
    nodes, leaves = patches.nodes, rows[-1]
    point = nodes.position[leaves.start : leaves.stop].double()
    radius = nodes.radius[leaves.start : leaves.stop].double()
    previous_reach: list[float] = radius.tolist()
    for level in range(len(rows) - 1, -1, -1):
        at, child, reach = 0, 0, []
        for k, size in enumerate(sizes[level]):
            part = slice(at, at + size)
            weight = radius[part] ** 2
            row = rows[level][k]
            mean = (weight[:, None] * point[part]).sum(0) / weight.sum()
            torch.testing.assert_close(nodes.position[row].double(), mean, atol=1e-5, rtol=1e-5)
            color = nodes.color[leaves.start : leaves.stop].double()[part]
            torch.testing.assert_close(nodes.color[row].double(), (weight[:, None] * color).sum(0) / weight.sum(),
                                       atol=1e-5, rtol=1e-5)  # fmt: skip
            wanted = radius[at]
            if level < len(rows) - 1:
                children = [child] if size == 1 else [child, child + 1]
                below = [rows[level + 1][c] for c in children]
                wanted = max(
                    float((nodes.position[b].double() - nodes.position[row].double()).norm()) + previous_reach[c]
                    for b, c in zip(below, children)
                )
                child += len(children)
            reach.append(float(nodes.radius[row]))
            assert reach[-1] == pytest.approx(float(wanted), rel=1e-5)
            at += size
        assert at == count  # every level stands for every point
        previous_reach = reach


def test_parent_spheres_contain_those_of_their_children():
    patches = build_patches(random_cloud(5000), PatchOptions(max_points=512, max_variation=1 / 3, max_cone_deg=180))
    for p in range(len(patches.headers)):
        rows = level_rows(patches, p)
        sizes = halves(int(patches.headers.count[p]))
        for level in range(len(rows) - 1):
            child = rows[level + 1].start
            for k, size in enumerate(sizes[level]):
                for c in range(child, child + min(size, 2)):
                    parent = rows[level][k]
                    gap = (patches.nodes.position[c] - patches.nodes.position[parent]).double().norm()
                    assert float(gap + patches.nodes.radius[c]) <= float(patches.nodes.radius[parent]) * (1 + 1e-6)
                child += min(size, 2)


def test_the_tree_has_at_most_three_nodes_a_point():
    for count in (1, 2, 3, 64, 65, 127, 128, 129, 4095, 4097):
        start = level_starts(np.array([count]))
        assert count <= start[0, -1] <= 3 * count


def test_patches_keep_their_thresholds_and_are_large_where_it_is_flat():
    options = PatchOptions(max_points=1024, min_points=32, max_variation=0.01, max_cone_deg=20)
    patches = build_patches(sphere_cloud(20_000), options)
    headers = patches.headers
    small = headers.count <= options.min_points
    flat = (headers.sigma <= options.max_variation) & (headers.cone[:, 3] <= math.radians(options.max_cone_deg) + 1e-9)
    assert bool((small | (flat & (headers.count <= options.max_points))).all())
    rough = build_patches(random_cloud(20_000), options)
    assert rough.headers.count.float().mean() < 0.2 * headers.count.float().mean()


def test_cones_hold_all_normals_and_levels_their_radii():
    patches = build_patches(sphere_cloud(5000), PatchOptions(max_points=512))
    headers, nodes = patches.headers, patches.nodes
    for p in range(len(headers)):
        for level, rows in enumerate(level_rows(patches, p)):
            cosine = (nodes.normal[rows.start : rows.stop].double() @ headers.cone[p, :3]).clamp(-1, 1)
            assert float(cosine.acos().max()) <= float(headers.cone[p, 3]) + 1e-3
            radius = nodes.radius[rows.start : rows.stop].double()
            found = torch.stack([radius.min(), radius.mean(), radius.max()])
            torch.testing.assert_close(headers.radius[p, level], found, rtol=1e-6, atol=0)


def test_flatness_is_the_smallest_eigenvalue_over_their_sum():
    for seed in range(5):
        cloud = random_cloud(200, seed=seed)
        patches = build_patches(cloud, PatchOptions(min_points=500, max_points=512))
        values = torch.linalg.eigvalsh(torch.cov(cloud.position.T, correction=0))
        assert float(patches.headers.sigma[0]) == pytest.approx(float(values[0] / values.sum()), rel=1e-6)


def test_the_same_tree_every_time():
    first, second = (build_patches(sphere_cloud(30_000), PatchOptions(max_points=512)) for _ in range(2))
    assert torch.equal(first.nodes.position, second.nodes.position)
    assert torch.equal(first.headers.start, second.headers.start)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 200), st.integers(0, 10**6), st.sampled_from([1e-12, 1.0, 1e9]), st.booleans())
def test_any_cloud_gives_a_sound_tree(count, seed, scale, repeated):
    g = torch.Generator().manual_seed(seed)
    position = torch.randn(count, 3, generator=g).double() * scale
    if repeated:
        position = position[torch.randint(0, count, (count,), generator=g)]
    normal = torch.randn(count, 3, generator=g)
    radius = 10.0 ** (torch.rand(count, generator=g) * 8 - 4) * scale
    patches = build_patches(PointCloud(position=position, normal=normal, radius=radius), PatchOptions(min_points=16))
    assert int(patches.headers.count.sum()) == count
    assert bool(torch.isfinite(patches.nodes.position).all() and torch.isfinite(patches.nodes.radius).all())
    length = patches.nodes.normal.norm(dim=1)
    assert bool(((length - 1).abs() < 1e-5).logical_or(length == 0).all())


def test_wrong_input_is_named():
    with pytest.raises(InputError, match="position"):
        PointCloud(position=torch.zeros(0, 3))
    with pytest.raises(InputError, match="position must be finite"):
        PointCloud(position=torch.tensor([[0.0, math.nan, 0.0]]))
    with pytest.raises(InputError, match="radius"):
        PointCloud(position=torch.zeros(2, 3), radius=torch.zeros(3))
    with pytest.raises(OptionError, match="max_points"):
        PatchOptions(max_points=10)
    with pytest.raises(OptionError, match="min_points"):
        PatchOptions(max_points=256, min_points=512)
