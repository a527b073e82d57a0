"""What each setting of a picture's shadows costs and brings: spheres, terms, levels, pixels per point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.sky_shadows.light import prepare_light
from torchrender.effects.sky_shadows.occluder import chosen_meshes, occluder_of
from torchrender.effects.sky_shadows.options import SkyLightOptions, SkyShadowOptions
from torchrender.effects.sky_shadows.picture import light_left
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.all_frequency.accuracy import OFFSET
from torchrender.report.all_frequency.stage import errors
from torchrender.report.all_frequency.ways import mesh_bits, texel_sum
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

LOOKED_AT, SEARCHED = 1500, 12_000
"""Pixels of the floor at which rays are traced; and of which those close to the figure are taken as well."""

SHADED = 0.02
"""Share of the light that is missing at least in a shadow."""

CONTACT = 0.08
"""Height of the figure within which a pixel of the floor is close to it."""


@dataclass(frozen=True, eq=False)
class _Floor:
    """Pixels of the floor, and what rays into the meshes tell of them."""

    gbuffer: GBuffer
    rows: Tensor  # (N,) in the flat picture; the first LOOKED_AT are drawn from all of the floor
    wanted: Tensor  # (N,3) share of the light that is left
    shaded: Tensor  # (N,) bool
    close: Tensor  # (N,) bool


def settings_of(scene: Scene, camera: Cameras, tall: float, runs: int) -> list[dict[str, Any]]:
    """A row for each way off the usual settings: milliseconds, and errors in percent against rays into the meshes.

    Args:
        scene: an object ``tall`` on a floor at one time of its animation, seen by one camera.
    """
    usual = SkyShadowOptions()
    ways = {f"usual: {usual.sphere.spheres} spheres, {_told(usual)}": usual}
    for count in (16, 32, 128):
        ways[f"{count} spheres"] = replace(usual, sphere=replace(usual.sphere, spheres=count))
    ways["fitted longer (20 teleports)"] = replace(usual, sphere=replace(usual.sphere, teleports=20))
    for terms in (50, 1000):
        ways[f"{terms} terms"] = replace(usual, light=replace(usual.light, terms=terms))
    ways["one level"] = replace(usual, light=replace(usual.light, levels=1))
    for spacing in (1, 3, 4):
        ways[f"a point for {spacing} x {spacing} pixels"] = replace(usual, spacing=spacing)
    ways["exact caps"] = replace(usual, light=replace(usual.light, direct_bits=True))
    floor = _floor(scene, camera, tall)
    work = {name: _work(scene, floor, way) for name, way in ways.items()}
    took = take_turns(work, runs=runs, warm_up=1)
    return [{"name": name, "ms": took[name].least, **_errors(work[name](), floor)} for name in ways]


def _told(options: SkyShadowOptions) -> str:
    spacing = options.spacing
    return f"{options.light.terms} terms, {options.light.levels} levels, a point for {spacing} x {spacing} pixels"


def _work(scene: Scene, floor: _Floor, options: SkyShadowOptions) -> Any:
    occluder = occluder_of(scene, chosen_meshes(scene, options.occluders), options.sphere)
    assert occluder is not None and scene.environment is not None
    light = prepare_light(scene.environment, options.light)
    return lambda: light_left(scene, floor.gbuffer, occluder, light, options.spacing)


def _floor(scene: Scene, camera: Cameras, tall: float) -> _Floor:
    gbuffer = rasterize(scene, camera)
    ground = len(scene.materials) - 1
    rows = (gbuffer.material == ground).reshape(-1).nonzero().reshape(-1)
    rows = rows[torch.randperm(len(rows), generator=torch.Generator().manual_seed(0))[:SEARCHED]]
    figure = torch.cat([m.vertices.double() for m in scene.meshes if m.material != ground])
    flat = gbuffer.position.reshape(-1, 3)
    close = (
        torch.cat([torch.cdist(flat[some].double(), figure).amin(dim=1) for some in rows.split(256)]) < CONTACT * tall
    )
    taken = close | (torch.arange(len(rows)) < LOOKED_AT)
    rows, close = rows[taken], close[taken]
    points, normals = flat[rows], gbuffer.normal.reshape(-1, 3)[rows]
    assert scene.environment is not None
    light = prepare_light(scene.environment, SkyLightOptions())
    hidden = mesh_bits(RayCaster(scene.geometry), points, normals, OFFSET * tall)
    wanted = texel_sum(hidden, normals, light)
    whole = texel_sum(torch.zeros(1, *hidden.shape[1:], dtype=torch.bool), normals[:1], light)
    share = wanted / whole.clamp_min(1e-30)
    return _Floor(gbuffer, rows, share, (1.0 - share).amax(dim=1) > SHADED, close)


def _errors(left: Tensor, floor: _Floor) -> dict[str, float]:
    found = left.reshape(-1, 4)[floor.rows, :3].double()
    one = torch.ones(3, dtype=torch.float64)
    drawn = torch.arange(len(floor.rows)) < LOOKED_AT
    parts = {"all": drawn, "shaded": drawn & floor.shaded, "close": floor.close}
    return {name: errors(found[some], floor.wanted[some], one)["rms"] for name, some in parts.items()}
