"""Measure shadow maps against shadow rays: ``python -m torchrender.report.shadow_maps [--quick]``.

Writes ``docs/results/shadow-maps.md``, ``.json`` and ``.jpg``: time of map and lookup, wrong pixels, contact
displacement and memory by filter, bias and map size.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.shadows.shadow_map import ShadowOptions, light_visibility, options_for, render_shadow_map
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.images.files import write_atomically
from torchrender.numerics.shadow_compare import disc_points
from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.command import study_parser
from torchrender.report.shadow_maps.quality import contact_displacement, disc_visibility, shadow_errors
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
SHOWN = ("bilinear", "pcf 5 x 5", "pcss", "edges by the map, whole scene: bilinear")


def main() -> None:
    """Run every case and write the page."""
    arguments = study_parser(__doc__, quick="small images and few runs, to check that it works").parse_args()
    width, height, runs = (96, 72, 1) if arguments.quick else (480, 360, 5)
    record: dict[str, Any] = {"machine": machine_record(), "size": [width, height], "cases": {}}
    rows = []
    for name, index in CASES:
        scene = terrain(64 if arguments.quick else 256) if name == "terrain" else build(name)
        light = scene.lights[index]
        sys.stderr.write(f"{name}: {light.name}\n")
        measured, pictures = measure(scene, light, (width, height), runs)
        record["cases"][f"{name}, {light.name}"] = measured
        rows.append(torch.cat(pictures, dim=1))
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_record(arguments.output / "shadow-maps.json", record)
    write_text(arguments.output / "shadow-maps.md", page(record))
    picture = Picture.fromarray((torch.cat(rows) * 255).to(torch.uint8).numpy())
    write_atomically(arguments.output / "shadow-maps.jpg", lambda p: picture.save(p, format="JPEG", quality=88))
    sys.stderr.write(f"wrote {arguments.output / 'shadow-maps.md'}\n")


def measure(scene: Scene, light: Light, size: tuple[int, int], runs: int) -> tuple[dict[str, Any], list[Tensor]]:
    """Figures of every setting for one light, and pictures of the ray reference and of some settings."""
    gbuffer = rasterize(scene, scene.camera(width=size[0], height=size[1]))
    caster = RayCaster(scene.geometry)
    hard, soft = traced_visibility(caster, light, gbuffer), _soft(scene, caster, light, gbuffer)
    facing = gbuffer.covered & _faces(light, gbuffer)
    found, pictures = {}, [soft[0]]
    for name, options in SETTINGS.items():
        reference = soft if options.filter == "pcss" else hard
        follows = gbuffer if options.coverage == "view" else None
        shadow_map = render_shadow_map(scene, light, options, gbuffer=follows)
        timings = take_turns(
            {
                "map": partial(render_shadow_map, scene, light, options, gbuffer=follows),
                "lookup": partial(light_visibility, scene, light, gbuffer, options, shadow_map),
            },
            runs=runs,
        )
        seen = light_visibility(scene, light, gbuffer, options, shadow_map)
        errors = shadow_errors(seen, reference, facing)
        moved = contact_displacement(gbuffer, light, shadow_map, options)
        found[name] = {
            "map_ms": timings["map"].record(),
            "lookup_ms": timings["lookup"].record(),
            "false_shadow": errors.false_shadow,
            "false_light": errors.false_light,
            "mean_error": errors.mean_error,
            "acne": errors.acne,
            "kept": errors.kept,
            "penumbra": errors.penumbra,
            "views": len(shadow_map.cameras),
            "contact_displacement_p95": float(moved[facing].quantile(0.95)) if bool(facing.any()) else 0.0,
            "map_mib": shadow_map.depth.numel() * 4 / 2**20,
        }
        if name in SHOWN:
            pictures.append(seen[0])
    return {
        "settings": found,
        "diagonal": scene.diagonal,
    }, pictures


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


def _faces(light: Light, gbuffer: GBuffer) -> Tensor:
    """Pixels whose surface is not turned away from the light's centre, on the side to which a rectangle sends."""
    place = light.centre if isinstance(light, RectLight) else getattr(light, "position", None)
    if place is None:
        return (gbuffer.geometric_normal @ -light.direction) > 0  # type: ignore[union-attr]
    toward = place.double() - gbuffer.position
    facing = (toward * gbuffer.geometric_normal.double()).sum(-1) > 0
    return facing & ((toward @ -light.normal.double()) > 0) if isinstance(light, RectLight) else facing


def page(record: dict[str, Any]) -> str:
    """The page in Markdown."""
    width, height = record["size"]
    lines = [
        "# Shadow maps, measured",
        "",
        f"`python -m torchrender.report.shadow_maps` on {machine_line(record['machine'])}",
        f"Image {width} × {height}; maps 1024² where nothing else is said. Wrong pixels: shares of the pixels",
        "that face the light, dark or lit by over a half against one shadow ray each; of pcss against 64 rays to the",
        "light's area, or to the disc that pcss takes a light without area for: the sun's 0.53°, lamps a twentieth of",
        "the scene's diagonal.",
        "Acne: false shadow farther than two pixels from any true edge. Kept: share of the true shadow that is dark.",
        "Penumbra: mean error where the reference is neither lit nor dark, which one ray never is.",
        "Contact displacement: how far the bias of the map alone may move a contact, 95th percentile, share of the",
        "diagonal. Maps follow the view, and triangles settle their edges, unless a row says otherwise; constant",
        "biases are those that a user would tune.",
        "",
        "![per row: rays, bilinear, pcf, pcss, bilinear of the whole scene with edges by the map](shadow-maps.jpg)",
        "",
    ]
    for case, row in record["cases"].items():
        lines += [
            f"## {case}",
            "",
            "| setting | map ms | lookup ms | false shadow | false light | acne | kept | mean error ",
        ]
        lines[-1] += "| penumbra | contact displacement | views | map MiB |"
        lines.append("|---|---|---|---|---|---|---|---|---|---|---|---|")
        for name, s in row["settings"].items():
            lines.append(
                f"| {name} | {s['map_ms']['median']:.1f} | {s['lookup_ms']['median']:.1f} "
                f"| {100 * s['false_shadow']:.3f} % | {100 * s['false_light']:.3f} % | {100 * s['acne']:.3f} % "
                f"| {100 * s['kept']:.2f} % | {s['mean_error']:.4f} | {s['penumbra']:.4f} "
                f"| {100 * s['contact_displacement_p95'] / row['diagonal']:.3f} % | {s['views']} | {s['map_mib']:.0f} |"
            )
        pair = ("edges by the map: none", "edges by the map: bilinear")
        none, bilinear = (row["settings"][n]["lookup_ms"]["median"] for n in pair)
        lines += ["", f"Lookup cost bilinear / none: {bilinear / none:.2f} (published, shader path: 1.45–1.47).", ""]
    return "\n".join(lines)
