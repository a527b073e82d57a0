"""Holes and opacity of materials, in voxels and in sampled points."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.effects.transparency.passing import passing_light
from torchrender.points.load import sample_points
from torchrender.scene.material import Material, Sampler
from torchrender.scene.shapes import plane
from torchrender.voxels.coverage import placed_uv


def chequered(**changes: object) -> tr.Scene:
    """A square of one unit whose texture has four by four fields, every other one a hole."""
    field = (torch.arange(4)[:, None] + torch.arange(4)[None]) % 2
    alpha = field.repeat_interleave(8, 0).repeat_interleave(8, 1).float()
    texture = torch.cat([torch.ones(32, 32, 3), alpha[..., None]], dim=-1)
    material = Material(diffuse_texture=texture, **{"alpha_cutoff": 0.5, **changes})  # type: ignore[arg-type]
    return tr.Scene(meshes=(plane(torch.tensor([1.0, 1.0]), 1, 1.0),), materials=(material,))


def solid_scene() -> tr.Scene:
    scene = chequered()
    return replace(scene, materials=(Material(),))


def test_holes_are_empty_cells() -> None:
    """Half of the cells, and those are the solid fields: the picture of cells is the texture's."""
    scene = chequered()
    grid = tr.make_grid(scene.bounds[None], 36)
    full, holed = tr.voxelize_scene(solid_scene(), grid), tr.voxelize_scene(scene, grid)
    share = len(holed.cells) / len(full.cells)
    assert 0.45 < share < 0.65  # cells on the borders of fields count
    assert int((holed.voxels & ~full.voxels).dense().sum()) == 0
    assert float(holed.density.sum()) == pytest.approx(0.5 * float(full.density.sum()), rel=0.1)
    # What is occupied is what the cells list.
    dense = holed.voxels.dense()[0]
    i, j, k = holed.cells.unbind(-1)
    assert int(dense.sum()) == len(holed.cells) and bool(dense[k, j, i].all())


def test_everything_a_hole_is_nothing() -> None:
    scene = chequered(opacity=0.1)
    assert len(tr.voxelize_scene(scene, tr.make_grid(scene.bounds[None], 16)).cells) == 0
    with pytest.raises(tr.errors.MeshError, match="all of it is transparent"):
        sample_points(scene, 100)


def test_what_blends_is_thinner() -> None:
    scene = replace(solid_scene(), materials=(Material(blend=True, opacity=0.25),))
    grid = tr.make_grid(scene.bounds[None], 16)
    full, thin = tr.voxelize_scene(solid_scene(), grid), tr.voxelize_scene(scene, grid)
    assert torch.equal(full.cells, thin.cells)
    torch.testing.assert_close(thin.density, 0.25 * full.density, atol=0.02, rtol=0.05)
    points = sample_points(scene, 500)
    assert points.opacity is not None and points.opacity.tolist() == pytest.approx([0.25] * 500)


@pytest.mark.parametrize(
    ("pane", "alpha"),
    [
        (Material(blend=True, opacity=0.75), 0.75),
        (Material(metallic=0.0, roughness=0.0, transmission=0.5, diffuse=torch.ones(3)), 1 - 0.5 * 0.96),
        (
            Material(metallic=0.0, roughness=0.0, transmission=1.0, diffuse=torch.tensor([0.9, 0.6, 0.3])),
            1 - 0.96 * 0.6,
        ),
        (
            Material(metallic=0.0, roughness=0.0, transmission=1.0, diffuse=torch.ones(3), blend=True, opacity=0.5),
            0.5 * (1 - 0.96),
        ),
    ],
)
def test_panes_are_as_solid_as_pictures_show_them(pane: Material, alpha: float) -> None:
    """What is left of the light behind, straight through; pictures say the same."""
    scene = replace(solid_scene(), materials=(pane,))
    grid = tr.make_grid(scene.bounds[None], 8)
    full, thin = tr.voxelize_scene(solid_scene(), grid), tr.voxelize_scene(scene, grid)
    torch.testing.assert_close(thin.density.sum() / full.density.sum(), torch.tensor(alpha), atol=0.01, rtol=0)
    points = sample_points(scene, 50)
    assert points.opacity is not None and points.opacity.tolist() == pytest.approx([alpha] * 50, abs=2e-3)
    origin, down = torch.tensor([[0.1, 1.0, 0.1]]).double(), torch.tensor([[0.0, -1.0, 0.0]]).double()
    hits = tr.RayCaster(scene.geometry.panes).first_hit(origin, down)
    assert bool(hits.hit.all())
    _, behind = passing_light(scene, origin, down, hits)
    assert 1.0 - float(behind.mean()) == pytest.approx(alpha, abs=2e-3)


def test_a_picture_of_transmission_counts() -> None:
    """Half of the wall lets light pass, the other half is solid."""
    picture = torch.cat([torch.zeros(2, 64, 1), torch.ones(2, 64, 1)], dim=1)
    pane = Material(metallic=0.0, transmission=1.0, transmission_texture=picture, diffuse=torch.ones(3))
    points = sample_points(replace(solid_scene(), materials=(pane,)), 400)
    assert points.opacity is not None
    assert float((points.opacity > 0.9).float().mean()) == pytest.approx(0.5, abs=0.1)
    assert float((points.opacity < 0.2).float().mean()) == pytest.approx(0.5, abs=0.1)


def test_points_stand_on_what_is_solid() -> None:
    points = sample_points(chequered(), 20_000)
    assert 0.48 < len(points) / 20_000 < 0.52 and points.opacity is None
    low = points.position.amin(0)
    field = ((points.position - low)[:, [0, 2]] * 4 - 1e-3).floor()
    # All in fields of one colour of the board.
    parity = field.sum(1) % 2
    assert float(parity.mean()) < 0.02 or float(parity.mean()) > 0.98


def test_samplers_wrap_and_move() -> None:
    uv = torch.tensor([[-0.25, 1.25], [2.5, 0.5]], dtype=torch.float64)
    move = torch.tensor([[2.0, 0.0, 0.5], [0.0, 1.0, 0.0]])
    assert placed_uv(uv, Sampler(transform=move)).tolist() == [[0.0, 1.25], [5.5, 0.5]]
    mirrored = placed_uv(uv, Sampler(wrap_u="mirror", wrap_v="mirror"))
    assert mirrored.tolist() == [[0.25, 0.75], [0.5, 0.5]]
    clamped = placed_uv(uv, Sampler(wrap_u="clamp", wrap_v="clamp"))
    torch.testing.assert_close(clamped, torch.tensor([[0.0, 1.0], [1.0, 0.5]], dtype=torch.float64), atol=1e-5, rtol=0)
