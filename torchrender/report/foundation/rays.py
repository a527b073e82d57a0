"""The ray caster beside Embree's own float32 triangles through the same C interface, and its wrong rays."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.arrays import view
from torchrender.kernels.raster.records import NO_HOLES
from torchrender.kernels.rays.bvh import trace
from torchrender.kernels.rays.bvh_build import build_bvh
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.embree_scene import QUICK, EmbreeScene
from torchrender.kernels.rays.plain_embree import PlainEmbree
from torchrender.kernels.rays.watertight import Rays
from torchrender.quality.timing import take_turns
from torchrender.rays import RayCaster
from torchrender.report.common.progress import part
from torchrender.report.foundation.ray_sets import RaySet, ray_sets
from torchrender.scene.procedural import build

SUBJECTS = (("nest", None), ("living_room", None), ("city", 1_000_000), ("city", 3_000_000))
ANGLES = (0.5, 0.05, 0.005)
"""Largest angles in radians between grazing rays and the triangles that they are aimed at."""
INSETS = (1e-3, 1e-9, 0.0)
"""How far inside an edge grazing rays are aimed, as a share of the triangle's height; 0: at the edge."""


def measure_rays(quick: bool) -> list[dict[str, Any]]:
    """One record a scene; none where Embree is missing."""
    if embree() is None:
        return []
    if quick:
        return [compare_rays("nest", None, 128, 2, 500)]
    rows = []
    for name, triangles in SUBJECTS:
        with part(f"rays, {name} {triangles or ''}"):
            rows.append(compare_rays(name, triangles, 512, 3, 180_000))
    return rows


def compare_rays(name: str, triangles: int | None, side: int, runs: int, grazing: int) -> dict[str, Any]:
    """Build times, rays per second and wrong rays of one scene: the caster, plain Embree, the tree without Embree."""
    scene = build(name) if triangles is None else build(name, triangles=triangles)
    vertices, faces = view(scene.geometry.vertices, np.float64), view(scene.geometry.faces, np.int32)
    builders = {
        "caster": lambda: EmbreeScene(vertices, faces),
        "moved": lambda: EmbreeScene(vertices, faces, QUICK),
        "plain": lambda: PlainEmbree(vertices, faces),
    }
    # Freed in turn: two trees over millions of triangles at once would be timed while memory is scarce.
    built = take_turns(builders, runs=2 if len(faces) > 2_000_000 else 4, warm_up=1)
    built |= take_turns({"tree": lambda: build_bvh(vertices, faces)}, runs=1, warm_up=0)
    boxes, plain, tree = EmbreeScene(vertices, faces), PlainEmbree(vertices, faces), build_bvh(vertices, faces)
    record: dict[str, Any] = {
        "scene": name,
        "triangles": len(faces),
        "build_ms": {k: v.record() for k, v in built.items()},
        "kinds": {},
    }
    for kind, rays in ray_sets(scene, RayCaster(scene.geometry), side).items():
        record["kinds"][kind] = _compare_kind(_records(rays), boxes, plain, tree, runs)
    record["grazing"] = _grazing(vertices, faces, boxes, plain, tree, grazing)
    return record


def _compare_kind(rays: Rays, boxes: EmbreeScene, plain: PlainEmbree, tree: Any, runs: int) -> dict[str, Any]:
    none = np.zeros((0, 3), np.int32)
    candidates = {
        "caster": lambda: boxes.cast(rays),
        "plain": lambda: plain.cast(rays),
        "tree": lambda: trace(tree, rays, none, NO_HOLES),
    }
    times = take_turns(candidates, runs=runs, warm_up=1)
    count = len(rays.origins)
    return {
        "rays": count,
        "mrays_per_s": {k: round(count / v.median / 1e3, 2) for k, v in times.items()},
        "wrong": _wrong(rays, boxes, plain, tree),
    }


def _wrong(rays: Rays, boxes: EmbreeScene, plain: PlainEmbree, tree: Any) -> dict[str, int]:
    """Rays whose triangle, or whether there is one, differs from the float64 tree's."""
    found = {"caster": boxes.cast(rays)[1], "plain": plain.cast(rays)[1]}
    truth = trace(tree, rays, np.zeros((0, 3), np.int32), NO_HOLES)[1]
    if rays.any_hit:
        return {k: int(((v >= 0) != (truth >= 0)).sum()) for k, v in found.items()}
    return {k: int((v != truth).sum()) for k, v in found.items()}


def _grazing(
    vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any], boxes: EmbreeScene, plain: Any, tree: Any, count: int
) -> dict[str, Any]:
    total, wrong = 0, {"caster": 0, "plain": 0}
    for seed, (angle, inset) in enumerate((a, i) for a in ANGLES for i in INSETS):
        rays = grazing_rays(vertices, faces, count, angle, inset, seed)
        total += len(rays.origins)
        for name, number in _wrong(rays, boxes, plain, tree).items():
            wrong[name] += number
    return {"rays": total, "wrong": wrong}


def grazing_rays(
    vertices: np.ndarray[Any, Any], faces: np.ndarray[Any, Any], count: int, angle: float, inset: float, seed: int
) -> Rays:
    """Rays at points near edges, up to ``angle`` radians off the planes of their triangles.

    They start 0.01, 0.3 or 3 diagonals before their points.
    """
    rng = np.random.default_rng(seed)
    a, b, c = (vertices[faces[rng.integers(0, len(faces), count), k]] for k in (0, 1, 2))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    keep = lengths[:, 0] > 0
    a, b, c, normals = a[keep], b[keep], c[keep], normals[keep] / lengths[keep]
    share = rng.random((len(a), 1))
    points = a * (1 - share) + b * share
    points = points + inset * (c - points)
    along = rng.standard_normal((len(a), 3))
    along -= (along * normals).sum(1, keepdims=True) * normals
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tilt = angle * rng.random((len(a), 1))
    directions = np.cos(tilt) * along + np.sin(tilt) * normals
    diagonal = np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0))
    before = diagonal * rng.choice([0.01, 0.3, 3.0], (len(a), 1))
    return _flat(points - before * directions, directions, 0.0, np.inf, False)


def _records(rays: RaySet) -> Rays:
    return _flat(rays.origins.numpy(), rays.directions.numpy(), rays.t_min, rays.t_max, rays.any_hit)


def _flat(
    origins: np.ndarray[Any, Any], directions: np.ndarray[Any, Any], t_min: float, t_max: float, any_hit: bool
) -> Rays:
    count = len(origins)
    span = np.stack([np.full(count, t_min), np.full(count, t_max)], axis=1)
    return Rays(origins, directions, span, np.full(count, -1, np.int32), False, any_hit)
