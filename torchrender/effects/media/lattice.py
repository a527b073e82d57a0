"""Lattices of rays in a picture: what is dear to integrate is found along these, and pixels lie between them."""

from __future__ import annotations

import numpy as np

from torchrender.arrays import view
from torchrender.effects.media.eye_rays import EyeRays
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import LightTable, MediaTable
from torchrender.kernels.media.lattice import UNKNOWN, fill_lattice, fill_ways, ways_between
from torchrender.kernels.media.records import FLAT, GRID, HEIGHT, LAMP, NO_LATTICE, SQUARE, SUN, Beams, Lattice, Media
from torchrender.kernels.media.ways import ways_through

FINEST = 2
"""Pixels between nodes, below which a lattice gains nothing."""
CELLS = 2.0
"""Cells of a grid between nodes, where the longest ray ends."""
LAYERS = 0.25
"""Heights in which density falls to a part of 1/e, between nodes, there."""
FORWARD = 0.25
"""Widths of the phase function's peak between nodes."""
INTERVALS = 24
"""Of a node's ray, for light."""


def spacing(table: MediaTable, rays: EyeRays, options: ScatterOptions) -> int:
    """Pixels between nodes; 0: no lattice, because none is asked for, or media change within less."""
    if options.block == 1 or options.lattice == 0 or rays.sight is None:
        return 0
    media, far = table.arrays, max(rays.sight.longest * rays.sight.pixel, 1e-30)  # a pixel's width there
    step = float(options.lattice)
    for m in range(len(table)):
        _, falloff, _, g = (float(v) for v in media.numbers[m])
        step = min(step, FORWARD * (1.0 - abs(g)) / rays.sight.pixel)
        if media.kind[m] == GRID:
            side = (media.high[m] - media.low[m]) / media.dims[m, 2::-1]
            step = min(step, CELLS * float(side.min()) / far)
        elif media.kind[m] == HEIGHT:
            if falloff * min(rays.sight.longest, float(media.high[m, 1] - media.low[m, 1])) > INTERVALS:
                return 0  # steps of a node's ray are too long for it
            step = min(step, LAYERS / (falloff * far))
    return int(step) if step >= FINEST else 0


def _nodes(rays: EyeRays, step: int) -> tuple[np.ndarray, np.ndarray, tuple[int, int]]:
    """Matrix from pixels to directions, from directions to the lattice, and rows and columns of the lattice."""
    assert rays.sight is not None
    matrix = view(rays.sight.matrix, np.float64)
    inverse = np.diag([1.0 / step, 1.0 / step, 1.0]) @ np.linalg.inv(matrix)
    height, width = rays.shape
    shape = (max(-(-height // step) + 1, 2), max(-(-width // step) + 1, 2))
    return matrix.astype(np.float32), inverse.astype(np.float32), shape


def lattice_of(media: Media, light: LightTable, table: MediaTable, rays: EyeRays, options: ScatterOptions) -> Lattice:
    """Light of a sun or lamp in the only medium; :data:`NO_LATTICE` where there is a closed form, or no lattice."""
    step = spacing(table, rays, options)
    closed = media.kind[0] == FLAT and light.kind == SUN
    if not step or len(table) != 1 or light.kind not in (SUN, LAMP) or closed or not light.numbers[SQUARE] > 0:
        return NO_LATTICE
    matrix, inverse, shape = _nodes(rays, step)
    widths = np.empty((*shape, 2), np.float32)
    cells = np.empty((*shape, INTERVALS, media.extinction.shape[1], 4), np.float32)
    fill_lattice(media, (light.kind, light.numbers), matrix, step, rays.beams.span, rays.shape, widths, cells)
    assert rays.sight is not None
    return Lattice(inverse, widths, cells, np.float32(step * rays.sight.pixel))


def ways_by_lattice(table: MediaTable, rays: EyeRays, steps: int, options: ScatterOptions, ways: np.ndarray) -> bool:
    """Fill ``ways`` (N,M) with integrals of the densities along rays; False: no lattice."""
    step = spacing(table, rays, options)
    if not step:
        return False
    matrix, inverse, shape = _nodes(rays, step)
    beams, media = rays.beams, table.arrays
    missing = np.zeros(len(ways), bool)
    if not (media.kind == GRID).all():
        ways_through(media._replace(kind=np.where(media.kind == GRID, FLAT, media.kind)), beams, steps, ways)
    for m in np.flatnonzero(media.kind == GRID):
        widths, nodes = np.empty(shape, np.float32), np.empty((*shape, steps + 1, 2), np.float32)
        fill_ways(media, int(m), matrix, step, beams.span, rays.shape, widths, nodes)
        found = np.empty(len(ways), np.float32)
        ways_between(media, int(m), inverse, widths, nodes, beams, found)
        missing |= found == UNKNOWN
        ways[:, m] = found
    rows = np.flatnonzero(missing)
    if len(rows):
        some = np.zeros((len(rows), ways.shape[1]), np.float32)
        ways_through(media, Beams(beams.origin, beams.direction[rows], beams.span[rows]), steps, some)
        ways[rows] = some
    return True
