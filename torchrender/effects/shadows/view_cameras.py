"""Cameras of a light that follow the view: fitted to the surfaces that a picture sees, whatever casts shadows on them.

The picture's own pixels say where its receivers stand in the light's images and how far from the eye, so no texel is
spent on what is not seen. The range of distances is cut into slices where that makes texels smaller beside pixels.
Texel sizes are powers of 2^(1/4), windows move in steps of an eighth of their width and depths are counted from
powers of two: while the view moves a little nothing changes, and when something does, by whole texels.

Sources: Lauritzen, Salvi and Lefohn, Sample distribution shadow maps, 2010; Zhang et al., Parallel-split shadow maps,
2006.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.shadows.light_cameras import extent, light_frames
from torchrender.effects.shadows.light_reach import lamps_of, points_of
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.kernels.shadows.light_reach import (
    COUNT,
    HIGH_A,
    HIGH_B,
    HIGH_Z,
    LOW_A,
    LOW_B,
    LOW_Z,
    Points,
    bound_receivers,
)
from torchrender.numerics.transforms import pinhole_matrix
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light
from torchrender.scene.model import Scene

MOST_CASCADES = 4
"""Chosen at most where their number is not given."""

_STEPS = 48  # of the eye's depth, factors of sqrt(2)
_PARTS = 16
_SLACK = 8  # windows move in steps of this part of their width
_FINEST = 8.0  # texels are at most this many times smaller than pixels
_WORTH = 0.5  # powers of two by which one more cascade must shrink texels that are larger than pixels
_NEAREST = 2.0**-14  # near plane before the nearest receiver, of its depth: casters between them count


class _Window(NamedTuple):
    """One view of a light: the receivers' bounds in its image."""

    frame: int
    bounds: np.ndarray  # (7,) as in the kernel's table
    footprint: float  # of the smallest pixel, scene units


def view_cameras(
    scene: Scene, light: Light, gbuffer: GBuffer, options: ShadowOptions
) -> tuple[Cameras, tuple[int, ...]]:
    """The views that a light needs for what B pictures see of a scene.

    Returns:
        The views, finest first within a picture, and B + 1 numbers: those of picture b are views ``starts[b]`` to
        ``starts[b + 1]``. A light that reaches nothing in a picture has none there.
    """
    frames, orthographic = light_frames(light)
    rows = np.ascontiguousarray(frames[:, :3].reshape(len(frames), 12).numpy())
    boxes = scene.geometry.cluster_bounds
    lamps = lamps_of([light])
    table = np.zeros((_PARTS, len(frames), _STEPS, 7))
    made, starts = [], [0]
    for index, points in enumerate(points_of(scene, gbuffer)):
        first = _first_step(points)
        bound_receivers(points, lamps, 0, rows, orthographic, first, table)
        windows = _windows(_joined(table), gbuffer.cameras[index], first, (orthographic, options))
        fit = _parallel if orthographic else _perspective
        made += [fit(frames[w.frame], w, boxes, options) for w in windows]
        starts.append(len(made))
    height, width = options.shape
    if not made:
        limits = torch.zeros(0, dtype=torch.float64)
        nothing = torch.zeros(0, 4, 4, dtype=torch.float64)
        return Cameras(nothing, nothing[:, :3, :3], width, height, limits, limits, orthographic), tuple(starts)
    return Cameras.cat(made), tuple(starts)


def same_views(first: Cameras, second: Cameras) -> bool:
    """Two sets of views show the same, texel by texel."""
    names = ("camera_from_world", "intrinsics", "near", "far")
    return all(torch.equal(getattr(first, name), getattr(second, name)) for name in names)


def _first_step(points: Points) -> int:
    """Number of the nearest step of depth that holds a surface."""
    depth = points.depth[points.takes]
    nearest = float(depth[depth > 0].min()) if bool((depth > 0).any()) else 1.0
    return math.floor(2 * math.log2(nearest))


def _joined(table: np.ndarray) -> np.ndarray:
    """(F,N,7) bounds of all parts of the work."""
    out = np.empty(table.shape[1:])
    for low in (LOW_A, LOW_B, LOW_Z):
        out[..., low] = table[..., low].min(axis=0)
        out[..., low + 1] = table[..., low + 1].max(axis=0)
    out[..., COUNT] = table[..., COUNT].sum(axis=0)
    return out


def _windows(table: np.ndarray, eye: Cameras, first: int, how: tuple[bool, ShadowOptions]) -> list[_Window]:
    """The views that are needed: of every face in which something is seen, and slices of a single one."""
    orthographic, options = how
    steps = np.arange(table.shape[1])
    size = float((1.0 / eye.intrinsics[0, (0, 1), (0, 1)]).max())
    pixels = np.full(len(steps), size) if eye.orthographic else size * 2.0 ** ((first + steps) / 2)
    found = []
    for frame, rows in enumerate(table):
        used = np.flatnonzero(rows[:, COUNT])
        if not len(used):
            continue
        rows, fine = rows[used], pixels[used]
        cuts = [0, len(used)]
        if len(table) == 1 and not eye.orthographic:
            cuts = _cuts(rows, fine, orthographic, options)
        for a, b in pairwise(cuts):
            found.append(_Window(frame, _union(rows[a:b]), float(fine[a:b].min())))
    return found


def _union(rows: np.ndarray) -> np.ndarray:
    """(7,) bounds of (N,7) bounds."""
    low, high = rows.min(axis=0), rows.max(axis=0)
    return np.array([low[0], high[1], low[2], high[3], low[4], high[5], rows[:, COUNT].sum()])


def _cuts(rows: np.ndarray, pixels: np.ndarray, orthographic: bool, options: ShadowOptions) -> list[int]:
    """Where to cut N steps of depth: ends of the slices, with 0 and N."""
    count, most = len(rows), min(options.cascades or MOST_CASCADES, len(rows))
    blur = np.full((count, count + 1), np.inf)  # of a slice from step i to before step j
    for i in range(count):
        low = np.minimum.accumulate(rows[i:, (LOW_A, LOW_B, LOW_Z)], axis=0)
        high = np.maximum.accumulate(rows[i:, (HIGH_A, HIGH_B, HIGH_Z)], axis=0)
        texel = (high - low)[:, :2].max(axis=1) / _room(options).min()
        if not orthographic:
            texel = texel * high[:, 2]
        with np.errstate(divide="ignore"):
            over = np.log2(np.maximum(texel[:, None] / pixels[None, i:], 1.0)) * rows[None, i:, COUNT]
        blur[i, i + 1 :] = np.tril(over).sum(axis=1)
    blur /= rows[:, COUNT].sum()
    best, back = [blur[0].copy()], []
    for _ in range(1, most):
        total = best[-1][:, None] + np.concatenate([blur, np.full((1, count + 1), np.inf)])
        back.append(total.argmin(axis=0))
        best.append(total.min(axis=0))
    chosen = len(best) - 1
    if options.cascades is None:
        chosen = 0
        while chosen + 1 < len(best) and best[chosen][count] - best[chosen + 1][count] > _WORTH:
            chosen += 1
    cuts = [count]
    for level in range(chosen, 0, -1):
        cuts.append(int(back[level - 1][cuts[-1]]))
    return sorted({*cuts, 0})


def _room(options: ShadowOptions) -> np.ndarray:
    """Texels along width and height that a window's content may take: its border and its steps are left free."""
    height, width = options.shape
    return (np.array([width, height]) - 2.0 * options.border) * (1.0 - 1.0 / _SLACK)


def _grid(window: _Window, smallest: float, options: ShadowOptions) -> tuple[np.ndarray, np.ndarray]:
    """Size of a texel and middle of the window (2,) in the light's image plane, on the steps that keep them still."""
    low, high = window.bounds[[LOW_A, LOW_B]], window.bounds[[HIGH_A, HIGH_B]]
    least = np.maximum((high - low) / _room(options), smallest)
    texel = 2.0 ** (np.ceil(4.0 * np.log2(least)) / 4.0)
    inner = np.array([options.shape[1], options.shape[0]]) - 2.0 * options.border
    step = np.floor(inner / _SLACK)
    begin = np.floor(low / (texel * step)) * step
    return texel, (begin + np.floor(inner / 2)) * texel


def _parallel(frame: Tensor, window: _Window, boxes: Tensor, options: ShadowOptions) -> Cameras:
    height, width = options.shape
    low, high = window.bounds[LOW_Z], window.bounds[HIGH_Z]
    texel, middle = _grid(window, window.footprint / _FINEST, options)
    # Depths count from a power of two within the receivers, so that float32 holds them well.
    unit = 2.0 ** math.ceil(math.log2(max(high - low, 16.0 * texel.max())))
    zero = round((low + high) / 2 / unit) * unit
    matrix = frame.clone()
    matrix[:3, 3] -= torch.tensor([*middle, zero], dtype=torch.float64)
    far = (math.ceil((high - zero) / unit) + 1.0) * unit
    casters = float(extent(frame, boxes)[0][2]) if len(boxes) else low
    near = min(casters, low) - zero - unit
    k = pinhole_matrix(1.0 / texel[0], 1.0 / texel[1], width / 2, height / 2)
    return Cameras(matrix[None], k[None], width, height, _number(near), _number(far), orthographic=True)


def _perspective(frame: Tensor, window: _Window, boxes: Tensor, options: ShadowOptions) -> Cameras:
    del boxes
    height, width = options.shape
    low, high = window.bounds[LOW_Z], window.bounds[HIGH_Z]
    texel, middle = _grid(window, window.footprint / _FINEST / high, options)
    near, far = (2.0 ** math.floor(math.log2(low)) * _NEAREST, 2.0 ** (math.ceil(math.log2(high)) + 1))
    centre = [width / 2 - middle[0] / texel[0], height / 2 - middle[1] / texel[1]]
    k = pinhole_matrix(1.0 / texel[0], 1.0 / texel[1], *centre)
    return Cameras(frame[None], k[None], width, height, _number(near), _number(far))


def _number(value: float) -> Tensor:
    return torch.tensor(value, dtype=torch.float64)
