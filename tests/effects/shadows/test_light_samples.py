"""Samples of rectangular lights, and the parts that they fall into."""

from __future__ import annotations

import math

import pytest
import torch

from torchrender.effects.shadows.light_samples import light_grid
from torchrender.scene.light import RectLight, cell_shares

BOX = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], dtype=torch.float64)


def grid(per_side: int, edge_v: tuple[float, float, float] = (0.3, 0.0, 2.0)):
    light = RectLight(
        corner=torch.tensor([-0.5, 3.0, -0.5]), edge_u=torch.tensor([1.0, 0.2, 0.0]), edge_v=torch.tensor(edge_v)
    )
    return light_grid(light, BOX, per_side=per_side, size=64)


@pytest.mark.parametrize("per_side", [1, 3, 4, 5, 16])
def test_parts_hold_their_samples_and_cover_the_light(per_side: int) -> None:
    g = grid(per_side)
    part, outlines = g.tiles(per_side, 4)
    assert len(outlines) == (-(-per_side // 4)) ** 2
    corner, u, v = outlines[part].unbind(1)
    edges = torch.stack([u, v, torch.linalg.cross(u, v)], dim=2)
    a, b, height = torch.linalg.solve(edges, g.samples - corner).unbind(1)
    for share in (a, b):
        assert bool(((share > 0) & (share < 1)).all())
    assert float(height.abs().max()) < 1e-12
    assert int(torch.bincount(part).max()) <= 16
    area = torch.linalg.cross(outlines[:, 1], outlines[:, 2]).norm(dim=1).sum()
    assert float(area) == pytest.approx(float(torch.linalg.cross(g.outline[1], g.outline[2]).norm()))


@pytest.mark.parametrize("edge_v", [(0.0, 0.0, 0.0), (2.0, 0.4, 0.0)])
def test_a_line_is_one_part_even_of_sixteen_samples(edge_v: tuple[float, float, float]) -> None:
    part, outlines = grid(16, edge_v).tiles(16, 4)
    assert len(part) == 16 and len(outlines) == 1 and int(part.max()) == 0


@pytest.mark.parametrize("share", [0.0, 0.5, -0.5, -2.0])
@pytest.mark.parametrize("per_side", [1, 4])
def test_samples_of_a_line_are_the_middles_of_equal_parts_from_tip_to_tip(share: float, per_side: int) -> None:
    """Edges one after the other, or against each other: then the tips are their ends."""
    u = torch.tensor([1.0, 0.2, 0.0]).double()
    found = grid(per_side, tuple((share * u).tolist()))
    corner = torch.tensor([-0.5, 3.0, -0.5], dtype=torch.float64)
    low, high = min(0.0, share, 1.0 + share), max(1.0, share, 1.0 + share)
    t = low + (high - low) * (torch.arange(per_side, dtype=torch.float64) + 0.5) / per_side
    wanted = corner + t[:, None] * u
    ends = corner + torch.tensor([low, high], dtype=torch.float64)[:, None] * u
    in_turn = found.samples if float((found.samples[-1] - found.samples[0]) @ u) >= 0 else found.samples.flip(0)
    torch.testing.assert_close(in_turn, wanted, atol=1e-6, rtol=0)
    tips = torch.stack([found.outline[0], found.outline[0] + found.outline[1]])
    tips = tips if float((tips[1] - tips[0]) @ u) > 0 else tips.flip(0)
    torch.testing.assert_close(tips, ends, atol=1e-6, rtol=0)


@pytest.mark.parametrize("n", [1, 2, 5, 16])
def test_staggered_samples_cover_edges_one_by_one(n: int) -> None:
    """One in each cell, and along either edge one in each of n^2 equal steps; cell centres repeat n shares n times."""
    shares = cell_shares(n, staggered=True)
    cells = torch.stack(torch.meshgrid(torch.arange(n), torch.arange(n), indexing="ij"), dim=-1)
    assert torch.equal((shares * n).floor().long(), cells)
    for axis in range(2):
        assert (shares[..., axis] * n * n).floor().long().reshape(-1).sort().values.tolist() == list(range(n * n))
    assert torch.allclose(shares.mean(dim=(0, 1)), torch.full((2,), 0.5, dtype=torch.float64))
    assert len(cell_shares(n)[..., 0].unique()) == n


def test_staggered_samples_share_out_what_straight_edges_hide() -> None:
    """Half planes in every direction through a light of 16 x 16 samples, against their exact area; of 255."""
    generator = torch.Generator().manual_seed(3)
    angle = 2 * math.pi * torch.rand(400, generator=generator, dtype=torch.float64)
    normal = torch.stack([angle.cos(), angle.sin()], dim=1)
    offset = (torch.rand(400, 2, generator=generator, dtype=torch.float64) * normal).sum(1)
    shares = cell_shares(16, staggered=True).reshape(-1, 2)
    found = (normal @ shares.T > offset[:, None]).double().mean(1)
    fine = (torch.arange(1000, dtype=torch.float64) + 0.5) / 1000
    # Along each line of the square the half plane holds an interval: exact in one direction, fine in the other.
    cut = (offset[:, None] - normal[:, 1:] * fine) / normal[:, :1]
    held = torch.where(normal[:, :1] > 0, 1.0 - cut.clamp(0.0, 1.0), cut.clamp(0.0, 1.0)).mean(1)
    assert 255 * float((found - held).abs().mean()) < 0.9
