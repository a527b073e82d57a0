"""A tall hall with dust in the air: low sun falls through a row of barred windows, between columns, onto benches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from torchrender.scene.light import DirectionalLight
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, fitted, view
from torchrender.scene.procedural.parts.curves import lathe
from torchrender.scene.procedural.parts.shapes import Part, box, boxes, merge
from torchrender.scene.procedural.parts.textures import mottled, planks

USUAL, FEWEST = 40_000, 3_000
FULL = 46_000
HALF_X, HALF_Z, HIGH, THICK = 4.5, 9.0, 7.0, 0.3
WINDOWS = np.linspace(-6.6, 6.6, 5)  # z of their centres
WIDE, SILL, HEAD = 1.5, 1.6, 6.0
DUST = 0.075  # 1/m


def _wall_with_windows(cell: float) -> Part:
    """The sunny wall, around its openings; each has a grille of bars."""
    x0, x1 = -HALF_X - THICK, -HALF_X
    parts = [box((x0, -0.2, -HALF_Z - 0.2), (x1, SILL, HALF_Z + 0.2), cell=cell)]
    parts.append(box((x0, HEAD, -HALF_Z - 0.2), (x1, HIGH + 0.2, HALF_Z + 0.2), cell=cell))
    edges = [-HALF_Z - 0.2, *(v for z in WINDOWS for v in (z - WIDE / 2, z + WIDE / 2)), HALF_Z + 0.2]
    for low, high in zip(edges[::2], edges[1::2], strict=True):
        parts.append(box((x0, SILL, low), (x1, HEAD, high), cell=cell))
    return merge(parts)


def _grilles() -> Part:
    x = -HALF_X - THICK / 2
    centres, sizes = [], []
    for z in WINDOWS:
        for k in range(1, 4):
            centres.append((x, (SILL + HEAD) / 2, z - WIDE / 2 + WIDE * k / 4))
            sizes.append((0.05, HEAD - SILL, 0.05))
        for k in range(1, 7):
            centres.append((x, SILL + (HEAD - SILL) * k / 7, z))
            sizes.append((0.045, 0.045, WIDE))
    return boxes(np.array(centres), np.array(sizes))


def _column(detail: float) -> Part:
    profile = np.array(
        [(0.0, 0.0), (0.48, 0.0), (0.48, 0.0), (0.48, 0.2), (0.48, 0.2), (0.4, 0.28), (0.3, 0.4), (0.3, 0.4),
         (0.27, 4.9), (0.27, 4.9), (0.36, 5.2), (0.46, 5.35), (0.46, 5.35), (0.46, HIGH), (0.46, HIGH), (0.0, HIGH)]
    )  # fmt: skip
    return lathe(profile, max(round(24 * detail), 6))


def _bench(detail: float) -> Part:
    cell = max(0.5 / detail, 0.1)
    return merge([
        box((-1.1, 0.42, -0.2), (1.1, 0.48, 0.2), cell=cell),
        box((-1.1, 0.55, 0.2), (1.1, 1.0, 0.25), cell=cell),
        box((-1.08, 0.0, -0.18), (-1.0, 0.425, 0.24)),
        box((1.0, 0.0, -0.18), (1.08, 0.425, 0.24)),
    ])  # fmt: skip


def _furnished(detail: float, seed: int) -> Assembly:
    rng = np.random.default_rng((seed, 11))
    made = Assembly()
    made.material("stone", (1.0, 1.0, 1.0), texture=mottled(rng, (0.42, 0.39, 0.34), (0.56, 0.52, 0.45)))
    made.material("floor", (1.0, 1.0, 1.0), texture=mottled(rng, (0.2, 0.17, 0.14), (0.32, 0.28, 0.23), slope=1.0))
    made.material("wood", (0.85, 0.85, 0.85), texture=planks(rng, (0.12, 0.07, 0.035), (0.3, 0.18, 0.09)))
    made.material("iron", (0.05, 0.05, 0.055))
    made.material("paper", (0.3, 0.26, 0.2))
    cell = float(np.clip(0.45 / detail, 0.08, 2.0))
    x, z, t = HALF_X, HALF_Z, THICK
    made.add("floor", ("floor", box((-x - t, -0.2, -z - t), (x + t, 0.0, z + t), cell=cell).mapped(0.4)))
    made.add("ceiling", ("wood", box((-x - t, HIGH, -z - t), (x + t, HIGH + 0.2, z + t), cell=cell).mapped(0.3)))
    made.add("window wall", ("stone", _wall_with_windows(cell).mapped(0.35)))
    made.add("grilles", ("iron", _grilles()))
    shell = [
        box((x, -0.2, -z - t), (x + t, HIGH + 0.2, z + t), cell=cell),
        box((-x - t, -0.2, -z - t), (x + t, HIGH + 0.2, -z), cell=cell),
        box((-x - t, -0.2, z), (x + t, HIGH + 0.2, z + t), cell=cell),
    ]
    made.add("walls", ("stone", merge(shell).mapped(0.35)))
    column, bench = _column(detail), _bench(detail)
    for number, place in enumerate(np.linspace(-6.6, 6.6, 5) + 1.65):
        if place < HALF_Z - 1.0:
            made.add(f"column {number}", ("stone", column.moved((1.9, 0.0, float(place)))))
    for number, place in enumerate(np.linspace(-6.0, 3.6, 7)):
        made.add(f"bench {number}", ("wood", bench.moved((-1.0, 0.0, float(place)))))
    return made


def hall(triangles: int, seed: int) -> Scene:
    """Walls, columns and benches get finer with the count; books on the floor and the benches fill up what is left."""
    made, left = fitted(lambda detail: _furnished(detail, seed), triangles, usual=FULL)
    rng = np.random.default_rng((seed, 12))
    count = max(left // 12, 1)
    sizes = np.stack(
        [rng.uniform(0.05, 0.16, count), rng.uniform(0.01, 0.05, count), rng.uniform(0.08, 0.24, count)], 1
    )
    place = np.stack([rng.uniform(-4.2, 4.2, count), sizes[:, 1] / 2, rng.uniform(-8.6, 8.6, count)], 1)
    made.add("books", ("paper", boxes(place, sizes, rng.uniform(0, 360, count))))
    cameras = {
        "default": view((3.9, 1.6, -7.6), (-3.0, 2.9, 2.0), 64.0, 0.05, 60.0),
        "close": view((3.8, 1.6, -1.0), (-4.5, 3.4, -0.4), 66.0, 0.05, 60.0),
        "along": view((0.6, 1.7, 8.6), (0.3, 2.8, -8.0), 58.0, 0.05, 60.0),
    }
    sun = DirectionalLight(
        direction=torch.tensor([0.72, -0.6, -0.3]), irradiance=as_tensor((30.0, 25.0, 18.0)), name="sun"
    )
    scene = made.scene("hall", lights=[sun], cameras=cameras, ambient=(0.07, 0.075, 0.085))
    dust = Medium(
        low=torch.tensor([-HALF_X, 0.0, -HALF_Z]), high=torch.tensor([HALF_X, HIGH, HALF_Z]),
        scattering=torch.full((3,), DUST), absorption=torch.full((3,), 0.004), asymmetry=0.45, name="dust",
    )  # fmt: skip
    return replace(scene, media=(dust,))
