"""Soft shadows measured: errors of sampled occluders beside the published ones, times, and the cost of penumbrae.

``python -m torchrender.report.soft_shadows [--quick] [-o docs/results]`` writes ``soft-shadows.md``, ``.json`` and
pictures. Errors are taken on an evenly thinned picture, which changes means by less than their third digit.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.soft_shadow import LightVisibility, SoftShadowOptions, occluders, soft_shadow
from torchrender.geometry.light_occluders import OccluderOptions, approximate_occluders
from torchrender.image_io import write_atomically
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.machine import machine_record
from torchrender.report.soft_shadow_errors import mean_errors, signed_picture
from torchrender.report.soft_shadow_page import write_page
from torchrender.scene.light import RectLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

SCENES = ("nest", "grass", "city", "tree")
METHODS = ("nonredundant", "conventional", "depth_peeling")


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """How much is measured."""

    scenes: tuple[str, ...] = SCENES
    picture: int = 192  # pixels of the output's side where errors are taken
    timed_picture: int = 512  # and where times are
    size: int = 1024  # pixels of a reference image
    sizes: tuple[int, ...] = (512, 1024, 1536)
    ratios: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0)  # light diagonal over scene diagonal
    counts: tuple[int, ...] = (63_000, 250_000, 1_000_000, 3_000_000)
    light_samples: int = 16
    ray_pixels: int = 400  # pixels whose rays the ray caster traces one by one


QUICK = StudyOptions(
    scenes=("city",), picture=48, timed_picture=64, size=96, sizes=(64, 96), ratios=(0.5, 1.0), counts=(5_000,),
    light_samples=4, ray_pixels=20,
)  # fmt: skip


def study_light(scene: Scene, ratio: float = 1.0) -> RectLight:
    """The square light of the study: 0.75 diagonals above the box's centre, facing down, with this diagonal."""
    side = ratio * scene.diagonal / 2**0.5
    centre = scene.bounds.mean(0) + torch.tensor([0.0, 0.75 * scene.diagonal, 0.0], dtype=torch.float64)
    corner = centre - torch.tensor([side / 2, 0.0, side / 2], dtype=torch.float64)
    return RectLight(corner=corner, edge_u=torch.tensor([side, 0.0, 0.0]), edge_v=torch.tensor([0.0, 0.0, side]))


def error_tables(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Tables 8 to 10 and the ablation of meshes: errors by scene, resolution, light size and method."""
    out: dict[str, Any] = {"resolution": {}, "light": {}, "mesh": {}}
    for name in study.scenes:
        scene = build(name)
        view = rasterize(scene, scene.camera(width=study.picture, height=study.picture))
        references = {r: _references(scene, study_light(scene, r), view, study) for r in study.ratios}
        for size in study.sizes:
            for method in METHODS:
                cell = _errors(scene, view, references, study, OccluderOptions(method=method, size=size), 1.0)
                out["resolution"].setdefault(name, {}).setdefault(str(size), {})[method] = cell[0]
                if size == study.size and method == METHODS[0]:
                    picture = signed_picture(cell[1], references[1.0]["shadow_map"], view.covered)
                    _save(picture, folder / f"soft-shadows-{name}.png")
        for ratio in study.ratios:
            for method in METHODS:
                cell = _errors(scene, view, references, study, OccluderOptions(method=method, size=study.size), ratio)
                out["light"].setdefault(name, {}).setdefault(str(ratio), {})[method] = cell[0]
        for mesh in ("hybrid", "grid", "splat"):
            cell = _errors(scene, view, references, study, OccluderOptions(mesh=mesh, size=study.size), 1.0)
            out["mesh"].setdefault(name, {})[mesh] = cell[0]
    return out


def times(study: StudyOptions) -> dict[str, Any]:
    """Table 11 and figure 20: step times against scene size, beside the full scene and single rays."""
    out: dict[str, Any] = {}
    for count in study.counts:
        scene = build("city", triangles=count)
        light = study_light(scene)
        view = rasterize(scene, scene.camera(width=study.timed_picture, height=study.timed_picture))
        options = SoftShadowOptions(light_samples=study.light_samples, map_size=study.size)
        row: dict[str, Any] = {"triangles": scene.geometry.triangle_count}
        for label in ("full scene", "four images"):
            start = time.perf_counter()
            mesh = scene.geometry
            if label == "four images":
                mesh = approximate_occluders(scene, light, OccluderOptions(size=study.size))
            sampled = time.perf_counter()
            ready = occluders(mesh)
            sorted_at = time.perf_counter()
            soft_shadow(ready, light, view, options, bounds=scene.bounds)
            done = time.perf_counter()
            row[label] = {
                "triangles": mesh.triangle_count,
                "images_and_meshes": sampled - start,
                "tree": sorted_at - sampled,
                "visibility": done - sorted_at,
            }
        row["single_rays"] = _single_rays(scene, light, view, study)
        out[str(count)] = row
    return out


def penumbra_cost(study: StudyOptions) -> list[dict[str, float]]:
    """Share of penumbra pixels and time, for a slab over a floor under lights of growing size."""
    floor = _slab((-6.0, -0.1, -6.0), (6.0, 0.0, 6.0))
    scene = Scene(meshes=(floor, _slab((-1.5, 1.0, -1.5), (1.5, 1.1, 1.5))))
    camera = scene.camera(width=study.timed_picture, height=study.timed_picture)
    view, ready, rows = rasterize(scene, camera), occluders(scene.geometry), []
    for side in (0.02, 0.2, 0.5, 1.0, 2.0, 3.0, 4.5, 6.0, 8.0):
        corner = torch.tensor([-side / 2, 6.0, -side / 2])
        light = RectLight(corner=corner, edge_u=torch.tensor([side, 0, 0]), edge_v=torch.tensor([0, 0, side]))
        row: dict[str, float] = {"side": side}
        for label, options in {
            "skipping": SoftShadowOptions(light_samples=study.light_samples),
            "tracing all": SoftShadowOptions(light_samples=study.light_samples, skip_lit=False, umbra_probes=0),
        }.items():
            soft_shadow(ready, light, view, options, bounds=scene.bounds)
            start = time.perf_counter()
            result = soft_shadow(ready, light, view, options, bounds=scene.bounds)
            row[label] = time.perf_counter() - start
            row[f"{label} lit"] = float(result.lit.sum())
        lit = result.lit[:, 0][view.covered]
        row["share"] = float(((lit > 0) & (lit < result.sample_count[0])).float().mean())
        rows.append(row)
    return rows


def skipping_error(study: StudyOptions) -> dict[str, float]:
    """Share of pixels that default settings change against tracing everything."""
    out = {}
    for name in study.scenes:
        scene = build(name)
        view = rasterize(scene, scene.camera(width=study.picture, height=study.picture))
        ready, light = occluders(scene.geometry), study_light(scene)
        n = study.light_samples
        quick = soft_shadow(ready, light, view, SoftShadowOptions(light_samples=n), bounds=scene.bounds)
        whole = SoftShadowOptions(light_samples=n, skip_lit=False, umbra_probes=0)
        exact = soft_shadow(ready, light, view, whole, bounds=scene.bounds)
        out[name] = float((quick.lit != exact.lit)[:, 0][view.covered].float().mean())
    return out


def _references(scene: Scene, light: RectLight, view: GBuffer, study: StudyOptions) -> dict[str, LightVisibility]:
    """Reference A (maps of the original triangles) and B (rays to them; the bias only covers float32 depths)."""
    ready = occluders(scene.geometry)
    maps = SoftShadowOptions(visibility="shadow_map", light_samples=study.light_samples, map_size=study.size)
    rays = SoftShadowOptions(light_samples=study.light_samples, constant_bias=1e-4, slope_bias=0.0)
    return {
        "shadow_map": soft_shadow(ready, light, view, maps, bounds=scene.bounds),
        "ray": soft_shadow(ready, light, view, rays, bounds=scene.bounds),
    }


def _errors(
    scene: Scene,
    view: GBuffer,
    references: dict[float, dict[str, LightVisibility]],
    study: StudyOptions,
    options: OccluderOptions,
    ratio: float,
) -> tuple[dict[str, Any], LightVisibility]:
    """Mean and maximum errors against A (same procedure) and B (rays), and the approximate visibility."""
    light = study_light(scene, ratio)
    ready = occluders(approximate_occluders(scene, light, options))
    cell: dict[str, Any] = {"triangles": ready.geometry.triangle_count}
    found = {}
    for label, visibility in (("A", "shadow_map"), ("B", "ray")):
        made = SoftShadowOptions(visibility=visibility, light_samples=study.light_samples, map_size=study.size)
        found[label] = soft_shadow(ready, light, view, made, bounds=scene.bounds)
        cell[label] = mean_errors(found[label], references[ratio][visibility], view.covered)
    return cell, found["A"]


def _single_rays(scene: Scene, light: RectLight, view: GBuffer, study: StudyOptions) -> dict[str, float]:
    """Seconds that the ray caster needs for every light sample of every pixel, from an even choice of pixels."""
    points, normals = view.position[view.covered], view.geometric_normal[view.covered].double()
    chosen = torch.linspace(0, len(points) - 1, min(study.ray_pixels, len(points))).long()
    start = time.perf_counter()
    caster = RayCaster(scene.geometry)
    built = time.perf_counter()
    targets = light.samples(study.light_samples).double()
    origins = (points + normals * 1e-5 * scene.diagonal)[chosen][:, None].expand(-1, len(targets), 3)
    toward = targets[None] - origins
    caster.occluded(origins[:1], toward[:1], t_max=1.0)
    begun = time.perf_counter()
    caster.occluded(origins, toward, t_max=1.0)
    seconds = (time.perf_counter() - begun) * len(points) / len(chosen)
    return {"build": built - start, "trace": seconds}


def _slab(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    from torchrender.scene.shapes import box

    first, last = torch.tensor(low), torch.tensor(high)
    mesh = box(last - first)
    return Mesh(vertices=mesh.vertices + (first + last) / 2, faces=mesh.faces)


def _save(picture: Tensor, path: Path) -> None:
    from torchrender.image_io import write_image

    write_image(path, picture)


def run(study: StudyOptions, folder: Path) -> dict[str, Any]:
    """Measure everything and write the page."""
    folder.mkdir(parents=True, exist_ok=True)
    record: dict[str, Any] = {"machine": machine_record(), "study": asdict(study)}
    record |= {"errors": error_tables(study, folder), "times": times(study), "penumbra": penumbra_cost(study)}
    record["skipping"] = skipping_error(study)
    write_atomically(folder / "soft-shadows.json", lambda path: _write_text(path, json.dumps(record, indent=1) + "\n"))
    write_page(record, folder)
    return record


def _write_text(path: Path, text: str) -> None:
    path.write_text(text)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="one scene, small pictures: checks that it works")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/results"), help="folder to write into")
    given = parser.parse_args()
    run(QUICK if given.quick else StudyOptions(), given.output)


if __name__ == "__main__":
    main()
