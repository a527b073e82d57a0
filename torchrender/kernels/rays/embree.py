"""Exact rays in one pass of Embree, called from compiled code through its C interface.

Embree's tree holds padded float32 boxes (user geometry), and a compiled callback runs the float64 watertight test
whenever a ray meets one. Float32 decides only which boxes are opened; the padding is several times its rounding, so no
hit is lost at any angle.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import carray, cfunc, from_dtype, prange, types
from numba import config as numba_config
from numba.extending import intrinsic

from torchrender.kernels.compile import kernel
from torchrender.kernels.keys import cache_folder, module_key
from torchrender.kernels.raster.fragments import is_hole
from torchrender.kernels.rays.boxes import HIGH, IDS, LINE, LOW, SCALE, WIDE
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.watertight import BLOCK, LANES, TIE, hit_triangle, row_length, shear_of
from torchrender.kernels.rays.wide_test import edges_around

PAD = 2e-6
"""Boxes are larger by this share of the half extent. Float32 moves a ray's start by 6e-8 of it, its end by 2e-7 more,
and the planes of boxes by up to 4e-7 in Embree's arithmetic."""
BACK = 1e-5
"""Rays start earlier by this share of the half extent; boxes that begin this much behind the best hit are opened."""
ROOM = 1e-3  # the box at which rays start and end is larger by this

_I4, _I8, _F4, _F8 = np.int32, np.int64, np.float32, np.float64
RAY_HIT = np.dtype(
    [(n, _F4) for n in ("ox", "oy", "oz", "near", "dx", "dy", "dz", "time", "far")]
    + [(n, _I4) for n in ("mask", "number", "flags")]
    + [(n, _F4) for n in ("nx", "ny", "nz", "u", "v")]
    + [(n, _I4) for n in ("primitive", "geometry", "instance", "instance_primitive", "_0", "_1", "_2")]
)
"""RTCRayHit, 96 bytes."""
ARGUMENTS = np.dtype(
    [("flags", _I4), ("features", _I4)] + [(n, _I8) for n in ("context", "filter", "intersect", "_0", "_1")]
)
"""RTCIntersectArguments and RTCOccludedArguments, with room behind."""
CALL = np.dtype(
    [
        ("valid", _I8),
        ("user", _I8),
        ("piece", _I4),
        ("_0", _I4),
        ("context", _I8),
        ("ray", _I8),
        ("count", _I4),
        ("geometry", _I4),
    ]
)
"""RTCIntersectFunctionNArguments and RTCOccludedFunctionNArguments."""
BOUNDS_CALL = np.dtype([("user", _I8), ("piece", _I4), ("step", _I4), ("bounds", _I8)])
"""RTCBoundsFunctionArguments."""
STATE = np.dtype(
    [("instance", _I4), ("instance_primitive", _I4)]  # RTCRayQueryContext
    + [(n, _I8) for n in ("packed", "owner", "faces", "mask", "table", "texels", "uv")]
    + [(n, _I8) for n in ("x", "y", "z")]
    + [(n, _F8) for n in ("ox", "oy", "oz", "sx", "sy", "sz")]
    + [(n, _F8) for n in ("low", "high", "start", "per_t")]
    + [(n, _I8) for n in ("ignore", "cull", "any_hit", "last", "triangle")]
    + [(n, _F8) for n in ("t", "b", "c")]
)
"""The float64 side of a ray behind Embree's query context, and the nearest hit so far."""


class Boxes(NamedTuple):
    """A scene of Embree over boxes, and what its callback looks at."""

    scene: int  # RTCScene; 0: nothing to hit
    packed: np.ndarray  # (G,LINE) float64 as of :func:`~torchrender.kernels.rays.boxes.pack_groups`
    owner: np.ndarray  # (M,) int32 group of each box; without elements boxes are groups
    faces: np.ndarray  # (F,3) int32; only holes look at them
    frame: np.ndarray  # (10,) as of :func:`~torchrender.kernels.rays.boxes.frame_of`


def _pointer(kind: Any) -> Any:
    """A function for compiled code that turns an address into a pointer to ``kind``."""

    @intrinsic
    def convert(typingctx, address):  # noqa: ARG001  numba calls it with types
        def code(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.int64), code

    return convert


_call = types.void(types.int64, types.int64, types.int64)
# By name: cached code finds them in whatever place the library is loaded to.
_intersect1 = types.ExternalFunction("rtcIntersect1", _call)
_occluded1 = types.ExternalFunction("rtcOccluded1", _call)
_f64, _f32, _i64, _i32, _u8 = (
    _pointer(k) for k in (types.float64, types.float32, types.int64, types.int32, types.uint8)
)
_state, _ray = _pointer(from_dtype(STATE)), _pointer(from_dtype(RAY_HIT))
_MANY = 1 << 40  # length of arrays of which only the address is known


@kernel(inline=True)
def _in_hole(state, triangle, b, c):
    """The surface is missing there."""
    holes = (
        carray(_i32(state.mask), _MANY),
        carray(_i64(state.table), (_MANY, 4)),
        carray(_u8(state.texels), _MANY),
        carray(_f32(state.uv), (_MANY, 3)),
    )
    return is_hole(triangle, np.float32(b), np.float32(c), carray(_i32(state.faces), (_MANY, 3)), holes)


def _box_of(call):
    """Embree's bounds function: copies the box of a piece."""
    a = carray(call, 1)[0]
    boxes = carray(_f32(a.user), (_MANY, 6))
    piece, out = np.int64(np.uint32(a.piece)), carray(_f32(a.bounds), 8)
    for k in range(3):
        out[k], out[4 + k] = boxes[piece, k], boxes[piece, 3 + k]


@kernel(inline=True)
def _try(s, corners, q, triangle):
    """Test one triangle of a group; True: it is the best hit so far."""
    if triangle == s.ignore:
        return False
    shear = (s.x, s.y, s.z, s.ox, s.oy, s.oz, s.sx, s.sy, s.sz)
    det, t, b, c = hit_triangle(corners, q, 3 * WIDE + q, 6 * WIDE + q, shear)
    if det == 0 or not (s.low < t < s.high):
        return False
    best, tie = s.t, TIE * abs(t)
    if t > best + tie or (s.triangle >= 0 and t >= best - tie and triangle > s.triangle):
        return False
    if s.cull != 0 and det < 0:
        return False
    if s.mask != 0 and _in_hole(s, triangle, b, c):
        return False
    s.t, s.triangle, s.b, s.c = t, triangle, b, c
    return True


def _settle(call):
    """Embree's intersect and occluded function of a piece: tests the triangles of its group."""
    a = carray(call, 1)[0]
    s = carray(_state(a.context), 1)[0]
    group = np.int64(np.uint32(a.piece))
    if s.owner != 0:
        group = np.int64(carray(_i32(s.owner), _MANY)[group])
        if group == s.last:
            return
        s.last = group
    at = s.packed + group * (8 * LINE)
    bits = edges_around(at, s.x, s.y, s.z, (s.ox, s.oy, s.oz), (s.sx, s.sy))
    if bits == 0:
        return
    corners, ids, found, q = carray(_f64(at), LINE), carray(_i64(at), LINE), False, 0
    while bits != 0:  # not counted: the loop's body is large, and compilers would repeat it
        if bits & 1 != 0 and ids[IDS + q] >= 0:
            found |= _try(s, corners, q, ids[IDS + q])
        bits, q = bits >> 1, q + 1
    if found:
        ray = carray(_ray(a.ray), 1)[0]
        # Negative infinity is Embree's sign for "occluded".
        ray.far = -np.inf if s.any_hit != 0 else min(ray.far, np.float32((s.t - s.start) * s.per_t + BACK))


def load_library() -> None:
    """Load what the kernels here call by name.

    Raises:
        ImportError: there is no Embree that fits.
    """
    if embree() is None:
        raise ImportError("there is no Embree that these kernels can call")


@cache
def callbacks() -> tuple[Any, Any]:
    """The compiled bounds and hit function; their ``address`` is what Embree calls."""
    return _compiled(_box_of, BOUNDS_CALL), _compiled(_settle, CALL)


def _compiled(function: Callable[..., Any], argument: np.dtype[Any]) -> Any:
    before = numba_config.CACHE_DIR
    # By the text of all that goes into it, as kernels are: numba itself does not notice an edited helper.
    numba_config.CACHE_DIR = str(cache_folder() / f"callbacks-{module_key('rays.embree')}")
    try:
        signature = types.void(types.CPointer(from_dtype(argument)))
        return cfunc(signature, cache=True, error_model="numpy")(function)
    finally:
        numba_config.CACHE_DIR = before


@kernel(inline=True)
def _clip(frame, origins, directions, r, near, far):
    """The part of a ray within the scene's box, somewhat enlarged."""
    scale = frame[SCALE]
    for k in range(3):
        step = directions[r, k] * scale
        # Finite: 0 times infinity would be NaN for an origin in the plane of a side.
        step = 1.0 / step if abs(step) > 1e-290 else np.copysign(1e290, step)
        at = origins[r, k] * scale - frame[k]
        a, b = (frame[LOW + k] - ROOM - at) * step, (frame[HIGH + k] + ROOM - at) * step
        near, far = max(near, min(a, b)), min(far, max(a, b))
    return near, far


@kernel(inline=True)
def _aim(ray, state, frame, origins, directions, span, r):
    """Set the float32 ray that Embree sees and the origin in the frame; False: the ray passes the scene by."""
    scale = frame[SCALE]
    length = row_length(directions, r) * scale
    x, y, z = origins[r, 0] * scale - frame[0], origins[r, 1] * scale - frame[1], origins[r, 2] * scale - frame[2]
    near, far = span[r, 0], span[r, 1]
    inside = (
        (x > frame[LOW] - ROOM)
        & (y > frame[LOW + 1] - ROOM)
        & (z > frame[LOW + 2] - ROOM)
        & (x < frame[HIGH] + ROOM)
        & (y < frame[HIGH + 1] + ROOM)
        & (z < frame[HIGH + 2] + ROOM)
    )
    if not inside or not 0.0 <= near * length < 1.0:
        near, far = _clip(frame, origins, directions, r, near, far)
    if not near < far:
        return False
    near -= BACK / length
    dx, dy, dz = directions[r, 0] * scale, directions[r, 1] * scale, directions[r, 2] * scale
    ray.ox, ray.oy, ray.oz = x + near * dx, y + near * dy, z + near * dz
    ray.dx, ray.dy, ray.dz = dx / length, dy / length, dz / length
    ray.near, ray.time, ray.far = 0.0, 0.0, (far - near) * length + BACK
    ray.mask, ray.number, ray.flags, ray.primitive, ray.geometry = -1, 0, 0, -1, -1
    state.start, state.per_t = near, length
    return True


@kernel(inline=True)
def _look_at(state, boxes, rays, holes):
    """What of the callback's state is the same for all rays."""
    state.instance, state.instance_primitive = -1, -1
    state.faces = boxes.faces.ctypes.data
    state.packed = boxes.packed.ctypes.data
    state.owner = boxes.owner.ctypes.data if boxes.owner.shape[0] > 0 else 0
    state.cull, state.any_hit = rays.cull, rays.any_hit
    state.mask = holes.mask.ctypes.data if holes.mask.shape[0] > 0 else 0
    state.table, state.texels, state.uv = holes.table.ctypes.data, holes.texels.ctypes.data, holes.uv.ctypes.data


@kernel()
def _cast_lane(boxes, rays, holes, lane, lanes, out):
    """Every ``lanes``-th block of rays: those next to each other cost about the same, and threads get equal runs."""
    origins, directions, span, ignore, _, any_hit = rays
    t, triangle, weights = out
    n = origins.shape[0]
    frame, scene = boxes.frame, np.int64(boxes.scene)
    states, arguments, hits = np.zeros(1, STATE), np.zeros(1, ARGUMENTS), np.zeros(1, RAY_HIT)
    state, ray = states[0], hits[0]
    _look_at(state, boxes, rays, holes)
    arguments[0].features, arguments[0].context = -1, states.ctypes.data
    at_ray, at_arguments = np.int64(hits.ctypes.data), np.int64(arguments.ctypes.data)
    for block in range(lane * BLOCK, n, lanes * BLOCK):
        for r in range(block, min(n, block + BLOCK)):
            t[r], triangle[r], weights[r, 0], weights[r, 1] = np.inf, -1, 0.0, 0.0
            if not _aim(ray, state, frame, origins, directions, span, r):
                continue
            x, y, z, ox, oy, oz, sx, sy, sz = shear_of(origins, directions, r, frame[SCALE])
            state.x, state.y, state.z = x * WIDE, y * WIDE, z * WIDE
            state.ox, state.oy, state.oz, state.sx, state.sy, state.sz = ox, oy, oz, sx, sy, sz
            state.low, state.high, state.ignore = span[r, 0], span[r, 1], ignore[r]
            state.t, state.triangle, state.last = np.inf, -1, -1
            if any_hit:
                _occluded1(scene, at_ray, at_arguments)
            else:
                _intersect1(scene, at_ray, at_arguments)
            if state.triangle >= 0:
                t[r], triangle[r], weights[r, 0], weights[r, 1] = state.t, state.triangle, state.b, state.c


@kernel(parallel=True)
def cast_through_boxes(boxes, rays, holes):
    """Nearest (or any) hit of each ray that is not in a hole.

    Returns:
        ``t`` (N,) float64 (+inf for a miss), ``triangle`` (N,) int64 (-1) and ``weights`` (N,2) float32 of the second
        and third vertex.
    """
    n = rays.origins.shape[0]
    out = (np.empty(n), np.empty(n, np.int64), np.empty((n, 2), np.float32))
    lanes = np.int64(min((n + BLOCK - 1) // BLOCK, LANES))
    for lane in prange(lanes):
        _cast_lane(boxes, rays, holes, np.int64(lane), lanes, out)
    return out
