"""What the kernels of points hand to each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Nodes(NamedTuple):
    """T points or nodes side by side."""

    position: np.ndarray  # (T,3)
    normal: np.ndarray  # (T,3) unit, zero where unknown
    radius: np.ndarray  # (T,)
    color: np.ndarray  # (T,3) linear light; anything of that width where ``has_color`` is false
    has_color: bool


class Lens(NamedTuple):
    """A perspective camera."""

    turn: np.ndarray  # (3,3) camera from world
    k: np.ndarray  # (3,3) intrinsics
    near: float  # points lie between these planes
    far: float
    width: int
    height: int


class Filters(NamedTuple):
    """How points are filtered, and when with which filter."""

    r_h: float  # radius of the low-pass, pixels
    peak: float  # 1 / (2 pi kappa^2)
    eps_scale: float  # tolerance of depth
    unit: float  # of area: weights stay in float32's range
    one_sided: bool
    c_min: float
    c_max: float
    c_eta: float
    by_axes: bool  # the choice goes by the axes of the ellipse, else by its area


class Coloring(NamedTuple):
    """Colour of points: Lambert's law, or their normals."""

    x: float  # direction to the light; zero: from the eye
    y: float
    z: float
    ambient: float
    lit: bool
    plain: float  # grey of points without colours
    normals: bool  # the normal itself in place of a colour


class Slices(NamedTuple):
    """Runs of nodes, one of each patch that is drawn."""

    rows: np.ndarray  # (S,2) int64 rows of the nodes
    modes: np.ndarray  # (S,) int64 filter
    first: np.ndarray  # (S,) int64 where their records start
    origin: np.ndarray  # (S,3) the patch's centre in the camera's frame
    chunks: np.ndarray  # (N,2) int64 runs of slices


class Projected(NamedTuple):
    """What becomes of points."""

    records: np.ndarray  # (M,RECORD) float32
    boxes: np.ndarray  # (M,BOX) int16; a box with x0 > x1 is empty
    tiles: np.ndarray  # (N,T) int64 entries of each chunk and tile
    counts: np.ndarray  # (N,COUNTS) int64


class Splat(NamedTuple):
    """One point in the camera's frame."""

    x: float
    y: float
    z: float
    n: tuple[float, float, float]
    r: float


class Target(NamedTuple):
    """Where one point is written."""

    record: np.ndarray  # (RECORD,) see ``ewa``
    box: np.ndarray  # (BOX,)
    tally: np.ndarray  # (COUNTS,) what became of points
