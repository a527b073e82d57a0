"""The pass ``sky_shadow``: when it runs, and what it darkens."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchrender.buffers import GBuffer
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.sky_shadows.light import prepare_light
from torchrender.effects.sky_shadows.occluder import chosen_meshes, occluder_of
from torchrender.effects.sky_shadows.options import SkyShadowOptions, SphereOptions
from torchrender.effects.sky_shadows.picture import light_left
from torchrender.errors import InputError
from torchrender.passes.light.sky_shadow import SKY_SHADOW, applies
from torchrender.passes.outlook import Outlook
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.report.all_frequency.ways import mesh_bits, texel_sum
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural.walker import walker
from torchrender.scene.shapes import sphere

QUICK = SkyShadowOptions(
    occluders=("ball",), spacing=1, sphere=SphereOptions(spheres=8, resolution=24, starts=1, teleports=2)
)


def sky() -> Environment:
    radiance = torch.full((32, 64, 3), 0.1)
    radiance[3:9, 20:40] = 8.0
    return Environment(radiance=radiance, name="lamps")


def still(environment: Environment | None = None) -> Scene:
    floor = torch.tensor([[-3.0, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]])
    ball = sphere(0.5, 24)
    ball = replace(ball, vertices=ball.vertices + torch.tensor([0.0, 0.8, 0.0]), name="ball")
    ground = Mesh(vertices=floor, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), name="floor")
    return Scene(
        meshes=(ground, ball),
        materials=(Material(name="white", diffuse=torch.full((3,), 0.8)),),
        environment=environment,
    )


def view() -> Cameras:
    return Cameras.look_at([2.0, 3.0, 3.0], [0.0, 0.2, 0.0], width=48, height=48, fov_deg=50)


def verdict(scene: Scene, **options: object) -> tuple[bool, str]:
    made = RenderOptions(**options)  # type: ignore[arg-type]
    outlook = Outlook(scene=scene, cameras=view(), options=made, history=RenderHistory())
    return tuple(applies(outlook))  # type: ignore[return-value]


def test_it_says_why() -> None:
    assert verdict(still()) == (False, "no environment lights the scene")
    assert verdict(still(sky()), shadows=False) == (False, "shadows are turned off")
    assert verdict(still(sky()))[1].startswith("nothing moves")
    even = Environment.constant(torch.ones(3))
    assert verdict(still(even), sky_shadow=QUICK) == (False, "the environment is even: ambient visibility is enough")
    assert verdict(still(sky()), sky_shadow=QUICK) == (True, "1 mesh, as 8 spheres, under lamps")
    with pytest.raises(InputError, match="known meshes: ball, floor"):
        verdict(still(sky()), sky_shadow=replace(QUICK, occluders=("bell",)))


def test_a_chosen_object_darkens_the_floor_and_brightens_nothing() -> None:
    scene = still(sky())
    usual = RenderOptions(ambient_visibility="off")
    plain = render(scene, view(), options=usual)
    dark = render(scene, view(), options=replace(usual, sky_shadow=QUICK, buffers=("sky_shadow",)))
    change = plain.radiance - dark.radiance
    assert float(change.min()) > -1e-5 and float(change.max()) > 0.1
    assert float((change - dark.buffers[SKY_SHADOW.name]).abs().max()) < 1e-4
    exact = replace(QUICK, light=replace(QUICK.light, direct_bits=True, terms=6138))
    best = render(scene, view(), options=replace(usual, sky_shadow=exact))
    coarse = render(scene, view(), options=replace(usual, sky_shadow=replace(QUICK, spacing=2)))
    assert float((best.radiance - dark.radiance).abs().mean()) < 0.1 * float(change.abs().mean())
    assert float((coarse.radiance - dark.radiance).abs().mean()) < 0.25 * float(change.abs().mean())


def test_every_mesh_is_a_body_and_a_figure_of_limbs_is_one() -> None:
    """Bodies that touch darken each other at once; a figure's joints do not."""
    scene = still(sky())
    ball = scene.meshes[1]
    other = replace(ball, vertices=ball.vertices + torch.tensor([1.0, 0.0, 0.0]), name="other")
    scene = replace(scene, meshes=(*scene.meshes, other))
    made = occluder_of(scene, chosen_meshes(scene, ("ball", "other")), QUICK.sphere)
    assert made is not None
    used = made.binding.set.radii > 0
    left = made.binding.set.centres[:, 0] < 0.5
    assert torch.equal(made.bodies[used] == 0, left[used]) and set(made.bodies[used].tolist()) == {0, 1}
    light, camera = (
        prepare_light(sky()),
        Cameras.look_at([0.5, 1.2, 3.0], [0.5, 0.8, 0.0], width=64, height=64, fov_deg=30),
    )
    seen = rasterize(scene, camera)
    two, one = (
        light_left(scene, seen, occluder, light)
        for occluder in (made, replace(made, bodies=torch.zeros_like(made.bodies)))
    )
    assert bool((two <= one).all()) and float((one - two).max()) > 1e-3
    figure = walker(3000, 0)
    limbs = occluder_of(
        figure, chosen_meshes(figure, "moving"), SphereOptions(spheres=4, resolution=16, starts=1, teleports=0)
    )
    assert limbs is not None and set(limbs.bodies.tolist()) == {0}


def by_rays(scene: Scene, gbuffer: GBuffer, albedo: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Radiance (N,3) of some pixels with up-facing white floor, a ray through every texel; and the rows."""
    rows = (gbuffer.covered & (gbuffer.normal[..., 1] > 0.99)).reshape(-1).nonzero().reshape(-1)[::9]
    points, normals = gbuffer.position.reshape(-1, 3)[rows], gbuffer.normal.reshape(-1, 3)[rows]
    assert scene.environment is not None
    hidden = mesh_bits(RayCaster(scene.geometry), points, normals, 1e-4)
    return albedo * texel_sum(hidden, normals, prepare_light(scene.environment)), rows


@pytest.mark.parametrize("walls", [0, 1])
def test_it_takes_the_occluders_place_among_what_hides_the_sky(walls: int) -> None:
    """A ball alone, and beside a wall: each hides its part of the sky once."""
    scene = still(sky())
    if walls:
        corners = torch.tensor([[-1.2, 0, -3], [-1.2, 2, -3], [-1.2, 2, 3], [-1.2, 0, 3]])
        wall = Mesh(vertices=corners, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), name="wall")
        scene = replace(scene, meshes=(*scene.meshes, wall))
    usual = RenderOptions(
        ambient_visibility="traced", ambient=AmbientOptions(rays=64, ray_spacing=1), buffers=("gbuffer",)
    )
    wanted, rows = by_rays(scene, render(scene, view(), options=usual).buffers["gbuffer"], 0.8)
    error = {}
    for name, options in {
        "ambient": usual,
        "occluder": replace(usual, ambient_visibility="off", sky_shadow=QUICK),
        "both": replace(usual, sky_shadow=QUICK),
        "by depth images": replace(usual, ambient_visibility="horizon", sky_shadow=QUICK),
    }.items():
        found = render(scene, view(), options=options).radiance.reshape(-1, 3)[rows]
        error[name] = float((found - wanted).abs().mean() / wanted.mean())
    if walls:  # of which ambient visibility knows a number only
        assert max(error["both"], error["by depth images"]) < min(error["ambient"], error["occluder"])
    else:
        assert error["both"] < 0.25 * error["ambient"] and error["by depth images"] < 0.6 * error["ambient"]


def test_what_ambient_visibility_took_too_much_comes_back() -> None:
    """Before a dim part of the sky the ball hides less light than its share of the sky."""
    lost = render(still(sky()), view(), options=RenderOptions(sky_shadow=QUICK, buffers=("sky_shadow",)))
    assert float(lost.buffers["sky_shadow"].min()) < -0.01 and float(lost.radiance.min()) >= 0


def test_an_environment_without_light_takes_none_away() -> None:
    scene = replace(still(Environment(radiance=torch.zeros(32, 64, 3))), ambient=torch.full((3,), 0.5))
    assert bool(torch.isfinite(render(scene, view(), options=RenderOptions(sky_shadow=QUICK)).radiance).all())


def test_a_character_that_walks(data_dir: Path) -> None:
    """Its shadow follows it, and its spheres are fitted once."""
    scene = load(data_dir / "characters" / "CesiumMan.glb")
    low, high = scene.bounds
    y = float(low[1])
    floor = torch.tensor([[-2.0, y, -2], [-2, y, 2], [2, y, 2], [2, y, -2]])
    ground = Mesh(
        vertices=floor, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), name="floor", material=len(scene.materials)
    )
    scene = replace(
        scene, meshes=(*scene.meshes, ground), materials=(*scene.materials, Material(name="floor")), environment=sky()
    )
    camera = Cameras.look_at([2.0, 2.5, 2.5], [0.0, 0.5, 0.0], width=64, height=64, fov_deg=45)
    options = RenderOptions(
        sky_shadow=SkyShadowOptions(sphere=SphereOptions(spheres=24, resolution=32, starts=1, teleports=0)),
        buffers=("sky_shadow",),
    )
    first = render(scene.at(0.2), camera, options=options)
    other = render(scene.at(0.9), camera, options=options, history=first.history)
    lost = [image.buffers["sky_shadow"] for image in (first, other)]
    assert float(lost[0].max()) > 0.05 and float((lost[0] - lost[1]).abs().max()) > 0.02
    assert [row.reason for row in first.plan.rows if row.name == "sky_shadow"] == ["1 mesh, as 24 spheres, under lamps"]
    del high


def test_spheres_hide_nothing_of_a_convex_body_from_itself() -> None:
    """A box of twelve triangles: its spheres bulge out of its faces, which nothing hides."""
    box = replace(Mesh.box(1.0, [0.0, 0.5, 0.0]), name="ball")
    scene = replace(still(sky()), meshes=(box,))
    few = AmbientOptions(rays=16, ray_spacing=1)
    options = RenderOptions(
        ambient_visibility="traced", ambient=few, sky_shadow=QUICK, buffers=("gbuffer", SKY_SHADOW.name)
    )
    image = render(scene, view(), options=options)
    lost = image.buffers[SKY_SHADOW.name][image.buffers["gbuffer"].covered]
    whole = render(scene, view(), options=replace(options, buffers=(), shadows=False)).radiance
    assert len(lost) and float(lost.abs().max()) < 0.02 * float(whole.max())
    alone = render(scene, view(), options=replace(options, ambient_visibility="off"))
    assert float(alone.buffers[SKY_SHADOW.name].max()) > 0.05 * float(whole.max())
