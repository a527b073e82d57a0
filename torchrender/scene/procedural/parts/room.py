"""The shell of a closed room: slabs that overlap at the corners, a window with daylight behind it, a door."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchrender.scene.procedural.parts.assembly import Assembly
from torchrender.scene.procedural.parts.shapes import (
    Array,
    Part,
    Vector,
    box,
    extruded,
    frame,
    gridded_box,
    merge,
    yaw_matrix,
)

THICK = 0.2


@dataclass(frozen=True, kw_only=True)
class Shell:
    """Inner size of a room: x and z from minus to plus these half sizes, y from 0 to ``height``."""

    half_x: float
    half_z: float
    height: float
    cell: float  # metres between the vertices of walls, floor and ceiling

    def corners(self, part: Part, axis: int, strength: float = 0.34) -> Part:
        """Vertex colours that darken near the two other pairs of planes, as corners of real rooms are."""
        low, high = np.array([-self.half_x, 0.0, -self.half_z]), np.array([self.half_x, self.height, self.half_z])
        shade = np.ones(len(part.vertices))
        for k in range(3):
            if k != axis:
                near = np.minimum(part.vertices[:, k] - low[k], high[k] - part.vertices[:, k]).clip(0.0)
                shade *= 1.0 - strength * np.exp(-near / 0.28)
        return part.tinted(np.repeat(shade[:, None], 3, axis=1))

    def slab(self, low: Vector, high: Vector, axis: int) -> Part:
        """A slab with shaded corners; ``axis`` is the one it is thin along."""
        a, b = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        cells = np.maximum(np.ceil((b - a) / self.cell), 1).astype(int)
        cells[axis] = 1
        return self.corners(gridded_box(a, b, cells), axis)

    def build(self, made: Assembly, *, floor: str, ceiling: str, walls: tuple[str, str, str]) -> None:
        """Floor, ceiling and the walls at -z, +x and +z; the wall at -x is :meth:`window_wall`."""
        x, z, h, t = self.half_x, self.half_z, self.height, THICK
        made.add("floor", (floor, self.slab((-x - t, -t, -z - t), (x + t, 0.0, z + t), 1)))
        made.add("ceiling", (ceiling, self.slab((-x - t, h, -z - t), (x + t, h + t, z + t), 1)))
        e = 0.004  # keeps the outer sides of overlapping slabs in different planes
        made.add("back wall", (walls[0], self.slab((-x - t + e, -t + e, -z - t + e), (x + t - e, h + t - e, -z), 2)))
        made.add(
            "right wall",
            (walls[1], self.slab((x, -t + 2 * e, -z - t + 2 * e), (x + t - 2 * e, h + t - 2 * e, z + t - 2 * e), 0)),
        )
        made.add("front wall", (walls[2], self.slab((-x - t + e, -t + e, z), (x + t - e, h + t - e, z + t - e), 2)))

    def window_wall(
        self, made: Assembly, wall: str, *, low: tuple[float, float], high: tuple[float, float], bars: int
    ) -> None:
        """The wall at -x with a window from ``low`` to ``high`` (each z, y), its frame, and a bright view behind it."""
        z, h, t = self.half_z, self.height, THICK
        a, b = -high[0], -low[0]  # in the wall's own frame x runs along -z
        grid_x, grid_y = self._lines(-z - t, a, b, z + t), self._lines(-t, low[1], high[1], h + t)
        inside_x, inside_y = (
            (grid_x[:-1] > a - 1e-6) & (grid_x[1:] < b + 1e-6),
            (grid_y[:-1] > low[1] - 1e-6) & (grid_y[1:] < high[1] + 1e-6),
        )
        mask = ~(inside_y[:, None] & inside_x[None])
        turn, place = yaw_matrix(90.0), (-self.half_x - t, 0.0, 0.0)
        plate = extruded(grid_x[:], grid_y[:], mask.tolist(), t).transformed(turn, place)
        made.add("window wall", (wall, self.corners(plate, 0)))
        wide, tall = b - a, high[1] - low[1]
        centre = (-self.half_x - 0.13, (low[1] + high[1]) / 2, (low[0] + high[0]) / 2)
        made.add("window frame", ("window frame", _casement(wide + 0.02, tall + 0.02, bars).transformed(turn, centre)))
        sill = box(
            (-self.half_x - 0.06, low[1] - 0.035, low[0] - 0.06), (-self.half_x + 0.16, low[1] + 0.004, high[0] + 0.06)
        )
        made.add("window sill", ("window frame", sill))
        self._outside(made, centre, wide, tall)

    def _lines(self, start: float, low: float, high: float, end: float) -> Array:
        parts = [
            np.linspace(p, q, max(round((q - p) / self.cell), 1) + 1)
            for p, q in ((start, low), (low, high), (high, end))
        ]
        return np.concatenate([parts[0], parts[1][1:], parts[2][1:]])

    def _outside(self, made: Assembly, centre: tuple[float, float, float], wide: float, tall: float) -> None:
        """A closed box outside the window: sky and two ranges of hills that shine by themselves."""
        x, y, z = -self.half_x - THICK, centre[1], centre[2]
        turn = yaw_matrix(90.0)
        made.add(
            "window box", ("outside", frame(wide + 1.7, tall + 1.7, 0.2, 0.7).transformed(turn, (x - 0.698, y, z)))
        )
        w, h = wide / 2 + 0.8, tall / 2 + 0.8
        made.add("view sky", ("view sky", box((x - 0.74, y - h, z - w), (x - 0.64, y + h, z + w))))
        s = np.linspace(-w, w, 49)
        for name, level, front, waves in (("view hills", -0.12, 0.60, 2.1), ("view trees", -0.34, 0.54, 5.2)):
            top = y + tall * (level + 0.09 * np.sin(waves * s + 1.0) + 0.05 * np.sin(3.1 * waves * s))
            v = np.array(
                [
                    [[x - front - d, q, z + p] for p, q in zip(s, line)]
                    for d, line in ((0, np.full(49, y - h)), (0, top), (0.02, top))
                ]
            )
            made.add(name, (name, _strip(v)))


def _strip(v: Array) -> Part:
    """An open folded strip through rows of points (R,N,3): hills that are only seen from the front."""
    rows, n, _ = v.shape
    index = np.arange(rows * n).reshape(rows, n)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, c, b], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return Part(v.reshape(-1, 3), faces)


def _casement(width: float, height: float, bars: int) -> Part:
    """A window frame with ``bars`` upright bars and one cross bar, 6 cm deep."""
    w, h, f, m = width / 2, height / 2, 0.06, 0.018
    xs = [-w, -w + f]
    for k in range(1, bars + 1):
        c = -w + width * k / (bars + 1)
        xs += [c - m, c + m]
    xs += [w - f, w]
    ys = (-h, -h + f, 0.28 * h - m, 0.28 * h + m, h - f, h)
    mask = [[1 if (i % 2 == 0 or j % 2 == 0) else 0 for i in range(len(xs) - 1)] for j in range(5)]
    return extruded(xs, ys, mask, 0.06)


def skirting(shell: Shell, height: float, depth: float) -> Part:
    """Boards along all four walls, mitred by overlap, a little inside the walls."""
    x, z, d = shell.half_x, shell.half_z, depth
    boards = [
        box((-x - 0.05, -0.02, -z - 0.05), (x + 0.05, height, -z + d)),
        box((-x - 0.05, -0.02, z - d), (x + 0.05, height, z + 0.05)),
        box((-x - 0.051, -0.021, -z - 0.051), (-x + d, height - 0.001, z + 0.051)),
        box((x - d, -0.021, -z - 0.051), (x + 0.051, height - 0.001, z + 0.051)),
    ]
    return merge(boards)


def door(width: float, height: float) -> dict[str, Part]:
    """A panelled door with its casing, back at z = 0, foot at y = 0, facing +z."""
    w, p = width / 2, 0.12
    leaf = extruded(
        (-w, -w + p, -0.04, 0.04, w - p, w), (0.0, 0.2, 0.9, 1.02, height - 0.13, height),
        ((1, 1, 1, 1, 1), (1, 0, 1, 0, 1), (1, 1, 1, 1, 1), (1, 0, 1, 0, 1), (1, 1, 1, 1, 1)), 0.04,
    )  # fmt: skip
    panel = box((-w + 0.01, 0.01, 0.001), (w - 0.01, height - 0.01, 0.022))
    b = 0.09
    casing = extruded(
        (-w - b, -w + 0.005, w - 0.005, w + b), (0.0, height - 0.005, height + b), ((1, 0, 1), (1, 1, 1)), 0.055
    )
    return {"white wood": merge([leaf, panel]), "window frame": casing.moved((0, 0.001, 0.0005))}
