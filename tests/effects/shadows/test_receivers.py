"""Shadows on coarse smooth meshes: light fades where the shading normal turns from it, not where triangles do."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from torchrender.effects.shadows.receivers import shadow_receivers
from torchrender.effects.shadows.shadow_map import ShadowOptions, light_visibility
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight, RectLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.shade import shade

CAMERA = Cameras.look_at([1.5, 1.2, 4.2], [0.0, 0.0, 0.0], width=120, height=120, fov_deg=16.0)
LAMP = PointLight(position=torch.tensor([30.0, 2.0, 0.0]))
SUN = DirectionalLight(direction=torch.tensor([-1.0, -0.1, 0.0]))
WINDOW = RectLight(
    corner=torch.tensor([30.0, -0.3, -0.3]), edge_u=torch.tensor([0.0, 0.0, 0.6]), edge_v=torch.tensor([0.0, 0.6, 0.0])
)
LIGHTS = {"lamp": LAMP, "sun": SUN, "window": WINDOW}


def ball(segments: int = 12) -> Mesh:
    return Mesh.sphere(0.5, [0.0, 0.0, 0.0], segments=segments)


@pytest.mark.parametrize("way", ["maps", "pcss", "rays", "samples"])
@pytest.mark.parametrize("name", LIGHTS)
def test_a_lone_coarse_ball_is_lit_as_far_as_its_normals_say(name: str, way: str) -> None:
    light = LIGHTS[name]
    scene = Scene(meshes=[ball()], lights=[light])
    seen = rasterize(scene, CAMERA)
    toward = -light.direction if isinstance(light, DirectionalLight) else torch.tensor([30.0, 0.0, 0.0]) - seen.position
    if isinstance(light, PointLight):
        toward = light.position - seen.position
    cosine = (torch.nn.functional.normalize(toward.double(), dim=-1) * seen.normal).sum(-1)
    if way == "rays":
        found = traced_visibility(RayCaster(scene.geometry), light, seen, samples=4)
    elif way == "samples":
        if not isinstance(light, RectLight):
            pytest.skip("has no area")
        found = soft_shadow(scene.geometry, light, seen, SoftShadowOptions(light_samples=4)).visibility[:, 0]
    else:
        options = ShadowOptions() if way == "maps" else ShadowOptions(filter="pcss", light_width=0.1)
        found = light_visibility(scene, light, seen, options)
    lit, turned = seen.covered & (cosine > 0.04), seen.covered & (cosine < -0.04)
    assert int(lit.sum()) > 1000 and int(turned.sum()) > 1000
    assert float((found[lit] < 0.9).float().mean()) < 0.003
    assert float(found[turned].max()) < 0.05


@pytest.mark.parametrize("gradient", [False, True])
def test_light_falls_on_all_that_normals_turn_to_it(gradient: bool) -> None:
    """Without shadows, by the compiled shading and by the one that carries gradients."""
    paint = Material(diffuse=torch.full((3,), 0.5, requires_grad=gradient))
    scene = Scene(meshes=[ball()], materials=[paint], lights=[replace(LAMP, intensity=torch.ones(3) * 1000.0)])
    seen = rasterize(scene, CAMERA)
    toward = torch.nn.functional.normalize(LAMP.position - seen.position, dim=-1)
    cosine = (toward * seen.normal).sum(-1)
    wanted = 0.5 / math.pi * 1000.0 * cosine.clamp_min(0.0) / (LAMP.position - seen.position).square().sum(-1)
    found = shade(scene, seen).detach().mean(dim=-1)[seen.covered]
    torch.testing.assert_close(found, wanted[seen.covered].float(), atol=2e-3, rtol=0.0)


def test_what_is_flat_stays_where_it_is_to_the_bit() -> None:
    plain = Scene(meshes=[Mesh.plane(4.0), Mesh.box(0.6, [0.0, 0.3, 0.0])], lights=[LAMP])
    seen = rasterize(plain, CAMERA)
    assert all(torch.equal(*pair) for pair in zip(shadow_receivers(seen), (seen.position, seen.geometric_normal)))


def test_receivers_lie_on_the_ball_that_the_triangles_stand_for() -> None:
    """Between the triangle and the planes that touch at its corners: nearer to the ball than before."""
    seen = rasterize(Scene(meshes=[ball()], lights=[LAMP]), CAMERA)
    moved, normal = shadow_receivers(seen)
    before, after = (points[seen.covered].norm(dim=-1) for points in (seen.position, moved))
    assert float(before.min()) < 0.485
    assert bool((after >= before - 1e-6).all()) and float(after.max()) < 0.53
    assert float(after.min()) > 0.4999
    assert torch.equal(normal[seen.covered], seen.normal[seen.covered])
