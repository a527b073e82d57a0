"""Measure the rasteriser, rays and the first picture: ``python -m torchrender.report.foundation [--quick] [--part P]``.

Writes ``docs/results/foundation.md``, ``.json`` and plots. All times of one table come from one run in which the
candidates take turns. With ``--part`` only that part is measured (at most four minutes each on two cores): raster,
scaling, rays or start; the others stay as they are recorded, with the machine and commit that they are of.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from torchrender.depth.viewpoints import viewpoints_around
from torchrender.kernels.compile import thread_count
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record
from torchrender.quality.timing import Timing, take_turns
from torchrender.raster import rasterize, rasterize_depth, rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.report.common.command import RESULTS, study_parser
from torchrender.report.common.memory import added_memory
from torchrender.report.foundation.page import write_page
from torchrender.report.foundation.peers import open3d_rays, opengl_raster
from torchrender.report.foundation.rays import measure_rays
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.scene.motion.refit import refitted
from torchrender.scene.procedural import build

SCENES = ("grass", "city", "living_room", "nest")
FILES = {
    "bookstore": "scenes/bookstore.glb",
    "dragon": "meshes/stanford_dragon_res2.ply",
    "armadillo": "meshes/armadillo.ply",
}
"""Below the folder that TORCHRENDER_DATA names; those that are not there are left out."""
VIEWS, VIEW_SIDE = 200, 256
SPREAD = 0.05  # side of the polygon of viewpoints, bounding-box diagonals
EDGE = 1e-2  # pixels whose smallest barycentric weight is below this count as "at an edge"


def main() -> None:
    """Run every measurement, or one part of them, and write the page."""
    parser = study_parser(__doc__, quick="small images and few runs, to check that it works")
    parser.add_argument("--part", choices=tuple(PARTS), help="measure this alone, keep the rest of the recorded page")
    arguments = parser.parse_args()
    record = {} if arguments.part is None else recorded(arguments.output)
    for name in _progress(PARTS if arguments.part is None else (arguments.part,), "parts"):
        record.update(PARTS[name](arguments.quick))
        record.setdefault("machines", {})[name] = machine_record()
    write_results(record, arguments.output)


def part_raster(quick: bool) -> dict[str, Any]:
    """G-buffers beside the peers, changing geometry, the floor, and many small pictures."""
    size, runs = (256, 3) if quick else (1024, 7)
    rows = {}
    views = []
    for name, scene in scenes():
        rows[name] = {**compare(scene, size, runs), "cost": cost_model(scene, size, runs)}
        views.append(many_views(name, scene, *((8, 64) if quick else ())))
    counts = (20_000,) if quick else (1_000_000, 3_000_000)
    return {
        "size": size,
        "quick": quick,
        "gbuffer": rows,
        "views": views,
        "changing": [changing(build("city", triangles=count), size, 3) for count in counts],
        "floor_ms": write_floor(size, runs),
    }


def part_scaling(quick: bool) -> dict[str, Any]:
    """Sweeps over triangles, pixels and the share in view."""
    size, runs = (256, 3) if quick else (1024, 7)
    return {
        "triangles": triangle_sweep(size, runs, 70_000 if quick else 3_000_000),
        "pixels": pixel_sweep(3, 512 if quick else 4096),
        "in_view": view_share(size, runs, 100_000 if quick else 1_000_000),
    }


def part_rays(quick: bool) -> dict[str, Any]:
    """Rays beside plain Embree."""
    return {"rays": {"machine": machine_record(), "rows": measure_rays(quick)}}


def part_start(quick: bool) -> dict[str, Any]:
    """A whole process."""
    return {"start": start_up(quick)}


PARTS = {"raster": part_raster, "scaling": part_scaling, "rays": part_rays, "start": part_start}


def recorded(folder: Path) -> dict[str, Any]:
    """What an earlier run left in ``folder``, or, where there is none, in the documentation."""
    places = [place / "foundation.json" for place in (folder, RESULTS)]
    found: dict[str, Any] = json.loads(next((p for p in places if p.exists()), places[0]).read_text())
    return found


def scenes() -> Iterator[tuple[str, Scene]]:
    """Built-in scenes and those from files."""
    folder = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data"))
    for name in _progress((*SCENES, *FILES), "scenes"):
        if name in SCENES:
            yield name, build(name)
        elif (folder / FILES[name]).exists():
            yield name, load(folder / FILES[name])


def many_views(name: str, scene: Scene, count: int = VIEWS, side: int = VIEW_SIDE, runs: int = 3) -> dict[str, Any]:
    """Pictures a second of ``count`` cameras around a scene, in one call: depth alone, and depth, normals and ids."""
    around = viewpoints_around(scene, scene.camera(width=side, height=side), count, spread=SPREAD)
    outputs = ("depth", "normal", "object_id")
    times = take_turns(
        {
            "depth": lambda: rasterize_depth(scene.geometry, around),
            "outputs": lambda: rasterize(scene, around, outputs=outputs),
        },
        runs=runs,
        warm_up=1,
    )
    rates = {key: 1e3 * count / timing.median for key, timing in times.items()}
    most, _ = added_memory(lambda: rasterize(scene, around, outputs=outputs))
    return {"scene": name, "count": count, "side": side, "per_second": rates, "added_mb": most}


def write_results(record: dict[str, Any], folder: Path) -> None:
    """The record and its page."""
    folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "foundation.json", record)
    write_page(record, folder)
    sys.stderr.write(f"wrote {folder / 'foundation.md'}\n")


def compare(scene: Scene, size: int, runs: int) -> dict[str, Any]:
    """G-buffer times beside open3d and software OpenGL, and agreement with the ray caster."""
    geometry, camera = scene.geometry, scene.camera(width=size, height=size)
    fields = (geometry.vertices, geometry.faces, geometry.object_id, geometry.material, None, None, None, geometry.runs)
    candidates: dict[str, Any] = {
        "torchrender": lambda: rasterize_visibility(geometry, camera),
        "torchrender_fresh": lambda: rasterize_visibility(Geometry(*fields), camera),  # clusters are built anew
    }
    notes: dict[str, str] = {}
    add_open3d(candidates, notes, geometry, camera)
    drawn = opengl_raster(geometry, camera)
    if isinstance(drawn, str):
        notes["opengl"] = drawn
    else:
        candidates["opengl"], notes["opengl"] = drawn
    times = take_turns(candidates, runs=runs)
    return {
        "triangles": geometry.triangle_count,
        "ms": {name: timing.record() for name, timing in times.items()},
        "notes": notes,
        "agreement": agreement(scene, size),
    }


def add_open3d(candidates: dict[str, Any], notes: dict[str, str], geometry: Geometry, camera: Cameras) -> None:
    """Its build and its rays among the candidates; a note, where it is not there."""
    rays = open3d_rays(geometry, camera, thread_count())
    if isinstance(rays, str):
        notes["open3d"] = rays
    else:
        candidates["open3d_build"], candidates["open3d"] = rays


def cost_model(scene: Scene, size: int, runs: int) -> dict[str, float]:
    """Where the time of a picture goes, in ms.

    ``triangles`` is the time of a picture of 16 x 16: culling, transforming and setting up whatever is in view, with
    hardly a pixel. ``memory`` is the least that ``size`` x ``size`` pixels could take: vertices and faces read once and
    the buffers written once, at the speed of copying.
    """
    geometry, camera = scene.geometry, scene.camera(width=size, height=size)
    few = scene.camera(width=16, height=16)
    block = torch.zeros(1 << 23)
    target = torch.empty_like(block)
    times = take_turns(
        {"triangles": lambda: rasterize_visibility(geometry, few), "copy": lambda: target.copy_(block)}, runs=runs
    )
    per_byte = times["copy"].median / (2 * block.nbytes)
    read = geometry.vertices.nbytes + geometry.faces.nbytes
    written = sum(
        image.nbytes for image in vars(rasterize_visibility(geometry, camera)).values() if torch.is_tensor(image)
    )
    return {"triangles": times["triangles"].median, "memory": per_byte * (read + written)}


def changing(scene: Scene, size: int, runs: int) -> dict[str, Any]:
    """Every triangle moves before every picture: refitted clusters and a picture, beside open3d's build and rays."""
    geometry, camera = scene.geometry, scene.camera(width=size, height=size)
    span = float((geometry.bounds[1] - geometry.bounds[0]).norm())
    generator = torch.Generator().manual_seed(5)
    moved = [
        geometry.vertices + 1e-4 * span * torch.randn(geometry.vertices.shape, generator=generator, dtype=torch.float64)
        for _ in range(2)
    ]
    turn = iter(range(1 << 30))
    candidates: dict[str, Any] = {
        "torchrender": lambda: rasterize_visibility(refitted(geometry, moved[next(turn) % 2]), camera)
    }
    notes: dict[str, str] = {}
    add_open3d(candidates, notes, geometry, camera)
    times = take_turns(candidates, runs=runs, warm_up=1)
    return {
        "triangles": geometry.triangle_count,
        "ms": {name: timing.record() for name, timing in times.items()},
        "notes": notes,
    }


def agreement(scene: Scene, size: int) -> dict[str, float]:
    """Share of equal triangle ids away from edges, and the largest relative depth error there, against Embree rays."""
    geometry, camera = scene.geometry, scene.camera(width=size, height=size)
    seen = rasterize_visibility(geometry, camera)
    origins, directions = (a.reshape(-1, 3) for a in camera.rays())
    hits = RayCaster(geometry).first_hit(origins, directions, t_min=float(camera.near[0]))
    ids, depth = seen.triangle.reshape(-1), seen.depth.reshape(-1).double()
    weights = seen.barycentric.reshape(-1, 2)
    least = torch.minimum(weights.amin(1), 1 - weights.sum(1))
    inner = (ids >= 0) & (least > EDGE)
    same = inner & (ids == hits.triangle)
    error = ((depth - hits.t).abs() / hits.t)[same]
    return {
        "pixels": int(inner.sum()),
        "same_id": float(same.sum() / inner.sum().clamp_min(1)),
        "same_id_with_edges": float(((ids == hits.triangle) & (ids >= 0)).sum() / (ids >= 0).sum().clamp_min(1)),
        "same_coverage": float(((ids >= 0) == (hits.triangle >= 0)).double().mean()),
        "depth_error_max": float(error.max()) if error.numel() else 0.0,
    }


def write_floor(size: int, runs: int) -> dict[str, float]:
    """Time to write the buffers once into memory that is already mapped, by one call of ``fill`` each."""
    buffers: list[np.ndarray[Any, Any]] = [
        np.zeros((size, size), np.float32),
        np.zeros((size, size), np.int64),
        np.zeros((size, size), np.int64),
        np.zeros((size, size, 2), np.float32),
    ]
    tensors = [torch.from_numpy(b) for b in buffers]
    timing = take_turns({"fill": lambda: [t.fill_(1) for t in tensors]}, runs=runs)["fill"]
    return {**timing.record(), "mib": sum(b.nbytes for b in buffers) / 2**20}


def triangle_sweep(size: int, runs: int, most: int) -> list[dict[str, float]]:
    """Time against the number of triangles: grass from its usual size up."""
    rows = []
    for count in _progress(
        [n for n in (63_000, 125_000, 250_000, 500_000, 1_000_000, 3_000_000) if n <= most], "sizes"
    ):
        scene = build("grass", triangles=count)
        camera = scene.camera(width=size, height=size)
        geometry = scene.geometry
        timing = _time(geometry, camera, max(3, runs // 2))
        rows.append({"triangles": geometry.triangle_count, **timing.record()})
    return rows


def pixel_sweep(runs: int, most: int) -> list[dict[str, float]]:
    """Time against image size on the living room."""
    scene = build("living_room")
    rows = []
    for side in [s for s in (256, 512, 1024, 2048, 4096) if s <= most]:
        camera = scene.camera(width=side, height=side)
        timing = _time(scene.geometry, camera, runs)
        rows.append({"side": side, **timing.record()})
    return rows


def view_share(size: int, runs: int, triangles: int) -> list[dict[str, float]]:
    """Time against the share of the scene in view: the city through narrower and narrower lenses."""
    scene = build("city", triangles=triangles)
    whole = scene.camera(width=size, height=size)
    rows = []
    for zoom in (1.0, 2.0, 4.0, 8.0, 16.0):
        k = whole.intrinsics.clone()
        k[:, (0, 1), (0, 1)] *= zoom
        camera = type(whole)(whole.camera_from_world, k, size, size, whole.near, whole.far)
        planes = camera.frustum_planes()[0]
        bounds = scene.geometry.cluster_bounds
        corners = torch.stack([bounds[:, (a, b, c), (0, 1, 2)] for a in (0, 1) for b in (0, 1) for c in (0, 1)], 1)
        inside = ~(corners @ planes[:, :3].T + planes[:, 3] < 0).all(1).any(1)
        timing = _time(scene.geometry, camera, runs)
        rows.append({"zoom": zoom, "share_in_view": float(inside.double().mean()), **timing.record()})
    return rows


def _time(geometry: Geometry, camera: Cameras, runs: int) -> Timing:
    return take_turns({"": lambda: rasterize_visibility(geometry, camera)}, runs=runs)[""]


def start_up(quick: bool) -> dict[str, float]:
    """Seconds of a whole ``torchrender render`` process: with kernels cached, and with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "torchrender.cli", "render", "cornell_box", "-o", f"{folder}/p.png"]
        seconds = {"cached": min(_process(command) for _ in range(1 if quick else 4))}
        if not quick:
            seconds["very_first"] = _process(command, NUMBA_CACHE_DIR=f"{folder}/cache")
    return seconds


def _process(command: list[str], **environment: str) -> float:
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, **environment})
    return time.perf_counter() - begin


def _progress(items: Any, unit: str) -> Any:
    from tqdm import tqdm

    return tqdm(items, desc=unit, disable=not sys.stderr.isatty())
