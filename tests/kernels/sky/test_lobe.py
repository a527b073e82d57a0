"""The lobe over a tree of cells beside its slow twin, which opens cells by recursion."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from torchrender.kernels.sky.lobe import SkyTree, lobe_mean, lobe_weight
from torchrender.scene.sky.prefilter import sky_tree


def weight(cosine: float, alpha: float) -> float:
    up = (1 + cosine) / 2
    return (alpha / (up * (alpha * alpha - 1) + 1)) ** 2 * max(cosine, 0.0)


def twin(tree: SkyTree, normal: np.ndarray, alpha: float, detail: float) -> np.ndarray:
    def visit(level: int, j: int, i: int) -> np.ndarray:
        cell = tree.cells[tree.starts[level] + j * (2 * tree.rows << level) + i].astype(float)
        cosine = float(cell[:3] @ normal)
        if cosine < -cell[7]:
            return np.zeros(4)
        wide = cell[7] > detail * max(alpha, 0.5 * math.sqrt(max(2 - 2 * cosine, 0.0)))
        if level + 2 < len(tree.starts) and wide:
            return sum(visit(level + 1, 2 * j + a, 2 * i + b) for a in (0, 1) for b in (0, 1))
        return weight(cosine, alpha) * cell[3:7]

    total = sum(visit(0, j, i) for j in range(tree.rows) for i in range(2 * tree.rows))
    return total[1:] / total[0]


@pytest.mark.parametrize("alpha", [0.05, 0.3, 1.0])
def test_it_is_the_mean_over_the_lobe(alpha: float) -> None:
    radiance = torch.rand(64, 128, 3, generator=torch.Generator().manual_seed(2)) ** 8
    tree = sky_tree(radiance)
    normals = torch.nn.functional.normalize(torch.randn(5, 3, generator=torch.Generator().manual_seed(4)), dim=-1)
    total = torch.full((5, 3), math.nan)
    lobe_mean(tree, normals.numpy(), (alpha, 0.5), total.numpy())
    expected = np.stack([twin(tree, n.astype(float), alpha, 0.5) for n in normals.numpy()])
    np.testing.assert_allclose(total.numpy(), expected, rtol=2e-3)


def test_the_weight_is_the_lobe() -> None:
    for cosine in (-1.0, -0.2, 0.0, 0.3, 0.9, 1.0):
        for alpha in (0.01, 0.5, 1.0):
            found = lobe_weight(np.float32(cosine), np.float32(alpha))
            assert found == pytest.approx(weight(cosine, alpha), rel=1e-4, abs=1e-9)
