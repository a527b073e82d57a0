"""Pinholes are closed where a surface goes on, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.kernels.warp.pinholes import DOWN, RIGHT
from torchrender.reconstruct.pinholes import AGREE, APART, FEWEST, SMOOTH, close_pinholes

LINES = tuple(zip(DOWN, RIGHT, strict=True))


def tilted(height: int = 9, width: int = 11) -> tuple[np.ndarray, ...]:
    """A plane: inverse depth is affine in the pixel; colours follow the columns, sources the rows."""
    j, i = np.mgrid[:height, :width]
    depth = (1.0 / (0.5 + 0.004 * i + 0.003 * j)).astype(np.float32)
    color = np.repeat((i / width)[..., None], 3, axis=2).astype(np.float32)
    return color, depth, np.ones((height, width), bool), j.astype(np.int64)


def punched(arrays: tuple[np.ndarray, ...], *pixels: tuple[int, int]) -> tuple[np.ndarray, ...]:
    color, depth, valid, source = (a.copy() for a in arrays)
    for at in pixels:
        color[at], depth[at], valid[at], source[at] = 0.0, np.inf, False, -1
    return color, depth, valid, source


def is_one_surface(near: float, far: float, limit: float = SMOOTH) -> bool:
    return abs(near - far) <= limit * min(near, far)


def is_seen_through(at: tuple[int, int], depth, valid, source) -> bool:
    for dj, di in LINES[:2]:
        a, b = (at[0] + dj, at[1] + di), (at[0] - dj, at[1] - di)
        if valid[a] and valid[b] and not source[a] == source[b] == source[at]:
            near, far = float(depth[a]), float(depth[b])
            if is_one_surface(near, far, APART) and float(depth[at]) > (1.0 + AGREE) * max(near, far):
                return True
    return False


def twin(color, depth, valid, source) -> int:
    """The same, pixel by pixel."""
    before = [a.copy() for a in (color, depth, valid, source)]
    inner = [(j, i) for j in range(1, valid.shape[0] - 1) for i in range(1, valid.shape[1] - 1)]
    through = {at for at in inner if valid[at] and is_seen_through(at, depth, valid, source)}
    own = before[2].copy()
    for at in through:
        own[at] = False
    count = 0
    for j, i in inner:
        pairs = []
        for dj, di in LINES:
            a, b = (j + dj, i + di), (j - dj, i - di)
            if own[a] and own[b]:
                near, far = float(before[1][a]), float(before[1][b])
                if is_one_surface(near, far):
                    pairs.append((a, b, 0.5 / near + 0.5 / far))
        mean = sum(p[2] for p in pairs) / max(len(pairs), 1)
        smooth = all(abs(p[2] - mean) <= AGREE * mean for p in pairs)
        if own[j, i]:
            continue
        if len(pairs) < FEWEST[(j, i) in through] or not smooth:
            if (j, i) in through:
                valid[j, i], depth[j, i], source[j, i], color[j, i] = False, np.inf, -1, 0.0
            continue
        valid[j, i], depth[j, i], source[j, i] = True, 1.0 / mean, before[3][pairs[0][0]]
        color[j, i] = sum(0.5 * (before[0][a].astype(float) + before[0][b]) for a, b, _ in pairs) / len(pairs)
        count += 1
    return count


def closed(arrays: tuple[np.ndarray, ...]) -> int:
    return int(close_pinholes(*arrays)[0].sum())


def test_a_pinhole_in_a_plane_gets_the_plane() -> None:
    whole = tilted()
    got = punched(whole, (4, 5), (2, 2), (6, 8))
    assert closed(got) == 3
    assert got[2].all() and np.abs(got[1] - whole[1]).max() < 1e-5 and np.abs(got[0] - whole[0]).max() < 1e-6
    assert set(got[3][[4, 2, 6], [5, 2, 8]] - np.array([4, 2, 6])) <= {-1, 0}


def test_outlines_and_real_holes_stay() -> None:
    color, depth, valid, source = tilted()
    depth[:, 6:] *= 3.0  # a step: what lies behind it is unseen along column 5
    crack = [(j, 5) for j in range(9)]
    for holes in (crack, [(4, 5)], [(j, i) for j in range(3, 6) for i in range(3, 6)], [(0, 3)]):
        got = punched((color, depth, valid, source), *holes)
        known = [a.copy() for a in got]
        filled = closed(got)
        still = [at for at in holes if not got[2][at]]
        assert filled == len(holes) - len(still)
        assert holes == [(4, 5)] or filled == 0
        assert all(np.array_equal(a[known[2]], b[known[2]]) for a, b in zip(got, known, strict=True))


@pytest.mark.parametrize("seed", range(3))
def test_the_twin_agrees_on_noise(seed: int) -> None:
    random = np.random.default_rng(seed)
    arrays = tilted(24, 30)
    arrays[1][random.random((24, 30)) < 0.1] *= 2.0
    holes = [tuple(at) for at in np.argwhere(random.random((24, 30)) < 0.15)]
    first, second = punched(arrays, *holes), punched(arrays, *holes)
    filled = closed(first)
    assert filled > 5 and filled == twin(*second)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_the_twin_agrees_where_images_mingle(seed: int) -> None:
    random = np.random.default_rng(seed)
    color, depth, valid, _ = tilted(24, 30)
    behind = random.random((24, 30)) < 0.12
    source = np.where(behind, random.integers(0, 2, (24, 30)), 0)
    depth[behind] *= 1.2
    first, second = ([a.copy() for a in (color, depth, valid, source)] for _ in range(2))
    filled = closed(tuple(first))
    assert filled > 5 and filled == twin(*second)
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-7)


def test_what_lies_behind_a_surface_does_not_show_through_it() -> None:
    """A crack between the samples of one image, through which another one shows what is behind."""
    whole = tilted()
    color, depth, valid, source = (a.copy() for a in whole)
    source[:] = 0
    own = [a.copy() for a in (color, depth, valid, source)]
    for at in ((4, 4), (4, 5), (4, 6)):
        color[at], depth[at], source[at] = 0.0, 1.3 * depth[at], 1
    assert closed((color, depth, valid, source)) == 3
    assert np.abs(depth - own[1]).max() < 1e-5 and (source == 0).all()
    for at in ((4, 4), (4, 5), (4, 6)):  # of the same image: it saw a hole there
        own[1][at] *= 1.3
    assert closed(tuple(own)) == 0


def test_what_shows_through_the_edge_of_two_walls_is_emptied() -> None:
    """Above and below differ by more than a surface does; a row between them shows the inside of the wall."""
    color, depth, valid, source = tilted()
    source[:] = 0
    depth[5:] *= 1.1
    seen = (valid.copy(), depth.copy(), color.copy(), source.copy())
    for column in (3, 4, 5, 8):
        color[4, column], depth[4, column], source[4, column] = 0.0, 1.3 * depth[4, column], 1
    row = [3, 4, 5, 8]
    assert closed((color, depth, valid, source)) == 0
    assert not valid[4, row].any() and np.isinf(depth[4, row]).all() and (source[4, row] == -1).all()
    rest = np.ones_like(valid)
    rest[4, row] = False
    for now, before in zip((valid, depth, color, source), seen, strict=True):
        assert np.array_equal(now[rest], before[rest])
    color, depth, valid, source = (seen[k].copy() for k in (2, 1, 0, 3))
    depth[4], depth[5:], source[4] = 1.25 * depth[4], 1.3 * depth[5:], 1  # an outline: what is behind is seen beside it
    kept = [a.copy() for a in (color, depth, valid, source)]
    assert closed((color, depth, valid, source)) == 0
    assert all(np.array_equal(a, b) for a, b in zip((color, depth, valid, source), kept, strict=True))


def test_small_pictures_have_none() -> None:
    assert closed(punched(tilted(2, 9), (1, 4))) == 0


def test_near_views_of_a_surface_have_no_pinholes() -> None:
    """A wall seen a step aside: every pixel that the image can know is known, and its depth is right."""
    wall = tr.Scene(meshes=[tr.Mesh.sphere(1.0, segments=96)])
    here = tr.Cameras.look_at([0, 0, 3.0], [0, 0, 0], width=96, height=96, fov_deg=30)
    aside = tr.Cameras.look_at([0.25, 0.1, 2.9], [0, 0, 0], width=96, height=96, fov_deg=30)
    images = tr.sample_depth_images(wall, here)
    exact = tr.rasterize(wall, aside)
    seen = tr.visibility(here, exact)[0] & exact.covered[0]
    inner = -torch.nn.functional.max_pool2d(-seen[None].float(), 5, 1, 2)[0] > 0  # away from outlines
    closed = tr.reproject(images, aside)
    assert bool(closed.valid[0][inner].all())
    assert float((closed.depth[0] - exact.depth[0])[inner].abs().max()) < 0.02
    plain = tr.reproject(images, aside, options=tr.ReprojectOptions(close_pinholes=False))
    known = plain.valid
    assert torch.equal(plain.color[known], closed.color[known])
    assert int((closed.valid & ~known).sum()) < 0.05 * int(known.sum())
