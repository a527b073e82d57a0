"""The times of the soft-shadow study: steps against scene size, single rays, and the cost of penumbrae."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.shadows.occluders import OccluderOptions, approximate_occluders
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, occluders, soft_shadow
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.plain_embree import PlainEmbree
from torchrender.kernels.rays.watertight import Rays
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.progress import part
from torchrender.report.soft_shadows.subject import StudyOptions, Subject, study_light
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build
from torchrender.scene.shapes import box

TIMED_MESHES = ("triangles", "hybrid")


def times(study: StudyOptions) -> dict[str, Any]:
    """Table 11 and figure 20: step times against scene size, beside the full scene and single rays."""
    out: dict[str, Any] = {}
    small = Subject.of(build("city", triangles=5000), 64)
    for label in ("full scene", *TIMED_MESHES):  # compiles, and touches what is only loaded once
        _steps(small, label, SoftShadowOptions(light_samples=2), study)
    _single_rays(small, replace(study, ray_pixels=10))
    for name, count in study.timed:
        with part(f"times, {name} {count:,}"):
            subject = Subject.of(build(name, triangles=count), study.timed_picture)
            options = SoftShadowOptions(light_samples=study.light_samples, map_size=study.timed_size)
            row: dict[str, Any] = {"count": subject.scene.geometry.triangle_count}
            for label in ("full scene", *TIMED_MESHES):
                row[label] = _steps(subject, label, options, study)
            row["single rays"] = _single_rays(subject, study)
            out.setdefault(name, {})[str(count)] = row
    return out


def _steps(subject: Subject, label: str, options: SoftShadowOptions, study: StudyOptions) -> dict[str, float]:
    """Seconds by step, from the scene to light visibility; nothing is kept from one call to the next."""
    start = time.perf_counter()
    mesh = subject.scene.geometry
    if label != "full scene":
        chosen = OccluderOptions(size=study.timed_size, mesh=label)
        mesh = approximate_occluders(subject.scene, study_light(subject.box), chosen, bounds=subject.box)
    sampled = time.perf_counter()
    options = replace(options, occluders="rebuilt" if label == "hybrid" else "scene")
    ready = occluders(mesh).prepared(options)
    sorted_at = time.perf_counter()
    subject.lit(ready, 1.0, options)
    done = time.perf_counter()
    return {
        "triangles": mesh.triangle_count,
        "images": sampled - start,
        "tree": sorted_at - sampled,
        "visibility": done - sorted_at,
        "total": done - start,
    }


def penumbra_cost(study: StudyOptions) -> list[dict[str, float]]:
    """Share of penumbra pixels and time: a grille over a floor, under lights of growing size."""
    floor = _slab((-6.0, -0.1, -6.0), (6.0, 0.0, 6.0))
    bars = [_slab((x - 0.06, 1.0, -3.0), (x + 0.06, 1.1, 3.0)) for x in torch.linspace(-3, 3, 13).tolist()]
    scene = Scene(meshes=(floor, *bars))
    camera = Cameras.look_at([0.0, 9.0, 7.0], [0.0, 0.0, 0.0], width=study.timed_picture, height=study.timed_picture,
                             fov_deg=45.0, near=0.01)  # fmt: skip
    seen, ready, rows = rasterize(scene, camera), occluders(scene.geometry), []
    settings = {
        "skipping": SoftShadowOptions(light_samples=study.light_samples),
        "tracing all": SoftShadowOptions(light_samples=study.light_samples, refine=1, skip_lit=False, umbra_probes=0),
    }
    for side in (0.01, 0.1, 0.25, 1.0, 3.0, 8.0):
        corner = torch.tensor([-side / 2, 6.0, -side / 2])
        light = RectLight(corner=corner, edge_u=torch.tensor([side, 0, 0]), edge_v=torch.tensor([0, 0, side]))
        row: dict[str, float] = {"side": side}
        work = {
            label: partial(soft_shadow, ready, light, seen, o, bounds=scene.bounds) for label, o in settings.items()
        }
        for label, timing in take_turns(work, runs=3, warm_up=1).items():
            row[label] = timing.median / 1e3
            result = work[label]()
            row[f"{label} lit"] = float(result.lit.sum())
        lit = result.lit[:, 0][seen.covered]
        row["share"] = float(((lit > 0) & (lit < result.sample_count[0])).float().mean())
        rows.append(row)
    return rows


def _single_rays(subject: Subject, study: StudyOptions) -> dict[str, float]:
    """Seconds of one ray from every pixel to every light sample, from an even choice of pixels.

    By the ray caster, whose hits are exact, and by Embree alone.
    """
    seen = subject.view
    points, normals = seen.position[seen.covered], seen.geometric_normal[seen.covered].double()
    chosen = torch.linspace(0, len(points) - 1, min(study.ray_pixels, len(points))).long()
    geometry, scale = subject.scene.geometry, len(points) / len(chosen)
    targets = study_light(subject.box).samples(study.light_samples).double()
    origins = (points + normals * 1e-5 * subject.scene.diagonal)[chosen][:, None].expand(-1, len(targets), 3)
    toward = targets[None] - origins
    start = time.perf_counter()
    caster = RayCaster(geometry)
    built = time.perf_counter()
    caster.occluded(origins[:1], toward[:1], t_max=1.0)
    begun = time.perf_counter()
    caster.occluded(origins, toward, t_max=1.0)
    found = {"build": built - start, "trace": (time.perf_counter() - begun) * scale}
    if embree() is not None:
        rays = _segments(origins, toward)
        start = time.perf_counter()
        plain = PlainEmbree(view(geometry.vertices, np.float64), view(geometry.faces, np.int32))
        built = time.perf_counter()
        plain.cast(rays)
        found |= {"embree build": built - start, "embree trace": (time.perf_counter() - built) * scale}
    return found


def _segments(origins: Tensor, toward: Tensor) -> Rays:
    """Rays from ``origins`` (N,K,3) that end after ``toward`` (N,K,3), whatever they hit."""
    start, direction = (np.ascontiguousarray(a.reshape(-1, 3).numpy()) for a in (origins, toward))
    span = np.stack([np.zeros(len(start)), np.ones(len(start))], axis=1)
    return Rays(start, direction, span, np.full(len(start), -1, np.int32), False, True)


def _slab(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    first, last = torch.tensor(low), torch.tensor(high)
    mesh = box(last - first)
    return Mesh(vertices=mesh.vertices + (first + last) / 2, faces=mesh.faces)
