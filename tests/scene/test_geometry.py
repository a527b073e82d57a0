"""All triangles of a scene whose vertices move."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from torchrender.errors import MeshError
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry, Mesh, concatenate
from torchrender.scene.motion.refit import refitted


def lump(see_through: bool = False) -> Geometry:
    """Some thousand triangles in several clusters, part of them panes if asked for."""
    geometry = concatenate([Mesh.sphere(1.0, segments=48), replace(Mesh.box((1.0, 2.0, 0.5)), material=1)])
    return replace(geometry, see_through=geometry.material == 1) if see_through else geometry


@pytest.mark.parametrize("see_through", [False, True])
def test_refitted_clusters_give_the_picture_of_new_ones(see_through: bool) -> None:
    camera = Cameras.look_at([1.0, 1.5, 4.0], [0.0, 0.0, 0.0], width=64, height=48, fov_deg=50.0)
    old = lump(see_through)
    rasterize_visibility(old, camera)
    twisted = old.vertices.clone()
    twisted[:, 0] += 1.5 * torch.sin(2.0 * twisted[:, 1])
    moved = refitted(old, twisted)
    assert moved.order is old.order and moved.solid.order is old.solid.order
    assert not torch.equal(moved.solid.cluster_bounds, old.solid.cluster_bounds)
    seen, fresh = (rasterize_visibility(g, camera) for g in (moved, replace(old, vertices=twisted)))
    assert int(seen.covered.sum()) > 200
    for name in ("depth", "triangle", "object_id", "barycentric"):
        assert torch.equal(getattr(seen, name), getattr(fresh, name))


def test_other_vertices_must_be_as_many_and_as_exact() -> None:
    old = lump()
    for wrong in (old.vertices[1:], old.vertices.float()):
        with pytest.raises(MeshError, match="vertices"):
            refitted(old, wrong)
