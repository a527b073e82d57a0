"""Pinholes are closed where a surface goes on, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.kernels.warp.pinholes import DOWN, RIGHT
from torchrender.reconstruct.pinholes import AGREE, FEWEST, SMOOTH, close_pinholes

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


def twin(color, depth, valid, source):
    """The same, pixel by pixel."""
    before = [a.copy() for a in (color, depth, valid, source)]
    for j in range(1, valid.shape[0] - 1):
        for i in range(1, valid.shape[1] - 1):
            pairs = []
            for dj, di in LINES:
                a, b = (j + dj, i + di), (j - dj, i - di)
                if before[2][a] and before[2][b]:
                    near, far = float(before[1][a]), float(before[1][b])
                    if abs(near - far) <= SMOOTH * min(near, far):
                        pairs.append((a, b, 0.5 / near + 0.5 / far))
            mean = sum(p[2] for p in pairs) / max(len(pairs), 1)
            smooth = all(abs(p[2] - mean) <= AGREE * mean for p in pairs)
            if before[2][j, i] or len(pairs) < FEWEST or not smooth:
                continue
            valid[j, i], depth[j, i], source[j, i] = True, 1.0 / mean, before[3][pairs[0][0]]
            color[j, i] = sum(0.5 * (before[0][a].astype(float) + before[0][b]) for a, b, _ in pairs) / len(pairs)


def test_a_pinhole_in_a_plane_gets_the_plane() -> None:
    whole = tilted()
    got = punched(whole, (4, 5), (2, 2), (6, 8))
    assert close_pinholes(*got) == 3
    assert got[2].all() and np.abs(got[1] - whole[1]).max() < 1e-5 and np.abs(got[0] - whole[0]).max() < 1e-6
    assert set(got[3][[4, 2, 6], [5, 2, 8]] - np.array([4, 2, 6])) <= {-1, 0}


def test_outlines_and_real_holes_stay() -> None:
    color, depth, valid, source = tilted()
    depth[:, 6:] *= 3.0  # a step: what lies behind it is unseen along column 5
    crack = [(j, 5) for j in range(9)]
    for holes in (crack, [(4, 5)], [(j, i) for j in range(3, 6) for i in range(3, 6)], [(0, 3)]):
        got = punched((color, depth, valid, source), *holes)
        known = [a.copy() for a in got]
        filled = close_pinholes(*got)
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
    filled = close_pinholes(*first)
    twin(*second)
    assert filled > 5 and filled == int(second[2].sum() - (24 * 30 - len(holes)))
    for a, b in zip(first, second, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-7)


def test_small_pictures_have_none() -> None:
    assert close_pinholes(*punched(tilted(2, 9), (1, 4))) == 0


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
