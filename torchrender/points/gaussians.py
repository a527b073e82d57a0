"""3D Gaussians and half-transparent points: ellipsoids projected by EWA and blended from the front to the back.

Source: Zwicker et al. 2001, "EWA volume splatting" (the projected covariance); Kerbl et al. 2023, "3D Gaussian
splatting" (opacity, order, and the low-pass of 0.3 square pixels). Colours are blended as sRGB codes, as the files of
such models mean them.
"""

from __future__ import annotations

import time

import numpy as np
import torch
from torch import Tensor

from torchrender.errors import CameraError
from torchrender.kernels.points.blended import TILE, blend_tiles, count_tiles, fill_tiles
from torchrender.numerics.color import linear_from_srgb, srgb_from_linear
from torchrender.numerics.quaternions import rotations
from torchrender.points.cloud import PointCloud
from torchrender.points.options import PointImage, SplatOptions, SplatStatistics
from torchrender.scene.camera import Cameras
from torchrender.scene.files.plain.ply import Gaussians

LOW_PASS = 0.3
"""Variance of the screen filter, square pixels."""
REACH = 3.33
"""Standard deviations that a Gaussian is drawn to: beyond, it covers less than a code of 255."""
WIDEST = 1.3
"""Tangents beyond this many times those of the picture's edge are projected as at that edge (affine projection)."""
DISC = 0.5
"""Standard deviation of a disc over its radius."""
_GREY = 0.8
_LARGEST = 3e38  # of float32


def covariances(model: Gaussians) -> np.ndarray:
    """(N,3,3) float32 ``R S S^T R^T`` of scales and rotations."""
    turn = rotations(model.rotation.astype(np.float64)[:, [1, 2, 3, 0]])
    axes = turn * model.scale.astype(np.float64)[:, None, :]
    wide = axes @ axes.transpose(0, 2, 1)
    most = np.abs(wide).max(axis=(1, 2), keepdims=True, initial=_LARGEST)
    spread: np.ndarray = (wide * (_LARGEST / most)).astype(np.float32)  # the whole matrix: it stays a covariance
    return spread


def is_blended(cloud: PointCloud) -> bool:
    """Whether a cloud shows what lies behind its points: only this module draws such ones."""
    return cloud.spread is not None or (cloud.opacity is not None and bool((cloud.opacity < 1.0).any()))


def render_gaussians(cloud: PointCloud, cameras: Cameras, options: SplatOptions) -> PointImage:
    """Draw a cloud from B perspective cameras; points without a covariance are discs about their normals.

    Raises:
        CameraError: orthographic cameras.
    """
    if cameras.orthographic:
        raise CameraError("points are drawn by perspective cameras only")
    spread = cloud if cloud.spread is not None else cloud.completed()
    covariance = spread.spread.double() if spread.spread is not None else _discs(spread)
    shape = (len(cameras), cameras.height, cameras.width)
    image, depth, cover = torch.zeros(*shape, 3), torch.zeros(shape), torch.zeros(shape)
    background = srgb_from_linear(torch.tensor(options.background).clamp(0.0, 1.0))
    statistics = []
    for number in range(len(cameras)):
        begin = time.perf_counter()
        records, boxes = project(cloud, covariance, cameras[number])
        middle = time.perf_counter()
        _blend(records, boxes, image[number], depth[number], cover[number])
        end = time.perf_counter()
        ms = {"project": 1e3 * (middle - begin), "draw": 1e3 * (end - middle)}
        statistics.append(_statistics(len(cloud), len(records), ms))
    image = linear_from_srgb(image + (1.0 - cover[..., None]).clamp_min(0.0) * background)
    return PointImage(image, depth, cover, tuple(statistics))


def _discs(cloud: PointCloud) -> Tensor:
    """(P,3,3) covariance of discs; of a point without a normal that of a ball."""
    assert cloud.radius is not None and cloud.normal is not None
    normal = cloud.normal.double()
    flat = torch.eye(3, dtype=torch.float64) - normal[:, :, None] * normal[:, None, :]
    return flat * (DISC * cloud.radius.double()).square()[:, None, None]


def project(cloud: PointCloud, covariance: Tensor, camera: Cameras) -> tuple[np.ndarray, np.ndarray]:
    """Records (N,10) float32 of what is in view, nearest first, and the tiles (N,4) int32 that each meets."""
    k, turn = camera.intrinsics[0], camera.rotation[0]
    place = camera.transform(cloud.position)[0]
    z = place[:, 2]
    inside = (z > float(camera.near[0])) & (z < float(camera.far[0]))
    rows = inside.nonzero().reshape(-1)
    place, z = place[rows], z[rows]
    edge = WIDEST * torch.tensor([camera.width / (2 * float(k[0, 0])), camera.height / (2 * float(k[1, 1]))])
    tangent = place[:, :2] / z[:, None]
    bent = torch.maximum(torch.minimum(tangent, edge), -edge)
    slope = torch.zeros(len(rows), 2, 3, dtype=torch.float64)
    slope[:, 0, 0], slope[:, 1, 1] = k[0, 0] / z, k[1, 1] / z
    slope[:, 0, 2], slope[:, 1, 2] = -k[0, 0] * bent[:, 0] / z, -k[1, 1] * bent[:, 1] / z
    matrix = slope @ turn
    flat = matrix @ covariance[rows] @ matrix.transpose(1, 2)
    a, b, c = flat[:, 0, 0] + LOW_PASS, flat[:, 0, 1], flat[:, 1, 1] + LOW_PASS
    centre = torch.stack([k[0, 0] * tangent[:, 0] + k[0, 2], k[1, 1] * tangent[:, 1] + k[1, 2]], dim=1)
    determinant = a * c - b * b
    reach = REACH * torch.stack([a, c], dim=1).sqrt()
    low, high = centre - reach, centre + reach
    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    seen = ((high > 0) & (low < size)).all(1) & torch.isfinite(determinant) & (determinant > 0)
    order = seen.nonzero().reshape(-1)
    order = order[torch.argsort(z[order], stable=True)]
    rows = rows[order]
    opacity = torch.ones(len(rows)) if cloud.opacity is None else cloud.opacity[rows]
    color = torch.full((len(rows), 3), _GREY) if cloud.color is None else cloud.color[rows]
    inverse = torch.stack([c, -b, a], dim=1)[order] / determinant[order, None]
    planes = (centre[order], inverse, z[order, None], opacity[:, None], srgb_from_linear(color.clamp(0.0, 1.0)))
    records = torch.cat([p.float() for p in planes], dim=1).contiguous()
    last = torch.tensor([-(-camera.width // TILE), -(-camera.height // TILE)]) - 1
    first = torch.minimum((low[order] / TILE).floor().clamp(0, 1e6).long(), last)
    until = torch.minimum((high[order] / TILE).floor().clamp(0, 1e6).long(), last)
    boxes = torch.stack([first[:, 0], until[:, 0], first[:, 1], until[:, 1]], dim=1).int().contiguous()
    return records.numpy(), boxes.numpy()


def _blend(records: np.ndarray, boxes: np.ndarray, image: Tensor, depth: Tensor, cover: Tensor) -> None:
    height, width = cover.shape
    across, down = -(-width // TILE), -(-height // TILE)
    counts = np.zeros(across * down, np.int64)
    count_tiles(boxes, across, counts)
    start = np.concatenate([[0], counts.cumsum()])
    entries = np.empty(max(int(start[-1]), 1), np.int32)
    fill_tiles(boxes, across, start[:-1].copy(), entries)
    blend_tiles(records, entries, start, image.numpy(), depth.numpy(), cover.numpy())


_NONE = dict.fromkeys(
    (
        *("patches", "patches_outside", "patches_back", "reconstruction", "low_pass", "squares", "back"),
        *("degenerate", "large", "capped", "evaluations", "bytes_read"),
    ),
    0,
)


def _statistics(points: int, drawn: int, ms: dict[str, float]) -> SplatStatistics:
    return SplatStatistics(points=points, nodes=points, drawn=drawn, full=drawn, behind=points - drawn, **_NONE, ms=ms)
