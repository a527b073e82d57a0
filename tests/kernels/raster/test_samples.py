"""Pixel centres that small triangles hit, against a loop over pixels in exact integers."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.raster import binning, samples
from torchrender.kernels.raster.project import (
    CULL_BACK,
    CULL_FRONT,
    CULL_NONE,
    HALF,
    NEEDS_CLIP,
    SUBPIXEL,
    snap,
    snapped_x,
    snapped_y,
)
from torchrender.kernels.raster.records import Frame

FRAME = Frame(6, 5, 0.1, 10.0, False)


def drops(corners: list[tuple[int, int]], cull: int) -> bool:
    (ax, ay), (bx, by), (cx, cy) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    return area == 0 or (cull == CULL_BACK and area > 0) or (cull == CULL_FRONT and area < 0)


def covers(corners: list[tuple[int, int]], x: int, y: int, cull: int) -> bool:
    """One pixel: exact edges, whose points belong to the triangle on the side that the tie rule names."""
    (ax, ay), (bx, by), (cx, cy) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if drops(corners, cull):
        return False
    px, py = (x - 3) * SUBPIXEL + HALF, (y - 2) * SUBPIXEL + HALF
    for (ux, uy), (vx, vy) in zip(corners, corners[1:] + corners[:1], strict=True):
        dx, dy = (vx - ux, vy - uy) if area > 0 else (ux - vx, uy - vy)
        value = dx * (py - uy) - dy * (px - ux)
        owns = dy > 0 or (dy == 0 and dx < 0)
        if value < 0 or (value == 0 and not owns):
            return False
    return True


@pytest.mark.parametrize("cull", [CULL_NONE, CULL_BACK, CULL_FRONT])
def test_codes_are_the_pixels_of_a_loop(cull: int) -> None:
    """Also of corners on centres, slivers, points and triangles outside of the image; large ones are only told."""
    rng = np.random.default_rng(3)
    count = 1500
    centre, size = rng.uniform(-4.5, 4.5, (count, 1, 2)), rng.choice([0.05, 0.6, 1.4, 4.0], (count, 1, 1))
    points = centre + size * rng.uniform(-1, 1, (count, 3, 2))
    points[::3] = np.round(points[::3] * 2) / 2
    packed = np.zeros((3 * count, 4), np.int64)
    packed[:, 3] = [snap(*p) for p in points.reshape(-1, 2)]
    packed[4, 3] = NEEDS_CLIP
    listed = np.arange(3 * count, dtype=np.int32).reshape(count, 3)
    runs = np.array([[0, 7], [7, count]])
    chunk = samples.room_for(runs, np.array([1, 0]))
    assert len(chunk.codes) == count - 7
    kinds = set()
    for first, past in runs:
        samples.gather_corners(packed, listed, first, past - first, chunk)
        samples.find_samples(chunk, past - first, FRAME, (0, 0, FRAME.width - 1, FRAME.height - 1), cull)
        middle = chunk.codes[: past - first] == samples.MIDDLE
        samples.find_windows(chunk, past - first, FRAME, (0, 0, FRAME.width - 1, FRAME.height - 1))
        listed_ones = chunk.found[: samples.list_found(chunk, past - first)]
        assert listed_ones.tolist() == np.flatnonzero(chunk.codes[: past - first]).tolist()
        for n in range(past - first):
            code = int(chunk.codes[n])
            corners = [int(packed[v, 3]) for v in listed[first + n]]
            if NEEDS_CLIP in corners:
                assert code == samples.CROSSING
                continue
            places = [(int(snapped_x(c)), int(snapped_y(c))) for c in corners]
            x0, y0, x1, y1 = binning.pixel_box(*corners, (0, 0, 5, 4), 3, 2)
            hit = {(x, y) for y in range(5) for x in range(6) if covers(places, x, y, cull)}
            if code == samples.LARGE:
                assert max(x1 - x0, y1 - y0) >= samples.SIDE
            else:
                kept = x0 <= x1 and y0 <= y1 and not drops(places, cull)
                assert middle[n] == (kept and 1 < max(x1 - x0, y1 - y0) < samples.SIDE)
                bits = {(x0 + k % 8, y0 + k // 8) for k in range(64) if code >> k & 1}
                assert bits == hit
            kinds.add(code)
    assert len(kinds) > 5
