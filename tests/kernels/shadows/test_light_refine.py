"""Visibility of light samples by packets of rays, against the exact ray caster, with and without refining."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from torchrender.effects.shadows.light_rays import _order
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.plain_embree import PlainEmbree
from torchrender.kernels.shadows.light_refine import GROUP, LightSamples, refine_light
from torchrender.rays import RayCaster
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

pytestmark = pytest.mark.skipif(embree() is None, reason="embreex is not installed")
SIDE = 16


def scene(rng: np.random.Generator, count: int, size: float) -> Scene:
    """Triangles between receivers and light."""
    centre = rng.uniform((-1, 0.4, -1), (1, 1.6, 1), (count, 3))[:, None]
    vertices = torch.from_numpy((centre + rng.normal(0, size, (count, 3, 3))).reshape(-1, 3))
    return Scene(meshes=(Mesh(vertices=vertices, faces=torch.arange(3 * count).reshape(-1, 3)),))


def receivers(rng: np.random.Generator, count: int, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    points = rng.uniform((-1, 0, -1), (1, 0, 1), (count, 3))
    points = points[np.lexsort((points[:, 2], (points[:, 0] * 8).astype(int)))]
    normals = np.array([0.0, 1.0, 0.0]) + rng.normal(0, tilt, (count, 3))
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def light(step: int) -> LightSamples:
    t = (np.arange(SIDE) + 0.5) / SIDE * 1.6 - 0.8
    places = np.stack([np.repeat(t, SIDE), np.full(SIDE * SIDE, 2.0), np.tile(t, SIDE)], axis=1)
    if step == 1:
        nothing = np.zeros(0, np.int64)
        return LightSamples(places, 0, np.zeros((GROUP, 0), np.int64), nothing, nothing)
    return LightSamples(places, SIDE, *_order(SIDE, step))


def found_bits(made: Scene, points: np.ndarray, normals: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """(P,S) bool, and samples above."""
    geometry = made.geometry
    plain = PlainEmbree(geometry.vertices.numpy(), geometry.faces.numpy())
    bits, above = np.zeros((len(points), 4), np.int64), np.zeros(len(points), np.int32)
    refine_light(plain.tree, points, normals, np.full(len(points), 1e-9), light(step), 5, (bits, above))
    return (bits[:, np.arange(256) >> 6] >> (np.arange(256) & 63)) & 1 > 0, above


@pytest.mark.parametrize("tilt", [0.0, 2.0])
def test_all_rays_equal_the_ray_caster(tilt: float) -> None:
    rng = np.random.default_rng(1)
    made = scene(rng, 40, 0.25)
    points, normals = receivers(rng, 203, tilt)
    found, above = found_bits(made, points, normals, 1)
    toward = light(1).places[None] - points[:, None]
    faces = (toward * normals[:, None]).sum(-1) > 0
    start = torch.from_numpy(np.broadcast_to(points[:, None], toward.shape) + normals[:, None] * 1e-6)
    hidden = RayCaster(made.geometry).occluded(start, torch.from_numpy(toward), t_max=1.0 - 1e-5).numpy()
    assert np.array_equal(above, faces.sum(1))
    assert (found != (faces & ~hidden)).mean() < 2e-4  # float32 at the edges of triangles
    assert 0.1 < found.mean() < 0.9 and (tilt == 0.0) == bool((above == 256).all())


@pytest.mark.parametrize("step", [2, 3, 4])
def test_refining_changes_little_and_nothing_that_agrees(step: int) -> None:
    rng = np.random.default_rng(2)
    made = scene(rng, 12, 0.4)
    points, normals = receivers(rng, 800, 0.3)
    exact, _ = found_bits(made, points, normals, 1)
    quick, _ = found_bits(made, points, normals, step)
    share, other = exact.mean(1), quick.mean(1)
    assert np.abs(share - other).mean() < 1 / 255
    assert ((share > 0) & (share < 1)).mean() > 0.3
    assert not (exact.any(1) & ~quick.any(1) & (share > 0.1)).any()


def test_light_and_umbra_everywhere_are_exact() -> None:
    points, normals = receivers(np.random.default_rng(3), 100, 0.0)
    roof = Mesh(
        vertices=torch.tensor([[-50.0, 1.0, -50.0], [50.0, 1.0, -50.0], [0.0, 1.0, 80.0]]),
        faces=torch.tensor([[0, 1, 2]]),
    )
    below = Mesh(vertices=roof.vertices - torch.tensor([0.0, 2.0, 0.0]), faces=roof.faces)
    for mesh, value in ((roof, False), (below, True)):
        found, _ = found_bits(Scene(meshes=(mesh,)), points, normals, 2)
        assert bool((found == value).all())
