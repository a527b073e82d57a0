"""Winding numbers of boxes, inside and out."""

from __future__ import annotations

import torch

from torchrender.numerics.winding import winding_number
from torchrender.scene.shapes import box, sphere


def test_one_inside_none_outside() -> None:
    for mesh in (box(torch.tensor([2.0, 1.0, 3.0])), sphere(0.9, 24)):
        corners = mesh.vertices.double()[mesh.faces]
        points = torch.tensor([[0.0, 0.0, 0.0], [0.3, 0.2, -0.4], [2.0, 0.0, 0.0], [0.0, 5.0, 1.0]])
        found = winding_number(corners, points)
        torch.testing.assert_close(found.abs(), torch.tensor([1.0, 1.0, 0.0, 0.0]).double(), atol=1e-9, rtol=0)
        torch.testing.assert_close(winding_number(corners.flip(1), points), -found)


def test_half_of_a_box_counts_half() -> None:
    mesh = box(torch.full((3,), 2.0))
    corners = mesh.vertices.double()[mesh.faces]
    upper = corners[(corners.mean(dim=1)[:, 1] > 0.99)]
    assert abs(float(winding_number(upper, torch.zeros(1, 3)).abs()) - 1.0 / 6.0) < 1e-9
