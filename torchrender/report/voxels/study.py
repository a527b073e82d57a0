"""Voxels measured: stages and sizes beside the published tables, other programs, solids, scaling, uses.

``python -m torchrender.report.voxels [--quick] [-o docs/results]`` writes ``voxels.md``, ``.json`` and pictures. Real
models are looked for in ``TORCHRENDER_DATA`` (default ``../shared/data``); where they are absent, only synthetic ones
are measured.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch

from torchrender.checks import checked_fields
from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_record
from torchrender.quality.timing import take_turns
from torchrender.rays import RayCaster
from torchrender.report.common.command import study_parser
from torchrender.report.voxels.baselines import layered_depths, slices, three_sheets
from torchrender.report.voxels.models import bumpy_ring, models
from torchrender.report.voxels.page import write_page
from torchrender.report.voxels.peers import SURFACES, agreement, peer_solid, peer_surface
from torchrender.report.voxels.pictures import draw_pictures, sphere_points, tangle
from torchrender.scene import shapes
from torchrender.scene.mesh import Geometry, concatenate
from torchrender.voxels.collision import CollisionOptions, collide
from torchrender.voxels.functions import voxelize_implicit, voxelize_parametric
from torchrender.voxels.grid import VoxelGrid, Voxels, make_grid
from torchrender.voxels.mesh import voxel_mesh
from torchrender.voxels.sheets import SheetLayout
from torchrender.voxels.solid import SolidOptions, SolidReport, voxelize_solid
from torchrender.voxels.surface import SurfaceOptions, dominant_axes, voxelize_surface

STAGES = ("classify_ms", "rasterise_ms", "texelize_ms", "synthesise_ms", "pairs")
REAL = ("utah_teapot.obj", "fandisk.obj", "stanford_bunny.ply", "armadillo.ply", "stanford_dragon_res2.ply")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    models: tuple[str, ...] = REAL
    synthetic: tuple[int, ...] = (871_000, 1_800_000, 10_000_000)  # triangles of the bumpy ring
    side: int = 256  # cells along the longest side
    sides: tuple[int, ...] = (64, 128, 256, 512)
    peer_side: int = 256
    rays: int = 20_000  # cells whose inside is asked of rays
    runs: int = 5
    picture: int = 420


QUICK = StudyOptions(
    models=("suzanne.obj",), synthetic=(4_000,), side=48, sides=(16, 32), peer_side=32, rays=300, runs=1, picture=64
)


def model_row(name: str, geometry: Geometry, study: StudyOptions) -> dict[str, Any]:
    """Table 2.1 for one model: stages in torch, the compiled passes, and what they met."""
    mesh = geometry.vertices[None], geometry.faces
    grid = make_grid(geometry.bounds[None], (study.side,) * 3)
    thin, quiet = SurfaceOptions(mode="thin"), SolidOptions(warn=False)
    timed = {
        "classify": lambda: dominant_axes(geometry.vertices, geometry.faces),
        "thin": lambda: voxelize_surface(*mesh, grid, thin),
        "conservative": lambda: voxelize_surface(*mesh, grid),
        "solid": lambda: voxelize_solid(*mesh, grid, quiet),
    }
    times = take_turns(timed, runs=study.runs, warm_up=1)
    stages = three_sheets(geometry.vertices, geometry.faces, grid)
    surface = voxelize_surface(*mesh, grid)
    solid, report = voxelize_solid(*mesh, grid, quiet)
    return {
        "name": name,
        "triangles": geometry.triangle_count,
        "vertices": len(geometry.vertices),
        "ms": {key: value.record() for key, value in times.items()},
        "sheets": {
            k: getattr(stages, k) for k in ("classify_ms", "rasterise_ms", "texelize_ms", "synthesise_ms", "pairs")
        },
        "sheets_equal_thin": stages.voxels.equals(voxelize_surface(*mesh, grid, thin)),
        "thin_cells": stages.voxels.count,
        "surface_cells": surface.count,
        "pairs": surface.stats["pairs"],
        "solid_cells": solid.count,
        **_leaks(report),
    }


def _leaks(report: SolidReport) -> dict[str, Any]:
    return {"closed": report.closed, "leaking": report.leaking_share, "unknown": report.unknown}


def grid_rows(geometry: Geometry, study: StudyOptions) -> list[dict[str, Any]]:
    """Table 2.2: size, bits, memory, time, voxels and drawing by resolution."""
    rows: list[dict[str, Any]] = []
    mesh = geometry.vertices[None], geometry.faces
    for n in study.sides:
        grid = make_grid(geometry.bounds[None], (n, n, n))
        surface = voxelize_surface(*mesh, grid)
        times = take_turns(
            {
                "surface": partial(voxelize_surface, *mesh, grid),
                "solid": partial(voxelize_solid, *mesh, grid, SolidOptions(warn=False)),
                "sides": partial(voxel_mesh, surface),
            },
            runs=study.runs,
            warm_up=1,
        )
        bits = {512: 1, 256: 8, 128: 16, 64: 8}.get(n, 1)
        sheet = SheetLayout(dims=(n, n, n), bits=bits)
        ratio = surface.count / rows[-1]["cells"] if rows else None
        rows.append(
            {
                "side": n,
                "cells": surface.count,
                "ratio": ratio,
                "packed_bytes": surface.nbytes,
                "sheet_bits": bits,
                "sheet_bytes": n**3 * bits // 8,
                "sheets": sheet.sheets,
                "ms": {key: value.record() for key, value in times.items()},
            }
        )
    return rows


def solid_rows(study: StudyOptions) -> list[dict[str, Any]]:
    """Volume by resolution, and cells that disagree with rays, for every closed model; the source's fill beside it."""
    rows = []
    for name, geometry in models(study.models, study.synthetic):
        mesh = geometry.vertices[None], geometry.faces
        corners = geometry.vertices[geometry.faces.long()]
        exact = abs(float(torch.linalg.det(corners).sum() / 6))
        row: dict[str, Any] = {"name": name, "triangles": geometry.triangle_count, "error": {}}
        for n in study.sides:
            solid, report = voxelize_solid(*mesh, make_grid(geometry.bounds[None], n), SolidOptions(warn=False))
            row["error"][str(n)] = float(solid.volume[0]) / exact - 1 if report.closed else None
            row |= _leaks(report)
        grid = make_grid(geometry.bounds[None], study.sides[-2])
        for method in ("winding", "parity", "vote", "toggle"):
            solid, _ = voxelize_solid(*mesh, grid, SolidOptions(method=method, warn=False))
            row[method] = _wrong_by_rays(geometry, solid, study.rays)
        rows.append(row)
        if geometry.triangle_count > 1_000_000:
            break
    return rows


def _wrong_by_rays(geometry: Geometry, solid: Voxels, count: int) -> float:
    """Share of randomly chosen cells whose centre is on the other side by the majority of three rays."""
    grid = solid.grid
    generator = torch.Generator().manual_seed(0)
    cells = torch.stack([torch.randint(0, d, (count,), generator=generator) for d in grid.dims], dim=1)
    centres, caster = grid.centres(cells), RayCaster(geometry)
    votes = torch.zeros(count, dtype=torch.int64)
    for toward in ((0.6, 0.3, 0.742), (-0.31, 0.86, 0.405), (0.21, -0.43, -0.878)):
        directions = torch.tensor(toward, dtype=torch.float64).expand_as(centres)
        crossings = torch.zeros(count, dtype=torch.int64)
        hits = caster.first_hit(centres, directions)
        while bool((hits.triangle >= 0).any()):
            crossings += hits.triangle >= 0
            hits = caster.next_hit(centres, directions, hits.t, hits.triangle)
        votes += crossings % 2
    i, j, k = cells.unbind(-1)
    return float((solid.dense()[0, k, j, i] != (votes >= 2)).float().mean())


def peer_rows(study: StudyOptions) -> dict[str, Any]:
    """Other programs on the model of the brief size, surface and solid, beside this one on grids like theirs."""
    geometry = bumpy_ring(study.synthetic[0])
    mesh, grid = (geometry.vertices[None], geometry.faces), make_grid(geometry.bounds[None], study.peer_side)
    cell = float(grid.cell[0])
    own = take_turns(
        {"surface": lambda: voxelize_surface(*mesh, grid), "solid": lambda: voxelize_solid(*mesh, grid)},
        runs=study.runs,
        warm_up=1,
    )
    out: dict[str, Any] = {
        "triangles": geometry.triangle_count,
        "side": study.peer_side,
        "own_ms": {k: v.record() for k, v in own.items()},
    }
    for kind, measure in (("surface", peer_surface), ("solid", peer_solid)):
        out[kind] = {}
        for name in SURFACES:
            found, seconds, why = measure(name, geometry, cell)
            row: dict[str, Any] = {"seconds": seconds, "why": why}
            if found is not None:
                row |= agreement(found, geometry, kind == "solid")
                # In turn with the peer, so that a busy machine slows both alike.
                again = take_turns({"own": partial(_again, kind, mesh, grid)}, runs=study.runs, warm_up=0)
                row["ratio"] = 1e3 * seconds / again["own"].median
            out[kind][name] = row
            _say(f"  {name} {kind}: {seconds:.2f} s {why}")
    return out


def _again(kind: str, mesh: tuple[torch.Tensor, torch.Tensor], grid: VoxelGrid) -> object:
    return voxelize_surface(*mesh, grid) if kind == "surface" else voxelize_solid(*mesh, grid)


def baseline_row(study: StudyOptions) -> dict[str, Any]:
    """Slices, layered depths and three sheets in torch against the compiled passes."""
    geometry = bumpy_ring(study.synthetic[0])
    grid = make_grid(geometry.bounds[None], (study.side,) * 3)
    mesh = geometry.vertices, geometry.faces, grid
    thin = SurfaceOptions(mode="thin")
    times = take_turns(
        {
            "slices": lambda: slices(*mesh),
            "three sheets, torch": lambda: three_sheets(*mesh),
            "thin": lambda: voxelize_surface(mesh[0][None], *mesh[1:], thin),
            "layered depths": lambda: layered_depths(geometry, grid),
            "solid": lambda: voxelize_solid(mesh[0][None], *mesh[1:]),
        },
        runs=min(study.runs, 3),
        warm_up=1,
    )
    difference = layered_depths(geometry, grid), voxelize_solid(mesh[0][None], *mesh[1:])[0]
    wrong = (difference[0] - difference[1]).count + (difference[1] - difference[0]).count
    return {
        "triangles": geometry.triangle_count,
        "ms": {k: v.record() for k, v in times.items()},
        "slices_equal_thin": slices(*mesh).equals(voxelize_surface(mesh[0][None], *mesh[1:], thin)),
        "layered_differs": wrong,
    }


def scaling(study: StudyOptions) -> list[dict[str, float]]:
    """Time against triangles on one grid."""
    rows = []
    for part in (16, 8, 4, 2, 1):
        geometry = bumpy_ring(max(study.synthetic) // part)
        mesh, grid = (geometry.vertices[None], geometry.faces), make_grid(geometry.bounds[None], (study.side,) * 3)
        times = take_turns({"surface": partial(voxelize_surface, *mesh, grid)}, runs=study.runs, warm_up=1)
        surface = voxelize_surface(*mesh, grid)
        rows.append(
            {
                "triangles": geometry.triangle_count,
                "ms": times["surface"].median,
                "cells": surface.count,
                "pairs": surface.stats["pairs"],
            }
        )
    return rows


def uses(study: StudyOptions) -> dict[str, Any]:
    """Implicit counts, a parametric surface, and collision."""
    implicit = []
    for n in [s for s in study.sides if s <= 256]:
        low = torch.full((1, 3), -3.0, dtype=torch.float64)
        grid = VoxelGrid(low, torch.tensor([6 / n], dtype=torch.float64), (n, n, n))
        times = take_turns({"solid": partial(voxelize_implicit, tangle, grid)}, runs=1, warm_up=0)
        counts = {kind: voxelize_implicit(tangle, grid, kind).count for kind in ("solid", "surface")}
        implicit.append({"side": n, **counts, "ms": times["solid"].median})
    grid = VoxelGrid(torch.full((1, 3), -1.1), torch.tensor([2.2 / 64]), (64, 64, 64))
    ball = voxelize_parametric(sphere_points, ((0.0, 2 * torch.pi), (0.0, torch.pi)), grid)
    body, away = concatenate([shapes.torus(1.0, 0.3, 256)]), torch.eye(4)
    away[0, 3] = 1.1
    options = CollisionOptions(resolution=study.peer_side)
    times = take_turns({"collide": lambda: collide(body, body, options, world_from_second=away)}, runs=study.runs)
    found = collide(body, body, options, world_from_second=away)
    return {
        "implicit": implicit,
        "parametric": {"cells": ball.voxels.count, "samples": ball.samples, "largest_gap": ball.largest_gap},
        "collision": {"triangles": body.triangle_count, "shared": found.count, "ms": times["collide"].record()},
    }


def run(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Measure everything and write the page."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"machine": machine_record(), "study": asdict(study), "models": []}
    for name, geometry in models(study.models, study.synthetic):
        _say(f"{name}, {geometry.triangle_count:,} triangles")
        record["models"].append(model_row(name, geometry, study))
    geometry = next(
        g
        for n, g in models(study.models, study.synthetic)
        if "bunny" in n or study.sides[-1] < 256 or n == "bumpy ring"
    )
    record["grids"] = {"triangles": geometry.triangle_count, "rows": grid_rows(geometry, study)}
    for key, part in (("solids", solid_rows), ("peers", peer_rows), ("baselines", baseline_row), ("scaling", scaling)):
        _say(key)
        record[key] = part(study)
    _say("uses and pictures")
    record["uses"] = uses(study)
    record["pictures"] = draw_pictures(folder, study.picture)
    text = json.dumps(record, indent=1) + "\n"
    write_atomically(folder / "voxels.json", lambda path: _write(path, text))
    write_page(record, folder)
    return record


def _write(path: Path, text: str) -> None:
    path.write_text(text)


def _say(text: str) -> None:
    sys.stderr.write(f"{text}\n")


def main() -> None:
    """The command."""
    parser = study_parser(__doc__, quick="small models and grids: checks that it works")
    parser.add_argument("--pictures", action="store_true", help="draw voxels.jpg and measure nothing")
    given = parser.parse_args()
    if given.pictures:
        draw_pictures(given.output, 320)
        return
    run(QUICK if given.quick else StudyOptions(), given.output)
