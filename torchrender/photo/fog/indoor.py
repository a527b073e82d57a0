"""Fog in a room: what lights it, what of the photo is left, and what the air adds.

Source: specification 12, sections 3, 4 and 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from torchrender.errors import InputError
from torchrender.numerics.color import luminance
from torchrender.photo.fog.air import Air
from torchrender.photo.fog.marks.records import Marks
from torchrender.photo.fog.options import FogMedium, FogOptions
from torchrender.photo.fog.picture import polygon_mask
from torchrender.photo.fog.room.calibrate import FACES, Room, calibrate, corners_in_view, face_of, lift
from torchrender.photo.fog.room.emitters import Emitter, emitter_of
from torchrender.photo.fog.room.lights import GREY, LightFit, fit_lights, light_color
from torchrender.photo.fog.room.proxy import Proxy, Seen, build_proxy, look, prism_of
from torchrender.photo.fog.room.shafts import Shafts, build_shafts
from torchrender.photo.fog.room.sun import SunFit, fit_sun, same_order
from torchrender.photo.fog.room.transport import arriving

FIT_COLUMNS = 80
"""Pixels across of the picture that lights are fitted to."""


@dataclass(frozen=True, eq=False)
class RoomScene:
    """A room with its lights, ready for any medium."""

    room: Room
    proxy: Proxy
    seen: Seen
    emitters: tuple[Emitter, ...]
    radiance: Tensor  # (L,3) of the emitters
    shafts: Shafts | None
    sun: Tensor  # (3,) irradiance across its direction
    sun_fit: SunFit | None
    ambient: Tensor  # (3,) radiance from everywhere
    albedo: Tensor  # (P,) of the proxy's parts
    glowing: Tensor  # (H,W) bool: lights and windows, which nothing lights
    fit: LightFit

    @cached_property
    def ray_length(self) -> Tensor:
        """(H,W) float64 metres from the eye to what a pixel shows."""
        way = self.room.camera.rays()[1][0].norm(dim=-1)
        return torch.where(torch.isfinite(self.seen.depth), self.seen.depth, 0.0) * way

    @cached_property
    def ray_direction(self) -> Tensor:
        """(H,W,3) float64 unit."""
        return torch.nn.functional.normalize(self.room.camera.rays()[1][0], dim=-1)

    @property
    def eye(self) -> Tensor:
        """(3,) float64."""
        return self.room.camera.eye[0]

    def facts(self) -> dict[str, object]:
        """What was found out about the photo, in numbers."""
        out: dict[str, object] = {
            "room_size_m": [round(float(v), 3) for v in self.room.size],
            "focal_px": round(float(self.room.camera.intrinsics[0, 0, 0]), 2),
            "corner_error_px": round(self.room.error_px, 2),
            "corners_px": corners_in_view(self.room),
            "lights": {
                e.name: [round(float(v), 4) for v in r] for e, r in zip(self.emitters, self.radiance, strict=True)
            },
            "ambient": [round(float(v), 4) for v in self.ambient],
            "light_error": round(self.fit.error, 4),
        }
        if self.sun_fit is not None:
            out["sun_direction"] = [round(float(v), 5) for v in self.sun_fit.direction]
            out["sun_irradiance"] = [round(float(v), 4) for v in self.sun]
            out["sun_iou"] = round(self.sun_fit.iou, 3)
            out["shaft_volumes_m3"] = [round(h.volume, 3) for h in self.shafts.hulls] if self.shafts else []
        return out


def prepare_room(photo: Tensor, marks: Marks, options: FogOptions, depth: Tensor | None = None) -> RoomScene:
    """Everything about a photo (H,W,3) that does not depend on the medium.

    Args:
        depth: (H,W) camera z in metres, if it is known; otherwise it is that of the proxy.

    Raises:
        InputError: marks that fit no room, or lie where they cannot; names the mark.
    """
    assert marks.room is not None
    h, w = photo.shape[:2]
    room = calibrate(marks.room, marks.camera, w, h)
    proxy = build_proxy(room, [prism_of(room, m, k) for k, m in enumerate(marks.cuboids)])
    seen = look(proxy, room)
    if depth is not None:
        seen = _with_depth(seen, depth, room)
    emitters, sunny, glowing = _marked_lights(marks, room, (h, w))
    sun_fit, shafts = None, None
    if sunny:
        pairs = [(corners, lit) for corners, lit, _, _ in sunny]
        sun_fit = fit_sun(
            pairs, room.camera, angle_weight=options.angle_weight, iou_weight=options.iou_weight
        )  # fmt: skip
        shafts = build_shafts(sunny, sun_fit.direction)
    return _lit(photo, options, RoomScene(
        room, proxy, seen, tuple(emitters), torch.zeros(len(emitters), 3), shafts, torch.zeros(3), sun_fit,
        torch.zeros(3), torch.full((proxy.parts,), GREY), glowing, LightFit(torch.zeros(0), torch.zeros(0), 0.0),
    ))  # fmt: skip


def known_room(
    room: Room, proxy: Proxy, emitters: tuple[Emitter, ...], radiance: Tensor, albedo: Tensor,
    depth: Tensor | None = None,
) -> RoomScene:  # fmt: skip
    """A room all of which is known: radiance (L,3) of its emitters, albedo (P,) of its parts, perhaps depth (H,W)."""
    seen = look(proxy, room)
    glowing = torch.zeros(seen.depth.shape, dtype=torch.bool)
    for emitter in emitters:
        glowing |= polygon_mask(emitter.pixels, *seen.depth.shape)
    seen = seen if depth is None else _with_depth(seen, depth, room)
    dark, nothing = torch.zeros(3), LightFit(torch.zeros(0), torch.zeros(0), 0.0)
    return RoomScene(
        room, proxy, seen, emitters, radiance.float(), None, dark, None, dark, albedo.float(), glowing, nothing
    )


def with_lights(scene: RoomScene, radiance: Tensor, *, sun: Tensor | None = None, ambient: Tensor | None = None,
                albedo: Tensor | None = None) -> RoomScene:  # fmt: skip
    """The scene with given strengths: radiance (L,3), irradiance of the sun (3,), radiance from everywhere (3,)."""
    if radiance.shape != (len(scene.emitters), 3):
        raise InputError(f"radiance must have shape ({len(scene.emitters)}, 3), got {tuple(radiance.shape)}")
    return RoomScene(
        scene.room, scene.proxy, scene.seen, scene.emitters, radiance.float(), scene.shafts,
        scene.sun if sun is None else sun.float(), scene.sun_fit, scene.ambient if ambient is None else ambient.float(),
        scene.albedo if albedo is None else albedo.float(), scene.glowing, scene.fit,
    )  # fmt: skip


def _marked_lights(
    marks: Marks, room: Room, size: tuple[int, int]
) -> tuple[list[Emitter], list[tuple[Tensor, Tensor, Tensor, str]], Tensor]:
    """Emitters, windows with lit floors, and the pixels of both."""
    emitters, sunny = [], []
    glowing = torch.zeros(size, dtype=torch.bool)
    for k, light in enumerate(marks.lights):
        name = f"light[{k}]"
        wall = face_of(room, light.polygon, light.wall)
        glowing |= polygon_mask(light.polygon, *size)
        if light.on:
            emitters.append(emitter_of(lift(room, light.polygon, wall, name), wall, name, light.polygon))
    for k, window in enumerate(marks.windows):
        name = f"window[{k}]"
        wall = face_of(room, window.polygon, window.wall)
        corners = lift(room, window.polygon, wall, name)
        made = emitter_of(corners, wall, name, window.polygon)
        glowing |= polygon_mask(window.polygon, *size)
        if window.glow:
            emitters.append(made)
        if window.lit is not None:
            lit = lift(room, window.lit, "floor", f"{name} lit")
            sunny.append((corners, same_order(corners, lit, name), made.normal, name))
    return emitters, sunny, glowing


def _with_depth(seen: Seen, depth: Tensor, room: Room) -> Seen:
    """What is seen at a given depth; the proxy's stays where the depth knows nothing."""
    known = torch.isfinite(depth) & (depth > 0)
    z = torch.where(known, depth.double(), seen.depth)
    origin, way = room.camera.rays()
    place = origin[0] + way[0] * torch.where(torch.isfinite(z), z, 0.0)[..., None]
    return Seen(z, place, seen.normal, seen.part)


def _lit(photo: Tensor, options: FogOptions, scene: RoomScene) -> RoomScene:
    """The scene with strengths of its lights as the photo tells them."""
    h, w = photo.shape[:2]
    step = max(1, w // FIT_COLUMNS)
    rows, columns = torch.arange(step // 2, h, step), torch.arange(step // 2, w, step)
    pick = (rows[:, None], columns[None, :])
    place, normal = scene.seen.place[pick].reshape(-1, 3), scene.seen.normal[pick].reshape(-1, 3)
    part = torch.where(scene.glowing[pick], -1, scene.seen.part[pick]).reshape(-1)
    clear = Air(None, scene.room.low, scene.room.high)
    lit = [arriving(e, scene.proxy, clear, place + 1e-4 * normal, normal, 3).lit() for e in scene.emitters]
    if scene.shafts is not None:
        _, inside = scene.shafts.reach(place)
        lit.append(torch.where(inside, -(normal @ scene.shafts.direction), 0.0).clamp_min(0.0).float())
    if options.ambient:
        lit.append(torch.full((len(place),), math.pi))
    if not lit:
        return scene
    found = fit_lights(torch.stack(lit, dim=1), photo[pick].reshape(-1, 3), part, scene.proxy.parts)
    tint = light_color(scene.emitters, photo) * options.light_gain
    strengths = [tint * s for s in found.strength]
    count = len(scene.emitters)
    radiance = torch.stack(strengths[:count]) if count else torch.zeros(0, 3)
    sun, ambient = torch.zeros(3), strengths[-1] if options.ambient else torch.zeros(3)
    if scene.shafts is not None:
        others = torch.stack([f * s for k, (f, s) in enumerate(zip(lit, found.strength, strict=True)) if k != count])
        told = _told_by_floor(scene, photo[pick].reshape(-1, 3), place, part, others.sum(dim=0))
        sun = torch.maximum(strengths[count], tint * told) * options.shaft_gain
    return RoomScene(
        scene.room, scene.proxy, scene.seen, scene.emitters, radiance, scene.shafts, sun, scene.sun_fit, ambient,
        found.albedo, scene.glowing, found,
    )  # fmt: skip


def _told_by_floor(scene: RoomScene, photo: Tensor, place: Tensor, part: Tensor, others: Tensor) -> float:
    """Irradiance across the sun's direction by how much brighter the lit floor is than the rest of it.

    That needs no albedo, and pixels that the camera cut off count, too: the least that the sun can be. A lit polygon is
    drawn by hand and holds shadows of furniture and frames, so that its bright pixels speak for it.

    Args:
        photo: (N,3). place: (N,3). part: (N,). others: (N,) irradiance of all other sources.
    """
    assert scene.shafts is not None
    floor = part == list(FACES).index("floor")
    _, inside = scene.shafts.reach(place)
    seen, cosine = luminance(photo), max(-float(scene.shafts.direction[1]), 0.05)
    lit, rest = seen[floor & inside], seen[floor & ~inside]
    if len(lit) < 4 or len(rest) < 4:
        return 0.0
    ratio = float(torch.quantile(lit, 0.75) / torch.quantile(rest, 0.25).clamp_min(1e-3))
    return max(0.0, ratio - 1.0) * float(others[floor & inside].median()) / cosine


def air_of(scene: RoomScene, medium: FogMedium) -> Air:
    """The medium as it fills the room."""
    return Air.of(medium, scene.room.low, scene.room.high)
