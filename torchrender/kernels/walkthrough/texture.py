"""Textures of planes: every texel looked up in the photos that see it, with votes for holes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.walkthrough.density import agreeing, moved, pixel_of

UNSEEN, SEEN, HOLE, GUESSED = 0, 1, 2, 3


BORDER = 16
"""Pixels from the border of a photo within which its colours are no guess: undistorted photos are empty there."""


FAR_BEHIND = 3.0
"""Tolerances behind the plane from which on even a pixel at a depth edge tells that the plane is not there."""


class Patch(NamedTuple):
    """A rectangle on a plane."""

    origin: Any  # (3,) world position of the texture's first corner
    across: Any  # (3,) unit axis along columns
    down: Any  # (3,) unit axis along rows
    normal: Any  # (3,) unit, towards the cameras
    step: float  # size of a texel, scene units
    plane: int


class Votes(NamedTuple):
    """Limits of the look-up."""

    tau_z: float
    power: float  # of the density, as weight
    min_votes: int  # photos that must see through a texel to make it a hole
    feather: float  # pixels over which a photo fades in from its border
    near: float  # distance from the plane, scene units, beyond which a point of no plane is another surface
    average: bool  # every photo weighs the same, as without a comparison of densities


@kernel(inline=True)
def masked_color(photos, j, u, v, plane):
    """Bilinear colour among the pixels of the plane, and the weight found (0: none)."""
    height, width = photos.plane.shape[1], photos.plane.shape[2]
    x, y = math.floor(u - 0.5), math.floor(v - 0.5)
    a, b = u - 0.5 - x, v - 0.5 - y
    total, red, green, blue = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        px, py = int(x) + (k & 1), int(y) + (k >> 1)
        if px < 0 or py < 0 or px >= width or py >= height:
            continue
        if photos.plane[j, py, px] != plane:
            continue
        w = (a if k & 1 else 1.0 - a) * (b if k >> 1 else 1.0 - b)
        total += w
        red += w * photos.color[j, py, px, 0]
        green += w * photos.color[j, py, px, 1]
        blue += w * photos.color[j, py, px, 2]
    if total < 1e-6:
        return 0.0, 0.0, 0.0, 0.0
    return red / total, green / total, blue / total, total


BLOCK = 16
"""Texels along a side that are looked up in the same photos."""


@kernel()
def photos_of_block(patch, block, chosen, poses, photos):
    """Rows of ``chosen`` in whose picture some of a block (top, left, bottom, right) of texels may lie.

    A block is flat: it is outside if its corners lie before the camera and on the outer side of one border.
    """
    height, width = photos.plane.shape[1], photos.plane.shape[2]
    top, left, bottom, right = block
    found, count = np.empty(len(chosen), np.int64), 0
    for k in range(len(chosen)):
        j = chosen[k]
        before, low_u, high_u, low_v, high_v = 0, 0, 0, 0, 0
        for corner in range(4):
            s = (left if corner & 1 else right) * patch.step
            t = (top if corner & 2 else bottom) * patch.step
            q = moved(
                poses[k],
                patch.origin[0] + s * patch.across[0] + t * patch.down[0],
                patch.origin[1] + s * patch.across[1] + t * patch.down[1],
                patch.origin[2] + s * patch.across[2] + t * patch.down[2],
            )
            if q[2] > 1e-9:
                before += 1
                u = photos.lens[j, 0] * q[0] / q[2] + photos.lens[j, 2]
                v = photos.lens[j, 1] * q[1] / q[2] + photos.lens[j, 3]
                low_u, high_u = low_u + (u < 0.0), high_u + (u >= width)
                low_v, high_v = low_v + (v < 0.0), high_v + (v >= height)
        if before == 0 or (before == 4 and max(max(low_u, high_u), max(low_v, high_v)) == 4):
            continue
        found[count] = k
        count += 1
    return found[:count]


@kernel(parallel=True)
def resample(patch, chosen, poses, photos, votes, color, state):
    """Fill ``color`` (Ht,Wt,3) uint8 and ``state`` (Ht,Wt) uint8 from the photos ``chosen`` (J,), camera_from_world
    ``poses`` (J,3,4).

    A photo whose depth agrees has seen the texel; one that looks past it votes for a hole; one whose view is blocked
    says nothing (specification 13, sections 5 and 6). One that sees another surface there, closer than tells them apart
    by depth, takes the texel: filled in, it would hide that surface. Where they disagree, the denser photos are
    right: so
    planes end where they do, to the pixel of the best photo. Where nobody knows a depth (glass, black things), but
    photos have a colour, the texel is guessed: it gets the colour of the photo that looks at it most densely.
    """
    rows, columns = state.shape
    height, width = photos.plane.shape[1], photos.plane.shape[2]
    across = (columns + BLOCK - 1) // BLOCK
    blocks = across * ((rows + BLOCK - 1) // BLOCK)
    for block in prange(blocks):
        top, left = np.int64(block) // across * BLOCK, np.int64(block) % across * BLOCK
        bottom, right = min(top + BLOCK, rows), min(left + BLOCK, columns)
        own_photos = photos_of_block(patch, (top, left, bottom, right), chosen, poses, photos)
        for row in range(top, bottom):
            for column in range(left, right):
                s, t = (column + 0.5) * patch.step, (row + 0.5) * patch.step
                x = patch.origin[0] + s * patch.across[0] + t * patch.down[0]
                y = patch.origin[1] + s * patch.across[1] + t * patch.down[1]
                z = patch.origin[2] + s * patch.across[2] + t * patch.down[2]
                total, red, green, blue = 0.0, 0.0, 0.0, 0.0
                through, pro, against = 0, 0.0, 0.0
                densest = 0.0
                guess_j, guess_x, guess_y = -1, 0, 0
                for c in range(len(own_photos)):
                    k = own_photos[c]
                    j = chosen[k]
                    q = moved(poses[k], x, y, z)
                    px, py = pixel_of(photos.lens, j, q, height, width)
                    if px < 0:
                        continue
                    found = np.float64(photos.depth[j, py, px])
                    n, m = patch.normal, poses[k]
                    facing = 0.0
                    for axis in range(3):
                        facing -= (m[axis, 0] * n[0] + m[axis, 1] * n[1] + m[axis, 2] * n[2]) * q[axis]
                    sigma = photos.lens[j, 0] * photos.lens[j, 1] * facing / (q[2] * q[2] * q[2])
                    if found <= 0.0:
                        if sigma > densest and min(px, py, width - 1 - px, height - 1 - py) >= BORDER:
                            densest = sigma
                            guess_j, guess_x, guess_y = j, px, py
                        continue
                    gap, slack = found - q[2], agreeing(photos, j, q[2], votes.tau_z)
                    other = photos.plane[j, py, px]
                    # How far what the photo sees lies from the plane: at a grazing view less than depths differ.
                    off = abs(gap) * abs(facing) / q[2]
                    # A pixel of the plane sees this very place, whatever noise says of its depth.
                    own = other == patch.plane and found < np.inf
                    if gap > slack and not own and off > votes.near:
                        if photos.guard[j, py, px] == 0 or gap > FAR_BEHIND * slack:
                            through += 1
                            against += sigma * sigma
                        continue
                    if (gap < -slack and not own) or facing <= 0.0:
                        continue
                    u = photos.lens[j, 0] * q[0] / q[2] + photos.lens[j, 2]
                    v = photos.lens[j, 1] * q[1] / q[2] + photos.lens[j, 3]
                    if own:
                        r, g, b, share = masked_color(photos, j, u, v, patch.plane)
                    elif other < 0 and off <= votes.near:
                        # Seen, but as an edge: good enough where nothing better is.
                        r, g, b = (
                            float(photos.color[j, py, px, 0]),
                            float(photos.color[j, py, px, 1]),
                            float(photos.color[j, py, px, 2]),
                        )
                        share = 1e-4
                    else:
                        # Where planes meet, the other one is as good as this one.
                        if off > 2.0 * votes.near and abs(gap) > 1.5 * q[2] / photos.lens[j, 0]:
                            through += 1
                            against += sigma * sigma
                        continue
                    if share <= 0.0:
                        continue
                    weight = share
                    if not votes.average:
                        relative = math.log(max(sigma * patch.step * patch.step, 1e-12)) + photos.log_quality[j]
                        weight *= math.exp(min(votes.power * relative, 60.0))
                        edge = min(float(photos.feather[j, py, px]), votes.feather) / votes.feather
                        weight *= max(edge, 0.02) ** 2
                    total += weight
                    red, green, blue = red + weight * r, green + weight * g, blue + weight * b
                    pro += sigma * sigma
                if total > 0.0 and against <= pro:
                    color[row, column, 0] = int(red / total + 0.5)
                    color[row, column, 1] = int(green / total + 0.5)
                    color[row, column, 2] = int(blue / total + 0.5)
                    state[row, column] = SEEN
                elif guess_j >= 0 and through == 0:
                    for c in range(3):
                        color[row, column, c] = photos.color[guess_j, guess_y, guess_x, c]
                    state[row, column] = GUESSED
                else:
                    color[row, column, 0] = color[row, column, 1] = color[row, column, 2] = 0
                    state[row, column] = HOLE if through >= votes.min_votes or total > 0.0 else UNSEEN
