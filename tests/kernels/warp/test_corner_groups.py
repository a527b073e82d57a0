"""Which pixels share a corner, against pairs joined one after the other."""

from __future__ import annotations

import numba
import numpy as np

from torchrender.kernels.warp.corner_groups import EMPTY, GUESSED, TRUE, group, shared_words


def slow_group(s: list[int], z: list[float], t: list[float], owner: list[int], merge: bool) -> tuple[int, list[float]]:
    label = list(range(4))
    true = [k for k in range(4) if s[k] == TRUE]
    for k in true:
        label[k] = true[0]
    for b in range(1, 4):
        for a in range(b):
            guessed = s[a] == s[b] == GUESSED and owner[a] == owner[b]
            if merge and guessed and abs(z[a] - z[b]) <= min(t[a], t[b]):
                low, high = sorted((label[a], label[b]))
                label = [low if one == high else one for one in label]
    depths = list(z)
    for k in range(4):
        shared = [n for n in range(4) if s[n] == GUESSED and label[n] == label[k]]
        if s[k] == GUESSED and len(shared) > 1:
            depths[k] = float(np.float32(sum(float(np.float32(z[n])) for n in shared) / len(shared)))
    word = sum(label[k] << (2 * k) for k in range(4))
    word |= sum(1 << (8 + k) for k in range(4) if s[k] != EMPTY and label[k] == k)
    return word | sum(1 << (12 + k) for k in true), depths


@numba.njit
def quick_group(s, z, t, owner, merge, words):
    return group(
        (s[0], s[1], s[2], s[3]), (z[0], z[1], z[2], z[3]), (t[0], t[1], t[2], t[3]),
        (owner[0], owner[1], owner[2], owner[3]), merge, words,
    )  # fmt: skip


def test_groups_at_a_corner_equal_the_slow_twin() -> None:
    rng = np.random.default_rng(3)
    words = np.zeros(64, np.int32)
    shared_words(words)
    kinds = set()
    for _ in range(3000):
        s = rng.choice(np.array([EMPTY, GUESSED, GUESSED, TRUE], np.uint8), 4)
        z = rng.choice(np.array([1.0, 1.01, 1.03, 1.3, np.inf], np.float32), 4)
        z[s == EMPTY] = np.inf
        t = rng.choice(np.array([0.0, 0.015, 0.05], np.float32), 4)
        owner, merge = rng.integers(0, 2, 4), bool(rng.integers(0, 4))
        word, depths = quick_group(s, z, t, owner, merge, words)
        wanted, means = slow_group(s.tolist(), z.tolist(), t.tolist(), owner.tolist(), merge)
        assert word == wanted
        np.testing.assert_array_equal(np.array(depths, np.float32), np.array(means, np.float32))
        kinds.add(word)
    assert len(kinds) > 60
