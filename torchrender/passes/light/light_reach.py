"""The pass ``light_reach``: which lights reach what is seen. Nobody makes shadows of the others."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from torchrender.buffers import RaySurface
from torchrender.effects.shadows.light_reach import LightReach, light_reach
from torchrender.effects.shadows.small_lights import FEWEST, small_lights
from torchrender.passes.contract import Amounts, Pass
from torchrender.passes.hard import HardEffect, Law, Outputs, Subject, no_lights
from torchrender.passes.outlook import Outlook, Verdict, counted, no_shadows
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.scene.light import RectLight
from torchrender.shade import shade

LIGHT_REACH = Buffer("light_reach", LightReach)
"""By light and picture, and the lights of every tile of pixels."""

POINT_LIGHTS, AREA_LIGHTS = "point lights in view", "area lights in view"
"""Quantities that are known after this pass."""
POINT_LISTED, AREA_LISTED = "point lights of a tile", "area lights of a tile"
"""Means over the tiles."""
SMALL_LIGHTS = "point lights by rays"
"""Those that reach so little that they take rays, where others take maps."""


def applies(outlook: Outlook) -> Verdict:
    """Some light may cast shadows: which of them matter is worth knowing."""
    nothing = no_shadows(outlook)
    if nothing is not None:
        return nothing
    if isinstance(outlook.samples, RaySurface) and outlook.point_lights < FEWEST:
        return Verdict(False, "rays end anywhere, and lights are few: any may reach them")
    total = len(outlook.scene.lights)
    reaching = lights_in_view(outlook)
    if reaching is None:
        return Verdict(True, f"{counted(total, 'light')}: shadows are made of those that reach what is seen")
    if reaching == total:
        return Verdict(True, f"{'the light reaches' if total == 1 else f'all {total} lights reach'} what is seen")
    return Verdict(True, f"{total - reaching} of {counted(total, 'light')} reach nothing in view")


def lights_in_view(outlook: Outlook) -> int | None:
    """How many lights reach what is seen, once that is known."""
    point, area = outlook.known.get(POINT_LIGHTS), outlook.known.get(AREA_LIGHTS)
    return None if point is None or area is None else int(point + area)


def run(frame: Frame) -> LightReach:
    """Lights that reach what is seen."""
    return light_reach(frame.scene, frame[GBUFFER])


def checkpoint(frame: Frame) -> Mapping[str, float]:
    """How many lights reach what is seen, and a tile of it: where none does, no shadows are made."""
    reach, lights = frame[LIGHT_REACH], frame.scene.lights
    reaching = reach.any
    wide = torch.tensor([isinstance(light, RectLight) for light in lights], dtype=torch.bool)
    area, tiles = int((reaching & wide).sum()), max(len(reach.starts) - 1, 1)
    listed = int(wide[reach.lights.long()].sum())
    seen = {n: light for n, light in enumerate(lights) if reaching[n]}
    return {
        POINT_LIGHTS: float(int(reaching.sum()) - area),
        AREA_LIGHTS: float(area),
        POINT_LISTED: (len(reach.lights) - listed) / tiles,
        AREA_LISTED: listed / tiles,
        SMALL_LIGHTS: float(len(small_lights(reach, seen, frame.options.shadow))),
    }


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; lights times pixels."""
    return (1.0, outlook.pixels, len(outlook.scene.lights) * outlook.pixels)


def _reach(subject: Subject) -> Outputs:
    found = light_reach(subject.scene, subject.gbuffer)
    return {"reaches": found.reaches, "lights": found.starts.diff()}


def _dark(subject: Subject, _: Outputs) -> float:
    """Light that lights in no list of a pixel's tile bring, as a share of the brightest pixel."""
    scene, seen = subject.scene, subject.gbuffer
    found = light_reach(scene, seen, side=1)
    listed = torch.zeros(seen.material.numel(), len(scene.lights))
    rows = torch.repeat_interleave(torch.arange(seen.material.numel()), found.starts.diff())
    listed[rows, found.lights.long()] = 1.0
    lists = listed.T.reshape(len(scene.lights), *seen.material.shape).movedim(0, 1).contiguous()
    every, chosen = shade(scene, seen), shade(scene, seen, lists)
    return float((every - chosen).abs().max() / every.abs().max().clamp_min(1e-30))


HARD = HardEffect(
    name="light_reach",
    modules=("effects.shadows.light_reach",),
    run=_reach,
    bounds=lambda _: {},
    law=Law(
        text="a light that is not in a pixel's list brings it nothing: largest difference, of the brightest pixel",
        deviation=_dark,
        limit=1e-5,
    ),
    skip=no_lights,
)

PASS = Pass(
    name="light_reach",
    summary="finds the lights that reach what is seen",
    makes=LIGHT_REACH,
    needs=(GBUFFER,),
    applies=applies,
    run=run,
    amounts=amounts,
    checkpoint=checkpoint,
    hard=(HARD,),
)
