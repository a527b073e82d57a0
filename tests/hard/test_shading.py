"""Shading where numbers are at their limits: light stays finite, and bad values are named."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from shading_scenes import LIGHTS, bumps, noise
from torchrender.errors import InputError
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material, Sampler
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.shade import shade

SQUARE = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = torch.tensor([[0, 1, 2], [0, 2, 3]])
UV = torch.tensor([[0.0, 0], [1, 0], [1, 1], [0, 1]])
SUN = DirectionalLight(direction=torch.tensor([-0.3, -0.5, -1.0]), irradiance=torch.full((3,), 2.0))


def front(size: int = 24) -> Cameras:
    return Cameras.look_at([0.3, 0.2, 3.0], [0.0, 0.0, 0.0], width=size, height=size, fov_deg=45.0)


def panel(material: Material, **rest: Any) -> Scene:
    mesh = Mesh(vertices=SQUARE, faces=FACES, **{"uv": UV, **rest})
    return Scene(meshes=(mesh,), materials=(material,), lights=(SUN,), ambient=torch.full((3,), 0.1))


def both(scene: Scene, camera: Cameras | None = None, differ: float = 5e-3) -> Tensor:
    """The kernel's picture, after it was compared with torch's."""
    gbuffer = rasterize(scene, camera or front())
    image, twin = shade(scene, gbuffer), shade(scene, replace(gbuffer))
    assert bool(torch.isfinite(image).all()) and bool((image >= 0).all())
    error = ((image - twin).abs() / twin.abs().clamp_min(1e-3)).amax(-1)
    assert float((error > 1e-4).float().mean()) < differ
    return image


ALL_MAPS = Material(
    metallic=0.5,
    roughness=0.6,
    diffuse_texture=noise(16, 16, 3, 0),
    metallic_roughness_texture=noise(16, 16, 3, 1),
    normal_texture=bumps(16, 16, 2),
    occlusion_texture=noise(16, 16, 1, 3),
)


@pytest.mark.parametrize(
    "uv", [torch.zeros(4, 2), UV[:1].expand(4, 2), UV * torch.tensor([1.0, 0.0]), UV * 1e-30, UV * 1e7], ids=str
)
def test_degenerate_and_extreme_coordinates_under_a_normal_map(uv: Tensor) -> None:
    both(panel(ALL_MAPS, uv=uv.contiguous()))


def test_textures_without_coordinates_show_one_texel() -> None:
    image = both(panel(Material(unlit=True, diffuse_texture=noise(8, 8, 3, 0)), uv=None))
    seen = image[image.sum(-1) != 0.1 * 3]
    covered = seen[(seen - seen[0]).abs().amax(-1) < 1e-6]
    assert len(covered) > 50


@pytest.mark.parametrize("roughness", [0.0, 1e-8, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
def test_the_ends_of_roughness_and_metallic(roughness: float, metallic: float) -> None:
    ball = sphere(segments=24)
    mesh = replace(ball, normals=torch.nn.functional.normalize(ball.vertices, dim=-1))
    material = Material(metallic=metallic, roughness=roughness, diffuse=torch.ones(3), clearcoat=1.0)
    image = both(Scene(meshes=(mesh,), materials=(material,), lights=LIGHTS, ambient=torch.full((3,), 0.1)))
    assert float(image.max()) > 0.02


def test_textures_of_one_texel_and_of_sixteen_thousand() -> None:
    one = both(panel(Material(diffuse_texture=torch.full((1, 1, 3), 0.5), diffuse=torch.ones(3))))
    flat = both(panel(Material(diffuse=torch.full((3,), 0.5))))
    torch.testing.assert_close(one, flat, rtol=1e-5, atol=1e-6)
    wide = torch.full((2, 16384, 3), 0.5)
    torch.testing.assert_close(
        both(panel(Material(diffuse_texture=wide, diffuse=torch.ones(3)))), flat, rtol=1e-5, atol=1e-6
    )
    tall = noise(16384, 1, 3, 5)
    both(panel(Material(diffuse_texture=tall, samplers={"diffuse_texture": Sampler(wrap_v="mirror")})))


def test_a_mirrored_copy_is_lit_as_the_mirror_image() -> None:
    """Vertices, normals and winding mirrored at x = 0, tangents with the other sign: the picture is mirrored."""
    bend = Mesh(
        vertices=torch.tensor([[-1.0, -1, 0], [1, -1, 0.4], [1, 1, 0.2], [-1, 1, 0]]),
        faces=FACES,
        uv=UV,
        normals=torch.nn.functional.normalize(
            torch.tensor([[-0.2, 0.1, 1.0], [0.3, 0, 1], [0.1, 0.2, 1], [0, 0, 1]]), dim=-1
        ),
    )
    turn = torch.tensor([-1.0, 1.0, 1.0])
    other = replace(bend, vertices=bend.vertices * turn, normals=bend.normals * turn, faces=bend.faces.flip(1))
    sun = DirectionalLight(direction=torch.tensor([-0.3, -0.5, -1.0]) * turn, irradiance=SUN.irradiance)
    camera = Cameras.look_at([0.0, 0.2, 3.0], [0.0, 0.0, 0.0], width=24, height=24, fov_deg=45.0)
    first = both(Scene(meshes=(bend,), materials=(ALL_MAPS,), lights=(SUN,)), camera)
    second = both(Scene(meshes=(other,), materials=(ALL_MAPS,), lights=(sun,)), camera)
    error = (first - second.flip(2)).abs().amax(-1)
    assert float((error > 1e-3).float().mean()) < 0.02


def test_alpha_zero_everywhere_leaves_the_background() -> None:
    leaf = torch.zeros(4, 4, 4)
    for scene in (
        panel(Material(diffuse_texture=leaf, alpha_cutoff=0.5)),
        panel(Material(alpha_cutoff=0.5, opacity=0.0)),
        panel(Material(alpha_cutoff=0.5), alpha=torch.zeros(4)),
    ):
        gbuffer = rasterize(scene, front())
        assert not bool(gbuffer.covered.any())
        torch.testing.assert_close(shade(scene, gbuffer), scene.ambient.expand(1, 24, 24, 3))


def test_lamps_in_surfaces_on_them_and_inside_glass() -> None:
    glass = Material(metallic=0.0, roughness=0.0, transmission=1.0, diffuse=torch.ones(3))
    for place in ([0.0, 0.0, 0.0], [0.0, 0.0, 0.999999], [0.0, 0.0, 1.0], [0.0, 0.0, 1e-3]):
        lamps = (
            PointLight(position=torch.tensor(place)),
            SpotLight(position=torch.tensor(place), direction=torch.tensor([0.0, 0.0, 1.0])),
            RectLight(corner=torch.tensor(place), edge_u=torch.tensor([0.1, 0, 0]), edge_v=torch.zeros(3)),
        )
        both(Scene(meshes=(sphere(segments=12),), materials=(glass,), lights=lamps))
        image = both(replace(panel(Material()), lights=lamps))
        if place[2] == 0.0:  # in the plane of the panel: no light, and not by chance
            dark = both(replace(panel(Material()), lights=()))
            torch.testing.assert_close(image, dark, atol=1e-5, rtol=0.0)


def test_lamps_on_a_map_of_millions_of_metres_light_as_at_the_origin() -> None:
    lamp = PointLight(position=torch.tensor([0.3, 0.4, 0.7], dtype=torch.float64), intensity=torch.full((3,), 2.0))
    far = torch.tensor([500_000.0, 4_000_000.0, 120.0], dtype=torch.float64)
    here = replace(panel(Material(metallic=0.3, roughness=0.4)), lights=(lamp,))
    mesh = replace(here.meshes[0], vertices=here.meshes[0].vertices.double() + far)
    there = replace(here, meshes=(mesh,), lights=(replace(lamp, position=lamp.position + far),))
    moved = Cameras.look_at(
        (far + torch.tensor([0.3, 0.2, 3.0])).tolist(), far.tolist(), width=24, height=24, fov_deg=45.0
    )
    found, wanted = both(there, moved), both(here)
    error = ((found - wanted).abs() / wanted.clamp_min(1e-3)).amax(-1)
    assert float((error > 1e-3).float().mean()) < 0.01


def test_nothing_grows_with_the_size_of_the_scene() -> None:
    """A backdrop of 1,000 km changes nothing about a lamp a millimetre above a table."""
    lamp = PointLight(position=torch.tensor([0.0, 0.0, 1e-3], dtype=torch.float64), intensity=torch.full((3,), 1e-6))
    table = replace(panel(Material()), lights=(lamp,), ambient=torch.zeros(3))
    backdrop = Mesh(vertices=SQUARE * 1e6 + torch.tensor([0.0, 0.0, -1e6]), faces=FACES)
    close = Cameras.look_at([0.0, 0.0, 0.05], [0.0, 0.0, 0.0], width=24, height=24, fov_deg=20.0, near=1e-3)
    alone, behind = both(table, close), both(replace(table, meshes=(*table.meshes, backdrop)), close)
    torch.testing.assert_close(alone, behind, rtol=1e-3, atol=1e-6)
    assert float(alone.max()) > 0.15  # 1e-6 / (1e-3)^2 / pi times 0.8


NAN, INF = math.nan, math.inf
BAD: dict[str, tuple[Callable[[], object], str]] = {
    "texture nan": (lambda: Material(diffuse_texture=torch.full((2, 2, 3), NAN)), "diffuse_texture"),
    "texture inf": (lambda: Material(emission_texture=torch.full((2, 2, 3), INF)), "emission_texture"),
    "texture negative": (lambda: Material(metallic=1.0, metallic_roughness_texture=-torch.ones(2, 2, 3)), "metallic_r"),
    "texture uint8": (lambda: Material(diffuse_texture=torch.zeros(2, 2, 3, dtype=torch.uint8)), "diffuse_texture"),
    "colour negative": (lambda: Material(emission=torch.tensor([0.0, -1.0, 0.0])), "emission"),
    "vertex colours": (lambda: panel(Material(), colors=torch.full((4, 3), NAN)), "colors"),
    "vertex colours uint8": (lambda: panel(Material(), colors=torch.zeros(4, 3, dtype=torch.uint8)), "colors"),
    "vertex alpha": (lambda: panel(Material(), alpha=torch.full((4,), -1.0)), "alpha"),
    "tangents": (lambda: panel(Material(), tangents=torch.full((4, 4), INF)), "tangents"),
    "ambient nan": (lambda: Scene(ambient=torch.full((3,), NAN)), "ambient"),
    "ambient negative": (lambda: Scene(ambient=torch.tensor([0.0, 0.0, -0.1])), "ambient"),
    "ambient shape": (lambda: Scene(ambient=torch.zeros(4)), "ambient"),
    "light negative": (lambda: PointLight(position=torch.zeros(3), intensity=-torch.ones(3)), "intensity"),
    "light nan": (lambda: DirectionalLight(direction=torch.ones(3), irradiance=torch.full((3,), NAN)), "irradiance"),
    "lamp at nan": (lambda: SpotLight(position=torch.full((3,), NAN), direction=torch.ones(3)), "position"),
    "sky negative": (lambda: Environment(radiance=-torch.ones(2, 4, 3)), "radiance"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_values_are_named(case: str) -> None:
    make, name = BAD[case]
    with pytest.raises(InputError, match=name):
        make()


@pytest.mark.parametrize("dtype", [torch.float16, torch.float64])
def test_other_floats_are_converted(dtype: torch.dtype) -> None:
    texture = noise(8, 8, 3, 0)
    wanted = both(panel(Material(diffuse_texture=texture.to(dtype).float())))
    torch.testing.assert_close(both(panel(Material(diffuse_texture=texture.to(dtype)))), wanted)
    sky = torch.rand(8, 16, 3)
    scenes = [
        replace(panel(Material()), environment=Environment(radiance=v)) for v in (sky.to(dtype), sky.to(dtype).float())
    ]
    torch.testing.assert_close(both(scenes[0]), both(scenes[1]))
