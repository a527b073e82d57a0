"""Neighbours share their rays alike, by compiled loops and by tensors."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from torchrender.buffers import ReflectionLayer
from torchrender.effects.reflections import glossy
from torchrender.effects.reflections.glossy import LEAST, SHARE, WIDE
from torchrender.kernels.reflections.share import Lobes, share_around


def layer_of(seed: int, shape: tuple[int, int, int]) -> tuple[ReflectionLayer, torch.Tensor]:
    """Three reflectors in patches, some pixels without one, directions that differ about as much as lobes are wide."""
    rng = torch.Generator().manual_seed(seed)
    reflector = torch.randint(-1, 3, (shape[0], shape[1] // 4 + 1, shape[2] // 4 + 1), generator=rng)
    reflector = reflector.repeat_interleave(4, 1).repeat_interleave(4, 2)[:, : shape[1], : shape[2]].contiguous()
    direction = torch.tensor([0.0, 0.6, 0.8]) + 0.1 * torch.randn(*shape, 3, generator=rng)
    alpha = torch.rand(shape, generator=rng).square() * (torch.rand(shape, generator=rng) > 0.2)
    covered = reflector >= 0
    made = ReflectionLayer(
        color=torch.rand(*shape, 3, generator=rng) * covered[..., None],
        distance=torch.full(shape, torch.inf),
        direction=torch.nn.functional.normalize(direction, dim=-1),
        state=covered.to(torch.uint8),
        cluster=reflector,
    )
    return made, SHARE * alpha * covered


@pytest.mark.parametrize("shape", [(2, 37, 41), (1, 2, 9), (1, 9, 1), (1, 1, 1)])
@pytest.mark.parametrize("wide", [False, True])
def test_loops_and_tensors_agree(shape: tuple[int, int, int], wide: bool) -> None:
    layer, width = layer_of(sum(shape), shape)
    found, wanted = glossy._compiled(layer, width, wide), glossy.in_torch(layer, width, wide)
    torch.testing.assert_close(found, wanted, rtol=2e-6, atol=2e-6)
    if shape[0] == 2:
        assert float((wanted - layer.color).abs().max()) > 0.2, "something is shared"
        assert bool((glossy.in_torch(layer, width, True) != glossy.in_torch(layer, width, False)).any())


def test_weights_of_one_pixel() -> None:
    """By hand: a pixel in the middle of nine, of which one is another reflector's and one is a mirror."""
    rng = np.random.default_rng(3)
    color, direction = rng.random((3, 3, 3), np.float32), rng.random((3, 3, 3), np.float32)
    width = rng.uniform(0.3, 0.9, (3, 3)).astype(np.float32)
    reflector = np.full((3, 3), 7)
    reflector[0, 1], width[2, 2] = 5, 0.0
    out = np.zeros_like(color)
    share_around(Lobes(color, direction, width, reflector), 1, (LEAST, LEAST), out)
    total, weight = np.zeros(3), 0.0
    for j in range(3):
        for i in range(3):
            if (j, i) not in ((0, 1), (2, 2)):
                off = ((direction[1, 1].astype(float) - direction[j, i]) ** 2).sum()
                own = np.exp(-off / (2.0 * float(width[1, 1]) ** 2))
                total, weight = total + own * color[j, i], weight + own
    np.testing.assert_allclose(out[1, 1], total / weight, rtol=1e-5)
    np.testing.assert_array_equal(out[2, 2], color[2, 2])
    narrow = np.zeros_like(color)
    share_around(Lobes(color, direction, width, reflector), 1, (1.0, LEAST), narrow)
    np.testing.assert_array_equal(narrow, color)


def test_gradients_go_through_what_is_shared() -> None:
    layer, width = layer_of(5, (1, 12, 15))
    color = layer.color.clone().requires_grad_()
    shared = glossy.in_torch(
        ReflectionLayer(color, layer.distance, layer.direction, layer.state, layer.cluster), width, bool(WIDE)
    )
    shared.square().sum().backward()
    assert color.grad is not None and float(color.grad.abs().sum()) > 0.0
