"""Where the next keyframe goes: pose prediction, overscan, and whether it is needed at all."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from torchrender.wire.fields import MAX_SIDE
from torchrender.wire.messages import CameraHeader, Pose

MAX_LEAD_S = 1.0
MAX_SPIN = 8.0
MOVE_SHARE = 0.02  # of the typical depth: a keyframe this far away shows holes
MARGIN_SHARE = 0.3  # of the overscan margin that a turn may use up
MIN_TURN = 0.005
SPARE_SHARE = 0.15  # of how far a view may go without a keyframe: from here one is of use, if there is time for it
MAX_HOLES = 0.01

Matrix = tuple[float, ...]


def predicted(pose: Pose, lead_s: float) -> CameraHeader:
    """The camera of a pose after ``lead_s`` seconds of its velocity and spin, at most ``MAX_LEAD_S``."""
    lead = min(max(lead_s, 0.0), MAX_LEAD_S)
    m = pose.camera.world_from_camera
    if not pose.moving or lead == 0.0:
        return pose.camera
    turn = _rotation([w * lead for w in pose.spin])
    rotation = [[sum(m[4 * i + k] * turn[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    eye = [m[4 * i + 3] + lead * pose.velocity[i] for i in range(3)]
    rows = [[*rotation[i], eye[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
    matrix = tuple(value for row in rows for value in row)
    return msgspec.structs.replace(pose.camera, world_from_camera=matrix)


def overscanned(camera: CameraHeader, overscan: float, max_pixels: int) -> CameraHeader:
    """The same view with a wider field: ``overscan`` times as many pixels along each side, fewer where the limit asks.

    Where even the view itself has more than ``max_pixels`` pixels, it is made coarser.
    """
    pixels = camera.width * camera.height
    shrink = min(1.0, math.sqrt(max_pixels / pixels))
    width, height = max(1, int(camera.width * shrink)), max(1, int(camera.height * shrink))
    sx, sy = width / camera.width, height / camera.height
    room = MAX_SIDE / max(width, height)
    factor = max(1.0, min(overscan, math.sqrt(max_pixels / (width * height)), room))
    # As many pixels on both sides: pixels of the wider picture then coincide with those of the view.
    left, top = (int(side * (factor - 1.0) / 2.0 + 1e-6) for side in (width, height))
    wide, high = width + 2 * left, height + 2 * top
    return CameraHeader(
        world_from_camera=camera.world_from_camera,
        fx=camera.fx * sx,
        fy=camera.fy * sy,
        cx=camera.cx * sx + left,
        cy=camera.cy * sy + top,
        width=wide,
        height=high,
        near=camera.near,
    )


def margin_of(camera: CameraHeader, view: CameraHeader) -> tuple[int, int]:
    """Columns and rows that an overscanned camera has beyond the view, on either side."""
    scale = camera.fx / view.fx
    sides = (camera.width, view.width), (camera.height, view.height)
    left, top = (max(0, int((wide - scale * side) / 2)) for wide, side in sides)
    return left, top


def distance(first: CameraHeader, second: CameraHeader) -> float:
    """Between the eyes of two cameras, scene units."""
    a, b = first.world_from_camera, second.world_from_camera
    return math.dist((a[3], a[7], a[11]), (b[3], b[7], b[11]))


def angle(first: CameraHeader, second: CameraHeader) -> float:
    """Of the rotation between two cameras, radians."""
    a, b = first.world_from_camera, second.world_from_camera
    trace = sum(a[4 * i + k] * b[4 * i + k] for i in range(3) for k in range(3))
    return math.acos(max(-1.0, min(1.0, (trace - 1.0) / 2.0)))


def needs_keyframe(
    shown: CameraHeader, wanted: CameraHeader, typical_depth: float, overscan: float, *, share: float = 1.0
) -> bool:
    """Whether the view ``wanted`` is about to run out of the samples of a keyframe taken from ``shown``.

    Args:
        shown, wanted: without overscan.
        typical_depth: median depth of the keyframe; 0: nothing was seen, so moving does not matter.
        overscan: of the keyframe.
        share: of how far it may go.
    """
    if (shown.width, shown.height) != (wanted.width, wanted.height) or abs(shown.fx / wanted.fx - 1.0) > 0.01:
        return True
    margin = (overscan - 1.0) / 2.0 * min(wanted.width / wanted.fx, wanted.height / wanted.fy)
    if angle(shown, wanted) > share * max(MIN_TURN, MARGIN_SHARE * margin):
        return True
    return typical_depth > 0.0 and distance(shown, wanted) > share * MOVE_SHARE * typical_depth


def same_view(first: CameraHeader, second: CameraHeader) -> bool:
    """Whether two cameras show the same picture."""
    rest = _rest(first) == _rest(second)
    near = 1e-6 * (1.0 + max(abs(v) for v in first.world_from_camera))
    pairs = zip(first.world_from_camera, second.world_from_camera)
    return rest and all(abs(a - b) <= near for a, b in pairs)


def _rest(camera: CameraHeader) -> dict[str, float]:
    names = ("fx", "fy", "cx", "cy", "width", "height", "near")
    return {name: getattr(camera, name) for name in names}


def _rotation(vector: Sequence[float]) -> list[list[float]]:
    """Rodrigues' formula: rotation by the length of ``vector`` about it."""
    size = math.sqrt(sum(v * v for v in vector))
    if size < 1e-12:
        return [[float(i == j) for j in range(3)] for i in range(3)]
    x, y, z = (v / size for v in vector)
    size = min(size, MAX_SPIN)
    s, c = math.sin(size), math.cos(size)
    k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    kk = [[sum(k[i][n] * k[n][j] for n in range(3)) for j in range(3)] for i in range(3)]
    return [[float(i == j) + s * k[i][j] + (1.0 - c) * kk[i][j] for j in range(3)] for i in range(3)]
