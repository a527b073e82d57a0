"""A point in a light's image: which view, where, and how its surface's depth runs there.

The slope bound ``(1/2 + reach) (|dz/du| + |dz/dv|)`` is rigorous for planes: their depth is a convex function of the
pixel wherever it is positive. Receiver plane: Isidoro, Shadow mapping: GPU-based tips and techniques, 2006.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel

CONSTANT, SLOPE, RECEIVER_PLANE = 0, 1, 2

FX, FY, CX, CY, NEAR, FAR = 12, 13, 14, 15, 16, 17
"""Places in the row of a light's view; its 3x4 matrix from the world comes first."""

SMALLEST_COSINE = 1e-4
_HALF_ULP = 2.0**-24
_FAR_EYE = 4096.0  # texels from the eye to what it sees


class LookupSettings(NamedTuple):
    """Numbers of one lookup. Biases are in texels: a texel's width where the receiver lies."""

    orthographic: bool
    cube: bool  # several views around one point: take the one that the point lies in front of most
    bias: int
    filter: int
    n: int  # WINDOW: radius in texels; 0 is plain bilinear
    radius: float  # DISC: radius in texels
    reach: float  # texels that a point must stay away from the border of a cascade
    b0: float  # texels
    k: float
    b_max: float  # texels
    k_n: float
    outside: float  # value outside the map
    light_size: float  # PCSS: width of the light; for parallel light twice the tangent of its half angle
    rho_max: float  # PCSS: largest radius in texels
    search_near: float  # PCSS: depth before which there is no blocker
    search_taps: int  # first rows of the disc table; the rest are filter taps
    ux: float  # edges of a rectangle, scene units; zero for lights without area
    uy: float
    uz: float
    vx: float
    vy: float
    vz: float
    settles: bool  # say where the map cannot tell
    exact: bool  # points are float64: what they are off does not grow with the distance from the origin


class Receiver(NamedTuple):
    """One point in one view of the light."""

    u: float
    v: float
    z: float
    gu: float  # dz/du of the plane through the point
    gv: float
    d0: float  # perspective planes: z(u, v) = distance / (d0 + du u + dv v)
    du: float
    dv: float
    distance: float
    focal_u: float
    focal_v: float
    texel: float  # width of a texel there
    rounding: float  # what float32 storage of depths and points may be off
    flat: bool  # the plane's depth may be used
    bias: float  # how much deeper than the stored depth still counts as lit
    plane: bool  # compare the plane's depth at each tap


@kernel(inline=True)
def outside_view(views, i, u, v, z, margin, height, width):
    """The point is nearer to the border than ``margin`` texels, or not between near and far."""
    inside = u >= margin and v >= margin and u < width - margin and v < height - margin
    return not (inside and z > views[i, NEAR] and z <= views[i, FAR])


@kernel(inline=True)
def image_point(views, i, orthographic, x, y, z):
    """u, v and depth of a world point; u and v mean nothing where the depth is not positive."""
    a = views[i, 0] * x + views[i, 1] * y + views[i, 2] * z + views[i, 3]
    b = views[i, 4] * x + views[i, 5] * y + views[i, 6] * z + views[i, 7]
    c = views[i, 8] * x + views[i, 9] * y + views[i, 10] * z + views[i, 11]
    if orthographic:
        return views[i, FX] * a + views[i, CX], views[i, FY] * b + views[i, CY], c
    if c <= 0.0:
        return -1.0, -1.0, c
    return views[i, FX] * (a / c) + views[i, CX], views[i, FY] * (b / c) + views[i, CY], c


@kernel(inline=True)
def choose_view(views, s, x, y, z, height, width):
    """Index of the view that looks up a world point: a cube's face, or the first of several that holds it."""
    count = views.shape[0]
    best = 0
    if count == 1:
        return best
    if s.cube:
        deepest = -np.inf
        for i in range(count):
            depth = views[i, 8] * x + views[i, 9] * y + views[i, 10] * z + views[i, 11]
            if depth > deepest:
                deepest, best = depth, i
        return best
    held = -1
    for i in range(count):
        depth = views[i, 8] * x + views[i, 9] * y + views[i, 10] * z + views[i, 11]
        if not views[i, NEAR] < depth <= views[i, FAR] or not (s.orthographic or depth > 0.0):
            continue  # before the divisions that a place in the image takes
        u, v, depth = image_point(views, i, s.orthographic, x, y, z)
        if not outside_view(views, i, u, v, depth, s.reach, height, width):
            return i
        if held < 0 and not outside_view(views, i, u, v, depth, 0.0, height, width):
            held = i
    return held if held >= 0 else count - 1


@kernel(inline=True)
def receiver(views, i, orthographic, place, normal, cosine, size):
    """The plane of the surface in the light's image at ``place`` (u, v, z).

    ``size``: lengths whose float32 rounding the point may be off; 0: of thousands of texels, for a point that an eye
    saw in float32 depth.
    """
    u, v, z = place
    fu, fv = views[i, FX], views[i, FY]
    nx = views[i, 0] * normal[0] + views[i, 1] * normal[1] + views[i, 2] * normal[2]
    ny = views[i, 4] * normal[0] + views[i, 5] * normal[1] + views[i, 6] * normal[2]
    nz = views[i, 8] * normal[0] + views[i, 9] * normal[1] + views[i, 10] * normal[2]
    texel = 1.0 / min(fu, fv)
    d0 = du = dv = 0.0
    if orthographic:
        distance = -nz
        steep = distance < SMALLEST_COSINE
        gu = np.inf if steep else nx / (distance * fu)
        gv = np.inf if steep else ny / (distance * fv)
    else:
        # The normal faces the light, so n.p is negative in the light's frame: turn signs to keep it positive.
        du, dv = -nx / fu, -ny / fv
        d0 = -nz - du * views[i, CX] - dv * views[i, CY]
        denominator = d0 + du * u + dv * v
        distance = z * denominator
        steep = cosine < SMALLEST_COSINE or denominator < SMALLEST_COSINE
        gu = np.inf if steep else -z * du / denominator
        gv = np.inf if steep else -z * dv / denominator
        texel *= z
    rounding = 2.0 * _HALF_ULP * abs(z)
    size = size if size > 0.0 else _FAR_EYE * texel
    if not steep:
        rounding += _HALF_ULP * size * (1.0 + (abs(gu) + abs(gv)) / texel)
    return Receiver(u, v, z, gu, gv, d0, du, dv, distance, fu, fv, texel, rounding, not steep, 0.0, False)


@kernel(inline=True)
def with_reach(r, s, reach_u, reach_v):
    """The receiver with its bias for taps up to ``reach`` texels away.

    A slope bias above its cap would either lift contact shadows or, capped, speckle the surface: there the plane's own
    depth takes over. The cap itself is left for what has no usable plane.
    """
    cap = s.b_max * r.texel
    bias = s.b0 * r.texel
    plane = s.bias == RECEIVER_PLANE
    if s.bias != CONSTANT:
        if r.flat:
            bias += s.k * ((0.5 + reach_u) * abs(r.gu) + (0.5 + reach_v) * abs(r.gv))
            plane = plane or bias > cap
        else:
            bias = cap
        bias = min(bias, cap)
    return Receiver(
        r.u, r.v, r.z, r.gu, r.gv, r.d0, r.du, r.dv, r.distance, r.focal_u, r.focal_v, r.texel,
        r.rounding, r.flat, bias + r.rounding, plane,
    )  # fmt: skip


@kernel(inline=True)
def plane_depth(r, orthographic, u, v):
    """Depth of the receiver's plane at (u, v); NaN where it must not be used."""
    if not r.flat:
        return np.nan
    if orthographic:
        return r.z + r.gu * (u - r.u) + r.gv * (v - r.v)
    denominator = r.d0 + r.du * u + r.dv * v
    return r.distance / denominator if denominator >= SMALLEST_COSINE else np.nan
