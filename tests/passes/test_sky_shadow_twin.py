"""Light lost under the sky: the compiled way and the one in torch tell the same."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

import torchrender.effects.sky_shadows.picture as picture
from torchrender.buffers import GBuffer
from torchrender.effects.sky_shadows.picture import Surroundings, light_lost
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere

LOOKS = {
    "matt": Material(name="matt", diffuse=torch.tensor([0.7, 0.4, 0.2]), diffuse_texture=torch.rand(8, 8, 3)),
    "glossy": Material(name="glossy", diffuse=torch.full((3,), 0.3), specular=0.4, shininess=30.0),
    "physical": Material(
        name="physical", diffuse=torch.tensor([0.6, 0.5, 0.4]), metallic=0.3, roughness=0.4, clearcoat=0.7,
        emission=torch.tensor([0.5, 0.2, 0.9]), sheen_color=torch.tensor([0.2, 0.3, 0.1]),
        occlusion_texture=torch.rand(8, 8, 1), occlusion_strength=0.8,
    ),
    "shown": Material(name="shown", diffuse=torch.full((3,), 0.5), unlit=True),
}  # fmt: skip


def scene() -> Scene:
    """A floor and balls of all kinds of material, under a sky with a bright side."""
    radiance = torch.full((32, 64, 3), 0.2)
    radiance[4:12, 10:30] = torch.tensor([5.0, 3.0, 1.0])
    floor = torch.tensor([[-4.0, 0, -4], [-4, 0, 4], [4, 0, 4], [4, 0, -4]])
    meshes = [Mesh(vertices=floor, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), name="floor")]
    for number in range(len(LOOKS)):
        ball = sphere(0.5, 16)
        place = torch.tensor([1.2 * number - 1.8, 0.6, 0.0])
        meshes.append(replace(ball, vertices=ball.vertices + place, material=number))
    return Scene(
        meshes=tuple(meshes),
        materials=tuple(LOOKS.values()),
        environment=Environment(radiance=radiance, rotation_deg=40.0),
        ambient=torch.full((3,), 0.3),
    )


def seen(of: Scene) -> GBuffer:
    eyes = ([0.0, 2.0, 5.0], [3.0, 1.0, 3.0])
    parts = [Cameras.look_at(eye, [0.0, 0.4, 0.0], width=56, height=40, fov_deg=50) for eye in eyes]
    return rasterize(of, Cameras.cat(parts))


def shares(shape: torch.Size, generator: torch.Generator) -> Tensor:
    left = torch.rand(*shape, 4, generator=generator)
    left[:, ::3] = 1.0  # rows that lose nothing
    return left


@pytest.mark.parametrize("around", ["nothing", "shares", "shares and directions"])
def test_the_kernel_tells_what_torch_tells(around: str, monkeypatch: pytest.MonkeyPatch) -> None:
    generator = torch.Generator().manual_seed(3)
    of = scene()
    gbuffer = seen(of)
    shape = gbuffer.covered.shape
    left = shares(shape, generator)
    known = None
    if around != "nothing":
        bent = normalize(gbuffer.normal + 0.4 * torch.randn(*shape, 3, generator=generator), dim=-1)
        taken, sky = (torch.rand(shape, generator=generator) for _ in range(2))
        sky[:, 5] = 1.0
        known = Surroundings(taken, bent if around.endswith("directions") else None, sky)
    quick = light_lost(of, gbuffer, left, known)
    monkeypatch.setattr(picture, "is_of", lambda *_: False)  # as if of nobody's triangles: through torch
    exact = light_lost(of, gbuffer, left, known)
    lost = exact.abs().amax(dim=-1)
    for number in range(3):
        assert float(lost[gbuffer.material == number].max()) > 0.05
    assert float(lost[gbuffer.material == 3].max()) == 0.0 and float(lost[~gbuffer.covered].max()) == 0.0
    assert float((quick - exact).abs().max()) < 2e-4 * float(exact.abs().max())
    assert float(quick[:, ::3].abs().max()) == 0.0
