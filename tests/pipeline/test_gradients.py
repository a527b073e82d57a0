"""What a picture gives no gradient to is refused by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from torchrender.effects.shadows.soft_shadow import soft_shadow
from torchrender.errors import GradientError
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

LAMP = PointLight(position=torch.tensor([1.0, 3.0, 2.0]), intensity=torch.full((3,), 20.0))
SCENE = Scene(meshes=(Mesh.plane(4), Mesh.sphere(0.5, (0, 0.5, 0))), materials=(Material(),), lights=(LAMP,))
CAMERA = Cameras.look_at((2, 1.6, 2), (0, 0.4, 0), width=24, height=18)
PLAIN = RenderOptions(reflections="off")
BOX = {"low": torch.tensor([-2.0, 0, -2]), "high": torch.full((3,), 2.0)}

CASES: dict[str, tuple[list[float], Callable[[Tensor], Scene]]] = {
    "scattering of medium": ([0.1] * 3, lambda q: replace(SCENE, media=(Medium(**BOX, scattering=q),))),
    "absorption of medium": ([0.1] * 3, lambda q: replace(SCENE, media=(Medium(**BOX, absorption=q),))),
    "roughness of material": ([0.5], lambda q: replace(SCENE, materials=(Material(metallic=0.0, roughness=q[0]),))),
    "metallic of material": ([0.5], lambda q: replace(SCENE, materials=(Material(metallic=q[0]),))),
    "opacity of material": ([0.5], lambda q: replace(SCENE, materials=(Material(opacity=q[0], blend=True),))),
    "position of light": ([1.0, 3, 2], lambda q: replace(SCENE, lights=(PointLight(position=q),))),
    "direction of light": ([0.0, -1, 0], lambda q: replace(SCENE, lights=(DirectionalLight(direction=q),))),
    "direction of light 'spot": (
        [0.0, -1, 0],
        lambda q: replace(SCENE, lights=(SpotLight(position=LAMP.position, direction=q, name="spot"),)),
    ),
    "corner of light": (
        [0.0, 3, 0],
        lambda q: replace(SCENE, lights=(RectLight(corner=q, edge_u=torch.eye(3)[0], edge_v=torch.eye(3)[2]),)),
    ),
}


@pytest.mark.filterwarnings("ignore:Converting a tensor")
@pytest.mark.parametrize("named", CASES)
def test_it_is_refused_by_name_and_drawn_when_none_is_wanted(named: str) -> None:
    values, scene = CASES[named]
    asking = torch.tensor(values, requires_grad=True)
    with pytest.raises(GradientError, match=named):
        render(scene(asking), CAMERA, options=PLAIN)
    with torch.no_grad():
        assert bool(render(scene(asking), CAMERA, options=PLAIN).radiance.isfinite().all())


def test_backgrounds_and_lights_of_soft_shadows_are_refused() -> None:
    with pytest.raises(GradientError, match="background"):
        render(SCENE, CAMERA, options=replace(PLAIN, background=torch.full((3,), 0.5, requires_grad=True)))
    corner = torch.tensor([0.0, 3.0, 0.0], requires_grad=True)
    panel = RectLight(corner=corner, edge_u=torch.eye(3)[0], edge_v=torch.eye(3)[2])
    with pytest.raises(GradientError, match="corner of light"):
        soft_shadow(SCENE, panel, rasterize(SCENE, CAMERA))


def test_positions_have_one_without_shadows() -> None:
    place = torch.tensor([1.0, 3.0, 2.0], dtype=torch.float64, requires_grad=True)

    def total(position: Tensor) -> Tensor:
        scene = replace(SCENE, lights=(replace(LAMP, position=position),))
        return render(scene, CAMERA, options=replace(PLAIN, shadows=False)).radiance.double().sum()

    total(place).backward()
    assert place.grad is not None
    with torch.no_grad():
        for axis in range(3):
            step = torch.eye(3, dtype=torch.float64)[axis] * 1e-2
            slope = (total(place + step) - total(place - step)) / 2e-2
            assert float((slope - place.grad[axis]).abs()) < 0.02 * float(place.grad.abs().max())
