"""A light's depth images, made ready to tell where rays are lit: pyramids, and epipolar slices."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import ShadowMap
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import LightTable
from torchrender.errors import InputError
from torchrender.kernels.media.records import PLACE, SUN, Images, Slices
from torchrender.kernels.media.slices import NUMBERS, RUN, build_slices
from torchrender.kernels.media.walk import build_pyramid

NO_IMAGES = Images(
    np.zeros((0, 16), np.float32), False, np.zeros((0, 1, 2), np.float32), np.zeros((1, 3), np.int64)
)  # fmt: skip
NO_SLICES = Slices(
    np.zeros((1, RUN), np.float32), np.zeros((1, 2, 2), np.float32), np.zeros((1, RUN, 2), np.int8),
    np.zeros(1, np.float32), np.zeros(NUMBERS, np.float32),
)  # fmt: skip
CLOSE = 1e-3
"""Distance of a lamp from the eye, as a share of the longest ray, below which there is no plane through both."""
CLOSEST = 0.4
"""Pixels between slices, closer than which they tell no more."""
STEEP = 4.0
"""Change of depth between entries, in lengths of one, that is the edge of something."""
FEWEST = 32
"""Slices, however few pixels there are."""


def views_of(shadow_map: ShadowMap, origin: Tensor) -> np.ndarray:
    """(V,16) float32: 3x4 matrix from places relative to ``origin`` to the view, focal lengths, centre.

    Raises:
        InputError: views with skew.
    """
    cameras = shadow_map.cameras
    if bool((cameras.intrinsics[:, 0, 1] != 0).any()):
        raise InputError("shadow_map.cameras must not have skew")
    matrix = cameras.camera_from_world[:, :3].clone()
    matrix[:, :, 3] += matrix[:, :, :3] @ origin
    k = cameras.intrinsics
    numbers = torch.stack([k[:, 0, 0], k[:, 1, 1], k[:, 0, 2], k[:, 1, 2]], dim=1)
    return view(torch.cat([matrix.reshape(-1, 12), numbers], dim=1), np.float32)


def images_of(shadow_map: ShadowMap, views: np.ndarray, *, pyramid: bool) -> Images:
    """The images with their pyramid, or without one for slices alone."""
    cameras = shadow_map.cameras
    height, width = cameras.height, cameras.width
    levels = [[0, height, width]]
    while max(height, width) > 1:
        first = levels[-1][0] + height * width
        height, width = (height + 1) // 2, (width + 1) // 2
        levels.append([first, height, width])
    table = np.array(levels, np.int64)
    if not pyramid:
        return Images(views, cameras.orthographic, np.zeros((len(cameras), 1, 2), np.float32), table)
    made = np.empty((len(cameras), int(table[-1, 0]) + 1, 2), np.float32)
    build_pyramid(view(shadow_map.depth, np.float32), cameras.orthographic, table, made)
    return Images(views, cameras.orthographic, made, table)


@dataclass(frozen=True, eq=False)
class Sight:
    """What the eye's rays have in common: the corners of the picture bound their directions."""

    corners: Tensor  # (4,3) float64 directions through the picture's corners, in order around it
    matrix: Tensor  # (3,3) float64 from pixels to directions
    longest: float  # ray length
    pixel: float  # angle between the rays of neighbouring pixels, radians


def slices_of(
    shadow_map: ShadowMap, views: np.ndarray, light: LightTable, sight: Sight, options: ScatterOptions
) -> Slices | None:
    """Slices of the light's images through the eye, which is the origin; None where the lamp is the eye.

    Rows of parallel light reach as far as the longest ray, and have no more entries than texels pass there.
    Pictures of few pixels get fewer slices.
    """
    numbers = np.zeros(NUMBERS, np.float64)
    count, texels = options.slices
    if light.kind == SUN:
        span = _parallel_numbers(numbers, shadow_map, views, sight)
    else:
        span = _lamp_numbers(numbers, light, sight)
    if span is None:
        return None
    count = min(count, _useful(numbers, sight, span[1] - span[0]))
    numbers[10] = (span[1] - span[0]) / count
    if light.kind == SUN:
        texels = max(min(texels, 1 << (int(span[2]) - 1).bit_length()), 2 * RUN)
        numbers[16] = STEEP * span[2] / texels / float(np.abs(views[0, 12:14]).min())
    numbers[9], numbers[12] = span[0], span[2] / texels
    rows = np.empty((count, texels), np.float32)
    tree = np.empty((count, 2 * texels // RUN, 2), np.float32)
    made = Slices(
        rows, tree, np.empty((count, texels if light.kind == SUN else 1, 2), np.int8), np.zeros(count, np.float32),
        numbers.astype(np.float32),
    )  # fmt: skip
    depth = view(shadow_map.depth, np.float32)
    build_slices(depth, views, light.kind == SUN, made.numbers, made.rows, made.tree, made.edges, made.starts)
    return made


def _useful(numbers: np.ndarray, sight: Sight, span: float) -> int:
    """How many slices of ``span`` radians lie as close as ``CLOSEST`` pixels where they are farthest apart."""
    across, upward, axis = torch.from_numpy(numbers[:9].reshape(3, 3))
    cosine = (sight.corners @ axis) / sight.corners.norm(dim=1)
    # At right angles to the axis they are; where no ray is that, at a corner.
    beside = 1.0 if float(cosine.min()) <= 0.0 <= float(cosine.max()) else float((1 - cosine.square()).max()) ** 0.5
    first, second = float(across.norm()), float(upward.norm())
    skewed = max(first, second) / max(min(first, second), 1e-30)
    return max(math.ceil(min(span * beside * skewed / (CLOSEST * sight.pixel), 2.0**20)), FEWEST)


def _lamp_numbers(numbers: np.ndarray, light: LightTable, sight: Sight) -> tuple[float, float, float] | None:
    place = torch.from_numpy(light.numbers[PLACE : PLACE + 3].astype(np.float64))
    distance = float(place.norm())
    if distance < CLOSE * sight.longest:
        return None
    axis = place / distance
    across = torch.linalg.cross(axis, torch.eye(3, dtype=torch.float64)[int(axis.abs().argmin())])
    across = across / across.norm()
    upward = torch.linalg.cross(axis, across)
    numbers[:9] = torch.cat([across, upward, axis]).numpy()
    numbers[13] = distance
    first, last = angle_range(sight.corners @ across, sight.corners @ upward, sight.corners @ axis)
    return first, last, math.pi


def _parallel_numbers(
    numbers: np.ndarray, shadow_map: ShadowMap, views: np.ndarray, sight: Sight
) -> tuple[float, float, float] | None:
    m = views[0].astype(np.float64)
    frame = torch.from_numpy(np.stack([m[0:3] * m[12], m[4:7] * m[13], m[8:11]]))
    u, v, depth = m[3] * m[12] + m[14], m[7] * m[13] + m[15], m[11]
    numbers[:9] = frame.reshape(-1).numpy()
    numbers[13], numbers[14], numbers[15] = u, v, depth
    width, height = shadow_map.cameras.width, shadow_map.cameras.height
    speed = float(torch.linalg.matrix_norm(frame[:2], 2))  # texels per unit of length, at most
    x, y, z = (sight.corners @ frame.T).unbind(1)
    first, last = angle_range(x, y, z * speed)
    beside = math.hypot(max(-u, u - width, 0.0), max(-v, v - height, 0.0))
    columns = min(math.hypot(width, height), max(sight.longest * speed - beside, 0.0)) + 2.0
    return first, last, columns


def angle_range(x: Tensor, y: Tensor, z: Tensor) -> tuple[float, float]:
    """Angles about the third axis that the cone through four corners covers; all of them if the axis is inside."""
    corners = torch.stack([x, y, z], dim=1)
    inside = []
    for sign in (1.0, -1.0):
        sides = []
        for k in range(4):
            normal = torch.linalg.cross(corners[k], corners[(k + 1) % 4])
            sides.append(float(normal[2]) * sign * float(torch.sign(normal @ corners.sum(0))))
        inside.append(all(side >= -1e-9 for side in sides))
    if any(inside):
        return -math.pi, math.pi
    angles = torch.atan2(y, x)
    middle = math.atan2(float(torch.sin(angles).mean()), float(torch.cos(angles).mean()))
    off = torch.remainder(angles - middle + math.pi, 2 * math.pi) - math.pi
    low, high = float(off.min()), float(off.max())
    margin = 1e-3 + 0.01 * (high - low)
    if high - low > math.pi - 2 * margin:
        return -math.pi, math.pi
    return middle + low - margin, middle + high + margin
