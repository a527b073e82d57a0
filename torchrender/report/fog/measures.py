"""What the study measures: figures asked by the specification beside those found."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.photo.fog.air import Air
from torchrender.photo.fog.indoor import known_room
from torchrender.photo.fog.options import FogMedium, FogOptions
from torchrender.photo.fog.room.proxy import Prism, build_proxy
from torchrender.photo.fog.room.sun import angle, cast, fit_sun
from torchrender.photo.fog.room.transport import arriving
from torchrender.photo.fog.room_fog import RoomFog
from torchrender.report.fog.cornell import (
    Box,
    Truth,
    bounced_ratio,
    cornell,
    method,
    psnr,
    reference,
    wavy,
    way,
    with_albedo,
)
from torchrender.scene.camera import Cameras

KAPPA = 0.1
PATCH_LIMIT = 0.05
"""Extinction times the diameter of a patch of the light."""
CENTROID_CASES = ((0.5, 0.1), (0.5, 0.4), (1.0, 0.1), (1.5, 0.4), (2.5, 0.4))
PUBLISHED = {(0.5, 0.1): (0.2, 0.6), (0.5, 0.4): (1.0, 2.5), (1.0, 0.1): (0.8, 1.9), (1.5, 0.4): (7.8, 13.0),
             (2.5, 0.4): (16.0, 21.0)}  # fmt: skip
"""Mean errors of the centroid in percent, homogeneous and heterogeneous, as the specification has them."""


def verification(box: Box, varied: bool, truth: Truth) -> list[dict[str, Any]]:
    """Errors of transmittance and composite for every way, and for every baseline."""
    rows = []
    for name in ("centroid", "patches", "ratio"):
        through, added = method(box, KAPPA, varied, name, patch_limit=PATCH_LIMIT)
        error = ((through[..., 0] - truth.transmittance).abs() / truth.transmittance)[truth.lit]
        rows.append({
            "way": name, "varied": varied, "mean": float(error.mean()), "most": float(error.quantile(0.999)),
            "max": float(error.max()), "psnr": psnr(truth.clear * through + added, truth.foggy),
            "V": float((added - truth.scattered).abs().mean() / truth.scattered.mean()),
        })  # fmt: skip
    through, added = method(box, KAPPA, varied, "patches", patch_limit=PATCH_LIMIT)
    for name, picture in baselines(box, truth, added).items():
        rows.append({"way": name, "varied": varied, "psnr": psnr(picture, truth.foggy)})
    return rows


def baselines(box: Box, truth: Truth, added: Tensor) -> dict[str, Tensor]:
    """Pictures (H,W,3) by simpler models, each with the airlight or veil that fits the truth best."""
    length = box.scene().ray_length.float()
    left = torch.exp(-KAPPA * length)[..., None]
    veil = 1.0 - left
    airlight = ((truth.foggy - truth.clear * left) * veil).sum(dim=(0, 1)) / veil.square().sum()
    flat = (truth.foggy - truth.clear).mean(dim=(0, 1))
    share = torch.stack([
        ((truth.clear[..., k] * (truth.foggy[..., k] - flat[k])).sum() / truth.clear[..., k].square().sum())
        for k in range(3)
    ]).clamp(0.0, 1.0)  # fmt: skip
    even = (truth.foggy - truth.clear * share).mean(dim=(0, 1))
    bright = truth.clear.reshape(-1, 3).quantile(0.99, dim=0)
    return {
        "depth fog, best airlight": truth.clear * left + airlight * veil,
        "depth fog, airlight of the photo's brightest": truth.clear * left + bright * veil,
        "depth fog, best airlight, no light lost on its way": truth.clear * left + added,
        "uniform veil, best": truth.clear * share + even,
    }


def proxies(box: Box, truth: Truth) -> float:
    """PSNR with cuboids a tenth too large and turned back straight in place of the true boxes."""
    prisms = []
    for first in (6, 11):
        rows = (box.proxy.face_part >= first) & (box.proxy.face_part < first + 5)
        points = box.proxy.vertices[box.proxy.faces[rows].reshape(-1)]
        low, high = points.amin(dim=0), points.amax(dim=0)
        middle, half = (low + high) / 2, (high - low) / 2 * 0.9
        a, b = middle - half, middle + half
        base = torch.tensor([[a[0], 0, a[2]], [b[0], 0, a[2]], [b[0], 0, b[2]], [a[0], 0, b[2]]], dtype=torch.float64)
        prisms.append(Prism(base, float(high[1]) * 0.95))
    proxy = build_proxy(box.room, prisms)
    scene = known_room(box.room, proxy, (box.light,), box.scene().radiance, box.albedo.mean(dim=1))
    fog = RoomFog(scene, FogOptions(transmittance="patches", columns=96, steps=64))
    medium = FogMedium.of(scattering=KAPPA)
    return psnr(truth.clear * fog.transmittance(medium) + fog.scattered(medium), truth.foggy)


def centroid_errors(count: int, sides: tuple[int, ...] = (1,)) -> list[dict[str, Any]]:
    """Mean relative error of T of lights by one or more centres, on the walls and the floor of an empty box."""
    rows = []
    for half, kappa in CENTROID_CASES:
        box = cornell(32, 24, half=half, boxes=False)
        place, normal = _on_surfaces(box, count)
        air = Air(None, box.room.low, box.room.high)
        fine = arriving(box.light, box.proxy, air, place, normal, 16)
        samples, _ = box.light.samples(16)
        for varied in (False, True):
            ways = way(samples[None].expand(count, -1, 3), place[:, None].expand(-1, len(samples), 3), varied, 16)
            exact = (fine.weight * torch.exp(-kappa * ways)).sum(dim=1) / fine.weight.sum(dim=1)
            for side in sides:
                centres, _ = box.light.samples(side)
                to = way(centres[None].expand(count, -1, 3), place[:, None].expand(-1, len(centres), 3), varied, 16)
                part = arriving(box.light, box.proxy, air, place, normal, side).weight
                share = part / part.sum(dim=1, keepdim=True).clamp_min(1e-20)
                found = (share * torch.exp(-kappa * to)).sum(dim=1) if side > 1 else torch.exp(-kappa * to[:, 0])
                error = (found - exact).abs() / exact
                rows.append({"half": half, "kappa": kappa, "varied": varied, "patches": side,
                             "mean": float(error.mean()), "max": float(error.max())})  # fmt: skip
    return rows


def _on_surfaces(box: Box, count: int) -> tuple[Tensor, Tensor]:
    """Places on the four walls and the floor."""
    random = torch.Generator().manual_seed(3)
    side = torch.randint(0, 5, (count,), generator=random)
    u = torch.rand(count, 3, generator=random, dtype=torch.float64)
    place = box.room.low + u * (box.room.high - box.room.low)
    normal = torch.zeros(count, 3, dtype=torch.float64)
    for number, (axis, high) in enumerate(((0, False), (0, True), (1, False), (2, False), (2, True))):
        rows = side == number
        place[rows, axis] = float((box.room.high if high else box.room.low)[axis])
        normal[rows, axis] = -1.0 if high else 1.0
    return place + 1e-6 * normal, normal


def indirect(width: int, height: int, samples: int) -> list[dict[str, Any]]:
    """By how much T of the centre, and T by the ratio, miss the survival of all light, four bounces included."""
    box = with_albedo(cornell(width, height, boxes=False), 0.7)
    rows = []
    for kappa in (0.05, 0.1, 0.2):
        eye = torch.exp(-kappa * box.scene().ray_length.float())
        true = bounced_ratio(box, kappa, samples=samples) * eye
        lit = ~box.scene().glowing
        row: dict[str, Any] = {"kappa": kappa}
        for name, bounces in (("centroid", 0), ("ratio", 4)):
            through, _ = _transmittance(box, kappa, name, bounces)
            error = ((through - true) / true)[lit]
            row[name], row[f"{name}_bias"] = float(error.abs().mean()), float(error.mean())
        rows.append(row)
    return rows


def _transmittance(box: Box, kappa: float, name: str, bounces: int) -> tuple[Tensor, float]:
    options = FogOptions(transmittance=name, bounces=bounces, paths=128, columns=32)
    begin = time.perf_counter()
    found = RoomFog(box.scene(), options).transmittance(FogMedium.of(scattering=kappa))[..., 0]
    return found, time.perf_counter() - begin


def sun_errors(runs: int, angle_weight: float = 1.0) -> dict[str, float]:
    """Direction and overlap of two windows with 6 cm noise at their corners and 8 cm at the lit ones, 640 x 480."""
    camera = Cameras.look_at((2.5, 1.6, 4.5), (1.2, 0.6, 0.0), width=640, height=480, fov_deg=65.0)
    truth = torch.nn.functional.normalize(torch.tensor([0.75, -0.6, 0.3], dtype=torch.float64), dim=0)
    windows = [
        torch.tensor([[0, 0.9, z], [0, 0.9, z + 1.0], [0, 2.1, z + 1.0], [0, 2.1, z]], dtype=torch.float64)
        for z in (0.2, 1.8)
    ]
    random = torch.Generator().manual_seed(7)
    found: list[tuple[float, ...]] = []
    for _ in range(runs):
        pairs = []
        for window in windows:
            noise = 0.06 * torch.randn(window.shape, generator=random, dtype=torch.float64)
            noise[:, 0] = 0.0
            lit = cast(window, truth, 0.0)
            moved = 0.08 * torch.randn(lit.shape, generator=random, dtype=torch.float64)
            moved[:, 1] = 0.0
            pairs.append((window + noise, lit + moved))
        fit = fit_sun(pairs, camera, angle_weight=angle_weight)
        found.append((math.degrees(float(angle(fit.start[None], truth)[0])),
                      math.degrees(float(angle(fit.direction[None], truth)[0])), fit.start_iou, fit.iou))  # fmt: skip
    start, end, start_iou, iou = np.mean(found, axis=0)
    return {"start_deg": float(start), "deg": float(end), "start_iou": float(start_iou), "iou": float(iou)}


def halo() -> float:
    """Scattered light around a lamp in view over the picture's median."""
    box = cornell(160, 120)
    camera = Cameras.look_at((0.0, 2.75, -0.02), (0.0, 3.6, -5.5), width=160, height=120, fov_deg=80.0)
    room = type(box.room)(box.room.low, box.room.high, camera, 0.0)
    small = torch.tensor([[-0.15, 5.5, -4.2], [0.15, 5.5, -4.2], [0.15, 5.5, -3.9], [-0.15, 5.5, -3.9]],
                         dtype=torch.float64)  # fmt: skip
    pixels = camera.project(small)[0][0]
    light = type(box.light)(small, box.light.normal, "lamp", tuple((float(u), float(v)) for u, v in pixels))
    scene = known_room(room, box.proxy, (light,), torch.tensor([[400.0, 400.0, 400.0]]), box.albedo.mean(dim=1))
    added = RoomFog(scene, FogOptions(columns=96)).scattered(FogMedium.of(scattering=KAPPA))[..., 1]
    v, u = torch.meshgrid(torch.arange(120) + 0.5, torch.arange(160) + 0.5, indexing="ij")
    near = (u - pixels[:, 0].mean()) ** 2 + (v - pixels[:, 1].mean()) ** 2 <= (30 * 160 / 640) ** 2
    return float(added[near].mean() / added.median())


def means_by_kappa(box: Box) -> list[dict[str, float]]:
    """Mean T and V of the box against extinction, and the time for each after the first."""
    fog = RoomFog(box.scene(), FogOptions(columns=64))
    fog.transmittance(FogMedium.of(scattering=0.01)), fog.scattered(FogMedium.of(scattering=0.01))
    rows = []
    for kappa in (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 2.0):
        medium = FogMedium.of(scattering=kappa)
        begin = time.perf_counter()
        through = fog.transmittance(medium)
        middle = time.perf_counter()
        added = fog.scattered(medium)
        rows.append({"kappa": kappa, "T": float(through.mean()), "V": float(added.mean()),
                     "T_ms": 1e3 * (middle - begin), "V_ms": 1e3 * (time.perf_counter() - middle)})  # fmt: skip
    return rows


__all__ = ["KAPPA", "PUBLISHED", "centroid_errors", "halo", "indirect", "means_by_kappa", "proxies", "reference",
           "sun_errors", "verification", "wavy"]  # fmt: skip
