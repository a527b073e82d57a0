"""Culling and level choice."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from point_scenes import sphere_cloud
from torchrender.errors import OptionError
from torchrender.points.select import SelectionOptions, select_patches
from torchrender.points.tree import PatchHeaders, PatchOptions, build_patches
from torchrender.scene.camera import Cameras


def headers_of(centre, half, cone, radius) -> PatchHeaders:
    count = len(centre)
    return PatchHeaders(
        box=torch.stack([centre - half, centre + half], dim=1),
        cone=cone,
        sigma=torch.zeros(count, dtype=torch.float64),
        start=torch.arange(count)[:, None] + torch.tensor([0, 1]),
        radius=radius.reshape(count, 1, 1).expand(count, 1, 3).contiguous(),
        count=torch.ones(count, dtype=torch.int64),
    )


def test_cones_never_cull_a_point_that_faces_the_eye():
    """10,000 random patches, each with random points inside its box and normals inside its cone."""
    g = torch.Generator().manual_seed(0)
    count, points = 10_000, 24
    centre = torch.randn(count, 3, generator=g).double() * 3
    half = torch.rand(count, 3, generator=g).double() ** 2
    axis = torch.nn.functional.normalize(torch.randn(count, 3, generator=g).double(), dim=1)
    alpha = torch.rand(count, generator=g).double() * math.pi / 2
    headers = headers_of(centre, half, torch.cat([axis, alpha[:, None]], 1), torch.full((count,), 0.1).double())
    camera = Cameras.look_at([0.0, 0.0, 0.0], [0.0, 0.0, 1.0], width=64, height=64, fov_deg=170)
    kept = select_patches(headers, camera, SelectionOptions(), two_sided=False, margin=1.0)
    every = select_patches(headers, camera, SelectionOptions(), two_sided=True, margin=1.0)
    culled = sorted(set(every.chosen.tolist()) - set(kept.chosen.tolist()))
    assert len(culled) == kept.back > 200
    place = centre[:, None] + half[:, None] * (2 * torch.rand(count, points, 3, generator=g).double() - 1)
    # Normals on the rim of the cone are the hardest.
    side = torch.nn.functional.normalize(
        torch.linalg.cross(axis[:, None].expand(count, points, 3), torch.randn(count, points, 3, generator=g).double()),
        dim=2,
    )
    normal = alpha.cos()[:, None, None] * axis[:, None] + alpha.sin()[:, None, None] * side
    faces = ((normal * place).sum(2) < -1e-12).any(1)
    assert not bool(faces[culled].any())


def test_boxes_outside_the_view_are_left_out_and_no_others():
    g = torch.Generator().manual_seed(1)
    count = 3000
    centre = torch.randn(count, 3, generator=g).double() * 4
    half = torch.rand(count, 3, generator=g).double() * 0.5
    cone = torch.tensor([0.0, 0.0, 1.0, math.pi]).double().expand(count, 4).contiguous()
    headers = headers_of(centre, half, cone, torch.full((count,), 1e-6).double())
    camera = Cameras.look_at([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], width=80, height=60, fov_deg=40, near=0.5, far=9.0)
    chosen = set(select_patches(headers, camera, SelectionOptions(), two_sided=True, margin=1.0).chosen.tolist())
    corner = torch.cartesian_prod(*[torch.linspace(-1, 1, 5).double()] * 3)
    pixels, z = camera.project((centre[:, None] + half[:, None] * corner).reshape(-1, 3))
    inside = (pixels[0] > 0).all(1) & (pixels[0, :, 0] < 80) & (pixels[0, :, 1] < 60) & (z[0] > 0.5) & (z[0] < 9.0)
    seen = inside.reshape(count, -1).any(1).nonzero().reshape(-1).tolist()
    assert set(seen) <= chosen
    assert len(chosen) < 1.5 * len(seen)


@pytest.mark.parametrize("stretch", [(1.0, 1.0), (1.7, 1.0), (1.0, 1.7)], ids=["square", "wide", "high"])
def test_levels_are_the_coarsest_that_project_small_enough(stretch):
    """Small enough along both axes of the image."""
    patches = build_patches(sphere_cloud(30_000), PatchOptions(max_points=1024))
    headers = patches.headers
    camera = Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=128, height=128)
    camera = replace(camera, intrinsics=camera.intrinsics * torch.tensor([[[stretch[0]], [stretch[1]], [1.0]]]))
    options = SelectionOptions(coarse_radius=1.5, fine_radius=0.5, cull=False)
    found = select_patches(headers, camera, options, two_sided=False, margin=1.0)
    focal, eye = float(torch.maximum(camera.intrinsics[0, 0, 0], camera.intrinsics[0, 1, 1])), camera.eye[0]
    for row, patch in enumerate(found.chosen.tolist()):
        low, high = headers.box[patch]
        distance = float((torch.minimum(torch.maximum(eye, low), high) - eye).norm())
        fine = bool(found.silhouette[row]) or float(headers.sigma[patch]) > options.curved_variation
        fine = fine or float(headers.cone[patch, 3]) > math.radians(options.curved_cone_deg)
        tau = 0.5 if fine else 1.5
        depth = int((headers.start[patch, 1:] > headers.start[patch, :-1]).sum()) - 1
        fits = [k for k in range(depth + 1) if focal * float(headers.radius[patch, k, 2]) / distance <= tau]
        assert int(found.level[row]) == (fits[0] if fits else depth)


def test_silhouettes_lie_around_the_outline():
    patches = build_patches(sphere_cloud(30_000), PatchOptions(max_points=512))
    camera = Cameras.look_at([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], width=128, height=128)
    found = select_patches(patches.headers, camera, SelectionOptions(), two_sided=False, margin=1.0)
    # The outline of a unit sphere seen from five units away lies at z = 0.2.
    z = patches.headers.centre[found.chosen][:, 2]
    assert bool(found.silhouette.any()) and not bool(found.silhouette.all())
    assert float((z[found.silhouette] - 0.2).abs().max()) < 0.7
    assert float(z[~found.silhouette].min()) > 0.2


def test_an_eye_inside_a_patch_culls_nothing_of_it():
    headers = headers_of(
        torch.zeros(1, 3).double(), torch.ones(1, 3).double(), torch.tensor([[0.0, 0.0, 1.0, 0.0]]).double(),
        torch.ones(1).double(),
    )  # fmt: skip
    for target in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.2, 0.0]):
        camera = Cameras.look_at([0.1, 0.2, 0.3], target, width=32, height=32)
        assert len(select_patches(headers, camera, SelectionOptions(), two_sided=False, margin=1.0).chosen) == 1


def test_options_check_themselves():
    with pytest.raises(OptionError, match="coarse_radius"):
        SelectionOptions(coarse_radius=0.1)
    with pytest.raises(OptionError, match="fine_radius must be <="):
        SelectionOptions(coarse_radius=0.6, fine_radius=0.7)
    with pytest.raises(OptionError, match="level"):
        SelectionOptions(level="finest")
