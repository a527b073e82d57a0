"""How well a reconstruction stands for the scene: closedness, coverage, overdraw, depth error.

Source: specification 02, section 3.5.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.checks import check_range
from torchrender.errors import InputError
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.reconstruct.corners import SampleQuads
from torchrender.reconstruct.hybrid import Reconstruction
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

LAYERS = 8  # surfaces counted in one pixel


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Figures of a reconstruction drawn from B cameras, each (B,) float64."""

    coverage: Tensor  # share of the pixels that the scene covers
    excess: Tensor  # share of the reconstruction's pixels where the scene is empty
    overdraw: Tensor  # faces drawn per covered pixel; 1 is none twice; at most LAYERS are counted
    depth_error: Tensor  # mean |depth difference| in pixel footprints where both cover
    far_off: Tensor  # share of those pixels that are off by more than two footprints


def quality(reconstruction: Reconstruction, scene: Geometry, cameras: Cameras) -> Quality:
    """Draw the reconstruction and the scene from B cameras and compare; surfaces seen from behind are left out."""
    truth = rasterize_visibility(scene, cameras, cull="back")
    drawn = rasterize_visibility(reconstruction.geometry, cameras, cull="back")
    both = truth.covered & drawn.covered
    # inf - inf would be NaN: mask before subtracting.
    depth = torch.where(both, truth.depth, 1.0).double()
    error = (torch.where(both, drawn.depth, 1.0) - depth).abs() / cameras.footprint(depth)
    layers = count_layers(reconstruction.geometry, cameras)
    return Quality(
        coverage=_share(both, truth.covered),
        excess=_share(drawn.covered & ~truth.covered, drawn.covered),
        overdraw=_ratio(layers.sum((1, 2)), drawn.covered.sum((1, 2))),
        depth_error=_ratio(error.sum((1, 2)), both.sum((1, 2))),
        far_off=_share(error > 2.0, both),
    )


def count_layers(geometry: Geometry, cameras: Cameras) -> Tensor:
    """(B,H,W) front-facing triangles at every pixel centre, at most LAYERS."""
    total = torch.zeros(len(cameras), cameras.height, cameras.width, dtype=torch.int64)
    tests = None
    for _ in range(LAYERS):
        layer = rasterize_visibility(geometry, cameras, cull="back", tests=tests)
        total += layer.covered
        if not bool(layer.covered.any()):
            break
        tests = FragmentTests(beyond=layer.depth, skip=layer.triangle)
    return total


def closedness(quads: SampleQuads) -> float:
    """Share of the edges between two neighbouring filled pixels on one triangle whose two ends are shared vertices.

    1 where there is no such edge. Only for pixel quads (hybrid reconstruction).

    Raises:
        InputError: grid quads, which share every vertex by construction.
    """
    if quads.centred:
        raise InputError("closedness is for the quads of pixels")
    triangle, joined = quads.images.triangle, quads.joined
    across = (triangle[:, :, 1:] == triangle[:, :, :-1]) & (triangle[:, :, 1:] >= 0)
    down = (triangle[:, 1:] == triangle[:, :-1]) & (triangle[:, 1:] >= 0)
    middle, bottom = joined[:, :-1, 1:-1], joined[:, 1:, 1:-1]
    left, right = joined[:, 1:-1, :-1], joined[:, 1:-1, 1:]
    closed_across = _same(middle, 0, 3) & _same(bottom, 1, 2)
    closed_down = _same(left, 0, 1) & _same(right, 2, 3)
    total = int(across.sum() + down.sum())
    return float((closed_across & across).sum() + (closed_down & down).sum()) / total if total else 1.0


def edge_uses(faces: Tensor) -> Tensor:
    """(3,) int64 number of mesh edges used by one, two and more of the faces (F,3)."""
    ends = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).long().sort(dim=1).values
    uses = torch.unique(ends[:, 0] * (int(faces.max()) + 1 if len(faces) else 1) + ends[:, 1], return_counts=True)[1]
    return torch.stack([(uses == 1).sum(), (uses == 2).sum(), (uses > 2).sum()])


def nearby_cameras(camera: Cameras, count: int, radius: float) -> Cameras:
    """``count`` cameras with the view of ``camera`` (a batch of one), moved within its image plane by up to ``radius``.

    Offsets fill the disc evenly (Vogel's spiral); scene units.

    Raises:
        OptionError: ``count`` < 1 or a negative radius.
    """
    check_range("count", count, 1)
    check_range("radius", radius, 0.0)
    number = torch.arange(count, dtype=torch.float64)
    distance = radius * torch.sqrt((number + 0.5) / count)
    angle = number * 2.399963229728653  # the golden angle
    matrix = camera.camera_from_world.expand(count, 4, 4).clone()
    matrix[:, 0, 3] -= distance * angle.cos()
    matrix[:, 1, 3] -= distance * angle.sin()
    return replace(
        camera,
        camera_from_world=matrix,
        intrinsics=camera.intrinsics.expand(count, 3, 3),
        near=camera.near.expand(count),
        far=camera.far.expand(count),
    )


def _same(word: Tensor, a: int, b: int) -> Tensor:
    return ((word >> (2 * a)) & 3) == ((word >> (2 * b)) & 3)


def _ratio(part: Tensor, whole: Tensor) -> Tensor:
    """``part / whole``, 0 where there is nothing."""
    return torch.where(whole > 0, part.double() / whole.clamp_min(1).double(), 0.0)


def _share(part: Tensor, whole: Tensor) -> Tensor:
    return _ratio((part & whole).sum((1, 2)), whole.sum((1, 2)))
