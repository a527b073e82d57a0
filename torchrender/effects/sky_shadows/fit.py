"""Sets of spheres that cover a closed mesh and stand out of it as little as they can.

Source: specification 08, section 4; Wang, Zhou, Snyder and others, *Variational sphere set approximation for solid
objects*, 2006.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_finite, check_tensor, options_of
from torchrender.effects.sky_shadows.clusters import Array, Model, State, model_of, sphere_of
from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.effects.sky_shadows.sharing import Sharing, joined
from torchrender.errors import InputError
from torchrender.kernels.sky_shadows.fit import flood, outside_volume, volumes_within

Progress = Callable[[int, int], None]
"""Told after every step: steps done, and all there may be."""

ROUNDS = 30
SETTLED = 1e-3
MOST_FAILURES = 5
AFTER_TELEPORT = 6
LEAST_GAIN = 1e-4
ADDED = 3
"""Times that points outside of all spheres join those that are clustered."""


@dataclass(frozen=True, eq=False)
class SphereSet:
    """Spheres that cover a mesh in the pose that they were fitted to."""

    centres: Tensor  # (S,3) float64
    radii: Tensor  # (S,) float64
    vertex_sphere: Tensor  # (V,) int64 the sphere of each vertex
    face_sphere: Tensor  # (F,) int64 the sphere of each triangle's centre
    inner_radii: Tensor  # (S,) float64 how far points inside the mesh reach
    error: float  # E: sum of the volumes that stand out
    volume: float  # of the mesh
    margin: float = 0.0  # by which radii may shrink until all spheres together hold the mesh's volume
    history: tuple[float, ...] = ()  # E after each step that was accepted

    @property
    def spheres(self) -> Tensor:
        """(S,4) float64 centre and radius."""
        return torch.cat([self.centres, self.radii[:, None]], dim=1)

    @property
    def relative_error(self) -> float:
        """E over the mesh's volume."""
        return self.error / max(self.volume, 1e-300)


def fit_spheres(
    vertices: Tensor, faces: Tensor, options: SphereOptions | None = None, progress: Progress | None = None
) -> SphereSet:
    """Fit spheres to a mesh.

    Every vertex and the centre of every triangle lie in the sphere they belong to. Meshes that are not closed count as
    far as voxelization finds an inside; one without any inside is covered all the same.

    Args:
        vertices: (V,3) scene units.
        faces: (F,3) integers.
        progress: told about every step.

    Raises:
        InputError: wrong shapes, no triangles, or vertices that are not finite.
    """
    options = options_of(options, SphereOptions)
    check_tensor("vertices", vertices, ("V", 3))
    check_tensor("faces", faces, ("F", 3))
    check_finite("vertices", vertices)
    if not len(faces):
        raise InputError("faces must hold at least one triangle")
    corners, triangles = view(vertices, np.float64), view(faces, np.int64)
    surface = np.concatenate([corners, corners[triangles].mean(axis=1)])
    used = np.unique(triangles)
    counted = np.concatenate([used, len(corners) + np.arange(len(triangles))])
    model, inner = model_of(vertices.double(), faces.long(), surface[counted], options)
    done, total = [0], options.starts * (options.teleports + 1)

    def step() -> None:
        done[0] += 1
        if progress is not None:
            progress(min(done[0], total), total)

    def run(start: int) -> tuple[Sharing, list[float]]:
        rng = np.random.default_rng([options.seed, start])
        return _run(model, options, _begin(model, options.spheres, rng, spread=start % 2 == 1), step)

    if options.starts == 1:
        found = [run(0)]
    else:
        with ThreadPoolExecutor(2) as pool:  # the compiled loops run on one thread each, outside Python's lock
            found = list(pool.map(run, range(options.starts)))
    best, history = min(found, key=lambda pair: float(pair[0].outside.sum()))
    for _ in range(ADDED):  # points that were left out of the rounds
        best = best.with_points(np.concatenate([surface[counted], inner]))
    return _covering(model, best.state, (surface, counted, len(corners)), inner, history)


def _begin(model: Model, spheres: int, rng: np.random.Generator, *, spread: bool) -> Array:
    """Points to begin with: at random; or ``spread``, each the farthest from those before: limbs have theirs."""
    points, count = model.points, min(spheres, len(model.points))
    if not spread:
        return points[rng.choice(len(points), count, replace=False)]
    chosen = [int(rng.integers(len(points)))]
    away = np.full(len(points), np.inf)
    while len(chosen) < count:
        away = np.minimum(away, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(away.argmax()))
    return points[chosen]


def _run(model: Model, options: SphereOptions, begin: Array, step: Callable[[], None]) -> tuple[Sharing, list[float]]:
    """One start, relaxed, and spheres moved to where they serve better."""
    state = _relaxed(model, begin, ROUNDS)
    history = [state.error]
    best = Sharing(model, state).settle()
    history.append(float(best.outside.sum()))
    step()
    failures = 0
    spare = best.dispensable()
    for _ in range(options.teleports):
        if failures >= min(MOST_FAILURES, len(spare)):
            break
        other = best.without(spare[failures])
        if other.outside.sum() >= best.outside.sum() * (1.0 - LEAST_GAIN):
            other = Sharing(model, _relaxed(model, other.centres, AFTER_TELEPORT)).settle()
        step()
        if other.outside.sum() < best.outside.sum() * (1.0 - LEAST_GAIN):
            best, failures, spare = other, 0, other.dispensable()
            history.append(float(best.outside.sum()))
        else:
            failures += 1
    return best, history


def _relaxed(model: Model, centres: Array, rounds: int) -> State:
    """Clusters and spheres, in turns, until what stands out falls no more."""
    best: State | None = None
    for _ in range(rounds):
        state = _round(model, centres)
        if best is not None and state.error > best.error * (1.0 - SETTLED):
            return state if state.error < best.error else best
        best, centres = state, state.centres
    assert best is not None
    return best


def _round(model: Model, centres: Array) -> State:
    centres = np.ascontiguousarray(centres)
    table = np.empty((len(centres), model.steps))
    volumes_within(model.solid, centres, model.width, table)
    radii, labels = np.zeros(len(centres)), np.empty(len(model.points), np.int64)
    flood(model.points, model.neighbours, centres, (table, model.width), radii, labels)
    order = np.argsort(labels, kind="stable")
    ends = np.searchsorted(labels[order], np.arange(len(centres) + 1))
    centres, outside = centres.copy(), np.zeros(len(centres))
    for k in range(len(centres)):
        mine = model.points[order[ends[k] : ends[k + 1]]]
        if len(mine):
            centres[k], radii[k], outside[k] = sphere_of(model, centres[k], mine)
        else:
            radii[k] = 0.0
    return State(centres, radii, labels, outside)


def _covering(
    model: Model, state: State, surface: tuple[Array, Array, int], inner: Array, history: list[float]
) -> SphereSet:
    """The set with radii for all points: those left out of the rounds join a sphere that holds them or grows least."""
    points, counted, vertices = surface
    labels, reach = joined(state, points)
    inner_labels, inner_reach = joined(state, inner)
    radii, inner_radii = state.radii.copy(), np.zeros(len(state.radii))
    np.maximum.at(radii, labels[counted], reach[counted])
    np.maximum.at(inner_radii, inner_labels, inner_reach)
    inner_radii = np.minimum(inner_radii, radii)
    outside = [outside_volume(model.solid, *state.centres[k], radii[k]) for k in range(len(radii))]
    outside = [value if radii[k] > 0 else 0.0 for k, value in enumerate(outside)]
    return SphereSet(
        centres=torch.from_numpy(state.centres.copy()),
        radii=torch.from_numpy(radii * (1.0 + 1e-12)),
        vertex_sphere=torch.from_numpy(labels[:vertices].copy()),
        face_sphere=torch.from_numpy(labels[vertices:].copy()),
        inner_radii=torch.from_numpy(inner_radii),
        error=float(np.sum(np.maximum(outside, 0.0))),
        volume=model.volume,
        margin=_margin(model, state.centres, radii),
        history=tuple(history),
    )


def _margin(model: Model, centres: Array, radii: Array) -> float:
    """How deep within the spheres the mesh's volume ends, on average; 0 where it has none."""
    cell, (nz, ny, nx) = model.solid.cell, model.solid.filled.shape
    used = radii > 0
    cells = round(model.volume / cell**3)
    if not cells or not used.any():
        return 0.0
    pad = int(radii.max() / cell) + 1
    x, y, z = (
        model.solid.origin[axis] + (np.arange(-pad, count + pad) + 0.5) * cell
        for axis, count in enumerate((nx, ny, nz))
    )
    depths = []
    for level in z:  # a layer of cells at a time
        deepest = np.full((len(y), len(x)), -np.inf)
        for (a, b, c), radius in zip(centres[used], radii[used]):
            if abs(level - c) < radius:
                away = np.sqrt((x[None] - a) ** 2 + (y[:, None] - b) ** 2 + (level - c) ** 2)
                np.maximum(deepest, radius - away, out=deepest)
        depths.append(deepest[deepest > 0])
    depth = np.concatenate(depths)
    if len(depth) <= cells:
        return 0.0
    return float(np.partition(depth, len(depth) - cells)[len(depth) - cells])
