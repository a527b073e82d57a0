"""Sets of spheres that cover a closed mesh and stand out of it as little as they can.

Source: specification 08, section 4; Wang, Zhou, Snyder and others, *Variational sphere set approximation for solid
objects*, 2006.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_finite, check_tensor
from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.errors import InputError
from torchrender.kernels.sky_shadows.fit import Solid, flood, outside_volume, refit, volumes_within

Array = np.ndarray[Any, Any]
Progress = Callable[[int, int], None]
"""Told after every step: steps done, and all there may be."""

NEIGHBOURS = 12
MOST_POINTS = 24_000
"""Points that are clustered in each round; the others join the clusters that they fit best in the end."""

ROUNDS = 30
REFITS = 4
"""Rounds of line searches after each clustering: the next one goes on."""

SETTLED = 1e-3
MOST_FAILURES = 5
AFTER_TELEPORT = 6


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
    history: tuple[float, ...] = ()  # E after each step that was accepted

    @property
    def spheres(self) -> Tensor:
        """(S,4) float64 centre and radius."""
        return torch.cat([self.centres, self.radii[:, None]], dim=1)

    @property
    def relative_error(self) -> float:
        """E over the mesh's volume."""
        return self.error / max(self.volume, 1e-300)


@dataclass(frozen=True, eq=False)
class _Model:
    solid: Solid
    points: Array  # (N,3) that are clustered
    neighbours: Array  # (N,12) int64
    width: float  # of the steps of volume tables
    steps: int
    volume: float


@dataclass(frozen=True, eq=False)
class _State:
    centres: Array
    radii: Array
    labels: Array
    outside: Array  # (S,) volume of each sphere outside

    @property
    def error(self) -> float:
        return float(self.outside.sum())


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
    options = options or SphereOptions()
    check_tensor("vertices", vertices, ("V", 3))
    check_tensor("faces", faces, ("F", 3))
    check_finite("vertices", vertices)
    if not len(faces):
        raise InputError("faces must hold at least one triangle")
    corners, triangles = view(vertices, np.float64), view(faces, np.int64)
    surface = np.concatenate([corners, corners[triangles].mean(axis=1)])
    used = np.unique(triangles)
    counted = np.concatenate([used, len(corners) + np.arange(len(triangles))])
    model, inner = _model(vertices.double(), faces.long(), surface[counted], options)
    done, total = [0], options.starts * (options.teleports + 2)

    def step() -> None:
        done[0] += 1
        if progress is not None:
            progress(min(done[0], total), total)

    def run(start: int) -> tuple[_State, list[float]]:
        return _run(model, options, np.random.default_rng([options.seed, start]), step)

    if options.starts == 1:
        found = [run(0)]
    else:
        with ThreadPoolExecutor(2) as pool:  # the compiled loops run on one thread each, outside Python's lock
            found = list(pool.map(run, range(options.starts)))
    best, history = min(found, key=lambda pair: pair[0].error)
    return _covering(model, best, (surface, counted, len(corners)), inner, history)


def _model(vertices: Tensor, faces: Tensor, surface: Array, options: SphereOptions) -> tuple[_Model, Array]:
    from scipy.spatial import cKDTree

    from torchrender.voxels.grid import make_grid  # pictures need none of it
    from torchrender.voxels.solid import SolidOptions, voxelize_solid

    grid = make_grid(vertices[None], options.resolution)
    voxels, _ = voxelize_solid(vertices[None], faces, grid, SolidOptions(method="winding", warn=False))
    filled = voxels.dense()[0].to(torch.uint8).numpy()
    cell, origin = float(grid.cell[0]), grid.origin[0].numpy()
    solid = Solid(np.ascontiguousarray(filled), origin, cell)
    k, j, i = np.nonzero(filled)
    inner = origin + (np.stack([i, j, k], axis=1) + 0.5) * cell
    rng = np.random.default_rng(options.seed)
    points = np.concatenate([_thinned(inner, MOST_POINTS // 2, rng), _thinned(surface, MOST_POINTS // 2, rng)])
    count = min(NEIGHBOURS + 1, len(points))
    neighbours = cKDTree(points).query(points, count)[1].reshape(len(points), count)
    width = 0.25 * cell
    reach = float(np.linalg.norm(np.ptp(surface, axis=0))) + 2 * cell
    volume = len(inner) * cell**3
    model = _Model(
        solid, points, np.ascontiguousarray(neighbours.astype(np.int64)), width, int(reach / width) + 3, volume
    )
    return model, inner


def _thinned(points: Array, most: int, rng: np.random.Generator) -> Array:
    return points if len(points) <= most else points[np.sort(rng.choice(len(points), most, replace=False))]


def _run(
    model: _Model, options: SphereOptions, rng: np.random.Generator, step: Callable[[], None]
) -> tuple[_State, list[float]]:
    """One random start, relaxed, and spheres moved to where they serve better."""
    count = min(options.spheres, len(model.points))
    state = _relaxed(model, model.points[rng.choice(len(model.points), count, replace=False)], ROUNDS)
    history, failures = [state.error], 0
    step()
    for _ in range(options.teleports):
        if failures >= MOST_FAILURES or count < 2:
            break
        moved = _teleported(model, state)
        step()
        if moved is None:
            break
        other = _relaxed(model, moved, AFTER_TELEPORT)
        if other.error < state.error * (1.0 - 1e-9):
            state, failures = other, 0
            history.append(state.error)
        else:
            failures += 1
            if failures < MOST_FAILURES:
                state = _next_worst(state)
    final = _relaxed(model, state.centres, ROUNDS)
    step()
    if final.error < state.error:
        state = final
        history.append(state.error)
    return state, history


def _next_worst(state: _State) -> _State:
    """The same state, in which the sphere that stands out most passes its turn to the next one; the sum stays."""
    outside = state.outside.copy()
    worst = int(outside.argmax())
    amount, outside[worst] = outside[worst], 0.0
    outside[int(outside.argmax())] += amount
    return replace(state, outside=outside)


def _relaxed(model: _Model, centres: Array, rounds: int) -> _State:
    """Clusters and spheres, in turns, until what stands out falls no more."""
    best: _State | None = None
    for _ in range(rounds):
        state = _round(model, centres)
        if best is not None and state.error > best.error * (1.0 - SETTLED):
            return state if state.error < best.error else best
        best, centres = state, state.centres
    assert best is not None
    return best


def _round(model: _Model, centres: Array) -> _State:
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
            centres[k], radii[k], outside[k] = _sphere_of(model, centres[k], mine)
        else:
            radii[k] = 0.0
    return _State(centres, radii, labels, outside)


def _sphere_of(model: _Model, centre: Array, points: Array) -> tuple[Array, float, float]:
    """The sphere about points that stands out least, from the best of three places."""
    outer = np.ascontiguousarray(_outermost(points))
    places = (centre, points.mean(axis=0), 0.5 * (points.min(axis=0) + points.max(axis=0)))

    def cost(place: Array) -> float:
        reach = float(np.sqrt(((outer - place) ** 2).sum(axis=1).max()))
        return float(outside_volume(model.solid, place[0], place[1], place[2], reach))

    place = np.array(min(places, key=cost), dtype=np.float64)
    least = float(refit(model.solid, outer, place, REFITS))
    return place, float(np.sqrt(((points - place) ** 2).sum(axis=1).max())), max(least, 0.0)


def _outermost(points: Array) -> Array:
    """Corners of the convex hull: one of them is farthest from any place."""
    from scipy.spatial import ConvexHull, QhullError

    if len(points) < 32:
        return points
    try:
        hull: Array = points[ConvexHull(points).vertices]
    except QhullError:  # flat
        return points
    return hull


def _teleported(model: _Model, state: _State) -> Array | None:
    """Centres with the sphere that stands out most split in two, in place of the one that is needed least."""
    worst = int(state.outside.argmax())
    mine = model.points[state.labels == worst]
    if len(mine) < 2:
        return None
    outer = _outermost(mine)
    apart = ((outer[:, None] - outer[None]) ** 2).sum(axis=-1)
    a, b = np.unravel_index(int(apart.argmax()), apart.shape)
    spare = _least_needed(state, worst)
    centres = state.centres.copy()
    centres[worst] = outer[a]
    centres[spare] = outer[b]
    return centres


def _least_needed(state: _State, but: int) -> int:
    """The sphere of whose volume the others hold the largest share; empty ones first."""
    empty = np.flatnonzero(state.radii <= 0.0)
    empty = empty[empty != but]
    if len(empty):
        return int(empty[0])
    distance = np.linalg.norm(state.centres[:, None] - state.centres[None], axis=-1)
    r, s = state.radii[:, None], state.radii[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        lens = np.pi * (r + s - distance) ** 2 * (distance**2 + 2 * distance * (r + s) - 3 * (r - s) ** 2)
        common = lens / (12 * distance)
    common = np.where(distance >= r + s, 0.0, common)
    within = 4 / 3 * np.pi * np.minimum(r, s) ** 3
    common = np.where(distance <= np.abs(r - s), within, common)
    np.fill_diagonal(common, 0.0)
    share = common.sum(axis=1) / (4 / 3 * np.pi * np.maximum(state.radii, 1e-300) ** 3)
    share[but] = -1.0
    return int(share.argmax())


def _covering(
    model: _Model, state: _State, surface: tuple[Array, Array, int], inner: Array, history: list[float]
) -> SphereSet:
    """The set with radii for all points: those left out of the rounds join the sphere that sticks out least for it."""
    from scipy.spatial import cKDTree

    points, counted, vertices = surface
    nearest = cKDTree(model.points).query(points)[1]
    labels = state.labels[nearest]
    inner_labels = state.labels[cKDTree(model.points).query(inner)[1]] if len(inner) else np.zeros(0, np.int64)
    radii = state.radii.copy()
    for k in range(len(radii)):
        mine = points[counted[labels[counted] == k]]
        if len(mine):
            radii[k] = max(radii[k], float(np.sqrt(((mine - state.centres[k]) ** 2).sum(axis=1).max())))
    inner_radii = np.zeros(len(radii))
    np.maximum.at(inner_radii, inner_labels, np.linalg.norm(inner - state.centres[inner_labels], axis=1))
    inner_radii = np.minimum(inner_radii, radii)
    outside = [outside_volume(model.solid, *state.centres[k], radii[k]) for k in range(len(radii))]
    return SphereSet(
        centres=torch.from_numpy(state.centres.copy()),
        radii=torch.from_numpy(radii * (1.0 + 1e-12)),
        vertex_sphere=torch.from_numpy(labels[:vertices].copy()),
        face_sphere=torch.from_numpy(labels[vertices:].copy()),
        inner_radii=torch.from_numpy(inner_radii),
        error=float(np.sum(np.maximum(outside, 0.0))),
        volume=model.volume,
        history=tuple(history),
    )
