"""Light of single samples for the views after them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from torchrender.effects.upsampling.gathered import MOST, GatheredLight
from torchrender.errors import GradientError, InputError
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

SIZE = 64


def beside(camera: Cameras, right: float) -> Cameras:
    matrix = camera.camera_from_world.clone()
    matrix[0, 0, 3] -= right
    return replace(camera, camera_from_world=matrix)


def place_of(scene: Scene, camera: Cameras, chosen: torch.Tensor) -> torch.Tensor:
    """Light (N,3) that tells where a sample is: its world point."""
    seen = rasterize_visibility(scene.geometry, camera)
    return camera.unproject(camera.pixel_centres(), seen.depth)[0][chosen].float()


def test_samples_are_found_where_they_are_in_another_view() -> None:
    scene = load("cornell_box")
    first = scene.camera(width=SIZE, height=SIZE)
    seen = rasterize_visibility(scene.geometry, first)
    chosen = seen.covered[0] & (torch.rand(SIZE, SIZE, generator=torch.Generator().manual_seed(0)) < 0.9)
    gathered = GatheredLight.none().with_samples(scene, seen, chosen, place_of(scene, first, chosen))
    second = beside(first, 0.02 * scene.diagonal)
    there = rasterize_visibility(scene.geometry, second)
    wanted, light = there.covered[0].clone(), torch.zeros(SIZE, SIZE, 3)
    wanted[:, :20] = False
    gathered.place(scene, there, wanted, light)
    found = there.covered[0] & ~wanted
    found[:, :20] = False
    assert float(found[:, 20:].float().mean()) > 0.5
    assert not light[:, :20].any(), "nobody asked for these"
    depth = there.depth[0][found][:, None]
    apart = (light[found] - place_of(scene, second, found)).norm(dim=1, keepdim=True)
    pixel = depth / float(second.intrinsics[0, 0, 0])
    assert float((apart / pixel).median()) < 1.0, "about half a pixel away"


def test_samples_of_mirrors_stay_where_they_were_seen_from() -> None:
    scene = load("washroom")
    first = scene.camera(width=SIZE, height=SIZE)
    seen = rasterize_visibility(scene.geometry, first)
    chosen = seen.covered[0]
    mirrors = torch.tensor([m.is_reflector for m in scene.materials])[scene.geometry.material[seen.triangle[0]]]
    gathered = GatheredLight.none().with_samples(scene, seen, chosen, torch.ones(int(chosen.sum()), 3))
    wanted, light = chosen.clone(), torch.zeros(SIZE, SIZE, 3)
    gathered.place(scene, seen, wanted, light)
    assert not wanted.any() and bool((light[chosen] == 1).all()), "all are known from the very eye"
    second = rasterize_visibility(scene.geometry, beside(first, 0.1 * scene.diagonal))
    wanted = second.covered[0].clone()
    gathered.place(scene, second, wanted, light)
    held = torch.tensor([m.is_reflector for m in scene.materials])[scene.geometry.material[second.triangle[0]]]
    assert bool((mirrors & chosen).any()) and bool((held & second.covered[0]).any())
    assert bool(wanted[held & second.covered[0]].all()), "what mirrors show has changed"
    assert not wanted[~held & second.covered[0]].all()


def test_the_oldest_samples_go_first_and_mistakes_are_named() -> None:
    scene = load("cornell_box")
    seen = rasterize_visibility(scene.geometry, scene.camera(width=SIZE, height=SIZE))
    chosen, gathered = seen.covered[0], GatheredLight.none()
    count = int(chosen.sum())
    for step in range(MOST // count + 2):
        gathered = gathered.with_samples(scene, seen, chosen, torch.full((count, 3), float(step)))
    assert len(gathered) == MOST
    assert float(gathered.light[-1, 0]) == MOST // count + 1 and float(gathered.light[0, 0]) > 0
    with pytest.raises(InputError, match="light must have shape"):
        gathered.with_samples(scene, seen, chosen, torch.zeros(3, 3))
    with pytest.raises(InputError, match="wanted must have shape"):
        gathered.place(scene, seen, chosen[1:], torch.zeros(SIZE, SIZE, 3))
    with pytest.raises(GradientError):
        gathered.with_samples(scene, seen, chosen, torch.zeros(count, 3, requires_grad=True))
