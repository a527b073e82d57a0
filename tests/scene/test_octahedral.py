"""Laws of the octahedral map: it can be undone, folds without a seam, and interpolates what is linear."""

from __future__ import annotations

import pytest
import torch

from torchrender.scene.sky.octahedral import (
    direction_from_square,
    interpolate_nodes,
    node_directions,
    square_from_direction,
)


def units(count: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=torch.Generator().manual_seed(1)), dim=-1)


@pytest.mark.parametrize("length", [1.0, 1e-6, 1e6])
def test_directions_survive_the_square(length: float) -> None:
    directions = torch.cat([units(500), torch.eye(3), -torch.eye(3)])
    square = square_from_direction(directions * length)
    assert bool(((square >= 0) & (square <= 1)).all())
    torch.testing.assert_close(direction_from_square(square), directions, atol=2e-6, rtol=0)


def test_up_is_the_middle_and_down_the_corners() -> None:
    assert square_from_direction(torch.tensor([0.0, 1.0, 0.0])).tolist() == [0.5, 0.5]
    corners = torch.tensor([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    torch.testing.assert_close(direction_from_square(corners), torch.tensor([[0.0, -1.0, 0.0]] * 4))


def test_folded_edges_meet() -> None:
    nodes = node_directions(17)
    for edge in (nodes[0], nodes[-1], nodes[:, 0], nodes[:, -1]):
        torch.testing.assert_close(edge, edge.flip(0), atol=1e-6, rtol=0)


def test_interpolation_is_exact_at_nodes_and_close_between() -> None:
    image = node_directions(33)
    torch.testing.assert_close(interpolate_nodes(image, image), image, atol=1e-5, rtol=0)
    directions = units(300)
    assert float((interpolate_nodes(node_directions(129), directions) - directions).abs().max()) < 1e-3


def test_it_is_differentiable_in_values_and_directions() -> None:
    image = torch.rand(5, 5, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64, requires_grad=True)
    directions = units(6).double().requires_grad_()
    assert torch.autograd.gradcheck(interpolate_nodes, (image, directions))
