"""Tangent frames: the direction of u on a plane, mirrored halves, shared corners, degenerate coordinates."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.numerics.tangents import Corners, derive_tangents, tangents_of


def quad(uv: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Two triangles in the plane z = 0 with texture coordinates (4,2) at their corners."""
    place = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=torch.float64)
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]])
    normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(2, 3, 3)
    return place[faces], normal, uv.double()[faces]


SQUARE = torch.tensor([[0.0, 0.0], [1, 0], [1, 1], [0, 1]])


def test_tangents_follow_u() -> None:
    for turn, wanted in ((SQUARE, [1.0, 0, 0]), (SQUARE[:, [1, 0]] * torch.tensor([1.0, -1.0]), [0.0, 1, 0])):
        made = derive_tangents(*quad(turn))
        torch.testing.assert_close(made[..., :3], torch.tensor(wanted).expand(2, 3, 3))
        assert bool((made[..., 3] == 1).all())


def test_a_mirrored_map_turns_the_bitangent() -> None:
    made = derive_tangents(*quad(SQUARE * torch.tensor([-1.0, 1.0])))
    torch.testing.assert_close(made[..., :3], torch.tensor([-1.0, 0, 0]).expand(2, 3, 3))
    assert bool((made[..., 3] == -1).all())


def test_halves_mirrored_at_an_edge_do_not_cancel_each_other() -> None:
    place, normal, uv = quad(SQUARE)
    uv[1, 2] = torch.tensor([1.0, 0.0], dtype=torch.float64)  # the second triangle folds back over the first
    made = derive_tangents(place, normal, uv)
    assert made[0, 0, 3] == 1 and made[1, 0, 3] == -1
    torch.testing.assert_close(made[..., :3].norm(dim=-1), torch.ones(2, 3))


def test_corners_share_a_tangent_weighted_by_angle_in_the_plane_of_the_normal() -> None:
    """Two triangles of a bent sheet with smooth normals along the fold."""
    place = torch.tensor(
        [[[0.0, 0, 0], [0, 1, 0], [-1, 0, -1]], [[0, 0, 0], [1, 0, -1], [0, 1, 0]]], dtype=torch.float64
    )
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    normal = up.expand(2, 3, 3)
    uv = torch.tensor([[[0.0, 0], [0, 1], [-1, 0]], [[0, 0], [1, 0], [0, 1]]], dtype=torch.float64)
    made = derive_tangents(place, normal, uv)
    for corner in ((0, 0), (0, 1), (1, 0), (1, 2)):
        torch.testing.assert_close(made[corner][:3], torch.tensor([1.0, 0.0, 0.0]))


def test_degenerate_coordinates_give_some_direction_in_the_surface() -> None:
    for uv in (torch.zeros(4, 2), torch.tensor([[0.0, 0], [1, 1], [2, 2], [3, 3]])):
        made = derive_tangents(*quad(uv))
        assert bool(torch.isfinite(made).all())
        torch.testing.assert_close(made[..., :3].norm(dim=-1), torch.ones(2, 3))
        assert float(made[..., 2].abs().max()) < 1e-6


def test_given_tangents_win_where_there_are_some() -> None:
    place, normal, uv = quad(SQUARE)
    given = torch.zeros(2, 3, 4, dtype=torch.float64)
    given[0] = torch.tensor([0.0, 1.0, 0.0, -1.0])
    made = tangents_of(Corners(place, normal, uv, given))
    torch.testing.assert_close(made[0], given[0].float())
    torch.testing.assert_close(made[1, :, :3], torch.tensor([1.0, 0.0, 0.0]).expand(3, 3))
