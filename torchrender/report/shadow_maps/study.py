"""Measure shadow maps against shadow rays: ``python -m torchrender.report.shadow_maps [--quick]``.

Writes ``docs/results/shadow-maps.md``, ``.json`` and ``.jpg``: time of map and lookup, wrong pixels, contact
displacement and memory by filter, bias and map size.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.shadows.shadow_map import ShadowOptions, light_visibility, options_for, render_shadow_map
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.images.files import write_atomically
from torchrender.numerics.shadow_compare import disc_points
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.command import study_parser
from torchrender.report.common.progress import part
from torchrender.report.shadow_maps.everywhere import GROUNDS, box_on_ground, wrong_everywhere
from torchrender.report.shadow_maps.page import page
from torchrender.report.shadow_maps.quality import contact_displacement, disc_visibility, faces, shadow_errors
from torchrender.report.shadow_maps.terrain import terrain
from torchrender.scene.light import DirectionalLight, Light, RectLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

CASES = (("city", 0), ("living_room", 1), ("cornell_box", 0), ("nest", 0), ("terrain", 0))
_MAP = ShadowOptions(edges="map")
_WHOLE = ShadowOptions(edges="map", coverage="scene")
SETTINGS = {
    "bilinear": ShadowOptions(),
    "none": ShadowOptions(filter="none"),
    "pcf 5 x 5": ShadowOptions(filter="pcf", filter_radius=2),
    "poisson": ShadowOptions(filter="poisson", filter_radius=2),
    "pcss": ShadowOptions(filter="pcss"),
    "bilinear, 256": ShadowOptions(size=256),
    "edges by the map: bilinear": _MAP,
    "edges by the map: none": replace(_MAP, filter="none"),
    "edges by the map: bilinear, 2048": replace(_MAP, size=2048),
    "edges by the map: receiver plane": replace(_MAP, bias="receiver_plane"),
    "edges by the map: pcf 5 x 5": replace(_MAP, filter="pcf", filter_radius=2),
    "edges by the map: poisson": replace(_MAP, filter="poisson", filter_radius=2),
    "edges by the map: pcss": replace(_MAP, filter="pcss"),
    "edges by the map, whole scene: bilinear": _WHOLE,
    "edges by the map, whole scene: none": replace(_WHOLE, filter="none"),
    **{
        f"baseline: constant bias of {bias:g} texels": replace(_WHOLE, bias="constant", constant_bias=bias)
        for bias in (0.5, 2.0, 4.0, 8.0)
    },
    "baseline: averaged depth": replace(_WHOLE, filter="average_depth"),
}
SHOWN = ("none", "bilinear", "pcf 5 x 5", "poisson", "pcss", "edges by the map, whole scene: bilinear")


def main() -> None:
    """Run every case and write the page."""
    arguments = study_parser(__doc__, quick="small images and few runs, to check that it works").parse_args()
    run(arguments.output, arguments.quick)
    sys.stderr.write(f"wrote {arguments.output / 'shadow-maps.md'}\n")


def run(folder: Path, quick: bool = False, cases: Sequence[tuple[str, int]] = CASES) -> dict[str, Any]:
    """Measure, and write page, record and picture into ``folder``."""
    width, height, runs = (96, 72, 1) if quick else (480, 360, 3)
    record: dict[str, Any] = {"machine": machine_record(), "size": [width, height], "runs": runs, "cases": {}}
    rows = []
    for name, index in cases:
        scene = terrain(64 if quick else 256) if name == "terrain" else build(name)
        light = scene.lights[index]
        with part(f"{name}, {light.name}"):
            measured, pictures = measure(scene, light, (width, height), runs)
        record["cases"][f"{name}, {light.name}"] = measured
        rows.append(torch.cat(pictures, dim=1))
    with part("grounds"):
        record["grounds"] = [box_on_ground(*ground, pixels=width) for ground in GROUNDS]
    with part("built-in scenes"):
        record["everywhere"] = wrong_everywhere(width // 2, height // 2)
    folder.mkdir(parents=True, exist_ok=True)
    write_record(folder / "shadow-maps.json", record)
    write_text(folder / "shadow-maps.md", page(record))
    picture = Picture.fromarray((torch.cat(rows) * 255).to(torch.uint8).numpy())
    write_atomically(folder / "shadow-maps.jpg", lambda p: picture.save(p, format="JPEG", quality=80))
    return record


def measure(scene: Scene, light: Light, size: tuple[int, int], runs: int) -> tuple[dict[str, Any], list[Tensor]]:
    """Figures of every setting for one light, and pictures of the ray reference and of some settings."""
    gbuffer = rasterize(scene, scene.camera(width=size[0], height=size[1]))
    caster = RayCaster(scene.geometry)
    hard, soft = traced_visibility(caster, light, gbuffer), _soft(scene, caster, light, gbuffer)
    facing = gbuffer.covered & faces(light, gbuffer)
    found, pictures = {}, {"rays": soft[0]}
    for name, options in SETTINGS.items():
        follows = gbuffer if options.coverage == "view" else None
        shadow_map = render_shadow_map(scene, light, options, gbuffer=follows)
        seen = light_visibility(scene, light, gbuffer, options, shadow_map)
        timings = take_turns(
            {
                "map": partial(render_shadow_map, scene, light, options, gbuffer=follows),
                "lookup": partial(light_visibility, scene, light, gbuffer, options, shadow_map),
            },
            runs=runs,
            warm_up=0,  # both have just run
        )
        errors = shadow_errors(seen, soft if options.filter == "pcss" else hard, facing)
        moved = contact_displacement(gbuffer, light, shadow_map, options)
        found[name] = asdict(errors) | {
            "map_ms": timings["map"].record(),
            "lookup_ms": timings["lookup"].record(),
            "views": len(shadow_map.cameras),
            "contact_displacement_p95": float(moved[facing].quantile(0.95)) if bool(facing.any()) else 0.0,
            "map_mib": shadow_map.depth.numel() * 4 / 2**20,
        }
        if name in SHOWN:
            pictures[name] = seen[0]
    shown = [picture[::2, ::2] for picture in (pictures["rays"], *(pictures[name] for name in SHOWN))]
    return {"settings": found, "diagonal": scene.diagonal}, shown


def _soft(scene: Scene, caster: RayCaster, light: Light, gbuffer: GBuffer) -> Tensor:
    """What 64 rays find of the light, or, of one without area, of the disc that filter "pcss" takes it for."""
    if isinstance(light, RectLight):
        return traced_visibility(caster, light, gbuffer, samples=8)
    options = options_for(light, scene, ShadowOptions(filter="pcss"))
    assert options.light_width is not None
    width = options.light_width
    if isinstance(light, DirectionalLight):
        width = 2.0 * math.tan(math.radians(options.light_angle_deg) / 2)
    return disc_visibility(caster, light, gbuffer, width, disc_points(64))
