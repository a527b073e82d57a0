"""Lights that reach little of a picture: rays from the pixels of their tiles say what rays from all pixels say."""

from __future__ import annotations

from dataclasses import replace

import torch

from shadow_scenes import box, floor
from torchrender.effects.shadows.light_reach import light_reach
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.effects.shadows.shadow_map import light_visibility
from torchrender.effects.shadows.small_lights import FEWEST, small_light_visibility, small_lights
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.shading.ray_surface import ray_surface


def lamps(count: int) -> tuple[SpotLight, ...]:
    """Narrow spots in rows above a floor with posts."""
    places = [(-2.6 + 0.9 * (k % 6), -2.0 + 0.9 * (k // 6)) for k in range(count)]
    return tuple(
        SpotLight(position=torch.tensor([x, 1.2, z]), direction=torch.tensor([0.3, -1.0, 0.2]), inner_deg=8.0,
                  outer_deg=14.0, name=f"{x} {z}") for x, z in places
    )  # fmt: skip


def street(count: int) -> Scene:
    posts = [box((x - 0.05, 0.0, -3.0), (x + 0.05, 0.5, 3.0)) for x in (-2.3, -1.4, -0.5, 0.4, 1.3)]
    return Scene(meshes=(floor(), *posts), lights=lamps(count))


EYE = Cameras.look_at((0.0, 4.0, 4.0), (0.0, 0.0, 0.0), width=150, height=110)


def test_they_see_what_rays_from_every_pixel_see() -> None:
    scene = street(18)
    seen = rasterize(scene, Cameras.cat([EYE, Cameras.look_at((1.0, 3.0, 4.0), (0.0, 0, 0), width=150, height=110)]))
    reach, caster = light_reach(scene, seen), RayCaster(scene.geometry)
    chosen = small_lights(reach, dict(enumerate(scene.lights)), ShadowOptions())
    assert len(chosen) >= FEWEST
    found = small_light_visibility(caster, {n: scene.lights[n] for n in chosen}, seen, reach)
    dark = 0
    for number, visibility in found.items():
        light = scene.lights[number]
        toward = light.position - seen.position
        lit = seen.covered & (light.cone(-(toward @ light.direction.double()) / toward.norm(dim=-1)) > 0)
        lit &= (toward * seen.geometric_normal).sum(-1) > 0  # others take none anyway
        wanted = traced_visibility(caster, light, seen)
        assert torch.equal(visibility[lit], wanted[lit])
        dark += int((wanted[lit] == 0).sum())
        by_map = light_visibility(scene, light, seen, ShadowOptions(filter="none", size=512))
        assert int((by_map != visibility)[lit].sum()) <= 2
    assert dark > 200


def test_few_lights_wide_ones_and_soft_filters_keep_their_maps() -> None:
    scene = street(18)
    reach = light_reach(scene, rasterize(scene, EYE))
    lights = dict(enumerate(scene.lights))
    assert not small_lights(reach, {n: lights[n] for n in range(FEWEST - 1)}, ShadowOptions())
    for options in (ShadowOptions(filter="pcf"), ShadowOptions(edges="map")):
        assert not small_lights(reach, lights, options)
    sun = replace(scene, lights=(*scene.lights, DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.1]))))
    reach = light_reach(sun, rasterize(sun, EYE))
    assert 18 not in small_lights(reach, dict(enumerate(sun.lights)), ShadowOptions())


def test_the_picture_is_that_of_traced_shadows() -> None:
    scene = street(18)
    options = RenderOptions(reflections="off")
    quick, exact = (
        render(scene, EYE, options=replace(options, point_shadows=kind)).radiance for kind in ("maps", "traced")
    )
    assert float((quick - exact).abs().max()) <= 1e-5 * float(exact.max())


def mirror_over_street(count: int) -> tuple[Scene, Cameras]:
    """The posts and their lamps before an upright mirror."""
    mirror = replace(box((-3.0, 0.0, -3.2), (3.0, 2.5, -3.1)), material=1)
    scene = street(count)
    polished = Material(name="mirror", metallic=1.0, roughness=0.0)
    scene = replace(scene, meshes=(*scene.meshes, mirror), materials=(Material(), polished))
    return scene, Cameras.look_at((0.0, 1.6, 0.5), (0.0, 1.0, -3.0), width=90, height=60)


def test_mirrors_ask_many_small_lights_by_rays() -> None:
    """No map of everything is drawn, and hits are as bright as when each light has a fine one."""
    scene, eye = mirror_over_street(FEWEST)
    options = RenderOptions(reflections="traced", buffers=("scene_shadow_map",))
    image = render(scene, eye, options=options)
    assert all(cast is None for cast in image.buffers["scene_shadow_map"])
    few = replace(scene, lights=scene.lights[: FEWEST - 1])
    drawn = render(few, eye, options=options)
    assert all(cast is not None for cast in drawn.buffers["scene_shadow_map"])
    away = SpotLight(position=torch.tensor([0.0, 50.0, 0.0]), direction=torch.tensor([0.0, 1.0, 0.0]))
    by_rays = render(replace(few, lights=(*few.lights, away)), eye, options=options)
    assert all(cast is None for cast in by_rays.buffers["scene_shadow_map"])
    found, wanted = by_rays.radiance, drawn.radiance
    assert float(wanted.max()) > 0.1
    assert float(((found - wanted).abs().amax(-1) > 0.05 * wanted.max()).double().mean()) < 0.01


def test_hits_of_rays_are_listed_and_asked_in_one_row() -> None:
    scene = street(18)
    caster = RayCaster(scene.geometry)
    origins, directions = (v.reshape(-1, 3) for v in EYE.rays())
    surface = ray_surface(scene, origins, directions, caster.first_hit(origins, directions), 1e-2).image
    seen = rasterize(scene, EYE)
    found = small_light_visibility(caster, dict(enumerate(scene.lights)), surface, light_reach(scene, surface))
    for number, light in enumerate(scene.lights):
        toward = light.position - seen.position
        lit = seen.covered & (light.cone(-(toward @ light.direction.double()) / toward.norm(dim=-1)) > 0)
        lit &= (toward * seen.geometric_normal).sum(-1) > 0
        wanted = traced_visibility(caster, light, seen)
        assert int((found[number].reshape(wanted.shape) != wanted)[lit].sum()) <= 1
