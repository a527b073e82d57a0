"""An armchair turns in its room: time per picture, and how far pictures are from those of a scene built anew."""

from __future__ import annotations

import math
import time
from statistics import median
from typing import Any

import torch
from torch import Tensor

from torchrender.image import Image
from torchrender.pipeline.history import RenderHistory
from torchrender.renderer import render
from torchrender.scene.load import load
from torchrender.scene.model import Scene

WIDTH, HEIGHT = 320, 240
NAME = "armchair"


def turned(middle: Tensor, angle: float) -> Tensor:
    """(4,4) turn by ``angle`` radians about the upright axis through a point (3,)."""
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[0, 0] = matrix[2, 2] = math.cos(angle)
    matrix[0, 2], matrix[2, 0] = math.sin(angle), -math.sin(angle)
    matrix[:3, 3] = middle - matrix[:3, :3] @ middle
    return matrix


def measured(triangles: int, frames: int, checked: int) -> dict[str, Any]:
    """Milliseconds of each picture of a sequence, of each pass, and beside ``checked`` pictures made alone."""
    room = load("living_room", size=triangles)
    camera = room.camera(width=WIDTH, height=HEIGHT)
    middle = Scene(meshes=room.parts(NAME), materials=room.materials).bounds.mean(0)
    history = RenderHistory()
    times, alone, passes, errors = [], [], [], []
    for number in range(frames):
        begin = time.perf_counter()
        scene = room.moved(NAME, turned(middle, 0.5 * number / frames))
        image = render(scene, camera, history=history)
        times.append(1e3 * (time.perf_counter() - begin))
        assert image.history is not None
        history = image.history
        passes.append(image.timings_ms)
        if number in _chosen(frames, checked):
            fresh = scene.replace(name="living_room")  # with nothing that was found out before
            begin = time.perf_counter()
            other = render(fresh, camera)
            alone.append(1e3 * (time.perf_counter() - begin))
            errors.append(_difference(image, other))
    names = {name for one in passes[3:] for name in one} - {"total"}
    return {
        "triangles": room.geometry.triangle_count,
        "moving": sum(len(mesh.faces) for mesh in room.parts(NAME)),
        "frames": frames,
        "first_ms": times[:3],
        "median_ms": median(times[3:]),
        "longest_ms": max(times[3:]),
        "alone_ms": median(alone),
        "passes": {name: median([one.get(name, 0.0) for one in passes[3:]]) for name in sorted(names)},
        "mean_error": max(mean for mean, _ in errors),
        "visible": max(share for _, share in errors),
    }


def _chosen(frames: int, count: int) -> set[int]:
    return {round((k + 1) * (frames - 1) / count) for k in range(count)}


def _difference(first: Image, second: Image) -> tuple[float, float]:
    """Mean difference of display values, of 255, and the share of pixels that differ by more than 8."""
    apart = 255.0 * (first.to_srgb() - second.to_srgb()).abs().double()
    return float(apart.mean()), float((apart.amax(-1) > 8.0).double().mean())
