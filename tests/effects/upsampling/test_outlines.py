"""Outlines at one sample a pixel."""

from __future__ import annotations

import pytest
import torch

import torchrender as tr
from torchrender.effects.upsampling.outlines import mean_of_places, smooth_outlines
from torchrender.errors import GradientError, InputError
from torchrender.raster import rasterize_visibility

SIZE = 48


def two_boxes() -> tr.Scene:
    front = tr.Mesh.box(1.0, (0.1, 0.05, 0.0), name="front")
    return tr.Scene(meshes=(front, tr.Mesh.box((9.0, 9.0, 0.1), (0.0, 0.0, -3.0), name="back")))


def of_objects(scene: tr.Scene, camera: tr.Cameras) -> torch.Tensor:
    """(H,W,3) 1 on the object in front, 0 elsewhere."""
    seen = rasterize_visibility(scene.geometry, camera)
    return (seen.object_id[0] == 0).float()[..., None].expand(-1, -1, 3).contiguous()


@pytest.mark.parametrize("eye", [(0.4, 0.9, 4.0), (-1.3, 0.2, 3.5), (0.0, 2.0, 3.0)])
def test_shares_come_near_those_of_many_samples(eye: tuple[float, ...]) -> None:
    scene = two_boxes()
    camera = tr.Cameras.look_at(eye, (0.0, 0.0, 0.0), width=SIZE, height=SIZE)
    seen = rasterize_visibility(scene.geometry, camera)
    plain = of_objects(scene, camera)
    many = of_objects(scene, camera.scaled(8)).reshape(SIZE, 8, SIZE, 8, 3).mean(dim=(1, 3))
    made = smooth_outlines(scene.geometry, seen, plain)
    errors = [float((picture - many).square().mean()) for picture in (plain, made)]
    assert errors[1] < 0.35 * errors[0]
    inside = (many == 0) | (many == 1)
    assert float((made - many)[inside].abs().max()) < 0.5 and float((made - many)[inside].abs().mean()) < 0.01


def test_mistakes_are_named() -> None:
    scene = two_boxes()
    camera = tr.Cameras.look_at((0.0, 0.0, 4.0), (0.0, 0.0, 0.0), width=SIZE, height=SIZE)
    seen = rasterize_visibility(scene.geometry, camera)
    with pytest.raises(InputError, match="light must have shape"):
        smooth_outlines(scene.geometry, seen, torch.zeros(2, 2, 3))
    with pytest.raises(GradientError):
        smooth_outlines(scene.geometry, seen, torch.zeros(SIZE, SIZE, 3, requires_grad=True))
    both = rasterize_visibility(scene.geometry, tr.Cameras.cat([camera, camera]))
    with pytest.raises(InputError, match="one camera"):
        smooth_outlines(scene.geometry, both, torch.zeros(SIZE, SIZE, 3))
    with pytest.raises(InputError, match="one camera"):
        mean_of_places(both, torch.zeros(SIZE, SIZE, 3), [(0.0, 0.0)])
    with pytest.raises(InputError, match="light must have shape"):
        mean_of_places(seen, torch.zeros(2, 2, 3), [(0.0, 0.0)])
    with pytest.raises(GradientError):
        mean_of_places(seen, torch.zeros(SIZE, SIZE, 3, requires_grad=True), [(0.0, 0.0)])
    for places in ([], [(0.0, 0.0), (0.2, -1.5)], [(float("nan"), 0.0)]):
        with pytest.raises(InputError, match="places must lie within a pixel"):
            mean_of_places(seen, torch.zeros(SIZE, SIZE, 3), places)


def test_a_mean_of_places_is_that_of_the_light_between_pixels() -> None:
    """Within an object against bilinear samples of torch; beside a border the light of the other side stays there."""
    scene = two_boxes()
    camera = tr.Cameras.look_at((0.4, 0.9, 4.0), (0.0, 0.0, 0.0), width=SIZE, height=SIZE)
    seen = rasterize_visibility(scene.geometry, camera)
    light = torch.rand(SIZE, SIZE, 3, generator=torch.Generator().manual_seed(4))
    places = [(0.0, 0.0), (0.4, -0.1), (-0.25, 0.375), (1.0, -1.0)]
    rows, columns = torch.meshgrid(*[torch.arange(SIZE) + 0.5] * 2, indexing="ij")
    sampled = []
    for right, down in places:
        grid = torch.stack([columns + right, rows + down], dim=-1)[None] * 2.0 / SIZE - 1.0
        sampled.append(
            torch.nn.functional.grid_sample(
                light.permute(2, 0, 1)[None], grid, padding_mode="border", align_corners=False
            )[0]
        )
    expected = torch.stack(sampled).mean(dim=0).permute(1, 2, 0)
    made = mean_of_places(seen, light, places)
    owner = seen.object_id.float()[None]
    inside = (-torch.nn.functional.max_pool2d(-owner, 3, 1, 1) == torch.nn.functional.max_pool2d(owner, 3, 1, 1))[0, 0]
    inside[[0, -1]] = inside[:, [0, -1]] = False
    assert inside.float().mean() > 0.5
    assert float((made - expected)[inside].abs().max()) < 1e-5
    plain = of_objects(scene, camera)
    assert torch.equal(mean_of_places(seen, plain, places), plain), "no object takes the light of another"
