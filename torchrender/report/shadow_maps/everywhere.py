"""Wrong shadow of every filter on every built-in scene, and how much of a small box's shadow large grounds keep."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.shadows.options import FILTERS, ShadowOptions
from torchrender.effects.shadows.shadow_map import light_visibility
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.shadow_maps.quality import faces, shadow_errors
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural import NAMES, build
from torchrender.scene.shapes import box, quad

EDGE_FILTERS = tuple(name for name in FILTERS if name not in ("pcss", "average_depth"))
"""Those whose truth is one ray: the others take the light for wider than a point, or settle no edges."""
GROUNDS = ((100.0, 0.0), (1000.0, 0.0), (10_000.0, 0.0), (10_000.0, 5_000_000.1))
"""Metres of ground's side, and how far from the origin it lies."""
BOX_SIDE = 0.6
_SUN = (0.5, -1.0, 0.3)


def wrong_everywhere(width: int, height: int) -> dict[str, dict[str, dict[str, float]]]:
    """For each built-in scene and filter, the worst of its lights: false shadow, false light and acne as shares."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for name in NAMES:
        scene = build(name)
        view, caster = rasterize(scene, scene.camera(width=width, height=height)), RayCaster(scene.geometry)
        worst = {way: dict.fromkeys(("false_shadow", "false_light", "acne"), 0.0) for way in EDGE_FILTERS}
        for light in scene.lights:
            truth, facing = traced_visibility(caster, light, view), view.covered & faces(light, view)
            for way, row in worst.items():
                errors = shadow_errors(light_visibility(scene, light, view, ShadowOptions(filter=way)), truth, facing)
                for kind in row:
                    row[kind] = max(row[kind], float(getattr(errors, kind)))
        found[name] = worst
    return found


def box_on_ground(side: float, place: float, pixels: int) -> dict[str, float]:
    """Share of a box's true shadow on the ground that is dark, by default and traced, against the closed form.

    The truth shares nothing with maps or rays: the sun's line from the point where a pixel's ray meets the plane
    against the slabs of the box, in float64.
    """
    scene, camera = ground_scene(side, place, pixels)
    view, light = rasterize(scene, camera), scene.lights[0]
    truth, ground = _slab_shadow(view, place)
    traced = traced_visibility(RayCaster(scene.geometry), light, view)
    row = {"side": side, "place": place}
    for way, visibility in (("default", light_visibility(scene, light, view, ShadowOptions())), ("traced", traced)):
        errors = shadow_errors(visibility, truth, ground)
        row |= {f"{way} kept": errors.kept, f"{way} false": errors.false_shadow}
    return row


def ground_scene(side: float, place: float, pixels: int) -> tuple[Scene, Cameras]:
    """A box of 0.6 m in the middle of a square ground, seen from three metres away, under a sun."""
    middle = torch.tensor([place, 0.0, place], dtype=torch.float64)
    corner = middle + torch.tensor([-side / 2, 0.0, side / 2], dtype=torch.float64)
    ground = quad(corner, torch.tensor([side, 0.0, 0.0]), torch.tensor([0.0, 0.0, -side]))
    cube = box(torch.full((3,), BOX_SIDE))
    up = torch.tensor([0.0, BOX_SIDE / 2, 0.0], dtype=torch.float64)
    cube = replace(cube, vertices=cube.vertices.double() - cube.vertices.double().mean(0) + middle + up)
    sun = DirectionalLight(direction=torch.tensor(_SUN), irradiance=torch.ones(3))
    eye = middle + torch.tensor([1.2, 2.0, 2.2], dtype=torch.float64)
    camera = Cameras.look_at(eye, middle, width=pixels, height=pixels, fov_deg=45.0, near=0.01)
    return Scene(meshes=(ground, cube), lights=(sun,)), camera


def _slab_shadow(view: GBuffer, place: float) -> tuple[Tensor, Tensor]:
    """Light (1,H,W) that the closed form gives the ground, and where the ground is seen."""
    origins, directions = (a.double() for a in view.cameras.rays())
    ground = view.covered & (view.object_id == 0)
    hit = origins - directions * (origins[..., 1:2] / directions[..., 1:2])
    middle = torch.tensor([place, BOX_SIDE / 2, place], dtype=torch.float64)
    toward = -torch.tensor(_SUN, dtype=torch.float64)
    ends = torch.stack([(middle - hit + s * BOX_SIDE / 2) / toward for s in (-1.0, 1.0)])
    enter, leave = ends.amin(0).amax(-1), ends.amax(0).amin(-1)
    return ((enter >= leave) | (leave <= 0)).float(), ground
