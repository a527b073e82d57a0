"""Direction of the sun from windows and the floor that it lights through them.

Source: specification 12, section 4: observed directions and overlap in the image, by the simplex method.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from scipy.optimize import minimize
from torch import Tensor

from torchrender.errors import InputError
from torchrender.photo.fog.options import FogWarning
from torchrender.scene.camera import Cameras

FEW_CORNERS = 5
LOWEST_DEG = 3.0
NEAR = 0.05
"""Metres before the camera at which polygons are cut."""
SUB_BITS = 4
SIMPLEX_DEG = 3.0
EVALUATIONS = 60


@dataclass(frozen=True, eq=False)
class SunFit:
    """A direction, and how well it fits."""

    direction: Tensor  # (3,) float64 unit, the way the light travels
    iou: float  # mean over the windows
    start: Tensor  # (3,) normalised mean of the observed directions
    start_iou: float


def angle(a: Tensor, b: Tensor) -> Tensor:
    """(...) angle between vectors (...,3), radians: atan2 of cross and dot, exact and differentiable down to 0."""
    cross = torch.linalg.cross(a, b.expand_as(a))
    square = (cross * cross).sum(dim=-1)
    safe = torch.where(square > 0, square, 1.0)
    return torch.atan2(torch.where(square > 0, safe.sqrt(), 0.0), (a * b).sum(dim=-1))


def direction_at(azimuth: float, elevation: float) -> Tensor:
    """(3,) float64 way of sunlight from a sun at an elevation, radians."""
    return torch.tensor(
        [math.cos(elevation) * math.cos(azimuth), -math.sin(elevation), math.cos(elevation) * math.sin(azimuth)],
        dtype=torch.float64,
    )


def angles_at(direction: Tensor) -> tuple[float, float]:
    """Azimuth and elevation of :func:`direction_at`."""
    x, y, z = (float(v) for v in direction)
    return math.atan2(z, x), math.atan2(-y, math.hypot(x, z))


def same_order(window: Tensor, lit: Tensor, name: str) -> Tensor:
    """Lit corners (m,3) in the order of the window's, with a warning if their connectors cross as they are given.

    Reversed and shifted orders are tried, of few corners all.
    """

    def spread(order: Tensor) -> float:
        ways = torch.nn.functional.normalize(order - window, dim=-1)
        return float(angle(ways, ways.mean(dim=0)).sum())

    if crossings(window, lit) == 0:
        return lit
    if len(lit) <= FEW_CORNERS:
        orders = [lit[list(order)] for order in itertools.permutations(range(len(lit)))]
    else:
        orders = [o.roll(k, 0) for o in (lit, lit.flip(0)) for k in range(len(lit))]
    best = min(orders, key=spread)
    if spread(best) < spread(lit) - 1e-9:
        warnings.warn(
            f"{name}: lines from its corners to its lit corners cross: the lit corners are taken in another order",
            FogWarning, stacklevel=3,
        )  # fmt: skip
        return best
    return lit


def crossings(window: Tensor, lit: Tensor) -> int:
    """Pairs of connectors that cross, seen along their mean."""
    mean = torch.nn.functional.normalize((lit - window).mean(dim=0), dim=0)
    other = torch.eye(3, dtype=torch.float64)[int(mean.abs().argmin())]
    across = torch.nn.functional.normalize(torch.linalg.cross(other, mean), dim=0)
    basis = torch.stack([across, torch.linalg.cross(mean, across)])
    a, b = window @ basis.T, lit @ basis.T
    # Seen so, parallel connectors are points: turned corners make their ends change sides.
    count = 0
    for i, j in itertools.combinations(range(len(a)), 2):
        before, after = a[j] - a[i], b[j] - b[i]
        count += int(float(before @ after) < 0)
    return count


def fit_sun(
    windows: Sequence[tuple[Tensor, Tensor]], camera: Cameras, floor: float = 0.0, *, angle_weight: float = 1.0,
    iou_weight: float = 1.0,
) -> SunFit:  # fmt: skip
    """The direction that fits windows (m,3) and lit floors (m,3) best.

    Raises:
        InputError: no window, or lit corners that are not below the window's.
    """
    if not windows:
        raise InputError("the sun's direction needs a window with its lit floor")
    observed = torch.cat([torch.nn.functional.normalize(lit - window, dim=-1) for window, lit in windows])
    start = torch.nn.functional.normalize(observed.mean(dim=0), dim=0)
    if float(start[1]) > -1e-3:
        raise InputError("lit floors must lie below their windows: are they marked the right way round?")
    areas = [mask_of(lit, camera) for _, lit in windows]
    lowest = math.radians(LOWEST_DEG)

    def overlaps(direction: Tensor) -> list[float]:
        return [iou(mask_of(cast(window, direction, floor), camera), a)
                for (window, _), a in zip(windows, areas, strict=True)]  # fmt: skip

    def cost(x: np.ndarray) -> float:
        direction = direction_at(x[0], max(x[1], lowest))
        below = 100.0 * max(0.0, lowest - x[1], x[1] - math.pi / 2)
        return angle_weight * float(angle(observed, direction).sum()) - iou_weight * sum(overlaps(direction)) + below

    first = np.array(angles_at(start))
    first[1] = max(first[1], lowest)
    step = math.radians(SIMPLEX_DEG)
    simplex = np.stack([first, first + np.array([step, 0.0]), first + np.array([0.0, step])])
    options = {"initial_simplex": simplex, "maxfev": EVALUATIONS, "xatol": 1e-5, "fatol": 1e-6}
    found = minimize(cost, first, method="Nelder-Mead", options=options)
    best = found.x if found.fun <= cost(first) else first
    direction = direction_at(best[0], max(best[1], lowest))
    begin = direction_at(first[0], first[1])
    return SunFit(direction, float(np.mean(overlaps(direction))), start, float(np.mean(overlaps(begin))))


def cast(window: Tensor, direction: Tensor, floor: float) -> Tensor:
    """(m,3) where light through corners (m,3) meets the floor."""
    return window + direction * ((floor - window[:, 1:2]) / direction[1])


def mask_of(places: Tensor, camera: Cameras) -> np.ndarray:
    """(H,W) uint8 image of a polygon (m,3), cut before the camera; empty if all of it lies behind."""
    mask = np.zeros((camera.height, camera.width), np.uint8)
    seen = _cut(camera.transform(places)[0].numpy())
    if len(seen) >= 3:
        k = camera.intrinsics[0].numpy()
        pixels = seen @ k.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        # Far corners would overflow the rasteriser's integers.
        limit = 2.0**20
        codes = np.round((np.clip(pixels, -limit, limit) - 0.5) * 2**SUB_BITS).astype(np.int32)
        cv2.fillPoly(mask, [codes.reshape(-1, 1, 2)], 1, shift=SUB_BITS)
    return mask


def _cut(points: np.ndarray) -> np.ndarray:
    """Polygon (m,3) in camera space before the plane z = NEAR."""
    out = []
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        if a[2] >= NEAR:
            out.append(a)
        if (a[2] >= NEAR) != (b[2] >= NEAR):
            out.append(a + (b - a) * (NEAR - a[2]) / (b[2] - a[2]))
    return np.array(out).reshape(-1, 3)


def iou(one: np.ndarray, other: np.ndarray) -> float:
    """Common area over that of both together; 0 if there is none."""
    union = int(np.count_nonzero(one | other))
    return int(np.count_nonzero(one & other)) / union if union else 0.0
