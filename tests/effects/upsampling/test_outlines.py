"""Outlines at one sample a pixel."""

from __future__ import annotations

import pytest
import torch

import torchrender as tr
from torchrender.effects.upsampling.outlines import smooth_outlines
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
    with pytest.raises(InputError, match="one perspective camera"):
        smooth_outlines(scene.geometry, both, torch.zeros(SIZE, SIZE, 3))
