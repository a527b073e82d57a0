"""The indexed mesh of joined quads, corner by corner."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.warp.corner_mesh import Faces, Joined, Vertices, count_rows, write_mesh
from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND

PIXELS = ((0, 0), (-1, 0), (-1, -1), (0, -1))  # row and column, from corner (j, i), of the pixel whose corner k it is


def random_words(rng: np.random.Generator, shape: tuple[int, ...], filled: np.ndarray):
    """Groups of the filled pixels around every corner, and the words that say so."""
    words, groups = np.zeros(shape, np.int32), {}
    for b, j, i in np.ndindex(shape):
        present = []
        for k, (y, x) in enumerate(PIXELS):
            row, column = j + y, i + x
            if 0 <= row < filled.shape[1] and 0 <= column < filled.shape[2] and filled[b, row, column]:
                present.append(k)
        label = {k: k for k in range(4)}
        names = {k: int(rng.integers(0, 2)) for k in present}
        for k in present:
            label[k] = min(m for m in present if names[m] == names[k])
        leaders = {label[k] for k in present}
        true = {k for k in present if rng.random() < 0.5}
        word = sum(label[k] << (2 * k) for k in range(4)) + sum(1 << (8 + k) for k in leaders)
        words[b, j, i] = word + sum(1 << (12 + k) for k in true)
        groups[b, j, i] = (label, sorted(leaders), true)
    return words, groups


@pytest.mark.parametrize("colored", [False, True])
def test_mesh_against_a_loop(colored: bool) -> None:
    rng = np.random.default_rng(0)
    count, height, width = 2, 5, 6
    filled = rng.random((count, height, width)) < 0.8
    both = FIRST | SECOND
    shape = np.where(filled, rng.choice([both, both | DIAGONAL], filled.shape), 0).astype(np.uint8)
    words, groups = random_words(rng, (count, height + 1, width + 1), filled)
    depths = rng.uniform(1, 5, (count, height, 4, width)).astype(np.float32)
    poses, color = rng.normal(size=(count, 3, 4)), rng.random((count, height, width, 3)).astype(np.float32)
    per_corner_row, per_row = np.zeros(count * (height + 1), np.int64), np.zeros(count * height, np.int64)
    count_rows(words, shape, per_corner_row, per_row)
    np.testing.assert_array_equal(per_row, filled.sum(axis=2).reshape(-1))

    number, position, corner, guessed, tint = {}, [], [], [], []
    for b, j, i in np.ndindex(words.shape):
        label, leaders, true = groups[b, j, i]
        for k in leaders:
            number[b, j, i, k] = len(position)
            y, x = j + PIXELS[k][0], i + PIXELS[k][1]
            position.append(float(depths[b, y, k, x]) * (poses[b, :, :3] @ [i, j, 1.0]) + poses[b, :, 3])
            corner.append(j * (width + 1) + i)
            guessed.append(k not in true)
            members = [m for m in range(4) if label[m] == k]
            tint.append(np.mean([color[b, j + PIXELS[m][0], i + PIXELS[m][1]] for m in members], axis=0))
    starts = np.concatenate([[0], np.cumsum(per_corner_row)])
    assert starts[-1] == len(position)
    faces, source, counts = [], [], np.zeros((count * height, 5), np.int64)
    for b, j, i in np.argwhere(filled):
        names, right = [], 0
        for k, (y, x) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
            label, _, true = groups[b, j + y, i + x]
            names.append(number[b, j + y, i + x, label[k]])
            right += k in true
        if shape[b, j, i] & DIAGONAL:
            names = [*names[1:], names[0]]
        faces += [[names[0], names[1], names[2]], [names[2], names[3], names[0]]]
        source.append(j * width + i)
        counts[b * height + j, right] += 1

    made = Vertices(np.zeros((len(position), 3)), np.zeros(len(position), np.int64), np.zeros(len(position), np.bool_),
                    np.zeros((len(position) if colored else 0, 3), np.float32))  # fmt: skip
    out = Faces(np.zeros((len(faces), 3), np.int32), np.zeros(len(source), np.int64), np.zeros_like(counts))
    first_quad = np.concatenate([[0], np.cumsum(per_row)])
    texels = color if colored else np.zeros((0, 0, 0, 3), np.float32)
    write_mesh(Joined(depths, words, shape), poses, texels, starts, first_quad, made, out)
    np.testing.assert_allclose(made.position, position, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(made.corner, corner)
    np.testing.assert_array_equal(made.guessed, guessed)
    np.testing.assert_array_equal(out.corners, faces)
    np.testing.assert_array_equal(out.source, source)
    np.testing.assert_array_equal(out.counts, counts)
    if colored:
        np.testing.assert_allclose(made.color, tint, rtol=1e-5)
