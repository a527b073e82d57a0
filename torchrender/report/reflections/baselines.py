"""Other ways to use an old reflection again, for comparison: by surface depth, and by motion vectors of mirrors."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.effects.reflections.key_frame import ReflectionKeyFrame
from torchrender.effects.reflections.reflectors import ReflectivePixels

ITERATIONS = 4
_AGREE = 2.0  # pixels, seen along the path: how far the point found may be from the one looked for


@dataclass(frozen=True, eq=False)
class BaselineReflections:
    """What N pixels of one new view mirror according to a baseline."""

    color: Tensor  # (N,3)
    found: Tensor  # (N,) bool; the others would have to be traced


def depth_reprojection(key: ReflectionKeyFrame, pixels: ReflectivePixels) -> BaselineReflections:
    """The old picture warped by the depth of the reflectors, as if what they mirror were painted on them."""
    camera = key.cameras[0]
    uv, depth = camera.project(pixels.position[None])
    uv, depth = uv[0], depth[0]
    place, inside = _pixel(key, uv, depth > camera.near[0])
    surface = key.surface[0].reshape(-1, 8)[place]
    cosine = (pixels.normal * pixels.view).sum(-1).abs().clamp_min(0.1)
    tolerance = 0.01 * depth + 2.0 * pixels.pixel_angle * pixels.length / cosine
    same = key.reflector[0].reshape(-1)[place] == pixels.object_id
    found = inside & same & ((surface[:, 7].double() - depth).abs() <= tolerance)
    return BaselineReflections(_bilinear(key, uv, pixels.object_id), found)


def mirror_motion_vectors(
    key: ReflectionKeyFrame, pixels: ReflectivePixels, iterations: int = ITERATIONS
) -> BaselineReflections:
    """Motion vectors of what is mirrored: its virtual picture behind the mirror's tangent plane, seen from the key eye.

    The distance of what a pixel mirrors is not known before it is traced; it is taken from the key frame where the
    virtual picture falls, over and over. A pixel counts as found if the point there is the one looked for. After the
    mirror and glossy motion vectors of Zeng et al., *Temporally reliable motion vectors for real-time ray tracing*
    (Eurographics 2021).
    """
    camera = key.cameras[0]
    eye = pixels.cameras.eye[0]
    uv, depth = camera.project(pixels.position[None])
    uv, before = uv[0], depth[0] > camera.near[0]
    far = 1e4 * float(pixels.length.max()) if len(pixels) else 1.0
    for _ in range(iterations):
        place, inside = _pixel(key, uv, before)
        distance = key.distance[0].reshape(-1)[place].double()
        distance = torch.where(torch.isfinite(distance) & inside, distance, far)
        virtual = eye + (pixels.length + distance)[:, None] * pixels.view
        uv, depth = (v[0] for v in camera.project(virtual[None]))
        before = depth > camera.near[0]
    place, inside = _pixel(key, uv, before)
    reached = key.reached[0].reshape(-1, 4)[place].double()
    start = pixels.position - camera.eye[0]
    toward = torch.where(reached[:, 3:] > 0, reached[:, :3] - start, reached[:, :3])
    along = (toward * pixels.direction).sum(-1)
    off = (toward - along[:, None] * pixels.direction).norm(dim=-1)
    path = torch.where(reached[:, 3] > 0, along + pixels.length, 1.0)
    same = key.reflector[0].reshape(-1)[place] == pixels.object_id
    found = inside & same & (along > 0) & (off <= _AGREE * pixels.pixel_angle * path)
    return BaselineReflections(_bilinear(key, uv, pixels.object_id), found)


def _pixel(key: ReflectionKeyFrame, uv: Tensor, before: Tensor) -> tuple[Tensor, Tensor]:
    """Flat key pixel (N,) at positions (N,2), and whether there is one."""
    height, width = key.reflector.shape[1:]
    size = torch.tensor([width, height])
    inside = before & ((uv >= 0) & (uv < size)).all(-1)
    x, y = torch.where(inside[:, None], uv, 0.0).long().unbind(-1)
    return y * width + x, inside


def _bilinear(key: ReflectionKeyFrame, uv: Tensor, own: Tensor) -> Tensor:
    """Colours (N,3) at key positions among the pixels of the own reflector; 0 where there is none."""
    height, width = key.reflector.shape[1:]
    at = torch.nan_to_num(uv, nan=-1e6).clamp(-1e6, 1e6) - 0.5
    first = at.floor().long()
    part = (at - first).float()
    total, color = torch.zeros(len(uv)), torch.zeros(len(uv), 3)
    for j in (0, 1):
        for i in (0, 1):
            x, y = first[:, 0] + i, first[:, 1] + j
            inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
            place = torch.where(inside, y * width + x, 0)
            weight = (part[:, 0] if i else 1 - part[:, 0]) * (part[:, 1] if j else 1 - part[:, 1])
            weight = weight * (inside & (key.reflector[0].reshape(-1)[place] == own))
            total += weight
            color += weight[:, None] * key.color[0].reshape(-1, 3)[place]
    return color / total.clamp_min(1e-6)[:, None]
