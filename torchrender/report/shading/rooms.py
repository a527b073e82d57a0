"""Ambient visibility in rooms: pictures by the search in depth images beside pictures by rays, and what both take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from torchrender.effects.ambient.options import AmbientOptions
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.metrics import flip, psnr
from torchrender.renderer import render
from torchrender.scene.load import load

ROOMS = ("living_room", "washroom", "hall")
RAYS = 256


def ambient_rooms(names: Sequence[str], side: int, runs: int) -> list[dict[str, Any]]:
    """FLIP of whole pictures without mirrors, error of the visibility itself, and times of the pass."""
    plain = RenderOptions(reflections="off", buffers=(AMBIENT_VISIBILITY.name,))
    by_rays = replace(plain, ambient_visibility="traced", ambient=AmbientOptions(rays=RAYS, ray_spacing=1))
    rows = []
    for name in names:
        scene = load(name)
        wanted = render(scene, width=side, height=side, options=by_rays)
        found = [render(scene, width=side, height=side, options=plain) for _ in range(1 + runs)]
        none = render(scene, width=side, height=side, options=replace(plain, ambient_visibility="off", buffers=()))
        reference, covered = wanted.displayed(), wanted.gbuffer.covered
        own, exact = (one.buffers[AMBIENT_VISIBILITY.name] for one in (found[0], wanted))
        times = sorted(one.timings_ms[AMBIENT_VISIBILITY.name] for one in found[1:])
        rows.append(
            {
                "room": name,
                "flip": float(flip(found[0].displayed(), reference)),
                "psnr": float(psnr(found[0].displayed(), reference)),
                "without": float(flip(none.displayed(), reference)),
                "near": float((own.near - exact.near).abs()[covered].mean()),
                "sky": float((own.sky - exact.sky).abs()[covered].mean()),
                "ms": times[len(times) // 2],
                "rays_ms": wanted.timings_ms[AMBIENT_VISIBILITY.name],
            }
        )
    return rows
