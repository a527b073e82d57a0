"""Embree's own float32 triangles through its C interface: what the exact rays are measured against. Not exact."""

from __future__ import annotations

import weakref

import numpy as np
from numba import prange, types

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.boxes import SCALE, frame_of
from torchrender.kernels.rays.embree import ARGUMENTS, RAY_HIT, STATE
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.watertight import BLOCK, LANES, Rays

_USUAL, _TRIANGLES = 1, 0  # build quality, kind of geometry
_INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 1, 0x5003, 0x9003  # kinds and formats of buffers

_call = types.void(types.int64, types.int64, types.int64)
_intersect1 = types.ExternalFunction("rtcIntersect1", _call)
_occluded1 = types.ExternalFunction("rtcOccluded1", _call)


class PlainEmbree:
    """Triangles as Embree keeps them: vertices (V,3) rounded to float32 about the scene's centre, faces (F,3)."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        library = embree()
        assert library is not None
        self._frame = frame_of(vertices, faces)
        self._points = np.zeros((len(vertices) + 2, 3), np.float32)  # Embree reads sixteen bytes at the last vertex
        self._points[:-2] = vertices * self._frame[SCALE] - self._frame[:3]
        self._faces = np.ascontiguousarray(faces, np.uint32)
        self._scene, geometry = library.rtcNewScene(library.device), library.rtcNewGeometry(library.device, _TRIANGLES)
        weakref.finalize(self, library.rtcReleaseScene, self._scene)
        library.rtcSetSceneBuildQuality(self._scene, _USUAL)
        library.rtcSetGeometryBuildQuality(geometry, _USUAL)
        index, points = self._faces.ctypes.data, self._points.ctypes.data
        library.rtcSetSharedGeometryBuffer(geometry, _INDEX, 0, _UINT3, index, 0, 12, len(faces))
        library.rtcSetSharedGeometryBuffer(geometry, _VERTEX, 0, _FLOAT3, points, 0, 12, len(vertices))
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(self._scene, geometry)
        library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(self._scene)

    @property
    def tree(self) -> tuple[np.int64, np.ndarray]:
        """Embree's scene, and the frame that its triangles are in, for other kernels."""
        return np.int64(self._scene), self._frame

    def cast(self, rays: Rays) -> tuple[np.ndarray, np.ndarray]:
        """Ray parameter (N,) float32 and triangle (N,) int64, -1: none; of any hit 0, whatever the triangle."""
        found: tuple[np.ndarray, np.ndarray] = cast_plain(self._scene, self._frame, rays)
        return found


@kernel()
def _plain_lane(scene, frame, rays, lane, lanes, out):
    """Every ``lanes``-th block of rays."""
    origins, directions, span, _, _, any_hit = rays
    length, triangle = out
    scale, n = frame[SCALE], origins.shape[0]
    contexts, arguments, hits = np.zeros(1, STATE), np.zeros(1, ARGUMENTS), np.zeros(1, RAY_HIT)
    contexts[0].instance, contexts[0].instance_primitive = -1, -1
    arguments[0].features, arguments[0].context = -1, contexts.ctypes.data
    ray, at_ray, at_arguments = hits[0], np.int64(hits.ctypes.data), np.int64(arguments.ctypes.data)
    for block in range(lane * BLOCK, n, lanes * BLOCK):
        for r in range(block, min(n, block + BLOCK)):
            ray.ox = origins[r, 0] * scale - frame[0]
            ray.oy = origins[r, 1] * scale - frame[1]
            ray.oz = origins[r, 2] * scale - frame[2]
            ray.dx, ray.dy, ray.dz = directions[r, 0] * scale, directions[r, 1] * scale, directions[r, 2] * scale
            ray.near, ray.time, ray.far = max(span[r, 0], 0.0), 0.0, span[r, 1]
            ray.mask, ray.number, ray.flags, ray.primitive, ray.geometry = -1, 0, 0, -1, -1
            if any_hit:
                _occluded1(scene, at_ray, at_arguments)
                triangle[r] = 0 if ray.far < 0 else -1
            else:
                _intersect1(scene, at_ray, at_arguments)
                triangle[r] = ray.primitive
            length[r] = ray.far


@kernel(parallel=True)
def cast_plain(scene, frame, rays):
    """Embree's own answer for each ray: its parameter (N,) float32 and triangle (N,) int64."""
    n = rays.origins.shape[0]
    out = (np.empty(n, np.float32), np.empty(n, np.int64))
    lanes = np.int64(min((n + BLOCK - 1) // BLOCK, LANES))
    for lane in prange(lanes):
        _plain_lane(np.int64(scene), frame, rays, np.int64(lane), lanes, out)
    return out
