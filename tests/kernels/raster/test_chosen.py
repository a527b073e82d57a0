"""Chosen attributes of many images against all attributes of each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from torchrender.kernels.compile import thread_count
from torchrender.kernels.raster.chosen import interpolate_views
from torchrender.raster import rasterize, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.shading.attributes import SHAPES, write_attributes

EYES = torch.tensor([[0.5, 1.0, 3.0], [-0.6, 0.9, 2.0], [0.0, 1.8, 2.5]], dtype=torch.float64)
VIEWS = Cameras.look_at(EYES, [0.0, 1.0, 0.0], width=23, height=17)
ABOVE = replace(
    VIEWS,
    orthographic=True,
    intrinsics=VIEWS.intrinsics * torch.tensor([[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]]),
    far=torch.tensor(9.0),
)


def painted() -> Scene:
    """With colours, normals and texture coordinates."""
    ball = Mesh.sphere(0.7, [0.0, 1.0, 0.0], segments=12)
    return Scene(
        meshes=[replace(ball, colors=torch.rand(len(ball.vertices), 3, generator=torch.Generator().manual_seed(1)))]
    )


@pytest.mark.parametrize("scene", [painted(), load("cornell_box")], ids=["all", "few"])
@pytest.mark.parametrize("views", [VIEWS, ABOVE], ids=["perspective", "orthographic"])
@pytest.mark.parametrize("names", [tuple(SHAPES), ("normal",), ("material", "uv"), ("position", "color")])
def test_each_is_that_of_the_image_alone(scene: Scene, views: Cameras, names: tuple[str, ...]) -> None:
    seen = rasterize_visibility(scene.geometry, views)
    assert bool(seen.covered.any()) and not bool(seen.covered.all())
    room = {}
    for name in names:
        tail, kind = SHAPES[name]
        room[name] = np.full((*seen.depth.shape, *tail), 7, kind)  # every pixel must be written
    write_attributes(scene.geometry, seen, room)
    assert len(interpolate_views.signatures) == 1  # whatever is asked for, nothing is compiled anew
    for k in range(len(views)):
        alone = rasterize(scene, views[k])
        for name in names:
            wanted = getattr(alone, name)[0]
            assert torch.equal(
                torch.from_numpy(room[name][k]), wanted.float() if wanted.is_floating_point() else wanted
            )


@pytest.mark.parametrize("scene", [painted(), load("cornell_box")], ids=["all", "few"])
@pytest.mark.parametrize("names", [("depth", "normal", "object_id"), ("uv_footprint", "triangle"), tuple(SHAPES)])
def test_many_small_pictures_hold_what_each_alone_holds(scene: Scene, names: tuple[str, ...]) -> None:
    """A thread draws whole pictures and writes their attributes at once; what is not asked for has room for one."""
    eyes = EYES[:1] + 0.4 * torch.rand(4 * thread_count() + 1, 3, generator=torch.Generator().manual_seed(2))
    around = Cameras.look_at(eyes, [0.0, 1.0, 0.0], width=70, height=40)
    found = rasterize(scene, around, outputs=names)
    for k in range(len(around)):
        alone = rasterize(scene, around[k])
        for name in names:
            assert torch.equal(found[name][k], getattr(alone, name)[0].to(found[name].dtype)), (name, k)
