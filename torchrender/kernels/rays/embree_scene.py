"""Scenes of Embree over the padded boxes of triangles."""

from __future__ import annotations

import weakref

import numpy as np

from torchrender.kernels.raster.records import NO_HOLES, Holes
from torchrender.kernels.rays.boxes import (
    LINE,
    SCALE,
    count_pieces,
    cut_boxes,
    frame_of,
    group_triangles,
    pack_groups,
)
from torchrender.kernels.rays.embree import PAD, Boxes, callbacks, cast_through_boxes
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.watertight import Rays

QUICK, USUAL = 0, 1
"""Build qualities of Embree: Morton order, or binned surface area heuristic."""
_USER = 120  # kind of geometry
_MOST_EXTRA = 2.0  # pieces on top of one, per triangle on average
_FILLED = 3.0  # box surface over shadow up to which nothing is cut


class EmbreeScene:
    """Triangles that Embree finds by their boxes and the callback settles in float64.

    Args:
        vertices: (V,3) float64.
        faces: (F,3) int32.
        quality: :data:`QUICK` or :data:`USUAL`.

    Only where :func:`~torchrender.kernels.rays.embree_library.embree` has found a library.

    Attributes:
        coarseness: share of boxes that are mostly padding; where it is large, triangles are too small for float32.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, quality: int = USUAL) -> None:
        frame = frame_of(vertices, faces)
        points = vertices * frame[SCALE]
        starts = np.empty(len(faces), np.int32)
        parts = group_triangles(points, faces, starts)
        groups = int(parts[-1])
        packed, waste, first = _lines(groups), np.empty(groups, np.float32), np.empty(groups + 1, np.int32)
        sums = pack_groups((points, faces), starts, parts, packed, waste, PAD).sum(axis=0)
        surface, coarse, shadows, wasted = sums.tolist()
        self.coarseness = coarse / max(groups, 1)
        # Twice the shadows is the surface of a box without depth: cut where boxes are mostly air.
        extra = float(np.clip(0.5 * (surface / max(shadows, 1e-300) - _FILLED), 0.0, _MOST_EXTRA))
        count_pieces(waste, extra * groups / max(wasted, 1e-300), first)
        count = int(first[-1])
        self._boxes, owner = np.empty((count, 6), np.float32), np.empty(count, np.int32)
        cut_boxes(packed, frame, first, PAD, self._boxes, owner)
        self._record = Boxes(self._commit(count, quality), packed, owner if count > groups else owner[:0], faces, frame)

    def _commit(self, count: int, quality: int) -> int:
        library = embree()
        assert library is not None
        box_of, settle = callbacks()
        scene, geometry = library.rtcNewScene(library.device), library.rtcNewGeometry(library.device, _USER)
        weakref.finalize(self, library.rtcReleaseScene, scene)
        library.rtcSetSceneBuildQuality(scene, quality)
        library.rtcSetGeometryBuildQuality(geometry, quality)
        library.rtcSetGeometryUserPrimitiveCount(geometry, count)
        library.rtcSetGeometryUserData(geometry, self._boxes.ctypes.data)
        library.rtcSetGeometryBoundsFunction(geometry, box_of.address, None)
        library.rtcSetGeometryIntersectFunction(geometry, settle.address)
        library.rtcSetGeometryOccludedFunction(geometry, settle.address)
        library.rtcCommitGeometry(geometry)
        library.rtcAttachGeometry(scene, geometry)
        library.rtcReleaseGeometry(geometry)  # the scene holds it
        library.rtcCommitScene(scene)
        error = library.rtcGetDeviceError(library.device)
        if error:
            raise MemoryError(f"Embree cannot build a tree over {count} boxes: error {error}")
        self._boxes = self._boxes[:0]  # only building reads them
        return int(scene)

    def cast(self, rays: Rays, holes: Holes | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As of :func:`~torchrender.kernels.rays.embree.cast_through_boxes`."""
        found: tuple[np.ndarray, np.ndarray, np.ndarray] = cast_through_boxes(
            self._record, rays, NO_HOLES if holes is None else holes
        )
        return found


def _lines(count: int) -> np.ndarray:
    """(count,LINE) float64 that begins at a cache line."""
    room = np.empty(count * LINE + 8)
    start = (-room.ctypes.data % 64) // 8
    return room[start : start + count * LINE].reshape(count, LINE)
