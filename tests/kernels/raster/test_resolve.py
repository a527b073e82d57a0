"""A finished tile into the image, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.project import barycentric_planes
from torchrender.kernels.raster.records import NO_IDS, Buffers, Frame, Triangles, Visible
from torchrender.kernels.raster.resolve import CACHED, resolve, resolve_blank


def tile(rng: np.random.Generator, faces: int) -> Buffers:
    """Runs of triangles, whose ids share places among the kept planes."""
    pixels = TILE_WIDTH * TILE_HEIGHT
    ids = np.repeat(rng.choice([-1, 0, 1, CACHED, CACHED + 1, faces - 1], pixels // 4), 4).astype(np.int32)
    known, planes = np.full(CACHED, -1, np.int64), np.full((CACHED, 6), np.nan)
    return Buffers(
        0, rng.uniform(0.1, 1, pixels), ids, np.zeros(0), np.zeros((2, TILE_HEIGHT), np.int64), known, planes
    )


@pytest.mark.parametrize("wants_ids", [False, True])
@pytest.mark.parametrize("orthographic", [False, True])
def test_a_tile_against_a_loop(orthographic: bool, wants_ids: bool) -> None:
    rng = np.random.default_rng(0)
    count = 2 * CACHED + 5
    z = rng.uniform(1, 9, (count + 2, 1))
    points = np.concatenate([rng.uniform(-60, 60, (count + 2, 2)) * (1 if orthographic else z), z, z], axis=1)
    faces = np.stack([np.arange(count), np.arange(count) + 1, np.arange(count) + 2], 1).astype(np.int32)
    objects = rng.integers(0, 9, count)
    nothing, none = np.zeros((0, 3), np.int64), np.zeros(0, np.int32)
    lists = (nothing, np.zeros(0, np.uint64), np.zeros(0), none, np.zeros((0, 4), np.int32))
    order = np.arange(count, dtype=np.int32)
    scene = Triangles(points, faces, objects, order, faces, *lists, nothing, none)
    frame = Frame(150, 80, 0.1, 100.0, orthographic)
    left, top, width, height = 64, 32, 51, 23
    buffers = tile(rng, count)
    if orthographic:
        buffers = buffers._replace(keys=-1.0 / buffers.keys)
    keys = buffers.keys.copy()  # they become depths
    depth = np.full((80, 150), -7, np.float32)
    others = (np.full((80, 150), -7), np.full((80, 150), -7), np.full((80, 150, 2), -7, np.float32))
    out = Visible(depth, *(others if wants_ids else NO_IDS))
    resolve(scene, frame, (left, top, width, height), buffers, out)
    assert (np.delete(out.depth.reshape(-1), 0)[: 32 * 150 - 1] == -7).all()
    assert (out.depth != -7).sum() == width * height
    for y in range(height):
        for x in range(width):
            place, at = (top + y, left + x), y * TILE_WIDTH + x
            key, t = keys[at], buffers.ids[at]
            found = -key if orthographic else 1.0 / key
            assert out.depth[place] == np.float32(found if t >= 0 else np.inf)
            if not wants_ids:
                continue
            assert out.triangle[place] == t and out.object_id[place] == (objects[t] if t >= 0 else -1)
            px, py = left + x + 0.5 - 75, top + y + 0.5 - 40
            u = v = 0.0
            if t >= 0:
                ux, uy, uc, vx, vy, vc = barycentric_planes(points, faces, t, orthographic)
                weight = 1.0 if orthographic else 1.0 / key
                u = min(max((ux * px + uy * py + uc) * weight, 0.0), 1.0)
                v = min(max((vx * px + vy * py + vc) * weight, 0.0), 1.0 - u)
            np.testing.assert_allclose(out.barycentric[place], [u, v], atol=1e-6)


@pytest.mark.parametrize("wants_ids", [False, True])
@pytest.mark.parametrize("width", [1, 8, 51, 64])
def test_a_tile_without_a_surface_is_written_and_nothing_beside_it(width: int, wants_ids: bool) -> None:
    out = Visible(np.full((40, 120), -7, np.float32), *NO_IDS)
    if wants_ids:
        out = Visible(out.depth, np.full((40, 120), -7), np.full((40, 120), -7), np.full((40, 120, 2), -7, np.float32))
    resolve_blank((3, 5, width, 23), np.full(TILE_WIDTH, np.inf), out)
    inside = np.zeros((40, 120), bool)
    inside[5:28, 3 : 3 + width] = True
    for image, blank in zip(out, (np.inf, -1, -1, 0.0), strict=True):
        if image.size:
            assert (image[inside] == blank).all() and (image[~inside] == -7).all()
