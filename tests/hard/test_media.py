"""Media where numbers are in danger: lamps on surfaces and beside rays, eyes in solids, thin air, narrow peaks."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from media_scenes import LAMP, SUN, eye, fog, rmse, scattered, t1
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import Illumination, ScatteringLayer, scatter
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light

CAMERA = eye(40, 30)
WALL = torch.full((1, 30, 40), 7.0)
GRID = torch.rand(5, 6, 7, generator=torch.Generator().manual_seed(1)) + 0.5
KINDS = {"flat": {}, "height": {"density": 1.5, "falloff": 0.8}, "grid": {"density": GRID}}


def layer(medium, *lights: Light, camera: Cameras = CAMERA, depth: torch.Tensor = WALL, **options) -> ScatteringLayer:
    lit = Illumination(lights=lights, size=10.0)
    return scatter((medium,), camera, depth, lit, ScatterOptions(**{"block": 1, **options}))


def healthy(made: ScatteringLayer) -> bool:
    values = torch.cat([made.scattered.reshape(-1), made.transmittance.reshape(-1)])
    return bool(torch.isfinite(values).all()) and bool((values >= 0).all()) and bool((made.transmittance <= 1).all())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("light", [LAMP, SUN], ids=["lamp", "sun"])
def test_panels_find_what_many_steps_find(kind: str, light: Light) -> None:
    """Lamp inside, lamp outside, sun; every kind of density: ways inside of the box have forms of their own."""
    lights = [light] if light is SUN else [light, replace(LAMP, position=torch.tensor([1.0, 4.6, -4.5]))]
    for lamp in lights:
        how = {"camera": eye(16, 12), "depth": torch.full((1, 12, 16), 7.0), "light_steps": 64}
        quick = layer(fog(**KINDS[kind]), lamp, panels=32, **how).scattered
        slow = layer(fog(**KINDS[kind]), lamp, way="march", steps=512, **how).scattered
        # Towards a light, a grid's density is known from the centres of its cells.
        assert rmse(quick, slow) < (0.012 if kind == "grid" else 0.005)


@pytest.mark.parametrize("g", [-0.99, 0.99])
def test_peaks_of_the_phase_function_are_not_missed(g: float) -> None:
    behind = replace(LAMP, position=torch.tensor([0.5, 0.4, -7.5]))
    camera, depth = eye(20, 15), torch.full((1, 15, 20), 7.0)
    for light in (behind, SUN):
        quick = layer(fog(asymmetry=g), light, camera=camera, depth=depth).scattered
        slow = layer(fog(asymmetry=g), light, camera=camera, depth=depth, way="march", steps=1024).scattered
        assert float((quick / slow - 1).abs().max()) < 0.03  # of every ray: the mean is that of the brightest few


@pytest.mark.parametrize("way", ["slices", "walk"])
def test_a_lamp_on_a_surface_lights_the_fog_before_it(way: str) -> None:
    """On the floor, to the last digit: the floor is no shadow of itself, and nothing else stands in the way."""
    lamp = replace(LAMP, position=torch.tensor([1.6, -1.0, -6.5]))
    scene = replace(t1(lamp), meshes=t1(lamp).meshes[:2])  # floor and wall alone
    made = scattered(scene, CAMERA, way=way, block=1)
    assert healthy(made)
    assert rmse(made.scattered, scattered(scene, CAMERA, shadows=False, block=1).scattered) < 0.05


def test_pixels_around_a_lamp_are_integrated() -> None:
    camera = eye(200, 150)
    made = layer(fog(), LAMP, camera=camera, depth=torch.full((1, 150, 200), 7.0), block=3, halo_guard_px=20)
    where, _ = camera.project(LAMP.position.double()[None])
    centres = torch.stack(torch.meshgrid(torch.arange(150) + 0.5, torch.arange(200) + 0.5, indexing="ij"), dim=-1)
    near = (centres - where[0, 0].flip(0)).norm(dim=-1) < 19.9
    assert int(near.sum()) > 1000 and bool((made.integrated[0][near] == 1).all())
    assert float(made.integrated[0][~near].mean()) < 0.5


def test_a_ray_beside_a_lamp_is_no_matter_of_luck() -> None:
    """0.02 from it, where 16 to 128 equal steps are wrong by tens of per cent: equal angles and the table agree."""
    lamp = replace(LAMP, position=torch.tensor([0.02, 0.0, -4.1]))
    camera = Cameras.look_at((0, 0, 0), (0, 0, -1), width=1, height=1, fov_deg=1.0)
    depth = torch.full((1, 1, 1), 7.0)
    slow = layer(fog(), lamp, camera=camera, depth=depth, way="march", steps=1024).scattered
    quick = layer(fog(), lamp, camera=camera, depth=depth).scattered
    few = layer(fog(), lamp, camera=camera, depth=depth, way="march", steps=16, jitter=False).scattered
    torch.testing.assert_close(quick, slow, rtol=2e-3, atol=0)
    torch.testing.assert_close(few, slow, rtol=5e-3, atol=0)
    equal = layer(fog(), lamp, camera=camera, depth=depth, way="march", steps=16, jitter=False, equiangular=False)
    assert abs(float(equal.scattered.mean() / slow.mean()) - 1) > 0.15, "the case is hard"


def test_an_eye_in_a_solid_sees_no_fog() -> None:
    """Surfaces right before the eye, and at it: the way through the medium is nothing."""
    for depth in (1e-6, 1e-30):
        made = layer(fog(), LAMP, SUN, depth=torch.full((1, 30, 40), depth), block=2)
        assert healthy(made)
        assert float((1 - made.transmittance).max()) < 1e-5 and float(made.scattered.max()) < 1e-4


@pytest.mark.parametrize("block", [2, 3])
def test_air_that_is_too_thin_to_divide_by_is_no_division_by_nothing(block: int) -> None:
    """Far above its floor the medium has a density of nothing: what is interpolated would be divided by that."""
    medium = fog(density=1.0, falloff=10.0, floor=-5.0)
    made = layer(medium, LAMP, SUN, block=block)
    every = layer(medium, LAMP, SUN, block=1)
    assert healthy(made)
    assert 0.0 < float(every.scattered.max()) < 1e-15
    assert bool((made.integrated == 1).all()) and torch.equal(made.scattered, every.scattered)


def test_float64_in_is_the_same_picture() -> None:
    scene = t1(LAMP, SUN, medium=fog(density=1.5, falloff=0.8))
    usual = scattered(scene, CAMERA)
    medium = scene.media[0]
    double = replace(
        scene,
        media=(replace(medium, absorption=medium.absorption.double(), scattering=medium.scattering.double()),),
        meshes=tuple(replace(mesh, vertices=mesh.vertices.double()) for mesh in scene.meshes),
    )
    found = scattered(double, CAMERA)
    assert healthy(found)
    torch.testing.assert_close(found.transmittance.double(), usual.transmittance.double(), rtol=1e-5, atol=1e-6)
    assert rmse(found.scattered, usual.scattered) < 1e-3


def test_blocks_of_sky_and_object() -> None:
    """Rays of the sky end where the box does."""
    depth = torch.full((1, 30, 40), torch.inf)
    depth[0, 11:19, 13:22] = 3.0
    made, every = (layer(fog(), LAMP, SUN, depth=depth, block=block) for block in (3, 1))
    assert healthy(made) and rmse(made.scattered, every.scattered) < 0.02
