"""Stand-ins for a room and its furniture: a mesh that rays are cast against, and the depth that it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.errors import InputError
from torchrender.photo.fog.marks.records import CuboidMark
from torchrender.photo.fog.room.calibrate import FACES, Room, lift
from torchrender.rays import RayCaster
from torchrender.scene.mesh import Mesh, concatenate


@dataclass(frozen=True, eq=False)
class Prism:
    """Furniture: a footprint on the floor, and its height."""

    base: Tensor  # (m,3) float64
    height: float


@dataclass(frozen=True, eq=False)
class Proxy:
    """Faces that stand for the room."""

    caster: RayCaster
    vertices: Tensor  # (V,3) float64
    faces: Tensor  # (F,3) int64
    normal: Tensor  # (F,3) float64, into the air
    face_part: Tensor  # (F,) int64: sides of the room 0 to 5, then those of each prism
    parts: int
    room_low: Tensor
    room_high: Tensor

    @property
    def mean_chord(self) -> float:
        """Mean length of a line through the room, ``4 volume / surface``."""
        w, h, d = (float(v) for v in self.room_high - self.room_low)
        return 4 * w * h * d / (2 * (w * h + h * d + d * w))


@dataclass(frozen=True, eq=False)
class Seen:
    """What rays of a picture hit."""

    depth: Tensor  # (H,W) float64 camera z; +inf: nothing
    place: Tensor  # (H,W,3) float64
    normal: Tensor  # (H,W,3) float64, towards the air
    part: Tensor  # (H,W) int64, -1 for none


def prism_of(room: Room, mark: CuboidMark, number: int) -> Prism:
    """Lift a cuboid's marks.

    Raises:
        InputError: a base off the floor, or a top below it.
    """
    name = f"cuboid[{number}]"
    base = lift(room, mark.base, "floor", f"{name} base")
    if len(base) == 3:
        base = torch.cat([base, (base[0] + base[2] - base[1])[None]])
    height = mark.height
    if height is None:
        assert mark.top is not None
        origin, way = room.camera.rays(torch.tensor([[mark.top]], dtype=torch.float64))
        flat = way[0, 0].clone()
        flat[1] = 0.0
        t = float(((base[0] - origin[0, 0]) * flat).sum() / (flat * flat).sum().clamp_min(1e-12))
        height = float(origin[0, 0, 1] + t * way[0, 0, 1])
    if not 0.001 < height < 1e3:
        raise InputError(f"{name} top must lie above its base, got a height of {height:.3f} m")
    return Prism(base, height)


def build_proxy(room: Room, prisms: Sequence[Prism]) -> Proxy:
    """A mesh of the room from inside and of the furniture from outside."""
    vertices: list[Tensor] = []
    faces: list[Tensor] = []
    parts: list[int] = []
    count = 0

    def add(corners: Tensor, part: int, inside: Tensor) -> None:
        """A flat polygon as a fan that turns its right-hand side towards ``inside``."""
        nonlocal count
        n = len(corners)
        fan = torch.tensor([[0, k, k + 1] for k in range(1, n - 1)])
        across = torch.linalg.cross(corners[1] - corners[0], corners[2] - corners[0])
        if float((across * (inside - corners.mean(dim=0))).sum()) < 0:
            fan = fan.flip(1)
        vertices.append(corners)
        faces.append(fan + count)
        parts.extend([part] * len(fan))
        count += n

    middle = (room.low + room.high) / 2
    for part, (axis, side) in enumerate(FACES.values()):
        a, b = [k for k in range(3) if k != axis]
        corners = torch.stack([middle.clone() for _ in range(4)])
        corners[:, axis] = (room.high if side else room.low)[axis]
        for k, (one, other) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            corners[k, a] = (room.high if one else room.low)[a]
            corners[k, b] = (room.high if other else room.low)[b]
        add(corners, part, middle)
    part = len(FACES)
    for prism in prisms:
        low = prism.base.clone()
        high = low.clone()
        high[:, 1] = prism.height
        centre = (low.mean(dim=0) + high.mean(dim=0)) / 2
        m = len(low)
        for k in range(m):
            wall = torch.stack([low[k], low[(k + 1) % m], high[(k + 1) % m], high[k]])
            add(wall, part + k, 2 * wall.mean(dim=0) - centre)
        add(high, part + m, 2 * high.mean(dim=0) - centre)
        part += m + 1
    v, f = torch.cat(vertices), torch.cat(faces)
    normal = torch.linalg.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    normal = torch.nn.functional.normalize(normal, dim=-1)
    caster = RayCaster(concatenate([Mesh(vertices=v, faces=f)]))
    return Proxy(caster, v, f, normal, torch.tensor(parts), part, room.low, room.high)


def look(proxy: Proxy, room: Room) -> Seen:
    """Depth, places and normals of what the room's camera sees of the proxy, walls before it included."""
    origin, way = room.camera.rays()
    hits = proxy.caster.first_hit(origin[0].reshape(-1, 3), way[0].reshape(-1, 3), t_min=1e-6, cull_backfaces=True)
    shape = (room.camera.height, room.camera.width)
    t, face = hits.t.reshape(shape).double(), hits.triangle.reshape(shape)
    hit = face >= 0
    place = origin[0] + way[0] * torch.where(hit, t, 0.0)[..., None]
    some = face.clamp_min(0)
    return Seen(torch.where(hit, t, torch.inf), place, proxy.normal[some], torch.where(hit, proxy.face_part[some], -1))
