"""Camera and room box from marked corners.

The world has the floor at y = 0, the camera at (0, its height, 0), and the back wall towards -z; metres by the camera's
height. Source: specification 12, section 4; vanishing points of orthogonal edges.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from torch import Tensor

from torchrender.errors import InputError
from torchrender.photo.fog.marks.records import CORNERS, CameraMark, Polygon, RoomMark
from torchrender.photo.fog.options import FogWarning
from torchrender.scene.camera import Cameras

Array = NDArray[np.float64]
FLIP = np.diag([1.0, -1.0, -1.0])
"""Camera from world of a level camera that looks along -z."""
IN_VIEW = 0.05
"""Metres before the camera from which on a corner has a place in the picture."""
BEHIND = 0.5
"""Metres behind the camera at which a room ends whose front is not marked."""
_AXES = {"x": ("left", "right"), "y": ("floor", "ceiling"), "z": ("back", "front")}


@dataclass(frozen=True, eq=False)
class Room:
    """A box in metres, seen by a camera."""

    low: Tensor  # (3,) float64
    high: Tensor  # (3,) float64
    camera: Cameras
    error_px: float  # root mean square of the marked corners

    @property
    def size(self) -> Tensor:
        """(3,) width, height, depth."""
        return self.high - self.low


def vanishing_point(segments: list[tuple[tuple[float, float], tuple[float, float]]]) -> Array:
    """(3,) homogeneous meeting point of two or more lines, each through two pixels; least squares."""
    lines = []
    for a, b in segments:
        line = np.cross([*a, 1.0], [*b, 1.0])
        lines.append(line / max(float(np.hypot(line[0], line[1])), 1e-12))
    found: Array = np.linalg.svd(np.array(lines))[2][-1]
    return found


def focal_of(first: Array, second: Array, center: tuple[float, float]) -> float | None:
    """Focal length in pixels from the vanishing points (3,) of two orthogonal directions: f^2 = -(v1-c).(v2-c).

    None where a point is too far away, or no focal length fits.
    """
    points = []
    for v in (first, second):
        if abs(v[2]) < 1e-9 * float(np.abs(v).max()):
            return None
        points.append(v[:2] / v[2] - np.array(center))
    square = -float(points[0] @ points[1])
    size = max(float(np.linalg.norm(points[0])), float(np.linalg.norm(points[1])))
    if square <= 0 or size > 1e5:
        return None
    return square**0.5


def _edges(room: RoomMark, axis: str) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Marked edges of the room along an axis."""
    one, other = _AXES[axis]
    found = []
    for name, place in room.corners.items():
        words = name.split("_")
        if one in words:
            partner = "_".join(other if w == one else w for w in words)
            if partner in room.corners:
                found.append((place, room.corners[partner]))
    return found


def find_focal(room: RoomMark, width: int, height: int, center: tuple[float, float]) -> float | None:
    """Focal length from the room's vanishing points; None where the marks do not tell it."""
    points = {axis: vanishing_point(edges) for axis in _AXES if len(edges := _edges(room, axis)) >= 2}
    found = []
    for a, b in (("x", "z"), ("y", "z"), ("x", "y")):
        if a in points and b in points:
            focal = focal_of(points[a], points[b], center)
            if focal is not None and 0.2 < focal / max(width, height) < 5.0:
                found.append(focal)
    return float(np.median(found)) if found else None


def calibrate(room: RoomMark, camera: CameraMark, width: int, height: int) -> Room:
    """Camera and box that fit the marked corners best.

    Raises:
        InputError: too few corners for what is unknown, or corners that no box can have.
    """
    center = camera.center or (width / 2, height / 2)
    focal, free = camera.focal, False
    if focal is None:
        found = find_focal(room, width, height, center)
        focal = float(max(width, height)) if found is None else found
        free = found is not None and len(room.corners) >= 6
        if found is None:
            warnings.warn(
                f"the marked corners do not tell the focal length: {focal:.0f} px are assumed; name it under camera",
                FogWarning, stacklevel=3,
            )  # fmt: skip
    names = list(room.corners)
    for axis, (one, other) in _AXES.items():
        words = {w for name in names for w in name.split("_")}
        if axis != "z" and axis != "y" and not {one, other} <= words:
            raise InputError(f"room corners must show both its {one} and its {other} side")
    if not any("floor" in n for n in names) or not any("back" in n for n in names):
        raise InputError("room corners must show the floor and the back wall")
    pixels = np.array([room.corners[n] for n in names])
    best = None
    for yaw in (0.0, -0.6, 0.6):
        start = _start(names, pixels, yaw, focal, center, camera.height, room)
        fitted = least_squares(
            _misses, start, args=(names, pixels, focal, center, camera.height, room, free), method="trf",
            x_scale="jac", loss="soft_l1", f_scale=20.0, max_nfev=300,
        )  # fmt: skip
        if best is None or fitted.cost < best.cost:
            best = fitted
    assert best is not None
    turn, low, high, scale = _unpack(best.x, names, camera.height, room, free)
    if not bool((high > low).all()) or not np.isfinite(best.x).all():
        raise InputError("no room has these corners: are left and right, or floor and ceiling, confused?")
    misses = _misses(best.x, names, pixels, focal, center, camera.height, room, free)[: 2 * len(names)]
    error = float(np.sqrt((misses**2).mean() * 2))
    if error > 0.05 * max(width, height):
        raise InputError(
            f"no room fits these corners: they are {error:.0f} px off, at most {0.05 * max(width, height):.0f} may be"
        )
    return Room(torch.from_numpy(low), torch.from_numpy(high),
                camera_at(turn, focal * scale, center, camera.height, width, height), error)  # fmt: skip


def camera_at(
    rotation: Array, focal: float, center: tuple[float, float], height_m: float, width: int, height: int
) -> Cameras:
    """A camera at (0, height_m, 0) with a rotation (3,3) camera from world."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ np.array([0.0, height_m, 0.0])
    k = torch.tensor([[focal, 0, center[0]], [0, focal, center[1]], [0, 0, 1]], dtype=torch.float64)
    near, far = torch.tensor(1e-3, dtype=torch.float64), torch.tensor(float("inf"), dtype=torch.float64)
    return Cameras(torch.from_numpy(matrix)[None], k[None], width, height, near, far)


def _unpack(x: Array, names: list[str], eye: float, room: RoomMark, free: bool) -> tuple[Array, Array, Array, float]:
    """Rotation camera from world, low and high corners, factor of the focal length."""
    turn = FLIP @ Rotation.from_rotvec(x[:3]).as_matrix()
    top = room.height if room.height is not None else x[5]
    if room.height is None and not any("ceiling" in n for n in names):
        top = max(2.5, 1.25 * eye)
    front = x[7] if any("front" in n for n in names) else BEHIND
    low, high = np.array([x[3], 0.0, x[6]]), np.array([x[4], top, max(front, BEHIND)])
    return turn, low, high, float(np.exp(x[8])) if free else 1.0


def _misses(
    x: Array, names: list[str], pixels: Array, focal: float, center: tuple[float, float], eye: float, room: RoomMark,
    free: bool,
) -> Array:  # fmt: skip
    turn, low, high, scale = _unpack(x, names, eye, room, free)
    front = x[7] if any("front" in n for n in names) else high[2]
    places = np.where(_upper(tuple(names)), [high[0], high[1], front], low)
    seen = (places - [0.0, eye, 0.0]) @ turn.T
    z = seen[:, 2]
    # Corners behind the camera have no image: they are pulled before it.
    safe = np.maximum(z, 0.02)
    out = focal * scale * seen[:, :2] / safe[:, None] + np.array(center) - pixels
    # A fit must not flee to infinity along what no corner tells.
    unused = 1e-3 * (x[3:8] - np.array([-2.0, 2.0, 2.5, -4.0, -0.5]))
    return np.concatenate([out.reshape(-1), 1e3 * np.minimum(z - 0.02, 0.0), unused, 1e-2 * x[8:]])


def corners_in_view(room: Room) -> dict[str, list[float]]:
    """Pixels of the box's corners by name; those behind the camera are left out."""
    places = torch.where(torch.from_numpy(_upper(CORNERS)), room.high, room.low)
    seen = room.camera.transform(places)[0]
    pixels = seen @ room.camera.intrinsics[0].T
    pixels = pixels[:, :2] / pixels[:, 2:].clamp_min(1e-9)
    return {
        name: [round(float(v), 2) for v in pixel]
        for name, pixel, z in zip(CORNERS, pixels, seen[:, 2], strict=True)
        if float(z) > IN_VIEW
    }


@lru_cache(maxsize=64)
def _upper(names: tuple[str, ...]) -> NDArray[np.bool_]:
    """(N,3) which corners lie on the right, at the ceiling, and in front."""
    words = ("right", "ceiling", "front")
    return np.array([[w in n for w in words] for n in names])


def _start(
    names: list[str], pixels: Array, yaw: float, focal: float, center: tuple[float, float], eye: float, room: RoomMark
) -> Array:
    x = np.zeros(9)
    x[1] = yaw
    turn = FLIP @ Rotation.from_rotvec(x[:3]).as_matrix()
    ways = np.concatenate([(pixels - center) / focal, np.ones((len(pixels), 1))], axis=1) @ turn
    met: dict[str, list[float]] = {}
    for name, way in zip(names, ways, strict=True):
        if "floor" in name and way[1] < -1e-3:
            x0, z0 = way[[0, 2]] * (-eye / way[1])
            met.setdefault("left" if "left" in name else "right", []).append(float(x0))
            met.setdefault("back" if "back" in name else "front", []).append(float(z0))

    def middle(side: str, usual: float) -> float:
        return float(np.median(met[side])) if side in met else usual

    x[3], x[4] = middle("left", -2.0), middle("right", 2.0)
    x[4] = max(x[4], x[3] + 0.5)
    x[6], x[7] = min(middle("back", -4.0), -0.5), middle("front", -0.5)
    x[5] = room.height or max(2.5, 1.25 * eye)
    return x


def face_of(room: Room, polygon: Polygon, wall: str | None) -> str:
    """The side of the room that a polygon's middle lies on, unless it is told."""
    if wall is not None:
        return wall
    middle = torch.tensor(polygon, dtype=torch.float64).mean(dim=0)
    origin, way = room.camera.rays(middle[None, None])
    best, found = float("inf"), "back"
    for name, (axis, side) in FACES.items():
        at = float((room.high if side else room.low)[axis])
        speed = float(way[0, 0, axis])
        if abs(speed) < 1e-9:
            continue
        t = (at - float(origin[0, 0, axis])) / speed
        if 1e-6 < t < best:
            best, found = t, name
    return found


FACES = {
    "left": (0, False), "right": (0, True), "floor": (1, False), "ceiling": (1, True), "back": (2, False),
    "front": (2, True),
}  # fmt: skip
"""Axis, and whether it is the high side."""


def lift(room: Room, polygon: Polygon, wall: str, name: str) -> Tensor:
    """(m,3) float64 places of pixels on a side of the room.

    Raises:
        InputError: a pixel whose line of sight does not meet that side's plane before the camera; names the mark.
    """
    axis, side = FACES[wall]
    origin, way = room.camera.rays(torch.tensor(polygon, dtype=torch.float64)[None])
    t = ((room.high if side else room.low)[axis] - origin[0, :, axis]) / way[0, :, axis]
    if not bool(((t > 0) & torch.isfinite(t) & (t < 1e5)).all()):
        raise InputError(f"{name} does not lie on the {wall} of the room: its lines of sight do not meet it")
    return origin[0] + way[0] * t[:, None]
