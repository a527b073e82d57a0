"""One pass over pixels: into the light's image, bias, compare, average.

Sources: Reeves, Salesin, Cook, Rendering antialiased shadows with depth maps, 1987 (compare first, then average);
Fernando, Percentage-closer soft shadows, 2005.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.shadows.shadow_receiver import (
    FX,
    FY,
    NEAR,
    SMALLEST_COSINE,
    choose_view,
    image_point,
    outside_view,
    plane_depth,
    receiver,
    with_reach,
)

NEAREST_TEXEL, WINDOW, DISC, PCSS, AVERAGE_DEPTH = 0, 1, 2, 3, 4
UNSURE, DARK, LIT = 0, 1, 2

_BLOCK, _PARTS = 512, 64
_RISE = 8.0  # texels of depth per texel aside, beyond the slope of the receiver: surfaces that hardly face the light
_WITHIN = 1.25  # how far outside the cone to the light a blocker still counts: texels are not points
SHARP = 1.5  # radius in texels up to which a penumbra is an edge
_CLEAR = 2.0  # texels that a blocker must lie before the receiver to be none of its own surface


class _Disc(NamedTuple):
    """Taps in a disc."""

    first: int  # rows of the table of points
    last: int
    cosine: float  # of the turn
    sine: float
    radius_u: float  # texels
    radius_v: float
    cone: bool  # count only blockers that stand between the point and the light's disc
    rise: bool  # see _tap


@kernel(inline=True)
def _tap(maps, face, row, column, r, s, rise):
    """1 or 0 for lit or not, and the depth of the blocker (+inf if there is none).

    With ``rise``, what rises from the receiver's own surface, as at the foot of a wall, blocks nothing: it is no edge
    to be softened.
    """
    height, width = maps.shape[1], maps.shape[2]
    if row < 0 or column < 0 or row >= height or column >= width:
        if not s.cube:
            return s.outside, np.inf
        row = min(max(row, 0), height - 1)
        column = min(max(column, 0), width - 1)
    depth = np.float64(maps[face, row, column])
    if depth == np.inf:
        return 1.0, np.inf
    # Depth times this against the distance of the plane: a division for each tap would be a third of all the time.
    z, scale, bias = r.z, 1.0, r.bias
    if r.plane and r.flat:
        own = s.b0 * r.texel + r.rounding
        if s.orthographic:
            z, bias = plane_depth(r, True, column + 0.5, row + 0.5), own
        else:
            inverse = r.d0 + r.du * (column + 0.5) + r.dv * (row + 0.5)
            if inverse >= SMALLEST_COSINE:
                z, scale, bias = r.distance, inverse, own
    if rise:
        x, y = column + 0.5 - r.u, row + 0.5 - r.v
        bias += (_RISE * r.texel + abs(r.gu) + abs(r.gv)) * math.sqrt(x * x + y * y)
    if z <= (depth + bias) * scale:
        return 1.0, np.inf
    return 0.0, depth


@kernel(inline=True)
def _window(maps, face, r, s):
    """(2n+1)^2 bilinear taps as one window of (2n+2)^2 compared texels with summed weights."""
    n = s.n
    left, top = math.floor(r.u - 0.5), math.floor(r.v - 0.5)
    a, b = r.u - 0.5 - left, r.v - 0.5 - top
    total = 0.0
    for j in range(-n, n + 2):
        weight_v = (1.0 - b) if j == -n else (b if j == n + 1 else 1.0)
        row = 0.0
        for i in range(-n, n + 2):
            weight_u = (1.0 - a) if i == -n else (a if i == n + 1 else 1.0)
            if weight_u > 0.0:
                row += weight_u * _tap(maps, face, top + j, left + i, r, s, s.settles)[0]
        total += weight_v * row
    return min(total / ((2.0 * n + 1.0) * (2.0 * n + 1.0)), 1.0)


@kernel()
def _average_depth(maps, face, r):
    """Wrong on purpose: compares with the bilinear mean of four depths, a depth that belongs to no surface."""
    left, top = math.floor(r.u - 0.5), math.floor(r.v - 0.5)
    a, b = r.u - 0.5 - left, r.v - 0.5 - top
    mean = 0.0
    for j in range(2):
        for i in range(2):
            weight = (a if i else 1.0 - a) * (b if j else 1.0 - b)
            row = min(max(top + j, 0), maps.shape[1] - 1)
            column = min(max(left + i, 0), maps.shape[2] - 1)
            if weight > 0.0:
                mean += weight * np.float64(maps[face, row, column])
    return 1.0 if r.z <= mean + r.bias else 0.0


@kernel(inline=True)
def _between(x, y, radius_u, radius_v, depth, r, s):
    """A blocker at a tap's place lies in the cone from point to light's disc, or within a texel of the point."""
    a, b = x * radius_u, y * radius_v
    if a * a + b * b <= 1.0:
        return True
    gap = 0.5 * s.light_size * (r.z - depth)
    if not s.orthographic:
        gap = gap / (r.z * depth) if depth > 0.0 else np.inf
    a, b = a / r.focal_u, b / r.focal_v
    return math.sqrt(a * a + b * b) <= _WITHIN * gap


@kernel()
def _disc(maps, face, r, s, taps, disc):
    """Share of lit taps in a disc, and number and mean depth of the blockers."""
    first, last, cosine, sine, radius_u, radius_v, cone, rise = disc
    lit, blockers, depth_sum = 0.0, 0, 0.0
    for i in range(first, last):
        x = cosine * taps[i, 0] - sine * taps[i, 1]
        y = sine * taps[i, 0] + cosine * taps[i, 1]
        row, column = math.floor(r.v + radius_v * y), math.floor(r.u + radius_u * x)
        share, depth = _tap(maps, face, row, column, r, s, rise)
        if cone and depth < np.inf and not _between(x, y, radius_u, radius_v, depth, r, s):
            share, depth = 1.0, np.inf
        lit += share
        if depth < np.inf:
            blockers += 1
            depth_sum += depth
    return lit / max(last - first, 1), blockers, depth_sum / max(blockers, 1)


@kernel()
def _pcss(maps, face, r, s, taps, turn):
    """Blocker search, penumbra width at the receiver, then a disc of that width; and whether texels are as wide."""
    width = s.light_size
    if s.orthographic:
        search = 0.5 * width * max(r.z - s.search_near, 0.0)
    else:
        search = 0.5 * width * max(r.z - s.search_near, 0.0) / (s.search_near * r.z)
    longer = max(r.focal_u, r.focal_v)
    search = min(max(search, 1.0 / longer), s.rho_max / longer)
    cosine, sine = math.cos(turn), math.sin(turn)
    here = with_reach(r, s, search * r.focal_u, search * r.focal_v)
    disc = _Disc(0, s.search_taps, cosine, sine, search * r.focal_u, search * r.focal_v, True, False)
    _, blockers, mean = _disc(maps, face, here, s, taps, disc)
    if blockers == 0 or (not s.orthographic and not mean > 0.0):
        return 1.0, True
    gap = max(r.z - mean, 0.0)
    radius = 0.5 * width * gap if s.orthographic else 0.5 * width * gap / (mean * r.z)
    radius = min(max(radius, 1.0 / longer), s.rho_max / longer)
    sharp = radius * longer <= SHARP
    here = with_reach(r, s, radius * r.focal_u, radius * r.focal_v)
    rise = s.settles and sharp
    radius_u, radius_v = radius * r.focal_u, radius * r.focal_v
    disc = _Disc(s.search_taps, taps.shape[0], cosine, sine, radius_u, radius_v, True, rise)
    return _disc(maps, face, here, s, taps, disc)[0], sharp


@kernel()
def _angle(index):
    """An angle in [0, 2 pi) from the pixel's index: the finaliser of MurmurHash3."""
    h = np.uint32(index)
    h = np.uint32((h ^ (h >> np.uint32(16))) * np.uint32(0x85EBCA6B))
    h = np.uint32((h ^ (h >> np.uint32(13))) * np.uint32(0xC2B2AE35))
    h ^= h >> np.uint32(16)
    return 2.0 * math.pi * (h / 4294967296.0)


@kernel(inline=True)
def _side(maps, face, r, s):
    """LIT or DARK where the 3 x 3 texels around a point all say so, dark by a clear margin; else UNSURE.

    They are compared with the receiver's plane. Unsure are edges, contacts and surfaces that are rough beside a texel.
    """
    if not r.flat:
        return UNSURE
    height, width = maps.shape[1], maps.shape[2]
    left, top = math.floor(r.u), math.floor(r.v)
    lit = dark = 0
    for row in range(top - 1, top + 2):
        for column in range(left - 1, left + 2):
            if row < 0 or column < 0 or row >= height or column >= width:
                continue
            depth = np.float64(maps[face, row, column])
            plane = plane_depth(r, s.orthographic, column + 0.5, row + 0.5)
            if math.isnan(plane):
                return UNSURE
            if plane <= depth + s.b0 * r.texel + r.rounding:
                lit += 1
            elif plane > depth + _CLEAR * r.texel:
                dark += 1
            else:
                return UNSURE
    if lit > 0 and dark > 0:
        return UNSURE
    return LIT if lit > 0 else DARK


@kernel()
def _filtered(maps, face, r, s, taps, index):
    """Visibility, and whether it is an edge that is softened, not a penumbra."""
    if s.filter == WINDOW:
        return _window(maps, face, with_reach(r, s, s.n + 0.5, s.n + 0.5), s), True
    if s.filter == DISC:
        here = with_reach(r, s, s.radius, s.radius)
        turn = _angle(index)
        disc = _Disc(s.search_taps, taps.shape[0], math.cos(turn), math.sin(turn), s.radius, s.radius, False, s.settles)
        return _disc(maps, face, here, s, taps, disc)[0], True
    if s.filter == PCSS:
        return _pcss(maps, face, r, s, taps, _angle(index))
    here = with_reach(r, s, 0.0, 0.0)
    if s.filter == AVERAGE_DEPTH:
        return _average_depth(maps, face, here), False
    return _tap(maps, face, math.floor(r.v), math.floor(r.u), here, s, s.settles)[0], True


@kernel()
def _factor(points, normals, index, light, views, maps, taps, s):
    """Visibility of one point, and the view in which it is in doubt or -1.

    A zero normal or a point that is not finite stands for no surface.
    """
    x, y, z = np.float64(points[index, 0]), np.float64(points[index, 1]), np.float64(points[index, 2])
    nx, ny, nz = np.float64(normals[index, 0]), np.float64(normals[index, 1]), np.float64(normals[index, 2])
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    size = abs(x) + abs(y) + abs(z)
    if not (length > 0.0 and size < np.inf):
        return 1.0, -1
    nx, ny, nz = nx / length, ny / length, nz / length
    lx, ly, lz = light[0] - light[3] * x, light[1] - light[3] * y, light[2] - light[3] * z
    away = math.sqrt(lx * lx + ly * ly + lz * lz)
    facing = nx * lx + ny * ly + nz * lz
    if not facing > 0.0:
        reach = abs(nx * s.ux + ny * s.uy + nz * s.uz) + abs(nx * s.vx + ny * s.vy + nz * s.vz)
        # A part of a rectangle may stand above the surface although its centre does not: nothing is known of it.
        return (1.0 if facing + 0.5 * reach > 0.0 else 0.0), -1
    cosine = min(facing / away, 1.0)
    height, width = maps.shape[1], maps.shape[2]
    chosen = choose_view(views, s, x, y, z, height, width)
    u, v, depth = image_point(views, chosen, s.orthographic, x, y, z)
    if s.k_n > 0.0 and depth > views[chosen, NEAR]:
        step = s.k_n * math.sqrt(1.0 - cosine * cosine) / min(views[chosen, FX], views[chosen, FY])
        if not s.orthographic:
            step *= depth
        u, v, depth = image_point(views, chosen, s.orthographic, x + step * nx, y + step * ny, z + step * nz)
    if outside_view(views, chosen, u, v, depth, 0.0, height, width):
        # Between the light and its near plane nothing was drawn, but triangles may stand there.
        close = s.settles and not s.orthographic and 0.0 < depth <= views[chosen, NEAR]
        return s.outside, chosen if close and u >= 0.0 and v >= 0.0 and u < width and v < height else -1
    size *= 0.0 if s.exact else 1.0
    r = receiver(views, chosen, s.orthographic, (u, v, depth), (nx, ny, nz), cosine, size)
    found, edge = _filtered(maps, chosen, r, s, taps, index)
    if not (s.settles and edge):
        return found, -1
    side = _side(maps, chosen, r, s)
    if side == UNSURE:
        return found, chosen
    # A filter wider than a shadow, or than a gap between two, says softness and no side.
    other = 1.0 - found
    return max(found, other) if side == LIT else min(found, other), -1


@kernel(parallel=True)
def shadow_lookup(points, normals, light, views, maps, taps, settings, answers):
    """Visibility of one light at N points.

    Args:
        points: (N,3) float32 or float64 world positions.
        normals: (N,3) float32 geometric normals that face the viewer; zero: no surface, result 1.
        light: (4,) float64: position and 1, or the direction towards a parallel light and 0.
        views: (V,18) float64: 3x4 world-to-view matrix, fx, fy, cx, cy, near, far.
        maps: (V,H,W) float32 depths, +inf where empty.
        taps: (search_taps + M, 2) float64 points in the unit disc.
        settings: :class:`LookupSettings`.
        answers: visibility (N,) float32, written; and (N,) int32, written where ``settings.settles``: the view in which
            the map cannot tell, or -1.
    """
    out, doubt = answers
    count = points.shape[0]
    # The schedule is static: strided blocks give every thread its share of the costly pixels, of small pictures, too.
    block = np.int64(min(max(count // (4 * _PARTS), 1), _BLOCK))
    for part in numba.prange(_PARTS):
        for start in range(np.int64(part) * block, count, _PARTS * block):
            for i in range(start, min(start + block, count)):
                out[i], view = _factor(points, normals, i, light, views, maps, taps, settings)
                if settings.settles:
                    doubt[i] = view
