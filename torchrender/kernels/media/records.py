"""What the kernels of scattering read: media, a light, and rays; places are relative to one origin, in float32."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

FLAT, HEIGHT, GRID = 0, 1, 2
"""Kinds of density."""

SUN, LAMP, SPOT, RECT, AMBIENT = 0, 1, 2, 3, 4
"""Kinds of light; AMBIENT is what comes from everywhere, and what media give off themselves."""

DENSITY, FALLOFF, GROUND, G = 0, 1, 2, 3
"""Places in a medium's numbers."""

PLACE, AXIS, OUTER, INNER, AREA, NEAREST, SQUARE, FADE = 0, 3, 6, 7, 8, 9, 10, 11
"""Places in a light's numbers: where it is, where it looks or travels (unit), one minus the cosines of the cone, area,
the distance below which it gets no brighter, whether it falls off with the squared distance (1 or 0), one over its
squared range."""
LIGHT_NUMBERS = 12

BIG: Any = np.float32(1e30)


class Media(NamedTuple):
    """M media, C colour channels that are integrated apart."""

    low: np.ndarray  # (M,3)
    high: np.ndarray  # (M,3)
    kind: np.ndarray  # (M,) int64
    numbers: np.ndarray  # (M,4)
    extinction: np.ndarray  # (M,C) 1/unit
    scattering: np.ndarray  # (M,C) 1/unit; of an ambient light what the medium gives off, radiance/unit
    cells: np.ndarray  # densities of all grids, x fastest
    dims: np.ndarray  # (M,4) int64 cells along z, y, x, and the first of them
    means: np.ndarray  # mean densities of all grids towards the light that is looked at, see light_grid
    coarse: np.ndarray  # (M,4) int64 the same numbers of these


class Beams(NamedTuple):
    """N rays."""

    origin: np.ndarray  # (1,3) or (N,3)
    direction: np.ndarray  # (N,3) unit
    span: np.ndarray  # (N,2) ray lengths between which there may be a medium; empty where the second is not greater


class Images(NamedTuple):
    """The V depth images of a light, with pyramids of least and greatest values; a point is lit where its own value
    is at most that of its texel. Values are depths where rays of light are parallel, else -1/depth: either is linear
    along the image of a ray.
    """

    views: np.ndarray  # (V,16): 3x4 matrix from places to the view, fx, fy, cx, cy
    parallel: bool
    pyramid: np.ndarray  # (V,K,2)
    levels: np.ndarray  # (L,3) int64 first entry, rows, columns


class Slices(NamedTuple):
    """Planes through the eye along the light, each a row of thresholds: a ray is lit where its slope is not above."""

    rows: np.ndarray  # (S,K) thresholds
    tree: np.ndarray  # (S,2 K/RUN,2) least and greatest of runs, and of 2, 4, ... of these
    edges: np.ndarray  # (S,K,2) int8 of parallel light: where entries begin, on both borders of the slice, see slices
    starts: np.ndarray  # (S,) of parallel light: where the first entry begins, in texels from the eye
    numbers: np.ndarray  # (18,) see slices


class Lattice(NamedTuple):
    """A light along some rays of a picture as if nothing stood in its way, see lattice."""

    inverse: np.ndarray  # (3,3) from directions to columns and rows of the lattice
    widths: np.ndarray  # (R,Q,2)
    cells: np.ndarray  # (R,Q,K,C,4)
    angle: np.float32  # between the rays of neighbouring nodes, radians; 0: there is no lattice


NO_LATTICE = Lattice(
    np.zeros((3, 3), np.float32), np.zeros((2, 2, 2), np.float32), np.zeros((2, 2, 1, 1, 4), np.float32),
    np.float32(0.0),
)  # fmt: skip


class Source(NamedTuple):
    """A light, and the lattice on which it is known, if there is one."""

    numbers: np.ndarray  # (12,)
    table: np.ndarray  # (C,R,K) of airlight; (1,1,1) for none
    inverse: np.ndarray = NO_LATTICE.inverse
    widths: np.ndarray = NO_LATTICE.widths
    cells: np.ndarray = NO_LATTICE.cells
    angle: np.float32 = NO_LATTICE.angle


class Scattered(NamedTuple):
    """What becomes of N rays."""

    radiance: np.ndarray  # (N,C)
    told: np.ndarray  # (N,3) see integrate
