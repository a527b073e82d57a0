"""The verification experiment: a Cornell box with fog by a reference renderer, and by the method.

The reference shares geometry and camera with the method, but none of its integrals: it takes random samples of the
light and random steps, and evaluates the density's formula itself. Source: specification 12, section 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.photo.fog.indoor import RoomScene, known_room
from torchrender.photo.fog.options import FogMedium, FogOptions
from torchrender.photo.fog.room.calibrate import Room
from torchrender.photo.fog.room.emitters import Emitter, emitter_of
from torchrender.photo.fog.room.proxy import Prism, Proxy, Seen, build_proxy, look
from torchrender.photo.fog.room_fog import RoomFog
from torchrender.scene.camera import Cameras

SIDE = 5.5
LIGHT = (1.3, 1.05)
WHITE, RED, GREEN = (0.73, 0.73, 0.73), (0.61, 0.06, 0.06), (0.12, 0.44, 0.12)
RADIANCE = (24.0, 21.0, 17.0)
CELLS = 64
CHUNK = 1 << 19


@dataclass(frozen=True, eq=False)
class Box:
    """The scene."""

    room: Room
    proxy: Proxy
    light: Emitter
    albedo: Tensor  # (P,3)
    seen: Seen
    exact: bool = True

    def scene(self) -> RoomScene:
        """As the method sees it, with true geometry and light."""
        grey = self.albedo.mean(dim=1)
        return known_room(self.room, self.proxy, (self.light,), torch.tensor([RADIANCE]), grey)


def cornell(width: int, height: int, *, half: float | None = None, boxes: bool = True) -> Box:
    """The box, with a light of 1.3 x 1.05 m or a square one of half-width ``half``."""
    camera = Cameras.look_at(
        (0.0, SIDE / 2, -0.02), (0.0, SIDE / 2 - 0.3, -SIDE), width=width, height=height, fov_deg=68.0, near=0.001
    )
    low = torch.tensor([-SIDE / 2, 0.0, -SIDE], dtype=torch.float64)
    high = torch.tensor([SIDE / 2, SIDE, 0.0], dtype=torch.float64)
    room = Room(low, high, camera, 0.0)
    prisms = [_box(0.9, -2.0, 1.65, 1.65, 1.65, 17.0), _box(-0.9, -3.6, 1.65, 1.65, 3.3, -17.0)] if boxes else []
    proxy = build_proxy(room, prisms)
    a, b = (half, half) if half is not None else (LIGHT[0] / 2, LIGHT[1] / 2)
    corners = torch.tensor(
        [[-a, SIDE, -SIDE / 2 - b], [a, SIDE, -SIDE / 2 - b], [a, SIDE, -SIDE / 2 + b], [-a, SIDE, -SIDE / 2 + b]],
        dtype=torch.float64,
    )
    pixels = camera.project(corners)[0][0]
    light = emitter_of(corners, "ceiling", "light", tuple((float(u), float(v)) for u, v in pixels))
    albedo = torch.tensor([WHITE]).repeat(proxy.parts, 1)
    albedo[0], albedo[1] = torch.tensor(RED), torch.tensor(GREEN)
    return Box(room, proxy, light, albedo, look(proxy, room))


def _box(x: float, z: float, w: float, d: float, h: float, yaw: float) -> Prism:
    c, s = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    flat = [(-w / 2, -d / 2), (w / 2, -d / 2), (w / 2, d / 2), (-w / 2, d / 2)]
    base = [[x + c * p + s * q, 0.0, z - s * p + c * q] for p, q in flat]
    return Prism(torch.tensor(base, dtype=torch.float64), h)


def wavy(places: Tensor) -> Tensor:
    """(...) density at places (...,3), of the heterogeneous case; x and z count from a corner of the box."""
    x, y, z = places.unbind(dim=-1)
    x, z = x + SIDE / 2, z + SIDE
    return 1.0 + 0.9 * torch.sin(2.3 * x + 1.0) * torch.sin(2.9 * y) * torch.sin(2.1 * z + 0.5)


def wavy_grid(box: Box) -> Tensor:
    """The same as a grid over the room."""
    axes = [
        low + (torch.arange(CELLS, dtype=torch.float64) + 0.5) / CELLS * (high - low)
        for low, high in zip(box.room.low, box.room.high, strict=True)
    ]
    z, y, x = torch.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    return wavy(torch.stack([x, y, z], dim=-1)).float()


def way(start: Tensor, end: Tensor, varied: bool, steps: int = 24) -> Tensor:
    """(...) integral of the density between places."""
    length = (end - start).norm(dim=-1)
    if not varied:
        return length
    total = torch.zeros_like(length)
    for k in range(steps):
        total += wavy(start + (end - start) * ((k + 0.5) / steps))
    return total / steps * length


@dataclass(frozen=True, eq=False)
class Truth:
    """What the reference renders, direct light only."""

    clear: Tensor  # (H,W,3)
    transmittance: Tensor  # (H,W)
    scattered: Tensor  # (H,W,3)
    lit: Tensor  # (H,W) bool: something arrives, and it is no light

    @property
    def foggy(self) -> Tensor:
        """(H,W,3)."""
        return self.clear * self.transmittance[..., None] + self.scattered


def _on_light(box: Box, count: int, random: torch.Generator, cell: tuple[int, int] = (0, 1)) -> Tensor:
    """(count,3) random places on the light, or in one cell of so many a side."""
    number, side = cell
    u = torch.rand(count, 2, generator=random, dtype=torch.float64)
    u = (u + torch.tensor([number % side, number // side])) / side
    c = box.light.corners
    return c[0] + (c[1] - c[0]) * u[:, :1] + (c[3] - c[0]) * u[:, 1:]


def _from_light(
    box: Box, places: Tensor, normals: Tensor | None, random: torch.Generator, cell: tuple[int, int] = (0, 1)
) -> tuple[Tensor, Tensor]:
    """Weight at unit radiance and place on the light, one random sample for each place (N,3)."""
    target = _on_light(box, len(places), random, cell)
    offset = places - target
    length = offset.norm(dim=-1).clamp_min(1e-6)
    weight = (offset @ box.light.normal / length).clamp_min(0.0) * box.light.area / length.square()
    if normals is not None:
        weight = weight * (-(offset * normals).sum(dim=-1) / length).clamp_min(0.0)
    hidden = box.proxy.caster.occluded(places, target - places, t_min=1e-6, t_max=1 - 1e-6, cull_backfaces=True)
    return torch.where(hidden, 0.0, weight), target


def reference(box: Box, kappa: float, varied: bool, *, samples: int = 64, steps: int = 48, lights: int = 8) -> Truth:
    """Direct light and single scattering by random samples; scattering only, isotropic.

    Args:
        samples: of the light at every surface, one in each cell of a grid: fewer are taken if it is no square.
    """
    random = torch.Generator().manual_seed(1)
    h, w = box.seen.depth.shape
    place = (box.seen.place + 1e-6 * box.seen.normal).reshape(-1, 3)
    normal = box.seen.normal.reshape(-1, 3)
    clear, fog = torch.zeros(h * w, dtype=torch.float64), torch.zeros(h * w, dtype=torch.float64)
    side = math.isqrt(samples)
    for number in range(side * side):
        weight, target = _from_light(box, place, normal, random, (number, side))
        clear += weight / side**2
        fog += weight / side**2 * torch.exp(-kappa * way(target, place, varied))
    eye = box.room.camera.eye
    seen = torch.exp(-kappa * way(eye.expand_as(place), place, varied))
    through = torch.where(clear > 0, fog / clear.clamp_min(1e-30), 1.0)
    scene = box.scene()
    glowing = scene.glowing.reshape(-1)
    through = torch.where(glowing, 1.0, through) * seen
    radiance = torch.tensor(RADIANCE)
    shown = clear[:, None].float() * radiance * box.albedo[box.seen.part.reshape(-1).clamp_min(0)] / math.pi
    shown = torch.where(glowing[:, None], radiance, shown)
    added = torch.zeros(h * w, dtype=torch.float64)
    direction, length = scene.ray_direction.reshape(-1, 3), scene.ray_length.reshape(-1)
    before = torch.zeros(h * w, dtype=torch.float64)
    for k in range(steps):
        share = (k + torch.rand(h * w, generator=random, dtype=torch.float64)) / steps
        at = eye + direction * (length * share)[:, None]
        here = way(eye.expand_as(at), at, varied) if varied else length * share
        density = wavy(at) if varied else torch.ones_like(length)
        for _ in range(lights):
            weight, target = _from_light(box, at, None, random)
            light = weight * torch.exp(-kappa * (way(target, at, varied) + here))
            added += light * density * (kappa / (4 * math.pi) / lights / steps) * length
    del before
    scattered = (added[:, None].float() * radiance).reshape(h, w, 3)
    lit = ((clear > 1e-4) & ~glowing).reshape(h, w)
    return Truth(shown.reshape(h, w, 3), through.float().reshape(h, w), scattered, lit)


def bounced_ratio(box: Box, kappa: float, *, samples: int, bounces: int = 4, albedo: float = 0.7) -> Tensor:
    """(H,W) survival of all light that comes to each pixel's place, bounces included, by random paths of its own."""
    random = torch.Generator().manual_seed(2)
    h, w = box.seen.depth.shape
    clear, fog = torch.zeros(h * w, dtype=torch.float64), torch.zeros(h * w, dtype=torch.float64)
    first, facing = (box.seen.place + 1e-6 * box.seen.normal).reshape(-1, 3), box.seen.normal.reshape(-1, 3)
    for _ in range(samples):
        at, normal = first, facing
        beta, run = torch.ones(h * w, dtype=torch.float64), torch.zeros(h * w, dtype=torch.float64)
        for bounce in range(bounces + 1):
            weight, target = _from_light(box, at, normal, random)
            clear += beta * weight
            fog += beta * weight * torch.exp(-kappa * (run + (target - at).norm(dim=-1)))
            if bounce == bounces:
                break
            on_ball = torch.nn.functional.normalize(
                torch.randn(h * w, 3, generator=random, dtype=torch.float64), dim=-1
            )
            direction = torch.nn.functional.normalize(normal + on_ball * (1 - 1e-9), dim=-1)
            hits = box.proxy.caster.first_hit(at, direction, t_min=1e-5, cull_backfaces=True)
            hit = hits.triangle >= 0
            length = torch.where(hit, hits.t.double(), 0.0)
            normal = box.proxy.normal[hits.triangle.clamp_min(0)]
            at, run, beta = at + direction * length[:, None] + 1e-6 * normal, run + length, beta * albedo * hit
    return torch.where(clear > 0, fog / clear.clamp_min(1e-30), 1.0).float().reshape(h, w)


def psnr(one: Tensor, other: Tensor) -> float:
    """Of encoded pictures, peak 1."""
    a, b = (srgb_from_linear(x.clamp(0.0, 1.0)) for x in (one, other))
    return -10 * math.log10(max(float((a - b).square().mean()), 1e-12))


def method(box: Box, kappa: float, varied: bool, transmittance: str, **changed: object) -> tuple[Tensor, Tensor]:
    """Transmittance (H,W,3) and scattered light (H,W,3) by the method."""
    settings: dict[str, object] = {
        "transmittance": transmittance, "bounces": 0, "columns": 96, "steps": 64, "light_samples": 16, "paths": 64
    }  # fmt: skip
    fog = RoomFog(box.scene(), FogOptions(**(settings | changed)))  # type: ignore[arg-type]
    medium = FogMedium.of(scattering=kappa, density=wavy_grid(box) if varied else None)
    return fog.transmittance(medium), fog.scattered(medium)


def with_albedo(box: Box, albedo: float) -> Box:
    """All parts of one grey."""
    return replace(box, albedo=torch.full_like(box.albedo, albedo))
